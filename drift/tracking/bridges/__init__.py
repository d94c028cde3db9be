"""Brownian bridges in closed form: what moves between places that are known, without particles.

Position laws, areas, crossings of a line and their times, after Nunez, Singham and Atkinson 2020
(doi:10.1080/01605682.2019.1570806), and the spread rate K from real tracks.
"""
