"""What all planners share: their checks, the case in which a plan fails, and their outputs.

A planner makes a `Proposal`. `propose` runs it and writes its files with the forecast; `drift plan`
prints its facts.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np

from drift.case.record import Case
from drift.evidence.filter.records import Sortie
from drift.evidence.filter.updates import Update
from drift.evidence.suspend.further import Planned
from drift.forecast.likeliest import Shown
from drift.pipeline import flow, run_metadata
from drift.pipeline.result import Result
from drift.pipeline.run_options import Job, RunOptions, serialized
from drift.pipeline.shards import shelf
from drift.products.files.chapter import OutputBundle
from drift.products.maps.imprint import Setting
from geo import notation
from geo.errors import UserError


@dataclass(frozen=True)
class PlanOutputs:
    """What the output files and pictures of a plan are made from."""

    plan: Any
    result: Result  # given the plan's failure
    setting: Setting
    case: Case
    synthetic: bool  # winds or currents are made up


@dataclass(frozen=True)
class Proposal:
    """A plan, the forecast given that it finds nothing, and what is reported of them."""

    plan: Any
    result: Result
    executed: Case  # in which the plan was carried out and found nothing
    facts: Mapping[str, str]  # for a terminal
    numbers: Mapping[str, Any]  # for programs
    texts: Mapping[str, str]  # file of each text for people, by what it is
    outputs: Sequence[Callable[[PlanOutputs], OutputBundle]]  # of the files and pictures
    sorties: Sequence[Sortie] = ()  # planned, not yet flown
    shown: Shown | None = None  # scenarios on the maps; None: all


@dataclass(frozen=True)
class Planner:
    """A kind of plan."""

    check: Callable[[Case], None]  # raises UserError if it cannot plan for a case
    # plans for a job; the particles of the forecast can be read until the context closes
    propose: Callable[[Job], AbstractContextManager[Proposal]]


@serialized
def propose(
    planner: Planner,
    case: Case,
    out: str | os.PathLike[str] | None,
    **options: Unpack[RunOptions],
) -> Proposal:
    """Return the plan of a planner; with `out`, write it with its forecast.

    Args:
        planner: the kind of plan.
        case: of `drift.load` or `drift.vary`.
        out: a folder for the results, written completely or not at all; None: nothing is written.
        **options: as in `drift.run`.

    Raises:
        UserError: the planner or `drift.run` rejects the case; one line for each mistake.
    """
    planner.check(case)
    job = flow.open_run(case, out, options)
    with planner.propose(job) as made:
        if job.out is not None:
            setting = run_metadata.map_setting(made.executed, job.where, made.shown)
            outputs = PlanOutputs(
                made.plan,
                made.result,
                run_metadata.with_coast(setting),
                case,
                run_metadata.has_synthetic_forcing(case),
            )
            bundles = [bundle_of(outputs) for bundle_of in made.outputs]
            names = frozenset(sortie.name for sortie in made.sorties)
            ends = [sortie.end for sortie in made.sorties]
            ahead = Planned(names, max(ends)) if names else None
            flow.write_results(made.result, job, more=bundles, planned=ahead)
    if job.out is not None:
        shelf.clear(job.out)
    return made


def check_period(case: Case) -> None:
    """Raise UserError if a case leaves no time for a plan."""
    if case.plan.begin >= case.plan.until:
        raise UserError(
            f"{case.path.name}: plan: the last sortie or contact is at {notation.format_dtg(case.plan.begin)}, when the plan is to "
            "end; give begin and until in [plan], or run for longer"
        )


def sortie_name(case: Case, name: str) -> str:
    """Return a name of a planned sortie that no sortie of the case has."""
    while name in {sortie.name for sortie in case.sorties}:
        name += " again"
    return name


def with_sorties(
    case: Case, sorties: Sequence[Sortie], shown: Sequence[np.datetime64] = ()
) -> Case:
    """Return a case in which a plan's sorties have been flown, up to the plan's end.

    It has few outputs, because planners wait for it: the begin of run and plan, its end, and
    `shown`.
    """
    flown = sorted((*case.sorties, *sorties), key=lambda sortie: (sortie.start, sortie.end))
    times = [case.start, case.plan.begin, *shown, case.plan.until]
    outputs = np.unique(np.array(times, "datetime64[s]"))
    return replace(case, sorties=tuple(flown), outputs=outputs, end=case.plan.until)


def updates_of(result: Result, sorties: Sequence[Sortie]) -> list[Update]:
    """Return the update by each sortie of a plan, from the forecast in which it failed."""
    assert result.updates is not None
    by_name = {update.name: update for update in result.updates.all}
    return [by_name[sortie.name] for sortie in sorties]
