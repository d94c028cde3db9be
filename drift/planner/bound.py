"""An estimated upper bound of what any plan can find: what effort would find that can be divided at will.

Effort f [s] of search by unit, time bin and box gives every particle i in the box the coverage f W_i (v + s_i) / area,
where W_i is the sweep width for its own scenario, v the unit's speed and s_i the particle's, as for a leg against its
drift. Its chance of being found is at most b(C_i), where C_i is all its coverage and b the concave curve above whatever
legs find (drift.planner.concave): P(f) = sum of w_i b(C_i) is concave. When being found is worth less later, a_i(t),
the worth of what is found is the sum over i and t of w_i (a_i(t) - a_i(t + 1)) b(C_i(t)), which is concave too.

For any slopes y no plan exceeds the sum of w_i b*(y_i) + max over g of the sum of w_i y_i C_i(g), where b*(y) = max
over C of b(C) - y C (Fenchel; with y = b'(C_i(f)) it is P(f) + max over g of <P'(f), g - f>, the duality gap of Frank
and Wolfe 1956). The maximum needs, at each time, only the greatest density of particles weighted by y: a unit spends
its time in the bins whose best box gains most. f is found by projected gradients with momentum (Beck and Teboulle 2009,
doi:10.1137/080716542).

The bound would be proven if densities were known. They are estimated, and so is the bound. It assumes that a particle
goes straight from one time of its track to the next, that its density is even within a box, and that the greatest
densities in a bin of time are at most those when the cloud is densest. Boxes are drawn as tight as the particles in
them, so that density is rather too high than too low, and they are cut where particles are clearly uneven; bins are as
short as the particles' motion against each other requires. The unevenness that is left makes the bound too low, by
second order in the size of boxes and bins. Noise makes it too high, because boxes that are too dense by chance look
worth a visit, and outweighs the other error (tests/planner/test_bound.py), except where density has no limit, as r^-1.5
about a point.

What steers moves fast against its neighbours and turns. Its bins are as short as the particles' displacement within
them requires, measured from edge to edge, which a bridge's noise does not lengthen; where no bins are short enough
there is no bound. In a bin in which a particle goes adrift the larger of its two sweep widths counts.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drift.motion.scenario import Survival
from drift.planner import availability, concave, quadtree
from drift.planner import planning_tracks as record
from drift.planner.planning_tracks import Tracks
from drift.search import laws
from drift.search.records import PlanSpec, Unit
from geo import sphere
from geo.array import Array
from kernels import allocate

BOXES = 160  # fewest boxes in a bin, where there are particles enough
# Fewest effective particles in a box: boxes of 8 are too dense by two thirds, boxes of 64 are too wide (test_bound.py).
LEAST = 16.0
FEWEST, MOST = 6, 24  # bins of time
STRAIN = 0.5  # of a box's side: how far its particles may move apart in a bin, unless that takes too many bins
STEERED = 0.25  # the same where something steers; half of it is then between the densest time and the bin's far end
MOST_STEERED = 240  # bins of time where something steers; more would take minutes
TRIAL = 4096  # particles on which that is measured
SMALLEST = 0.003  # [sweep widths] side of the smallest box, which a single pass covers
PATIENCE = 25  # steps without a better bound or better effort after which the search ends
STEPS = 500  # most steps
FEW = 1000.0  # effective particles: on a circular normal, fewer leave the bound up to 3 % too low
NEARLY = 0.995  # above this value a bound tells nothing
UNSURE = 0.05  # largest standard error of the bound less what the plan is worth
EASE = 0.95  # factor by which a lower curvature is tried after each step
ENOUGH = 0.001  # the search ends when the bound exceeds the best effort by no more than this


@dataclass(frozen=True)
class Budget:
    """What effort may be spent, by box, bin and unit."""

    start: Array  # int64 (b + 1,) first box of each bin
    most: Array  # [s] (b, units) in a bin
    total: Array  # [s] (units,) in all
    open: Array  # bool (boxes, units): the unit can be there in that bin


@dataclass(frozen=True)
class Bound:
    """The bound, and the divided effort that comes near to it."""

    value: float  # no plan should find more
    spread: float  # what the divided effort finds, of the particles on which it was found
    effort: Array  # float64 [s] (boxes, units)
    coarse: bool = False  # bins of time are too long for how particles move: it is no bound


@dataclass(frozen=True)
class Bins:
    """Positions of particles (m) at one time in each bin (b), on a plane."""

    edge: Array  # float64 [s since 1970] (b + 1,)
    x: Array  # float64 [m] (b, m)
    y: Array
    there: Array  # bool (b, m): the particle can be found in the bin
    pace: Array  # float64 [m/s] (b, m) highest speed of the particle in the bin
    moved: Array  # float64 [m] (b,) farthest that any particle is in the bin from that position
    coarse: bool = False  # particles move apart too far even in the shortest bins


def bound(tracks: Tracks, units: Sequence[Unit], spec: PlanSpec, survival: Sequence[Survival | None]) -> Bound:
    """Return the estimated upper bound of what any plan of these units, laws and times finds on these tracks."""
    weighted = np.flatnonzero(tracks.weight > 0)
    tracks = record.sort(record.take(tracks, weighted, tracks.weight[weighted]))
    field, budget, area, coarse = _field(tracks, units, spec, survival)
    return replace(ascend(field, budget, area), coarse=coarse)


def silent(value: float, effective: float, error: float, seen: float, scored: float, coarse: bool = False) -> str:
    """Return in a few words why a bound tells nothing; "" where it tells something.

    coarse: see Bound; effective: effective number of the particles on which it was found; seen: what the plan finds of them; scored: what
    the plan finds of others; error: standard error of value less scored.
    """
    if effective < FEW:
        return f"only {effective:,.0f} particles count, too few to tell"
    if coarse:
        return "what is looked for moves too fast for its bins of time"
    if value > NEARLY:
        return "effort that is divided at will would find nearly all"
    if error > UNSURE:
        return f"sampling leaves it unsure by {2 * error:.2f}"
    if seen > value or scored > value + 2 * error:
        return "this plan finds more than was reckoned for any"
    return ""


def worth(tracks: Tracks, survival: Sequence[Survival | None], objective: str, time: Array | None = None) -> Array:
    """Return what finding each particle is worth at some times, (k, m): 1, or its chance of being alive.

    time: (k,) [s since 1970]; the tracks' own by default.
    """
    time = tracks.time if time is None else time
    value = np.ones((len(time), tracks.m))
    if objective == "alive":
        for s, life in enumerate(survival):
            if life is not None:
                members = tracks.scenario == s
                value[:, members] = life.alive(np.maximum(time[:, None] - tracks.release[members], 0.0))
    return value


def ascend(field: allocate.Field, budget: Budget, areas: Array) -> Bound:
    """Return the bound and the best effort, by accelerated projected gradients; areas: of the boxes [m2]."""
    area = areas[:, None]
    curvature = _curvature(field, area)
    best, least = 0.0, 1.0
    effort = extrapolated = best_effort = np.zeros((len(area), field.units))
    t, stiffness, last = 1.0, 1.0, 0
    for k in range(STEPS):
        value, conjugate = field.spend(extrapolated / area)
        slope = field.gain() / area
        upper = conjugate + float(np.sum(_best(slope, budget)[1]))
        if upper < least - ENOUGH / 10:
            least, last = upper, k
        if least - best < ENOUGH or best > NEARLY or k - last > PATIENCE:
            break
        while True:
            new = project(extrapolated + slope / (stiffness * curvature), stiffness * curvature, budget)
            step = new - extrapolated
            attained, _ = field.spend(new / area)
            expected = value + float(np.sum(slope * step)) - stiffness / 2 * float(np.sum(curvature * step**2))
            if attained >= expected - 1e-6:
                break
            stiffness *= 2
        stiffness *= EASE
        if attained > best:
            last = k if attained > best + ENOUGH / 10 else last
            best, best_effort = attained, new
        next_t = (1 + np.sqrt(1 + 4 * t * t)) / 2
        # Momentum starts anew where it leads astray (O'Donoghue and Candes 2015).
        if np.sum((extrapolated - new) * curvature * (new - effort)) > 0:
            t, extrapolated = 1.0, new
        else:
            extrapolated = _shrink(np.maximum(new + (t - 1) / next_t * (new - effort), 0.0), budget)
            t = next_t
        effort = new
    return Bound(least, best, best_effort)


def _field(
    tracks: Tracks, units: Sequence[Unit], spec: PlanSpec, survival: Sequence[Survival | None]
) -> tuple[allocate.Field, Budget, Array, bool]:
    """Return the particles in boxes, the effort that may be spent there, the boxes' areas [m2], and whether bins are
    too long.
    """
    widths = np.array([unit.sweep_width for unit in units]).T
    if tracks.turn is not None:
        under_way = np.array([unit.width_under_way or unit.sweep_width for unit in units]).T
        widths = np.concatenate([widths, under_way, np.maximum(widths, under_way)])
    smallest = SMALLEST * float(widths.min(where=widths > 0, initial=np.inf) if (widths > 0).any() else 1.0)
    plane = record.plane(tracks)
    bins = _bins(tracks, plane) if tracks.turn is None else _steered_bins(tracks, plane)
    effective = float(1 / np.sum(tracks.weight**2))
    box_of, boxes = np.full(bins.there.shape, -1), []
    for t, present in enumerate(bins.there):
        if present.any():
            x, y, weight = bins.x[t, present], bins.y[t, present], tracks.weight[present]
            boxes.append(quadtree.fit(x, y, weight, max(effective / BOXES, LEAST), LEAST, smallest))
            box_of[t, present] = sum(group.count for group in boxes[:-1]) + boxes[-1].of
        else:  # an empty box, because nobody can be found in this bin
            boxes.append(quadtree.Boxes(np.zeros(0, np.int64), *np.zeros((3, 1, 2))))
    start = np.concatenate([[0], np.cumsum([group.count for group in boxes])])
    area = np.concatenate([np.prod(np.maximum(group.sides, smallest), axis=1) for group in boxes])
    value = worth(tracks, survival, spec.objective, bins.edge[:-1])  # worth does not rise within a bin
    fall = value - np.concatenate([value[1:], np.zeros((1, tracks.m))])
    groups = {unit.group or unit.name: unit.shape for unit in units}
    curve = concave.curve(list(dict.fromkeys(unit.law for unit in units)), list(groups.values()))
    sweep_rates = widths * np.array([unit.search_speed for unit in units])
    # the effort of a random search counts over the ground, whatever the particles' speed
    slowness = [0.0 if laws.of(unit.law).detects == "anywhere" else 1 / unit.search_speed for unit in units]
    field = allocate.Field(
        box_of, len(area), fall, bins.pace, _states(tracks, bins.edge, len(units[0].sweep_width)), tracks.weight, sweep_rates, slowness,
        (curve.value, curve.slope, curve.conjugate), concave.STEP,
    )  # fmt: skip
    return field, _budget(tracks, units, spec, bins, boxes, start, plane), area, bins.coarse


def _states(tracks: Tracks, edge: Array, scenarios: int) -> Array:
    """Return in each bin the row of sweep widths that a particle has: adrift, under way, or the greater of both.

    Rows are by state and then by scenario, (b, m); of what drifts all along its scenario alone, (m,).
    """
    if tracks.turn is None:
        return tracks.scenario
    state = np.where(tracks.turn <= edge[:-1, None], 0, np.where(tracks.turn >= edge[1:, None], 1, 2))
    return np.asarray(state * scenarios + tracks.scenario)


def _bins(tracks: Tracks, plane: record.Plane) -> Bins:
    """Return bins as short as the particles' relative motion requires, each when the cloud is densest in it."""
    x, y = plane.flat(tracks.lon * sphere.UNIT, tracks.lat * sphere.UNIT)
    time, duration = tracks.time, np.diff(tracks.time)
    side, apart = _strain(tracks, x, y)
    # While sides grow from a to b, particles move apart by d, which is the integral of d / (a + (b - a) s) sides.
    ratio = side[1:] / side[:-1]
    rise = np.where(np.abs(ratio - 1) > 1e-6, np.log(ratio) / np.where(ratio == 1, 1, ratio - 1), 1.0)
    strain = apart / side[:-1] * rise
    count = int(np.clip(np.ceil(strain.sum() / STRAIN), FEWEST, MOST))
    floor = STRAIN * FEWEST * duration / duration.sum()  # so that no bin is too long for the units' own times
    progress = np.concatenate([[0.0], np.cumsum(strain + floor)])
    goal = np.linspace(0, progress[-1], count + 1)[1:-1]
    k = np.clip(np.searchsorted(progress, goal, side="right") - 1, 0, len(duration) - 1)
    share = (goal - progress[k]) / (progress[k + 1] - progress[k])
    position = np.where(
        np.abs(ratio[k] - 1) > 1e-6, (ratio[k] ** share - 1) / np.where(ratio[k] == 1, 1, ratio[k] - 1), share
    )
    edge = np.concatenate([time[:1], time[k] + position * duration[k], time[-1:]])
    speed = np.hypot(np.diff(x, axis=0), np.diff(y, axis=0)) / duration[:, None]
    shape = (len(edge) - 1, tracks.m)
    bins = _empty(edge, shape)
    for t in range(len(edge) - 1):
        first = min(int(np.searchsorted(time, edge[t], side="right")) - 1, len(duration) - 1)
        last = max(int(np.searchsorted(time, edge[t + 1], side="left")), first + 1)
        times = np.concatenate([edge[t : t + 2], time[first + 1 : last]])
        densest = float(times[np.argmin(np.interp(times, time, side))])
        j = min(int(np.searchsorted(time, densest, side="right")) - 1, len(duration) - 1)
        part = (densest - time[j]) / duration[j]
        bins.x[t], bins.y[t] = (v[j] + part * (v[j + 1] - v[j]) for v in (x, y))
        bins.there[t] = tracks.adrift[first : last + 1].any(axis=0)
        bins.pace[t] = speed[first:last].max(axis=0)
        bins.moved[t] = bins.pace[t].max() * (edge[t + 1] - edge[t])
    return bins


def _empty(edge: Array, shape: tuple[int, int], coarse: bool = False) -> Bins:
    x, y, pace = np.empty((3, *shape))
    return Bins(edge, x, y, np.zeros(shape, bool), pace, np.empty(shape[0]), coarse)


def _steered_bins(tracks: Tracks, plane: record.Plane) -> Bins:
    """Return bins for what steers, each from one time of the tracks to another, when the cloud is densest in it."""
    x, y = plane.flat(tracks.lon * sphere.UNIT, tracks.lat * sphere.UNIT)
    pace = np.hypot(*record.velocity(tracks, plane, x, y))
    edges, side, coarse = _shortest(tracks, x, y)
    bins = _empty(tracks.time[edges], (len(edges) - 1, tracks.m), coarse)
    for t, (first, last) in enumerate(itertools.pairwise(edges)):
        during = slice(first, last + 1)
        densest = first + int(np.argmin(side[during]))
        bins.x[t], bins.y[t] = x[densest], y[densest]
        bins.there[t] = tracks.adrift[during].any(axis=0)
        bins.pace[t] = pace[first:last].max(axis=0)
        bins.moved[t] = np.hypot(x[during] - x[densest], y[during] - y[densest]).max()
    return bins


def _shortest(tracks: Tracks, x: Array, y: Array) -> tuple[Array, Array, bool]:
    """Return numbers of the tracks' times at which bins for what steers begin and end, and the mean side of boxes.

    The sides are those at each time. Third: whether bins are longer than they should be, because the tracks' are or
    because there would be too many.
    """
    some, last = _few(tracks), len(x) - 1
    boxes = [_sides(x[t, some], y[t, some]) for t in range(last + 1)]
    side = np.array([own for _, own in boxes])
    edges, coarse = [0], False
    while edges[-1] < last:
        first, end = edges[-1], edges[-1] + 1
        shortest = side[first]
        while True:
            shortest = min(shortest, side[end])
            apart = _apart(boxes[first][0], x[end, some] - x[first, some], y[end, some] - y[first, some])
            if apart > STEERED * shortest or tracks.time[end] - tracks.time[first] > (
                (tracks.time[-1] - tracks.time[0]) / FEWEST
            ):
                coarse |= end == first + 1 and apart > STRAIN * shortest
                break
            end += 1
            if end > last:
                break
        edges.append(max(end - 1, first + 1))
    if len(edges) - 1 > MOST_STEERED:
        edges = np.unique(np.rint(np.linspace(0, last, MOST_STEERED + 1)).astype(int)).tolist()
        coarse = True
    return np.array(edges), side, coarse


def _strain(tracks: Tracks, x: Array, y: Array) -> tuple[Array, Array]:
    """Return the mean side of boxes at each time of the tracks, and how far particles then move apart [m]."""
    sample = _few(tracks)
    side, apart = np.empty(len(x)), np.empty(len(x) - 1)
    for t in range(len(x)):
        box_of, side[t] = _sides(x[t, sample], y[t, sample])
        if t < len(x) - 1:
            apart[t] = _apart(box_of, *(v[t + 1, sample] - v[t, sample] for v in (x, y)))
    return side, apart


def _few(tracks: Tracks) -> Array:
    """Return numbers of particles, drawn by weight, on which motion is measured."""
    tick = np.cumsum(tracks.weight)
    sample = np.minimum(np.searchsorted(tick, (np.arange(TRIAL) + 0.5) / TRIAL * tick[-1]), tracks.m - 1)
    return np.unique(sample)


def _sides(x: Array, y: Array) -> tuple[Array, float]:
    """Return boxes of particles at a time, the box of each (n,), and the boxes' mean side [m]."""
    boxes = quadtree.grow(x, y, np.ones(len(x)), max(len(x) / BOXES, 8.0))
    count = np.bincount(boxes.of)
    return boxes.of, float(np.sqrt(max(len(x) / np.sum(count / np.maximum(boxes.area, 1.0)), 1.0)))


def _apart(box_of: Array, *displacements: Array) -> float:
    """Return how far [m] particles of one box move apart: the deviation of displacements (n,) within boxes."""
    count, total = np.bincount(box_of), 0.0
    for displacement in displacements:
        residual = displacement - (np.bincount(box_of, displacement) / count)[box_of]
        total += float(residual @ residual) / len(box_of)
    return float(np.sqrt(total / 2))


def _budget(
    tracks: Tracks,
    units: Sequence[Unit],
    spec: PlanSpec,
    bins: Bins,
    boxes: Sequence[quadtree.Boxes],
    start: Array,
    plane: record.Plane,
) -> Budget:
    """Return the budget of boxes; start: (b + 1,) number of the first box of each bin."""
    bin_of = np.repeat(np.arange(len(boxes)), np.diff(start))
    low, high = (np.concatenate(v) for v in ([group.low for group in boxes], [group.high for group in boxes]))
    begin, end = bins.edge[:-1][bin_of], bins.edge[1:][bin_of]
    # A unit need not come nearer to a box than its motion within the bin and a sweep width.
    moved = bins.moved[bin_of]
    spare, total = np.zeros((len(low), len(units))), np.zeros(len(units))
    for u, unit in enumerate(units):
        available = availability.of_unit(unit, spec, (plane.lon, plane.lat))
        x, y = plane.flat(*np.radians(unit.base))
        distance = np.hypot(*np.maximum(np.maximum(low - (x, y), (x, y) - high), 0.0).T)
        widest = max(*unit.sweep_width, *unit.width_under_way, 0.0)
        to_go = np.maximum(distance - moved - widest, 0.0)
        spare[:, u] = available.within(begin, end, available.leaves + to_go / available.transit_speed)
        ends = laws.of(unit.law).ends * widest / unit.search_speed
        total[u] = available.search + spec.rounds * ends
        spare[:, u] += (spare[:, u] > 0) * spec.rounds * ends
    return Budget(start, np.maximum.reduceat(spare, start[:-1], axis=0), total, spare > 0)


def _best(slope: Array, budget: Budget) -> tuple[Array, Array]:
    """Return the best slope of each bin and unit, (b, units), and the most that each unit can gain, (units,)."""
    top = np.maximum.reduceat(np.where(budget.open, slope, 0.0), budget.start[:-1], axis=0)
    gains = np.zeros(top.shape[1])
    for u in range(top.shape[1]):
        order = np.argsort(-top[:, u], kind="stable")
        spent = np.minimum(np.cumsum(budget.most[order, u]), budget.total[u])
        gains[u] = np.sum(np.diff(spent, prepend=0.0) * top[order, u])
    return top, gains


def _shrink(effort: Array, budget: Budget) -> Array:
    """Return effort scaled down to the budget, first in each bin, then in all."""
    spent_in_bin = np.add.reduceat(effort, budget.start[:-1], axis=0)
    share = np.minimum(1, budget.most / np.maximum(spent_in_bin, 1e-9))
    share *= np.minimum(1, budget.total / np.maximum(np.sum(spent_in_bin * share, axis=0), 1e-9))
    return np.asarray(effort * np.repeat(share, np.diff(budget.start), axis=0))


def _curvature(field: allocate.Field, area: Array) -> Array:
    """Return a diagonal matrix above the curvature of -P, by box and unit [1/s2]."""
    field.spend(np.zeros(area.shape) * np.ones(field.units))
    return np.asarray(np.maximum(field.gain(squared=True) / area**2, 1e-30))


def project(effort: Array, stiff: Array, budget: Budget) -> Array:
    """Return the effort within the budget that is nearest to `effort`, (boxes, units).

    stiff: weights of the squares. It is max(0, effort - price / stiff), where the price in a bin is the larger of the
    bin's and the unit's.
    """
    inverse = np.where(budget.open, 1 / stiff, 0.0)
    effort = np.where(budget.open, effort, 0.0)
    first, bins = budget.start[:-1], np.diff(budget.start)

    def spent(price: Array) -> tuple[Array, Array]:
        kept = effort - np.repeat(price, bins, axis=0) * inverse
        return np.add.reduceat(np.maximum(kept, 0), first, axis=0), np.add.reduceat(
            np.where(kept > 0, inverse, 0), first, axis=0
        )

    price = np.zeros(budget.most.shape)
    for _ in range(12):  # Newton's method from below, on a convex decreasing function
        used, slope = spent(price)
        excess = used - budget.most
        if np.all(excess <= 1e-9 * np.maximum(budget.most, 1)):
            break
        price = np.where(excess > 0, price + excess / np.maximum(slope, 1e-300), price)
    low, high = np.zeros(len(budget.total)), np.max(np.where(budget.open, effort * stiff, 0), axis=0, initial=0)
    if np.any(np.sum(spent(price)[0], axis=0) > budget.total):
        for _ in range(30):
            middle = (low + high) / 2
            excess = np.sum(spent(np.maximum(price, middle))[0], axis=0) > budget.total
            low, high = np.where(excess, middle, low), np.where(excess, high, middle)
        price = np.where(np.sum(spent(price)[0], axis=0) > budget.total, np.maximum(price, high), price)
    return np.maximum(effort - np.repeat(price, bins, axis=0) * inverse, 0)
