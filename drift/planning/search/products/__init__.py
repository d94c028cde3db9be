"""Output files and pictures of a search plan."""
