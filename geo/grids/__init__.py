"""Grids: where the points of a variable lie, and the weights that carry values to a regular grid."""
