"""Real tracks of drifters, ships and animals: believable fixes and clustered means."""
