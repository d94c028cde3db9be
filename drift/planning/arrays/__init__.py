"""Towed and fixed arrays: what to process of what they hear."""
