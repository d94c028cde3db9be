"""Backtrack: estimate where and when a spill was released, from its finds."""
