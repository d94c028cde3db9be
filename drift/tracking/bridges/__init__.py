"""Brownian bridges in closed form: motion between known positions, without particles.

Position distributions, areas, crossings of a line and their times, after Nunez, Singham and
Atkinson 2020 (doi:10.1080/01605682.2019.1570806), and the spread rate K fitted to real tracks.
"""
