"""Tracks cut into stretches of motion: thinned, without gaps, without times at anchor.

A step leads from one kept fix to the next. A stretch is a run of steps that all count.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drift.tracking.tracks import records
from drift.tracking.tracks.records import Track
from geo import notation, sphere
from geo.array import Array
from geo.box import Box
from geo.errors import UserError
from geo.notation import KNOT

FASTEST = 60 * KNOT  # [m/s] default of the highest believable speed
GAP = 24 * 3600.0  # [s] longest step if tracks are not thinned
LATE = 1.5  # longest step by default, as a multiple of the interval to which tracks are thinned
SOON = 0.5  # shortest step, as a share of that interval


@dataclass(frozen=True)
class Rules:
    """Which steps of tracks count.

    every: interval [s] to which tracks are thinned: each fix is followed by the one nearest to an
    interval later; None: all fixes are kept. gap: longest step that counts [s]; None: LATE times
    `every`, or GAP. slowest: speed between fixes [m/s] that a step must exceed. fastest: highest
    believable speed [m/s]. without: a box whose fixes are left out, and which no step spans.
    """

    every: float | None = None
    gap: float | None = None
    slowest: float = 0.0
    fastest: float = FASTEST
    without: Box | None = None

    @property
    def longest(self) -> float:
        """Longest step that counts [s]."""
        return self.gap or (GAP if self.every is None else LATE * self.every)


@dataclass(frozen=True)
class Stretch:
    """Fixes of a track joined by steps that count.

    time [s since 1970], lon, lat [rad], each (n,), with n at least 2.
    """

    name: str
    time: Array
    lon: Array
    lat: Array


@dataclass(frozen=True)
class Cut:
    """Stretches in the order of tracks, and notes on what was left out."""

    stretches: tuple[Stretch, ...]
    notes: tuple[str, ...]


def cut_tracks(tracks: Sequence[Track], rules: Rules) -> Cut:
    """Return the stretches of tracks, in the order of the tracks' first fixes.

    Raises UserError if no step is left.
    """
    believed = records.believed(tracks, rules.fastest, records.nowhere)
    counts = dict.fromkeys(("box", "long", "slow"), 0)
    stretches: list[Stretch] = []
    for track in sorted(believed.tracks, key=lambda track: float(track.time[0])):
        inside = _inside(track, rules.without)
        counts["box"] += int(inside.sum())
        begun = np.flatnonzero(np.diff(inside, prepend=True) & ~inside)
        for first in begun:
            last = first + int(np.argmax(np.append(inside[first:], True)))
            stretches += _moving(records.selected(track, np.arange(first, last)), rules, counts)
    notes = [*believed.notes]
    if counts["box"]:
        notes.append(f"{counted(counts['box'], 'fix', 'fixes')} left out in the box that was named")
    if counts["long"]:
        notes.append(
            f"{counted(counts['long'], 'step')} left out of more than {rules.longest / 3600:g} h"
        )
    if counts["slow"]:
        notes.append(
            f"{counted(counts['slow'], 'step')} left out of {rules.slowest / KNOT:.3g} kn or less"
        )
    if not stretches:
        raise UserError(
            f"tracks: no step from fix to fix is left{'; ' if notes else ''}{'; '.join(notes)}; see --every, --max-gap, "
            "--min-speed, --without"
        )
    return Cut(tuple(stretches), tuple(notes))


def _inside(track: Track, box: Box | None) -> Array:
    """Return which fixes are inside the box, shape (n,)."""
    if box is None:
        return np.zeros(track.time.size, bool)
    lon = sphere.east_of_degrees(track.lon, box.west)
    return np.asarray((lon <= box.east) & (box.south <= track.lat) & (track.lat <= box.north))


def _moving(track: Track, rules: Rules, counts: dict[str, int]) -> list[Stretch]:
    """Return the stretches of one run of fixes; counts: left-out steps by reason, updated."""
    kept = records.selected(track, _thinned(track.time, rules.every))
    lon, lat = np.radians(kept.lon), np.radians(kept.lat)
    step = np.diff(kept.time)
    speed = sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:]) / step
    long, slow = step > rules.longest, speed <= rules.slowest
    if rules.slowest <= 0:
        slow[:] = False
    counts["long"] += int(long.sum())
    counts["slow"] += int((slow & ~long).sum())
    pieces = np.split(np.arange(kept.time.size), 1 + np.flatnonzero(long | slow))
    return [
        Stretch(kept.name, kept.time[piece], lon[piece], lat[piece])
        for piece in pieces
        if piece.size > 1
    ]


def _thinned(time: Array, every: float | None) -> Array:
    """Return the indices of kept fixes: each is the one nearest to an interval after the last.

    Fixes that follow sooner than SOON of the interval are skipped.
    """
    if every is None:
        return np.arange(time.size)
    kept = [0]
    while True:
        now = time[kept[-1]]
        # Always advance, even if the interval is lost in rounding.
        after = max(int(np.searchsorted(time, now + every)), kept[-1] + 1)
        before = max(after - 1, kept[-1] + 1)
        near = [k for k in (before, after) if k < time.size and time[k] >= now + SOON * every]
        if not near:
            return np.array(kept)
        kept.append(min(near, key=lambda k: abs(float(time[k]) - now - every)))


def counted(number: int, one: str, many: str | None = None) -> str:
    """Return a number with its noun: 1 step, 2,310 steps."""
    return f"{number:,} {one if number == 1 else many or one + 's'}"


def told(rules: Rules) -> str:
    """Return a description of the rules."""
    words = ["all fixes" if rules.every is None else f"fixes every {rules.every / 3600:g} h"]
    words.append(f"steps of at most {rules.longest / 3600:g} h")
    if rules.slowest > 0:
        words.append(f"faster than {rules.slowest / KNOT:.3g} kn")
    if rules.without is not None:
        box = rules.without
        words.append(
            f"without {notation.position(box.west, box.south)} to {notation.position(box.east, box.north)}"
        )
    return ", ".join(words)
