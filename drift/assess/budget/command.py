"""Divide the area of a forecast among its sources of spread: `drift budget`.

A small forecast is made with each combination of the sources, all on common random numbers. The
Shapley values of its areas are the shares (drift.assess.budget.shapley). Standard errors come from
batches of the particles, whose areas are computed apart.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Unpack

import numpy as np

from drift.assess.budget import chapter, consensus, sources
from drift.assess.budget.consensus import Consensus
from drift.assess.budget.record import Budget
from drift.assess.budget.sources import Source
from drift.case.record import Case
from drift.case.values import units
from drift.engine.motion import scene, simulate
from drift.engine.motion.clock import Clock
from drift.engine.motion.spool import SnapshotStore
from drift.engine.particles.snapshot import Snapshot
from drift.engine.particles.status import Status
from drift.evidence.filter.records import Sensors
from drift.forecast import build
from drift.pipeline import run_setup
from drift.pipeline.run_options import Job, JobOptions, Options, open_job, serialized
from drift.pipeline.run_setup import Start
from drift.products.files import writer
from geo import notation
from geo.array import Array
from geo.cells import IsLand
from geo.errors import UserError
from kernels.step import coast as device_coast

PARTICLES = 10_000
BATCHES = 8
LEAST = 500  # particles of a batch
EACH = 1000  # particles of a model whose own areas are drawn


@serialized
def budget(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    *,
    times: Sequence[object] = (),
    particles: int = PARTICLES,
    **options: Unpack[JobOptions],
) -> Budget:
    """Return the share of each source of spread in the areas of a case's forecast.

    Sources are the start, the errors of current and wind, the leeway, the side of the wind with
    jibing, diffusion, members of an ensemble and scenarios. Sorties, contacts and sensors are not
    used. With `out`, also write the results into that folder.

    Args:
        case: whose objects drift, from `drift.load` or `drift.vary`.
        out: folder for the results, written completely or not at all; None: nothing is written.
        times: as a case writes them, like "+6 h"; (): `output.datum`, or the end of the run.
        particles: number of particles of each forecast, at least 4,000.
        **options: as in `drift.run`.

    Returns:
        By source, time and area: its share of the area, the change of the area without it, and
        the area [m2] with it alone, with standard errors (sampling only).

    Raises:
        UserError: the case has nothing to divide, or a time or number is wrong.
    """
    asked, folder = Options(out, **options), None if out is None else Path(out)
    if folder is not None:
        writer.check_folder(folder, asked.overwrite, chapter.NAMES)
    sources.check_case(case)
    if particles < BATCHES * LEAST:
        raise UserError(
            f"--particles {particles}: must be at least {BATCHES * LEAST:,}, for {BATCHES} batches"
        )
    small = _small_case(case, _chosen_times(case, times), particles)
    job = open_job(small, replace(asked, out=None))
    found = sources.present_sources(small, job.where)
    if not found:
        raise UserError(
            f"{case.path.name}: drift budget: nothing is uncertain in this case, so there is "
            "nothing to divide; give the position an error, or state [uncertainty]"
        )
    areas, batches = _areas_of_all(job, found)
    result = Budget(
        case,
        found,
        tuple(small.outputs),
        small.areas,
        particles,
        areas,
        batches,
        _consensus(job),
        _left_out(case),
    )
    if folder is not None:
        job.tell("write", 0.0)
        writer.write(
            folder,
            chapter.budget_bundles(result, job),
            overwrite=asked.overwrite,
            tell=partial(job.tell, "write"),
        )
    return result


def _chosen_times(case: Case, times: Sequence[object]) -> list[np.datetime64]:
    """Return the times of a budget in the order of the run."""
    if not times:
        chosen = [case.end if case.opens is None else case.opens]
    else:
        chosen = []
        for text in [times] if isinstance(times, str) else times:
            try:
                chosen.append(units.resolve(units.time(text), case.start))
            except ValueError as error:
                raise UserError(f"--time TIME: {error}") from None
    first, last = sorted((case.start, case.end))
    for time in chosen:
        if not first <= time <= last:
            raise UserError(
                f"--time TIME: {notation.format_dtg(time)} must be in the run, from "
                f"{notation.format_dtg(first)} to {notation.format_dtg(last)}"
            )
    return sorted(set(chosen), reverse=case.direction < 0)


def _small_case(case: Case, times: Sequence[np.datetime64], particles: int) -> Case:
    """Return a case without evidence, with a number of particles, that ends at the last time."""
    return replace(
        case,
        particles=particles,
        counts=None,
        sorties=(),
        contacts=(),
        sensors=Sensors(),
        units=(),
        grid=None,
        outputs=np.array(times),
    )


def _left_out(case: Case) -> tuple[str, ...]:
    """Return the evidence of a case, which a budget does not use, in words."""
    counts = {
        "sortie": len(case.sorties),
        "contact": len(case.contacts),
        "sensor": len(case.sensors.telling),
    }
    return tuple(f"{count} {name}{'s' * (count > 1)}" for name, count in counts.items() if count)


def _areas_of_all(job: Job, found: Sequence[Source]) -> tuple[Array, Array]:
    """Return the areas [m2] of each coalition, (coalitions, times, shares), and of each batch.

    Coalitions count sources as bits.
    """
    case, many = job.case, 2 ** len(found)
    shore = device_coast.upload(job.where.coast) if job.where.coast else None
    begin = run_setup.prepare(case, job.where, shore)
    begin.scene.forcing.close()
    clock = begin.clock
    shape = (len(case.outputs), len(case.areas))
    areas, batches = np.empty((many, *shape)), np.empty((BATCHES, many, *shape))
    for coalition in range(many):
        off = {source.key for k, source in enumerate(found) if not coalition >> k & 1}
        with _moved(job, off, clock, shore) as (snapshots, is_land):
            if coalition == many - 1:
                _check_snapshots(case, snapshots)
            for time, snapshot in enumerate(snapshots):
                parts = [_batch(snapshot, batch) for batch in range(BATCHES)]
                every = _areas(case, [snapshot, *parts], is_land)
                areas[coalition, time], batches[:, coalition, time] = every[0], every[1:]
        job.tell("drift", (coalition + 1) / many)
    _check_areas(case, areas[-1], batches[:, -1])
    # with some sources off, nothing may be left on the map: there is no area
    return np.nan_to_num(areas), np.nan_to_num(batches)


@contextmanager
def _moved(
    job: Job, off: set[str], clock: Clock | None, shore: device_coast.DeviceCoast | None
) -> Iterator[tuple[list[Snapshot], IsLand | None]]:
    """Yield the particles at each output, with some sources off, and what is land.

    clock: of the whole run, so that all share their random numbers; None: its own.
    """
    case = sources.case_without(job.case, off)
    if clock is not None:
        case = replace(case, step=clock.step)
    begin: Start = run_setup.prepare(case, job.where, shore)
    sources.hold_ensemble(case, begin.ensemble, off)
    with closing(begin.scene.forcing):
        outputs = case.period.seconds(case.outputs)
        moments = simulate.run(begin.ensemble, begin.scene, clock or begin.clock, outputs)
        snapshots = SnapshotStore.of_run(case.period, begin.ensemble, moments, len(outputs))
        with snapshots:
            yield [snapshots[k] for k in range(len(snapshots))], scene.land_of(begin.scene)


def _check_snapshots(case: Case, snapshots: Sequence[Snapshot]) -> None:
    """Raise UserError for a time at which the whole prior is not on the map yet."""
    for snapshot in snapshots:
        pending = snapshot.probability[snapshot.status == Status.PENDING].sum()
        if pending > 0:
            raise UserError(
                f"--time TIME: at {notation.format_dtg(snapshot.time)} {notation.percent(pending)} of "
                f"the probability of {case.path.name} is not adrift yet; choose a later time"
            )


def _check_areas(case: Case, areas: Array, batches: Array) -> None:
    """Raise UserError for a time at which all particles, or those of a batch, are off the map."""
    empty = (np.isnan(areas) | np.isnan(batches).any(axis=0)).any(axis=1)
    if empty.any():
        time = case.outputs[int(np.argmax(empty))]
        raise UserError(
            f"--time TIME: at {notation.format_dtg(time)} nothing is left on the map, or too little to divide its "
            "area: the objects have sunk or have left the map; choose an earlier time, or more --particles"
        )


def _batch(snapshot: Snapshot, batch: int) -> Snapshot:
    """Return every BATCHES-th particle: each batch has particles of all scenarios and members."""
    own = slice(batch, None, BATCHES)
    probability = snapshot.probability[own]
    return Snapshot(
        snapshot.time,
        np.ascontiguousarray(snapshot.lon[own]),
        np.ascontiguousarray(snapshot.lat[own]),
        probability / probability.sum(),
        np.ascontiguousarray(snapshot.status[own]),
        np.ascontiguousarray(snapshot.scenario[own]),
    )


def _areas(case: Case, snapshots: Sequence[Snapshot], is_land: IsLand | None) -> Array:
    """Return the containment areas [m2] of some snapshots, (snapshots, shares)."""
    forecast = build.build_forecast(
        snapshots,
        scenarios=[scenario.name for scenario in case.scenarios],
        is_land=is_land,
        shares=case.areas,
    )
    return np.asarray(forecast.data["containment_area"].values)


def _consensus(job: Job) -> Consensus | None:
    """Return where the models of a case agree; None if it has one."""
    models = consensus.models_of(job.case, job.where)
    if models is None:
        return None
    what, names, model_of = models
    particles = max(job.case.particles, EACH * len(names))
    enough = replace(job, case=replace(job.case, particles=particles))
    job.tell("map", 0.0)
    with _moved(enough, set(), None, None) as (snapshots, is_land):
        return consensus.find_consensus(
            snapshots,
            what,
            names,
            model_of,
            scenarios=[scenario.name for scenario in job.case.scenarios],
            is_land=is_land,
            shares=job.case.areas,
        )
