"""Output files and pictures of a spill."""
