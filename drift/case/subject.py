"""Build the scenarios of a case, or the classes of objects of a spill, and check them.

The records are checked against each other and against the period of the run.
"""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from drift.case.forcing import sources
from drift.case.scenario.scenario import PARAMETERS, ScenarioTable
from drift.case.schema import CaseTable
from drift.case.spill import build_spill as build_spill
from drift.case.values.mistakes import Mistakes
from drift.engine.environment.forcing_spec import Forcing, ForcingSpec
from drift.engine.motion.models import own_motion
from drift.engine.motion.models.own_motion import OwnMotion
from drift.engine.motion.objects.leeway import Drifter
from drift.engine.motion.scenario import Change, Hazard, Scenario
from drift.engine.motion.steering.itinerary import Itinerary, Phase, Spread, Ways
from drift.spills.worlds.records import Find, Patrol, Spill
from geo import notation
from geo.errors import UserError
from geo.forcing.quantity import QUANTITIES


def spill(table: CaseTable, start: np.datetime64, end: np.datetime64, folder: Path) -> Spill:
    """Build the spill of a case.

    Args:
        table: the case file's tables.
        start: start of the run.
        end: end of the run.
        folder: folder from which relative paths start.

    Raises:
        UserError: the spill is inconsistent with the run, one line for each mistake.
    """
    assert table.spill is not None
    wrong = Mistakes()
    if end < start:
        wrong.lines.append(
            "a [spill] runs forward: give an end after the start; to backtrack it from its finds, use drift origin"
        )
    if table.coast.source == "none":
        wrong.lines.append(
            'coast.source: "none": a [spill] needs a coast for its objects; give "gshhg" or a shoreline file'
        )
    if table.coast.behaviour == "slide":
        wrong.lines.append(
            'coast.behaviour: "slide": no object of a [spill] would come ashore; give "strand" or "refloat"'
        )
    named, file, record = table.spill.stretches.file, None, None
    with wrong.gathered():
        file = sources.one_file(named, folder, "spill.stretches.file") if named else None
    with wrong.gathered():
        record = build_spill(table.spill, table.find, table.patrol, table.patrol_unit, start, file)
    if record is None or end < start:
        wrong.refuse()
    assert record is not None
    events: list[Find | Patrol] = [*record.finds, *record.patrols]
    for event in events:
        if event.time > end:
            wrong.lines.append(
                f"{event.name}: at {notation.format_dtg(event.time)}, after the run's end, {notation.format_dtg(end)}; run for "
                "longer"
            )
    last = max((event.time for event in events), default=start)
    for team in record.teams:
        if team.times[0] < last:
            wrong.lines.append(
                f'patrol_unit "{team.name}": first {notation.format_dtg(team.times[0])} is before the last find or patrol, '
                f"{notation.format_dtg(last)}: a plan uses all finds and patrols; give a later first"
            )
        if team.times[-1] > end:
            wrong.lines.append(
                f'patrol_unit "{team.name}": its last patrol, at {notation.format_dtg(team.times[-1])}, is after the '
                f"run's end, {notation.format_dtg(end)}; give fewer days, or run for longer"
            )
    until = record.reporting.until
    if until is not None and until > end:
        wrong.lines.append(
            f"spill.reporting.until {notation.format_dtg(until)} is after the run's end, {notation.format_dtg(end)}; run for "
            "longer"
        )
    wrong.refuse()
    return record


def classes(
    spill: Spill, start: np.datetime64, end: np.datetime64, forcing: Forcing
) -> tuple[Scenario, ...]:
    """Return a spill's classes of objects as the scenarios that the engine moves.

    Args:
        spill: the spill.
        start: start of the run.
        end: end of the run.
        forcing: the sources of winds and currents.

    Raises:
        UserError: the release lies outside the run, or a class needs wind or current and has none.
    """
    named = {quantity: tuple(spec.name for spec in specs) for quantity, specs in forcing.items()}
    records = []
    for kind in spill.kinds:
        _check_release(f'class "{kind.name}"', spill.prior, start, end)
        _check_sources(f'class "{kind.name}"', kind.object, named)
        records.append(
            Scenario(kind.name, kind.share, kind.object, kind.jibe_rate, spill.prior, named)
        )
    return tuple(records)


def scenarios(
    case: CaseTable,
    start: np.datetime64,
    end: np.datetime64,
    forcing: Forcing,
    folder: Path,
) -> tuple[Scenario, ...]:
    """Build the scenarios of a case, with weights that add up to 1.

    Args:
        case: the case file's tables.
        start: start of the run.
        end: end of the run.
        forcing: the sources of winds and currents.
        folder: folder from which relative paths start.

    Raises:
        UserError: scenarios are inconsistent with the run, one line for each mistake.
    """
    wrong, tables = Mistakes(), case.scenario
    families = {name: place for family in case.family for name, place in family.places().items()}
    total = math.fsum(table.weight for table in tables)
    if total <= 0:
        wrong.lines.append("scenario weights add up to 0; at least one must be above 0")
    names = [table.name for table in tables]
    for name in sorted(name for name, times in Counter(names).items() if times > 1):
        wrong.lines.append(f'scenario "{name}": two scenarios have this name; give each its own')
    wrong.lines += [
        f'scenario "{name}": this name is reserved for all scenarios together; give another name'
        for name in names
        if name.strip().casefold() == "all"
    ]
    records = []
    for table in tables:
        with wrong.gathered():
            record = _scenario(table, table.weight / (total or 1.0), start, end, forcing, folder)
            records.append(replace(record, family=families.get(table.name)))
    wrong.refuse()
    return tuple(records)


def _scenario(
    table: ScenarioTable,
    weight: float,
    start: np.datetime64,
    end: np.datetime64,
    forcing: Forcing,
    folder: Path,
) -> Scenario:
    place, wrong = f'scenario "{table.name}"', Mistakes()
    own: OwnMotion | None = None
    prior: Any = None
    itinerary: Itinerary | None = None
    with wrong.gathered(place):
        own = table.own_motion(folder)
    drifter = table.drifter(own)
    with wrong.gathered(place):
        prior = table.prior(start)
    hazard: Hazard | None = None
    with wrong.gathered(place):
        hazard = table.hazard.hazard(folder) if table.hazard else None
    changes: tuple[Change, ...] = ()
    with wrong.gathered():
        changes = table.changes(start)
    if changes and end < start:
        wrong.lines.append(
            f"{place}: changes of state need a forward run; give an end after the start, or leave "
            "change out"
        )
    with wrong.gathered():
        itinerary = table.itinerary(start, end, folder)
    with wrong.gathered():
        if prior is not None:
            _check_release(place, prior, start, end)
        if itinerary is not None:
            _check_itinerary(place, itinerary, start, end)
    chosen: dict[str, tuple[str, ...]] = {}
    for quantity, specs in forcing.items():
        key = QUANTITIES[quantity].key
        with wrong.gathered():
            chosen[quantity] = _names_of_sources(getattr(table, key), specs, f"{place}.{key}")
    adrift = not table.phase or table.distress is not None
    if len(chosen) == len(forcing) and adrift and _needs_forcing(table.motion):
        with wrong.gathered():
            _check_sources(place, drifter, chosen, own)
            _check_winds_of_changes(place, changes, chosen)
        if hazard is not None and hazard.wind is not None and not chosen["wind"]:
            wrong.lines.append(
                f"{place}.hazard is by the wind and there is none: add [[wind]] with files, or "
                'constant = { speed = "12 kn", from = 240 }'
            )
        if own is not None and "waves" in own.uses and not chosen["stokes"]:
            wrong.lines.append(
                f"{place}: {own.path.name} uses waves, and the case has none: add [[stokes]], their Stokes drift"
            )
    elif itinerary is not None and itinerary.currents == "felt" and not chosen.get("current", True):
        wrong.lines.append(
            f'{place}.vessel.currents is "felt" and there is no current: add [[current]] with files, or leave it out'
        )
    wrong.refuse()
    alive = table.survival.survival() if table.survival else None
    return Scenario(
        table.name,
        weight,
        drifter,
        table.jibe_rate(drifter, *(one.object for one in changes if one.object is not None)),
        prior,
        chosen,
        search_object=table.search_object
        or (itinerary.search_object if itinerary and not adrift else None),
        model=table.motion,
        motion=own or PARAMETERS[table.motion](table),
        survival=alive,
        itinerary=itinerary,
        source_level=table.source_level,
        changes=changes,
        hazard=hazard,
    )


def _check_winds_of_changes(
    place: str, changes: tuple[Change, ...], named: Mapping[str, tuple[str, ...]]
) -> None:
    """Reject a change that needs the wind, where there is none."""
    for one in changes:
        needs = "comes by the wind"
        if one.wind is None and one.object is not None and one.object.uses_wind:
            needs = f'leads to "{one.object.name}", which drifts with the wind'
        elif one.wind is None:
            continue
        if not named["wind"]:
            raise UserError(
                f'{place}.change "{one.name}" {needs} and there is none: add [[wind]] with files, '
                'or constant = { speed = "12 kn", from = 240 }'
            )


def _needs_forcing(model: str) -> bool:
    """Return whether a model of motion needs currents and winds."""
    if model == "drift" or own_motion.is_own(model):
        return True  # answered here, because importing the models loads the Taichi compiler
    from drift.engine.motion.models.by_name import MODELS

    return MODELS[model].forced


def _check_release(place: str, prior: Any, start: np.datetime64, end: np.datetime64) -> None:
    for time in (prior.release_start, prior.release_end):
        if not min(start, end) <= time <= max(start, end):
            raise UserError(
                f"{place}: it may go adrift at {notation.format_dtg(time)}, outside the run, {notation.format_dtg(start)} to "
                f"{notation.format_dtg(end)}; change its times or the case's start and end"
            )


def _check_itinerary(
    place: str, itinerary: Itinerary, start: np.datetime64, end: np.datetime64
) -> None:
    """Reject a target that steers in a backward run, or may get under way outside the run."""
    if end < start:
        raise UserError(
            f"{place}: a target that steers needs a forward run; give an end after the start, or leave phases out"
        )
    span = f"outside the run, {notation.format_dtg(start)} to {notation.format_dtg(end)}; change its times or the case's start and end"
    for time in _departures(itinerary.phases[0]):
        if not start <= time <= end:
            raise UserError(f"{place}: it may get under way at {notation.format_dtg(time)}, {span}")
    if itinerary.overdue is not None and not start < itinerary.overdue <= end:
        raise UserError(f"{place}.overdue: {notation.format_dtg(itinerary.overdue)} is {span}")


def _departures(first: Phase) -> list[np.datetime64]:
    """Return the earliest and latest departure of a target; for a normal law, its mean."""
    if not isinstance(first, Ways):
        return []
    time = first.points[0].time
    low, high = (
        (time.low, time.high)
        if isinstance(time, Spread)
        else (time.mean, time.mean)
        if time
        else (0.0, 0.0)
    )
    return [
        first.start + np.timedelta64(round(t), "s")
        for t in (low + first.after.low, high + first.after.high)
    ]


def _check_sources(
    place: str, drifter: Drifter, named: Mapping[str, tuple[str, ...]], own: OwnMotion | None = None
) -> None:
    wrong = Mistakes()
    if not named["current"]:
        wrong.lines.append(
            f'{place} has no current: add [[current]] with files, or constant = {{ speed = "0 kn", toward = 0 }} '
            "if there is none"
        )
    if drifter.uses_wind and not named["wind"]:
        needs = (
            f"{own.path.name} takes wind"
            if own
            else f'object "{drifter.name}" drifts with the wind'
        )
        wrong.lines.append(
            f"{place}: {needs} and there is none: add [[wind]] with files, or "
            'constant = { speed = "12 kn", from = 240 }'
        )
    wrong.refuse()


def _names_of_sources(
    wanted: list[str] | None, specs: tuple[ForcingSpec, ...], place: str
) -> tuple[str, ...]:
    names = tuple(spec.name for spec in specs)
    for name in wanted or ():
        if name not in names:
            raise UserError(f'{place}: no source "{name}"; there are: {", ".join(names) or "none"}')
    if wanted is None:
        return names
    added = {spec.name for spec in specs if spec.add}
    if wanted and added.issuperset(wanted):
        rest = ", ".join(f'"{name}"' for name in names if name not in added)
        raise UserError(
            f"{place}: all of these have add = true; also name the sources to which they are added: {rest}"
        )
    for name in wanted:
        if name in added and wanted.count(name) > 1:
            raise UserError(f'{place}: "{name}" has add = true and is named twice; name it once')
    return tuple(wanted)
