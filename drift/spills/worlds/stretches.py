"""Number of objects on each stretch of coast over time, and arrival times, over simulated spills.

The objects of each world on each stretch are counted part by part of the worlds, as integers, into
a file. Figures are then computed for runs of stretches of at most CELLS rows by time. So memory
grows neither with the number of particles nor with that of stretches.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from drift.engine.motion.spool import ShardFile
from drift.engine.particles import weights
from drift.spills.worlds import estimate
from drift.spills.worlds.fates import FOREVER, Fates, Realisation
from drift.spills.worlds.products.dataset import SHARES
from geo.array import Array

CELLS = 2_000_000  # most rows (a stretch in a world) times output times in memory at once

MEANS = ("expected", "probability", "arrived")


def consistent_times(fates: Fates) -> dict[str, Array]:
    """Return consistent times of all slots and stays [s]: release, ended, arrival and leave.

    "Not yet released" has priority over "ended", and "ended" over "ashore".
    """
    stays = fates.stays
    ended = np.maximum(fates.ended, fates.release)
    arrival = np.clip(stays.arrival, fates.release[stays.slot], ended[stays.slot])
    leave = np.clip(stays.leave, arrival, ended[stays.slot])
    return {"release": fates.release, "ended": ended, "arrival": arrival, "leave": leave}


@dataclass(frozen=True)
class _Rows:
    """Objects of some worlds on stretches: a row by stretch and world, sorted by both.

    Shapes are (r,), (realisations, r) for times, and (.., r, T) for numbers by output time.
    """

    segment: Array
    world: Array
    most: Array  # largest number of objects in the row in any realisation
    lying: Array  # (realisations, r, T) objects that lie there
    arrived: Array  # (1, r, T) objects that ever lay there, summed over realisations
    # (kinds, r, T) objects that lie there by class, summed over realisations; empty for one class
    by_kind: Array
    first: Array  # arrival of the first object [s after start]; FOREVER: none arrives
    before: Array  # arrival of the last object of the first half
    after: Array  # arrival of the first object of the second half; for an odd number that before


class Table:
    """The rows of all worlds, in a file, to which they are added part by part."""

    def __init__(self, file: ShardFile, realisations: int, times: int, kinds: int) -> None:
        """Create an empty table."""
        self._file, self._times, self._realisations = file, times, realisations
        self._kinds = kinds if kinds > 1 else 0
        # For each part: its stretches; their first rows, followed by the number of all rows; and
        # the largest number of objects in a row of each.
        self._parts: list[tuple[Array, Array, Array]] = []

    @property
    def _width(self) -> int:
        return 3 + (self._realisations + 1 + self._kinds) * self._times + 3 * self._realisations

    def add(
        self, fates: Fates, realisations: Sequence[Realisation], weight: Array, outputs: Array
    ) -> None:
        """Add the rows of some worlds.

        weight: of all worlds, (W,). outputs: output times [s after start], (T,).
        """
        rows = _count_objects(fates, realisations, weight, outputs, self._kinds)
        segment, first = np.unique(rows.segment, return_index=True)
        bounds = np.append(first, rows.segment.size)
        most = np.maximum.reduceat(rows.most, first) if first.size else first
        columns = [np.stack([rows.segment, rows.world, rows.most], axis=1)]
        columns += [number for of in (rows.lying, rows.arrived, rows.by_kind) for number in of]
        columns += [np.stack([*rows.first, *rows.before, *rows.after], axis=1)]
        self._file.note(
            f"{len(self._parts)}", np.concatenate(columns, axis=1).astype(np.int32).ravel()
        )
        self._parts.append((segment, bounds, most))

    def pieces(self) -> Iterator[_Rows]:
        """Yield the rows of runs of stretches that fit into CELLS, at least one stretch each."""
        touched = np.unique(np.concatenate([segment for segment, _, _ in self._parts]))
        rows, largest = np.zeros((2, touched.size), np.int64)
        for segment, bounds, most in self._parts:
            which = np.searchsorted(touched, segment)
            rows[which] += np.diff(bounds)
            largest[which] = np.maximum(largest[which], most)
        for begin, end in _runs_of_stretches(
            (self._times * np.maximum(rows, largest + 1)).tolist()
        ):
            yield self._read(touched[begin], touched[end - 1])

    def _read(self, first: int, last: int) -> _Rows:
        """Return the rows of the stretches from number `first` to `last`."""
        parts = []
        for number, (segment, bounds, _) in enumerate(self._parts):
            begin, end = (
                bounds[np.searchsorted(segment, first)],
                bounds[np.searchsorted(segment, last, "right")],
            )
            parts.append(
                self._file.noted(f"{number}", begin * self._width, end * self._width).reshape(
                    -1, self._width
                )
            )
        every = np.concatenate(parts)
        every = every[np.argsort(every[:, 0], kind="stable")]  # worlds are in their order
        r, sizes = (
            len(every),
            (3, self._realisations * self._times, self._times, self._kinds * self._times),
        )
        head, lying, arrived, by_kind, when = np.split(every, np.cumsum(sizes), axis=1)
        numbers = [x.reshape(r, -1, self._times).swapaxes(0, 1) for x in (lying, arrived, by_kind)]
        return _Rows(*head.T, *numbers, *when.T.reshape(3, self._realisations, r))


def _count_objects(
    fates: Fates, realisations: Sequence[Realisation], weight: Array, outputs: Array, kinds: int
) -> _Rows:
    """Return the rows of some worlds; kinds: number of classes that are counted separately."""
    times_of_stays, stays, times = consistent_times(fates), fates.stays, len(outputs)
    in_spill = np.zeros(len(fates.world), bool)
    for realisation in realisations:
        in_spill |= realisation.stands > 0
    in_spill &= weight[fates.world] > 0
    chosen = np.flatnonzero(
        in_spill[stays.slot] & (times_of_stays["arrival"] < times_of_stays["leave"])
    )
    slot, segment, arrival = (
        stays.slot[chosen],
        stays.segment[chosen].astype(np.int64),
        times_of_stays["arrival"][chosen],
    )
    first_stay = np.zeros(len(chosen), bool)
    visit = slot * (segment.max(initial=0) + 1) + segment
    first_stay[np.unique(visit, return_index=True)[1]] = True
    pair = segment * fates.worlds + fates.world[slot]
    order = np.lexsort((arrival, pair))
    chosen, slot, pair, arrival, first_stay = (
        chosen[order],
        slot[order],
        pair[order],
        arrival[order],
        first_stay[order],
    )
    pairs, row = np.unique(pair, return_inverse=True)
    r, begin, end = (
        len(pairs),
        np.searchsorted(outputs, arrival),
        np.searchsorted(outputs, times_of_stays["leave"][chosen]),
    )

    def lying(amount: Array, leaves: bool = True) -> Array:
        """Return the objects that lie there by row and time, int32 (r, T); amount: by stay (m,).

        If `leaves` is false, stays do not end: all objects that ever lay there count.
        """
        change = np.zeros(r * (times + 1), np.int32)
        np.add.at(change, row * (times + 1) + begin, amount)
        if leaves:
            np.subtract.at(change, row * (times + 1) + end, amount)
        return np.cumsum(change.reshape(-1, times + 1), axis=1, dtype=np.int32)[:, :-1]

    amounts = [realisation.stands[slot] for realisation in realisations]
    total = np.sum(amounts, axis=0, dtype=np.int32)
    of_kind = [lying(np.where(fates.kind[slot] == kind, total, 0)) for kind in range(kinds)]
    when = [
        _arrivals_by_row(row, r, arrival, np.where(first_stay, amount, 0)) for amount in amounts
    ]
    return _Rows(
        segment=pairs // fates.worlds,
        world=pairs % fates.worlds,
        most=np.max([np.bincount(row, amount, r) for amount in amounts], axis=0).astype(np.int64),
        lying=np.array([lying(amount) for amount in amounts]),
        arrived=lying(np.where(first_stay, total, 0), leaves=False)[None],
        by_kind=np.reshape(of_kind, (kinds, r, times)),
        first=np.array([one[0] for one in when]),
        before=np.array([one[1] for one in when]),
        after=np.array([one[2] for one in when]),
    )


def _runs_of_stretches(sizes: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Yield runs of stretches that fit into CELLS, from the first to before the second number.

    Each holds at least one stretch.
    """
    begin, used = 0, 0
    for i, cells in enumerate(sizes):
        if i > begin and used + cells > CELLS:
            yield begin, i
            begin, used = i, 0
        used += cells
    if sizes:
        yield begin, len(sizes)


@dataclass(frozen=True)
class _Piece:
    """A run of stretches whose figures are computed together: its rows (r,), its stretches (s,)."""

    times: int
    start: Array  # (s,) first row of each stretch
    stretch: Array  # (r,) index of the row's stretch in the piece
    weight: Array  # (r,) weight of the row's world
    squares: float  # sum of squared weights of all worlds

    def mean(self, name: str, values: Array) -> dict[str, Array]:
        """Return the mean over worlds, (T, s), its standard error, and the sums for `unseen`.

        values: by row and time, (r, T).
        """
        middle, error = estimate.mean(values, self.weight, self.start, self.squares)
        if name == "probability":
            error = np.maximum(error, estimate.least_error(middle, 1 / self.squares))
            return {name: middle.T, f"{name}_se": error.T}
        return {name: middle.T, f"{name}_se": error.T} | _unseen_sums(
            name, values, self.weight, self.start
        )


class _Histogram:
    """Weighted histograms of the number of objects on each stretch at each time.

    Each stretch has as many bins as it needs, stored one stretch after the other, so that a stretch
    with many objects does not cost the others memory.
    """

    def __init__(self, piece: _Piece, most: Array) -> None:
        """Create empty histograms; most: largest number in each row, (r,)."""
        self._piece, times = piece, piece.times
        self._bins = np.maximum.reduceat(most, piece.start) + 1
        self._base = np.append(0, np.cumsum(self._bins * times))
        self._cell = (
            self._base[piece.stretch][:, None]
            + np.arange(times) * self._bins[piece.stretch][:, None]
        )
        self._weight = np.zeros(self._base[-1])

    def add(self, number: Array, share: float) -> None:
        """Add numbers by row and time (r, T); share: of the world's weight that they have."""
        filled = np.repeat(self._piece.weight * share, self._piece.times)
        self._weight += np.bincount((self._cell + number).ravel(), filled, minlength=self._base[-1])

    def quantiles(self) -> dict[str, Array]:
        """Return the quantiles of the numbers, (SHARES, T, s), and their standard errors.

        Worlds without any object that touches a stretch count as 0 there.
        """
        piece, times = self._piece, self._piece.times
        groups = (self._base[:-1, None] + np.arange(times) * self._bins[:, None]).ravel()
        self._weight[groups] += np.repeat(
            1 - np.add.reduceat(piece.weight, piece.start), times
        ).clip(0)
        numbers = np.arange(self._base[-1]) - np.repeat(groups, np.repeat(self._bins, times))
        number, error = estimate.quantiles(numbers, self._weight, groups, SHARES, 1 / piece.squares)
        shape = (len(SHARES), len(piece.start), times)
        return {
            "number": number.reshape(shape).swapaxes(1, 2),
            "number_se": error.reshape(shape).swapaxes(1, 2),
        }


def figures(rows: _Rows, weight: Array) -> dict[str, Array]:
    """Return the figures of a run of stretches; the last axis of each is the stretch.

    weight: of the worlds, (W,).
    """
    start = np.unique(rows.segment, return_index=True)[1]
    stretch = np.repeat(np.arange(len(start)), np.diff(np.append(start, len(rows.segment))))
    piece = _Piece(
        rows.lying.shape[-1], start, stretch, weight[rows.world], float(np.sum(weight**2))
    )
    histogram, share = _Histogram(piece, rows.most.astype(np.int64)), 1 / len(rows.lying)
    for number in rows.lying:
        histogram.add(number, share)
    sums = {
        "expected": rows.lying.sum(axis=0, dtype=np.int32),
        "probability": (rows.lying > 0).sum(axis=0, dtype=np.int32),
        "arrived": rows.arrived[0],
    }
    figures = {"segment": rows.segment[start].astype(np.int64)} | histogram.quantiles()
    for name, values in sums.items():
        figures |= piece.mean(name, values * share)
    if len(rows.by_kind):
        each = [piece.mean("expected_by_kind", values * share) for values in rows.by_kind]
        figures |= {name: np.array([kind[name] for kind in each]) for name in each[0]}
    else:
        figures |= {
            "expected_by_kind": figures["expected"][None],
            "expected_by_kind_se": figures["expected_se"][None],
        }
    return figures | _arrival_figures(rows, piece.weight * share, stretch, start, piece.squares)


def _unseen_sums(name: str, value: Array, weight: Array, start: Array) -> dict[str, Array]:
    """Return the sums for estimate.unseen over worlds with a value above 0, each (T, stretches).

    value: (rows, T).
    """
    w = weight[:, None]
    parts = {
        "hits": w * (value > 0),
        "count": (value > 0).astype(float),
        "square": w**3 * np.square(value),
    }
    return {f"{name}_{part}": np.add.reduceat(x, start).T for part, x in parts.items()}


def unseen_errors(figures: dict[str, Array], weight: Array) -> dict[str, Array]:
    """Return standard errors of expected numbers that allow for unseen kinds of worlds.

    This removes the results of `_unseen_sums` from the figures.
    """
    effective_worlds, errors = weights.effective(weight), {}
    for name in [name.removesuffix("_hits") for name in figures if name.endswith("_hits")]:
        parts = [figures.pop(f"{name}_{part}") for part in ("hits", "count", "square")]
        shape = parts[0].shape
        hits, count, square = (part.reshape(-1, shape[-1]).T for part in parts)
        more = estimate.unseen(hits, count, square, effective_worlds)
        errors[f"{name}_se"] = np.hypot(figures[f"{name}_se"], more.T.reshape(shape))
    if errors and "expected_by_kind_se" not in errors:
        errors["expected_by_kind_se"] = errors["expected_se"][None]
    return errors


def _arrivals_by_row(
    row: Array, many: int, arrival: Array, amount: Array
) -> tuple[Array, Array, Array]:
    """Return arrival times by row, int32 (many,): first object, and the two around the median.

    They are FOREVER if no object arrives. row: (m,) ascending; arrival: (m,) [s] ascending in each
    row; amount: (m,) objects, each of which arrives once.
    """
    there = np.flatnonzero(amount)
    row, arrival, amount = row[there], arrival[there], amount[there].astype(np.int64)
    rows, head = np.unique(row, return_index=True)
    running = np.cumsum(amount)
    before = running[head] - amount[head]
    # index of the row's last object
    last = np.append(running[head[1:] - 1], running[-1:]) - before - 1
    middle = [
        arrival[np.searchsorted(running, before + which, side="right")]
        for which in (last // 2, (last + 1) // 2)
    ]
    when = np.full((3, many), FOREVER, np.int32)
    when[:, rows] = arrival[head], *middle
    return when[0], when[1], when[2]


def _arrival_figures(
    rows: _Rows, weight: Array, stretch: Array, start: Array, squares: float
) -> dict[str, Array]:
    """Return quantiles of the arrival of the first object and of the bulk, given any arrival.

    They are in [s after start], with the probability of any arrival. weight: of a row in each
    realisation.
    """
    which, row = np.nonzero(rows.first != FOREVER)  # realisation after realisation
    when = {
        "first_arrival": rows.first[which, row].astype(np.float64),
        "bulk_arrival": np.mean([rows.before[which, row], rows.after[which, row]], axis=0),
    }
    any_comes = np.bincount(row, minlength=len(weight))[:, None] / len(rows.first)
    ever, ever_se = estimate.mean(any_comes, weight * len(rows.first), start, squares)
    ever_se = np.maximum(ever_se, estimate.least_error(ever, 1 / squares))
    mass = weight * any_comes[:, 0]
    # Scale weights by the largest of each stretch: otherwise their squares could underflow.
    size = np.diff(np.append(start, mass.size))
    part = mass / np.repeat(
        np.maximum(np.maximum.reduceat(mass, start), np.finfo(float).tiny), size
    )
    effective_arrivals = np.add.reduceat(part, start) ** 2 / np.maximum(
        np.add.reduceat(part**2, start), np.finfo(float).tiny
    )
    figures = {
        "ever": ever[:, 0],
        "ever_se": ever_se[:, 0],
        "effective_arrivals": effective_arrivals,
    }
    for name, value in when.items():
        order = np.lexsort((value, stretch[row]))
        head = np.searchsorted(stretch[row][order], np.arange(len(start)))
        figures[name], figures[f"{name}_se"] = estimate.quantiles(
            value[order], weight[row][order], head, SHARES, effective_arrivals
        )
    return figures
