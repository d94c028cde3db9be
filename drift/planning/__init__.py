"""Search plans: for search units, for patrols along a coast, and for towed arrays."""
