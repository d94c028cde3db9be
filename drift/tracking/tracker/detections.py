"""What a tracker's sensors told, of which only detections were written down: their boxes, and when
silence counts.
"""

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
    """What was detected, in order of time, each (n,)."""

    time: Array  # [s]
    sensor: Array  # number of the sensor
    bearing: Array  # [rad]; NaN: nothing is told of it
    range: Array  # [m]; NaN: nothing is told of it


def swept(
    sensors: tuple[Sensor, ...], found: Detections, tracker: Path, end: float
) -> list[Sweeps]:
    """Return what each sensor's sweeps came to until an end [s]: what they detected first.

    What is drawn again from a detection at one time is then cut by what others did not see at that
    time. A detection's box is the measured range less and more the sensor's share of it, at most
    its reach. Silence counts as `silences` says.
    """
    parts = []
    for number, sensor in enumerate(sensors):
        mine = found.sensor == number
        parts.append(
            _detected(sensor, found.time[mine], found.bearing[mine], found.range[mine], tracker)
        )
    silent = zip(sensors, silences(sensors, found, tracker, end), strict=True)
    return parts + [_silent(sensor, times, tracker) for sensor, times in silent if not sensor.hears]


def silences(
    sensors: tuple[Sensor, ...], found: Detections, tracker: Path, end: float
) -> list[Array]:
    """Return the times [s] of each sensor's sweeps that found nothing and tell something by it,
    until an end [s].

    They do while the sensor is on, does not hear, and the tracker's place is known; and no nearer
    than `grace` to a detection of what is within its reach, by whomever: of that the sensor should
    have said something, so that its log is not whole.
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
    """Return all sweeps in order of time, with marks at times [s] (n,), after what is swept at
    them.
    """
    return sweeps.ordered([*swept(sensors, found, tracker, end), sweeps.marks(moments, tracker)])


def needed(sensors: tuple[Sensor, ...], found: Detections, tracker: Path) -> tuple[Array, Array]:
    """Return the times [s] of detections that tell a place and follow another, and a speed [m/s]
    that the target had at least between the boxes of the two.
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
