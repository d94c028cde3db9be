"""Areas, and tracks of legs: built from points, cut, simplified and outlined.

Legs are great circles from vertex to vertex, each at constant speed. Positions are degrees, with
unwrapped longitudes. Times are seconds since 1970.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geo import sphere
from geo.array import Array

LonLat = tuple[float, float]  # (lon, lat) [deg]

SAME = 0.01  # [m] points closer than this count as one point


@dataclass(frozen=True)
class Area:
    """A region on the sphere with great-circle edges."""

    lon: tuple[float, ...]  # [deg] corners in order, not closed
    lat: tuple[float, ...]

    @property
    def ring(self) -> list[tuple[float, float]]:
        """Corners (lon, lat) [deg], with the first one repeated at the end."""
        return [*zip(self.lon, self.lat, strict=True), (self.lon[0], self.lat[0])]


@dataclass(frozen=True)
class Legs:
    """A track of great-circle legs from vertex to vertex, each at constant speed."""

    time: tuple[float, ...]  # [s since 1970], ascending, (k,)
    lon: tuple[float, ...]  # [deg] (k,)
    lat: tuple[float, ...]
    # whether the unit searches on the leg from vertex i to i + 1, (k - 1,)
    searching: tuple[bool, ...]


def legs_through(
    time: npt.ArrayLike,
    lon: npt.ArrayLike,
    lat: npt.ArrayLike,
    searching: Sequence[bool] | None = None,
) -> Legs:
    """Return legs from arrays of their vertices.

    Args:
        time: of the vertices [s since 1970], shape (k,).
        lon: of the vertices [deg], shape (k,).
        lat: of the vertices [deg], shape (k,).
        searching: whether the unit searches on each leg, shape (k - 1,); default: on all.
    """
    t, x, y = (
        tuple(np.asarray(values, np.float64).tolist()) for values in (time, unwrap(lon), lat)
    )
    return Legs(
        t,
        x,
        y,
        (True,) * (len(t) - 1) if searching is None else tuple(bool(value) for value in searching),
    )


def unwrap(lon: npt.ArrayLike, first: float | None = None) -> Array:
    """Return longitudes [deg] without jumps.

    Each is shifted by whole turns to be nearest to the previous one; first: what precedes the first
    one.
    """
    lon = np.asarray(lon, np.float64)
    extended = np.concatenate([[lon[0] if first is None else first], lon])
    # exact if nothing jumps
    return np.asarray(lon - 360.0 * np.cumsum(np.rint(np.diff(extended) / 360.0)))


def legs_at_speed(
    lon: npt.ArrayLike,
    lat: npt.ArrayLike,
    start: float,
    speed: float,
    searching: Sequence[bool] | None = None,
) -> Legs:
    """Return legs through points that start at a time and have constant speed.

    Args:
        lon: of the points [deg], shape (k,); repeated points are left out.
        lat: of the points [deg], shape (k,).
        start: time at the first point [s since 1970].
        speed: [m/s].
        searching: whether the unit searches on each leg, shape (k - 1,); default: on all.

    Raises:
        ValueError: all points are the same.
    """
    lon, lat = unwrap(lon), np.asarray(lat, np.float64)
    steps = _leg_lengths(lon, lat)
    keep = np.flatnonzero(np.concatenate([[True], steps > SAME]))
    if keep.size < 2:
        raise ValueError("has no length: all its points are the same")
    time = start + np.concatenate([[0.0], np.cumsum(steps)]) / speed
    searched = None if searching is None else [searching[k - 1] for k in keep[1:]]
    return legs_through(time[keep], lon[keep], lat[keep], searched)


def lengths(legs: Legs) -> Array:
    """Return the length [m] of each leg, shape (k - 1,)."""
    return _leg_lengths(np.array(legs.lon), np.array(legs.lat))


def great_circle_length(points: Sequence[LonLat]) -> float:
    """Return the length [m] of a line of great circles through points [deg]."""
    return float(_leg_lengths(*np.array(points).T).sum())


def _leg_lengths(lon: Array, lat: Array) -> Array:
    x, y = np.radians(lon), np.radians(lat)
    return sphere.distance(x[:-1], y[:-1], x[1:], y[1:])


def cut_legs(legs: Legs, share: float) -> Legs:
    """Return the legs up to a share of their total length; all of them if the share is 1."""
    done = np.concatenate([[0.0], np.cumsum(lengths(legs))])
    goal = share * done[-1]
    if share >= 1:
        return legs
    k = min(max(int(np.searchsorted(done, goal, "left")) - 1, 0), len(legs.lon) - 2)
    within = (goal - done[k]) / max(done[k + 1] - done[k], 1e-9)
    return legs_between(
        legs, legs.time[0], legs.time[k] + within * (legs.time[k + 1] - legs.time[k])
    )


def legs_between(legs: Legs, first: float, last: float) -> Legs:
    """Return the part of legs between two times [s since 1970]; raise ValueError if empty."""
    time = np.array(legs.time)
    first, last = max(first, legs.time[0]), min(last, legs.time[-1])
    if last <= first:
        raise ValueError("no part of the legs lies between these times")
    if (first, last) == (legs.time[0], legs.time[-1]):
        return legs
    inside = np.flatnonzero((time > first) & (time < last))
    begin = int(np.searchsorted(time, first, "right")) - 1
    finish = int(np.searchsorted(time, last, "left")) - 1
    vertices = [
        position_at(legs, first),
        *((legs.lon[k], legs.lat[k]) for k in inside),
        position_at(legs, last),
    ]
    lon, lat = np.array(vertices).T
    return legs_through([first, *time[inside], last], lon, lat, legs.searching[begin : finish + 1])


def position_at(legs: Legs, time: float) -> LonLat:
    """Return the position (lon, lat) [deg] on legs at a time [s since 1970]."""
    lon, lat = positions_at(legs, [time])[0].tolist()
    return lon, lat


def positions_at(legs: Legs, times: npt.ArrayLike) -> Array:
    """Return the positions (lon, lat) [deg] on legs at times [s since 1970], shape (n, 2)."""
    times, t = np.asarray(times, np.float64), np.array(legs.time)
    k = np.clip(np.searchsorted(t, times, "right") - 1, 0, t.size - 2)
    share = (times - t[k]) / (t[k + 1] - t[k])
    x, y = np.array(legs.lon), np.array(legs.lat)
    begin = np.radians(x[k]), np.radians(y[k])
    east, north = sphere.offset(*begin, np.radians(x[k + 1]), np.radians(y[k + 1]))
    lon, lat = sphere.destination(*begin, east * share, north * share)
    lon = np.degrees(lon)
    lon -= 360.0 * np.rint((lon - x[k]) / 360.0)  # nearest to the vertex before it
    return np.column_stack([lon, np.degrees(lat)])


def thin_legs(legs: Legs, tolerance: float) -> Legs:
    """Return legs with fewer vertices, on which the unit is never off by more than a tolerance [m].

    Douglas and Peucker (1973, doi:10.3138/FM57-6770-U75U-7727), with the distance between positions
    at the same time. Legs with search are not joined with legs without.
    """
    fixed = [
        0,
        *(k for k in range(1, len(legs.time) - 1) if legs.searching[k] != legs.searching[k - 1]),
        len(legs.time) - 1,
    ]
    (x, y, _), t = _to_plane(legs), np.array(legs.time)
    keep = np.zeros(t.size, bool)
    keep[fixed] = True
    unchecked = [(a, b) for a, b in itertools.pairwise(fixed) if b > a + 1]
    while unchecked:
        a, b = unchecked.pop()
        share = (t[a + 1 : b] - t[a]) / (t[b] - t[a])
        away = np.hypot(
            x[a + 1 : b] - x[a] - share * (x[b] - x[a]), y[a + 1 : b] - y[a] - share * (y[b] - y[a])
        )
        worst = int(np.argmax(away))
        if away[worst] > tolerance:
            k = a + 1 + worst
            keep[k] = True
            unchecked += [part for part in ((a, k), (k, b)) if part[1] > part[0] + 1]
    vertices = np.flatnonzero(keep)
    lon, lat = np.array(legs.lon)[vertices], np.array(legs.lat)[vertices]
    return legs_through(t[vertices], lon, lat, [legs.searching[k] for k in vertices[:-1]])


def search_strip(legs: Legs, reach: float) -> Area:
    """Return the outline of the area within a reach [m] of the search legs, without holes."""
    import shapely

    x, y, back = _to_plane(legs)
    parts = [[(x[k], y[k]), (x[k + 1], y[k + 1])] for k in range(len(x) - 1) if legs.searching[k]]
    merged = shapely.union_all(shapely.buffer(shapely.linestrings(parts), reach, quad_segs=4))
    if merged.geom_type != "Polygon":  # the search legs are far apart
        merged = merged.convex_hull
    outline = np.array(merged.simplify(reach / 50).exterior.coords)[:-1]
    lon, lat = back(outline[:, 0], outline[:, 1])
    return Area(tuple(unwrap(lon, legs.lon[0]).tolist()), tuple(lat.tolist()))


def _to_plane(legs: Legs) -> tuple[Array, Array, Callable[[Array, Array], tuple[Array, Array]]]:
    """Return (x, y) [m] of the vertices in an azimuthal equidistant projection, and its inverse.

    The projection is centred on the middle of the vertices. The inverse takes arrays of x and y [m]
    and returns (lon, lat) [deg].
    """
    lon, lat = np.array(legs.lon), np.array(legs.lat)
    middle = np.radians([(lon.min() + lon.max()) / 2, (lat.min() + lat.max()) / 2])
    x, y = sphere.offset(middle[0], middle[1], np.radians(lon), np.radians(lat))

    def back(east: Array, north: Array) -> tuple[Array, Array]:
        away = sphere.destination(middle[0], middle[1], east, north)
        return np.degrees(away[0]), np.degrees(away[1])

    return x, y, back
