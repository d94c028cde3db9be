"""Recorded detections of a tracker's sensors: their boxes, and when silence is evidence."""

from dataclasses import dataclass

import numpy as np

from drift.tracking.tracker import path, sweeps
from drift.tracking.tracker.path import Path
from drift.tracking.tracker.records import Sensor
from drift.tracking.tracker.sweeps import Sweeps
from geo import sphere
from geo.array import Array
from kernels.tracking.clouds import DETECTED, SILENT


@dataclass(frozen=True)
class Detections:
    """Detections in order of time, each (n,)."""

    time: Array  # [s]
    sensor: Array  # index of the sensor
    bearing: Array  # [rad]; NaN: unknown
    range: Array  # [m]; NaN: unknown


def swept(
    sensors: tuple[Sensor, ...], found: Detections, tracker: Path, end: float
) -> list[Sweeps]:
    """Return the results of each sensor's sweeps until an end [s], detections first.

    Particles redrawn from a detection are then cut by other sensors' silence at the same time. A
    detection's box is the measured range less and more the sensor's share of it, at most its reach.
    Silence counts as described in `silences`.

    Args:
        sensors: of the tracker.
        found: their recorded detections.
        tracker: its path.
        end: [s].
    """
    parts = []
    for number, sensor in enumerate(sensors):
        own = found.sensor == number
        parts.append(
            _detected(sensor, found.time[own], found.bearing[own], found.range[own], tracker)
        )
    silent = zip(sensors, silences(sensors, found, tracker, end), strict=True)
    return parts + [_silent(sensor, times, tracker) for sensor, times in silent if not sensor.hears]


def silences(
    sensors: tuple[Sensor, ...], found: Detections, tracker: Path, end: float
) -> list[Array]:
    """Return the times [s] of each sensor's sweeps whose silence is evidence.

    Silence counts while the sensor is on, is not a passive receiver, and the tracker's position is
    known. It does not count within `grace` of a detection, by any sensor, of a target within this
    sensor's reach: the sensor should then have reported something, so its log is incomplete.

    Args:
        sensors: of the tracker.
        found: their recorded detections.
        tracker: its path.
        end: [s].
    """
    reach = np.array([sensor.reach for sensor in sensors])
    farthest = np.where(np.isnan(found.range), reach[found.sensor], found.range)
    times = []
    for number, sensor in enumerate(sensors):
        time = np.empty(0) if sensor.hears else sensor.on.sweeps(sensor.interval, end)
        time = time[(time >= tracker.time[0]) & (time <= tracker.time[-1])]
        within = (found.sensor == number) | (farthest <= sensor.reach)
        known = np.concatenate([[-np.inf], found.time[within], [np.inf]])
        after = np.searchsorted(known, time, side="right")
        times.append(
            time[
                np.minimum(time - known[after - 1], known[after] - time) >= max(sensor.grace, 1e-6)
            ]
        )
    return times


def _detected(
    sensor: Sensor, time: Array, bearing: Array, measured: Array, tracker: Path
) -> Sweeps:
    """Return the sweeps of one sensor's detections."""
    reach = sensor.reach / sphere.RADIUS
    distance = measured / sphere.RADIUS
    return Sweeps(
        time,
        tracker.at(time)[0],
        np.nan_to_num(bearing),
        np.where(np.isnan(bearing), np.pi, sensor.bearing_error),
        np.nan_to_num(distance * (1 - sensor.range_share)),
        np.fmin(distance * (1 + sensor.range_share), reach),
        np.full(len(time), DETECTED, np.int32),
        np.full(len(time), -1, np.int32),
    )


def _silent(sensor: Sensor, time: Array, tracker: Path) -> Sweeps:
    """Return the sweeps of one sensor that found nothing."""
    zero, n = np.zeros(len(time)), len(time)
    return Sweeps(
        time,
        tracker.at(time)[0],
        zero,
        zero + np.pi,
        zero,
        zero + sensor.reach / sphere.RADIUS,
        np.full(n, SILENT, np.int32),
        np.full(n, -1, np.int32),
    )


def ordered(
    sensors: tuple[Sensor, ...], found: Detections, tracker: Path, moments: Array, end: float
) -> Sweeps:
    """Return all sweeps in order of time, with marks after the sweeps of the same time.

    Args:
        sensors: of the tracker.
        found: their recorded detections.
        tracker: its path.
        moments: times of the marks [s], shape (n,).
        end: of the sweeps [s].
    """
    return sweeps.ordered([*swept(sensors, found, tracker, end), sweeps.marks(moments, tracker)])


def needed(sensors: tuple[Sensor, ...], found: Detections, tracker: Path) -> tuple[Array, Array]:
    """Return the speed that the target needed at least between consecutive located detections.

    Returns:
        The times [s] of the later detections, and the speeds [m/s] between the boxes of each pair.
    """
    own = ~np.isnan(found.bearing) & ~np.isnan(found.range)
    time, bearing, far = found.time[own], found.bearing[own], found.range[own]
    share, error = (
        np.array([getattr(sensors[k], name) for k in found.sensor[own]])
        for name in ("range_share", "bearing_error")
    )
    lon, lat = np.radians(path.degrees(tracker.at(time)[0]))
    place = path.vector(*sphere.destination(lon, lat, far * np.sin(bearing), far * np.cos(bearing)))
    slack = far * np.hypot(share, np.minimum(error, 1.0))
    apart = np.maximum(
        path.arc(place[1:], place[:-1]) * sphere.RADIUS - slack[1:] - slack[:-1], 0.0
    )
    return time[1:], apart / np.maximum(np.diff(time), 1.0)
