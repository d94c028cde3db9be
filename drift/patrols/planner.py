"""Which stretches to patrol next: the expected number of objects that the teams of a spill's case find, as large as it can be.

An object that lies on a stretch when a team comes is found with the team's detection, unless it was reported, buried,
refloated or found before: SPILL's model (drift.spill.exposure), over the worlds as the finds weigh them. Stretches are
then worth what the visits to each are worth, with diminishing returns: a choice of one set of visits a stretch under
each team's length of shore a day, solved as an integer programme (HiGHS). What refloats and lands anew may be counted
on two stretches by that; the figures told are reckoned without, over all visits at once, and the bound holds all the
more.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from drift.motion.period import Period
from drift.spill import estimate, evidence, exposure, finds
from drift.spill.exposure import Exposure
from drift.spill.records import Spill, Team
from drift.spill.renewal import Aftermath
from geo import notation, sphere
from geo.array import Real
from geo.coast.segments import Segments
from geo.errors import UserError

VISITS = 3  # of one stretch that a plan has at most
CHOICES = 6_000  # sets of visits that are chosen from at once; of more, day by day
TRIFLE = 0.01  # of what its patrol finds, that a visit must add
LEAST = 1e-7  # of the best visit's worth under which a visit is not looked at
SECONDS = 60.0  # that the solver may take
GAP = 1e-4  # relative, at which it may stop
DAY = 86_400


@dataclass(frozen=True)
class Slot:
    """One patrol that a team can make."""

    team: Team
    when: np.datetime64
    time: int  # [s after start]
    reachable: tuple[int, ...]  # numbers of stretches that it can go to, each no longer than its day


@dataclass(frozen=True)
class Visit:
    """One stretch on one patrol of a plan."""

    slot: Slot
    segment: int
    lying: float  # expected number of objects there to be found, those that visits before it find left out
    found: float  # expected number that it finds
    error: float  # its standard error


@dataclass(frozen=True)
class PatrolPlan:
    """Visits by time, and what all of them are expected to find."""

    visits: tuple[Visit, ...]
    found: float
    error: float
    bound: float  # no plan of at most VISITS visits a stretch finds more on average
    daily: bool  # whether it was made day by day, and the bound with it
    idle: tuple[str, ...]  # teams with nothing to do
    slots: tuple[Slot, ...]


def plan(after: Aftermath) -> PatrolPlan:
    """Return the plan of a spill's teams."""
    slots = patrols(after.period, after.spill, after.segments)
    here = exposure.expose(after.fates, after.posterior.known.reporting, after.posterior.known.patrols)
    worth = value(after)
    tables = {s: table(here, s, worth, slots) for s in sorted({s for slot in slots for s in slot.reachable})}
    length = after.posterior.known.length
    chosen, bound, daily = choose(tables, length, slots)
    chosen = worthwhile(tables, slots, chosen)
    return _told(after, slots, chosen, bound, daily, worth)


def value(after: Aftermath) -> Real:
    """Return how many of the objects not yet found each particle stands for, per its chance of not having been found, (n,)."""
    told, fates = after.posterior, after.fates
    left = finds.remaining(told) * told.weight[:, None]
    cell = fates.world.astype(np.int64) * left.shape[1] + fates.kind
    unfound = np.bincount(cell, 1 - told.found, left.size)
    return np.asarray((left.ravel() / np.maximum(unfound, 1e-300))[cell])


def table(here: Exposure, segment: int, worth: Real, slots: Sequence[Slot]) -> Real:
    """Return what lies on a stretch at each patrol by the first patrol that could meet it, (M, M).

    Row i: what comes between the patrols i - 1 and i; column j: how much of it is still there at j.
    """
    rows = slice(int(here.bounds[segment]), int(here.bounds[segment + 1]))
    times = np.array([slot.time for slot in slots])
    first = np.searchsorted(times, here.arrival[rows])
    found = np.zeros((len(slots) + 1, len(slots)))
    for j, time in enumerate(times):
        lies = exposure.lying(here, segment, float(time)) * worth[here.slot[rows]]
        found[:, j] = np.bincount(first, lies, len(slots) + 1)
    return found[:-1]


def expected(lies: Real, detection: Sequence[float], visits: Sequence[int]) -> float:
    """Return the expected number that visits of a stretch find; lies: of `table`; visits: numbers of patrols, ascending."""
    total, missed = 0.0, np.ones(len(lies))
    for j in visits:
        come = np.arange(len(lies)) <= j
        total += float((lies[:, j] * missed)[come].sum()) * detection[j]
        missed = np.where(come, missed * (1 - detection[j]), missed)
    return total


def worthwhile(
    tables: dict[int, Real], slots: Sequence[Slot], chosen: dict[int, tuple[int, ...]]
) -> dict[int, tuple[int, ...]]:
    """Return visits without those that add less than TRIFLE to their patrol: they fill its length, and are not worth the way."""
    detection = [slot.team.detection for slot in slots]
    adds = {
        (j, s): expected(tables[s], detection, some) - expected(tables[s], detection, [k for k in some if k != j])
        for s, some in chosen.items()
        for j in some
    }
    patrol = [sum(gain for (k, _), gain in adds.items() if k == j) for j in range(len(slots))]
    kept = {s: tuple(j for j in some if adds[j, s] >= TRIFLE * patrol[j]) for s, some in chosen.items()}
    return {s: some for s, some in kept.items() if some}


def choose(
    tables: dict[int, Real], length: Real, slots: Sequence[Slot]
) -> tuple[dict[int, tuple[int, ...]], float, bool]:
    """Return the visits of each stretch, a bound of what any visits find, and whether both were made day by day.

    Visits before only take away from what later ones find, so that the best of each day by itself add up to a bound.
    """
    reach = [set(slot.reachable) for slot in slots]
    best = max((lies[: j + 1, j].sum() for lies in tables.values() for j in range(len(slots))), default=0.0)
    worthy = [
        s
        for s, lies in tables.items()
        if any(s in reach[j] and lies[: j + 1, j].sum() > LEAST * best for j in range(len(slots)))
    ]
    every = range(len(slots))
    rest = sum(  # what is not looked at could be found too
        float(lies[: j + 1, j].sum()) * slots[j].team.detection
        for s, lies in tables.items()
        for j in every
        if s in reach[j] and s not in worthy
    )
    if sum(sum(1 for _ in _sets(every, s, reach)) for s in worthy) <= CHOICES:
        chosen, bound = _solve(tables, length, slots, worthy, every, {})
        return chosen, bound + rest, False
    begin = slots[0].time
    days = itertools.groupby(every, key=lambda j: (slots[j].time - begin) // DAY)
    chosen, bound = {}, rest
    for _, group in days:
        today = list(group)
        bound += _solve(tables, length, slots, worthy, today, {})[1]
        for s, more in _solve(tables, length, slots, worthy, today, chosen)[0].items():
            chosen[s] = (*chosen.get(s, ()), *more)
    return chosen, bound, True


def _sets(slots: Sequence[int], segment: int, reach: Sequence[set[int]]) -> Iterator[tuple[int, ...]]:
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
    before: dict[int, tuple[int, ...]],
) -> tuple[dict[int, tuple[int, ...]], float]:
    """Return the best visits of some patrols, given those before, and a bound of what they find."""
    from scipy import optimize, sparse  # here: a run that plans nothing needs neither

    detection = [slot.team.detection for slot in slots]
    reach = [set(slot.reachable) for slot in slots]
    columns = [
        (s, some) for s in worthy for some in _sets(today, s, reach) if len(before.get(s, ())) + len(some) <= VISITS
    ]
    if not columns:
        return {}, 0.0
    base = {s: expected(tables[s], detection, before.get(s, ())) for s in worthy}
    gain = np.array([expected(tables[s], detection, (*before.get(s, ()), *some)) - base[s] for s, some in columns])
    number = {s: k for k, s in enumerate(worthy)}
    place = {j: k for k, j in enumerate(today)}
    one = sparse.csr_array(
        (np.ones(len(columns)), ([number[s] for s, _ in columns], range(len(columns)))), (len(worthy), len(columns))
    )
    uses = [(place[j], k, length[s]) for k, (s, some) in enumerate(columns) for j in some]
    row, column, amount = zip(*uses, strict=True)
    day = sparse.csr_array((amount, (row, column)), (len(today), len(columns)))
    scale = max(float(gain.max()), 1e-300)
    found = optimize.milp(
        -gain / scale,
        integrality=np.ones(len(columns)),
        bounds=optimize.Bounds(0, 1),
        constraints=[
            optimize.LinearConstraint(one, ub=np.ones(len(worthy))),
            optimize.LinearConstraint(day, ub=np.array([slots[j].team.length for j in today]) * (1 + 1e-9)),
        ],
        options={"time_limit": SECONDS, "mip_rel_gap": GAP},
    )
    if found.x is None:  # within its time it found none: nothing is planned, and everything could be found
        return {}, float(
            np.maximum.reduceat(gain, np.flatnonzero(np.diff([-1, *(number[s] for s, _ in columns)]))).sum()
        )
    chosen = {columns[k][0]: columns[k][1] for k in np.flatnonzero(found.x > 0.5)}
    return chosen, float(-found.mip_dual_bound * scale)


def patrols(period: Period, spill: Spill, segments: Segments) -> tuple[Slot, ...]:
    """Return the patrols that a spill's teams can make, by time; raise UserError for a team that can go nowhere."""
    found = []
    for team in spill.teams:
        place = f'patrol_unit "{team.name}"'
        if team.stretches:
            near = [evidence.named(name, place, segments) for name in dict.fromkeys(team.stretches)]
        elif team.base is not None:
            lon, lat = np.radians(team.base)
            away = sphere.distance(lon, lat, np.radians(segments.lon), np.radians(segments.lat))
            near = np.flatnonzero(away <= team.reach).tolist()
        else:
            near = list(range(len(segments.name)))
        short = tuple(s for s in near if segments.length[s] <= team.length)
        if not short:
            what = f"the shortest is {segments.length[near].min() / 1000:.1f} km" if near else "its reach holds none"
            raise UserError(
                f"{place}: no stretch that it can reach is at most {team.length / 1000:.1f} km long, its length a day: {what}; give a "
                "greater length or reach, or make stretches shorter ([spill.stretches] length)"
            )
        found += [Slot(team, when, period.elapsed(when), short) for when in team.times]
    return tuple(sorted(found, key=lambda slot: slot.time))


def _told(
    after: Aftermath,
    slots: tuple[Slot, ...],
    chosen: dict[int, tuple[int, ...]],
    bound: float,
    daily: bool,
    worth: Real,
) -> PatrolPlan:
    """Return a plan with its figures, reckoned over all visits at once."""
    known, fates, weight = after.posterior.known, after.fates, after.posterior.weight
    visits = sorted((j, s) for s, some in chosen.items() for j in some)
    planned = tuple(exposure.Patrol((s,), slots[j].time, slots[j].team.detection) for j, s in visits)
    here = exposure.expose(fates, known.reporting, (*known.patrols, *planned))
    share = worth / np.maximum(weight[fates.world], 1e-300)  # of a world by itself
    total, made = np.zeros(fates.worlds), list[Visit]()
    for k, (j, s) in enumerate(visits, len(known.patrols)):
        rows, chance = exposure.searched(here, s, k)
        owner = here.slot[rows]
        by_world = np.bincount(fates.world[owner], chance * share[owner], fates.worlds).astype(float)
        total += by_world
        mean, error = _mean(by_world, weight)
        made.append(Visit(slots[j], s, mean / slots[j].team.detection, mean, error))
    found, error = _mean(total, weight)
    busy = {visit.slot.team.name for visit in made}
    idle = tuple(team.name for team in after.spill.teams if team.name not in busy)
    return PatrolPlan(tuple(made), found, error, bound, daily, idle, slots)


def _mean(by_world: Real, weight: Real) -> tuple[float, float]:
    """Return the mean over worlds and its standard error."""
    mean, error = estimate.mean(by_world[:, None], weight, np.array([0]), float(np.sum(weight**2)))
    return float(mean[0, 0]), float(error[0, 0])


def by_patrol(made: PatrolPlan) -> list[tuple[Slot, list[Visit]]]:
    """Return the visits of each patrol that has any, by time and team."""
    return [(slot, some) for slot in made.slots if (some := [visit for visit in made.visits if visit.slot is slot])]


def heading(slot: Slot) -> str:
    """Return the name of a patrol that is planned: its team and day."""
    return f"{slot.team.name}, {notation.group(slot.when)}"
