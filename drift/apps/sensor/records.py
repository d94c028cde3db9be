"""Records of where a sensor hears: what is asked of it, and what is found."""

import math
from dataclasses import dataclass

import numpy as np

from drift.evidence.sensors.records import Sensor, Sonar
from geo.array import Array


@dataclass(frozen=True, eq=False)
class Question:
    """A sensor that looks once, from a place at a time, for a target of one source level."""

    sensor: Sensor
    place: tuple[float, float]  # (lon, lat) [deg]
    heading: float  # [rad] true, of its array
    time: np.datetime64
    beams: tuple[int, ...] = ()  # numbers of those that are listened to, from 0; (): all
    level: float = math.nan  # [dB re 1 uPa at 1 m] source level; NaN: it is no sonar
    assumed: tuple[tuple[str, str], ...] = ()  # what was taken for granted: name, and what and why

    @property
    def sonar(self) -> Sonar | None:
        """Its sonar, if it is one."""
        return self.sensor.sees if isinstance(self.sensor.sees, Sonar) else None

    @property
    def has_array(self) -> bool:
        """Whether it hears some directions better than others."""
        return self.sonar is not None and len(self.sonar.gain.bearing) > 1


@dataclass(frozen=True, eq=False)
class Looked:
    """Signal excess and probability of detection of one look at places, of one shape."""

    pod: Array  # 0 to 1
    # [dB]; NaN where the sound is not known, for it is too far; None: no sonar
    excess: Array | None


@dataclass(frozen=True, eq=False)
class Reach:
    """Where a sensor hears."""

    question: Question
    extent: float  # [m] from its place, of maps and tables
    bearing: Array  # (360,) true [rad]
    range: Array  # (r,) [m] from 0
    around: Looked  # (360, r)
    # (360,) [m] to which a look detects with 50 %, by bearing, zones included; 0: nowhere
    farthest: Array
    unbroken: Array  # (360,) [m] up to which it does without a gap
    lon: Array  # (x,) [deg] of a grid, ascending without jumps
    lat: Array  # (y,)
    cells: Looked  # (y, x)
