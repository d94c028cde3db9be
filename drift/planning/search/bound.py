"""An estimated upper bound of the value of any search plan, from divisible effort.

Effort f [s] by unit, time bin and box gives each particle i in the box the coverage f W_i (v + s_i)
/ area. W_i is the sweep width for its scenario, v the unit's speed and s_i the particle's, as for a
leg against its drift. Its probability of detection is at most b(C_i), where C_i is its total
coverage and b a concave curve above the result of any legs (drift.planning.search.concave). So P(f)
= sum of w_i b(C_i) is concave. If finding is worth less later, a_i(t), the total worth is the sum
over i and t of w_i (a_i(t) - a_i(t + 1)) b(C_i(t)), which is also concave.

For any slopes y no plan exceeds the sum of w_i b*(y_i) + max over g of the sum of w_i y_i C_i(g),
where b*(y) = max over C of b(C) - y C (Fenchel; with y = b'(C_i(f)) it is P(f) + max over g of
<P'(f), g - f>, the duality gap of Frank and Wolfe 1956). The maximum needs only the greatest
density of particles weighted by y at each time: a unit spends its time in the bins whose best box
gains most. f is found by projected gradients with momentum (Beck and Teboulle 2009,
doi:10.1137/080716542).

The bound would be exact if densities were known. They are estimated, and so is the bound. It
assumes that particles move straight between the times of their tracks and that density is uniform
within a box. It also assumes that the greatest density in a time bin is that of the cloud at its
densest or, for steering particles, the mean over the bin's rows (drift.planning.search.bins). Boxes
fit their particles tightly, so that density is too high rather than too low, and clearly uneven
boxes are cut. Bins are as short as relative motion requires. The remaining unevenness makes the
bound too low, by second order in the size of boxes and bins. Noise makes it too high, because boxes
that are dense by chance look attractive. Noise outweighs the other error
(tests/planning/search/test_bound.py), except for unlimited densities such as r^-1.5 about a point.

Steering particles stream past each other. A box of a bin with several rows does not move; effort
counts for a particle in proportion to the rows in which it is in the box, so the density is the
mean over rows. Noise makes the bound too high there too, by up to a third. There is no bound if
particles move farther in a row than boxes and sweep widths reach. Nor is there one for a sensor
that counts passes abeam against a Brownian bridge: a bridge crosses the abeam line infinitely
often, and no limit is known for ever shorter legs.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drift.engine.motion.scenario import Survival
from drift.evidence.filter.detection import laws
from drift.evidence.filter.records import PlanSpec, Unit
from drift.forecast import effective
from drift.planning.search import bins as binned
from drift.planning.search import concave, quadtree
from drift.planning.search import planning_tracks as record
from drift.planning.search.bins import BOXES, Bins
from drift.planning.search.boats import availability
from drift.planning.search.planning_tracks import Tracks
from geo.array import Array
from kernels.planning import allocate

# Fewest effective particles in a box: boxes of 8 are too dense by two thirds, boxes of 64 are too
# wide (test_bound.py).
LEAST = 16.0
# most particles if some steer: more rows improve the bound more than more particles
PARTICLES = 10_000
SMALLEST = 0.003  # [sweep widths] side of the smallest box, which a single pass covers
PATIENCE = 25  # steps without improvement after which the search ends
STEPS = 500  # most steps
FEW = 1000.0  # effective particles: on a circular normal, fewer leave the bound up to 3 % too low
NEARLY = 0.995  # a bound above this value is not reported
UNSURE = 0.05  # largest standard error of the bound less the plan's value
EASE = 0.95  # factor by which a lower curvature is tried after each step
ENOUGH = 0.001  # the search ends when the bound exceeds the best effort by no more than this
STEERED = 0.003  # the same if particles steer, which takes more steps


@dataclass(frozen=True)
class Budget:
    """The effort that may be spent by bin and unit, and where."""

    start: Array  # int64 (b + 1,) first box of each bin
    most: Array  # [s] (b, units) most effort in a bin
    total: Array  # [s] (units,) most effort in total
    open: Array  # bool (boxes, units): the unit can be there in that bin


@dataclass(frozen=True)
class Bound:
    """The bound, and the divisible effort that comes near it."""

    value: float  # no plan should find more
    spread: float  # value of that effort on the same particles
    effort: Array  # float64 [s] (boxes, units)
    none: str = ""  # short reason why there is no bound


def bound(
    tracks: Tracks, units: Sequence[Unit], spec: PlanSpec, survival: Sequence[Survival | None]
) -> Bound:
    """Return the estimated upper bound of any plan's value on these tracks.

    Args:
        tracks: planning particles.
        units: with their sweep widths, laws and times.
        spec: of the plan.
        survival: of each scenario; None: survival is not modelled.
    """
    if tracks.turn is None:
        weighted = np.flatnonzero(tracks.weight > 0)
        some = record.sort(record.take(tracks, weighted, tracks.weight[weighted]))
        return ascend(*_field(some, units, spec, survival)[:3])
    field, budget, area, none = _field(
        record.sample(tracks, max(int(counted(tracks)), 1)), units, spec, survival
    )
    if none:
        return Bound(1.0, 0.0, np.zeros((len(area), len(units))), none)
    return ascend(field, budget, area, STEERED)


def counted(tracks: Tracks) -> float:
    """Return the effective number of particles on which a bound is computed."""
    number = effective.number(tracks.weight)
    return number if tracks.turn is None else min(number, PARTICLES)


def silent(
    value: float, number: float, error: float, seen: float, scored: float, none: str = ""
) -> str:
    """Return a short reason why a bound is not reported, or "" if it is.

    Args:
        value: the bound.
        number: effective number of particles on which the bound was computed.
        error: standard error of `value` less `scored`.
        seen: value of the plan on the particles of the bound.
        scored: value of the plan on other particles.
        none: see `Bound`.
    """
    if number < FEW:
        return f"only {number:,.0f} effective particles, too few to judge this plan"
    if none:
        return none
    if value > NEARLY:
        return "it is near 1 and limits no plan"
    if error > UNSURE:
        return f"its sampling error is too large ({2 * error:.2f})"
    if seen > value or scored > value + 2 * error:
        return "this plan finds more than the estimate for any plan"
    return ""


def worth(
    tracks: Tracks, survival: Sequence[Survival | None], objective: str, time: Array | None = None
) -> Array:
    """Return the worth of finding each particle at some times, shape (k, m).

    The worth is 1, or the particle's probability of being alive if that is the objective.

    Args:
        tracks: planning particles.
        survival: of each scenario.
        objective: of the plan, "alive" or another.
        time: [s since 1970], shape (k,); None: the times of the tracks.
    """
    time = tracks.time if time is None else time
    value = np.ones((len(time), tracks.m))
    if objective == "alive":
        for s, life in enumerate(survival):
            if life is not None:
                members = tracks.scenario == s
                value[:, members] = life.alive(
                    np.maximum(time[:, None] - tracks.release[members], 0.0)
                )
    return value


def ascend(field: allocate.Field, budget: Budget, areas: Array, enough: float = ENOUGH) -> Bound:
    """Return the bound and the best effort, by accelerated projected gradients.

    Args:
        field: particles in boxes.
        budget: of the units.
        areas: of the boxes [m2], times the rows of their bins.
        enough: gap between bound and best effort at which the search ends.
    """
    area = areas[:, None]
    curvature = _curvature(field, area)
    best, least = 0.0, np.inf
    effort = extrapolated = best_effort = np.zeros((len(area), field.units))
    t, stiffness, last = 1.0, 1.0, 0
    for k in range(STEPS):
        value, conjugate = field.spend(extrapolated / area)
        slope = field.gain() / area
        upper = conjugate + float(np.sum(_best(slope, budget)[1]))
        if upper < least - ENOUGH / 10:
            least, last = upper, k
        if min(least, 1.0) - best < enough or best > NEARLY or k - last > PATIENCE:
            break
        while True:
            new = project(
                extrapolated + slope / (stiffness * curvature), stiffness * curvature, budget
            )
            step = new - extrapolated
            attained, _ = field.spend(new / area)
            expected = (
                value
                + float(np.sum(slope * step))
                - stiffness / 2 * float(np.sum(curvature * step**2))
            )
            if attained >= expected - 1e-6:
                break
            stiffness *= 2
        stiffness *= EASE
        if attained > best:
            last = k if attained > best + ENOUGH / 10 else last
            best, best_effort = attained, new
        next_t = (1 + np.sqrt(1 + 4 * t * t)) / 2
        # Restart momentum if it points the wrong way (O'Donoghue and Candes 2015).
        if np.sum((extrapolated - new) * curvature * (new - effort)) > 0:
            t, extrapolated = 1.0, new
        else:
            extrapolated = _shrink(np.maximum(new + (t - 1) / next_t * (new - effort), 0.0), budget)
            t = next_t
        effort = new
    return Bound(min(least, 1.0), best, best_effort)


def _field(
    tracks: Tracks, units: Sequence[Unit], spec: PlanSpec, survival: Sequence[Survival | None]
) -> tuple[allocate.Field, Budget, Array, str]:
    """Return particles in boxes, the budget, box areas [m2] and why there is no bound.

    Areas are multiplied by the rows of their bins.
    """
    widths = np.array([unit.sweep_width for unit in units]).T
    if tracks.turn is not None:
        under_way = np.array([unit.width_under_way or unit.sweep_width for unit in units]).T
        widths = np.concatenate([widths, under_way, np.maximum(widths, under_way)])
    smallest = SMALLEST * float(
        widths.min(where=widths > 0, initial=np.inf) if (widths > 0).any() else 1.0
    )
    plane = record.plane(tracks)
    bins = (
        binned.of_drift(tracks, plane) if tracks.turn is None else binned.of_streams(tracks, plane)
    )
    most = max(float(1 / np.sum(tracks.weight**2)) / BOXES, LEAST)
    box_of, boxes = np.full(bins.there.shape, -1), []
    for first, end in itertools.pairwise(bins.first):
        rows = slice(first, end)
        present = bins.there[rows]
        if present.any():
            x, y = bins.x[rows][present], bins.y[rows][present]
            if tracks.turn is None:
                boxes.append(quadtree.fit(x, y, tracks.weight[present[0]], most, LEAST, smallest))
            else:
                boxes.append(quadtree.halved(x, y, most, LEAST, len(present), smallest))
            box_of[rows][present] = sum(group.count for group in boxes[:-1]) + boxes[-1].of
        else:  # an empty box: nothing can be detected in this bin
            boxes.append(quadtree.Boxes(np.zeros(0, np.int64), *np.zeros((3, 1, 2))))
    counts = [group.count for group in boxes]
    start = np.concatenate([[0], np.cumsum(counts)])
    area = np.concatenate([np.prod(np.maximum(group.sides, smallest), axis=1) for group in boxes])
    # worth does not rise within a row
    value = worth(tracks, survival, spec.objective, bins.edge[:-1])
    fall = value - np.concatenate([value[1:], np.zeros((1, tracks.m))])
    groups = {unit.group or unit.name: unit.shape for unit in units}
    wander, more = _wander(tracks, units)
    curve = concave.curve(
        tuple(dict.fromkeys(unit.law for unit in units)), tuple(groups.values()), wander
    )
    sweep_rates = widths * np.array([unit.search_speed for unit in units])
    if tracks.turn is not None:
        sweep_rates *= np.concatenate([np.ones(more.shape), more, more])
    # the coverage of a random search does not depend on the particles' speed
    slowness = [
        0.0 if laws.formulas_of(unit.law).detects == "anywhere" else 1 / unit.search_speed
        for unit in units
    ]
    field = allocate.Field(
        box_of,
        len(area),
        fall,
        bins.pace,
        _states(tracks, bins.edge, len(units[0].sweep_width)),
        tracks.weight,
        sweep_rates,
        slowness,
        (curve.value, curve.slope, curve.conjugate),
        concave.STEP,
    )
    budget = _budget(tracks, units, spec, bins, boxes, start, plane)
    none = (
        ""
        if tracks.turn is None
        else _unbounded(tracks, units, bins, float(np.median(np.sqrt(area))))
    )
    return field, budget, area * np.repeat(np.diff(bins.first), counts), none


def _wander(tracks: Tracks, units: Sequence[Unit]) -> tuple[float, Array]:
    """Return the smallest wander of bridges, and factors on effort for larger ones.

    Wander is K^2 over the speed and sweep width of a unit, 0 without bridges. The factors have the
    shape (scenarios, units).
    """
    wander = np.zeros((len(units[0].sweep_width), len(units)))
    if tracks.flow is not None:
        k = np.nan_to_num(tracks.flow[2]).max(axis=0)
        for u, unit in enumerate(units):
            for s, width in enumerate(unit.width_under_way or unit.sweep_width):
                if width > 0 and laws.formulas_of(unit.law).detects == "along":
                    wander[s, u] = k[tracks.scenario == s].max(initial=0.0) ** 2 / (
                        unit.search_speed * width
                    )
    if not wander.any():
        return 0.0, np.ones(wander.shape)
    least = float(wander[wander > 0].min())
    h = concave.ROOTS[1:] ** 2
    usual = concave.wandering(h, least)
    factors = [
        np.max(concave.wandering(h, one) / usual) if one > least else 1.0 for one in wander.ravel()
    ]
    return least, np.reshape(factors, wander.shape)


def _unbounded(tracks: Tracks, units: Sequence[Unit], bins: Bins, side: float) -> str:
    """Return a short reason why steering particles allow no bound, or "" if they do.

    side: typical side of a box [m].
    """
    bridged = tracks.flow is not None and bool((np.nan_to_num(tracks.flow[2]) > 0).any())
    if bridged and any(laws.formulas_of(unit.law).detects == "abeam" for unit in units):
        return "none is known for sensors that count passes abeam of targets on Brownian bridges"
    widest = max(max(*unit.sweep_width, *unit.width_under_way, 0.0) for unit in units)
    if float((bins.pace * np.diff(bins.edge)[:, None])[bins.there].mean()) > max(widest, side):
        return "the search object moves too fast for the time bins"
    return ""


def _states(tracks: Tracks, edge: Array, scenarios: int) -> Array:
    """Return the index of each particle's sweep width by state and scenario.

    The states are adrift, under way, or the greater of both during a change; the shape is (r, m).
    If all particles drift, the index is the scenario, shape (m,).
    """
    if tracks.turn is None:
        return tracks.scenario
    state = np.where(
        tracks.turn <= edge[:-1, None], 0, np.where(tracks.turn >= edge[1:, None], 1, 2)
    )
    return np.asarray(state * scenarios + tracks.scenario)


def _budget(
    tracks: Tracks,
    units: Sequence[Unit],
    spec: PlanSpec,
    bins: Bins,
    boxes: Sequence[quadtree.Boxes],
    start: Array,
    plane: record.Plane,
) -> Budget:
    """Return the budget of boxes; start: first box of each bin, shape (b + 1,)."""
    bin_of = np.repeat(np.arange(len(boxes)), np.diff(start))
    low, high = (
        np.concatenate(v) for v in ([group.low for group in boxes], [group.high for group in boxes])
    )
    begin, end = bins.edge[bins.first[:-1]][bin_of], bins.edge[bins.first[1:]][bin_of]
    # A unit need not come nearer to a box than its motion within the bin and a sweep width.
    moved = bins.moved[bin_of]
    spare, total = np.zeros((len(low), len(units))), np.zeros(len(units))
    for u, unit in enumerate(units):
        available = availability.of_unit(unit, spec, (plane.lon, plane.lat))
        x, y = plane.flat(*np.radians(unit.base))
        distance = np.hypot(*np.maximum(np.maximum(low - (x, y), (x, y) - high), 0.0).T)
        widest = max(*unit.sweep_width, *unit.width_under_way, 0.0)
        to_go = np.maximum(distance - moved - widest, 0.0)
        spare[:, u] = available.within(
            begin, end, available.leaves + to_go / available.transit_speed
        )
        ends = laws.formulas_of(unit.law).ends * widest / unit.search_speed
        total[u] = available.search + spec.rounds * ends
        spare[:, u] += (spare[:, u] > 0) * spec.rounds * ends
    return Budget(start, np.maximum.reduceat(spare, start[:-1], axis=0), total, spare > 0)


def _best(slope: Array, budget: Budget) -> tuple[Array, Array]:
    """Return the best slope by bin and unit, (b, units), and each unit's largest gain."""
    top = np.maximum.reduceat(np.where(budget.open, slope, 0.0), budget.start[:-1], axis=0)
    gains = np.zeros(top.shape[1])
    for u in range(top.shape[1]):
        order = np.argsort(-top[:, u], kind="stable")
        spent = np.minimum(np.cumsum(budget.most[order, u]), budget.total[u])
        gains[u] = np.sum(np.diff(spent, prepend=0.0) * top[order, u])
    return top, gains


def _shrink(effort: Array, budget: Budget) -> Array:
    """Return effort scaled down to the budget, first in each bin, then in total."""
    spent_in_bin = np.add.reduceat(effort, budget.start[:-1], axis=0)
    share = np.minimum(1, budget.most / np.maximum(spent_in_bin, 1e-9))
    share *= np.minimum(1, budget.total / np.maximum(np.sum(spent_in_bin * share, axis=0), 1e-9))
    return np.asarray(effort * np.repeat(share, np.diff(budget.start), axis=0))


def _curvature(field: allocate.Field, area: Array) -> Array:
    """Return a diagonal bound of the curvature of -P by box and unit [1/s2]."""
    field.spend(np.zeros(area.shape) * np.ones(field.units))
    return np.asarray(np.maximum(field.gain(squared=True) / area**2, 1e-30))


def project(effort: Array, stiff: Array, budget: Budget) -> Array:
    """Return the nearest effort within the budget, shape (boxes, units).

    It is max(0, effort - price / stiff), where the price in a bin is the larger of the bin's and
    the unit's.

    Args:
        effort: to be projected [s], shape (boxes, units).
        stiff: weights of the squared distance, shape (boxes, units).
        budget: of the units.
    """
    inverse = np.where(budget.open, 1 / stiff, 0.0)
    effort = np.where(budget.open, effort, 0.0)
    first, bins = budget.start[:-1], np.diff(budget.start)

    def spent(price: Array) -> tuple[Array, Array]:
        """Return the effort spent by bin and unit at a price, and its slope."""
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
    low, high = (
        np.zeros(len(budget.total)),
        np.max(np.where(budget.open, effort * stiff, 0), axis=0, initial=0),
    )
    if np.any(np.sum(spent(price)[0], axis=0) > budget.total):
        for _ in range(30):
            middle = (low + high) / 2
            excess = np.sum(spent(np.maximum(price, middle))[0], axis=0) > budget.total
            low, high = np.where(excess, middle, low), np.where(excess, high, middle)
        price = np.where(
            np.sum(spent(price)[0], axis=0) > budget.total, np.maximum(price, high), price
        )
    return np.maximum(effort - np.repeat(price, bins, axis=0) * inverse, 0)
