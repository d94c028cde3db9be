"""Patrol plans of a spill: which team visits which stretches of coast on which day."""
