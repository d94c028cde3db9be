"""Sonars in a case file: sensors, ships that tow arrays, and scarce processing."""
