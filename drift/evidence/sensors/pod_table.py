"""Probability of detection from a table: interpolated at particles, and as tables for kernels.

The kernels are those of kernels.evidence.glimpse, which move particles past the sensor.
"""

import math

import numpy as np

from drift.evidence.sensors import hearing
from drift.evidence.sensors.hearing import TURN
from drift.evidence.sensors.records import PodGrid
from geo import notation, sphere
from geo.array import Array
from kernels.evidence import glimpse
from kernels.evidence.glimpse import Pods

MOST_RINGS = 4000  # most ranges of a resampled table
# fewest ranges and bearings for a table with uneven ones, whose corners lie between even points
LEAST_RINGS, LEAST_RAYS = 200, 720


def pod_at(grid: PodGrid, time: np.datetime64) -> Array:
    """Return the table (lat, lon) or (b, r) at a time, interpolated linearly between its times."""
    if not grid.times.size:
        return np.asarray(grid.pod[0])
    known = np.array([float(notation.epoch(moment)) for moment in grid.times])
    when = float(notation.epoch(time))
    k = int(np.clip(np.searchsorted(known, when, side="right") - 1, 0, max(len(known) - 2, 0)))
    if len(known) == 1:
        return np.asarray(grid.pod[0])
    share = float(np.clip((when - known[k]) / (known[k + 1] - known[k]), 0, 1))
    return np.asarray((1 - share) * grid.pod[k] + share * grid.pod[k + 1])


def chance(
    grid: PodGrid, place: tuple[float, float], time: np.datetime64, lon: Array, lat: Array
) -> Array:
    """Return the probability of detection at positions, shape (n,).

    Args:
        grid: the table.
        place: position of the sensor (lon, lat) [rad].
        time: of the look.
        lon: longitudes [rad], shape (n,).
        lat: latitudes [rad], shape (n,).
    """
    table = pod_at(grid, time)
    if grid.range is not None:
        assert grid.bearing is not None
        east, north = sphere.offset(*place, lon, lat)
        return _polar(table, grid.bearing, grid.range, east, north)
    assert grid.lon is not None
    assert grid.lat is not None
    x = np.mod(lon - grid.lon[0], TURN) / (grid.lon[1] - grid.lon[0])
    y = (lat - grid.lat[0]) / (grid.lat[1] - grid.lat[0])
    ny, nx = table.shape
    inside = (x <= nx - 1) & (y >= 0) & (y <= ny - 1)
    j, i = np.clip(y.astype(int), 0, ny - 2), np.clip(x.astype(int), 0, nx - 2)
    v, u = y - j, x - i
    found = (1 - v) * ((1 - u) * table[j, i] + u * table[j, i + 1]) + v * (
        (1 - u) * table[j + 1, i] + u * table[j + 1, i + 1]
    )
    return np.where(inside, found, 0.0)


def tables(grid: PodGrid, time: np.datetime64, lasting: float) -> Pods:
    """Return the table at a time in the form that kernels take.

    Args:
        grid: the table.
        time: of the table.
        lasting: duration of the watch [s], for which a POD without its own duration holds.
    """
    table, rate = pod_at(grid, time), 1 / (lasting if math.isnan(grid.per) else grid.per)
    if grid.range is not None:
        assert grid.bearing is not None
        rings, rays = _even(grid.range), hearing.even(grid.bearing, hearing.MOST_RAYS)
        if rays > 1 and not np.allclose(
            np.mod(grid.bearing * rays / TURN + 0.5, 1.0), 0.5, atol=1e-3
        ):
            rays = max(rays, LEAST_RAYS)
        by_range = np.stack([np.interp(rings, grid.range, row) for row in table])
        found = hearing.round_circle(np.arange(rays) * TURN / rays, grid.bearing, by_range)
        return Pods(
            glimpse.ROUND,
            found.astype(np.float32),
            float(rings[1] - rings[0]),
            rate,
            float(rings[0]),
        )
    assert grid.lon is not None
    assert grid.lat is not None
    d_lon, d_lat = float(grid.lon[1] - grid.lon[0]), float(grid.lat[1] - grid.lat[0])
    middle = [
        int(sphere.to_binary(math.degrees(0.5 * (axis[0] + axis[-1]))))
        for axis in (grid.lon, grid.lat)
    ]
    narrow = d_lon * max(math.cos(float(np.abs(grid.lat).max())), 0.01)
    return Pods(
        glimpse.PLACES,
        table.astype(np.float32),
        sphere.RADIUS * min(d_lat, narrow),
        rate,
        middle=(middle[0], middle[1]),
        cell=(d_lon / sphere.UNIT, d_lat / sphere.UNIT),
    )


def _even(ranges: Array) -> Array:
    """Return evenly spaced ranges [m], as fine as those of a table; at most MOST_RINGS."""
    if len(ranges) == 1:
        return np.array([ranges[0], ranges[0] + 1.0])
    gaps = np.diff(ranges)
    many = math.ceil((ranges[-1] - ranges[0]) / float(gaps.min()) - 1e-6) + 1
    if not np.allclose(gaps, gaps[0], rtol=1e-3):
        many = max(many, LEAST_RINGS)
    return np.linspace(ranges[0], ranges[-1], min(max(many, 2), MOST_RINGS))


def _polar(table: Array, bearing: Array, ranges: Array, east: Array, north: Array) -> Array:
    """Return the values of a table (b, r) at (east, north) [m]; 0 beyond its last range."""
    far, turned = np.hypot(east, north), np.mod(np.arctan2(east, north), TURN)
    ring = np.interp(far, ranges, np.arange(len(ranges)))
    k = np.minimum(ring.astype(int), max(len(ranges) - 2, 0))
    share = ring - k
    found = np.empty(far.shape)
    after = np.minimum(k + 1, len(ranges) - 1)
    if len(bearing) == 1:
        found = (1 - share) * table[0, k] + share * table[0, after]
    else:
        b = np.searchsorted(bearing, turned, side="right") - 1
        c = (b + 1) % len(bearing)
        span = np.mod(bearing[c] - bearing[b], TURN)
        part = np.mod(turned - bearing[b], TURN) / np.where(span > 0, span, TURN)
        low = (1 - part) * table[b, k] + part * table[c, k]
        high = (1 - part) * table[b, after] + part * table[c, after]
        found = (1 - share) * low + share * high
    return np.where(far <= ranges[-1] * (1 + math.ulp(1.0)), found, 0.0)
