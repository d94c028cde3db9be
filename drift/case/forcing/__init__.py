"""Winds and currents in a case file, and their errors."""
