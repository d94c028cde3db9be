"""Constants and a case for the tests of drift track."""

from pyproj import Geod

from geo import sphere

EARTH = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
SMALL = {"particles": "600"}
SPACE = {"g": "http://www.topografix.com/GPX/1/1"}
DOUBTFUL = """
title = "t"
start = "2026-03-05T00:00Z"
duration = "30 min"
detections = "d.csv"
particles = 40
land = "ignore"
[tracker]
at = "14N 077W"
[[sensor]]
name = "radar"
reach = "18 nmi"
range_ambiguity = 0.05
bearing_ambiguity = 1
on = false
[[method]]
name = "first"
fastest = "32 kn"
[[method]]
name = "second"
fastest = "40 kn"
"""
