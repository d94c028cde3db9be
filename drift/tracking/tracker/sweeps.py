"""Results of the sweeps of the tracker's sensors, and the times of estimates (marks)."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from drift.tracking.tracker import path
from drift.tracking.tracker.path import Path
from drift.tracking.tracker.records import Plan, Sensor
from geo import sphere
from geo.array import Array
from kernels.tracking.clouds import DETECTED, MARK, SILENT


@dataclass(frozen=True)
class Sweeps:
    """Sweeps in order of time, each (n,).

    Sweeps of one time are in the order of their sensors, followed by marks.
    """

    time: Array  # [s]
    place: Array  # unit vectors of the tracker; at marks, of the target (n, 3)
    bearing: Array  # [rad] of the detection
    half: Array  # [rad] half the width of its box
    near: Array  # [rad] least range of its box; 0 without a detection
    far: Array  # [rad] greatest range of its box, or the reach of a silent sensor
    outcome: Array  # kernels.tracking.clouds.SILENT, DETECTED or MARK
    row: Array  # row of the estimates, or -1

    @property
    def marked(self) -> Array:
        """Whether each row is a mark, at which nothing is swept."""
        return np.asarray(self.outcome == MARK)

    def __len__(self) -> int:
        return len(self.time)


def join_sweeps(parts: Sequence[Sweeps]) -> Sweeps:
    """Return several sets of sweeps one after the other."""
    return Sweeps(
        *(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Sweeps))
    )


def ordered(parts: Sequence[Sweeps], every_detection: bool = False) -> Sweeps:
    """Return sweeps of several sensors in order of time, with numbered rows of estimates.

    Args:
        parts: sweeps of each sensor, and marks.
        every_detection: whether estimates are also recorded at each detection.
    """
    number = np.concatenate([np.full(len(part), k) for k, part in enumerate(parts)])
    joined = join_sweeps(parts)
    order = np.lexsort((number, joined.outcome == MARK, joined.time))
    columns = {field.name: getattr(joined, field.name)[order] for field in fields(Sweeps)}
    recorded = (columns["outcome"] == MARK) | (every_detection & (columns["outcome"] == DETECTED))
    columns["row"] = np.where(recorded, np.cumsum(recorded) - 1, -1).astype(np.int32)
    return Sweeps(**columns)


def times(sensor: Sensor, end: float, emissions: Array) -> Array:
    """Return when a sensor sweeps, or may hear the target's emissions [s].

    Args:
        sensor: of the tracker.
        end: of the sweeps [s].
        emissions: of the target [s], shape (n,).
    """
    return emissions[emissions <= end] if sensor.hears else sensor.on.sweeps(sensor.interval, end)


def emitted(radiates: Plan | None, interval: float, end: float) -> Array:
    """Return the times [s] of the sweeps of a target's radar."""
    return np.empty(0) if radiates is None else radiates.sweeps(interval, end)


def of_sensor(sensor: Sensor, moments: Array, tracker: Path, target: Array) -> Sweeps:
    """Return the sweeps of a sensor.

    Args:
        sensor: of the tracker.
        moments: times of the sweeps [s], shape (n,).
        tracker: its path.
        target: unit vectors of the target at these times, shape (n, 3).
    """
    place, _ = tracker.at(moments)
    distance, there = path.arc(place, target), path.frame(place)
    bearing = np.arctan2(np.sum(target * there.east, axis=1), np.sum(target * there.north, axis=1))
    reach = sensor.reach / sphere.RADIUS
    seen = distance <= reach
    keep = seen | (not sensor.hears)
    near = np.where(seen, np.maximum(distance * (1 - sensor.range_share), 0.0), 0.0)
    far = np.where(seen, np.minimum(distance * (1 + sensor.range_share), reach), reach)
    half = np.where(seen, sensor.bearing_error, np.pi)
    outcome = np.where(seen, DETECTED, SILENT).astype(np.int32)
    row = np.full(len(moments), -1, np.int32)
    return Sweeps(*(x[keep] for x in (moments, place, bearing, half, near, far, outcome, row)))


def marks(moments: Array, target: Path) -> Sweeps:
    """Return rows at which the estimate is recorded and nothing is swept.

    Args:
        moments: [s], shape (n,).
        target: its path.
    """
    zero = np.zeros(len(moments))
    kind = np.full(len(moments), MARK, np.int32)
    return Sweeps(moments, target.at(moments)[0], zero, zero, zero, zero, kind, kind)
