"""Build the record of a case from its validated tables, and check that the tables fit together."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drift.case import subject
from drift.case.context import Run
from drift.case.forcing import sources, uncertainty
from drift.case.forcing.sources import SourceTable
from drift.case.record import Case, Depth
from drift.case.schema import CaseTable, CoastTable, OutputTable
from drift.case.search import barrier as barrier_table
from drift.case.search import contact as contact_table
from drift.case.search import drifter as drifter_table
from drift.case.search import look as look_table
from drift.case.search import plan as plan_table
from drift.case.search import presence as presence_table
from drift.case.search import report as report_table
from drift.case.search import sortie as sortie_table
from drift.case.sonar import sonar as sonar_table
from drift.case.sonar import tow as tow_table
from drift.case.values import units
from drift.case.values.mistakes import Mistakes
from drift.engine.environment.environment_spec import Coast
from drift.engine.environment.forcing_spec import Forcing, ForcingSpec
from drift.engine.motion.errors.buoys import BuoyTrack, PointReport
from drift.engine.motion.errors.forcing_error import CASE, DEFAULT, UNFELT, ForcingError
from drift.engine.motion.objects.leeway import Drifter
from drift.engine.motion.scenario import Scenario
from drift.evidence.filter import filling
from drift.evidence.filter.records import Contact, PlanSpec, Resampling, Sensors, Sortie, Unit
from drift.evidence.sensors.records import Processing, Sensor, Tow
from drift.spills.worlds.records import Spill
from geo import notation
from geo.errors import UserError
from geo.forcing.quantity import QUANTITIES

MOST_OUTPUTS = 1000


class _Search(NamedTuple):
    """The search of a case: sorties, contacts, observations of sensors, units and the plan.

    `plan` is None if the scenarios are invalid.
    """

    sorties: tuple[Sortie, ...] = ()
    contacts: tuple[Contact, ...] = ()
    sensors: Sensors = Sensors()
    units: tuple[Unit, ...] = ()
    plan: PlanSpec | None = None
    tows: tuple[Tow, ...] = ()
    processing: Processing | None = None
    named: Mapping[str, Sensor] = MappingProxyType({})  # the [[sensor]] tables by name


def build_case(table: CaseTable, path: Path, text: str) -> Case:
    """Build the record of a case.

    Args:
        table: the validated tables.
        path: the case file.
        text: its text, with overrides.

    Raises:
        UserError: tables do not fit together, one line for each mistake.
    """
    start, end = table.begin(), table.finish()
    folder, wrong = path.absolute().parent, Mistakes()
    forcing = {
        name: _sources(name, getattr(table, name), start, folder, wrong) for name in QUANTITIES
    }
    spill, scenarios = _build_subject(table, forcing, folder, wrong)
    search = _build_search(table, Run(start, end, scenarios, folder), wrong)
    wrong.lines += _mixed_stokes(scenarios, search.contacts)
    opens = _first_map_time(table, search, wrong)
    outputs = _outputs(table, spill, search, opens, wrong)
    current_error, wind_error = _forcing_errors(table, forcing, scenarios, search.contacts, wrong)
    run = Run(start, end, scenarios, folder)
    drifters = _drifters(table, run, current_error, wrong)
    reports = _reports(table, run, {"current": current_error, "wind": wind_error}, wrong)
    depth = _depth(table, search.units, folder, wrong)
    coast = _coast(table.coast, folder, wrong)
    resampling = table.resampling.resampling()
    if resampling.fills and not wrong.lines:
        wrong.lines += _why_not_repopulated(table, resampling, search, scenarios, start)
    wrong.lines += _missing_expected_areas(table)
    wrong.refuse()
    assert search.plan is not None
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
        about=table.output.about.told(),
        grid=table.output.grid.cells() if table.output.grid else None,
        step=table.clock.step,
        scheme=table.clock.scheme,
        tolerance=table.clock.tolerance,
        domain=table.domain.box() if table.domain else None,
        coast=coast,
        forcing=forcing,
        current_error=current_error,
        wind_error=wind_error,
        diffusivity=uncertainty.DIFFUSIVITY if diffusivity is None else diffusivity,
        diffusivity_by=DEFAULT if diffusivity is None else CASE,
        scenarios=scenarios,
        spill=replace(spill, current_bias=current_error.bias) if spill else None,
        sorties=search.sorties,
        contacts=search.contacts,
        sensors=search.sensors,
        named_sensors=search.named,
        drifters=drifters,
        reports=reports,
        units=search.units,
        plan=search.plan,
        resampling=resampling,
        expect=table.expect,
        tows=search.tows,
        processing=search.processing,
        depth=depth,
        opens=opens,
    )


def _build_subject(
    table: CaseTable, forcing: Forcing, folder: Path, wrong: Mistakes
) -> tuple[Spill | None, tuple[Scenario, ...]]:
    """Return the spill (None: none) and the scenarios; invalid ones are left out."""
    start, end = table.begin(), table.finish()
    spill: Spill | None = None
    scenarios: tuple[Scenario, ...] = ()
    with wrong.gathered():
        if table.spill:
            spill = subject.spill(table, start, end, folder)
            scenarios = subject.classes(spill, start, end, forcing)
        else:
            scenarios = subject.scenarios(table, start, end, forcing, folder)
    return spill, scenarios


def _forcing_errors(
    table: CaseTable,
    forcing: Forcing,
    scenarios: tuple[Scenario, ...],
    contacts: tuple[Contact, ...],
    wrong: Mistakes,
) -> tuple[ForcingError, ForcingError]:
    """Return the errors of current and wind.

    Missing values have defaults if the forcing comes from gridded files.
    """
    stated = table.uncertainty
    current, wind = uncertainty.CURRENT, uncertainty.WIND
    if not scenarios:  # the scenarios are invalid, so the sources they use are unknown
        return current, wind
    with wrong.gathered():
        reason = uncertainty.why_no_default(
            forcing["current"], [s.sources["current"] for s in scenarios]
        )
        current = uncertainty.error(stated.current, uncertainty.CURRENT, reason, "current")
        normal = {"[spill]": table.spill, "[[drifter]]": table.drifter, "[[report]]": table.report}
        if current.tailed and (needs := [key for key, given in normal.items() if given]):
            raise UserError(uncertainty.no_tail_beside(needs[0]))
        if table.spill:
            current = uncertainty.with_spill_bias(current, stated.current, table.spill.current_bias)
        reason = uncertainty.why_no_default(forcing["wind"], [s.sources["wind"] for s in scenarios])
        debris = [c.drifter for c in contacts if c.drifter is not None]
        if not any(own.uses_wind for own in scenarios) and not any(
            drifter.uses_wind for drifter in debris
        ):
            reason = UNFELT
        wind = uncertainty.error(stated.wind, uncertainty.WIND, reason, "wind")
    return current, wind


def _mixed_stokes(scenarios: tuple[Scenario, ...], contacts: tuple[Contact, ...]) -> list[str]:
    """Return messages about debris, and states of an object, that differ from the object in
    whether lines include the Stokes drift: they drift in the forcing of the object.
    """
    waves = [scenario for scenario in scenarios if scenario.sources.get("stokes")]
    pairs = [
        (f'scenario "{scenario.name}".change "{change.name}"', change.object, scenario.object)
        for scenario in waves
        for change in scenario.changes
    ]
    pairs += [
        (f'contact "{contact.name}".of', contact.drifter, scenario.object)
        for contact in contacts
        for scenario in waves
    ]
    different = {
        place: (own, other)
        for place, own, other in reversed(pairs)
        if own is not None and own.stokes != other.stokes
    }
    return [
        f"{place}: the Stokes drift is {_of_stokes(own)}, and {_of_stokes(other)}; both drift in the same waves: "
        'give leeway.stokes = "added", which adds it to both'
        for place, (own, other) in reversed(different.items())
    ]


def _of_stokes(drifter: Drifter) -> str:
    where = "in the lines of" if drifter.stokes == "inside" else "not in the lines of"
    return f"{where} {drifter.name}"


def _drifters(
    table: CaseTable, run: Run, current: ForcingError, wrong: Mistakes
) -> tuple[BuoyTrack, ...]:
    """Return the drifting buoys of the case; add mistakes to `wrong`."""
    if not table.drifter:
        return ()
    if table.direction == "backward":
        wrong.lines.append(
            '[[drifter]]: has no effect in a backward run; leave it out, or direction = "backward"'
        )
        return ()
    if run.scenarios and current.std == 0:
        wrong.lines.append(
            "[[drifter]]: the current has no error that a buoy could correct "
            f"({current.by[0]}); give uncertainty.current.std, or leave the drifters out"
        )
    with wrong.gathered():
        buoys = drifter_table.build_drifters(table.drifter, run)
        if run.scenarios:
            drifter_table.check_near(buoys, run.scenarios, current.length)
            drifter_table.check_wind(buoys, run.scenarios)
        return buoys
    return ()


def _reports(
    table: CaseTable, run: Run, errors: Mapping[str, ForcingError], wrong: Mistakes
) -> tuple[PointReport, ...]:
    """Return the reports of winds and currents; add mistakes to `wrong`."""
    if not table.report:
        return ()
    if table.direction == "backward":
        wrong.lines.append(
            '[[report]]: has no effect in a backward run; leave it out, or direction = "backward"'
        )
        return ()
    with wrong.gathered():
        reports = report_table.build_reports(table.report, len(table.drifter), run)
        if run.scenarios:
            report_table.check_reports(reports, run, errors)
        return reports
    return ()


def _depth(
    table: CaseTable, units: tuple[Unit, ...], folder: Path, wrong: Mistakes
) -> Depth | None:
    """Return the bathymetry of the case; None if it names no file."""
    if table.depth is None:
        if any(unit.draught > 0 for unit in units):
            wrong.lines.append(
                'draught: has no effect without depths; give [depth] file = "depths.nc", or leave draught out'
            )
        return None
    with wrong.gathered():
        file = sources.one_file(table.depth.file, folder, "depth.file")
        return Depth(file, table.depth.variable, table.depth.positive)
    return None


def _coast(table: CoastTable, folder: Path, wrong: Mistakes) -> Coast:
    """Return the specification of the coast; add mistakes in its files to `wrong`."""
    shore, lakes = table.source, table.lakes
    with wrong.gathered():
        shore = _find_shoreline(shore, folder)
    with wrong.gathered():
        lakes = sources.one_file(lakes, folder, "coast.lakes") if isinstance(lakes, str) else lakes
    return Coast(shore, table.behaviour, table.half_life or 0.0, table.offing, lakes)


def _why_not_repopulated(
    table: CaseTable,
    resampling: Resampling,
    search: _Search,
    scenarios: tuple[Scenario, ...],
    start: np.datetime64,
) -> list[str]:
    """Return the reasons why a case excludes repopulation at its contacts."""
    lines = [filling.why_not_repopulated(resampling, scenarios, search.contacts, start)]
    if table.unit or table.tow or "plan" in table.model_fields_set:
        lines.append(
            f'resampling: a plan needs particles of the posterior, and method "{resampling.method}" does not keep these; give '
            '"systematic", or leave units and [plan] out'
        )
    if search.sensors.presences or search.sensors.barriers or search.sensors.lines:
        lines.append(
            f'resampling: fields, barriers and lines need continuous tracks, and method "{resampling.method}" moves particles; give [[look]] '
            "instead, or another method"
        )
    return [line for line in lines if line]


def _missing_expected_areas(table: CaseTable) -> list[str]:
    """Return messages about expected containment areas that the case does not output."""
    areas = ", ".join(f"{percent:g}" for percent in table.output.areas)
    return [
        f"expect: there is no {percent:g} % area, only {areas} %; add {percent:g} to output.areas"
        for percent in table.expect.by_percent()
        if percent not in table.output.areas
    ]


def _build_search(table: CaseTable, run: Run, wrong: Mistakes) -> _Search:
    """Return the search of a case; add its mistakes to `wrong`.

    If the scenarios are invalid nothing is checked, because sweep widths depend on the scenarios.
    """
    if not run.scenarios:
        return _Search()
    sorties: tuple[Sortie, ...] = ()
    contacts: tuple[Contact, ...] = ()
    fleet: tuple[Unit, ...] = ()
    plan = None
    before = len(wrong.lines)
    with wrong.gathered():
        run = replace(run, sensors=sonar_table.build_sensors(table.sensor, run))
    if len(wrong.lines) > before:  # tables that name an invalid sensor would report it again
        return _Search()
    with wrong.gathered():
        sorties = sortie_table.build_sorties(table.sortie, run)
    with wrong.gathered():
        contacts = contact_table.build_contacts(table.contact, run)
    sensors = _sensors(table, run, wrong)
    with wrong.gathered():
        plan = table.plan.spec(
            run,
            sorties,
            contacts,
            sensors,
            asked=bool(table.unit or table.tow) or "plan" in table.model_fields_set,
        )
    # If the plan is invalid, units are checked against the longest possible plan, so that their own
    # mistakes are reported too.
    longest = PlanSpec(run.start, run.end, "pos", 0.0, 1, plan_table.LEAST)
    with wrong.gathered():
        fleet = plan_table.build_units(table.unit, run, plan or longest)
    if len(wrong.lines) == before:
        with wrong.gathered():
            plan_table.check_groups(sorties, fleet)
    tows: tuple[Tow, ...] = ()
    with wrong.gathered():
        tows = tow_table.build_ships(table.tow, run, plan or longest)
    if fleet and tows:
        wrong.lines.append(
            "[[unit]] and [[tow]]: a plan is either for search units, or for ships that tow arrays; plan one, append its sorties to the "
            "case, and plan the other"
        )
    processing: Processing | None = None
    if table.plan.processing is not None and plan is not None and len(tows) == len(table.tow):
        with wrong.gathered():
            processing = table.plan.processing.processing(run, plan, tows)
        if fleet:
            wrong.lines.append(
                "[[unit]] and [plan.processing]: a plan is either for search units, or for the beams to process; plan "
                "one, append its sorties to the case, and plan the other"
            )
    return _Search(sorties, contacts, sensors, fleet, plan, tows, processing, run.sensors)


def _sensors(table: CaseTable, run: Run, wrong: Mistakes) -> Sensors:
    """Return looks, presences, barriers and lines; add their mistakes to `wrong`."""
    sensors = Sensors()
    with wrong.gathered():
        sensors = replace(sensors, looks=look_table.build_looks(table.look, run))
    with wrong.gathered():
        sensors = replace(sensors, presences=presence_table.build_presences(table.presence, run))
    with wrong.gathered():
        sensors = replace(sensors, barriers=barrier_table.build_barriers(table.barrier, run))
    with wrong.gathered():
        sensors = replace(sensors, lines=barrier_table.build_lines(table.line, run))
    return sensors


def _first_map_time(table: CaseTable, search: _Search, wrong: Mistakes) -> np.datetime64 | None:
    """Return the time of map.png and of the report's first map; None: the end of the run.

    It is `output.datum`, else the begin of the plan, else the end of the last sortie.
    """
    start, end = table.begin(), table.finish()
    if table.output.datum is not None:
        with wrong.gathered():
            return _check_inside_run(
                "output.datum", units.resolve(table.output.datum, start), start, end
            )
        return None
    planned = bool(table.unit or table.tow) or "plan" in table.model_fields_set
    if planned and search.plan is not None and search.plan.begin > start:
        return search.plan.begin
    return max((sortie.end for sortie in search.sorties), default=None)


def _check_inside_run(
    key: str, time: np.datetime64, start: np.datetime64, end: np.datetime64
) -> np.datetime64:
    """Return the time of a key; raise UserError if it lies outside the run."""
    if not min(start, end) <= time <= max(start, end):
        raise UserError(
            f"{key}: {notation.format_dtg(time)} is outside the run, {notation.format_dtg(start)} to {notation.format_dtg(end)}"
        )
    return time


def _outputs(
    table: CaseTable,
    spill: Spill | None,
    search: _Search,
    opens: np.datetime64 | None,
    wrong: Mistakes,
) -> NDArray[np.datetime64]:
    """Return the output times in the order of the run.

    These are the requested times, the start and end, the times of sorties and observations, and the
    time of map.png.
    """
    start, end = table.begin(), table.finish()
    seen = (
        [find.time for find in spill.finds if find.at_sea]
        if spill
        else plan_table.map_times(search.sorties, search.contacts) + search.sensors.times
    )
    sign = 1 if end > start else -1
    asked: list[np.datetime64] = []
    with wrong.gathered():
        asked = _asked_outputs(table.output, start, end, sign)
    first = [] if opens is None else [opens]
    every_time = np.unique(np.array([start, *asked, *seen, *first, end], dtype="datetime64[s]"))
    return every_time[::sign]


def _asked_outputs(
    table: OutputTable, start: np.datetime64, end: np.datetime64, sign: int
) -> list[np.datetime64]:
    """Return the times that [output] requests; `sign` is -1 in a backward run.

    Raises UserError for times outside the run, and for too many times.
    """
    if table.times is None:
        span = abs((end - start).astype(int))
        if table.every is not None and table.every < 1:
            raise UserError(f"output.every: {table.every:g} s must be at least 1 s")
        every = round(table.every or 21_600.0)
        if span // every > MOST_OUTPUTS:
            raise UserError(
                f"output.every gives {span // every:,} output times; at most {MOST_OUTPUTS}"
            )
        return [start + np.timedelta64(sign * k * every, "s") for k in range(span // every + 1)]
    return [
        _check_inside_run("output.times", units.resolve(time, start), start, end)
        for time in table.times
    ]


def _find_shoreline(source: str, folder: Path) -> str:
    if source in {"gshhg", "none"}:
        return source
    return sources.one_file(
        source, folder, "coast.source", '; allowed are "gshhg", "none" and a shoreline file'
    )


def _sources(
    quantity: str, tables: list[SourceTable], start: np.datetime64, folder: Path, wrong: Mistakes
) -> tuple[ForcingSpec, ...]:
    """Return the sources of a quantity; add their mistakes to `wrong`.

    An invalid source is replaced by an empty one with its name.
    """
    specs: list[ForcingSpec] = []
    for number, table in enumerate(tables, 1):
        place = sources.source_label(quantity, number, table.name)
        spec = ForcingSpec(table.name or f"{quantity} {number}", quantity)
        with wrong.gathered(place):
            spec = table.spec(quantity, number, start, folder)
        if spec.name in {other.name for other in specs}:
            wrong.lines.append(f"{place}: two sources have this name; give each its own")
        specs.append(spec)
    if specs and all(spec.add for spec in specs):
        wrong.lines.append(
            f'{quantity} "{specs[0].name}": add = true, and there is no [[{quantity}]] to add it to: leave add out of '
            "the source that the others are added to"
        )
    return tuple(specs)
