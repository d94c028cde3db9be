"""Winds and currents in a case file, and how wrong they may be."""
