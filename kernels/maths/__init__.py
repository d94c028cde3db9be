"""Point mathematics: the sphere, sines on every backend, random numbers."""
