"""The Earth and files that describe it: sphere, boxes, notation, forcing and shorelines.

This package knows nothing of particles.
"""
