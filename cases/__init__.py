"""Runnable cases as data; drift.case finds them by name."""
