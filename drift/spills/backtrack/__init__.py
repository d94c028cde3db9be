"""Where a spill came from, backward from its finds."""
