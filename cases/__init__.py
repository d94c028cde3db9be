"""Runnable cases as data; drift.case.file finds them by name."""
