"""Daylight at a place: sunrise to sunset.

The sun's position is the low-accuracy one of Meeus 1998, Astronomical Algorithms, chapters 25 and
28 (also used by NOAA's solar calculator). Its error is 0.01 degrees from 1900 to 2100. Sunrise is
then accurate to a minute below 65 degrees of latitude under normal refraction. A polar day is one
interval, a polar night none.
"""

import numpy as np
import numpy.typing as npt

from geo import sphere
from geo.array import Array

# [deg] elevation of the sun's centre at apparent sunrise: its radius and refraction
HORIZON = -0.833
J2000 = 946_728_000.0  # [s since 1970] noon of 1 January 2000
# [s] between samples of the elevation; linear interpolation gives its zero to a second
SAMPLE = 300.0


def sun(time: npt.ArrayLike) -> tuple[Array, Array]:
    """Return the sun's declination [rad] and the equation of time [s], apparent less mean.

    Args:
        time: [s since 1970].
    """
    days = (np.asarray(time, np.float64) - J2000) / 86_400 + 70 / 86_400  # TD is 70 s ahead
    t = days / 36_525
    mean = np.radians(280.46646 + 36_000.76983 * t + 0.0003032 * t**2)
    anomaly = np.radians(357.52911 + 35_999.05029 * t - 0.0001537 * t**2)
    centre = (
        (1.914602 - 0.004817 * t) * np.sin(anomaly)
        + 0.019993 * np.sin(2 * anomaly)
        + 0.000289 * np.sin(3 * anomaly)
    )
    node = np.radians(125.04 - 1934.136 * t)
    apparent = mean + np.radians(centre - 0.00569 - 0.00478 * np.sin(node))
    tilt = np.radians(23.439291 - 0.0130042 * t + 0.00256 * np.cos(node))
    right = np.arctan2(np.cos(tilt) * np.sin(apparent), np.cos(apparent))
    # equation 28.1; its nutation is a third of a second
    ahead = mean - np.radians(0.0057183) - right
    ahead = sphere.wrap(ahead)
    return np.arcsin(np.sin(tilt) * np.sin(apparent)), ahead * (86_400 / (2 * np.pi))


def _elevation(time: npt.ArrayLike, lon: float, lat: float) -> Array:
    """Return the sun's elevation [deg] without refraction.

    Args:
        time: [s since 1970], any shape.
        lon: of the place [deg].
        lat: of the place [deg].
    """
    declination, ahead = sun(time)
    hour = (
        (np.asarray(time, np.float64) % 86_400 + ahead) * (2 * np.pi / 86_400)
        + np.radians(lon)
        - np.pi
    )
    phi = np.radians(lat)
    sine = np.sin(phi) * np.sin(declination) + np.cos(phi) * np.cos(declination) * np.cos(hour)
    return np.asarray(np.degrees(np.arcsin(np.clip(sine, -1, 1))))


def windows(
    begin: float, end: float, lon: float, lat: float, horizon: float = HORIZON
) -> list[tuple[float, float]]:
    """Return the intervals of daylight (begin, end) [s since 1970], in order.

    Args:
        begin: of the time considered [s since 1970].
        end: of the time considered [s since 1970].
        lon: of the place [deg].
        lat: of the place [deg].
        horizon: elevation of the sun's centre at sunrise and sunset [deg].
    """
    if end <= begin:
        return []
    time = np.linspace(begin, end, int(np.ceil((end - begin) / SAMPLE)) + 1)
    above = _elevation(time, lon, lat) - horizon
    up = above > 0
    turn = np.flatnonzero(up[1:] != up[:-1])
    at = time[turn] + (time[turn + 1] - time[turn]) * above[turn] / (above[turn] - above[turn + 1])
    edges = [*([begin] if up[0] else []), *(float(v) for v in at), *([end] if up[-1] else [])]
    return list(zip(edges[0::2], edges[1::2], strict=True))
