"""Formulas on the spherical Earth in float64, and the binary angles in which positions are stored.

Angles are radians and distances metres unless a name says otherwise. Everything works on arrays, at
the antimeridian and at the poles. All formulas use vectors, because the haversine formula loses
precision near the antipode.
"""

from typing import TypeVar

import numpy as np
import numpy.typing as npt

from geo.array import Array

RADIUS = 6_371_008.8  # [m] mean radius R1 of GRS80 (Moritz 2000, doi:10.1007/s001900050278)
TURN = 2**32  # binary angle units in one turn: 9.3 mm at the equator
UNIT = 2 * np.pi / TURN  # [rad] one binary angle unit

Degrees = TypeVar("Degrees", float, Array)


def to_binary(angle_deg: npt.ArrayLike) -> Array:
    """Return angles [deg] as int32 binary angles.

    Longitudes wrap: 180 and -180 are the same number.
    """
    units = np.rint(np.asarray(angle_deg, np.float64) * (TURN / 360.0)).astype(np.int64)
    return ((units + 2**31) % TURN - 2**31).astype(np.int32)


def to_degrees(binary: npt.ArrayLike) -> Array:
    """Return int32 binary angles as degrees in [-180, 180), float64."""
    return np.asarray(binary, np.int64) * (360.0 / TURN)


def wrap(lon: npt.ArrayLike) -> Array:
    """Return longitudes [rad] wrapped into [-pi, pi)."""
    return (np.asarray(lon, np.float64) + np.pi) % (2 * np.pi) - np.pi


def wrap_degrees(lon: Degrees) -> Degrees:
    """Return longitudes [deg] wrapped into [-180, 180)."""
    return (lon + 180.0) % 360.0 - 180.0


def near_degrees(lon: Degrees, about: Degrees | float) -> Degrees:
    """Return longitudes [deg] shifted by whole turns to within half a turn of `about`."""
    return about + (lon - about + 180.0) % 360.0 - 180.0


def east_of_degrees(lon: Degrees, west: Degrees | float) -> Degrees:
    """Return longitudes [deg] shifted by whole turns to within one turn east of `west`."""
    return west + (lon - west) % 360.0


def vector(lon: npt.ArrayLike, lat: npt.ArrayLike) -> tuple[Array, Array, Array]:
    """Return points [rad] as unit vectors (x, y, z)."""
    lon, lat = np.asarray(lon, np.float64), np.asarray(lat, np.float64)
    return np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)


def distance(
    lon1: npt.ArrayLike, lat1: npt.ArrayLike, lon2: npt.ArrayLike, lat2: npt.ArrayLike
) -> Array:
    """Return the great-circle distance [m] between points [rad], exact at any separation."""
    a, b = np.broadcast_arrays(*vector(lon1, lat1)), np.broadcast_arrays(*vector(lon2, lat2))
    cross = np.sqrt(
        (a[1] * b[2] - a[2] * b[1]) ** 2
        + (a[2] * b[0] - a[0] * b[2]) ** 2
        + (a[0] * b[1] - a[1] * b[0]) ** 2
    )
    return np.asarray(RADIUS * np.arctan2(cross, a[0] * b[0] + a[1] * b[1] + a[2] * b[2]))


def offset(
    lon1: npt.ArrayLike, lat1: npt.ArrayLike, lon2: npt.ArrayLike, lat2: npt.ArrayLike
) -> tuple[Array, Array]:
    """Return (east, north) [m] of point 2 in the tangent plane of point 1 (points in rad).

    This is the inverse exponential map.
    """
    lon1, lat1, lon2, lat2 = (np.asarray(x, np.float64) for x in (lon1, lat1, lon2, lat2))
    dlon = lon2 - lon1
    x = np.cos(lat2) * np.sin(dlon)
    y = np.cos(lat1) * np.sin(lat2) - np.sin(lat1) * np.cos(lat2) * np.cos(dlon)
    z = np.sin(lat1) * np.sin(lat2) + np.cos(lat1) * np.cos(lat2) * np.cos(dlon)
    chord = np.hypot(x, y)
    scale = RADIUS * np.where(chord > 0, np.arctan2(chord, z) / np.where(chord > 0, chord, 1), 1)
    return x * scale, y * scale


def destination(
    lon: npt.ArrayLike, lat: npt.ArrayLike, east: npt.ArrayLike, north: npt.ArrayLike
) -> tuple[Array, Array]:
    """Return (lon, lat) [rad] reached from a point [rad] along the great circle (east, north) [m].

    This is the exponential map.
    """
    lon, lat = np.asarray(lon, np.float64), np.asarray(lat, np.float64)
    east, north = np.asarray(east, np.float64), np.asarray(north, np.float64)
    angle = np.hypot(east, north) / RADIUS
    sinc = np.sinc(angle / np.pi) / RADIUS  # sin(angle) / (angle R), 1/R at zero
    x, y, z = east * sinc, north * sinc, np.cos(angle)
    up, pole = z * np.cos(lat) - y * np.sin(lat), z * np.sin(lat) + y * np.cos(lat)
    return wrap(lon + np.arctan2(x, up)), np.arctan2(pole, np.hypot(x, up))


def track(lon: npt.ArrayLike, lat: npt.ArrayLike, longest: float) -> tuple[Array, Array]:
    """Return points (lon, lat) [rad] along great-circle legs between corners [rad].

    longest: largest distance between two points [m].
    """
    lon, lat = np.asarray(lon, np.float64), np.asarray(lat, np.float64)
    east, north = offset(lon[:-1], lat[:-1], lon[1:], lat[1:])
    count = np.maximum(np.ceil(np.hypot(east, north) / longest).astype(np.int64), 1)
    leg = np.repeat(np.arange(count.size), count)
    share = (np.arange(leg.size) - (np.cumsum(count) - count)[leg] + 1) / count[leg]
    x, y = destination(lon[leg], lat[leg], east[leg] * share, north[leg] * share)
    return np.concatenate([lon[:1], x]), np.concatenate([lat[:1], y])


def to_pole(
    lon: npt.ArrayLike, lat: npt.ArrayLike, east: npt.ArrayLike, north: npt.ArrayLike
) -> tuple[Array, Array]:
    """Return vectors near a pole in one frame: the polar plane's, aligned with the prime meridian.

    The local frames of two positions differ by the angle between their meridians. This is exact at
    the pole, and off by 1.5e-4 of that angle at 89 degrees. kernels.maths.sphere.meridian is the
    same on the device.

    Args:
        lon: of the positions [rad].
        lat: of the positions; only its sign is used, to choose the pole.
        east: component of the vectors in the local frame.
        north: component of the vectors in the local frame.

    Returns:
        The components of the vectors in the common frame, in the unit of the input.
    """
    turn = np.asarray(lon, float) * np.where(np.asarray(lat) < 0, -1.0, 1.0)
    cosine, sine = np.cos(turn), np.sin(turn)
    u, v = np.asarray(east), np.asarray(north)
    return np.asarray(u * cosine - v * sine), np.asarray(v * cosine + u * sine)


def from_pole(
    lon: npt.ArrayLike, lat: npt.ArrayLike, east: npt.ArrayLike, north: npt.ArrayLike
) -> tuple[Array, Array]:
    """Return vectors of the common frame of `to_pole` as local east and north; its inverse.

    lon, lat: positions [rad].
    """
    return to_pole(-np.asarray(lon, float), lat, east, north)
