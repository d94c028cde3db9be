"""Files and pictures of a forecast."""
