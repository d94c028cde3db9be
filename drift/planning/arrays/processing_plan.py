"""The next use of scarce processing: which beams of which arrays to process in which slot.

Beams are chosen on particles of their own (drift.planning.search.follow), as a plan's areas and
ways are. What the choice is worth is told of all of these particles, with each array's fluctuation
carried from slot to slot; the forecast beside it is that of the case as it is, or, where ships that
tow arrays are placed by the same plan, of their hearing nothing.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Unpack

import numpy as np

from drift.case.record import Case
from drift.evidence.sensors.records import Processing
from drift.pipeline import flow, run_metadata
from drift.pipeline.result import Result
from drift.pipeline.run_options import Job, RunOptions, serialized
from drift.pipeline.shards import shelf
from drift.planning.arrays import beams, manning, planner, processing, processing_chapter, records
from drift.planning.arrays import chapter as tow_chapter
from drift.planning.arrays.planner import ArrayPlan
from drift.planning.arrays.records import Allocation, Chosen, Hearing, Names
from drift.planning.search import follow, planning_tracks
from drift.products.files.chapter import OutputBundle
from geo import notation
from geo.errors import UserError
from kernels.maths import noise
from kernels.maths.noise import Purpose

MOST = 10_000  # particles on which beams are chosen
PAIRS = 30_000_000  # of a particle and a beam in a slot: with more, fewer particles are taken, but
FEWEST = 1000


@dataclass(frozen=True, eq=False)
class ProcessingPlan:
    """Which beams are to be processed when, and what that is worth."""

    allocation: Allocation
    hearing: Hearing
    names: Names
    # probability that the target is heard at least once, fluctuations carried from slot to slot
    pod: float
    standard_error: float  # of `pod`, as a mean over particles
    particles: int  # of which it is told
    made_on: int  # particles on which beams were chosen
    towed: ArrayPlan | None = None  # of the ships that were placed first


@serialized
def allocate(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    **options: Unpack[RunOptions],
) -> tuple[ProcessingPlan, Result]:
    """Plan which beams of a case's arrays to process when; with `out`, write it and a forecast.

    Ships of the case that tow arrays are placed first, and their plan is written too.

    The folder is written completely or not at all, with the forecast of the plan's failure.

    Args:
        case: of `drift.load` or `drift.vary`.
        out: a folder for the results, written completely or not at all; None: nothing is written.
        **options: as in `drift.run`.

    Returns:
        The plan and the forecast: beams by period, probability of detection (0 to 1) with a bound
            and what other choices are worth;
        the `drift.Result` as if nothing was heard.

    Raises:
        UserError: what a user can change, one line for each mistake (`error.lines`): the case has
            no `[plan.processing]`, or what `drift.run` rejects.
    """
    asked = case.processing
    if asked is None:
        raise UserError(
            f"{case.path.name}: has no [plan.processing] to allocate: give slot, processors and sensors, the arrays with beams"
        )
    if case.plan.begin >= case.plan.until:
        raise UserError(
            f"{case.path.name}: plan: the last sortie or contact is at {notation.format_dtg(case.plan.begin)}, when the plan is to "
            "end; give begin and until in [plan], or run for longer"
        )
    refuse_crowds(asked)
    today_of(asked)
    job = flow.open_run(case, out, options)
    chapters: list[OutputBundle] = []
    ahead = None
    executed = case
    if case.tows:
        towed, executed, result = planner.towed(job)
        asked = placed(asked, towed)
        ahead = planner.ahead(towed)
        if job.out is not None:
            chapters.append(tow_chapter.chapter(planner.matter(job, towed, executed, result)))
        plan = replace(_allocated(job, asked), towed=towed)
    else:
        plan = _allocated(job, asked)
        executed = _shown(case)
        result = flow.forecast_job(replace(job, case=executed))
    if job.out is not None:
        setting = run_metadata.with_coast(run_metadata.map_setting(executed, job.where))
        chapters.append(
            processing_chapter.chapter(processing_chapter.ProcessingOutputs(plan, setting))
        )
        flow.write_results(result, job, more=chapters, planned=ahead)
        shelf.clear(job.out)
    return plan, result


def refuse_crowds(asked: Processing) -> None:
    """Raise UserError where some of the processors that work at a time have fewer beams than they
    are.
    """
    for slot, works in enumerate(asked.manned):
        crew = tuple(tuple(row) for row in asked.serves[works].tolist())
        over = manning.surplus(crew, asked.beams) if crew else None
        if over is not None:
            raise UserError(
                f"plan.processing.processors: {over[0]} that work from {notation.format_dtg(asked.edges[slot])} on can serve {over[1]} "
                "beams; give at most as many as beams, or let them serve other sensors"
            )


def placed(asked: Processing, towed: ArrayPlan) -> Processing:
    """Return what is asked for with the ways of ships that have been placed."""
    each = zip(towed.placement.placed, towed.sorties, strict=True)
    legs = {one.sea.tow.name: sortie.legs for one, sortie in each}
    listeners = tuple(
        replace(one, legs=legs[one.tow]) if one.tow else one for one in asked.listeners
    )
    return replace(asked, listeners=listeners)


def _shown(case: Case) -> Case:
    """Return the case until the plan's end, with outputs at its begin and end."""
    shown = [case.start, case.plan.begin, case.plan.until]
    return replace(case, outputs=np.unique(np.array(shown, "datetime64[s]")), end=case.plan.until)


def _allocated(job: Job, asked: Processing) -> ProcessingPlan:
    """Return the plan of processing."""
    case = job.case
    with job.clock.phase("follow"):
        tracks = follow.follow(case, job.where)
    seed = noise.seed_for(case.seed, Purpose.OPTIMISER, 1) % 2**32
    many = int(np.clip(PAIRS // ((len(asked.edges) - 1) * sum(asked.beams)), FEWEST, MOST))
    with job.clock.phase("hear"):
        some = planning_tracks.sample(tracks, many) if many < tracks.m else tracks
        field = beams.field(asked.listeners, some, asked.edges, seed)
        heard = hearing(asked, field, beams.chances(field, partial(job.tell, "plan")))
    with job.clock.phase("plan"):
        allocation = processing.allocate(heard, today=today_of(asked))
    with job.clock.phase("hear"):
        chance = beams.carried(
            beams.field(asked.listeners, tracks, asked.edges, seed), allocation.chosen
        )
    pod = float(tracks.weight @ chance)
    error = float(np.sqrt(np.sum(tracks.weight**2 * (chance - pod) ** 2)))
    return ProcessingPlan(allocation, heard, called(asked), pod, error, tracks.m, some.m)


def hearing(asked: Processing, field: beams.Field, chances: Sequence[Any]) -> Hearing:
    """Return what is heard of particles, and by whom it can be processed."""
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


def called(asked: Processing) -> Names:
    """Return what arrays, beams and processors are called."""
    looks = [name for listener in asked.listeners for name in beams.looks(listener)]
    return Names(
        tuple(listener.name for listener in asked.listeners),
        tuple(looks),
        asked.processors,
        asked.edges,
    )


def today_of(asked: Processing) -> Chosen | None:
    """Return the beams of today in every slot, as many as have processors there, in the order of
    the arrays.

    Raises UserError where they have none even when all work.
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
