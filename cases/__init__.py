"""Runnable cases as data; drift.case.case finds them by name."""
