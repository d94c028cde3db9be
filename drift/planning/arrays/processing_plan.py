"""Plan which beams of which arrays to process in each slot.

Beams are chosen on separate planning particles (drift.planning.search.follow), like search areas
and towing ways. The POD is computed on all of these particles, with each array's fluctuation
carried from slot to slot. The forecast beside the plan is that of the case as it is. If the same
plan places ships that tow arrays, it is the forecast given that they hear nothing.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Unpack

import numpy as np

from drift.case.record import Case
from drift.evidence.sensors.records import Processing
from drift.pipeline import flow
from drift.pipeline.result import Result
from drift.pipeline.run_options import Job, RunOptions, serialized
from drift.planning import plans
from drift.planning.arrays import (
    beams,
    chapter,
    manning,
    planner,
    processing,
    processing_chapter,
    processing_text,
    records,
)
from drift.planning.arrays.planner import ArrayPlan
from drift.planning.arrays.records import Allocation, Chosen, Hearing, Names
from drift.planning.plans import Planner, Proposal
from drift.planning.search import follow, planning_tracks
from geo import notation
from geo.errors import UserError
from kernels.maths import noise
from kernels.maths.noise import Purpose

MOST = 10_000  # particles on which beams are chosen
PAIRS = 30_000_000  # most entries (particle, beam, slot): particles are reduced to this number
FEWEST = 1000  # but never below this


@dataclass(frozen=True, eq=False)
class ProcessingPlan:
    """A beam allocation and its probability of detection."""

    allocation: Allocation
    hearing: Hearing
    names: Names
    # probability that the target is heard at least once; fluctuations carry over between slots
    pod: float
    standard_error: float  # of `pod`, as a mean over particles
    particles: int  # on which `pod` is computed
    made_on: int  # number of particles on which beams were chosen
    towed: ArrayPlan | None = None  # plan of the ships that were placed first


@serialized
def allocate(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    **options: Unpack[RunOptions],
) -> tuple[ProcessingPlan, Result]:
    """Plan which beams of a case's arrays to process when.

    Ships of the case that tow arrays are placed first, and their plan is written too. With `out`,
    the plan is written together with a forecast.

    Args:
        case: of `drift.load` or `drift.vary`.
        out: a folder for the results, written completely or not at all; None: nothing is written.
        **options: as in `drift.run`.

    Returns:
        The plan and the forecast. The plan has beams by slot, the probability of detection (0 to
            1), a bound and the value of other choices; the forecast is the `drift.Result` given
            that nothing is heard.

    Raises:
        UserError: the case has no `[plan.processing]`, or `drift.run` rejects it; one line for each
            mistake (`error.lines`).
    """
    made = plans.propose(PLANNER, case, out, **options)
    return made.plan, made.result


def _check(case: Case) -> None:
    """Raise UserError unless the beams of a case can be allocated."""
    asked = case.processing
    if asked is None:
        raise UserError(
            f"{case.path.name}: has no [plan.processing] to allocate: give slot, processors and sensors, the arrays with beams"
        )
    plans.check_period(case)
    _refuse_crowds(asked)
    _today_of(asked)


@contextmanager
def _propose(job: Job) -> Iterator[Proposal]:
    """Yield the allocation of a job with what is reported of it, and of its ships."""
    asked = job.case.processing
    assert asked is not None
    outputs = [processing_chapter.chapter]
    if not job.case.tows:
        plan = _allocated(job, asked)
        executed = plans.with_sorties(job.case, ())
        yield Proposal(
            plan,
            flow.forecast_job(replace(job, case=executed)),
            executed,
            facts=processing_text.processing_facts(plan),
            numbers=processing_text.plan_numbers(plan),
            texts={"Plan of processing": "processing.txt"},
            outputs=outputs,
        )
        return
    with planner.propose(job) as ships:
        plan = replace(_allocated(job, _placed(asked, ships.plan)), towed=ships.plan)
        facts, own = dict(ships.facts), processing_text.processing_facts(plan)
        first, second = {"towed arrays": facts.pop("plan")}, {"processing": own.pop("plan")}
        yield replace(
            ships,
            plan=plan,
            facts=first | facts | second | own,
            numbers={"arrays": ships.numbers} | processing_text.plan_numbers(plan),
            texts={"Plan of towed arrays": "arrays.txt", "of processing": "processing.txt"},
            outputs=[
                lambda matter: chapter.chapter(replace(matter, plan=plan.towed)),
                *outputs,
            ],
        )


PLANNER = Planner(_check, _propose)


def _refuse_crowds(asked: Processing) -> None:
    """Raise UserError if processors of a slot outnumber the beams that they can serve."""
    for slot, works in enumerate(asked.manned):
        crew = tuple(tuple(row) for row in asked.serves[works].tolist())
        over = manning.surplus(crew, asked.beams) if crew else None
        if over is not None:
            raise UserError(
                f"plan.processing.processors: {over[0]} that work from {notation.format_dtg(asked.edges[slot])} on can serve {over[1]} "
                "beams; give at most as many as beams, or let them serve other sensors"
            )


def _placed(asked: Processing, towed: ArrayPlan) -> Processing:
    """Return the processing options with the ways of the ships that were placed."""
    each = zip(towed.placement.placed, towed.sorties, strict=True)
    legs = {one.sea.tow.name: sortie.legs for one, sortie in each}
    listeners = tuple(
        replace(one, legs=legs[one.tow]) if one.tow else one for one in asked.listeners
    )
    return replace(asked, listeners=listeners)


def _allocated(job: Job, asked: Processing) -> ProcessingPlan:
    """Return the beam allocation of a case."""
    case = job.case
    with job.clock.phase("follow"):
        tracks = follow.follow(case, job.where)
    seed = noise.seed_for(case.seed, Purpose.OPTIMISER, 1) % 2**32
    many = int(np.clip(PAIRS // ((len(asked.edges) - 1) * sum(asked.beams)), FEWEST, MOST))
    with job.clock.phase("hear"):
        some = planning_tracks.sample(tracks, many) if many < tracks.m else tracks
        field = beams.field(asked.listeners, some, asked.edges, seed)
        heard = _hearing(asked, field, beams.chances(field, partial(job.tell, "plan")))
    with job.clock.phase("plan"):
        allocation = processing.allocate(heard, today=_today_of(asked))
    with job.clock.phase("hear"):
        chance = beams.carried(
            beams.field(asked.listeners, tracks, asked.edges, seed), allocation.chosen
        )
    pod = float(tracks.weight @ chance)
    error = float(np.sqrt(np.sum(tracks.weight**2 * (chance - pod) ** 2)))
    return ProcessingPlan(allocation, heard, _called(asked), pod, error, tracks.m, some.m)


def _hearing(asked: Processing, field: beams.Field, chances: Sequence[Any]) -> Hearing:
    """Return the allocation problem of a case.

    Args:
        asked: processors and listeners of the case.
        field: arrays and particles.
        chances: for each slot, probability that each beam hears each particle, (particles, beams).
    """
    cost = np.full((len(chances), len(field.array)), asked.cost)
    return records.hearing(
        chances,
        field.tracks.weight,
        field.array,
        asked.serves,
        manned=asked.manned,
        cost=cost,
        shared=field.array,
    )


def _called(asked: Processing) -> Names:
    """Return the names of arrays, beams and processors."""
    looks = [name for listener in asked.listeners for name in beams.looks(listener)]
    return Names(
        tuple(listener.name for listener in asked.listeners),
        tuple(looks),
        asked.processors,
        asked.edges,
    )


def _today_of(asked: Processing) -> Chosen | None:
    """Return the beams of present practice in each slot; None if the case gives none.

    A slot with fewer processors keeps the first of them, in the order of the arrays. Raises
    UserError if the beams have no processors even when all work.
    """
    if asked.today is None:
        return None
    first = np.concatenate([[0], np.cumsum(asked.beams)])
    own = [(k, int(first[k]) + beam) for k, some in enumerate(asked.today) for beam in some]

    def fits(some: Sequence[tuple[int, int]], serves: Any) -> bool:
        counts = np.bincount([k for k, _ in some], minlength=len(asked.listeners))
        return manning.fits(tuple(tuple(row) for row in serves.tolist()), tuple(counts.tolist()))

    if not fits(own, asked.serves):
        raise UserError(
            f"plan.processing.today: {len(own)} beams, for which there are no processors even when all work; leave some out"
        )
    chosen = []
    for works in asked.manned:
        kept: list[tuple[int, int]] = []
        for one in own:
            if fits([*kept, one], asked.serves[works]):
                kept.append(one)
        chosen.append(tuple(beam for _, beam in kept))
    return tuple(chosen)
