"""Shorelines: land polygons, edges for the kernels, stretches of coast and land masses."""
