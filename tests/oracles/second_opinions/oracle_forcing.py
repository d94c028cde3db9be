"""Forcing for the second opinion on drift: files read by xarray and interpolated on their own
grids, and the built-in flows.

Nothing of drift, geo or kernels is used. Positions are degrees, times seconds after the case's
start, everything else SI.
"""

import itertools
from functools import cache

import numpy as np
import pyproj
import shapely
import xarray as xr
from oracle import DAY, DEG, HOUR, Array, Field, R
from scipy import ndimage
from scipy.interpolate import RectBivariateSpline

# [m] how far from wet water a narrow bay still has the current of the nearest wet point
FILL = 30_000.0


def planes(
    times: Array, fields: tuple[Array, ...], t: Array, row: Array, column: Array
) -> tuple[Array, ...]:
    """Return values of fields (t, y, x) linear in time and bilinear between nodes;

    NaN off the nodes or the times.
    """
    nt, ny, nx = fields[0].shape
    t = np.broadcast_to(t, row.shape)
    k = np.clip(np.searchsorted(times, t, side="right") - 1, 0, max(nt - 2, 0))
    after = np.where(
        nt > 1,
        (t - times[k]) / np.where(nt > 1, times[np.minimum(k + 1, nt - 1)] - times[k], 1),
        0.0,
    )
    known = (
        (row >= 0)
        & (row <= ny - 1)
        & (column >= 0)
        & (column <= nx - 1)
        & (after >= 0)
        & (after <= 1)
    )
    j, i = np.clip(row, 0, ny - 1.001), np.clip(column, 0, nx - 1.001)
    j, i = np.floor(np.nan_to_num(j)).astype(int), np.floor(np.nan_to_num(i)).astype(int)
    y, x = row - j, column - i
    told = []
    for values in fields:
        total = np.zeros(row.shape)
        for step, share in ((0, 1 - after), (1, after)):
            kk = np.minimum(k + step, nt - 1)
            low = (1 - x) * values[kk, j, i] + x * values[kk, j, i + 1]
            high = (1 - x) * values[kk, j + 1, i] + x * values[kk, j + 1, i + 1]
            total += share * ((1 - y) * low + y * high)
        told.append(np.where(known, total, np.nan))
    return tuple(told)


def filled(values: Array, spacing: tuple[float, float]) -> Array:
    """Return values (t, y, x) with land taken from the nearest wet node, as far as FILL [m];
    spacing of rows and columns [m].
    """
    dry = ~np.isfinite(values).all(axis=0)
    if not dry.any():
        return values
    away, (j, i) = ndimage.distance_transform_edt(dry, sampling=spacing, return_indices=True)
    return np.where(away <= FILL, values[:, j, i], np.nan)


def axes(times: Array, lon: Array, lat: Array, u: Array, v: Array) -> Field:
    """Return a field on longitude and latitude axes, which need not be even; shape of u and v (t,
    lat, lon).
    """
    if lat[0] > lat[-1]:
        lat, u, v = lat[::-1], u[:, ::-1], v[:, ::-1]
    spacing = (
        np.diff(lat).mean() * DEG * R,
        np.diff(lon).mean() * DEG * R * np.cos(lat.mean() * DEG),
    )
    wet = np.where(np.isfinite(u + v), 1.0, np.nan)
    u, v = filled(u * wet, spacing), filled(v * wet, spacing)

    def at(t: float | Array, x: Array, y: Array) -> tuple[Array, Array]:
        row = np.interp(y, lat, np.arange(lat.size), np.nan, np.nan)
        column = np.interp(x, lon, np.arange(lon.size), np.nan, np.nan)
        return planes(times, (u, v), t, row, column)

    return at


def projected(times: Array, x: Array, y: Array, u: Array, v: Array, proj: str) -> Field:
    """Return a field on a projection's plane [m], with components along its axes."""
    into = pyproj.Proj(proj)
    spacing = float(np.diff(y).mean()), float(np.diff(x).mean())
    u, v = filled(u, spacing), filled(v, spacing)

    def at(t: float | Array, lon: Array, lat: Array) -> tuple[Array, Array]:
        px, py = into(lon, lat)
        qx, qy = into(lon, lat + 1e-4)  # a step to the north: where north points on the plane
        length = np.hypot(qx - px, qy - py)
        s, c = (qx - px) / length, (qy - py) / length
        a, b = planes(times, (u, v), t, (py - y[0]) / spacing[0], (px - x[0]) / spacing[1])
        return a * c - b * s, a * s + b * c

    return at


def after(data: xr.Dataset, start: np.datetime64) -> Array:
    """Return a file's times [s after start]."""
    return (data["time"].values - start) / np.timedelta64(1, "s")


def chaikin(line: Array, rounds: int) -> Array:
    """Cut the corners of a polyline at quarters (Chaikin 1974), its ends kept."""
    for _ in range(rounds):
        quarters = [
            p + share * (q - p) for p, q in itertools.pairwise(line) for share in (0.25, 0.75)
        ]
        line = np.array([line[0], *quarters, line[-1]])
    return line


# Of the built-in "gulf" (geo/forcing/analytic.py, which is its only definition): axis of the jet,
# edge of the shelf [deg], eddies
LOOP = (
    "-85.6 20 -85.9 21.8 -86.6 23.4 -87.2 25 -87.1 26.4 -86.2 27.3 -85 27 -84.3 25.7 -83.9 24.5 -82.9 23.8 -81.2 23.9 "
    "-80 24.6 -79.6 26 -79.7 28 -79.4 30.5"
)
SHELF = (
    "-98 25 -96.6 27 -94.5 28.3 -91.5 28.4 -89 29.2 -87 29.9 -85 29 -83.7 27.6 -83 26 -82.4 24.7 -80.9 24.6 "
    "-80.1 25.4 -80 27 -80.6 30.5"
)
EDDIES = (  # lon, lat [deg], radius [km], swirl [m/s], drift west and north [km/day]
    (-89.6, 25.6, 115.0, -0.75, 3.0, 0.3),
    (-88.2, 27.6, 45.0, 0.45, -1.0, -0.8),
    (-88.0, 23.9, 55.0, 0.40, 1.0, 0.6),
    (-92.6, 26.6, 70.0, 0.35, 1.5, 0.0),
    (-94.3, 24.2, 95.0, -0.40, 2.0, 0.2),
)


def gulf(
    since_2000: float, west: float, south: float, east: float, north: float, spacing: float = 0.05
) -> Field:
    """Return the built-in current "gulf" by splines of its streamfunction on a fine grid;
    since_2000: start [s] of its clock.
    """
    lon, lat = np.arange(west, east, spacing), np.arange(south, north, spacing)
    x, y = np.meshgrid(lon, lat)
    squeeze = np.array([np.cos(26 * DEG), 1.0]) * R * DEG

    def right_of(text: str) -> Array:
        """Distance [m], positive to the right of a smoothed line whose ends go on straight."""
        line = chaikin(np.array(text.split(), float).reshape(-1, 2), 3) * squeeze
        line[0] += 20 * (line[0] - line[1]) / np.hypot(*(line[0] - line[1])) * 1e5
        line[-1] += 20 * (line[-1] - line[-2]) / np.hypot(*(line[-1] - line[-2])) * 1e5
        shape, points = shapely.LineString(line), np.stack([x, y], -1) * squeeze
        along = shapely.line_locate_point(shape, shapely.points(points))
        here = shapely.get_coordinates(shapely.line_interpolate_point(shape, along)).reshape(
            points.shape
        )
        ends = np.cumsum(np.hypot(*np.diff(line, axis=0).T))
        k = np.clip(np.searchsorted(ends, along - 1e-6), 0, len(ends) - 1)
        d, e = points - here, np.diff(line, axis=0)[k]
        return np.hypot(d[..., 0], d[..., 1]) * np.sign(
            e[..., 1] * d[..., 0] - e[..., 0] * d[..., 1]
        )

    side = right_of(LOOP)
    deep = 0.5 + 0.5 * np.tanh((right_of(SHELF) - 20e3) / 40e3)
    deep *= np.exp(-(np.maximum(np.hypot((x + 88) * 0.9, y - 25) / 14 - 0.7, 0) ** 2) / 0.02)

    @cache
    def spline(seconds: float) -> RectBivariateSpline:
        days = seconds / DAY
        psi = 0.9 * 38e3 * (1 + np.tanh((side + 12e3 * np.sin(2 * np.pi * days / 27)) / 38e3))
        phase = 2 * np.pi * days / 60
        for e_lon, e_lat, radius, swirl, to_west, to_north in EDDIES:
            metres = R * DEG * np.cos(e_lat * DEG)
            dx = (x - e_lon) * metres + to_west * 5e3 * np.sin(phase)
            dy = (y - e_lat) * R * DEG - to_north * 5e3 * np.cos(phase)
            psi = psi - swirl * radius * 1e3 * np.exp(
                0.5 - (dx**2 + dy**2) / (2 * (radius * 1e3) ** 2)
            )
        return RectBivariateSpline(lat, lon, psi * deep)

    def at(t: float | Array, a: Array, b: Array) -> tuple[Array, Array]:
        # Jet and eddies wander by 3 km a day: what they were within half of two hours moves nothing
        # by more than 0.15 km.
        hours = round((since_2000 + float(np.median(t))) / (2 * HOUR))
        of, turn = spline(hours * 2 * HOUR), 2 * np.pi * (since_2000 + t) / 86_164.1
        u = -of.ev(b, a, dx=1) / (R * DEG) + 0.06 * np.cos(turn)
        v = of.ev(b, a, dy=1) / (R * DEG * np.cos(b * DEG)) - 0.06 * np.sin(turn)
        return u, v

    return at


def breeze(since_2000: float, middle: float) -> Field:
    """Return the built-in wind "breeze" (geo/forcing/analytic.py); middle: the case's key, -88.7
    unless told [deg].
    """

    def at(t: float | Array, lon: Array, lat: Array) -> tuple[Array, Array]:
        days = (since_2000 + t) / DAY
        toward = DEG * (300 + 20 * np.sin(2 * np.pi * (days / 5 + (lon - middle) / 25)))
        speed = 7 * (1 + 0.1 * np.sin(2 * np.pi * (days / 4 - lat / 20)))
        turn = 2 * np.pi * (days + lon / 360)
        return speed * np.sin(toward) + 2 * np.sin(turn), speed * np.cos(toward) + 2 * np.cos(turn)

    return at
