"""The next watch of towed arrays: where each ship begins, and on what courses it tows.

Ways are chosen on particles of their own (drift.planning.search.follow); what the plan is worth is
told by the run in which it has been carried out and heard nothing.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Unpack

import numpy as np

from drift.case.record import Case
from drift.engine.environment import coastline
from drift.evidence.filter.records import Law, Sortie
from drift.evidence.suspend.further import Planned
from drift.pipeline import flow, run_metadata
from drift.pipeline.result import Result
from drift.pipeline.run_options import Job, RunOptions, serialized
from drift.pipeline.shards import shelf
from drift.planning.arrays import chapter, placement, placement_bound, ways
from drift.planning.arrays.placement import Placement
from drift.planning.arrays.placement_bound import Bound
from drift.planning.search import follow
from geo import notation
from geo.errors import UserError
from kernels.maths import noise
from kernels.maths.noise import Purpose


@dataclass(frozen=True)
class ArrayPlan:
    """Where ships are to tow their arrays, and what that is worth."""

    placement: Placement  # and what it is worth on the particles on which it was made
    bound: Bound
    sorties: tuple[Sortie, ...]  # in the order of the placement
    pos: float  # probability that any of them hears the target, on the case's own particles
    pos_of: tuple[float, ...]  # of each, given that those before it heard nothing
    begin: np.datetime64
    until: np.datetime64


@serialized
def place(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    **options: Unpack[RunOptions],
) -> tuple[ArrayPlan, Result]:
    """Plan where a case's ships tow their arrays; with `out`, write it and the forecast of their
    hearing nothing.

    The folder is written completely or not at all, with the forecast of the plan's failure.

    Args:
        case: of `drift.load` or `drift.vary`.
        out: a folder for the results, written completely or not at all; None: nothing is written.
        **options: as in `drift.run`.

    Returns:
        The plan and the forecast: `sorties` of the ships, `pos`, the probability that any of them
            hears the target (0 to 1), and its
        `bound`; the `drift.Result` as if nothing was heard.

    Raises:
        UserError: what a user can change, one line for each mistake (`error.lines`): the case has
            no `[[tow]]`, or what `drift.run` rejects.
    """
    if not case.tows:
        raise UserError(
            f"{case.path.name}: has no [[tow]] to place: give each its sensor, begin and speed"
        )
    if case.plan.begin >= case.plan.until:
        raise UserError(
            f"{case.path.name}: plan: the last sortie or contact is at {notation.format_dtg(case.plan.begin)}, when the plan is to "
            "end; give begin and until in [plan], or run for longer"
        )
    job = flow.open_run(case, out, options)
    plan, executed, result = towed(job)
    if job.out is not None:
        flow.write_results(
            result,
            job,
            more=[chapter.chapter(matter(job, plan, executed, result))],
            planned=ahead(plan),
        )
        shelf.clear(job.out)
    return plan, result


def towed(job: Job) -> tuple[ArrayPlan, Case, Result]:
    """Return a plan, the case in which it has been carried out and heard nothing, and the forecast
    of that.
    """
    case = job.case
    chosen, bound = _placed(job)
    sorties = tuple(_sortie(case, placed) for placed in chosen.placed)
    executed = _with(case, sorties)
    result = flow.forecast_job(replace(job, case=executed))
    return _worth(case, chosen, bound, sorties, result), executed, result


def matter(job: Job, plan: ArrayPlan, executed: Case, result: Result) -> chapter.PlacementOutputs:
    """Return what the files and the picture of a plan are made from."""
    setting = run_metadata.with_coast(run_metadata.map_setting(executed, job.where))
    taken = [sortie.name for sortie in job.case.sorties]
    return chapter.PlacementOutputs(plan, result.forecast, result.updates, setting, taken)


def ahead(plan: ArrayPlan) -> Planned:
    """Return the watches of a plan, which are still to be kept."""
    return Planned(
        frozenset(sortie.name for sortie in plan.sorties),
        max(sortie.end for sortie in plan.sorties),
    )


def _placed(job: Job) -> tuple[Placement, Bound]:
    """Return the best ways that are found, and a bound; raise UserError where a ship has none."""
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
            raise UserError(f'tow "{error.args[0].split(" has no way")[0]}": {error}') from None
    with job.clock.phase("bound"):
        return chosen, placement_bound.bound(seas, tracks, chosen)


def _sortie(case: Case, placed: placement.Placed) -> Sortie:
    """Return a ship's watch as it is to be sailed."""
    tow = placed.sea.tow
    legs = ways.legs(placed.sea, placed.way, 0)
    name = f"{tow.name}, planned"
    while name in {sortie.name for sortie in case.sorties}:
        name += " again"
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


def _with(case: Case, sorties: Sequence[Sortie]) -> Case:
    """Return a case in which the plan has been carried out, with outputs at the times that its
    picture shows.
    """
    every = tuple(sorted((*case.sorties, *sorties), key=lambda sortie: (sortie.start, sortie.end)))
    shown = [case.start, case.plan.begin, case.plan.until]
    for sortie in sorties:
        shown += [sortie.start, sortie.start + (sortie.end - sortie.start) // 2, sortie.end]
    return replace(
        case,
        sorties=every,
        outputs=np.unique(np.array(shown, "datetime64[s]")),
        end=case.plan.until,
    )


def _worth(
    case: Case, chosen: Placement, bound: Bound, sorties: tuple[Sortie, ...], result: Result
) -> ArrayPlan:
    """Return the plan with what it is worth, by the forecast in which it has been carried out."""
    assert result.updates is not None
    by_name = {update.name: update for update in result.updates.all}
    pos = [float(np.asarray(by_name[sortie.name].pos)[-1]) for sortie in sorties]
    ordered = [
        by_name[update.name]
        for update in result.updates.all
        if update.name in {s.name for s in sorties}
    ]
    missed = float(np.prod([1 - float(np.asarray(update.pos)[-1]) for update in ordered]))
    return ArrayPlan(
        chosen, bound, sorties, 1 - missed, tuple(pos), case.plan.begin, case.plan.until
    )
