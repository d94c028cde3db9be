"""How many objects lie on each stretch of coast, and when they come: figures over simulated spills.

Works stretch by stretch in pieces of CELLS rows by time: memory does not grow with the number of stretches.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from drift.particles import weights
from drift.spill import estimate
from drift.spill.dataset import SHARES
from drift.spill.fates import Fates, Realisation
from geo.array import Array

CELLS = 2_000_000  # most rows (a stretch in a world) times output times that are worked on together

MEANS = ("expected", "probability", "arrived")


def settled(fates: Fates) -> dict[str, Array]:
    """Return release and end of every slot, and arrival and leave of every stay [s], without contradictions.

    "Not yet released" goes before "ended", and "ended" before "ashore": where two hold at a time, the first counts.
    """
    stays = fates.stays
    ended = np.maximum(fates.ended, fates.release)
    arrival = np.clip(stays.arrival, fates.release[stays.slot], ended[stays.slot])
    leave = np.clip(stays.leave, arrival, ended[stays.slot])
    return {"release": fates.release, "ended": ended, "arrival": arrival, "leave": leave}


@dataclass(frozen=True)
class Rows:
    """Stays of drawn objects (m,), sorted into rows, one for each stretch and world.

    Rows (r,) are sorted by stretch.
    """

    slot: Array
    row: Array
    arrival: Array  # [s after start]
    begin: Array  # index of the first output at which it lies there
    end: Array  # index of the first output at which it no longer does
    debut: Array  # whether it is the slot's first on the stretch
    segment: Array  # (r,)
    world: Array  # (r,)
    most: Array  # (r,) largest number of objects in the row in any realisation
    first: Array  # (s,) first row of each stretch
    times: int


def sorted_rows(fates: Fates, realisations: Sequence[Realisation], weight: Array, outputs: Array) -> Rows:
    """Return the stays of all drawn objects as rows.

    weight: of the worlds, (W,). outputs: times [s after start], (T,).
    """
    clean, stays = settled(fates), fates.stays
    drawn = np.zeros(len(fates.world), bool)
    for realisation in realisations:
        drawn |= realisation.stands > 0
    drawn &= weight[fates.world] > 0
    chosen = np.flatnonzero(drawn[stays.slot] & (clean["arrival"] < clean["leave"]))
    slot, segment, arrival = stays.slot[chosen], stays.segment[chosen].astype(np.int64), clean["arrival"][chosen]
    debut = np.zeros(len(chosen), bool)
    debut[np.unique(slot * (segment.max(initial=0) + 1) + segment, return_index=True)[1]] = True
    pair = segment * fates.worlds + fates.world[slot]
    order = np.lexsort((arrival, pair))
    chosen, slot, pair, arrival = chosen[order], slot[order], pair[order], arrival[order]
    pairs, heads, row = np.unique(pair, return_index=True, return_inverse=True)
    most = np.zeros(len(pairs), np.int64)
    for realisation in realisations if len(pairs) else ():
        most = np.maximum(most, np.add.reduceat(realisation.stands[slot].astype(np.int64), heads))
    segment = pairs // fates.worlds
    return Rows(
        slot=slot,
        row=row,
        arrival=arrival,
        begin=np.searchsorted(outputs, arrival),
        end=np.searchsorted(outputs, clean["leave"][chosen]),
        debut=debut[order],
        segment=segment,
        world=pairs % fates.worlds,
        most=most,
        first=np.unique(segment, return_index=True)[1],
        times=len(outputs),
    )


def runs(rows: Rows) -> Iterator[tuple[int, int]]:
    """Yield runs of stretches, from the first to before the second, that fit into CELLS.

    Each holds at least one stretch.
    """
    if not len(rows.first):
        return
    count = np.diff(np.append(rows.first, len(rows.segment)))
    size = rows.times * np.maximum(count, np.maximum.reduceat(rows.most, rows.first) + 1)
    begin, used = 0, 0
    for i, cells in enumerate(size.tolist()):
        if i > begin and used + cells > CELLS:
            yield begin, i
            begin, used = i, 0
        used += cells
    yield begin, len(size)


@dataclass(frozen=True)
class _Piece:
    """A run of stretches that is worked on together: its stays (m,), its rows (r,), its stretches (s,)."""

    rows: Rows
    stays: slice  # which of the rows' stays
    slot: Array  # (m,)
    row: Array  # (m,) counted from the piece's first
    start: Array  # (s,) first row of each stretch
    stretch: Array  # (r,) number of its stretch in the piece
    weight: Array  # (r,) of its world
    squares: float  # sum of squared weights of all worlds

    def lying(self, amount: Array, leaves: bool = True) -> Array:
        """Return how many objects lie there by row and time, int32 (r, T); amount: of each stay (m,).

        leaves: whether stays end; else those that ever lay there count.
        """
        times = self.rows.times
        change = np.zeros(self.weight.size * (times + 1), np.int32)
        np.add.at(change, self.row * (times + 1) + self.rows.begin[self.stays], amount)
        if leaves:
            np.subtract.at(change, self.row * (times + 1) + self.rows.end[self.stays], amount)
        return np.cumsum(change.reshape(-1, times + 1), axis=1, dtype=np.int32)[:, :-1]

    def mean(self, name: str, values: Array) -> dict[str, Array]:
        """Return the mean over worlds, (T, s), its error, and what `unseen` needs.

        values: by row and time, (r, T).
        """
        middle, error = estimate.mean(values, self.weight, self.start, self.squares)
        if name == "probability":
            error = np.maximum(error, estimate.least_error(middle, 1 / self.squares))
            return {name: middle.T, f"{name}_se": error.T}
        return {name: middle.T, f"{name}_se": error.T} | _hits(name, values, self.weight, self.start)


class _Histogram:
    """Weighted histograms of the number of objects that lie on each stretch at each time.

    Each stretch has as many classes as it needs; they are stored one after the other, so that a stretch with many
    objects does not cost the others memory.
    """

    def __init__(self, piece: _Piece, most: Array) -> None:
        """Begin without any spill; most: largest number in each row, (r,)."""
        self._piece, times = piece, piece.rows.times
        self._classes = np.maximum.reduceat(most, piece.start) + 1
        self._base = np.append(0, np.cumsum(self._classes * times))
        self._cell = self._base[piece.stretch][:, None] + np.arange(times) * self._classes[piece.stretch][:, None]
        self._weight = np.zeros(self._base[-1])

    def add(self, number: Array, share: float) -> None:
        """Count numbers by row and time (r, T); share: of the world's weight that they have."""
        filled = np.repeat(self._piece.weight * share, self._piece.rows.times)
        self._weight += np.bincount((self._cell + number).ravel(), filled, minlength=self._base[-1])

    def quantiles(self) -> dict[str, Array]:
        """Return the quantiles of the numbers, (SHARES, T, s), and their errors.

        Worlds of which nothing ever touches a stretch have the number 0 there.
        """
        piece, times = self._piece, self._piece.rows.times
        groups = (self._base[:-1, None] + np.arange(times) * self._classes[:, None]).ravel()
        self._weight[groups] += np.repeat(1 - np.add.reduceat(piece.weight, piece.start), times).clip(0)
        numbers = np.arange(self._base[-1]) - np.repeat(groups, np.repeat(self._classes, times))
        number, error = estimate.quantiles(numbers, self._weight, groups, SHARES, 1 / piece.squares)
        shape = (len(SHARES), len(piece.start), times)
        return {"number": number.reshape(shape).swapaxes(1, 2), "number_se": error.reshape(shape).swapaxes(1, 2)}


def _piece(rows: Rows, run: tuple[int, int], weight: Array) -> _Piece:
    """Return a run of stretches, from the first to before the second; weight: of the worlds, (W,)."""
    bounds = np.append(rows.first, len(rows.segment))
    low, high = bounds[run[0]], bounds[run[1]]
    stays = slice(*np.searchsorted(rows.row, (low, high)))
    start = rows.first[slice(*run)] - low
    stretch = np.repeat(np.arange(len(start)), np.diff(np.append(start, high - low)))
    squares = float(np.sum(weight**2))
    slot, row = rows.slot[stays], rows.row[stays] - low
    return _Piece(rows, stays, slot, row, start, stretch, weight[rows.world[low:high]], squares)


def figures(
    rows: Rows, run: tuple[int, int], fates: Fates, realisations: Sequence[Realisation], weight: Array, kinds: int
) -> dict[str, Array]:
    """Return the figures of a run of stretches; the last axis of each is the stretch."""
    piece = _piece(rows, run, weight)
    bounds = np.append(rows.first, len(rows.segment))
    histogram = _Histogram(piece, rows.most[bounds[run[0]] : bounds[run[1]]])
    share, debut, shape = 1 / len(realisations), rows.debut[piece.stays], (piece.weight.size, rows.times)
    sums = {name: np.zeros(shape, np.int32) for name in MEANS}
    by_kind = np.zeros((kinds, *shape), np.int32) if kinds > 1 else None
    firsts: list[tuple[Array, Array, Array]] = []
    for realisation in realisations:
        amount = realisation.stands[piece.slot]
        number = piece.lying(amount)
        sums["expected"] += number
        sums["probability"] += number > 0
        sums["arrived"] += piece.lying(np.where(debut, amount, 0), leaves=False)
        if by_kind is not None:
            for kind in range(kinds):
                by_kind[kind] += piece.lying(np.where(fates.kind[piece.slot] == kind, amount, 0))
        histogram.add(number, share)
        firsts.append(_arrivals(piece.row, rows.arrival[piece.stays], np.where(debut, amount, 0)))
    figures = histogram.quantiles()
    for name, values in sums.items():
        figures |= piece.mean(name, values * share)
    if by_kind is not None:
        each = [piece.mean("expected_by_kind", values * share) for values in by_kind]
        figures |= {name: np.array([kind[name] for kind in each]) for name in each[0]}
    else:
        figures |= {"expected_by_kind": figures["expected"][None], "expected_by_kind_se": figures["expected_se"][None]}
    return figures | _when(firsts, piece.weight * share, piece.stretch, piece.start, piece.squares)


def _hits(name: str, value: Array, weight: Array, start: Array) -> dict[str, Array]:
    """Return what estimate.unseen needs of the worlds whose values (rows, T) are not 0, each (T, stretches)."""
    w = weight[:, None]
    parts = {"hits": w * (value > 0), "count": (value > 0).astype(float), "square": w**3 * np.square(value)}
    return {f"{name}_{part}": np.add.reduceat(x, start).T for part, x in parts.items()}


def unseen(figures: dict[str, Array], weight: Array) -> dict[str, Array]:
    """Return standard errors of expected numbers that allow for worlds that were not seen.

    The results of `_hits` are taken out of the figures.
    """
    many, errors = weights.effective(weight), {}
    for name in [name.removesuffix("_hits") for name in figures if name.endswith("_hits")]:
        parts = [figures.pop(f"{name}_{part}") for part in ("hits", "count", "square")]
        shape = parts[0].shape
        hits, count, square = (part.reshape(-1, shape[-1]).T for part in parts)
        more = estimate.unseen(hits, count, square, many)
        errors[f"{name}_se"] = np.hypot(figures[f"{name}_se"], more.T.reshape(shape))
    if errors and "expected_by_kind_se" not in errors:
        errors["expected_by_kind_se"] = errors["expected_se"][None]
    return errors


def _arrivals(row: Array, arrival: Array, amount: Array) -> tuple[Array, Array, Array]:
    """Return the rows at which any object arrives, the time of the first arrival in each, and the median time.

    row: (m,) ascending; arrival: (m,) [s] ascending in each row; amount: (m,) objects, each arrives once.
    """
    there = np.flatnonzero(amount)
    row, arrival, amount = row[there], arrival[there], amount[there].astype(np.int64)
    rows, head = np.unique(row, return_index=True)
    running = np.cumsum(amount)
    before = running[head] - amount[head]
    last = np.append(running[head[1:] - 1], running[-1:]) - before - 1  # number of the row's last object, from 0
    middle = [arrival[np.searchsorted(running, before + which, side="right")] for which in (last // 2, (last + 1) // 2)]
    return rows, arrival[head].astype(np.float64), np.mean(middle, axis=0)


def _when(
    firsts: Sequence[tuple[Array, Array, Array]], weight: Array, stretch: Array, start: Array, squares: float
) -> dict[str, Array]:
    """Return when the first object and the bulk arrive [s after start], if any does, and how probable that is.

    firsts: of each realisation, see _arrivals; weight: of a row in each realisation.
    """
    row = np.concatenate([arrivals[0] for arrivals in firsts])
    any_comes = np.bincount(row, minlength=len(weight))[:, None] / len(firsts)
    ever, ever_se = estimate.mean(any_comes, weight * len(firsts), start, squares)
    ever_se = np.maximum(ever_se, estimate.least_error(ever, 1 / squares))
    mass = weight * any_comes[:, 0]
    # Weights are relative to the largest of each stretch: their squares may be too small for a float.
    size = np.diff(np.append(start, mass.size))
    part = mass / np.repeat(np.maximum(np.maximum.reduceat(mass, start), np.finfo(float).tiny), size)
    many = np.add.reduceat(part, start) ** 2 / np.maximum(np.add.reduceat(part**2, start), np.finfo(float).tiny)
    figures = {"ever": ever[:, 0], "ever_se": ever_se[:, 0], "effective_arrivals": many}
    for name, which in (("first_arrival", 1), ("bulk_arrival", 2)):
        value = np.concatenate([arrivals[which] for arrivals in firsts])
        order = np.lexsort((value, stretch[row]))
        head = np.searchsorted(stretch[row][order], np.arange(len(start)))
        figures[name], figures[f"{name}_se"] = estimate.quantiles(value[order], weight[row][order], head, SHARES, many)
    return figures
