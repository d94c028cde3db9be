"""Ways and boxes of detections, written down by hand for tests of clouds that follow a target."""

import math

import numpy as np

from drift.tracking.tracker import path, sweeps
from drift.tracking.tracker.path import Leg, Path
from geo import sphere
from kernels.tracking.clouds import DETECTED

NMI, KNOT, MINUTE, HOUR = 1852.0, 1852 / 3600, 60.0, 3600.0
LON, LAT = math.radians(-121.0), math.radians(34.0)


def leg(course: float, speed: float, minutes: float) -> Leg:
    return Leg(math.radians(course), speed * KNOT, minutes * MINUTE)


def way(east: float, north: float, *legs: Leg) -> Path:
    """Return a way that begins so many nautical miles from the middle of the patch."""
    lon, lat = sphere.destination(LON, LAT, east * NMI, north * NMI)
    return path.of_legs(float(lon), float(lat), legs)


def one_box(
    bearing: float,
    near: float,
    far: float,
    half: float,
    time: float,
    place: np.ndarray,
    outcome: int = DETECTED,
) -> sweeps.Sweeps:
    """Return one sweep with ranges in nautical miles and angles in degrees."""
    return sweeps.Sweeps(
        np.array([time]), place[None], np.radians([bearing]), np.radians([half]), np.array([near]) * NMI / sphere.RADIUS,
        np.array([far]) * NMI / sphere.RADIUS, np.array([outcome], np.int32), np.array([-1], np.int32),
    )  # fmt: skip
