"""Clouds that follow one target, Brownian bridges, and tracks of real drifters."""
