"""Shorelines: polygons of land, edges as the kernels see them, stretches of coast."""
