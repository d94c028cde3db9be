"""How a unit lays its legs: the pattern, and the frame in which it is laid.

A pattern is laid in a frame that stands on the ground or drifts at a constant velocity, as a cloud
does; over ground the unit keeps its search speed. Patterns are those of the IAMSAR Manual, Vol. II,
chapter 5.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geo.array import Array

SEARCH = 9.0  # radii of track in a sector search: three sectors, each out, across and back
FASTEST = 0.5  # of the search speed: greatest speed of a frame


@dataclass(frozen=True)
class Manner:
    """A pattern, and the velocity over ground of the frame in which it is laid."""

    pattern: str = "parallel"  # an entry of PATTERNS
    east: float = 0.0  # [m/s]
    north: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether the frame drifts."""
        return self.east != 0 or self.north != 0

    @property
    def plain(self) -> bool:
        """Whether it is parallel legs on the ground."""
        return self.pattern == "parallel" and not self.moves


PLAIN = Manner()


class Size(NamedTuple):
    """The size of patterns that fill their track, (c,) each."""

    legs: Array
    spacing: Array  # [m]; of a sector search its radius
    length: Array  # [m]
    width: Array


@dataclass(frozen=True)
class Pattern:
    """A pattern: its size, and its points."""

    words: str  # as crews call it
    # of the track [m], the spacing [m] and the ratio of length to width
    size: Callable[[Array, Array, Array], Size]
    # (along, across) [m] of its points, by number of legs, spacing and length [m]; from a corner
    # (along, across) on
    points: Callable[[int, float, float, float, float], tuple[Array, Array]]


def _parallel_size(track: Array, spacing: Array, ratio: Array) -> Size:
    """Return n legs of L - S and n - 1 cross legs of S, which are n L - S of track."""
    legs = np.maximum(np.rint(np.sqrt(track / (ratio * spacing))), 1)
    return Size(legs, spacing, (track + spacing) / legs, legs * spacing)


def _parallel_points(
    legs: int, spacing: float, length: float, along: float, across: float
) -> tuple[Array, Array]:
    half = (length - spacing) / 2
    ends = np.where(np.arange(legs) % 2 == 0, half, -half) * along
    aside = np.repeat((np.arange(legs) - (legs - 1) / 2) * -across * spacing, 2)
    return np.column_stack([ends, -ends]).ravel(), aside


def _square_size(track: Array, spacing: Array, ratio: Array) -> Size:
    """Return an expanding square whose legs are S, S, 2 S, 2 S, ... long, the last of them cut off."""
    # n legs are S ceil(n/2) (floor(n/2) + 1) long
    legs = np.maximum(np.ceil(2 * np.sqrt(track / spacing)), 1)
    side = (np.ceil(legs / 2) + 2) * spacing  # it lies off its datum by half a spacing
    return Size(legs, spacing, side, side)


def _square_points(
    legs: int, spacing: float, length: float, along: float, across: float
) -> tuple[Array, Array]:
    reach, course = (np.arange(legs) // 2 + 1) * spacing, np.arange(legs) % 4
    steps = (
        reach * np.array(way)[course] for way in ((along, 0, -along, 0), (0, across, 0, -across))
    )
    ahead, aside = (np.concatenate([[0.0], np.cumsum(step)]) for step in steps)
    return ahead, aside


def _sector_size(track: Array, spacing: Array, ratio: Array) -> Size:
    """Return as many whole sector searches as come nearest to a radius, given as the spacing."""
    times = np.maximum(np.rint(track / (SEARCH * spacing)), 1)
    radius = track / (SEARCH * times)
    return Size(9 * times, radius, 2 * radius, 2 * radius)


def _sector_points(
    legs: int, spacing: float, length: float, along: float, across: float
) -> tuple[Array, Array]:
    """Return sectors: out along a radius, across by a chord and back, every search turned by 30
    degrees.
    """
    number = np.arange(legs // 3)
    out = np.radians(240.0 * (number % 3) + 30.0 * (number // 3))
    zero = np.zeros(len(out))
    ahead = (
        np.column_stack([np.cos(out), np.cos(out + math.pi / 3), zero]).ravel() * spacing * along
    )
    aside = (
        np.column_stack([np.sin(out), np.sin(out + math.pi / 3), zero]).ravel() * spacing * across
    )
    return np.concatenate([[0.0], ahead]), np.concatenate([[0.0], aside])


PATTERNS = {
    "parallel": Pattern("parallel sweep (PS)", _parallel_size, _parallel_points),
    "square": Pattern("expanding square (SS)", _square_size, _square_points),
    "sector": Pattern("sector search (VS)", _sector_size, _sector_points),
}


def ground(
    x: Array, y: Array, manner: Manner, start: float, duration: float, speed: float
) -> Array:
    """Return nodes over ground of legs through points of a frame.

    Args:
        x: east of the points when the frame is at its start [m], (k,).
        y: north of them [m], (k,).
        manner: whose frame drifts.
        start: when the legs begin [s], a whole second.
        duration: after which legs are cut off [s].
        speed: over ground [m/s], above that of the frame.

    Returns:
        Time [s], x, y [m], and 1 for a leg that searches, (n, 4). Times are whole seconds after the
        start, as in a case
        file: legs are up to half a second too long or short.
    """
    dx, dy = np.diff(x), np.diff(y)
    along = dx * manner.east + dy * manner.north
    rest = speed**2 - manner.east**2 - manner.north**2
    took = (along + np.sqrt(along**2 + (dx**2 + dy**2) * rest)) / rest  # |leg + frame t| = speed t
    elapsed = np.concatenate([[0.0], np.cumsum(took)])
    last = math.floor(duration)
    until = np.unique(np.rint(np.append(elapsed[elapsed < last], min(last, elapsed[-1]))))
    within = np.stack([np.interp(until, elapsed, v) for v in (x, y)])
    return np.column_stack(
        [
            start + until,
            within[0] + manner.east * until,
            within[1] + manner.north * until,
            np.ones(len(until)),
        ]
    )
