"""Records of sensors that know the water: what the sonar equation needs, and POD by place.

All is SI, radians, UTC and decibels. Bearings are clockwise, ascending in [0, 2 pi), and go on
round the circle; between the entries of a table its values are straight.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geo.array import Array
from geo.polyline import Area, Legs, LonLat


@dataclass(frozen=True, eq=False)
class Losses:
    """Transmission loss by bearing and range, round one place or several."""

    bearing: Array  # float64 (b,) true [rad]; one: the same all round
    # float64 (r,) [m], ascending; nearer than the first it is that of the first, beyond the last
    # nothing is heard
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
    """Array gain by bearing relative to the array's heading, of each of its beams."""

    bearing: Array  # float64 (b,) relative to the heading [rad]; one: the same all round
    # [dB] (beams, b); where all of them are processed it is the highest that counts
    beams: NDArray[np.float32]
    # float64 (beams,) relative bearing at which each beam looks [rad]; NaN: not told
    steered: Array
    mirrored: bool = False  # whether it cannot tell port from starboard, as a line cannot


@dataclass(frozen=True, eq=False)
class Levels:
    """Source level by scenario and speed."""

    # float64 (s,) over ground [m/s], ascending; below the first it is that of the first, above the
    # last of the last
    speed: Array
    level: NDArray[np.float32]  # [dB re 1 uPa at 1 m] (scenarios, s)


@dataclass(frozen=True, eq=False)
class Sonar:
    """A passive sonar: signal excess = source level - loss - (noise - gain) - threshold.

    It hears a target when its signal excess and a fluctuation of standard deviation `fluctuation`
    are together above 0. The fluctuation keeps its value until it jumps to another, independent
    one, at a rate of `jump_rate`: the lambda-sigma process (McCabe and Belkin 1973; Wagner,
    Mylander and Sanders 1999, Naval Operations Analysis, chapter 5).
    """

    levels: Levels
    losses: Losses
    noise: Noise
    gain: Gain
    threshold: float  # [dB]
    fluctuation: float  # [dB], above 0
    jump_rate: float  # [1/s], at least 0
    # [dB] standard deviation of what all looks and watches of its group have in common
    unknown: float = 0.0


@dataclass(frozen=True, eq=False)
class PodGrid:
    """Probability of detection by place, or by bearing and range round the sensor."""

    pod: NDArray[np.float32]  # (t, lat, lon) or (t, b, r), 0 to 1
    # (t,) ascending; (0,): at all times the same, with t = 1; straight in between
    times: NDArray[np.datetime64]
    # float64 [rad] (lat,) ascending, evenly spaced; beyond the grid nothing is detected
    lat: Array | None = None
    # float64 [rad] (lon,) ascending, evenly spaced; it may pass 180 degrees
    lon: Array | None = None
    bearing: Array | None = None  # float64 [rad] (b,), see Losses
    range: Array | None = None  # float64 [m] (r,)
    per: float = math.nan  # [s] for which it is there; NaN: for as long as the watch
    name: str = ""


@dataclass(frozen=True, eq=False)
class Sensor:
    """A sensor of a case, to which watches, looks, contacts and units refer by name."""

    name: str
    sees: Sonar | PodGrid
    # (lon, lat) [deg] where it stands; None: on what carries it
    place: tuple[float, float] | None = None
    heading: float = 0.0  # [rad] true, of the array of a sensor that stands
    group: str = ""  # sensors of one group share their unknown
    # [dB] least fluctuation of its group's sonars, for which values stand for the unknown
    steadiest: float = math.inf


@dataclass(frozen=True, eq=False)
class Tow:
    """A ship that tows an array, which a plan may place: it listens along one or two legs."""

    name: str
    sensor: Sensor
    begin: Area  # where it may begin to listen
    speed: float  # [m/s] while it listens
    ready: np.datetime64
    endurance: float = math.inf  # [s] of listening
    # (lon, lat) [deg] where it is when it is ready; None: wherever it is to begin
    base: LonLat | None = None
    transit_speed: float = math.nan  # [m/s] from its base to where it begins
    allowed: Area | None = None  # which it does not leave while it listens; None: it goes anywhere
    # [rad] that it may steer, from the first clockwise to the second
    courses: tuple[float, float] | None = None
    legs: int = 2  # most legs, 1 or 2


@dataclass(frozen=True, eq=False)
class Listener:
    """An array whose beams are to be processed: it stands, a plan places it, or it is towed along
    legs.
    """

    name: str
    sensor: Sensor
    # along which it is towed; None: it stands where its sensor says, or a [[tow]] is placed
    legs: Legs | None = None
    tow: str = ""  # name of the [[tow]] that tows it, "": none


@dataclass(frozen=True, eq=False)
class Processing:
    """Arrays with beams, and processors that are fewer: what a plan allocates, slot by slot."""

    edges: NDArray[np.datetime64]  # of the slots (slots + 1,) UTC
    listeners: tuple[Listener, ...]
    processors: tuple[str, ...]  # their names
    # (processors, listeners): whether one can work on the beams of an array
    serves: NDArray[np.bool_]
    manned: NDArray[np.bool_]  # (slots, processors): whether it works in that slot
    cost: float = 0.0  # chance of being heard that a beam must add to be worth a processor's slot
    # of each listener its beams, from 0, that would be processed else
    today: tuple[tuple[int, ...], ...] | None = None

    @property
    def beams(self) -> tuple[int, ...]:
        """How many beams each listener has."""
        return tuple(
            len(one.sensor.sees.gain.beams)
            for one in self.listeners
            if isinstance(one.sensor.sees, Sonar)
        )
