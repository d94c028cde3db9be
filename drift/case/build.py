"""The tables of a case file, each in order, -> the record of the case, after what only all of them together can tell."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drift.case import contact as contact_table
from drift.case import plan as plan_table
from drift.case import sortie as sortie_table
from drift.case import sources, subject, uncertainty, units
from drift.case.context import Run
from drift.case.mistakes import Mistakes
from drift.case.record import Case, Depth
from drift.case.schema import CaseTable, OutputTable
from drift.case.sources import SourceTable
from drift.motion.environment_spec import Coast
from drift.motion.forcing_error import CASE, DEFAULT, UNFELT, ForcingError
from drift.motion.forcing_spec import ForcingSpec, Quantity
from drift.motion.scenario import Scenario
from drift.search.records import Contact, PlanSpec, Sortie, Unit
from drift.spill.records import Spill
from geo import notation
from geo.errors import UserError

MOST_OUTPUTS = 1000
QUANTITIES: tuple[Quantity, ...] = ("current", "wind", "stokes")


def build(table: CaseTable, path: Path, text: str) -> Case:
    """Return the record of a case; raise one UserError for all that does not fit together."""
    start, end = table.begin(), table.finish()
    folder, wrong = path.absolute().parent, Mistakes()
    known = tuple(
        _sources(quantity, tables, start, folder, wrong)
        for quantity, tables in zip(QUANTITIES, (table.current, table.wind, table.stokes), strict=True)
    )
    spill: Spill | None = None
    scenarios: tuple[Scenario, ...] = ()
    with wrong.gathered():
        if table.spill:
            spill = subject.spill(table, start, end, folder)
            scenarios = subject.classes(spill, start, end, known)
        else:
            scenarios = subject.scenarios(table.scenario, start, end, known)
    run = Run(start, end, scenarios, folder)
    sorties, contacts, fleet, plan = _search(table, run, wrong)
    more = [find.time for find in spill.finds if find.at_sea] if spill else plan_table.times(sorties, contacts)
    outputs = np.empty(0, "datetime64[s]")
    with wrong.gathered():
        outputs = _outputs(table.output, start, end, more)
    current_error, wind_error = uncertainty.CURRENT, uncertainty.WIND
    with wrong.gathered():
        if scenarios:  # those at fault say nothing of what they drift in
            current_error, wind_error = _errors(table, known, scenarios, contacts)
        spill = replace(spill, current_bias=current_error.bias) if spill else None
    if table.depth is None and any(unit.draught > 0 for unit in fleet):
        wrong.lines.append(
            'draught: without depths it says nothing; give [depth] file = "depths.nc", or leave draught out'
        )
    depths = None
    with wrong.gathered():
        if table.depth:
            file = sources.one_file(table.depth.file, folder, "depth.file")
            depths = Depth(file, table.depth.variable, table.depth.positive)
    shore, lakes = table.coast.source, table.coast.lakes
    with wrong.gathered():
        shore = _shore(shore, folder)
    with wrong.gathered():
        lakes = sources.one_file(lakes, folder, "coast.lakes") if isinstance(lakes, str) else lakes
    made = ", ".join(f"{one:g}" for one in table.output.areas)
    wrong.lines += [
        f"expect: no {percent:g} % area is made, only {made} %; add {percent:g} to output.areas"
        for percent in table.expect.by_percent()
        if percent not in table.output.areas
    ]
    wrong.refuse()
    assert plan is not None
    currents, winds, stokes = known
    diffusivity = table.uncertainty.diffusivity
    return Case(
        title=table.title or path.stem,
        path=path,
        text=text,
        start=start,
        end=end,
        direction=-1 if table.direction == "backward" else 1,
        particles=spill.particles if spill else table.particles,
        seed=table.seed,
        max_lost=table.max_lost,
        outputs=outputs,
        trajectories=table.output.trajectories,
        areas=table.output.fractions(),
        grid=table.output.grid.cells() if table.output.grid else None,
        step=table.clock.step,
        scheme=table.clock.scheme,
        tolerance=table.clock.tolerance,
        domain=table.domain.box() if table.domain else None,
        coast=Coast(shore, table.coast.behaviour, table.coast.half_life or 0.0, table.coast.offing, lakes),
        currents=currents,
        winds=winds,
        stokes=stokes,
        current_error=current_error,
        wind_error=wind_error,
        diffusivity=uncertainty.DIFFUSIVITY if diffusivity is None else diffusivity,
        diffusivity_by=DEFAULT if diffusivity is None else CASE,
        scenarios=scenarios,
        spill=spill,
        sorties=sorties,
        contacts=contacts,
        units=fleet,
        plan=plan,
        resampling=table.resampling.resampling(),
        expect=table.expect,
        depth=depths,
    )


def _errors(
    table: CaseTable,
    known: tuple[tuple[ForcingSpec, ...], ...],
    scenarios: tuple[Scenario, ...],
    contacts: tuple[Contact, ...],
) -> tuple[ForcingError, ForcingError]:
    """Return the errors of current and wind: as the case says, else by default where they come from gridded files."""
    currents, winds, _ = known
    said = table.uncertainty
    drifters = [s.object for s in scenarios] + [c.drifter for c in contacts if c.drifter is not None]
    reason = uncertainty.silent(currents, [s.currents for s in scenarios])
    current = uncertainty.error(said.current, uncertainty.CURRENT, reason, "current")
    if table.spill:
        current = uncertainty.in_spill(current, said.current, table.spill.current_bias)
    reason = uncertainty.silent(winds, [s.winds for s in scenarios])
    if not any(drifter.uses_wind for drifter in drifters):
        reason = UNFELT
    return current, uncertainty.error(said.wind, uncertainty.WIND, reason, "wind")


def _search(
    table: CaseTable, run: Run, wrong: Mistakes
) -> tuple[tuple[Sortie, ...], tuple[Contact, ...], tuple[Unit, ...], PlanSpec | None]:
    """Return what was searched, seen, and can be sent; what is wrong with it is added to the mistakes.

    Where the scenarios are at fault nothing is looked at: they say what is searched for, and how well it is seen.
    """
    sorties: tuple[Sortie, ...] = ()
    contacts: tuple[Contact, ...] = ()
    fleet: tuple[Unit, ...] = ()
    plan = None
    if not run.scenarios:
        return sorties, contacts, fleet, plan
    before = len(wrong.lines)
    with wrong.gathered():
        sorties = sortie_table.build(table.sortie, run)
    with wrong.gathered():
        contacts = contact_table.build(table.contact, run)
    with wrong.gathered():
        plan = table.plan.spec(run, sorties, contacts, asked=bool(table.unit) or "plan" in table.model_fields_set)
    # Units that fit no plan of the case may fit the longest that there can be.
    longest = PlanSpec(run.start, run.end, "pos", 0.0, 1, plan_table.LEAST)
    with wrong.gathered():
        fleet = plan_table.build(table.unit, run, plan or longest)
    if len(wrong.lines) == before:
        with wrong.gathered():
            plan_table.check_groups(sorties, fleet)
    return sorties, contacts, fleet, plan


def _outputs(
    table: OutputTable, start: np.datetime64, end: np.datetime64, more: list[np.datetime64]
) -> NDArray[np.datetime64]:
    sign = 1 if end > start else -1
    if table.times is not None:
        times = [units.resolve(time, start) for time in table.times]
        for time in times:
            if not min(start, end) <= time <= max(start, end):
                raise UserError(
                    f"output.times: {notation.group(time)} is outside the run, {notation.group(start)} to {notation.group(end)}"
                )
    else:
        span = abs((end - start).astype(int))
        every = max(round(table.every or 21_600.0), 1)
        if span // every > MOST_OUTPUTS:
            raise UserError(f"output.every gives {span // every:,} output times; at most {MOST_OUTPUTS}")
        times = [start + np.timedelta64(sign * k * every, "s") for k in range(span // every + 1)]
    every_time = np.unique(np.array([start, *times, *more, end], dtype="datetime64[s]"))
    return every_time[::sign]


def _shore(source: str, folder: Path) -> str:
    if source in {"gshhg", "none"}:
        return source
    return sources.one_file(source, folder, "coast.source", '; allowed are "gshhg", "none" and a shoreline file')


def _sources(
    quantity: Quantity, tables: list[SourceTable], start: np.datetime64, folder: Path, wrong: Mistakes
) -> tuple[ForcingSpec, ...]:
    """Return the sources of a quantity; one that is at fault is added to the mistakes, and stands in by its name."""
    specs: list[ForcingSpec] = []
    for number, table in enumerate(tables, 1):
        place = sources.place(quantity, number, table.name)
        spec = ForcingSpec(table.name or f"{quantity} {number}", quantity)
        with wrong.gathered(place):
            spec = table.spec(quantity, number, start, folder)
        if spec.name in {other.name for other in specs}:
            wrong.lines.append(f"{place}: two sources have this name; give each its own")
        specs.append(spec)
    if specs and all(spec.add for spec in specs):
        wrong.lines.append(
            f'{quantity} "{specs[0].name}": add = true, and there is no [[{quantity}]] to add it to: leave add out of the '
            "source that the others are added to"
        )
    return tuple(specs)
