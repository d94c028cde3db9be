"""`drift track`: estimate the track of a lost target, its areas, and a path to regain contact."""
