"""The next patrols of a spill: which stretches of coast, by which team, on which day."""
