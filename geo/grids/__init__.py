"""Grids: where the points of a variable lie, and weights that regrid values to a regular grid."""
