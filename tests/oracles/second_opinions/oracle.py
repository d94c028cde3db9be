"""A second opinion on drift: particles in plain float64 NumPy, from the published laws, for the
oracles of the shipped cases.

Nothing of drift, geo or kernels is used. Priors, leeway and errors are drawn by the laws that
docs/leeway.md and docs/errors.md state; the Ornstein-Uhlenbeck error moves a particle by its exact
integral over a step, not by the mean of its ends; oracle_forcing.py reads the files; landings are
segments of the way against edges of GSHHG in shapely's tree. Positions are degrees, times seconds
after the case's start, everything else SI.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
import shapely
from scipy import stats

R = 6_371_008.8  # [m] mean radius of the Earth
NMI, KNOT, HOUR, DAY = 1852.0, 1852.0 / 3600.0, 3600.0, 86400.0
DEG = np.pi / 180
JIBES = 0.04 / HOUR  # [1/s]
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
