"""Likelihood of a look with a sensor of the case: whether it detected a target at one time."""

import math
from typing import Any, NamedTuple

import numpy as np

from drift.engine.particles.status import STRANDED, on_map
from drift.evidence.filter.detection import looks
from drift.evidence.filter.records import Look
from drift.evidence.sensors import hearing, pod_table, unknown
from drift.evidence.sensors.hearing import Receiver
from drift.evidence.sensors.records import Sensor, Sonar
from geo import sphere
from geo.array import Array

Device = Any


class Targets(NamedTuple):
    """Particles at the time of a look, each (n,)."""

    lon: Array  # binary angle
    lat: Array
    scenario: Array
    east: Array  # velocity over ground [m/s]; 0 if no likelihood needs it
    north: Array
    status: Array

    @property
    def speed(self) -> Array:
        """Speed over ground [m/s], (n,)."""
        return np.hypot(self.east, self.north)


def level_depends_on_speed(sensor: Sensor | None) -> bool:
    """Whether the source level of the targets depends on their speed."""
    return (
        sensor is not None and isinstance(sensor.sees, Sonar) and len(sensor.sees.levels.speed) > 1
    )


def log_likelihood(look: Look, targets: Targets) -> Array:
    """Return the log probability of a look's result by value of the unknown, (factors, n)."""
    assert look.sensor is not None
    assert look.place is not None
    at = math.radians(look.place[0]), math.radians(look.place[1])
    lon, lat = targets.lon * sphere.UNIT, targets.lat * sphere.UNIT
    there = on_map(targets.status)
    sees = look.sensor.sees
    if not isinstance(sees, Sonar):
        chance = pod_table.chance(sees, at, look.time, lon, lat)
        return looks.log_report_probability(
            np.where(there, chance, 0.0), look.positive, 1.0, look.false_alarms
        )[None]
    there &= ~np.isin(targets.status, STRANDED)
    source = hearing.level(sees, targets.scenario, targets.speed)
    over = hearing.signal_excess_of_sources(
        Receiver(sees, look.beams), at, look.heading, look.time, lon, lat, source
    )
    every = [
        np.where(there, hearing.instantaneous_pod(sees, over + offset), 0.0)
        for offset in unknown.values(look.sensor)[0]
    ]
    return np.stack(
        [
            looks.log_report_probability(chance, look.positive, 1.0, look.false_alarms)
            for chance in every
        ]
    )


def add_shared_report(said: Array, shared: Device, weights: Array) -> Array:
    """Return the log likelihood (n,) of a report, given all earlier reports of the group.

    The likelihood is the ratio of two means over the unknown: of the product of all reports with
    this one and without it. The report is added to `shared`.

    Args:
        said: logs by value of the unknown, shape (factors, n).
        shared: logs of all earlier reports, on the device, shape (factors * n,).
        weights: of the values, shape (factors,).
    """
    before = shared.to_numpy().reshape(said.shape).astype(np.float64)
    shared.from_numpy((before + said).astype(np.float32).reshape(-1))
    return average_over_unknown(said, before, weights)


def average_over_unknown(said: Array, before: Array, weights: Array) -> Array:
    """Return the log likelihood (n,) of a report, averaged over the unknown.

    Args:
        said: logs by value of the unknown, shape (factors, n).
        before: logs of all earlier reports, shape (factors, n).
        weights: of the values, shape (factors,).
    """
    after = before + said
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(weights)[:, None]
        ratio = np.logaddexp.reduce(after + logs, axis=0) - np.logaddexp.reduce(
            before + logs, axis=0
        )
    return np.where(np.isnan(ratio), -np.inf, ratio)
