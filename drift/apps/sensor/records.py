"""Records of `drift sensor`: the question to a sensor, and its reach."""

import math
from dataclasses import dataclass

import numpy as np

from drift.evidence.sensors.records import Sensor, Sonar
from geo.array import Array


@dataclass(frozen=True, eq=False)
class Question:
    """A sensor that looks once, from a position at a time, for a target of one source level."""

    sensor: Sensor
    place: tuple[float, float]  # (lon, lat) [deg]
    heading: float  # [rad] true, of its array
    time: np.datetime64
    beams: tuple[int, ...] = ()  # numbers of the processed beams, from 0; (): all
    level: float = math.nan  # [dB re 1 uPa at 1 m] source level; NaN: the sensor is not a sonar
    assumed: tuple[tuple[str, str], ...] = ()  # assumptions: name, and value with reason

    @property
    def sonar(self) -> Sonar | None:
        """The sonar, or None if the sensor is a POD table."""
        return self.sensor.sees if isinstance(self.sensor.sees, Sonar) else None

    @property
    def has_array(self) -> bool:
        """Whether the sonar hears some directions better than others."""
        return self.sonar is not None and len(self.sonar.gain.bearing) > 1


@dataclass(frozen=True, eq=False)
class Looked:
    """Signal excess and probability of detection of one look at positions, of equal shape."""

    pod: Array  # 0 to 1
    # [dB]; NaN beyond the range of the loss table; None: the sensor is not a sonar
    excess: Array | None


@dataclass(frozen=True, eq=False)
class Reach:
    """Where a sensor detects a target by one look."""

    question: Question
    extent: float  # [m] radius of maps and tables around the sensor
    bearing: Array  # (360,) true [rad]
    range: Array  # (r,) [m] from 0
    around: Looked  # (360, r)
    # (360,) [m] largest range of 50 % detection, by bearing, outer zones included; 0: none
    farthest: Array
    unbroken: Array  # (360,) [m] range of 50 % detection without a gap
    lon: Array  # (x,) [deg] of the grid, ascending without jumps
    lat: Array  # (y,)
    cells: Looked  # (y, x)
