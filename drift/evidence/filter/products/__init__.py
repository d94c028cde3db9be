"""Files and pictures of a search."""
