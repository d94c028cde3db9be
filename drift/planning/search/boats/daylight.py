"""When there is daylight at a place: sunrise to sunset.

The sun's position is that of low accuracy in Meeus 1998, Astronomical Algorithms, chapters 25 and
28 (NOAA's solar calculator uses the same). It is right to 0.01 degrees from 1900 to 2100, so that
sunrise is right to a minute below 65 degrees of latitude under normal refraction. Polar day is one
window, polar night none.
"""

import numpy as np
import numpy.typing as npt

from geo import sphere
from geo.array import Array

# [deg] elevation of the sun's centre when its upper limb seems to rise: its radius and refraction
HORIZON = -0.833
J2000 = 946_728_000.0  # [s since 1970] noon of 1 January 2000
# [s] between samples of the elevation; with lines between them its zero is right to a second
SAMPLE = 300.0


def sun(time: npt.ArrayLike) -> tuple[Array, Array]:
    """Return the sun's declination [rad] and the equation of time [s], apparent less mean.

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


def elevation(time: npt.ArrayLike, lon: float, lat: float) -> Array:
    """Return the sun's elevation [deg] without refraction at times [s since 1970] and a place
    [deg].
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
    """Return the spans (begin, end) [s since 1970] of daylight at a place [deg] between two times,
    in order.
    """
    if end <= begin:
        return []
    time = np.linspace(begin, end, int(np.ceil((end - begin) / SAMPLE)) + 1)
    above = elevation(time, lon, lat) - horizon
    up = above > 0
    turn = np.flatnonzero(up[1:] != up[:-1])
    at = time[turn] + (time[turn + 1] - time[turn]) * above[turn] / (above[turn] - above[turn + 1])
    edges = [*([begin] if up[0] else []), *(float(v) for v in at), *([end] if up[-1] else [])]
    return list(zip(edges[0::2], edges[1::2], strict=True))
