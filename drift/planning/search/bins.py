"""Time bins of the effort bound, and the positions of particles in them.

Drifting particles keep their neighbours, so a bin holds one position of each, at the time at which
the cloud is densest. Steering particles stream past each other, through straits and along lanes. A
unit searching there meets many that are not in one place at the same time; but the dense places
last longer than the particles stay in them. A bin of steering particles therefore holds their
positions at several times (rows), and its boxes do not move. Bins are as long as possible without
clearly lower density: a passing convoy gets short bins.
"""

from dataclasses import dataclass

import numpy as np

from drift.planning.search import planning_tracks as record
from drift.planning.search import quadtree
from drift.planning.search.planning_tracks import Tracks
from geo import sphere
from geo.array import Array

BOXES = 160  # fewest boxes in a bin, if there are enough particles
FEWEST, MOST = 6, 24  # limits of the number of bins if all particles drift
# how far particles of a box may move apart in a bin, as a share of its side; MOST permitting
STRAIN = 0.5
TRIAL = 4096  # particles on which relative motion is measured
PLACES = 3_000_000  # most positions of steering particles in all rows; more would take minutes
FINEST = 60.0  # [s] shortest row
LONGEST = 8  # most rows in a bin
THICK = 32.0  # particles per box and row when the length of bins is decided
THINNER = 0.1  # largest fall of the mean log density in a longer bin


@dataclass(frozen=True)
class Bins:
    """Positions of particles (m) in each row (r) of each bin (b), on a plane."""

    edge: Array  # float64 [s since 1970] (r + 1,)
    first: Array  # int64 (b + 1,) first row of each bin
    x: Array  # float64 [m] (r, m)
    y: Array
    there: Array  # bool (r, m): the particle can be found in the row
    pace: Array  # float64 [m/s] (r, m) highest speed of the particle in the row
    # float64 [m] (b,) largest distance of any particle in a row of the bin from that position
    moved: Array


def of_drift(tracks: Tracks, plane: record.Plane) -> Bins:
    """Return bins as short as the particles' relative motion requires.

    Each bin takes the positions at the time at which the cloud is densest.
    """
    x, y = plane.flat(tracks.lon * sphere.UNIT, tracks.lat * sphere.UNIT)
    time, duration = tracks.time, np.diff(tracks.time)
    side, apart = _strain(tracks, x, y)
    # While sides grow from a to b, particles move apart by d, which is the integral of d / (a + (b
    # - a) s) sides.
    ratio = side[1:] / side[:-1]
    rise = np.where(
        np.abs(ratio - 1) > 1e-6, np.log(ratio) / np.where(ratio == 1, 1, ratio - 1), 1.0
    )
    strain = apart / side[:-1] * rise
    count = int(np.clip(np.ceil(strain.sum() / STRAIN), FEWEST, MOST))
    # keep bins short enough for the units' own times of search
    floor = STRAIN * FEWEST * duration / duration.sum()
    progress = np.concatenate([[0.0], np.cumsum(strain + floor)])
    goal = np.linspace(0, progress[-1], count + 1)[1:-1]
    k = np.clip(np.searchsorted(progress, goal, side="right") - 1, 0, len(duration) - 1)
    share = (goal - progress[k]) / (progress[k + 1] - progress[k])
    position = np.where(
        np.abs(ratio[k] - 1) > 1e-6,
        (ratio[k] ** share - 1) / np.where(ratio[k] == 1, 1, ratio[k] - 1),
        share,
    )
    edge = np.concatenate([time[:1], time[k] + position * duration[k], time[-1:]])
    speed = np.hypot(np.diff(x, axis=0), np.diff(y, axis=0)) / duration[:, None]
    x_at, y_at, pace = np.empty((3, len(edge) - 1, tracks.m))
    there, moved = np.zeros(pace.shape, bool), np.empty(len(pace))
    for t in range(len(edge) - 1):
        first = min(int(np.searchsorted(time, edge[t], side="right")) - 1, len(duration) - 1)
        last = max(int(np.searchsorted(time, edge[t + 1], side="left")), first + 1)
        times = np.concatenate([edge[t : t + 2], time[first + 1 : last]])
        densest = float(times[np.argmin(np.interp(times, time, side))])
        j = min(int(np.searchsorted(time, densest, side="right")) - 1, len(duration) - 1)
        part = (densest - time[j]) / duration[j]
        x_at[t], y_at[t] = (v[j] + part * (v[j + 1] - v[j]) for v in (x, y))
        there[t] = tracks.adrift[first : last + 1].any(axis=0)
        pace[t] = speed[first:last].max(axis=0)
        moved[t] = pace[t].max() * (edge[t + 1] - edge[t])
    return Bins(edge, np.arange(len(edge)), x_at, y_at, there, pace, moved)


def of_streams(tracks: Tracks, plane: record.Plane) -> Bins:
    """Return bins of one, two, four or LONGEST rows for steering particles."""
    time, span = tracks.time, float(tracks.time[-1] - tracks.time[0])
    rows = LONGEST * max(int(min(PLACES / tracks.m, span / FINEST)) // LONGEST, 1)
    edge = np.linspace(time[0], time[-1], rows + 1)
    x, y = plane.flat(tracks.lon * sphere.UNIT, tracks.lat * sphere.UNIT)
    speed = np.hypot(*record.velocity(tracks, plane, x, y))
    (x_at, y_at), (x_edge, y_edge) = (
        _places(tracks, x, y, at) for at in ((edge[1:] + edge[:-1]) / 2, edge)
    )
    pace, there = np.empty(x_at.shape), np.empty(x_at.shape, bool)
    for r in range(rows):
        begin = min(int(np.searchsorted(time, edge[r], side="right")) - 1, len(time) - 2)
        end = max(int(np.searchsorted(time, edge[r + 1], side="left")), begin + 1)
        pace[r], there[r] = speed[begin:end].max(axis=0), tracks.adrift[begin : end + 1].any(axis=0)
    first = _joined(x_at, y_at, there, _few(tracks))
    moved = np.hypot(np.diff(x_edge, axis=0), np.diff(y_edge, axis=0)).max(axis=1)
    return Bins(edge, first, x_at, y_at, there, pace, np.maximum.reduceat(moved, first[:-1]))


def _places(tracks: Tracks, x: Array, y: Array, at: Array) -> tuple[Array, Array]:
    """Return positions (x, y) [m] at times [s since 1970], interpolated, shape (k, m)."""
    k = np.clip(np.searchsorted(tracks.time, at, side="right") - 1, 0, tracks.bins - 1)
    share = ((at - tracks.time[k]) / (tracks.time[k + 1] - tracks.time[k]))[:, None]
    return x[k] * (1 - share) + x[k + 1] * share, y[k] * (1 - share) + y[k + 1] * share


def _joined(x: Array, y: Array, there: Array, some: Array) -> Array:
    """Return the first row of each bin, shape (b + 1,).

    Rows are joined as long as density hardly falls; it is measured on the particles `some`.
    """
    x, y, there = (v[:, some] for v in (x, y, there))

    def density(first: int, rows: int) -> float:
        """Return the mean log density in fixed boxes over some rows, times particles and rows."""
        these = slice(first, first + rows)
        present = there[these]
        if not present.any():
            return 0.0
        boxes = quadtree.halved(x[these][present], y[these][present], THICK, THICK, rows, 1.0)
        count = np.bincount(boxes.of)
        # n evenly spread points span less than their box
        extent = boxes.sides * ((count + 1) / np.maximum(count - 1, 1))[:, None]
        return float(count @ np.log(count / np.maximum(np.prod(extent, axis=1), 1.0) / rows))

    bins = [(r, 1, density(r, 1)) for r in range(len(x))]
    length = 1
    while length < LONGEST:
        length *= 2
        joined = []
        while bins:
            here = bins.pop(0)
            if bins and here[0] % length == 0 and here[1] == bins[0][1] == length // 2:
                finest = here[2] + bins[0][2]
                if (
                    density(here[0], length)
                    >= finest - THINNER * there[here[0] : here[0] + length].sum()
                ):
                    here = (here[0], length, finest)
                    bins.pop(0)
            joined.append(here)
        bins = joined
    return np.array([first for first, _, _ in bins] + [len(x)])


def _strain(tracks: Tracks, x: Array, y: Array) -> tuple[Array, Array]:
    """Return the mean box side at each time, and how far particles then move apart [m]."""
    sample = _few(tracks)
    side, apart = np.empty(len(x)), np.empty(len(x) - 1)
    for t in range(len(x)):
        box_of, side[t] = _sides(x[t, sample], y[t, sample])
        if t < len(x) - 1:
            apart[t] = _apart(box_of, *(v[t + 1, sample] - v[t, sample] for v in (x, y)))
    return side, apart


def _few(tracks: Tracks) -> Array:
    """Return indices of particles, sampled by weight, on which relative motion is measured."""
    tick = np.cumsum(tracks.weight)
    sample = np.minimum(
        np.searchsorted(tick, (np.arange(TRIAL) + 0.5) / TRIAL * tick[-1]), tracks.m - 1
    )
    return np.unique(sample)


def _sides(x: Array, y: Array) -> tuple[Array, float]:
    """Return the box of each particle at one time, shape (n,), and the mean side [m]."""
    boxes = quadtree.grow(x, y, np.ones(len(x)), max(len(x) / BOXES, 8.0))
    count = np.bincount(boxes.of)
    return boxes.of, float(np.sqrt(max(len(x) / np.sum(count / np.maximum(boxes.area, 1.0)), 1.0)))


def _apart(box_of: Array, *displacements: Array) -> float:
    """Return how far [m] particles of one box move apart: the deviation within boxes."""
    count, total = np.bincount(box_of), 0.0
    for displacement in displacements:
        residual = displacement - (np.bincount(box_of, displacement) / count)[box_of]
        total += float(residual @ residual) / len(box_of)
    return float(np.sqrt(total / 2))
