"""What a run drifts in: its winds, currents and coast, opened once; refusals of what has none."""
