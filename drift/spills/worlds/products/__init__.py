"""Files and pictures of a spill."""
