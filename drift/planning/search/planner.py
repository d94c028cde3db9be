"""Plan the next search on separate particles and score it on those of the case.

Rounds are planned one after the other, each given the failure of those before. The score of a plan
is one minus the evidence of its failure: the same run that a debrief would make.
"""

import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Unpack

import numpy as np

from drift.case.record import Case
from drift.engine.particles.status import STRANDED
from drift.evidence.filter.account import UpdateCallback
from drift.evidence.filter.records import PlanSpec, Unit
from drift.evidence.filter.updates import Updates
from drift.forecast import effective, likeliest, mapped
from drift.forecast.effective import Count
from drift.pipeline import flow
from drift.pipeline.result import Result
from drift.pipeline.run_options import Job, ProgressCallback, RunOptions, serialized
from drift.planning import plans
from drift.planning.plans import Planner, Proposal
from drift.planning.search import bound as bounds
from drift.planning.search import follow, optimiser
from drift.planning.search.boats import daylight, fleet
from drift.planning.search.bound import Bound
from drift.planning.search.products import chapter, subareas
from drift.planning.search.products import text as plan_text
from drift.planning.search.records import Alternative, Plan, Tasking
from geo import notation
from geo.array import Array
from geo.errors import UserError
from geo.notation import format_dtg
from kernels.maths import noise
from kernels.maths.noise import Purpose


@serialized
def plan(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    **options: Unpack[RunOptions],
) -> tuple[Plan, Result]:
    """Plan the next search of a case.

    With `out`, the plan is written together with the forecast of its failure.

    Args:
        case: of `drift.load` or `drift.vary`.
        out: a folder for the results, written completely or not at all; None: nothing is written.
        **options: as in `drift.run`.

    Returns:
        The plan and the forecast. `plan.taskings` has a sub-area, legs [m], times [UTC], track
            spacing [m] and POS (0 to 1) for each sortie; `plan.value` is the objective, POS or the
            probability of finding alive, and `plan.bound` its estimated upper bound. The forecast
            is the `drift.Result` given that the plan found nothing.

    Raises:
        UserError: the case has no `[[unit]]` or `[plan]`, or `drift.run` rejects it; one line for
            each mistake (`error.lines`).
    """
    made = plans.propose(PLANNER, case, out, **options)
    return made.plan, made.result


def check(case: Case) -> None:
    """Raise UserError unless the next search of a case can be planned."""
    if not case.units:
        raise UserError(
            f"{case.path.name}: has no [[unit]] to plan with: "
            "add one with base, search_speed, endurance and sweep_width for each unit"
        )
    plans.check_period(case)
    known = [(sortie.end, f'the end of sortie "{sortie.name}"') for sortie in case.sorties]
    known += [(contact.time, f'contact "{contact.name}"') for contact in case.contacts]
    known += [
        (overdue, f'the time by which scenario "{scenario.name}" is overdue')
        for scenario in case.scenarios
        if scenario.itinerary and (overdue := scenario.itinerary.overdue) is not None
    ]
    known += [
        (max(sensors), "the end of the last look, presence or barrier")
        for sensors in [case.sensors.times]
        if sensors
    ]
    last, what = max(known, default=(case.plan.begin, ""))
    if last > case.plan.begin:
        raise UserError(
            f"{case.path.name}: plan.begin {format_dtg(case.plan.begin)} is before {what}, {format_dtg(last)}: "
            "a plan must begin after everything known; give a later begin in [plan], or leave it out"
        )


@contextmanager
def _propose(job: Job) -> Iterator[Proposal]:
    """Yield the plan of a job with what is reported of it."""
    proposed, executed, result = scheme(job)
    land = partial(fleet.shown, executed, job.where) if job.where.coast is not None else None
    yield Proposal(
        proposed,
        result,
        executed,
        facts=plan_text.plan_facts(proposed),
        numbers=subareas.plan_numbers(proposed),
        texts={"Search action plan": "plan.txt"},
        outputs=[partial(chapter.chapter, land=land)],
        sorties=[tasking.sortie for tasking in proposed.taskings],
        shown=None if proposed.shares is None else likeliest.likeliest_scenarios(proposed.shares),
    )


PLANNER = Planner(check, _propose)


@dataclass(frozen=True)
class _Rounds:
    """Rounds of sorties, each planned given the failure of those before."""

    tasked: Sequence[Tasking]
    executed: Case  # in which all sorties were flown and found nothing
    seen: float  # their value on the planning particles
    alternatives: tuple[Alternative, ...]  # to the last round
    bound: Bound
    bound_number: float  # effective particles on which the bound was found
    made_on: Count  # particles of the last round
    said: tuple[str, ...]  # remarks on boats


def scheme(job: Job, noted: UpdateCallback | None = None) -> tuple[Plan, Case, Result]:
    """Return a plan, the case in which it was executed in vain, and the forecast of that case.

    Args:
        job: the case with its options.
        noted: called for each sortie of that forecast, as drift.evidence.filter.filter does.
    """
    rounds = _rounds(job)
    result = flow.forecast_job(replace(job, case=rounds.executed), noted)
    return _scored_plan(job.case, rounds, result), rounds.executed, result


def _rounds(job: Job) -> _Rounds:
    """Return the rounds of a plan; raise UserError if no unit can search."""
    case, where, clock = job.case, job.where, job.clock
    spec = case.plan
    survival = [scenario.survival for scenario in case.scenarios]
    tasked: list[Tasking] = []
    units, executed = list(case.units), case
    seen, left, proposal, bound, boats, bound_number = 0.0, 1.0, None, None, None, 0.0
    for number in range(1, spec.rounds + 1):
        with clock.phase("follow"):
            tracks = follow.follow(executed, where)
        if boats is None:
            with clock.phase("ways"):
                boats = fleet.prepare(case, where, tracks)
            units = list(boats.units)
        if bound is None:
            bound_number = bounds.counted(tracks)
            with clock.phase("bound"):
                bound = bounds.bound(
                    tracks, _units_of_all_rounds(case.units, spec.rounds), spec, survival
                )
        with clock.phase("plan"):
            report_progress = partial(_report_progress, job.tell, number, spec.rounds)
            seed = noise.seed_for(case.seed, Purpose.OPTIMISER, number)
            proposal = optimiser.plan(
                tracks, units, spec, seed, survival, report_progress, boats.courses
            )
            flown, boats = fleet.checked(boats, proposal.taskings)
        more = [_name_sortie(tasking, number, spec.rounds, case) for tasking in flown]
        if not more:
            break
        tasked += more
        seen += left * proposal.seen
        # POS, not the probability of finding alive: an object found dead is found
        left *= math.prod(1 - tasking.pos for tasking in proposal.taskings)
        units = _units_after(units, more)
        executed = _with_sorties_flown(case, tasked)
    if proposal is None or bound is None or boats is None or not tasked:
        raise UserError(
            f"plan: no unit can search between {format_dtg(spec.begin)} and {format_dtg(spec.until)}: each needs time for its "
            "transit and some search before the end, in daylight if it is visual; give more time (until in [plan]), or "
            "units that are nearer or ready earlier"
            + _night(units, spec)
            + "".join(f". {words}" for words in (boats.said if boats else ()))
        )
    made_on = Count(effective.number(tracks.weight), len(tracks.weight))
    return _Rounds(
        tasked, executed, seen, proposal.alternatives, bound, bound_number, made_on, boats.said
    )


def _night(units: Sequence[Unit], spec: PlanSpec) -> str:
    """Return the units that the plan's period leaves without daylight, as text; "" if none."""
    begin, until = (float(notation.epoch(time)) for time in (spec.begin, spec.until))
    dark = [
        unit for unit in units if unit.daylight and not daylight.windows(begin, until, *unit.base)
    ]
    if not dark:
        return ""
    names = ", ".join(unit.name for unit in dark)
    words = f". Night throughout for {names}: a unit searches by day unless it has daylight = false"
    rises = daylight.windows(until, until + 86_400, *dark[0].base)
    if rises:
        sunrise = format_dtg(np.datetime64(round(rises[0][0]), "s"))
        words += f"; next sunrise {sunrise}"
    return words


def _scored_plan(case: Case, rounds: _Rounds, result: Result) -> Plan:
    """Return the plan with its value, taken from the forecast in which it was executed."""
    assert result.updates is not None
    spec, bound = case.plan, rounds.bound
    updates = plans.updates_of(result, [tasking.sortie for tasking in rounds.tasked])
    missed = np.prod([1 - np.asarray(update.pos) for update in updates], axis=0)
    alive, ashore, so_far = 0.0, 0.0, 1.0
    for update in updates:
        ashore += so_far * float(np.asarray(update.ashore)[-1])
        alive += so_far * float(
            np.asarray(update.pos if update.alive is None else update.alive)[-1]
        )
        so_far *= 1 - float(np.asarray(update.pos)[-1])
    pos = 1 - float(missed[-1])
    taskings = tuple(
        replace(
            tasking,
            pos=float(np.asarray(update.pos)[-1]),
            pos_ashore=float(np.asarray(update.ashore)[-1]),
        )
        for tasking, update in zip(rounds.tasked, updates, strict=True)
    )
    value = alive if spec.objective == "alive" else pos
    scored_on = _effective_number(result, rounds.executed, spec.begin)
    error = _error(bound.value, rounds.bound_number, value, scored_on)
    why = bounds.silent(bound.value, rounds.bound_number, error, rounds.seen, value, bound.none)
    sent = {tasking.unit.name for tasking in taskings}
    return Plan(
        spec=spec,
        taskings=taskings,
        value=value,
        pos=pos,
        by_scenario=1 - missed[:-1],
        seen=rounds.seen,
        bound=None if why else bound.value,
        bound_error=error,
        unbounded=why,
        alternatives=rounds.alternatives if spec.rounds == 1 else (),
        scenarios=tuple(scenario.name for scenario in case.scenarios),
        families=tuple(
            scenario.family.family.name if scenario.family else None for scenario in case.scenarios
        ),
        shares=_prior_by_scenario(result.updates, updates[0].name),
        made_on=rounds.made_on,
        scored_on=scored_on,
        ashore=_ashore(result, spec.begin),
        pos_ashore=ashore,
        idle=tuple(unit.name for unit in case.units if unit.name not in sent),
        said=rounds.said,
    )


def _prior_by_scenario(updates: Updates, name: str) -> Array:
    """Return the probability of each scenario before an update."""
    number = [update.name for update in updates.all].index(name)
    return np.asarray(updates.all[number - 1].posterior if number else updates.prior, float)


def _ashore(result: Result, begin: np.datetime64) -> float:
    """Return the probability that the object is ashore or aground when a plan begins."""
    data = result.forecast.data
    then = data["status_probability"].isel(time=mapped.opening_output(data, begin))
    return float(
        then.where(then["status"].isin([status.name.lower() for status in STRANDED])).sum()
    )


def _effective_number(result: Result, executed: Case, begin: np.datetime64) -> Count:
    """Return the effective number of the case's particles when a plan begins."""
    data = result.forecast.data
    return effective.effective_at(data, mapped.opening_output(data, begin), executed.particles)


def _error(bound: float, bound_number: float, value: float, scored_on: Count) -> float:
    """Return the standard error of a bound less the value of a plan.

    Both are means: the bound over `bound_number` effective particles, the value over those of
    `scored_on`.
    """
    counts = max(bound_number, 1.0), max(scored_on.number, 1.0)
    return math.sqrt(sum(p * (1 - p) / n for p, n in zip((bound, value), counts, strict=True)))


def _report_progress(tell: ProgressCallback, number: int, rounds: int, share: float) -> None:
    """Report the progress over all rounds."""
    tell("plan", (number - 1 + share) / rounds)


def _name_sortie(tasking: Tasking, number: int, rounds: int, case: Case) -> Tasking:
    """Return a tasking of a round whose sortie has a unique name."""
    name = f"{tasking.unit.name}, planned" + (f" {number}" if rounds > 1 else "")
    name = plans.sortie_name(case, name)
    return replace(
        tasking, round=number, sortie=replace(tasking.sortie, name=name, ashore=case.plan.ashore)
    )


def _with_sorties_flown(case: Case, tasked: Sequence[Tasking]) -> Case:
    """Return a case in which a plan's sorties have been flown, with an output for plan.png."""
    first = [tasking for tasking in tasked if tasking.round == 1]
    begin, end = (
        min(tasking.on_scene for tasking in first),
        max(tasking.off_scene for tasking in first),
    )
    sorties = [tasking.sortie for tasking in tasked]
    return plans.with_sorties(case, sorties, [begin + (end - begin) // 2])


def _units_after(units: Sequence[Unit], flown: Sequence[Tasking]) -> list[Unit]:
    """Return the units with the time at which each is ready after its sortie."""
    home = {tasking.unit.name: tasking.home for tasking in flown}
    return [
        replace(
            unit,
            ready=max(unit.ready, home[unit.name] + np.timedelta64(round(unit.turnaround), "s")),
        )
        if unit.name in home
        else unit
        for unit in units
    ]


def _units_of_all_rounds(units: Sequence[Unit], rounds: int) -> list[Unit]:
    """Return units with the endurance of all rounds together.

    Their bound is valid for several rounds.
    """
    return [replace(unit, endurance=unit.endurance * rounds) for unit in units]
