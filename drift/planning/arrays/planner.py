"""Plan the next watch of towed arrays: each ship's start, courses and turn.

Ways are chosen on separate planning particles (drift.planning.search.follow). The plan's POD comes
from the case's own run, with the planned watches carried out and nothing heard.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Unpack

import numpy as np

from drift.case.record import Case
from drift.engine.environment import coastline
from drift.evidence.filter.records import Law, Sortie
from drift.pipeline import flow
from drift.pipeline.result import Result
from drift.pipeline.run_options import Job, RunOptions, serialized
from drift.planning import plans
from drift.planning.arrays import chapter, placement, placement_bound, placement_text, ways
from drift.planning.arrays.placement import Placement
from drift.planning.arrays.placement_bound import Bound
from drift.planning.plans import Planner, Proposal
from drift.planning.search import follow
from geo import notation
from geo.errors import UserError
from kernels.maths import noise
from kernels.maths.noise import Purpose


@dataclass(frozen=True)
class ArrayPlan:
    """The ships' planned watches and their probability of hearing the target."""

    placement: Placement  # with its value on the planning particles
    bound: Bound
    sorties: tuple[Sortie, ...]  # in the order of the placement
    pos: float  # probability that any of them hears the target, on the case's own particles
    pos_of: tuple[float, ...]  # of each sortie, given that those before it heard nothing
    begin: np.datetime64
    until: np.datetime64


@serialized
def place(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    **options: Unpack[RunOptions],
) -> tuple[ArrayPlan, Result]:
    """Plan where the ships of a case tow their arrays.

    With `out`, the plan is written together with the forecast that assumes that nothing is heard.

    Args:
        case: of `drift.load` or `drift.vary`.
        out: a folder for the results, written completely or not at all; None: nothing is written.
        **options: as in `drift.run`.

    Returns:
        The plan and the forecast. The plan has `sorties` of the ships, `pos`, the probability that
            any of them hears the target (0 to 1), and its `bound`; the forecast is the
            `drift.Result` given that nothing is heard.

    Raises:
        UserError: the case has no `[[tow]]`, or `drift.run` rejects it; one line for each mistake
            (`error.lines`).
    """
    made = plans.propose(PLANNER, case, out, **options)
    return made.plan, made.result


def _check(case: Case) -> None:
    """Raise UserError unless the ships of a case can be placed."""
    if not case.tows:
        raise UserError(
            f"{case.path.name}: has no [[tow]] to place: add one with sensor, begin and speed for each ship"
        )
    plans.check_period(case)


@contextmanager
def propose(job: Job) -> Iterator[Proposal]:
    """Yield the plan of a job's ships with what is reported of it."""
    plan, executed, result = _towed(job)
    yield Proposal(
        plan,
        result,
        executed,
        facts=placement_text.placement_facts(plan),
        numbers=placement_text.summary_of_placement(plan),
        texts={"Plan": "arrays.txt"},
        outputs=[chapter.chapter],
        sorties=plan.sorties,
    )


PLANNER = Planner(_check, propose)


def _towed(job: Job) -> tuple[ArrayPlan, Case, Result]:
    """Return a plan, the case with its watches appended, and the forecast of that case.

    The watches are assumed to have heard nothing.
    """
    case = job.case
    chosen, bound = _best_placement(job)
    sorties = tuple(_sortie(case, placed) for placed in chosen.placed)
    executed = _with_planned_sorties(case, sorties)
    result = flow.forecast_job(replace(job, case=executed))
    return _scored_plan(case, chosen, bound, sorties, result), executed, result


def _best_placement(job: Job) -> tuple[Placement, Bound]:
    """Return the best ways that are found and their bound; raise UserError if there are none."""
    case, spec = job.case, job.case.plan
    with job.clock.phase("follow"):
        tracks = follow.follow(case, job.where)
    begin, until = (float(notation.epoch(time)) for time in (spec.begin, spec.until))
    seas = [ways.sea(tow, begin, until) for tow in case.tows]
    if job.where.coast is not None:
        seas = [
            ways.ashore(sea, coastline.land_reader(job.where.coast, case.coast)) for sea in seas
        ]
    with job.clock.phase("plan"):
        seed = noise.seed_for(case.seed, Purpose.OPTIMISER) % 2**32
        try:
            chosen = placement.best_ways(seas, tracks, seed, partial(job.tell, "plan"))
        except ValueError as error:
            raise UserError(f'tow "{error.args[0].split(" has no track")[0]}": {error}') from None
    with job.clock.phase("bound"):
        return chosen, placement_bound.bound(seas, tracks, chosen)


def _sortie(case: Case, placed: placement.Placed) -> Sortie:
    """Return a ship's planned watch as a sortie."""
    tow = placed.sea.tow
    legs = ways.legs(placed.sea, placed.way, 0)
    name = plans.sortie_name(case, f"{tow.name}, planned")
    start, end = (np.datetime64(round(time), "s") for time in (legs.time[0], legs.time[-1]))
    blind = (float("nan"),) * len(case.scenarios)
    return Sortie(
        name,
        "",
        start,
        end,
        Law(),
        blind,
        group=tow.sensor.group,
        legs=legs,
        sensor=tow.sensor,
        speed=tow.speed,
        planned=True,
    )


def _with_planned_sorties(case: Case, sorties: Sequence[Sortie]) -> Case:
    """Return the case with the planned watches and with output times for their map."""
    shown: list[np.datetime64] = []
    for sortie in sorties:
        shown += [sortie.start, sortie.start + (sortie.end - sortie.start) // 2, sortie.end]
    return plans.with_sorties(case, sorties, shown)


def _scored_plan(
    case: Case, chosen: Placement, bound: Bound, sorties: tuple[Sortie, ...], result: Result
) -> ArrayPlan:
    """Return the plan with its POD, taken from the forecast in which it was carried out."""
    pos = [float(np.asarray(own.pos)[-1]) for own in plans.updates_of(result, sorties)]
    by_end = sorted(zip(sorties, pos, strict=True), key=lambda one: (one[0].end, one[0].start))
    missed = float(np.prod([1 - own for _, own in by_end]))
    return ArrayPlan(
        chosen, bound, sorties, 1 - missed, tuple(pos), case.plan.begin, case.plan.until
    )
