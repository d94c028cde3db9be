"""Targets that steer: itineraries, lanes, and the model that moves them."""
