"""Compute a sensor's reach: detection by bearing and range, and on a longitude-latitude grid.

A look is one instant. It detects with probability Phi(signal excess / fluctuation), averaged over
the `unknown` of the sensor, or with that of its POD table. Land does not block sound, as in a run,
where a sonar detects no stranded target.
"""

import math

import numpy as np

from drift.apps.sensor.records import Looked, Question, Reach
from drift.evidence.sensors import hearing, pod_table, unknown
from drift.evidence.sensors.hearing import Receiver
from drift.evidence.sensors.records import PodGrid
from geo import sphere
from geo.array import Array
from geo.notation import NMI

HALF = 0.5  # probability of detection that defines the range
FAINT = 0.01  # probability of detection at the edge of the map
LEAST, MOST = 10 * NMI, 80 * 60 * NMI  # [m] limits of the extent; at most a hemisphere
MARGIN = 1.04  # extent of the map relative to the farthest detection
BEARINGS, RINGS = 360, 1201
# cells along a side of the grid, odd: the sensor is in the middle; in longitude round a pole
SIDE, ROUND = 401, 1440


def reach(question: Question) -> Reach:
    """Return the reach of a sensor: detection by bearing and range and on a grid, and ranges."""
    bearing = np.arange(BEARINGS) * hearing.TURN / BEARINGS
    horizon = _horizon(question)
    # Fine enough to resolve a ring of a quarter mile in a table that goes to 300 miles.
    found = _around(question, bearing, np.linspace(0.0, horizon, RINGS))
    detected = np.flatnonzero((found.pod > FAINT).any(axis=0))
    edge = horizon * (detected[-1] + 1) / (RINGS - 1) if detected.size else 0.0
    extent = min(max(edge * MARGIN, LEAST), MOST)
    ranges = np.linspace(0.0, extent, RINGS)
    found = _around(question, bearing, ranges)
    lon, lat = _grid(question.place, extent)
    x, y = np.meshgrid(np.radians(lon), np.radians(lat))
    last = np.array([(zones(ranges, row) or [(0.0, 0.0)])[-1][1] for row in found.pod])
    first = [(zones(ranges, row) or [(math.inf, 0.0)])[0] for row in found.pod]
    near = np.array([end if begin == 0 else 0.0 for begin, end in first])
    return Reach(
        question, extent, bearing, ranges, found, last, near, lon, lat, look(question, x, y)
    )


def look(question: Question, lon: Array, lat: Array) -> Looked:
    """Return the detection of a look at positions lon, lat [rad] of any shape."""
    at = math.radians(question.place[0]), math.radians(question.place[1])
    sees = question.sensor.sees
    if isinstance(sees, PodGrid):
        return Looked(np.asarray(pod_table.chance(sees, at, question.time, lon, lat)), None)
    source = np.array(question.level)
    excess = hearing.signal_excess_of_sources(
        Receiver(sees, question.beams), at, question.heading, question.time, lon, lat, source
    )
    values, shares = unknown.offsets(sees.unknown, sees.fluctuation)
    pod = sum(
        share * hearing.instantaneous_pod(sees, excess + value)
        for value, share in zip(values, shares, strict=True)
    )
    return Looked(np.asarray(pod), np.where(np.isfinite(excess), excess, np.nan))


def _around(question: Question, bearing: Array, ranges: Array) -> Looked:
    """Return the detection by bearing [rad] and range [m], shape (bearings, ranges)."""
    at = np.radians(question.place)
    east, north = np.sin(bearing)[:, None] * ranges, np.cos(bearing)[:, None] * ranges
    return look(question, *sphere.destination(at[0], at[1], east, north))


def _horizon(question: Question) -> float:
    """Return a range [m] beyond which nothing is detected."""
    sees = question.sensor.sees
    if not isinstance(sees, PodGrid):
        return min(float(Receiver(sees, question.beams).ranges[-1]), MOST)
    if sees.range is not None:
        return min(float(sees.range[-1]), MOST)
    assert sees.lon is not None
    assert sees.lat is not None
    x, y = np.meshgrid(sees.lon, sees.lat)
    covered = (pod_table.pod_at(sees, question.time) > 0) | np.zeros(x.shape, bool)
    at = np.radians(question.place)
    distances = sphere.distance(at[0], at[1], x[covered], y[covered])
    # A value of the table applies up to the next points.
    cell = sphere.RADIUS * math.hypot(sees.lon[1] - sees.lon[0], sees.lat[1] - sees.lat[0])
    return min(float(distances.max(initial=LEAST)) + cell, MOST)


def _grid(place: tuple[float, float], extent: float) -> tuple[Array, Array]:
    """Return longitudes and latitudes [deg] of a grid that contains a circle [m] around a place."""
    half = math.degrees(extent / sphere.RADIUS)
    lat = place[1] + np.linspace(-half, half, SIDE)
    if abs(place[1]) + half >= 89.0:  # the grid contains a pole, or is next to it
        lat = lat[np.abs(lat) <= 90.0]
        return -180.0 + (np.arange(ROUND) + 0.5) * 360.0 / ROUND, lat
    wide = math.degrees(
        math.asin(min(math.sin(math.radians(half)) / math.cos(math.radians(place[1])), 1.0))
    )
    return place[0] + np.linspace(-wide, wide, SIDE), lat


def zones(ranges: Array, pod: Array) -> list[tuple[float, float]]:
    """Return the zones (from, to) [m] in which the probability of detection is 50 % or more.

    It is interpolated linearly between the ranges.
    """
    inside = np.concatenate([[False], pod >= HALF, [False]])
    begins, ends = (
        np.flatnonzero(inside[1:] & ~inside[:-1]),
        np.flatnonzero(~inside[1:] & inside[:-1]) - 1,
    )
    found = []
    for a, b in zip(begins, ends, strict=True):
        first = ranges[0] if a == 0 else np.interp(HALF, pod[a - 1 : a + 1], ranges[a - 1 : a + 1])
        last = (
            ranges[-1]
            if b == len(ranges) - 1
            else np.interp(HALF, pod[b : b + 2][::-1], ranges[b : b + 2][::-1])
        )
        found.append((float(first), float(last)))
    return found


def bearings_by_range(found: Reach) -> Array:
    """Return the bearings [deg], shape (360,), in descending order of range.

    Among equal ranges the higher mean probability of detection comes first.
    """
    return np.lexsort(
        (
            np.arange(BEARINGS),
            -np.round(found.around.pod.mean(axis=1), 9),
            -np.round(found.farthest),
        )
    )
