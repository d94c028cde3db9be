"""Times of slices: units and calendars, means over intervals, overlapping forecast runs."""
