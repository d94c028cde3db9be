"""Candidate ways of a ship that tows an array: one or two legs from a start area."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from drift.evidence.filter.detection import sensor_path
from drift.evidence.sensors.records import Tow
from geo import notation, sphere
from geo.array import Array
from geo.box import Box
from geo.polyline import Area, Legs

LEAST_TIME = 1800.0  # [s] shortest time of listening of a way


@dataclass(frozen=True)
class Ways:
    """Candidate ways (c)."""

    lon: Array  # [rad] of the start
    lat: Array
    course: Array  # [rad] true, at the start of the first leg
    second: Array  # [rad] true, at the start of the second leg
    turn: Array  # share of the way after which it turns; 1: one leg

    def __len__(self) -> int:
        """Return the number of ways."""
        return len(self.lon)

    def take(self, which: Array) -> "Ways":
        """Return the ways with these indices."""
        return Ways(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


def join_ways(some: list[Ways]) -> Ways:
    """Return the ways of several sets in one."""
    return Ways(
        *(
            np.concatenate([getattr(ways, name) for ways in some])
            for name in Ways.__dataclass_fields__
        )
    )


@dataclass(frozen=True, eq=False)
class Sea:
    """Where and when a ship may tow."""

    tow: Tow
    begin: float  # [s since 1970] of the plan
    until: float
    begins: "Region"
    allowed: "Region | None"
    land: shapely.Geometry | None = None  # [m] in the plane of `begins`

    @property
    def middle(self) -> tuple[float, float]:
        """Centre [rad] of the start area."""
        return self.begins.lon, self.begins.lat


@dataclass(frozen=True, eq=False)
class Region:
    """An area on a plane about a centre; distances and bearings from there are true."""

    lon: float  # [rad]
    lat: float
    shape: shapely.Geometry  # [m] east and north

    def holds(self, lon: Array, lat: Array) -> NDArray[np.bool_]:
        """Return which positions [rad] lie in the area, any shape."""
        return np.asarray(
            shapely.contains_xy(self.shape, *sphere.offset(self.lon, self.lat, lon, lat))
        )


def region(area: Area, about: tuple[float, float] | None = None) -> Region:
    """Return an area on a plane.

    Args:
        area: its corners [deg].
        about: centre of the plane [rad]; None: the area's own.
    """
    lon, lat, _ = sensor_path.ring(area)
    at = about or (math.radians(lon), math.radians(lat))
    corners = np.radians(np.array(area.ring))
    x, y = sphere.track(corners[:, 0], corners[:, 1], sensor_path.EDGE)
    shape = shapely.Polygon(np.column_stack(sphere.offset(*at, x, y)))
    shapely.prepare(shape)
    return Region(*at, shape)


def sea(tow: Tow, begin: float, until: float) -> Sea:
    """Return where and when a ship may tow.

    Args:
        tow: the ship and its limits.
        begin: of the plan [s since 1970].
        until: end of the plan [s since 1970].
    """
    allowed = region(tow.allowed) if tow.allowed is not None else None
    return Sea(tow, max(begin, float(notation.epoch(tow.ready))), until, region(tow.begin), allowed)


def ashore(sea: Sea, lands: Callable[[Box], Any]) -> Sea:
    """Return a ship's sea with the land that it must avoid.

    Args:
        sea: where and when the ship may tow.
        lands: returns the land polygons [deg] in a box.
    """
    reach = sea.tow.speed * min(max(sea.until - sea.begin, 0.0), sea.tow.endurance)
    west, south, east, north = sea.begins.shape.bounds
    x, y = (
        np.array([low - reach, 0.5 * (low + high), high + reach])
        for low, high in ((west, east), (south, north))
    )
    lon, lat = (v.ravel() for v in sphere.destination(*sea.middle, *np.meshgrid(x, y)))
    centre = math.degrees(sea.middle[0])
    east_of_centre = np.degrees(sphere.wrap(lon - sea.middle[0]))
    box = Box(
        centre + float(east_of_centre.min()),
        float(np.degrees(lat.min())),
        centre + float(east_of_centre.max()),
        float(np.degrees(lat.max())),
    )
    projected = [
        shapely.transform(
            polygon, lambda xy: np.column_stack(sphere.offset(*sea.middle, *np.radians(xy).T))
        )
        for polygon in lands(box)
    ]
    if not projected:
        return sea
    land = shapely.union_all([shapely.make_valid(polygon) for polygon in projected])
    shapely.prepare(land)
    return replace(sea, land=land)


def _on_course(tow: Tow, course: Array) -> NDArray[np.bool_]:
    """Return which courses [rad] the ship may steer."""
    if tow.courses is None:
        return np.ones(np.shape(course), bool)
    low, high = tow.courses
    return np.asarray(np.mod(course - low, 2 * math.pi) <= np.mod(high - low, 2 * math.pi) + 1e-9)


def span(sea: Sea, ways: Ways) -> tuple[Array, Array]:
    """Return begin and end of listening [s since 1970] of each way, each of shape (c,)."""
    begin = np.full(len(ways), sea.begin)
    if sea.tow.base is not None:
        far = sphere.distance(
            math.radians(sea.tow.base[0]), math.radians(sea.tow.base[1]), ways.lon, ways.lat
        )
        begin = begin + far / sea.tow.transit_speed
    return begin, np.minimum(begin + sea.tow.endurance, sea.until)


def ships_at(sea: Sea, ways: Ways, time: Array) -> tuple[Array, Array]:
    """Return the ship's position on each way at some times.

    Before the begin of a way it is at its start, after the end of the way at its last position.

    Args:
        sea: where and when the ship may tow.
        ways: candidate ways (c).
        time: [s since 1970], shape (e,).

    Returns:
        Longitude and latitude [rad], each of shape (c, e).
    """
    begin, end = span(sea, ways)
    way_length = np.maximum(end - begin, 0.0) * sea.tow.speed
    gone = (
        np.clip(time - begin[:, None], 0.0, np.maximum(end - begin, 0.0)[:, None]) * sea.tow.speed
    )
    first = np.minimum(gone, (ways.turn * way_length)[:, None])
    lon, lat = _advance(ways.lon[:, None], ways.lat[:, None], ways.course[:, None], first)
    corner = _advance(ways.lon, ways.lat, ways.course, ways.turn * way_length)
    after = _advance(corner[0][:, None], corner[1][:, None], ways.second[:, None], gone - first)
    beyond = gone > first
    return np.where(beyond, after[0], lon), np.where(beyond, after[1], lat)


def _advance(lon: Array, lat: Array, course: Array, distance: Array) -> tuple[Array, Array]:
    """Return the position [rad] after a distance [m] on a course [rad]."""
    return sphere.destination(lon, lat, distance * np.sin(course), distance * np.cos(course))


def possible(sea: Sea, ways: Ways, time: Array) -> NDArray[np.bool_]:
    """Return which ways respect areas, courses, coast and the shortest time, shape (c,).

    Args:
        sea: where and when the ship may tow.
        ways: candidate ways (c).
        time: when the position is checked against the allowed area [s since 1970], shape (e,).
    """
    tow = sea.tow
    begin, end = span(sea, ways)
    good = (
        sea.begins.holds(ways.lon, ways.lat)
        & _on_course(tow, ways.course)
        & (end - begin >= LEAST_TIME)
    )
    good &= (ways.turn >= 1) | _on_course(tow, ways.second)
    if sea.allowed is None and sea.land is None:
        return good
    which = np.flatnonzero(good)
    some = ways.take(which)
    lon, lat = ships_at(sea, some, time)
    if sea.allowed is not None:
        good[which] &= sea.allowed.holds(lon, lat).all(axis=1)
    if sea.land is not None and which.size:
        x, y = sphere.offset(*sea.middle, *ships_at(sea, some, _check_times(sea, some, time)))
        lines = shapely.linestrings(np.stack([x, y], axis=2))
        good[which] &= ~shapely.intersects(sea.land, lines)
    return good


def _check_times(sea: Sea, ways: Ways, time: Array) -> Array:
    """Return the times [s since 1970] at which ways are tested for land."""
    return np.linspace(time[0], time[-1], 25)


def legs(sea: Sea, ways: Ways, number: int) -> Legs:
    """Return the legs of one way: its start, turn and end."""
    one = ways.take(np.array([number]))
    begin, end = (float(x[0]) for x in span(sea, one))
    turn = begin + float(one.turn[0]) * (end - begin)
    moments = [math.ceil(begin)] + ([turn] if one.turn[0] < 1 else []) + [math.floor(end)]
    lon, lat = (np.degrees(x[0]) for x in ships_at(sea, one, np.array(moments)))
    turned = np.degrees(np.unwrap(np.radians(lon)))
    return Legs(
        tuple(float(t) for t in moments),
        tuple(turned.tolist()),
        tuple(lat.tolist()),
        (True,) * (len(moments) - 1),
    )


def straight(ways: Ways) -> Ways:
    """Return the ways without their turn, as one leg each."""
    return replace(ways, second=ways.course, turn=np.ones(len(ways)))
