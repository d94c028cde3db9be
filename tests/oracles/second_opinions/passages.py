"""Passages of targets that steer in plain float64 NumPy: what docs/targets.md says, and nothing of
drift, geo or kernels.

Great circles and directions come from pyproj's geodesics on the sphere, a Brownian bridge from many
small steps on it, a loiterer's turns at the edge of its polygon, which must be convex, from
halving. Positions are degrees, times seconds after the case's start, everything else SI.
"""

import heapq
import itertools
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import shapely
from oracle import NMI, R, moved

Array = np.ndarray

GEOD = pyproj.Geod(a=R, b=R)


def triangle(
    rng: np.random.Generator, n: int, low: float, best: float, high: float, ratio: float
) -> Array:
    """Draw from a truncated triangle: by rejection under its density, which is straight from the
    ends to the best value.
    """
    drawn = np.empty(0)
    while drawn.size < n:
        x, y = rng.uniform(low, high, 2 * n), rng.uniform(0, ratio, 2 * n)
        density = np.interp(x, [low, best, high], [1.0, ratio, 1.0])
        drawn = np.append(drawn, x[y < density])
    return drawn[:n]


def inside(rng: np.random.Generator, corners: Any, n: int) -> tuple[Array, Array]:
    """Draw places uniform in true area inside a polygon (lon, lat) with straight sides in longitude
    and latitude.
    """
    shape = shapely.Polygon(corners)
    west, south, east, north = shape.bounds
    lon, lat = np.empty(0), np.empty(0)
    while lon.size < n:
        x = rng.uniform(west, east, n)
        y = np.degrees(np.arcsin(rng.uniform(*np.sin(np.radians([south, north])), n)))
        keep = shapely.contains_xy(shape, x, y)
        lon, lat = np.append(lon, x[keep]), np.append(lat, y[keep])
    return lon[:n], lat[:n]


def about(
    rng: np.random.Generator,
    at: tuple[float, float],
    n: int,
    along: float,
    across: float,
    turn: float = 0.0,
) -> tuple[Array, Array]:
    """Draw places normal about one; standard deviations [m] along and across a direction [deg from
    north].
    """
    a, b = along * rng.standard_normal(n), across * rng.standard_normal(n)
    return off(at, a, b, turn)


def off(at: tuple[float, float], along: Array, across: Array, turn: float) -> tuple[Array, Array]:
    """Return places so far [m] off one along a direction [deg from north], and to the right of it."""
    s, c = np.sin(np.radians(turn)), np.cos(np.radians(turn))
    lon, lat = (np.full(along.shape, x) for x in at)
    return moved(lon, lat, along * s + across * c, along * c - across * s)


def rhumb(lon: Array, lat: Array, course: Array, distance: Array) -> tuple[Array, Array]:
    """Return places on constant courses [deg]: longitude grows with the isometric latitude (Snyder
    1987, p. 46).
    """
    end = lat + np.degrees(distance / R * np.cos(np.radians(course)))
    psi, psi_end = (np.arctanh(np.sin(np.radians(y))) for y in (lat, end))
    rise = np.radians(end - lat)
    slope = np.where(
        np.abs(rise) > 1e-9,
        (psi_end - psi) / np.where(rise == 0, 1, rise),
        1 / np.cos(np.radians(lat)),
    )
    return lon + np.degrees(distance / R * np.sin(np.radians(course)) * slope), end


def between(
    lon: Array, lat: Array, lon_end: Array, lat_end: Array, share: Array
) -> tuple[Array, Array]:
    """Return places on great circles from one place to another, at a share of the way."""
    course, _, length = GEOD.inv(lon, lat, lon_end, lat_end)
    x, y, _ = GEOD.fwd(lon, lat, course, length * share)
    return np.asarray(x), np.asarray(y)


def passed(lon: Array, lat: Array, time: Array, when: float | Array) -> tuple[Array, Array]:
    """Return where targets are at a time on their way points (lon, lat, time), (n, k); at the first
    before, the last after.
    """
    when = np.broadcast_to(np.asarray(when, float), time.shape[:1])
    leg = np.clip((time <= when[:, None]).sum(axis=1) - 1, 0, time.shape[1] - 2)
    row = np.arange(leg.size)
    begin, end = time[row, leg], time[row, leg + 1]
    share = np.clip((when - begin) / np.maximum(end - begin, 1e-9), 0, 1)
    return between(lon[row, leg], lat[row, leg], lon[row, leg + 1], lat[row, leg + 1], share)


def corridor(
    points: Sequence[tuple[float, float]], width: Sequence[float]
) -> tuple[Array, Array, Array]:
    """Return of a route's way points: half the line across it [m], its direction to starboard
    [deg], metres made good.

    width: of its legs [m]. At a corner the line is the bisector, as long as mitred lines have it up
    to a right angle.
    """
    lon, lat = np.array(points, float).T
    ahead, back, length = (np.asarray(x) for x in GEOD.inv(lon[:-1], lat[:-1], lon[1:], lat[1:]))
    arrive, leave = np.append(ahead[0], back + 180), np.append(ahead, back[-1] + 180)
    turn = (leave - arrive + 180) % 360 - 180
    half = (np.append(width[0], width) + np.append(width, width[-1])) / 4
    half = half / np.maximum(np.cos(np.radians(turn / 2)), np.cos(np.radians(45)))
    return half, arrive + turn / 2 + 90, np.append(0, np.cumsum(length))


def aside(
    points: Sequence[tuple[float, float]], width: Sequence[float], side: Array
) -> tuple[Array, Array, Array]:
    """Return the way points (lon, lat) (n, k) of targets that keep to a side, in half widths, and
    metres made good (k,).
    """
    half, toward, along = corridor(points, width)
    lon, lat = np.array(points, float).T
    east, north = (side[:, None] * half * f(np.radians(toward)) for f in (np.sin, np.cos))
    shape = np.ones(side.size)[:, None]
    return *moved(lon * shape, lat * shape, east, north), along


def bridge(
    rng: np.random.Generator, begin: tuple[Array, Array, Array], end: tuple[Array, Array, Array], k: float, when: float,
    steps: int = 120,
) -> tuple[Array, Array]:  # fmt: skip
    """Return where Brownian bridges between places with times (lon, lat, time) are at a time: by
    steps on the sphere.

    Each step goes on along the great circle by its share of the time left, and is then blown aside,
    as much any way, by what a bridge of the rest still allows: the textbook's bridge in the plane,
    in steps so small that the Earth is flat: with 120 its variance across a way of 12 degrees errs
    by less than 0.1 %. k [m/sqrt(s)].
    """
    lon, lat = begin[0].copy(), begin[1].copy()
    start, stop = begin[2], end[2]
    until = np.clip(when, start, stop)
    for j in range(steps):
        a, b = start + (until - start) * j / steps, start + (until - start) * (j + 1) / steps
        share = np.where(stop > a, (b - a) / np.maximum(stop - a, 1e-9), 0.0)
        lon, lat = between(lon, lat, end[0], end[1], share)
        spread = k * np.sqrt(np.maximum((b - a) * (1 - share), 0.0))
        lon, lat = moved(
            lon, lat, spread * rng.standard_normal(lon.size), spread * rng.standard_normal(lon.size)
        )
    return lon, lat


def loiter(
    rng: np.random.Generator,
    corners: Any,
    lon: Array,
    lat: Array,
    lasting: Sequence[Array],
    speed: Array,
    leg: float,
) -> list[tuple[Array, Array]]:
    """Return where targets are that go to and fro in a convex polygon, after each of some times;
    below 0: they have not begun.

    What is outside goes to any place in it first. Legs [m] are exponential, in any direction; at
    the edge the way is reflected and a new leg begins.
    """
    shape = shapely.Polygon(corners)
    shapely.prepare(shape)
    x, y = inside(rng, corners, lon.size)
    away = np.where(shapely.contains_xy(shape, lon, lat), 0.0, GEOD.inv(lon, lat, x, y)[2])
    outer, done = (lon, lat, x, y), np.zeros(lon.size)
    lon, lat, course = lon.copy(), lat.copy(), rng.uniform(0, 2 * np.pi, lon.size)
    told = []
    for time in lasting:
        due = np.maximum(time, 0) * speed
        going_in = done < away
        share = np.clip(due / np.maximum(away, 1), 0, 1)
        arriving = between(*outer, share)
        lon, lat = (
            np.where(going_in, new, old) for new, old in zip(arriving, (lon, lat), strict=True)
        )
        done = np.where(going_in, np.minimum(due, away), done)
        while (going := np.flatnonzero(due - done > 1e-6)).size:
            state = _leg(
                rng, shape, lon[going], lat[going], course[going], (due - done)[going], leg
            )
            lon[going], lat[going], course[going] = state[:3]
            done[going] += state[3]
        told.append((lon.copy(), lat.copy()))
    return told


def _leg(
    rng: np.random.Generator,
    shape: shapely.Polygon,
    lon: Array,
    lat: Array,
    course: Array,
    most: Array,
    leg: float,
) -> tuple[Array, Array, Array, Array]:
    """Return where a leg ends, the course after it, and its length: at most so long, which ends no
    leg, for it has no memory.
    """
    far = rng.exponential(leg, lon.size)
    cut = far >= most
    far = np.where(cut, most, far)
    then = np.where(cut, course, rng.uniform(0, 2 * np.pi, lon.size))
    x, y = moved(lon, lat, far * np.sin(course), far * np.cos(course))
    gone = ~shapely.contains_xy(shape, x, y)
    if gone.any():
        p, q, to, ring = lon[gone], lat[gone], course[gone], np.array(shape.exterior.coords)
        near, beyond = np.zeros(p.size), far[gone]
        for _ in range(24):  # to a metre
            middle = (near + beyond) / 2
            within = shapely.contains_xy(
                shape, *moved(p, q, middle * np.sin(to), middle * np.cos(to))
            )
            near, beyond = np.where(within, middle, near), np.where(within, beyond, middle)
        x[gone], y[gone] = moved(p, q, near * np.sin(to), near * np.cos(to))
        u, v = x[gone], y[gone]
        nearest = np.stack([_beside(u, v, *ends) for ends in itertools.pairwise(ring)]).argmin(
            axis=0
        )
        east, north = (ring[nearest + 1] - ring[nearest]).T
        mirrored = 2 * np.arctan2(east * np.cos(np.radians(v)), north) - to
        # Who came to lie on the wrong side of the edge, by rounding, would leave it by single
        # metres.
        then[gone] = np.where(near < 1.0, rng.uniform(0, 2 * np.pi, near.size), mirrored)
        far[gone] = np.maximum(near, 1.0)
    return x, y, then, far


def _beside(lon: Array, lat: Array, a: Array, b: Array) -> Array:
    """Return how far [deg of latitude] places lie beside an edge."""
    scale = np.cos(np.radians(lat))
    east, north = (b[0] - a[0]) * scale, b[1] - a[1]
    return np.abs(east * (lat - a[1]) - north * (lon - a[0]) * scale) / np.hypot(east, north)


def network(path: Path) -> tuple[dict[str, tuple[float, float]], dict[tuple[str, str], float]]:
    """Return the nodes of a network's file, and the width [m] of the lane from one to another, as
    they may be followed.
    """
    told: Mapping[str, Any] = tomllib.loads(path.read_text())
    nodes = {node["name"]: (float(node["at"][0]), float(node["at"][1])) for node in told["node"]}
    lanes: dict[tuple[str, str], float] = {}
    for lane in told["lane"]:
        for a, b in itertools.pairwise(lane.get("through") or [lane["from"], lane["to"]]):
            width = float(lane["width"].split()[0]) * NMI
            lanes[a, b] = width
            if not lane.get("one_way", False):
                lanes[b, a] = width
    return nodes, lanes


def shortest(
    nodes: Mapping[str, tuple[float, float]],
    lanes: Mapping[tuple[str, str], float],
    stops: Sequence[str],
) -> list[str]:
    """Return the nodes on the shortest way from stop to stop along lanes."""
    found = [stops[0]]
    for first, last in itertools.pairwise(stops):
        heap: list[tuple[float, list[str]]] = [(0.0, [first])]
        done: set[str] = set()
        while heap:
            far, way = heapq.heappop(heap)
            if way[-1] == last:
                found += way[1:]
                break
            if way[-1] in done:
                continue
            done.add(way[-1])
            for a, b in lanes:
                if a == way[-1] and b not in done:
                    heapq.heappush(heap, (far + GEOD.inv(*nodes[a], *nodes[b])[2], [*way, b]))
    return found
