"""Manner of a search: its pattern, and the frame in which the pattern is laid.

The frame is fixed to the ground or drifts at a constant velocity, like the cloud. The unit keeps
its search speed over ground. Patterns are those of the IAMSAR Manual, Vol. II, chapter 5.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geo.array import Array

SEARCH = 9.0  # track of a sector search in radii: three sectors, each out, across and back
FASTEST = 0.5  # greatest speed of a frame, as a share of the search speed


@dataclass(frozen=True)
class Manner:
    """A pattern, and the velocity over ground of its frame."""

    pattern: str = "parallel"  # an entry of PATTERNS
    east: float = 0.0  # [m/s]
    north: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether the frame drifts."""
        return self.east != 0 or self.north != 0

    @property
    def plain(self) -> bool:
        """Whether the pattern is parallel legs on the ground."""
        return self.pattern == "parallel" and not self.moves


PLAIN = Manner()


class Size(NamedTuple):
    """Size of patterns that use their whole track, shape (c,) each."""

    legs: Array
    spacing: Array  # [m]; of a sector search its radius
    length: Array  # [m]
    width: Array


@dataclass(frozen=True)
class Pattern:
    """A pattern: its name, its size and its points."""

    words: str  # name that crews use
    # returns the size for track [m], spacing [m] and ratio of length to width
    size: Callable[[Array, Array, Array], Size]
    # returns points (along, across) [m] for number of legs, spacing and length [m], and the corner
    # (along, across) where the pattern starts
    points: Callable[[int, float, float, float, float], tuple[Array, Array]]


def _parallel_size(track: Array, spacing: Array, ratio: Array) -> Size:
    """Return n legs of L - S and n - 1 cross legs of S: n L - S of track in total."""
    legs = np.maximum(np.rint(np.sqrt(track / (ratio * spacing))), 1)
    return Size(legs, spacing, (track + spacing) / legs, legs * spacing)


def _parallel_points(
    legs: int, spacing: float, length: float, along: float, across: float
) -> tuple[Array, Array]:
    """Return the ends of parallel legs."""
    half = (length - spacing) / 2
    ends = np.where(np.arange(legs) % 2 == 0, half, -half) * along
    aside = np.repeat((np.arange(legs) - (legs - 1) / 2) * -across * spacing, 2)
    return np.column_stack([ends, -ends]).ravel(), aside


def _square_size(track: Array, spacing: Array, ratio: Array) -> Size:
    """Return an expanding square with legs S, S, 2 S, 2 S, ..., the last one cut off."""
    # n legs are S ceil(n/2) (floor(n/2) + 1) long
    legs = np.maximum(np.ceil(2 * np.sqrt(track / spacing)), 1)
    side = (np.ceil(legs / 2) + 2) * spacing  # its centre is half a spacing off the datum
    return Size(legs, spacing, side, side)


def _square_points(
    legs: int, spacing: float, length: float, along: float, across: float
) -> tuple[Array, Array]:
    """Return the corners of an expanding square."""
    reach, course = (np.arange(legs) // 2 + 1) * spacing, np.arange(legs) % 4
    steps = (
        reach * np.array(way)[course] for way in ((along, 0, -along, 0), (0, across, 0, -across))
    )
    ahead, aside = (np.concatenate([[0.0], np.cumsum(step)]) for step in steps)
    return ahead, aside


def _sector_size(track: Array, spacing: Array, ratio: Array) -> Size:
    """Return whole sector searches with a radius near the one given as spacing."""
    times = np.maximum(np.rint(track / (SEARCH * spacing)), 1)
    radius = track / (SEARCH * times)
    return Size(9 * times, radius, 2 * radius, 2 * radius)


def _sector_points(
    legs: int, spacing: float, length: float, along: float, across: float
) -> tuple[Array, Array]:
    """Return the corners of sector searches.

    Each sector goes out along a radius, across by a chord and back. Each further search is turned
    by 30 degrees.
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
    """Return nodes over ground of legs through points of a drifting frame.

    Args:
        x: east of the points when the frame is at its start [m], shape (k,).
        y: north of them [m], shape (k,).
        manner: with the drift of the frame.
        start: begin of the legs [s], a whole second.
        duration: time after which legs are cut off [s].
        speed: over ground [m/s], above that of the frame.

    Returns:
        Time [s], x, y [m], and 1 for a leg that searches, shape (n, 4). Times are whole seconds
            after the start, as in a case file; legs are therefore up to half a second too long or
            short.
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
