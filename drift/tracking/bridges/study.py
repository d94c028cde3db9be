"""A study of one bridge (lines, times, areas) and its answers."""

from dataclasses import dataclass

import numpy as np

from drift.tracking.bridges import bridge as bridges
from drift.tracking.bridges import crossing as crossings
from drift.tracking.bridges import ellipse
from drift.tracking.bridges.bridge import Bridge, Position
from drift.tracking.bridges.crossing import Chance, Crossing, Line
from geo import sphere
from geo.array import Array

CURVE = 81  # points of a curve of the crossing probability
ROUGH = 0.01  # (deviation / Earth's radius)^2 above which a note warns of the error


@dataclass(frozen=True)
class Study:
    """A bridge and the requested results.

    names: of the way points. times: [s since 1970], (m,). shares: of the areas; percentiles: of
    crossing times; both 0 to 1. coast: "gshhg", "none" or a shoreline file, for the map.
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
    """Results for a line: the probability of a crossing, and percentiles of its time.

    The times are [s since 1970], conditional on a crossing.
    """

    line: Line
    crossing: Crossing
    chance: Chance
    percentiles: tuple[float, ...]


@dataclass(frozen=True)
class Answers:
    """Positions at the requested times, areas [nmi2] (times, shares), and results for lines."""

    study: Study
    position: Position
    areas: Array
    touches: tuple[Touch, ...]
    notes: tuple[str, ...]


def answers(study: Study) -> Answers:
    """Return the results of a study."""
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
            f"it strays so far that the distributions (first order in the deviation) have an error of about {100 * rough:.0f} %"
        )
    return Answers(study, position, areas, tuple(touches), tuple(notes))


def curve(touch: Touch) -> tuple[Array, Array]:
    """Return times [s since 1970] and the probability of a crossing by then, (CURVE,) each."""
    time = np.linspace(touch.crossing.time[0], touch.crossing.time[-1], CURVE)
    return time, np.array([crossings.by(touch.crossing, float(moment)).value for moment in time])


def polygons(asked: Answers) -> list[list[Array]]:
    """Return the polygons of the areas at each time.

    Each is (corners, 2), lon and lat [deg], with continuous longitudes.
    """
    place = asked.position
    return [
        [ellipse.polygon(lon, lat, covariance, share) for share in asked.study.shares]
        for lon, lat, covariance in zip(place.lon, place.lat, place.covariance, strict=True)
    ]
