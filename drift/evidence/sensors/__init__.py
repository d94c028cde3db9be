"""Sensors of a case: the sonar equation and its tables, and tables of POD."""
