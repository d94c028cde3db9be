"""Marginal posteriors of speeds, courses, times and destinations, before and after each update."""
