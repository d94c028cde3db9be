"""Records of the sensors of a case: parameters of the sonar equation, and tables of POD.

All values are SI, radians, UTC and decibels. Bearings are clockwise, ascending in [0, 2 pi), and
periodic; tables are interpolated linearly between their entries.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geo.array import Array
from geo.polyline import Area, Legs, LonLat


@dataclass(frozen=True, eq=False)
class Losses:
    """Transmission loss by bearing and range, about one place or several."""

    bearing: Array  # float64 (b,) true [rad]; one: the same all round
    # float64 (r,) [m], ascending; constant below the first, inaudible beyond the last
    range: Array
    loss: NDArray[np.float32]  # [dB] (p, b, r), of each place
    lon: Array  # float64 (p,) [rad] of the places; (0,): the same everywhere, with p = 1
    lat: Array
    name: str = ""  # for messages: the file, or how it was computed


@dataclass(frozen=True, eq=False)
class Noise:
    """Ambient noise by direction and time."""

    bearing: Array  # float64 (b,) true [rad]; one: the same all round
    level: NDArray[np.float32]  # [dB re 1 uPa^2/Hz, or in a band] (t, b)
    times: NDArray[np.datetime64]  # (t,) ascending; (0,): always the same, with t = 1


@dataclass(frozen=True, eq=False)
class Gain:
    """Array gain of each beam, by bearing relative to the array's heading."""

    bearing: Array  # float64 (b,) relative to the heading [rad]; one: the same all round
    # [dB] (beams, b); the gain is the highest of the processed beams
    beams: NDArray[np.float32]
    # float64 (beams,) relative bearing to which each beam is steered [rad]; NaN: unknown
    steered: Array
    mirrored: bool = False  # whether it cannot tell port from starboard, as a line cannot


@dataclass(frozen=True, eq=False)
class Levels:
    """Source level by scenario and speed."""

    # float64 (s,) over ground [m/s], ascending; constant below the first and above the last
    speed: Array
    level: NDArray[np.float32]  # [dB re 1 uPa at 1 m] (scenarios, s)


@dataclass(frozen=True, eq=False)
class Sonar:
    """A passive sonar: signal excess = source level - loss - (noise - gain) - threshold.

    It detects a target when the sum of signal excess and a fluctuation of standard deviation
    `fluctuation` is above 0. The fluctuation is constant until it jumps to an independent value, at
    a rate of `jump_rate`: the lambda-sigma process (McCabe and Belkin 1973; Wagner, Mylander and
    Sanders 1999, Naval Operations Analysis, chapter 5).
    """

    levels: Levels
    losses: Losses
    noise: Noise
    gain: Gain
    threshold: float  # [dB]
    fluctuation: float  # [dB], above 0
    jump_rate: float  # [1/s], at least 0
    # [dB] standard deviation of the error that all looks and watches of its group share
    unknown: float = 0.0


@dataclass(frozen=True, eq=False)
class PodGrid:
    """Probability of detection by place, or by bearing and range from the sensor."""

    pod: NDArray[np.float32]  # (t, lat, lon) or (t, b, r), 0 to 1
    # (t,) ascending, interpolated linearly; (0,): the same at all times, with t = 1
    times: NDArray[np.datetime64]
    # float64 [rad] (lat,) ascending, evenly spaced; POD is 0 outside the grid
    lat: Array | None = None
    # float64 [rad] (lon,) ascending, evenly spaced; it may pass 180 degrees
    lon: Array | None = None
    bearing: Array | None = None  # float64 [rad] (b,), see Losses
    range: Array | None = None  # float64 [m] (r,)
    per: float = math.nan  # [s] of searching for which it holds; NaN: duration of the watch
    name: str = ""


@dataclass(frozen=True, eq=False)
class Sensor:
    """A sensor of a case, to which watches, looks, contacts and units refer by name."""

    name: str
    sees: Sonar | PodGrid
    # (lon, lat) [deg] of a fixed sensor; None: its carrier moves
    place: tuple[float, float] | None = None
    heading: float = 0.0  # [rad] true, of the array of a fixed sensor
    group: str = ""  # sensors of one group share their unknown
    # [dB] least fluctuation of its group's sonars, which sets the number of nodes of the unknown
    steadiest: float = math.inf


@dataclass(frozen=True, eq=False)
class Tow:
    """A ship that tows an array, which a plan may place: it listens along one or two legs."""

    name: str
    sensor: Sensor
    begin: Area  # area in which it may begin to listen
    speed: float  # [m/s] while it listens
    ready: np.datetime64
    endurance: float = math.inf  # [s] of listening
    # (lon, lat) [deg] position when it is ready; None: at the start of its legs
    base: LonLat | None = None
    transit_speed: float = math.nan  # [m/s] from its base to the start of its legs
    allowed: Area | None = None  # area that it must not leave while it listens; None: anywhere
    # [rad] allowed courses, from the first clockwise to the second
    courses: tuple[float, float] | None = None
    legs: int = 2  # most legs, 1 or 2


@dataclass(frozen=True, eq=False)
class Listener:
    """An array whose beams are to be processed: fixed, placed by a plan, or towed along legs."""

    name: str
    sensor: Sensor
    # legs along which it is towed; None: its sensor is fixed, or a plan places its [[tow]]
    legs: Legs | None = None
    tow: str = ""  # name of the [[tow]] that tows it; "": none


@dataclass(frozen=True, eq=False)
class Processing:
    """Arrays with beams and fewer processors: the problem that a plan solves, slot by slot."""

    edges: NDArray[np.datetime64]  # of the slots (slots + 1,) UTC
    listeners: tuple[Listener, ...]
    processors: tuple[str, ...]  # their names
    # (processors, listeners): whether one can work on the beams of an array
    serves: NDArray[np.bool_]
    manned: NDArray[np.bool_]  # (slots, processors): whether it works in that slot
    cost: float = 0.0  # probability of detection that a beam must add to use a processor's slot
    # beams of each listener, from 0, that are processed without the plan
    today: tuple[tuple[int, ...], ...] | None = None

    @property
    def beams(self) -> tuple[int, ...]:
        """Number of beams of each listener."""
        return tuple(
            len(one.sensor.sees.gain.beams)
            for one in self.listeners
            if isinstance(one.sensor.sees, Sonar)
        )
