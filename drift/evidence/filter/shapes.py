"""Shapes over the ground: searched areas, legs as flown, and possible positions of a contact.

Shapes are arrays (n, 2) of lon, lat [deg] whose longitudes run on without a jump; edges follow
great circles. Shapes that drift with a marker move with it if the marker's track is known. No area
may contain a pole.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import shapely

from drift.evidence.filter import contacts
from drift.evidence.filter.records import Barrier, Contact, Line, Look, Presence, Sortie
from drift.products.files import geojson
from geo import polyline, sphere
from geo.array import Array
from geo.polyline import Area, Legs

Shape = tuple[str, Array]  # name and points

# [m] between points of an edge: at 60 degrees of latitude a chord is 14 m off the great circle
LONGEST = 20_000.0
NEAR_ALL = 0.95  # share of a contact's error that its shape holds
IN_PLANE = math.sqrt(-2 * math.log(1 - NEAR_ALL))  # standard deviations: Rayleigh's quantile
ON_LINE = 1.959964  # normal's two-sided quantile
FARTHEST = 100 * 1852.0  # [m] to which a bearing without a far end is drawn
MARK = 2000.0  # [m] radius of the circle that represents a sensor


def epoch(time: np.datetime64) -> float:
    """Return a time, np.datetime64, in seconds since 1970."""
    return float(np.asarray(time).astype("datetime64[ms]").astype(np.int64)) / 1000


def curve(lon: Sequence[float] | Array, lat: Sequence[float] | Array) -> Array:
    """Return points along great circles between vertices [deg], at most LONGEST apart, (n, 2)."""
    x, y = sphere.track(np.radians(lon), np.radians(lat), LONGEST)
    return np.column_stack([np.degrees(np.unwrap(x)), np.degrees(y)])


def outline(area: Area) -> Array:
    """Return an area's closed outline, (n, 2)."""
    ring = np.array(area.ring)
    return curve(ring[:, 0], ring[:, 1])


def _circle(
    lon: float, lat: float, radius: float, begin: float = 0.0, end: float = 2 * math.pi
) -> Array:
    """Return a circle about a point, or an arc of it.

    Args:
        lon: longitude of the centre [deg].
        lat: latitude of the centre [deg].
        radius: of the circle [m].
        begin: bearing at which the arc begins, clockwise from north [rad].
        end: bearing at which it ends [rad].

    Returns:
        Points (lon, lat) [deg], shape (n, 2).
    """
    angle = np.linspace(begin, end, max(int(abs(end - begin) / 0.05), 2) + 1)
    return _about(lon, lat, radius * np.sin(angle), radius * np.cos(angle))


def _about(lon: float, lat: float, east: Array, north: Array) -> Array:
    x, y = sphere.destination(np.radians(lon), np.radians(lat), east, north)
    return np.column_stack([sphere.near_degrees(np.degrees(x), lon), np.degrees(y)])


def searched(sortie: Sortie, time: np.datetime64 | None = None) -> Array | None:
    """Return the closed outline of a sortie's area at a time, (n, 2); None if it has no area.

    time: by default the start of the sortie.
    """
    if sortie.area is None:
        return None
    if not _drifts(sortie):
        return outline(sortie.area)
    at = epoch(sortie.start if time is None else time)
    lon, lat = _moved(
        sortie,
        np.full(len(sortie.area.lon), at),
        np.array(sortie.area.lon),
        np.array(sortie.area.lat),
    )
    return outline(Area(tuple(lon), tuple(lat)))


def flown(sortie: Sortie, until: np.datetime64 | None = None) -> list[tuple[bool, Array]]:
    """Return a sortie's legs over the ground as lines.

    Args:
        sortie: with or without legs.
        until: time to which the legs are drawn, by default the sortie's end.

    Returns:
        Whether the line searches, and its points (lon, lat) [deg], shape (n, 2). Adjacent legs of
            the same kind are one line.
    """
    if sortie.legs is None:
        return []
    legs = _over_ground(sortie)
    if until is not None:
        if epoch(until) <= legs.time[0]:
            return []
        legs = polyline.legs_between(legs, legs.time[0], epoch(until))
    parts: list[tuple[bool, list[int]]] = []
    for i, searching in enumerate(legs.searching):
        if not parts or parts[-1][0] != searching:
            parts.append((searching, [i]))
        parts[-1][1].append(i + 1)
    return [
        (seeks, curve([legs.lon[i] for i in which], [legs.lat[i] for i in which]))
        for seeks, which in parts
    ]


def _position_on_legs(legs: Legs, time: float) -> tuple[float, float]:
    """Return the position on legs (lon, lat) [deg] at a time [s since 1970].

    Before or after the legs it is the nearer end.
    """
    lon, lat = _positions_on_legs(legs, np.array([time]))[0].tolist()
    return lon, lat


def _positions_on_legs(legs: Legs, times: Array) -> Array:
    """Return the positions on legs at times as `_position_on_legs` does, shape (n, 2)."""
    return polyline.positions_at(legs, np.clip(times, legs.time[0], legs.time[-1]))


def zones(sortie: Sortie, time: np.datetime64) -> list[Array]:
    """Return the edges of a watch's zones round its sensor at a time, each (n, 2)."""
    if sortie.watch is None or sortie.legs is None:
        return []
    lon, lat = _position_on_legs(sortie.legs, epoch(time))
    edges = sorted({*sortie.watch.inner, *sortie.watch.outer} - {0.0})
    return [_circle(lon, lat, radius) for radius in edges if math.isfinite(radius)]


def contact(seen: Contact) -> list[Shape]:
    """Return the possible positions of a contact: points, and shapes for NEAR_ALL of its error.

    Shapes are "point" (1, 2), "region" (closed) or "line". A bearing without a far end is drawn to
    FARTHEST.
    """
    return CONTACTS[seen.kind](seen)


def sensor(what: Look | Presence | Barrier | Line) -> Array:
    """Return the closed outline of the field of a look or presence, or a line, (n, 2).

    A look with a sensor of the case is a circle of radius MARK.
    """
    if isinstance(what, Barrier | Line):
        lon, lat = np.array(what.points).T
        return curve(lon, lat)
    if isinstance(what, Look) and what.field is None:
        assert what.place is not None
        return _circle(*what.place, MARK)
    field = what.field
    assert field is not None
    if field.radius > 0:
        return _circle(field.lon, field.lat, field.radius)
    x, y = (
        np.array([-1, 1, 1, -1, -1]) * field.width / 2,
        np.array([-1, -1, 1, 1, -1]) * field.height / 2,
    )
    # Sides are straight in the tangent plane of the middle, so points between the corners are
    # interpolated in that plane.
    share = np.linspace(0, 4, 4 * 16 + 1)
    x, y = np.interp(share, np.arange(5), x), np.interp(share, np.arange(5), y)
    c, s = math.cos(field.turned), math.sin(field.turned)
    return _about(field.lon, field.lat, x * c + y * s, y * c - x * s)


def _area(contact: Contact) -> list[Shape]:
    assert contact.area is not None
    return [("region", outline(contact.area))]


def _bearing(contact: Contact) -> list[Shape]:
    """Return the wedge and line of a bearing, and of its mirror image if that is possible."""
    assert contact.sensor is not None
    bearings = [contact.bearing]
    if contact.heard is not None and contact.heard.mirrored:
        bearings.append(contacts.mirrored_bearing(contact.bearing, contact.heard.heading))
    shapes: list[Shape] = [("point", np.array([contact.sensor]))]
    for bearing in bearings:
        shapes += _toward(contact, bearing)
    return shapes


def _toward(contact: Contact, bearing: float) -> list[Shape]:
    """Return the region that holds NEAR_ALL of the error of one bearing, and its line."""
    assert contact.sensor is not None
    lon, lat = contact.sensor
    far = contact.far if math.isfinite(contact.far) else max(FARTHEST, 2 * contact.near)
    off = NEAR_ALL * contact.wedge / 2 or ON_LINE * float(contacts.bearing_std(contact, bearing))
    low, high = bearing - off, bearing + off
    outer, inner = (
        _circle(lon, lat, far, low, high),
        _circle(lon, lat, max(contact.near, 1.0), high, low),
    )
    ends = _about(
        lon, lat, *(np.array([contact.near, far]) * f(bearing) for f in (math.sin, math.cos))
    )
    return [
        ("region", np.concatenate([outer, inner, outer[:1]])),
        ("line", curve(ends[:, 0], ends[:, 1])),
    ]


def _range(contact: Contact) -> list[Shape]:
    assert contact.sensor is not None
    lon, lat = contact.sensor
    near, far = (
        contact.range - ON_LINE * contact.range_std,
        contact.range + ON_LINE * contact.range_std,
    )
    circles = (_circle(lon, lat, radius) for radius in (near, contact.range, far) if radius > 0)
    return [("point", np.array([[lon, lat]])), *(("line", points) for points in circles)]


def _fixes(contact: Contact) -> Iterator[Shape]:
    angle = np.linspace(0, 2 * np.pi, 73)
    along, across = (
        IN_PLANE * contact.major * np.cos(angle),
        IN_PLANE * contact.minor * np.sin(angle),
    )
    east = along * math.sin(contact.orientation) + across * math.cos(contact.orientation)
    north = along * math.cos(contact.orientation) - across * math.sin(contact.orientation)
    for fix in contact.fixes:
        yield "point", np.array([[fix.lon, fix.lat]])
        if contact.major > 0:
            yield "region", _about(fix.lon, fix.lat, east, north)


CONTACTS: dict[str, Callable[[Contact], list[Shape]]] = {
    "position": lambda contact: [*_fixes(contact)],
    "area": _area,
    "bearing": _bearing,
    "range": _range,
}


def polygon(rings: Sequence[Array]) -> dict[str, Any]:
    """Return closed outlines as a GeoJSON MultiPolygon, cut at the antimeridian.

    Outer rings run anticlockwise.
    """
    whole = shapely.MultiPolygon([part for ring in rings for part in _valid(ring)])
    return geojson.polygons(whole)


def _valid(ring: Array) -> list[Any]:
    """Return the polygons of an outline; one drawn by a planner may cross itself."""
    valid = shapely.make_valid(shapely.Polygon(ring))
    return [part for part in shapely.get_parts(valid) if part.geom_type == "Polygon"]


def lines(parts: Sequence[Array]) -> dict[str, Any]:
    """Return lines as a GeoJSON MultiLineString, cut at the antimeridian."""
    return geojson.lines(map(shapely.LineString, parts))


def point(lon: float, lat: float) -> dict[str, Any]:
    """Return a position [deg] as a GeoJSON Point."""
    return geojson.point(lon, lat)


def _drifts(sortie: Sortie) -> bool:
    """Whether a sortie's shapes drift with a marker whose track is known."""
    return sortie.frame == "datum" and sortie.marker is not None and sortie.datum is not None


def _over_ground(sortie: Sortie) -> Legs:
    """Return a sortie's legs over the ground.

    Legs flown in the frame of a marker move with it between its fixes.
    """
    assert sortie.legs is not None
    if not _drifts(sortie):
        return sortie.legs
    assert sortie.marker is not None
    legs = sortie.legs
    between = [t for t in sortie.marker.time if legs.time[0] < t < legs.time[-1]]
    times = np.array(sorted({*legs.time, *between}))
    where = _positions_on_legs(legs, times)
    lon, lat = _moved(sortie, times, where[:, 0], where[:, 1])
    which = np.clip(
        np.searchsorted(legs.time, times[:-1], side="right") - 1, 0, len(legs.searching) - 1
    )
    return Legs(tuple(times), tuple(lon), tuple(lat), tuple(legs.searching[k] for k in which))


def _moved(sortie: Sortie, times: Array, lon: Array, lat: Array) -> tuple[Array, Array]:
    """Return positions [deg] shifted with the marker from the datum by each time, (n,)."""
    assert sortie.marker is not None
    assert sortie.datum is not None
    marker = np.radians(_positions_on_legs(sortie.marker, times))
    east, north = sphere.offset(
        math.radians(sortie.datum[0]),
        math.radians(sortie.datum[1]),
        np.radians(lon),
        np.radians(lat),
    )
    x, y = sphere.destination(marker[:, 0], marker[:, 1], east, north)
    return np.degrees(np.unwrap(x)), np.degrees(y)
