"""Grids: where the points of a variable lie, and the weights that carry values from any layout to a regular one."""
