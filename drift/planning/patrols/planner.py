"""Patrol planning: which stretches to visit so that teams find most objects on average.

A team finds an object that lies on its stretch with the team's detection probability, unless the
object was reported, buried, refloated or found before. That is the model of
drift.spills.worlds.exposure, averaged over the worlds with their weights given the finds. Visits to
a stretch have diminishing returns, so a plan chooses one set of visits for each stretch within each
team's daily length of shore, by an integer programme (HiGHS). That programme may count an object
twice if it refloats and lands again on another stretch. The plan's reported figures are computed
over all visits at once and count it once. The bound counts it twice, which keeps it an upper bound.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drift.engine.motion.period import Period
from drift.engine.particles import partials
from drift.engine.particles.partials import Partial
from drift.planning.patrols.access import Walkable
from drift.spills.worlds import estimate, exposure, finds, renewal
from drift.spills.worlds.exposure import Exposure
from drift.spills.worlds.records import Team
from drift.spills.worlds.renewal import SpillResult
from geo import notation
from geo.array import Array, Real
from geo.coast.segments import Segments
from geo.errors import UserError

VISITS = 3  # most visits of one stretch in a plan
# most sets of visits in one integer programme; beyond it the plan is made day by day
CHOICES = 6_000
TRIFLE = 0.01  # least share of its patrol's finds that a visit must add
LEAST = 1e-7  # share of the best visit's worth below which a visit is not considered
SECONDS = 60.0  # time limit of the solver
GAP = 1e-4  # relative gap at which the solver may stop
DAY = 86_400


@dataclass(frozen=True)
class Slot:
    """One possible patrol: a team and a time."""

    team: Team
    when: np.datetime64
    time: int  # [s after start]
    # indices of reachable stretches that are no longer than the team's daily length
    reachable: tuple[int, ...]
    stays: bool = False  # all patrols of its team lie on one land mass


@dataclass(frozen=True)
class Visit:
    """A visit of one stretch on one patrol of a plan."""

    slot: Slot
    segment: int
    # expected number of objects lying there, without those that earlier visits find
    lying: float
    found: float  # expected number that it finds
    error: float  # standard error of `found`


@dataclass(frozen=True)
class LeftOut:
    """A reachable stretch with objects that is longer than the team's daily length."""

    team: Team
    segment: int
    lying: float  # expected number of objects lying there at the team's first patrol


@dataclass(frozen=True)
class PatrolPlan:
    """The visits by time, and the expected number of objects that all of them find."""

    visits: tuple[Visit, ...]
    found: float
    error: float
    bound: float  # no plan of at most VISITS visits a stretch finds more on average
    daily: bool  # whether plan and bound were made day by day
    idle: tuple[str, ...]  # teams without a visit
    slots: tuple[Slot, ...]
    left_out: tuple[LeftOut, ...] = ()  # by team in the order of the case, most first
    notes: tuple[str, ...] = ()  # where bases on water were moved to


# indices of the visiting patrols, ascending, by stretch
Chosen = dict[int, tuple[int, ...]]


def plan(after: SpillResult, walkable: Walkable) -> PatrolPlan:
    """Return the best plan of a spill's teams.

    Args:
        after: the spill's result; the files of its run must be open.
        walkable: the reachable stretches of all teams.
    """
    slots = patrols(after.period, after.segments, walkable)
    known, worth = after.posterior.known, _value(after)
    reach = sorted({s for slot in slots for s in slot.reachable})
    teams, length = after.spill.teams, known.length
    long = [
        (team, s) for team in teams for s in walkable.of(team).stretches if length[s] > team.length
    ]
    parts: dict[int, list[Partial]] = {s: [] for s in reach}
    left: list[list[Partial]] = [[] for _ in long]
    for part in after.fates.parts():
        stays, own = (
            exposure.expose(part, known.reporting, known.patrols),
            worth[part.world, part.kind],
        )
        for s in reach:
            parts[s].append(stretch_table(stays, s, own, slots))
        for (team, s), sums in zip(long, left, strict=True):
            sums.append(_lying(stays, s, own, [float(after.period.elapsed(team.times[0]))]))
    tables = {s: partials.merge_partials(own).total[:-1] for s, own in parts.items()}
    chosen, bound, daily = choose(tables, length, slots, walkable.mass)
    planned = _scored(after, slots, worthwhile(tables, slots, chosen), bound, daily, worth)
    lying = [float(partials.merge_partials(sums).total.sum()) for sums in left]
    rows = [
        LeftOut(team, s, number)
        for (team, s), number in zip(long, lying, strict=True)
        if number > 0
    ]
    notes = tuple(access.note for access in walkable.teams if access.note)
    left_out = tuple(sorted(rows, key=lambda row: (teams.index(row.team), -row.lying)))
    return replace(planned, left_out=left_out, notes=notes)


def _value(after: SpillResult) -> Real:
    """Return the number of unfound objects that a particle of each world and class stands for.

    The shape is (W, classes). The remaining objects of a world and class are shared among its
    particles by their probability of not having been found. The value applies to a particle that
    has not been found: its share divided by that probability.
    """
    left = finds.remaining_objects(after.posterior) * after.posterior.weight[:, None]
    shared, _ = renewal.unfound_chances(after.fates, after.posterior.known)
    return np.asarray(left / np.maximum(shared, 1e-300))


def stretch_table(stays: Exposure, segment: int, worth: Real, slots: Sequence[Slot]) -> Partial:
    """Return the objects on a stretch at each patrol, by the first patrol that can meet them.

    Args:
        stays: stays of particles on stretches.
        segment: index of the stretch.
        worth: number of objects that each particle stands for, shape (n,).
        slots: the patrols by time (M).

    Returns:
        Sums by block, of shape (M + 1, M). Row i holds objects that arrive between patrols i - 1
            and i (last row: after all patrols), column j those still there at patrol j.
    """
    return _lying(stays, segment, worth, [float(slot.time) for slot in slots])


def _lying(stays: Exposure, segment: int, worth: Real, times: Sequence[float]) -> Partial:
    """Return the objects on a stretch at some times, by the first time after arrival."""
    rows = slice(int(stays.bounds[segment]), int(stays.bounds[segment + 1]))
    slot, first = stays.slot[rows], np.searchsorted(times, stays.arrival[rows])
    there = [exposure.lying_probability(stays, segment, time) * worth[slot] for time in times]
    return stays.fates.blocks.partial(*there, code=first, many=len(times) + 1, slots=slot)


def expected(lying: Real, detection: Sequence[float], visits: Sequence[int]) -> float:
    """Return the expected number of objects that visits of a stretch find.

    Args:
        lying: objects on the stretch by patrol, of `stretch_table`.
        detection: probability of detection by patrol.
        visits: indices of the patrols that visit the stretch, ascending.
    """
    total, missed = 0.0, np.ones(len(lying))
    for j in visits:
        arrived = np.arange(len(lying)) <= j
        total += float((lying[:, j] * missed)[arrived].sum()) * detection[j]
        missed = np.where(arrived, missed * (1 - detection[j]), missed)
    return total


def worthwhile(tables: dict[int, Real], slots: Sequence[Slot], chosen: Chosen) -> Chosen:
    """Return the visits without those that add less than TRIFLE to their patrol.

    Such visits only fill up the patrol's length and are not worth the way to the stretch.
    """
    detection = [slot.team.detection for slot in slots]
    adds = {
        (j, s): expected(tables[s], detection, visits)
        - expected(tables[s], detection, [k for k in visits if k != j])
        for s, visits in chosen.items()
        for j in visits
    }
    patrol = [sum(gain for (k, _), gain in adds.items() if k == j) for j in range(len(slots))]
    kept = {
        s: tuple(j for j in visits if adds[j, s] >= TRIFLE * patrol[j])
        for s, visits in chosen.items()
    }
    return {s: visits for s, visits in kept.items() if visits}


def choose(
    tables: dict[int, Real], length: Real, slots: Sequence[Slot], mass: Array | None = None
) -> tuple[Chosen, float, bool]:
    """Return the visits of each stretch, a bound, and whether both were made day by day.

    Earlier visits only reduce what later ones find, so the sum of the best of each day alone is a
    bound.

    Args:
        tables: objects by stretch and patrol, of `stretch_table`.
        length: of the stretches [m], shape (S,).
        slots: the patrols by time.
        mass: land mass of each stretch, shape (S,); None: all are on one. Teams that stay on one
            land mass have all patrols there.
    """
    reach = [set(slot.reachable) for slot in slots]
    all_patrols = range(len(slots))
    best = max(
        (lying[: j + 1, j].sum() for lying in tables.values() for j in all_patrols), default=0.0
    )
    worthy = [
        s
        for s, lying in tables.items()
        if any(s in reach[j] and lying[: j + 1, j].sum() > LEAST * best for j in all_patrols)
    ]
    rest = sum(  # the bound must include stretches that are not considered
        float(lying[: j + 1, j].sum()) * slots[j].team.detection
        for s, lying in tables.items()
        for j in all_patrols
        if s in reach[j] and s not in worthy
    )
    if sum(sum(1 for _ in _sets(all_patrols, s, reach)) for s in worthy) <= CHOICES:
        chosen, bound = _solve(tables, length, slots, worthy, all_patrols, {}, mass)
        return chosen, bound + rest, False
    begin = slots[0].time
    days = itertools.groupby(all_patrols, key=lambda j: (slots[j].time - begin) // DAY)
    chosen, bound = {}, rest
    for _, group in days:
        today = list(group)
        bound += _solve(tables, length, slots, worthy, today, {}, mass)[1]
        for s, visits in _solve(tables, length, slots, worthy, today, chosen, mass)[0].items():
            chosen[s] = (*chosen.get(s, ()), *visits)
    return chosen, bound, True


def _sets(
    slots: Sequence[int], segment: int, reach: Sequence[set[int]]
) -> Iterator[tuple[int, ...]]:
    """Yield the sets of visits that a stretch can have."""
    can = [j for j in slots if segment in reach[j]]
    for count in range(1, min(len(can), VISITS) + 1):
        yield from itertools.combinations(can, count)


def _solve(
    tables: dict[int, Real],
    length: Real,
    slots: Sequence[Slot],
    worthy: Sequence[int],
    today: Sequence[int],
    before: Chosen,
    mass: Array | None,
) -> tuple[Chosen, float]:
    """Return the best visits of some patrols, and a bound of what they find.

    length: of the stretches [m], (S,). worthy: stretches to choose from. today: indices of the
    patrols. before: visits on earlier patrols. mass: as in `choose`.
    """
    from scipy import optimize, sparse  # here: a run that plans nothing needs neither

    detection = [slot.team.detection for slot in slots]
    reach = [set(slot.reachable) for slot in slots]
    mass_of = {s: 0 if mass is None else int(mass[s]) for s in worthy}
    taken = {
        _stay(slots[j], mass_of[s])
        for s, visits in before.items()
        for j in visits
        if slots[j].stays
    }
    # Land masses to which a team restricted to one may no longer be sent.
    closed = {(team, m) for team, _ in taken for m in mass_of.values() if (team, m) not in taken}
    columns = [
        (s, visits)
        for s in worthy
        for visits in _sets(today, s, reach)
        if len(before.get(s, ())) + len(visits) <= VISITS
        and not any(_stay(slots[j], mass_of[s]) in closed for j in visits)
    ]
    if not columns:
        return {}, 0.0
    base = {s: expected(tables[s], detection, before.get(s, ())) for s in worthy}
    gain = np.array(
        [
            expected(tables[s], detection, (*before.get(s, ()), *visits)) - base[s]
            for s, visits in columns
        ]
    )
    stretch_row = {s: row for row, s in enumerate(worthy)}
    rows = [stretch_row[s] for s, _ in columns]
    # One more column for each pair of restricted team and land mass: 1 if the team goes there.
    stays = list(
        dict.fromkeys(
            _stay(slots[j], mass_of[s]) for s, visits in columns for j in visits if slots[j].stays
        )
    )
    stay_column = {stay: len(columns) + k for k, stay in enumerate(stays)}
    width = len(columns) + len(stays)
    sets_of_stretch = sparse.csr_array(
        (np.ones(len(columns)), (rows, range(len(columns)))), (len(worthy), width)
    )
    # A patrol walks at most its length; a restricted team only on the land mass to which it goes.
    limits = {
        (j, mass_of[s] if slots[j].stays else None): None for s, visits in columns for j in visits
    }
    limit_row = {limit: row for row, limit in enumerate(limits)}
    uses = [
        (limit_row[j, mass_of[s] if slots[j].stays else None], k, length[s])
        for k, (s, visits) in enumerate(columns)
        for j in visits
    ]
    most = [slots[j].team.length * (1 + 1e-9) for j, _ in limits]
    uses += [
        (row, stay_column[_stay(slots[j], m)], -most[row])
        for (j, m), row in limit_row.items()
        if m is not None
    ]
    row, column, amount = zip(*uses, strict=True)
    length_of_patrol = sparse.csr_array((amount, (row, column)), (len(limits), width))
    room = np.where([m is None for _, m in limits], most, 0.0)
    constraints = [
        optimize.LinearConstraint(sets_of_stretch, ub=np.ones(len(worthy))),
        optimize.LinearConstraint(length_of_patrol, ub=room),
    ]
    if stays:
        teams = list(dict.fromkeys(name for name, _ in stays))
        ones = [(teams.index(name), stay_column[name, m]) for name, m in stays]
        one_mass = sparse.csr_array(
            (np.ones(len(ones)), tuple(zip(*ones, strict=True))), (len(teams), width)
        )
        constraints.append(optimize.LinearConstraint(one_mass, ub=np.ones(len(teams))))
    scale = max(float(gain.max()), 1e-300)
    solution = optimize.milp(
        np.concatenate([-gain / scale, np.zeros(len(stays))]),
        integrality=np.ones(width),
        bounds=optimize.Bounds(0, 1),
        constraints=constraints,
        options={"time_limit": SECONDS, "mip_rel_gap": GAP},
    )
    # No solution within the time limit: plan nothing; the bound takes each stretch's best set.
    if solution.x is None:
        return {}, float(np.maximum.reduceat(gain, np.flatnonzero(np.diff([-1, *rows]))).sum())
    chosen = {
        columns[k][0]: columns[k][1] for k in np.flatnonzero(solution.x[: len(columns)] > 0.5)
    }
    return chosen, float(-solution.mip_dual_bound * scale)


def _stay(slot: Slot, mass: int) -> tuple[str, int]:
    """Return the pair of team and land mass."""
    return slot.team.name, mass


def patrols(period: Period, segments: Segments, walkable: Walkable) -> tuple[Slot, ...]:
    """Return the patrols that a spill's teams can make, by time.

    Raises UserError for a team that can reach no stretch.
    """
    slots = []
    for access in walkable.teams:
        team, near = access.team, list(access.stretches)
        place = f'patrol_unit "{team.name}"'
        short = tuple(s for s in near if segments.length[s] <= team.length)
        if not short:
            what = (
                f"the shortest is {segments.length[near].min() / 1000:.1f} km"
                if near
                else "its reach holds none"
            )
            raise UserError(
                f"{place}: no stretch that it can reach is at most {team.length / 1000:.1f} km long, its length a day: "
                f"{what}; give a greater length or reach, or make stretches shorter ([spill.stretches] length)"
            )
        slots += [
            Slot(team, when, period.elapsed(when), short, access.stays) for when in team.times
        ]
    return tuple(sorted(slots, key=lambda slot: slot.time))


def _scored(
    after: SpillResult,
    slots: tuple[Slot, ...],
    chosen: Chosen,
    bound: float,
    daily: bool,
    worth: Real,
) -> PatrolPlan:
    """Return the plan with its figures, computed over all visits at once."""
    known, fates, weight = after.posterior.known, after.fates, after.posterior.weight
    order = sorted((j, s) for s, visits in chosen.items() for j in visits)
    planned = tuple(exposure.Walk((s,), slots[j].time, slots[j].team.detection) for j, s in order)
    by_world = np.zeros((len(order), fates.worlds))
    for part in fates.parts():
        stays = exposure.expose(part, known.reporting, (*known.patrols, *planned))
        # number of objects that a particle stands for, given its world
        in_world = worth[part.world, part.kind] / np.maximum(weight[part.world], 1e-300)
        for k, (_, s) in enumerate(order):
            rows, chance = exposure.patrol_probability(stays, s, len(known.patrols) + k)
            slot = stays.slot[rows]
            by_world[k, part.here] = np.bincount(
                part.world[slot] - part.here.start, chance * in_world[slot], part.many
            )
    total, visits = np.zeros(fates.worlds), list[Visit]()
    for (j, s), own in zip(order, by_world, strict=True):
        total += own
        mean, error = _mean(own, weight)
        visits.append(Visit(slots[j], s, mean / slots[j].team.detection, mean, error))
    found, error = _mean(total, weight)
    busy = {visit.slot.team.name for visit in visits}
    idle = tuple(team.name for team in after.spill.teams if team.name not in busy)
    return PatrolPlan(tuple(visits), found, error, bound, daily, idle, slots)


def _mean(by_world: Real, weight: Real) -> tuple[float, float]:
    """Return the mean over worlds and its standard error."""
    mean, error = estimate.mean(by_world[:, None], weight, np.array([0]), float(np.sum(weight**2)))
    return float(mean[0, 0]), float(error[0, 0])


def by_patrol(plan: PatrolPlan) -> list[tuple[Slot, list[Visit]]]:
    """Return the visits of each patrol that has any, by time and team."""
    visits = [(slot, [visit for visit in plan.visits if visit.slot is slot]) for slot in plan.slots]
    return [(slot, of_slot) for slot, of_slot in visits if of_slot]


def heading(slot: Slot) -> str:
    """Return the name of a planned patrol: its team and time."""
    return f"{slot.team.name}, {notation.format_dtg(slot.when)}"
