"""How much a plan could find at the most, estimated: what effort that can be divided at will would find.

Effort f [s] of search by unit, time bin and box gives every particle i in the box the coverage f W_i (v + s_i) / area, W that of its
own scenario, v the unit's speed and s_i the particle's: a leg against its drift. Its chance of being found is at most b(C_i), C_i all its
coverage, b the concave curve above whatever legs find (drift.planner.concave): P(f) = sum of w_i b(C_i) is concave. When being found is worth less
later, a_i(t), what is found is sum over i and t of w_i (a_i(t) - a_i(t + 1)) b(C_i(t)): concave too.

For any slopes y no plan exceeds the sum of w_i b*(y_i) + max over g of sum of w_i y_i C_i(g), b*(y) = max over C of b(C) - y C
(Fenchel; with y = b'(C_i(f)) it is P(f) + max over g of <P'(f), g - f>, the duality gap of Frank and Wolfe 1956). The maximum takes
only, at each time, the greatest density of particles weighted by y: a unit spends its time in the bins whose best box gains most. f is
found by projected gradients with momentum (Beck and Teboulle 2009, doi:10.1137/080716542).

That would be proven if densities were known. They are estimated, and so is the bound. What is taken for granted: a particle goes straight from one time
of its track to the next; its density is even within a box; and in a bin of time the greatest densities are at most those when the cloud is densest. Boxes
are drawn as tight as the particles in them, so that density is rather too high than too low, and cut where particles are plainly uneven; bins are as short
as the particles' motion against each other asks for. What unevenness is left makes the bound too low by second order in the size of boxes and bins; noise makes it
too high, for boxes that are too dense by chance look worth a visit, and outweighs that (tests/planner/test_bound.py). Where density has no limit, as r^-1.5 about a point, it does not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from drift.motion.scenario import Survival
from drift.planner import availability, concave, quadtree
from drift.planner import planning_tracks as record
from drift.planner.planning_tracks import Tracks
from drift.search import laws
from drift.search.records import PlanSpec, Unit
from geo import sphere
from kernels import allocate

Array = npt.NDArray[Any]

BOXES = 160  # a bin, at least, where there are particles enough
LEAST = 16.0  # effective particles in a box before it is divided: 8 make it too dense by two thirds, 64 are too wide (tests/planner/test_bound.py)
FEWEST, MOST = 6, 24  # bins of time
STRAIN = 0.5  # sides of a box that its particles move apart in a bin, unless that takes too many bins
TRIAL = 4096  # particles on which that is measured
SMALLEST = 0.003  # sweep widths: the side of the smallest box, which a single pass covers
PATIENCE = 25  # steps without a better bound or better effort
STEPS = 500  # at most
FEW = 1000.0  # effective particles: on a circular normal, fewer leave the bound up to 3 % too low
NEARLY = 0.995
UNSURE = 0.05  # standard error of the bound less what the plan is worth
EASE = 0.95  # by which the curvature is tried lower after each step
ENOUGH = 0.001  # by which the bound may exceed the best that was found


@dataclass(frozen=True)
class Budget:
    """What effort may be spent. Arrays by box and unit, or by bin and unit [s]."""

    start: Array  # int64 (b + 1,) first box of each bin
    most: Array  # (b, units) in a bin
    total: Array  # (units,) in all
    open: Array  # bool (boxes, units): it can be there in that bin


@dataclass(frozen=True)
class Bound:
    """No plan should find more than `value`."""

    value: float
    spread: float  # what the divided effort finds, on the particles that it was found on
    effort: Array  # float64 [s] (boxes, units)


@dataclass(frozen=True)
class Bins:
    """Particles (m) at one time in each bin (b), on a plane."""

    edge: Array  # float64 [s since 1970] (b + 1,)
    x: Array  # float64 [m] (b, m)
    y: Array
    there: Array  # bool (b, m): it can be found in the bin
    pace: Array  # float64 [m/s] (b, m) the fastest that it is in the bin


def bound(tracks: Tracks, units: Sequence[Unit], spec: PlanSpec, survival: Sequence[Survival | None]) -> Bound:
    """Return the estimated upper bound of what any plan of these units, laws and times finds on these tracks."""
    some = np.flatnonzero(tracks.weight > 0)
    tracks = record.sort(record.take(tracks, some, tracks.weight[some]))
    field, budget, area = _field(tracks, units, spec, survival)
    return ascend(field, budget, area)


def silent(value: float, effective: float, error: float, seen: float, scored: float) -> str:
    """Return why a bound tells nothing, in a few words; "" where it does.

    effective: particles that it was found on count as so many; seen: what the plan finds of them; scored: what it finds of others; error: standard error
    of value less scored.
    """
    if effective < FEW:
        return f"only {effective:,.0f} particles count, too few to tell"
    if value > NEARLY:
        return "effort that is divided at will would find nearly all"
    if error > UNSURE:
        return f"sampling leaves it unsure by {2 * error:.2f}"
    if seen > value or scored > value + 2 * error:
        return "this plan finds more than was reckoned for any"
    return ""


def worth(tracks: Tracks, survival: Sequence[Survival | None], objective: str, time: Array | None = None) -> Array:
    """Return what finding each particle is worth at times (k) [s since 1970], (k, m): 1, or its chance of being alive.

    time: the tracks' own unless told.
    """
    time = tracks.time if time is None else time
    value = np.ones((len(time), tracks.m))
    if objective == "alive":
        for s, life in enumerate(survival):
            if life is not None:
                own = tracks.scenario == s
                value[:, own] = life.alive(np.maximum(time[:, None] - tracks.release[own], 0.0))
    return value


def ascend(field: allocate.Field, budget: Budget, areas: Array) -> Bound:
    """Return the bound and the effort that finds most, by accelerated projected gradients; areas [m2] of the boxes."""
    area = areas[:, None]
    curvature = _curvature(field, area)
    best, least = 0.0, 1.0
    effort = ahead = kept = np.zeros((len(area), field.units))
    t, stiff, last = 1.0, 1.0, 0
    for k in range(STEPS):
        value, rest = field.spend(ahead / area)
        slope = field.gain() / area
        most = rest + float(np.sum(_best(slope, budget)[1]))
        if most < least - ENOUGH / 10:
            least, last = most, k
        if least - best < ENOUGH or best > NEARLY or k - last > PATIENCE:
            break
        while True:
            new = project(ahead + slope / (stiff * curvature), stiff * curvature, budget)
            step = new - ahead
            found, _ = field.spend(new / area)
            expected = value + float(np.sum(slope * step)) - stiff / 2 * float(np.sum(curvature * step**2))
            if found >= expected - 1e-6:
                break
            stiff *= 2
        stiff *= EASE
        if found > best:
            last = k if found > best + ENOUGH / 10 else last
            best, kept = found, new
        after = (1 + np.sqrt(1 + 4 * t * t)) / 2
        if np.sum((ahead - new) * curvature * (new - effort)) > 0:  # momentum leads astray: O'Donoghue and Candes 2015
            t, ahead = 1.0, new
        else:
            ahead = _shrink(np.maximum(new + (t - 1) / after * (new - effort), 0.0), budget)
            t = after
        effort = new
    return Bound(least, best, kept)


def _field(
    tracks: Tracks, units: Sequence[Unit], spec: PlanSpec, survival: Sequence[Survival | None]
) -> tuple[allocate.Field, Budget, Array]:
    """Return the particles in boxes, what may be spent there, and the boxes' areas [m2]."""
    widths = np.array([unit.sweep_width for unit in units]).T
    smallest = SMALLEST * float(widths.min(where=widths > 0, initial=np.inf) if (widths > 0).any() else 1.0)
    plane = record.plane(tracks)
    bins = _bins(tracks, plane)
    effective = float(1 / np.sum(tracks.weight**2))
    of, made = np.full(bins.there.shape, -1), []
    for t, there in enumerate(bins.there):
        if there.any():
            made.append(
                quadtree.fit(
                    bins.x[t, there],
                    bins.y[t, there],
                    tracks.weight[there],
                    max(effective / BOXES, LEAST),
                    LEAST,
                    smallest,
                )
            )
            of[t, there] = sum(one.count for one in made[:-1]) + made[-1].of
        else:  # nobody to be found: a box of nobody
            made.append(quadtree.Boxes(np.zeros(0, np.int64), *np.zeros((3, 1, 2))))
    start = np.concatenate([[0], np.cumsum([one.count for one in made])])
    area = np.concatenate([np.prod(np.maximum(one.sides, smallest), axis=1) for one in made])
    value = worth(tracks, survival, spec.objective, bins.edge[:-1])  # later in the bin it is no more
    fall = value - np.concatenate([value[1:], np.zeros((1, tracks.m))])
    groups = {unit.group or unit.name: unit.shape for unit in units}
    curve = concave.curve(list(dict.fromkeys(unit.law for unit in units)), list(groups.values()))
    field = allocate.Field(
        of, len(area), fall, bins.pace, tracks.scenario, tracks.weight, widths * np.array([unit.search_speed for unit in units]),
        [0.0 if laws.of(unit.law).detects == "anywhere" else 1 / unit.search_speed for unit in units],  # its effort is over the ground
        (curve.value, curve.slope, curve.conjugate), concave.STEP,
    )  # fmt: skip
    return field, _budget(tracks, units, spec, bins, made, start, plane), area


def _bins(tracks: Tracks, plane: record.Plane) -> Bins:
    """Return bins as short as the particles' motion against each other asks for, each when the cloud is densest in it."""
    x, y = plane.flat(tracks.lon * sphere.UNIT, tracks.lat * sphere.UNIT)
    time, long = tracks.time, np.diff(tracks.time)
    side, apart = _strain(tracks, x, y)
    # While sides grow from a to b and particles move apart by d, in sides they do by the integral of d / (a + (b - a) s).
    ratio = side[1:] / side[:-1]
    rise = np.where(np.abs(ratio - 1) > 1e-6, np.log(ratio) / np.where(ratio == 1, 1, ratio - 1), 1.0)
    strain = apart / side[:-1] * rise
    count = int(np.clip(np.ceil(strain.sum() / STRAIN), FEWEST, MOST))
    rest = STRAIN * FEWEST * long / long.sum()  # so that no bin is too long for the units' own times
    done = np.concatenate([[0.0], np.cumsum(strain + rest)])
    goal = np.linspace(0, done[-1], count + 1)[1:-1]
    k = np.clip(np.searchsorted(done, goal, side="right") - 1, 0, len(long) - 1)
    share = (goal - done[k]) / (done[k + 1] - done[k])
    grown = np.where(
        np.abs(ratio[k] - 1) > 1e-6, (ratio[k] ** share - 1) / np.where(ratio[k] == 1, 1, ratio[k] - 1), share
    )
    edge = np.concatenate([time[:1], time[k] + grown * long[k], time[-1:]])
    speed = np.hypot(np.diff(x, axis=0), np.diff(y, axis=0)) / long[:, None]
    shape = (len(edge) - 1, tracks.m)
    bins = Bins(edge, np.empty(shape), np.empty(shape), np.zeros(shape, bool), np.empty(shape))
    for t in range(len(edge) - 1):
        first = min(int(np.searchsorted(time, edge[t], side="right")) - 1, len(long) - 1)
        last = max(int(np.searchsorted(time, edge[t + 1], side="left")), first + 1)
        when = np.concatenate([edge[t : t + 2], time[first + 1 : last]])
        at = float(when[np.argmin(np.interp(when, time, side))])
        j = min(int(np.searchsorted(time, at, side="right")) - 1, len(long) - 1)
        part = (at - time[j]) / long[j]
        bins.x[t], bins.y[t] = (v[j] + part * (v[j + 1] - v[j]) for v in (x, y))
        bins.there[t] = tracks.adrift[first : last + 1].any(axis=0)
        bins.pace[t] = speed[first:last].max(axis=0)
    return bins


def _strain(tracks: Tracks, x: Array, y: Array) -> tuple[Array, Array]:
    """Return the mean side of boxes at each time of the tracks [m], and by how much particles move apart in them until the next."""
    tick = np.cumsum(tracks.weight)
    few = np.minimum(np.searchsorted(tick, (np.arange(TRIAL) + 0.5) / TRIAL * tick[-1]), tracks.m - 1)
    few = np.unique(few)
    weight = np.ones(len(few))
    side, apart = np.empty(len(x)), np.empty(len(x) - 1)
    for t in range(len(x)):
        one = quadtree.grow(x[t, few], y[t, few], weight, max(len(few) / BOXES, 8.0))
        count = np.bincount(one.of)
        side[t] = np.sqrt(max(len(few) / np.sum(count / np.maximum(one.area, 1.0)), 1.0))
        if t < len(x) - 1:
            total = 0.0
            for v in (x, y):
                way = v[t + 1, few] - v[t, few]
                own = way - (np.bincount(one.of, way) / count)[one.of]
                total += float(own @ own) / len(few)
            apart[t] = np.sqrt(total / 2)
    return side, apart


def _budget(
    tracks: Tracks,
    units: Sequence[Unit],
    spec: PlanSpec,
    bins: Bins,
    made: Sequence[quadtree.Boxes],
    start: Array,
    plane: record.Plane,
) -> Budget:
    bin_of = np.repeat(np.arange(len(made)), np.diff(start))
    low, high = (np.concatenate(v) for v in ([one.low for one in made], [one.high for one in made]))
    begin, end = bins.edge[:-1][bin_of], bins.edge[1:][bin_of]
    # A box has moved within its bin, and is seen from a sweep width away.
    moved = np.max(bins.pace, axis=1)[bin_of] * (end - begin)
    spare, total = np.zeros((len(low), len(units))), np.zeros(len(units))
    for u, unit in enumerate(units):
        can = availability.reach(unit, spec, (plane.lon, plane.lat))
        x, y = plane.flat(*np.radians(unit.base))
        away = np.hypot(*np.maximum(np.maximum(low - (x, y), (x, y) - high), 0.0).T)
        near = np.maximum(away - moved - max(unit.sweep_width), 0.0)
        spare[:, u] = can.within(begin, end, can.leaves + near / can.transit_speed)
        ends = laws.of(unit.law).ends * max(unit.sweep_width) / unit.search_speed
        total[u] = can.search + spec.rounds * ends
        spare[:, u] += (spare[:, u] > 0) * spec.rounds * ends
    return Budget(start, np.maximum.reduceat(spare, start[:-1], axis=0), total, spare > 0)


def _best(slope: Array, budget: Budget) -> tuple[Array, Array]:
    """Return the best slope of each bin and unit, (b, units), and what each unit can gain by it at most."""
    top = np.maximum.reduceat(np.where(budget.open, slope, 0.0), budget.start[:-1], axis=0)
    gains = np.zeros(top.shape[1])
    for u in range(top.shape[1]):
        at = np.argsort(-top[:, u], kind="stable")
        spent = np.minimum(np.cumsum(budget.most[at, u]), budget.total[u])
        gains[u] = np.sum(np.diff(spent, prepend=0.0) * top[at, u])
    return top, gains


def _shrink(effort: Array, budget: Budget) -> Array:
    """Return effort scaled down to the budget, bin by bin, then in all."""
    used = np.add.reduceat(effort, budget.start[:-1], axis=0)
    share = np.minimum(1, budget.most / np.maximum(used, 1e-9))
    share *= np.minimum(1, budget.total / np.maximum(np.sum(used * share, axis=0), 1e-9))
    return np.asarray(effort * np.repeat(share, np.diff(budget.start), axis=0))


def _curvature(field: allocate.Field, area: Array) -> Array:
    """Return a diagonal that the curvature of -P does not exceed, by cell and unit [1/s2]."""
    field.spend(np.zeros(area.shape) * np.ones(field.units))
    return np.asarray(np.maximum(field.gain(squared=True) / area**2, 1e-30))


def project(effort: Array, stiff: Array, budget: Budget) -> Array:
    """Return the effort within the budget that is nearest to `effort`, squares weighted by `stiff`, (cells, units).

    It is max(0, effort - price / stiff), the price of a bin being the larger of its own and the unit's.
    """
    ease = np.where(budget.open, 1 / stiff, 0.0)
    effort = np.where(budget.open, effort, 0.0)
    first, bins = budget.start[:-1], np.diff(budget.start)

    def spent(price: Array) -> tuple[Array, Array]:
        left = effort - np.repeat(price, bins, axis=0) * ease
        return np.add.reduceat(np.maximum(left, 0), first, axis=0), np.add.reduceat(
            np.where(left > 0, ease, 0), first, axis=0
        )

    price = np.zeros(budget.most.shape)
    for _ in range(12):  # Newton from below on convex falling pieces
        used, slope = spent(price)
        over = used - budget.most
        if np.all(over <= 1e-9 * np.maximum(budget.most, 1)):
            break
        price = np.where(over > 0, price + over / np.maximum(slope, 1e-300), price)
    low, high = np.zeros(len(budget.total)), np.max(np.where(budget.open, effort * stiff, 0), axis=0, initial=0)
    if np.any(np.sum(spent(price)[0], axis=0) > budget.total):
        for _ in range(30):
            middle = (low + high) / 2
            over = np.sum(spent(np.maximum(price, middle))[0], axis=0) > budget.total
            low, high = np.where(over, middle, low), np.where(over, high, middle)
        price = np.where(np.sum(spent(price)[0], axis=0) > budget.total, np.maximum(price, high), price)
    return np.maximum(effort - np.repeat(price, bins, axis=0) * ease, 0)
