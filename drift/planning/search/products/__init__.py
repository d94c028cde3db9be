"""Files and pictures of a plan."""
