"""Rectangles that a unit can search by parallel sweeps: from free numbers to what is flown in the time there is.

A rectangle is a row (x, y, orientation, log spacing, log of length over width, wait, along, across): centre [m] on the plane,
orientation [rad], seconds waited beyond the earliest arrival, and the corner of commencement (-1 or 1 each, as drift.patterns).
Legs are whole: n legs of L - S and n - 1 cross legs of S are n L - S of track, which the search time fills.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from drift import detection
from drift.reach import Reach
from drift.sortie import Unit
from drift.tracks import Plane

Array = npt.NDArray[Any]

X, Y, TURN, SPACING, ASPECT, WAIT, ALONG, ACROSS = range(8)
SHORTEST = 600.0  # [s] of search that is worth a sortie
CLEAR = 300.0  # [s] that an area must have been left before one beside it is searched
SLIMMEST = 2.0  # a leg's rectangle is at least so many spacings long
STEP = 0.01  # of coverage in the tables of b
MOST = 12.0


@dataclass(frozen=True)
class Crew:
    """A unit as the optimiser takes it."""

    unit: Unit
    reach: Reach
    plane: Plane
    zero: float  # [s since 1970] that times are counted from
    width: Array  # (scenarios,) sweep width [m]
    factor: Array  # (nodes,) of the sweep width, at the joint nodes of all unknown factors
    curve: Array  # b at multiples of STEP of coverage
    table: Array | None  # lateral range curve of a law without a rate: range / W, chance, ...; None: it has a rate

    @property
    def random(self) -> bool:
        """Whether it searches at random, without legs."""
        return self.unit.law.kind == "random"

    @property
    def widest(self) -> float:
        """Its greatest sweep width [m]."""
        return float(np.max(self.width))


def crew(unit: Unit, reach: Reach, plane: Plane, zero: float, factor: Array) -> Crew:
    """Return a unit as the optimiser takes it."""
    curve = detection.pod(unit.law, np.arange(round(MOST / STEP) + 1) * STEP)
    table = None
    if unit.law.kind not in ("random", "inverse_cube"):
        table = np.column_stack(detection.table(unit.law)).ravel()
    return Crew(unit, reach, plane, zero, np.array(unit.sweep_width), factor, curve, table)


class Flown(NamedTuple):
    """Rectangles as they would be flown, (c,) each."""

    start: Array  # [s] after the crew's zero
    duration: Array  # [s] of search
    legs: Array
    spacing: Array  # [m]
    length: Array  # [m]
    width: Array
    possible: Array  # bool


def fly(crew: Crew, rows: Array, corner: bool = False) -> Flown:
    """Return what becomes of rectangles when their search time is filled; corner: times by where they commence."""
    spacing = np.exp(rows[:, SPACING])
    x, y = rows[:, X], rows[:, Y]
    legs = length = np.zeros(len(rows))
    start, duration = legs, legs
    for turn in range(3 if corner else 1):
        if turn:
            x, y = commence(rows, length, spacing, legs)
        start, duration = crew.reach.slot(crew.reach.arrival(*crew.plane.round(x, y)) + rows[:, WAIT])
        track = crew.unit.search_speed * duration
        if not turn:
            legs = np.maximum(np.rint(np.sqrt(track / (np.exp(rows[:, ASPECT]) * spacing))), 1)
        length = (track + spacing) / legs
    possible = (duration >= SHORTEST) & (length >= SLIMMEST * spacing) & (spacing >= crew.unit.least_spacing)
    return Flown(start - crew.zero, duration, legs, spacing, length, legs * spacing, possible)


def commence(rows: Array, length: Array, spacing: Array, legs: Array) -> tuple[Array, Array]:
    """Return (x, y) [m] of the points where the searches commence."""
    along = rows[:, ALONG] * (length - spacing) / 2
    across = rows[:, ACROSS] * (legs - 1) / 2 * spacing
    sin, cos = np.sin(rows[:, TURN]), np.cos(rows[:, TURN])
    return rows[:, X] + along * sin + across * cos, rows[:, Y] + along * cos - across * sin


def smeared(crew: Crew, rows: Array, flown: Flown) -> tuple[Array, Array]:
    """Return rectangles for kernels.rectangles, (c, 9), and their coverage by scenario, (c, scenarios)."""
    sin, cos = np.sin(rows[:, TURN]), np.cos(rows[:, TURN])
    duration = np.maximum(flown.duration, 1.0)
    table = np.column_stack(
        [rows[:, X], rows[:, Y], sin, cos, flown.length, flown.width, flown.start, duration, -rows[:, ACROSS]]
    )
    track = crew.unit.search_speed * duration
    return table, crew.width * (track / np.maximum(flown.length * flown.width, 1.0))[:, None]


def path(crew: Crew, row: Array, flown: Flown, k: int) -> Array:
    """Return the nodes (time [s after zero], x, y [m]) of the legs and cross legs of rectangle k, (2 n, 3)."""
    legs, spacing = int(flown.legs[k]), float(flown.spacing[k])
    half = (float(flown.length[k]) - spacing) / 2
    ends = np.where(np.arange(legs) % 2 == 0, half, -half) * row[ALONG]
    along = np.column_stack([ends, -ends]).ravel()
    across = np.repeat((np.arange(legs) - (legs - 1) / 2) * -row[ACROSS] * spacing, 2)
    sin, cos = math.sin(row[TURN]), math.cos(row[TURN])
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(along), np.diff(across)))])
    return np.column_stack(
        [
            float(flown.start[k]) + way / crew.unit.search_speed,
            row[X] + along * sin + across * cos,
            row[Y] + along * cos - across * sin,
        ]
    )


def apart(rows: Array, flown: Flown, row: Array, other: Flown) -> Array:
    """Return the distance [m] of rectangles from one other; inf where the two are not searched at the same time.

    Where they overlap it is minus the way that would part them.
    """
    sin, cos = np.sin(rows[:, TURN]), np.cos(rows[:, TURN])
    half = np.stack([flown.length, flown.width]) / 2
    own = np.array([math.sin(row[TURN]), math.cos(row[TURN])])
    size = np.array([float(other.length[0]), float(other.width[0])]) / 2
    dx, dy = row[X] - rows[:, X], row[Y] - rows[:, Y]
    # Corners of each in the other's own directions: along, across.
    nearest = np.full(len(rows), np.inf)
    deepest = np.full(len(rows), -np.inf)  # gap along the direction that parts them most: separating axes
    turn_sin, turn_cos = own[0] * cos - own[1] * sin, own[1] * cos + own[0] * sin  # of the other, seen from each
    there = np.stack([dx * sin + dy * cos, dx * cos - dy * sin])
    back = np.stack([-dx * own[0] - dy * own[1], -dx * own[1] + dy * own[0]])
    for place, mine, yours, s in ((there, half, np.broadcast_to(size[:, None], half.shape), turn_sin),
                                  (back, np.broadcast_to(size[:, None], half.shape), half, -turn_sin)):  # fmt: skip
        corners = []
        for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            u, v = a * yours[0], b * yours[1]
            corners.append(np.stack([place[0] + u * turn_cos - v * s, place[1] + u * s + v * turn_cos]))
        at = np.stack(corners)
        gap = np.maximum(np.abs(at) - mine, 0)
        nearest = np.minimum(nearest, np.hypot(gap[:, 0], gap[:, 1]).min(axis=0))
        deepest = np.maximum(deepest, np.maximum(at.min(axis=0) - mine, -mine - at.max(axis=0)).max(axis=0))
    together = (flown.start < other.start[0] + other.duration[0] + CLEAR) & (
        other.start[0] < flown.start + flown.duration + CLEAR
    )
    return np.where(together, np.where(deepest < 0, deepest, nearest), np.inf)
