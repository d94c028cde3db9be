"""Errors of winds and currents: their law, and what buoys and reports on scene show of them."""
