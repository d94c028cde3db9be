"""Debris that contacts report, and particles guided toward it."""
