"""The whole flow on one page: case -> environment -> prior -> forecast -> products -> files."""

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from drift import (
    aftermath,
    environment,
    evidence,
    figures,
    forecast,
    origin,
    output,
    prior,
    products,
    search_tables,
    start,
    summary,
    tables,
    units,
)
from drift import ensemble as record
from drift.aftermath import Aftermath, Drifted
from drift.case import Case
from drift.environment import Environment
from drift.landings import Landings
from drift.products import Forecast
from drift.search import Search
from drift.spill import Spill
from drift.spool import Spool
from drift.start import Start
from drift.status import Status
from drift.tasking import Plan
from drift.updates import Updates
from geo import coast as shoreline
from geo.errors import UserError
from geo.segments import Segments
from kernels import deposit, runtime

Report = Callable[[str, float], None]
CHECKED = 10_000  # particles that a check draws
LOST = (Status.OUTSIDE, Status.LEFT)


@dataclass(frozen=True)
class Result:
    """A forecast, the numbers about it, and its subsample's tracks."""

    case: Case
    forecast: Forecast
    trajectories: output.Trajectories
    summary: dict[str, Any]
    aftermath: Aftermath | None = None  # of a spill: its washup, finds and unknowns
    updates: Updates | None = None  # what sorties and contacts did

    @property
    def probability(self) -> Any:
        """Probability that the object is in a cell (time, lat, lon), an xarray.DataArray."""
        return self.forecast.probability

    @property
    def washup(self) -> Any:
        """What comes ashore where and when, an xarray.Dataset (see drift.washup); None without a spill."""
        return self.aftermath.washup if self.aftermath else None


@dataclass
class Stopwatch:
    """Wall time by phase [s]."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextlib.contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the time spent inside to a phase."""
        begin = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin


def run(
    case: Case,
    out: Path | None = None,
    *,
    threads: int | None = None,
    backend: str = "cpu",
    overwrite: bool = False,
    report: Report | None = None,
) -> Result:
    """Forecast a case; with `out`, write the results there, complete or not at all.

    report is told what is being done and how much of it is done. Raises UserError for all that the user can mend.
    """
    tell = report or (lambda phase, share: None)
    if out is not None:
        output.check_folder(out, overwrite)
    clock = Stopwatch()
    with clock.phase("taichi"):
        runtime.start(backend, threads)
    tell("read", 0.0)
    with clock.phase("read"):
        where = environment.open_for(case)
    result = forecasted(case, where, clock, tell)
    if out is not None:
        tell("write", 0.0)
        write(result, where, out, clock, overwrite=overwrite)
    return result


def forecasted(case: Case, where: Environment, clock: Stopwatch, tell: Report) -> Result:
    """Return the forecast of a case in an environment that has been opened; Taichi has been started."""
    with clock.phase("start"):
        begin = start.prepare(case, where)
        stretches = aftermath.stretches(case, case.spill, where, begin) if case.spill else None
    outputs = np.array([prior.elapsed(case, t) for t in case.outputs])
    with contextlib.ExitStack() as stack:

        def drifted(begin: Start) -> Drifted:
            """Move an ensemble through the run, keeping what it was like at every output."""
            stack.callback(begin.scene.forcing.close)
            with clock.phase("drift"):
                landings = Landings(begin.ensemble, begin.scene.place.beach.stay > 0)
                search = Search(case, begin.ensemble, begin.scene) if case.sorties or case.contacts else None
                moments = forecast.run(
                    begin.ensemble, begin.scene, begin.clock, outputs, partial(tell, "drift"), landings.watch, search
                )
                snapshots = stack.enter_context(Spool(case, begin.ensemble, moments))
            _check_lost(case, where, record.account(begin.ensemble, snapshots[-1].status).by_status.sum(axis=0))
            return Drifted(begin, snapshots, landings, search.updates if search else None)

        done, after = drifted(begin), None
        if case.spill and stretches:
            with clock.phase("finds"):
                done, after = aftermath.settle(case, case.spill, where, stretches, done, drifted)
        begin, snapshots = done.start, done.snapshots
        account = record.account(begin.ensemble, snapshots[-1].status)
        tell("map", 0.0)
        with clock.phase("products"):
            names = [scenario.name for scenario in case.scenarios]
            is_land = partial(shoreline.is_land, where.coast) if where.coast else None
            made = products.build(snapshots, scenarios=names, is_land=is_land, deposit=deposit.deposit)
            tracks = _trajectories(case, begin.ensemble, snapshots)
    numbers = summary.numbers(case, where, account, begin, clock.seconds)
    if after is not None:
        numbers |= aftermath.numbers(after)
    if done.updates is not None:
        numbers |= {"search": search_tables.numbers(done.updates)}
    return Result(case, made, tracks, numbers, after, done.updates)


def write(
    result: Result,
    where: Environment,
    out: Path,
    clock: Stopwatch,
    *,
    more: Sequence[output.Product] = (),
    plan: Plan | None = None,
    overwrite: bool = False,
) -> None:
    """Write all that a forecast hands out, complete or not at all; more: further products; plan: drawn with it."""
    case, after, updates = result.case, result.aftermath, result.updates
    with clock.phase("write"):
        attributes = summary.attributes(case, where)
        footer = f"{attributes['source']}, seed {case.seed}, coast {attributes['coast']}"
        pictures = figures.figures(case, where, result.forecast, footer, after, updates, plan)
        files = [*(aftermath.files(after) if after else ()), *more]
        if updates is not None:
            files += [
                output.Product("sorties.csv", lambda stamped: search_tables.csv(updates, stamped["run_id"])),
                output.Product(
                    "sorties.geojson",
                    lambda stamped: search_tables.geojson(updates.sorties, case.contacts, updates, stamped),
                ),
            ]
        output.write(
            out,
            result.forecast,
            result.trajectories,
            result.summary,
            pictures,
            attributes=attributes,
            more=files,
            overwrite=overwrite,
        )


def trace(
    case: Case,
    out: Path | None = None,
    *,
    threads: int | None = None,
    backend: str = "cpu",
    overwrite: bool = False,
    report: Report | None = None,
) -> origin.Origin:
    """Run a spill backward from its finds to where and when it may have been released; with `out`, write what it found.

    It proposes where to look: the answer is a forward run weighted by the finds. Raises UserError for all that the user
    can mend.
    """
    tell = report or (lambda phase, share: None)
    if case.spill is None:
        raise UserError(f"{case.path.name}: has no [spill]; an origin is told from the [[find]]s of a spill")
    if out is not None:
        output.check_folder(out, overwrite)
    clock = Stopwatch()
    runtime.start(backend, threads)
    tell("read", 0.0)
    with clock.phase("read"):
        where = environment.open_for(case)
        assert where.coast is not None
        segments = evidence.cut(case.spill, where.coast)
        places = [evidence.place(find, segments, where.coast) for find in case.spill.finds]
    with clock.phase("drift"):
        found = origin.backward(case, where, segments, places, progress=partial(tell, "drift"))
    if out is not None:
        attributes, facts = summary.attributes(case, where), origin.summary(found)
        output.publish(
            out,
            (
                output.Product("origin.nc", lambda stamped: origin.dataset(found)),
                output.Product(
                    "origin.csv",
                    lambda stamped: tables.csv_text([*facts, "run_id"], [[*facts.values(), stamped["run_id"]]]),
                ),
            ),
            {"origin": facts, "wall_time_s": clock.seconds},
            figures.origin(case, where, found, f"{attributes['source']}, seed {case.seed}"),
            attributes=attributes,
            overwrite=overwrite,
        )
    return found


def check(case: Case) -> dict[str, Any]:
    """Return how a case was understood, having opened all and drawn a few particles; run nothing.

    Raises UserError for all that a run would refuse at its start.
    """
    runtime.start()
    where = environment.open_for(case)
    few = replace(case, particles=min(case.particles, CHECKED))
    if case.spill:
        few = replace(few, spill=replace(case.spill, worlds=max(CHECKED // case.spill.per_world, 2)))
    begin = start.prepare(few, where)
    begin.scene.forcing.close()
    stretches = aftermath.stretches(case, few.spill, where, begin) if few.spill else None
    box = where.box
    found: dict[str, Any] = {
        "run": f"{case.start} to {case.end} UTC, {case.particles:,} particles, step {begin.clock.step} s",
        "domain": f"{box.west:.2f} to {box.east:.2f} E, {box.south:.2f} to {box.north:.2f} N",
        "coast": f"{where.coast.source}; {summary.behaviour(case)}" if where.coast else "none in the domain",
    }
    found |= {f"coast, note {k}": note for k, note in enumerate(where.notes, 1)}
    for source in where.sources:
        missing = f"{source.missing:.1%} missing; " if source.missing else ""
        found[f"{source.quantity} {source.name}"] = f"{missing}{'; '.join(source.notes) or 'as is'}"
    if case.spill and stretches:
        found |= _spill(case.spill, stretches)
    story = "class" if case.spill else "scenario"
    for scenario, dry in zip(case.scenarios, begin.dry, strict=True):
        found[f'{story} "{scenario.name}"'] = (
            f"{scenario.weight:.0%}, {scenario.object.name}: {scenario.object.description}"
        )
        if dry > 0:
            found[f'{story} "{scenario.name}"'] += f"; {dry:.1%} of its prior is on land and left out"
    return found


def _spill(spill: Spill, stretches: Segments) -> dict[str, str]:
    """Return how a spill was understood."""
    low, high = spill.objects
    rates = ", ".join(f"{kind} {86_400 * rate:g} a day" for kind, rate in spill.reporting.rate.items())
    told = {
        "spill": f"{low:,}{f' to {high:,}' if high > low else ''} objects, {spill.worlds:,} worlds of {spill.per_world:,} particles; "
        f"{spill.destroyed[0]:.0%} to {spill.destroyed[1]:.0%} destroyed at once",
        "released": f"{units.group(spill.prior.release_start)} to {units.group(spill.prior.release_end)}",
        "biases": f"windage a factor of {math.exp(spill.windage_bias):.2f}, current {spill.current_bias:g} m/s, reporting a factor "
        f"of {math.exp(spill.reporting_bias):.2f} (one standard deviation)",
        "reports": f"{rates}; other coast: {spill.reporting.coast}; removed {86_400 * spill.reporting.removal:g} a day",
        "stretches of coast": f"{len(stretches.name):,}, {stretches.length.sum() / 1000:,.0f} km",
    }
    for find in spill.finds:
        told[find.name] = f"{find.kind or 'class unknown'}, {units.group(find.time)}, by {find.by or 'the public'}"
    for patrol in aftermath.patrols(spill, stretches):
        told[f'patrol "{patrol["name"]}"'] = f"{len(patrol['stretches'])} stretches, {patrol['length_km']:.0f} km"
    return told


def _check_lost(case: Case, where: Environment, by_status: npt.NDArray[np.float64]) -> None:
    """Refuse a run that lost more than the case allows."""
    lost = {status: float(by_status[status]) for status in LOST}
    if sum(lost.values()) <= case.max_lost:
        return
    box = where.box
    raise UserError(
        f"{sum(lost.values()):.0%} of the probability was lost by the end: {lost[Status.OUTSIDE]:.0%} ran out of "
        f"forcing, {lost[Status.LEFT]:.0%} left the domain ({box.west:.2f}..{box.east:.2f} E, {box.south:.2f}.."
        f"{box.north:.2f} N); at most {case.max_lost:.0%} may be (max_lost). Shorten the run, add a source, or widen "
        "[domain]"
    )


def _trajectories(case: Case, ensemble: record.Ensemble, snapshots: Spool) -> output.Trajectories:
    """Return the tracks of slots spread evenly over the ensemble; of what was drawn anew, its ancestors' before that."""
    last = snapshots[-1]
    count = min(case.trajectories, last.lon.size)
    slots = np.arange(last.lon.size)
    if case.resampling.below > 0:  # without those to spare
        slots = np.flatnonzero(last.probability)
    slot = slots[np.unique(np.linspace(0, slots.size - 1, count).astype(int))]
    ancestor, columns = slot, []
    for k in range(len(snapshots) - 1, -1, -1):
        one = snapshots[k]
        columns.append((one.lon[ancestor], one.lat[ancestor], one.status[ancestor], one.probability[ancestor]))
        drawn = snapshots.ancestors[k]
        ancestor = ancestor if drawn is None else drawn[ancestor]
    lon, lat, status, weight = (np.stack(column[::-1], axis=1) for column in zip(*columns, strict=True))
    release, ended, edge = (column.to_numpy()[slot] for column in (ensemble.release, ensemble.ended, ensemble.edge))
    over = (last.status[slot] != Status.ADRIFT) & (last.status[slot] != Status.PENDING)
    ended, edge = np.where(over, ended, -1), np.where(over, edge, -1)
    times = np.array([snapshots.time(k) for k in range(len(snapshots))])
    return output.Trajectories(times, slot, last.scenario[slot], lon, lat, status, weight, release, ended, edge)
