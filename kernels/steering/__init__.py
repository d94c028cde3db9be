"""One step of what steers: itineraries, paths and their pieces."""
