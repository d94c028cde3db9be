"""Search patterns: the legs that a unit flies and the area that they cover.

They follow the IAMSAR Manual, Vol. II, chapter 5. Points are laid out in the tangent plane of the
pattern's centre or datum, and placed on the sphere along great circles; legs between them are great
circles. Legs have constant speed; turns take no time.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geo import sphere
from geo.array import Array
from geo.polyline import Area, Legs, LonLat, legs_at_speed, unwrap

MOST_LEGS = 10_000  # most legs of a pattern
ROUND = 36  # corners of a circle's outline


@dataclass(frozen=True)
class Pattern:
    """Legs and the area that they search; None where that depends on the sweep width."""

    legs: Legs
    area: Area | None


def points_along(
    centre: LonLat, orientation: float, along: npt.ArrayLike, across: npt.ArrayLike
) -> tuple[Array, Array]:
    """Return (lon, lat) [deg] of points given along and across an orientation.

    Args:
        centre: origin of the points (lon, lat) [deg].
        orientation: clockwise from north [rad].
        along: distances along the orientation [m].
        across: distances to the right of it [m].

    Returns:
        Longitudes, without a jump, and latitudes [deg].
    """
    along, across = np.asarray(along, np.float64), np.asarray(across, np.float64)
    sin, cos = math.sin(orientation), math.cos(orientation)
    x, y = np.radians(centre)
    lon, lat = sphere.destination(x, y, along * sin + across * cos, along * cos - across * sin)
    return unwrap(np.degrees(lon), centre[0]), np.degrees(lat)


def rectangle(centre: LonLat, length: float, width: float, orientation: float) -> Area:
    """Return a rectangle whose length [m] lies along an orientation [rad]."""
    along, across = np.array([-1, 1, 1, -1]) * length / 2, np.array([-1, -1, 1, 1]) * width / 2
    return _area(*points_along(centre, orientation, along, across))


def _area(lon: Array, lat: Array) -> Area:
    return Area(tuple(lon.tolist()), tuple(lat.tolist()))


def square_metres(area: Area) -> float:
    """Return the area [m2] that great circles enclose on the sphere."""
    import pyproj  # imported here, since most cases search nothing and the import takes 0.1 s

    size, _ = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS).polygon_area_perimeter(
        area.lon, area.lat
    )
    return float(abs(size))


def parallel(
    centre: LonLat,
    length: float,
    width: float,
    orientation: float,
    spacing: float,
    start: float,
    speed: float,
    corner: tuple[int, int] = (-1, -1),
) -> Pattern:
    """Return a parallel sweep (PS): legs along the length, advancing across it.

    The number of legs is n = max(1, floor(width / spacing + 1/2)). Legs lie exactly one spacing
    apart and are centred in the width. So the outer legs lie half a spacing inside if the width is
    a whole number of spacings. Legs also end half a spacing inside, and the cross legs between them
    are searched.

    Args:
        centre: of the rectangle (lon, lat) [deg].
        length: along the orientation [m].
        width: across it [m].
        orientation: clockwise from north [rad].
        spacing: between legs [m].
        start: time of the commence search point [s since 1970].
        speed: of the unit [m/s].
        corner: (along, across), each -1 or 1: the corner where the search commences. (-1, -1) is
            astern and to the left of the orientation.

    Raises:
        ValueError: the spacing gives more than MOST_LEGS legs, or legs of no length.
    """
    number = leg_count(width, spacing)
    if number > MOST_LEGS:
        raise ValueError(
            f"spacing {spacing:g} m makes {number:,} legs of a width of {width:g} m; at most {MOST_LEGS:,}"
        )
    half = max(length - spacing, 0.0) / 2
    if half == 0:
        raise ValueError(
            f"spacing {spacing:g} m leaves legs of a length of {length:g} m none; make it smaller"
        )
    across = (np.arange(number) - (number - 1) / 2) * spacing * -corner[1]
    ends = np.where(np.arange(number) % 2 == 0, half, -half) * corner[0]
    points = points_along(
        centre, orientation, np.column_stack([ends, -ends]).ravel(), np.repeat(across, 2)
    )
    return Pattern(
        legs_at_speed(*points, start, speed), rectangle(centre, length, width, orientation)
    )


def creeping(
    centre: LonLat,
    length: float,
    width: float,
    orientation: float,
    spacing: float,
    start: float,
    speed: float,
    corner: tuple[int, int] = (-1, -1),
) -> Pattern:
    """Return a creeping line search (CS): legs across the length, advancing along it.

    The arguments are those of `parallel`.
    """
    # After a quarter turn to the right, right becomes ahead, and ahead becomes left.
    turned = (corner[1], -corner[0])
    swept = parallel(
        centre, width, length, orientation + math.pi / 2, spacing, start, speed, turned
    )
    return Pattern(swept.legs, rectangle(centre, length, width, orientation))


def leg_count(width: float, spacing: float) -> int:
    """Return the number of legs of a spacing [m] that fit a width [m]."""
    return max(1, math.floor(width / spacing + 0.5))


def square(
    datum: LonLat, spacing: float, orientation: float, legs: int, start: float, speed: float
) -> Pattern:
    """Return an expanding square search (SS) from the datum.

    Its legs are S, S, 2 S, 2 S, 3 S, ... long, with turns of 90 deg to starboard.
    """
    import shapely

    reach = (np.arange(legs) // 2 + 1) * spacing
    course = np.arange(legs) % 4
    along = np.concatenate([[0.0], np.cumsum(reach * np.array([1, 0, -1, 0])[course])])
    across = np.concatenate([[0.0], np.cumsum(reach * np.array([0, 1, 0, -1])[course])])
    # Half a spacing on each side covers the area without holes; 0.5001 allows for rounding.
    swept = shapely.LineString(np.column_stack([along, across])).buffer(
        0.5001 * spacing, cap_style="square", join_style="mitre"
    )
    outline = points_along(
        datum, orientation, *np.array(swept.exterior.simplify(1e-3 * spacing).coords)[:-1].T
    )
    return Pattern(
        legs_at_speed(*points_along(datum, orientation, along, across), start, speed),
        _area(*outline),
    )


def square_legs(spacing: float, distance: float) -> int:
    """Return the number of legs of an expanding square begun within a distance [m]."""
    # n legs are S (1 + 1 + 2 + 2 + ...) = S ceil(n/2) (floor(n/2) + 1) long.
    number = max(1, math.ceil(2 * math.sqrt(max(distance, 0.0) / spacing)) - 2)
    while spacing * -(-number // 2) * (number // 2 + 1) < distance * (1 - 1e-12):
        number += 1
    return number


def sector(
    datum: LonLat, radius: float, sectors: int, orientation: float, start: float, speed: float
) -> Pattern:
    """Return a sector search (VS) of 1 to 6 sectors through the datum.

    A sector is an equilateral triangle: out along a radius, across by a chord and back. All turns
    are 120 deg to starboard; the unit flies straight on over the datum into the next sector. Three
    sectors are a complete search; the fourth to sixth are a second search, turned by 30 deg.
    """
    along, across = [0.0], [0.0]
    for number in range(sectors):
        out = math.radians(240 * (number % 3) + 30 * (number // 3))
        for course in (out, out + math.pi / 3):  # the chord leads to the radius 60 degrees on
            along.append(radius * math.cos(course))
            across.append(radius * math.sin(course))
        along.append(0.0)
        across.append(0.0)
    turn = np.arange(ROUND) * (2 * math.pi / ROUND)
    outline = points_along(datum, orientation, radius * np.cos(turn), radius * np.sin(turn))
    return Pattern(
        legs_at_speed(*points_along(datum, orientation, along, across), start, speed),
        _area(*outline),
    )


def trackline(
    waypoints: list[LonLat], offset: float, back: bool, start: float, speed: float
) -> Pattern:
    """Return a trackline search (TS) along a route, `offset` [m] to its right.

    back: whether the unit returns on the other side of the route.
    """
    lon, lat = _beside(waypoints, offset)
    if back:
        home = _beside(waypoints[::-1], offset)
        lon, lat = np.concatenate([lon, home[0]]), np.concatenate([lat, home[1]])
    return Pattern(legs_at_speed(lon, lat, start, speed), None)


def _beside(route: list[LonLat], offset: float) -> tuple[Array, Array]:
    """Return a route [deg] displaced to its right by a distance [m].

    Corners are mitred at turns up to 90 deg, and doubled at sharper ones.
    """
    lon, lat = np.radians(np.array(route)).T
    if offset == 0:
        return np.degrees(lon), np.degrees(lat)
    # course at the beginning of each leg
    out = np.arctan2(*sphere.offset(lon[:-1], lat[:-1], lon[1:], lat[1:]))
    # course at the end of each leg
    into = np.arctan2(*sphere.offset(lon[1:], lat[1:], lon[:-1], lat[:-1])) + math.pi
    courses, reach, which = [out[0]], [offset], [0]
    for k in range(1, lon.size - 1):
        turn = float(sphere.wrap(out[k] - into[k - 1]))
        if abs(turn) <= math.pi / 2:
            courses.append(into[k - 1] + turn / 2)
            reach.append(offset / math.cos(turn / 2))
            which.append(k)
        else:
            courses += [into[k - 1], out[k]]
            reach += [offset, offset]
            which += [k, k]
    side, size = np.array([*courses, into[-1]]) + math.pi / 2, np.array([*reach, offset])
    index = np.array([*which, lon.size - 1])
    x, y = sphere.destination(lon[index], lat[index], size * np.sin(side), size * np.cos(side))
    return np.degrees(x), np.degrees(y)
