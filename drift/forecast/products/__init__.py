"""Output files and pictures of a forecast."""
