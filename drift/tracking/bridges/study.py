"""What is asked of one bridge: its lines, its times, its areas; and the answers as they are
printed, drawn and written.
"""

from dataclasses import dataclass

import numpy as np

from drift.tracking.bridges import bridge as bridges
from drift.tracking.bridges import crossing as crossings
from drift.tracking.bridges import ellipse
from drift.tracking.bridges.bridge import Bridge, Position
from drift.tracking.bridges.crossing import Chance, Crossing, Line
from geo import sphere
from geo.array import Array

CURVE = 81  # times of a curve of the probability of having touched a line
ROUGH = 0.01  # (deviation / Earth's radius)^2 from which a note says so


@dataclass(frozen=True)
class Study:
    """A bridge, and what is asked of it.

    names: of the way points. times: [s since 1970], (m,). shares: of the areas; percentiles: of
    crossing times; both 0 to 1. coast: "gshhg", "none" or a shoreline file, for the picture.
    """

    title: str
    bridge: Bridge
    names: tuple[str, ...]
    lines: tuple[Line, ...]
    times: Array
    shares: tuple[float, ...]
    percentiles: tuple[float, ...]
    coast: str


@dataclass(frozen=True)
class Touch:
    """What is to be told of a line: whether it is touched, and by when, if it is: [s since 1970],
    one for each percentile.
    """

    line: Line
    crossing: Crossing
    chance: Chance
    percentiles: tuple[float, ...]


@dataclass(frozen=True)
class Answers:
    """Positions at the times asked for, areas [nmi2] (times, shares), and what is to be told of
    each line.
    """

    study: Study
    position: Position
    areas: Array
    touches: tuple[Touch, ...]
    notes: tuple[str, ...]


def answers(study: Study) -> Answers:
    """Return what a study asks for."""
    position = bridges.bridge_at(study.bridge, study.times)
    areas = np.stack([ellipse.area(position.covariance, share) for share in study.shares], -1)
    touches = []
    for line in study.lines:
        seen = crossings.crossing(study.bridge, line)
        by = tuple(crossings.percentile(seen, share) for share in study.percentiles)
        touches.append(Touch(line, seen, crossings.at_all(seen), by))
    notes = []
    if (rough := (bridges.widest(study.bridge) / sphere.RADIUS) ** 2) > ROUGH:
        notes.append(
            f"it strays so far that the distributions, which are of first order in that, are off by some {100 * rough:.0f} %"
        )
    return Answers(study, position, areas, tuple(touches), tuple(notes))


def curve(touch: Touch) -> tuple[Array, Array]:
    """Return times [s since 1970] and the probability that the line has been touched by then,
    (CURVE,).
    """
    time = np.linspace(touch.crossing.time[0], touch.crossing.time[-1], CURVE)
    return time, np.array([crossings.by(touch.crossing, float(moment)).value for moment in time])


def polygons(asked: Answers) -> list[list[Array]]:
    """Return for each time the polygons of the areas, each (corners, 2), lon and lat [deg],
    longitudes without jumps.
    """
    place = asked.position
    return [
        [ellipse.polygon(lon, lat, covariance, share) for share in asked.study.shares]
        for lon, lat, covariance in zip(place.lon, place.lat, place.covariance, strict=True)
    ]
