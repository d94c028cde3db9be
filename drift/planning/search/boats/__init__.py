"""Constraints of search units: seas of boats, depths, courses and daylight."""
