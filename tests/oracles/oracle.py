"""A second opinion on drift: particles in plain float64 NumPy, from the published laws, for the
oracles of the shipped cases.

Nothing of drift, geo or kernels is used. Priors, leeway and errors are drawn by the laws that
docs/leeway.md and docs/errors.md state; the Ornstein-Uhlenbeck error moves a particle by its exact
integral over a step, not by the mean of its ends; files are read by xarray and interpolated on
their own grids; landings are segments of the way against edges of GSHHG in shapely's tree.
Positions are degrees, times seconds after the case's start, everything else SI.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
import pyproj
import shapely
import xarray as xr
from scipy import ndimage, stats
from scipy.interpolate import RectBivariateSpline

R = 6_371_008.8  # [m] mean radius of the Earth
NMI, KNOT, HOUR, DAY = 1852.0, 1852.0 / 3600.0, 3600.0, 86400.0
DEG = np.pi / 180
JIBES = 0.04 / HOUR  # [1/s]
# [m] how far from wet water a narrow bay still has the current of the nearest wet point
FILL = 30_000.0

Array = np.ndarray
# (t, lon, lat) -> east, north; NaN where unknown
Field = Callable[[float | Array, Array, Array], tuple[Array, Array]]


def moved(lon: Array, lat: Array, east: Array, north: Array) -> tuple[Array, Array]:
    """Return the place so many metres away along a great circle (spherical law of sines and
    cosines).
    """
    way, bearing = np.hypot(east, north) / R, np.arctan2(east, north)
    y = np.arcsin(
        np.sin(lat * DEG) * np.cos(way) + np.cos(lat * DEG) * np.sin(way) * np.cos(bearing)
    )
    x = np.arctan2(
        np.sin(bearing) * np.sin(way) * np.cos(lat * DEG),
        np.cos(way) - np.sin(lat * DEG) * np.sin(y),
    )
    return lon + x / DEG, y / DEG


# Land


@dataclass(frozen=True)
class Coast:
    """Polygons of land, and the segments of their outlines in a tree."""

    land: Array
    edges: Array  # (m, 2, 2)
    tree: shapely.STRtree = field(repr=False)

    def on_land(self, lon: Array, lat: Array) -> Array:
        """Return whether points lie on land."""
        found = np.zeros(lon.shape, bool)
        for one in self.land:
            west, south, east, north = one.bounds
            near = np.flatnonzero((lon > west) & (lon < east) & (lat > south) & (lat < north))
            found[near] |= shapely.contains_xy(one, lon[near], lat[near])
        return found

    def first_met(self, lon: Array, lat: Array, lon_end: Array, lat_end: Array) -> Array:
        """Return the share of each way done at its first crossing of the shore; infinite where it
        meets none.
        """
        a, b = np.column_stack([lon, lat]), np.column_stack([lon_end, lat_end])
        way, edge = self.tree.query(shapely.linestrings(np.stack([a, b], 1)), "intersects")
        share = np.full(lon.size, np.inf)
        d, (p, q) = (b - a)[way], self.edges[edge].transpose(1, 0, 2)
        e, w = q - p, p - a[way]
        cross = d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (w[:, 0] * e[:, 1] - w[:, 1] * e[:, 0]) / cross
        np.minimum.at(share, way, np.where(np.isfinite(t), np.clip(t, 0, 1), 0.0))
        return share


@lru_cache(maxsize=1)
def earth() -> Array:
    """Return the polygons of GSHHG, the whole Earth, as their package holds them."""
    from roaring_landmask import LandmaskProvider, Shapes

    return shapely.get_parts(shapely.from_wkb(Shapes.wkb(LandmaskProvider.Gshhg)))


def gshhg(west: float, south: float, east: float, north: float) -> Coast:
    """Return GSHHG in a box."""
    everything = earth()
    bounds = shapely.bounds(everything)
    near = (
        (bounds[:, 0] < east)
        & (bounds[:, 2] > west)
        & (bounds[:, 1] < north)
        & (bounds[:, 3] > south)
    )
    return coast(everything[near], west, south, east, north)


def bna(path: Path, *box: float) -> Coast:
    """Return the land of NOAA's .bna (records of type 1, less lakes of type 2, without its frames)
    in a box.
    """
    lines, land, lakes = iter(path.read_text(encoding="latin-1").splitlines()), [], []
    for line in lines:
        if not line.strip():
            continue
        name, kind, count = (part.strip().strip('"') for part in line.split(","))
        points = [tuple(map(float, next(lines).split(",")[:2])) for _ in range(abs(int(count)))]
        if name.replace(" ", "").lower() not in ("mapbounds", "spillablearea") and int(count) > 2:
            (land if kind == "1" else lakes).append(shapely.Polygon(points).buffer(0))
    whole = shapely.difference(shapely.union_all(land), shapely.union_all(lakes))
    return coast(shapely.get_parts(whole), *box)


def coast(polygons: Array, west: float, south: float, east: float, north: float) -> Coast:
    """Return a coast of polygons, of which the box is wanted."""
    cut = shapely.get_parts(
        shapely.get_parts(shapely.clip_by_rect(polygons, west, south, east, north))
    )
    cut = cut[(shapely.get_type_id(cut) == 3) & ~shapely.is_empty(cut)]
    shapely.prepare(cut)
    points, ring = shapely.get_coordinates(shapely.get_rings(cut), return_index=True)
    same = ring[1:] == ring[:-1]
    edges = np.stack([points[:-1][same], points[1:][same]], axis=1)
    return Coast(cut, edges, shapely.STRtree(shapely.linestrings(edges)))


# Flows


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


# Particles


@dataclass
class Cloud:
    """Particles: place [deg], release [s], leeway lines (slope, offset [m/s]), side (+1 right),
    bias [m/s], sinking [s].
    """

    lon: Array
    lat: Array
    release: Array
    down: Array  # (2, n)
    right: Array
    left: Array
    side: Array
    bias: Array  # (2, n)
    sinks: Array


@dataclass(frozen=True)
class Errors:
    """Errors of the forcing: standard deviation [m/s] and decorrelation time [s] of current and
    wind, diffusivity [m2/s].
    """

    current: tuple[float, float]
    wind: tuple[float, float]
    diffusivity: float = 0.0


ADRIFT, ASHORE, OUTSIDE, SUNK = "adrift", "ashore", "outside", "sunk"


def lines(rng: np.random.Generator, n: int, row: dict[str, float]) -> tuple[Array, Array, Array]:
    """Return leeway lines of n objects of a class, of a row of the table in % and cm/s
    (docs/leeway.md).
    """
    made = []
    for side in ("down", "right", "left"):
        slope, offset, error = (row[f"{side}_{name}"] / 100 for name in ("slope", "offset", "std"))
        xi = rng.standard_normal(n)
        while side == "down" and (low := slope + error / 20 * xi < 0).any():
            xi[low] = rng.standard_normal(low.sum())
        made.append(np.stack([slope + error / 20 * xi, offset + error / 2 * xi]))
    return made[0], made[1], made[2]


def run(
    rng: np.random.Generator,
    cloud: Cloud,
    duration: float,
    current: Field,
    wind: Field | None,
    errors: Errors,
    coast: Coast | None,
    step: float,
    tracks: list[Array] | None = None,
) -> tuple[Array, Array, Array]:
    """Return longitudes, latitudes and what became of the particles at the end; Runge and Kutta's
    order 4.

    tracks: takes their places [deg] (2, n) at the begin of each step and at the end of the last.
    """
    n = cloud.lon.size
    lon, lat, side = cloud.lon.copy(), cloud.lat.copy(), cloud.side.copy()
    became = np.full(n, ADRIFT, object)
    (cs, ct), (ws, wt) = errors.current, errors.wind
    e_current, e_wind = cs * rng.standard_normal((2, n)), ws * rng.standard_normal((2, n))
    jibes = wind is not None and not np.array_equal(cloud.right, cloud.left)
    for begin in np.arange(0, duration, step):
        finish = min(begin + step, duration)
        if tracks is not None:
            tracks.append(np.stack([lon, lat]))
        go = np.flatnonzero((became == ADRIFT) & (cloud.release < finish))
        if not go.size:
            continue
        t0 = np.maximum(begin, cloud.release[go])
        t1 = np.maximum(np.minimum(finish, cloud.sinks[go]), t0)
        h = np.maximum(t1 - t0, 1e-3)
        e_current[:, go], push = _integral(rng, e_current[:, go], cs, ct, h)
        e_wind[:, go], gust = _integral(rng, e_wind[:, go], ws, wt, h)
        if jibes:
            turns = rng.poisson(JIBES * h) % 2 == 1
            side[go] = np.where(turns, -side[go], side[go])
        down, across = (
            cloud.down[:, go],
            np.where(side[go] > 0, cloud.right[:, go], cloud.left[:, go]),
        )

        x, y = lon[go], lat[go]
        sum_x, sum_y, kx, ky, known = 0.0 * x, 0.0 * x, 0.0 * x, 0.0 * x, np.ones(go.size, bool)
        for share, weight in ((0.0, 1 / 6), (0.5, 1 / 3), (0.5, 1 / 3), (1.0, 1 / 6)):
            at = y + share * ky
            u, v = current(t0 + share * h, x + share * kx, at)
            u, v = u + push[0] + cloud.bias[0, go], v + push[1] + cloud.bias[1, go]
            if wind is not None:
                a, b = wind(t0 + share * h, x + share * kx, at)
                a, b = a + gust[0], b + gust[1]
                speed = np.hypot(a, b) + 1e-12
                along, off = down[0] * speed + down[1], across[0] * speed + across[1]
                u, v = u + (a * along + b * off) / speed, v + (b * along - a * off) / speed
            fine = np.isfinite(u)
            kx = np.where(fine, u * h / (R * DEG * np.cos(at * DEG)), kx)
            ky = np.where(fine, v * h / (R * DEG), ky)
            known &= fine
            sum_x, sum_y = sum_x + weight * kx, sum_y + weight * ky
        sum_x, sum_y = np.where(known, sum_x, kx), np.where(known, sum_y, ky)
        x_end, y_end = x + sum_x, y + sum_y
        if errors.diffusivity:
            walk = np.sqrt(2 * errors.diffusivity * h) * rng.standard_normal((2, go.size))
            x_end, y_end = moved(x_end, y_end, walk[0], walk[1])
        met = coast.first_met(x, y, x_end, y_end) if coast else np.full(go.size, np.inf)
        part = np.where(np.isfinite(met), met, np.where(known, 1.0, 0.0))
        lon[go], lat[go] = x + part * (x_end - x), y + part * (y_end - y)
        fate = np.where(cloud.sinks[go] < finish, SUNK, ADRIFT)
        became[go] = np.where(np.isfinite(met), ASHORE, np.where(known, fate, OUTSIDE))
    if tracks is not None:
        tracks.append(np.stack([lon, lat]))
    return lon, lat, became


def _integral(
    rng: np.random.Generator, old: Array, std: float, time: float, h: Array
) -> tuple[Array, Array]:
    """Return an Ornstein-Uhlenbeck process after h [s] and its mean over h, drawn together
    (Gillespie 1996, eqs. 2.12-2.13).

    doi:10.1103/PhysRevE.54.2084. old: (2, n).
    """
    if not std:
        return old, 0 * old
    a = np.exp(-h / time)
    variance, both = std**2 * (1 - a * a), std**2 * time * (1 - a) ** 2
    whole = std**2 * time**2 * (2 * h / time - 3 + 4 * a - a * a)
    first, second = rng.standard_normal((2, *old.shape))
    new = a * old + np.sqrt(variance) * first
    rest = np.sqrt(np.maximum(whole - both**2 / np.maximum(variance, 1e-300), 0))
    integral = (
        time * (1 - a) * old + both / np.sqrt(np.maximum(variance, 1e-300)) * first + rest * second
    )
    return new, integral / h


# Searches


def exposure(places: Array, step: float, time: Array, unit: Array, searching: Array) -> Array:
    """Return what inverse cube sweeps do to particles: the integral of ds / r^3 along each one's
    relative track [1/m2], (n,).

    places: (steps + 1, 2, n) [deg], straight within a step [s]; time [s] and unit (k, 2) [deg]: the
    unit's turning points, straight in between; searching: (k - 1,) of its legs.
    """
    total = np.zeros(places.shape[2])
    cuts = np.unique(np.concatenate([time, np.arange(len(places)) * step]))
    cuts = cuts[(cuts >= time[0]) & (cuts <= time[-1])]
    for a, b in itertools.pairwise(cuts):
        leg = int(np.searchsorted(time, 0.5 * (a + b), side="right")) - 1
        if not searching[leg]:
            continue
        ends = []
        for t in (a, b):
            k = min(int(0.5 * (a + b) // step), len(places) - 2)
            lon, lat = places[k] + (t / step - k) * (places[k + 1] - places[k])
            x, y = (np.interp(t, time, one) for one in unit.T)
            ends.append(np.stack([(lon - x) * np.cos((lat + y) / 2 * DEG), lat - y]) * DEG * R)
        move = ends[1] - ends[0]
        length = np.hypot(*move) + 1e-9
        along = (ends[0] * move).sum(axis=0) / length
        aside = np.maximum((ends[0] ** 2).sum(axis=0) - along**2, 1e-2)
        total += (
            (along + length) / np.hypot(along + length, np.sqrt(aside))
            - along / np.hypot(along, np.sqrt(aside))
        ) / aside
    return total


def missed(exposed: Array, width: float, spread: float) -> Array:
    """Return the chance that inverse cube sweeps missed, of a sweep width [m] known to a share
    `spread` (gamma).
    """
    if not spread:
        return np.exp(-(width**2) / (8 * np.pi) * exposed)
    factor = stats.gamma.ppf((np.arange(400) + 0.5) / 400, spread**-2, scale=spread**2)
    return sum(np.exp(-((f * width) ** 2) / (8 * np.pi) * exposed) for f in factor) / factor.size
