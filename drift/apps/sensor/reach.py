"""Where a sensor hears, computed: round its place by bearing and range, and on a grid of longitude
and latitude.

A look is one instant: it detects with probability Phi(signal excess / fluctuation), averaged over
the `unknown` of the sensor, or with that of its table. Sound passes land, as it does in a run; a
target ashore is heard by no sonar there.
"""

import math

import numpy as np

from drift.apps.sensor.records import Looked, Question, Reach
from drift.evidence.sensors import grid_pod, hearing, unknown
from drift.evidence.sensors.hearing import Ear
from drift.evidence.sensors.records import PodGrid
from geo import sphere
from geo.array import Array
from geo.notation import NMI

HALF = 0.5  # probability of detection that tells ranges
FAINT = 0.01  # probability of detection up to which the map goes
LEAST, MOST = 10 * NMI, 80 * 60 * NMI  # [m] extents; the map is no wider than a hemisphere
MARGIN = 1.04  # of the extent beyond the last that is heard
BEARINGS, RINGS = 360, 1201
# cells along a side of the grid, odd: the sensor is in the middle; all round a pole
SIDE, ROUND = 401, 1440


def reach(asked: Question) -> Reach:
    """Return where a sensor hears."""
    bearing = np.arange(BEARINGS) * hearing.TURN / BEARINGS
    far = _horizon(asked)
    # So fine that a table's ring of a quarter mile is met, where it goes to 300 miles.
    found = _around(asked, bearing, np.linspace(0.0, far, RINGS))
    heard = np.flatnonzero((found.pod > FAINT).any(axis=0))
    edge = far * (heard[-1] + 1) / (RINGS - 1) if heard.size else 0.0
    extent = min(max(edge * MARGIN, LEAST), MOST)
    ranges = np.linspace(0.0, extent, RINGS)
    found = _around(asked, bearing, ranges)
    lon, lat = _grid(asked.place, extent)
    x, y = np.meshgrid(np.radians(lon), np.radians(lat))
    last = np.array([(zones(ranges, row) or [(0.0, 0.0)])[-1][1] for row in found.pod])
    first = [(zones(ranges, row) or [(math.inf, 0.0)])[0] for row in found.pod]
    near = np.array([end if begin == 0 else 0.0 for begin, end in first])
    return Reach(asked, extent, bearing, ranges, found, last, near, lon, lat, look(asked, x, y))


def look(asked: Question, lon: Array, lat: Array) -> Looked:
    """Return what a look detects at places [rad], any shape."""
    at = math.radians(asked.place[0]), math.radians(asked.place[1])
    sees = asked.sensor.sees
    if isinstance(sees, PodGrid):
        return Looked(np.asarray(grid_pod.chance(sees, at, asked.time, lon, lat)), None)
    source = np.array(asked.level)
    over = hearing.over(Ear(sees, asked.beams), at, asked.heading, asked.time, lon, lat, source)
    values, shares = unknown.offsets(sees.unknown, sees.fluctuation)
    pod = sum(
        share * hearing.chance(sees, over + value)
        for value, share in zip(values, shares, strict=True)
    )
    return Looked(np.asarray(pod), np.where(np.isfinite(over), over, np.nan))


def _around(asked: Question, bearing: Array, ranges: Array) -> Looked:
    """Return what a look detects by bearing and range."""
    at = np.radians(asked.place)
    east, north = np.sin(bearing)[:, None] * ranges, np.cos(bearing)[:, None] * ranges
    return look(asked, *sphere.destination(at[0], at[1], east, north))


def _horizon(asked: Question) -> float:
    """Return a range [m] beyond which nothing is detected."""
    sees = asked.sensor.sees
    if not isinstance(sees, PodGrid):
        return min(float(Ear(sees, asked.beams).ranges[-1]), MOST)
    if sees.range is not None:
        return min(float(sees.range[-1]), MOST)
    assert sees.lon is not None
    assert sees.lat is not None
    x, y = np.meshgrid(sees.lon, sees.lat)
    seen = (grid_pod.pod_at(sees, asked.time) > 0) | np.zeros(x.shape, bool)
    at = np.radians(asked.place)
    far = sphere.distance(at[0], at[1], x[seen], y[seen])
    # A value reaches as far as the points about it.
    cell = sphere.RADIUS * math.hypot(sees.lon[1] - sees.lon[0], sees.lat[1] - sees.lat[0])
    return min(float(far.max(initial=LEAST)) + cell, MOST)


def _grid(place: tuple[float, float], extent: float) -> tuple[Array, Array]:
    """Return longitudes and latitudes [deg] of a grid that holds a circle about a place."""
    half = math.degrees(extent / sphere.RADIUS)
    lat = place[1] + np.linspace(-half, half, SIDE)
    if abs(place[1]) + half >= 89.0:  # a pole is in it, or next to it
        lat = lat[np.abs(lat) <= 90.0]
        return -180.0 + (np.arange(ROUND) + 0.5) * 360.0 / ROUND, lat
    wide = math.degrees(
        math.asin(min(math.sin(math.radians(half)) / math.cos(math.radians(place[1])), 1.0))
    )
    return place[0] + np.linspace(-wide, wide, SIDE), lat


def zones(ranges: Array, pod: Array) -> list[tuple[float, float]]:
    """Return from and to which ranges [m] a probability of detection is 50 % or more, straight
    between those given.
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


def order(found: Reach) -> Array:
    """Return bearings (360,), by number, from the one that is heard farthest to the least far; of
    ties the most heard first.
    """
    return np.lexsort(
        (
            np.arange(BEARINGS),
            -np.round(found.around.pod.mean(axis=1), 9),
            -np.round(found.farthest),
        )
    )
