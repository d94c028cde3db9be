"""Fates of a spill's objects -> what a responder reads: how many come ashore on each stretch of coast, and when.

Every world of every realisation is one complete simulated spill: N whole objects. Figures are means and quantiles over
these, weighted; standard errors are over worlds (see drift.spill.estimate). An object lies on a stretch at a time if a stay
of it contains the time; one that refloats counts where it lies, and has arrived wherever it ever lay. What was
destroyed or found is in the account at all times, as if gone from the beginning, and on no stretch.

Works stretch by stretch in pieces of CELLS rows by time: memory does not grow with the number of stretches.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from drift.motion import weights
from drift.motion.status import Status
from drift.spill import dataset as washup_dataset
from drift.spill import estimate
from drift.spill.dataset import SHARES
from drift.spill.fates import Fates, Realisation
from geo.cells import Array
from geo.coast.segments import Segments

CELLS = 2_000_000  # rows (a stretch of a world) by output time that are worked on together
MEANS = ("expected", "probability", "arrived")


def build(
    fates: Fates,
    segments: Segments,
    realisations: Sequence[Realisation],
    weight: Array,
    outputs: Array,
    start: np.datetime64,
    kinds: Sequence[str] = ("object",),
) -> xr.Dataset:
    """Return the washup of every stretch that an object of any realisation touches, by time, and the account.

    weight: of the worlds, float64 (W,), adds up to 1. outputs: int (T,) [s after start], ascending. start: of the run,
    UTC. kinds: names of the classes of objects, in order of their numbers.
    """
    weight, outputs = np.asarray(weight, np.float64), np.asarray(outputs, np.int64)
    rows = _rows(fates, realisations, weight, outputs)
    parts = [_stretches(rows, piece, fates, realisations, weight, outputs, len(kinds)) for piece in _pieces(rows)]
    found = {name: np.concatenate([part[name] for part in parts], axis=-1) for name in parts[0]} if parts else {}
    found |= _unseen(found, weight)
    found |= _account(fates, realisations, weight, outputs)
    touched = rows.segment[rows.first]
    return washup_dataset.build(found, segments, touched, weight, len(realisations), outputs, start, kinds)


def worst(data: xr.Dataset, count: int | None = None, time: int = -1) -> Array:
    """Return the indices of the stretches with the largest expected numbers at a time, worst first; at most `count`.

    Where equally many lie there, the one at which more ever arrived comes first.
    """
    at = data.isel(time=time)
    return np.lexsort((-at["arrived"].values, -at["expected"].values))[:count]


def account(fates: Fates, realisation: Realisation, outputs: Array) -> Array:
    """Return how many of each world's objects have each of washup_dataset.FATES at each time, int64 (W, T, 7); adds up to N."""
    stands = realisation.stands
    when = {name: np.searchsorted(outputs, values) for name, values in _clean(fates).items()}

    def by_world(world: Array, at: Array, amount: Array) -> Array:
        """Sum of amounts by world up to each time."""
        sums = np.zeros((fates.worlds, len(outputs) + 1), np.int64)
        np.add.at(sums, (world, at), amount)
        return np.cumsum(sums, axis=1)[:, :-1]

    lain, world = stands[fates.stays.slot], fates.world[fates.stays.slot]
    ashore = by_world(world, when["arrival"], lain) - by_world(world, when["leave"], lain)
    released = by_world(fates.world, when["release"], stands)
    sunk = by_world(fates.world, when["ended"], np.where(fates.ending == Status.SUNK, stands, 0))
    gone = by_world(fates.world, when["ended"], np.where(fates.ending == Status.SUNK, 0, stands))
    every = np.zeros(fates.worlds, np.int64)
    np.add.at(every, fates.world, stands)
    lost = [np.repeat(values[:, None], len(outputs), axis=1) for values in (realisation.destroyed, realisation.found)]
    return np.stack(
        [every[:, None] - released, released - ashore - sunk - gone, ashore, sunk, gone, *lost], axis=-1
    ).astype(np.int64)


def _clean(fates: Fates) -> dict[str, Array]:
    """Return release and end of every slot, arrival and leave of every stay [s] in which each comes before the next.

    Not yet released goes before ended, and ended before ashore: of two that hold at a time, the former does.
    """
    stays = fates.stays
    ended = np.maximum(fates.ended, fates.release)
    arrival = np.clip(stays.arrival, fates.release[stays.slot], ended[stays.slot])
    leave = np.clip(stays.leave, arrival, ended[stays.slot])
    return {"release": fates.release, "ended": ended, "arrival": arrival, "leave": leave}


@dataclass(frozen=True)
class _Rows:
    """Stays of drawn objects (m,), sorted into rows, one a stretch and world; rows (r,) sorted by stretch."""

    slot: Array
    row: Array
    arrival: Array  # [s after start]
    begin: Array  # index of the first output at which it lies there
    end: Array  # and of the first at which it no longer does
    debut: Array  # whether it is the slot's first on the stretch
    segment: Array  # (r,)
    world: Array  # (r,)
    most: Array  # (r,) no realisation has more objects in the row
    first: Array  # (s,) first row of each stretch
    times: int


def _rows(fates: Fates, realisations: Sequence[Realisation], weight: Array, outputs: Array) -> _Rows:
    clean, stays = _clean(fates), fates.stays
    drawn = np.zeros(len(fates.world), bool)
    for one in realisations:
        drawn |= one.stands > 0
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
    for one in realisations if len(pairs) else ():
        most = np.maximum(most, np.add.reduceat(one.stands[slot].astype(np.int64), heads))
    segment = pairs // fates.worlds
    return _Rows(
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


def _pieces(rows: _Rows) -> Iterator[tuple[int, int]]:
    """Yield runs of stretches, from the first to before the second, that fit into CELLS, or that are but one."""
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


def _stretches(
    rows: _Rows,
    piece: tuple[int, int],
    fates: Fates,
    realisations: Sequence[Realisation],
    weight: Array,
    outputs: Array,
    kinds: int,
) -> dict[str, Array]:
    """Return the figures of a run of stretches; the last axis of each is the stretch."""
    bounds = np.append(rows.first, len(rows.segment))
    low, high = bounds[piece[0]], bounds[piece[1]]
    stays = slice(*np.searchsorted(rows.row, (low, high)))
    slot, row, times = rows.slot[stays], rows.row[stays] - low, rows.times
    start = rows.first[slice(*piece)] - low  # first row of each stretch
    stretch = np.repeat(np.arange(len(start)), np.diff(np.append(start, high - low)))  # of each row
    w = weight[rows.world[low:high]]
    squares, share = float(np.sum(weight**2)), 1 / len(realisations)

    def lying(amount: Array, leaves: bool = True) -> Array:
        """Return the number by row and time, int32 (rows, times), of stays that stand for these amounts."""
        change = np.zeros((high - low) * (times + 1), np.int32)
        np.add.at(change, row * (times + 1) + rows.begin[stays], amount)
        if leaves:
            np.subtract.at(change, row * (times + 1) + rows.end[stays], amount)
        return np.cumsum(change.reshape(-1, times + 1), axis=1, dtype=np.int32)[:, :-1]

    # A histogram of the number for each stretch and time, one after the other, of as many classes as the stretch needs
    classes = np.maximum.reduceat(rows.most[low:high], start) + 1
    base = np.append(0, np.cumsum(classes * times))
    histogram = np.zeros(base[-1])
    cell = base[stretch][:, None] + np.arange(times) * classes[stretch][:, None]
    sums = {name: np.zeros((high - low, times), np.int32) for name in MEANS}
    by_kind = np.zeros((kinds, high - low, times), np.int32) if kinds > 1 else None
    firsts: list[tuple[Array, Array, Array]] = []
    for one in realisations:
        amount = one.stands[slot]
        number = lying(amount)
        sums["expected"] += number
        sums["probability"] += number > 0
        sums["arrived"] += lying(np.where(rows.debut[stays], amount, 0), leaves=False)
        if by_kind is not None:
            for kind in range(kinds):
                by_kind[kind] += lying(np.where(fates.kind[slot] == kind, amount, 0))
        filled = np.repeat(w * share, times)
        histogram += np.bincount((cell + number).ravel(), filled, minlength=base[-1])
        firsts.append(_arrivals(row, rows.arrival[stays], np.where(rows.debut[stays], amount, 0)))
    groups = (base[:-1, None] + np.arange(times) * classes[:, None]).ravel()
    histogram[groups] += np.repeat(1 - np.add.reduceat(w, start), times).clip(0)  # worlds that never touch the stretch
    numbers = np.arange(base[-1]) - np.repeat(groups, np.repeat(classes, times))
    number, error = estimate.quantiles(numbers, histogram, groups, SHARES, 1 / squares)
    shape = (len(SHARES), len(start), times)
    found = {
        "number": number.reshape(shape).swapaxes(1, 2),
        "number_se": error.reshape(shape).swapaxes(1, 2),
    }
    for name, values in sums.items():
        middle, error = estimate.mean(values * share, w, start, squares)
        if name != "probability":
            found |= _hits(name, values * share, w, start)
        if name == "probability":
            error = np.maximum(error, estimate.least_error(middle, 1 / squares))
        found |= {name: middle.T, f"{name}_se": error.T}
    if by_kind is not None:
        each = [estimate.mean(values * share, w, start, squares) for values in by_kind]
        some = [_hits("expected_by_kind", values * share, w, start) for values in by_kind]
        found |= {name: np.array([one[name] for one in some]) for name in some[0]}
        found |= {
            "expected_by_kind": np.array([middle.T for middle, _ in each]),
            "expected_by_kind_se": np.array([error.T for _, error in each]),
        }
    else:
        found |= {"expected_by_kind": found["expected"][None], "expected_by_kind_se": found["expected_se"][None]}
    return found | _when(firsts, w * share, stretch, start, squares)


def _hits(name: str, value: Array, weight: Array, start: Array) -> dict[str, Array]:
    """Return of the worlds whose values (rows, T) are not 0 what estimate.unseen takes, each (T, stretches)."""
    w = weight[:, None]
    parts = {"hits": w * (value > 0), "count": (value > 0).astype(float), "square": w**3 * np.square(value)}
    return {f"{name}_{part}": np.add.reduceat(x, start).T for part, x in parts.items()}


def _unseen(found: dict[str, Array], weight: Array) -> dict[str, Array]:
    """Return standard errors of expected numbers with what worlds that were not seen leave open; takes what _hits made out."""
    many, made = weights.effective(weight), {}
    for name in [name.removesuffix("_hits") for name in found if name.endswith("_hits")]:
        parts = [found.pop(f"{name}_{part}") for part in ("hits", "count", "square")]
        shape = parts[0].shape
        hits, count, square = (part.reshape(-1, shape[-1]).T for part in parts)
        more = estimate.unseen(hits, count, square, many)
        made[f"{name}_se"] = np.hypot(found[f"{name}_se"], more.T.reshape(shape))
    if made and "expected_by_kind_se" not in made:
        made["expected_by_kind_se"] = made["expected_se"][None]
    return made


def _arrivals(row: Array, arrival: Array, amount: Array) -> tuple[Array, Array, Array]:
    """Return the rows at which any of these objects arrive, when the first of a row does, and when their median does.

    row: (m,) ascending; arrival: (m,) [s] ascending in each row; amount: (m,) objects, each arrives once.
    """
    there = np.flatnonzero(amount)
    row, arrival, amount = row[there], arrival[there], amount[there].astype(np.int64)
    found, head = np.unique(row, return_index=True)
    running = np.cumsum(amount)
    before = running[head] - amount[head]
    last = np.append(running[head[1:] - 1], running[-1:]) - before - 1  # number of the row's last object, from 0
    middle = [arrival[np.searchsorted(running, before + which, side="right")] for which in (last // 2, (last + 1) // 2)]
    return found, arrival[head].astype(np.float64), np.mean(middle, axis=0)


def _when(
    firsts: Sequence[tuple[Array, Array, Array]], weight: Array, stretch: Array, start: Array, squares: float
) -> dict[str, Array]:
    """Return when the first object and the bulk arrive, [s after start], given that any does, and how probable that is.

    firsts: of each realisation, see _arrivals; weight: of a row in each realisation.
    """
    row = np.concatenate([one[0] for one in firsts])
    any_comes = np.bincount(row, minlength=len(weight))[:, None] / len(firsts)
    ever, ever_se = estimate.mean(any_comes, weight * len(firsts), start, squares)
    ever_se = np.maximum(ever_se, estimate.least_error(ever, 1 / squares))
    mass = weight * any_comes[:, 0]
    # Of weights relative to the largest of each stretch: their squares may be too small for a float.
    size = np.diff(np.append(start, mass.size))
    part = mass / np.repeat(np.maximum(np.maximum.reduceat(mass, start), np.finfo(float).tiny), size)
    many = np.add.reduceat(part, start) ** 2 / np.maximum(np.add.reduceat(part**2, start), np.finfo(float).tiny)
    found = {"ever": ever[:, 0], "ever_se": ever_se[:, 0], "effective_arrivals": many}
    for name, which in (("first_arrival", 1), ("bulk_arrival", 2)):
        value = np.concatenate([one[which] for one in firsts])
        order = np.lexsort((value, stretch[row]))
        head = np.searchsorted(stretch[row][order], np.arange(len(start)))
        found[name], found[f"{name}_se"] = estimate.quantiles(value[order], weight[row][order], head, SHARES, many)
    return found


def _account(fates: Fates, realisations: Sequence[Realisation], weight: Array, outputs: Array) -> dict[str, Array]:
    """Return the totals over all stretches."""
    every = np.stack([account(fates, one, outputs) for one in realisations])  # (realisation, world, time, fate)
    middle = every.mean(axis=0)
    shape = every.shape[2:]
    squares = float(np.sum(weight**2))
    total, error = estimate.mean(middle.reshape(len(weight), -1), weight, np.array([0]), squares)
    flat = every.reshape(-1, shape[0] * shape[1]).T
    order = np.argsort(flat, axis=1, kind="stable")
    pooled = np.tile(weight, len(realisations))[order]
    number, number_se = estimate.quantiles(
        np.take_along_axis(flat, order, axis=1).ravel(),
        pooled.ravel(),
        np.arange(len(flat)) * flat.shape[1],
        SHARES,
        1 / squares,
    )
    return {
        "total": total.reshape(shape).T,
        "total_se": error.reshape(shape).T,
        "total_number": number.reshape(-1, *shape).swapaxes(1, 2),
        "total_number_se": number_se.reshape(-1, *shape).swapaxes(1, 2),
        "world_total": middle.astype(np.float32),
    }
