"""`drift check`: open a case's inputs, draw a few particles, and report how it is interpreted."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from drift.apps.check import outlook, voyage
from drift.case.record import Case
from drift.engine.motion.errors.buoys import BuoyTrack, PointReport
from drift.engine.motion.objects.leeway import COAST_GUARD
from drift.engine.motion.scenario import UNCHANGED, Change, Hazard, Scenario
from drift.evidence.filter import contacts
from drift.evidence.filter.records import Barrier, Contact, Field, Line, Look, Presence, Sortie
from drift.evidence.sensors.records import Processing, Sensor, Sonar, Tow
from drift.evidence.suspend import alive
from drift.forecast import likeliest
from drift.pipeline import run_metadata, run_setup
from drift.pipeline.run_options import serialized
from drift.spills.worlds import renewal
from drift.spills.worlds.records import Spill
from geo import notation
from geo.box import Box
from geo.coast import shore
from geo.coast.segments import Segments
from geo.forcing.sources import Source
from geo.notation import KNOT, NMI
from geo.polyline import Area
from kernels.runtime import runtime

NAMED = 4  # most values on an axis of a scenario family that are all listed
CHECKED = 10_000  # particles that a check draws


@serialized
def check(case: Case, datasets: Mapping[str, Any] | None = None) -> dict[str, str]:
    """Report how a case is interpreted, after opening its inputs and drawing a few particles.

    Nothing is run.

    Args:
        case: a case from `drift.load` or `drift.vary`.
        datasets: the xarray.Datasets that sources of the case with `dataset = "name"` refer to, by
            that name; they are only read, and no reference is kept.

    Returns:
        The facts that `drift check` prints, by name: "run", "errors", "coast" .. A fact "warning"
        says what a run would reject at its end.

    Raises:
        UserError: what a user can change, one line for each mistake (`error.lines`): all that a run
            would reject at its start.
    """
    runtime.start()
    environment = run_setup.open_for(case, datasets, shore.thin_shore)
    # each scenario needs a particle in each member, and gets at least a tenth of an equal share
    members = len(environment.members)
    reduced = replace(
        case, particles=min(case.particles, max(CHECKED, 20 * members * len(case.scenarios)))
    )
    if case.spill:
        reduced = replace(
            reduced,
            spill=replace(case.spill, worlds=max(CHECKED // case.spill.per_world, 2, members)),
        )
    setup = run_setup.prepare(reduced, environment)
    try:
        stretches = run_setup.stretches(reduced, environment, setup.worlds)
        nodes = sum(
            s.grid.nlon * s.grid.nlat * len(s.members) for s in environment.sources if s.others
        )
        work = outlook.work_in_words(case, setup.clock.step, nodes) + outlook.advice_on_step(
            case, environment, setup
        )
        ends, rejection = outlook.predict_final_statuses(case, setup)
    finally:
        setup.scene.forcing.close()
    box, span = (
        environment.box,
        f"{notation.stated_time(case.start)} to {notation.stated_time(case.end)}",
    )
    lines = {
        "warning": rejection,
        "run": f"{span}, {case.particles:,} particles, step {setup.clock.step} s",
        "domain": _domain(case.domain, box),
        "work": work,
        "by the end": ends,
        "errors": run_metadata.describe_errors(case),
        "coast": f"{environment.coast.source}; {run_metadata.describe_coast(case)}"
        if environment.coast
        else "none in the domain",
    }
    lines = {name: text for name, text in lines.items() if text}
    for about, notes in (
        ("errors", run_metadata.error_warnings(case)),
        ("leeway", run_metadata.object_warnings(case)),
    ):
        lines |= {f"{about}, note {k}": note for k, note in enumerate(notes, 1)}
    lines |= {f"coast, note {k}": note for k, note in enumerate(environment.notes, 1)}
    lines |= {
        f"{source.quantity} {source.name}": _source(case, source) for source in environment.sources
    }
    if members:
        unit = "world" if case.spill else "particle"
        each = (case.spill.worlds if case.spill else case.particles) // members
        lines["members"] = (
            f"{members}, all equally likely; each {unit} drifts in one of them throughout, about "
            f"{each:,} in each"
        )
    if case.spill and stretches:
        lines |= _spill(case.spill, stretches)
    label = "class" if case.spill else "scenario"
    lines |= _families(case, setup.dry)
    singles = [k for k, scenario in enumerate(case.scenarios) if scenario.family is None]
    weights = np.array([case.scenarios[k].weight for k in singles])
    shown = likeliest.likeliest_scenarios(weights)
    for scenario, dry in ((case.scenarios[singles[k]], setup.dry[singles[k]]) for k in shown.alone):
        lines[f'{label} "{scenario.name}"'] = _scenario(
            scenario, dry, released=case.spill is not None
        )
    if shown.rest:
        objects = {_object_name(case.scenarios[singles[k]]) for k in shown.rest}
        listed = ", ".join(sorted(objects)[:3]) + (
            f" and {len(objects) - 3} more" if len(objects) > 3 else ""
        )
        name = shown.names([case.scenarios[k].name for k in singles])[-1]
        lines[name] = f"{notation.percent(shown.sums(weights)[-1])} together: {listed}"
    return lines | _search(case)


def _domain(stated: Box | None, box: Box) -> str:
    """Return the limits of the domain [deg]: as stated, or rounded if the run chose it."""
    west, east, south, north = (
        notation.number(angle) if stated else f"{angle:.2f}"
        for angle in (box.west, box.east, box.south, box.north)
    )
    return f"{west} to {east} E, {south} to {north} N"


def _families(case: Case, dry: Sequence[float]) -> dict[str, str]:
    """Describe families of scenarios by their axes and their likeliest scenario.

    dry: share of the prior on land, by scenario.
    """
    lines: dict[str, str] = {}
    for family in dict.fromkeys(
        scenario.family.family for scenario in case.scenarios if scenario.family
    ):
        members = [
            k
            for k, s in enumerate(case.scenarios)
            if s.family is not None and s.family.family == family
        ]
        first = case.scenarios[max(members, key=lambda k: case.scenarios[k].weight)]
        axes = [
            f"{axis.name} {', '.join(axis.labels) if len(axis.labels) <= NAMED else _span(axis.labels)}"
            for axis in family.axes
        ]
        lines[f'family "{family.name}"'] = (
            f"{_weight(sum(case.scenarios[k].weight for k in members))}, {len(members):,} "
            f"scenarios: {'; '.join(axes)}"
        )
        name = f'such as "{first.name}"'
        lines[name] = _scenario(first, max(dry[k] for k in members), released=False).replace(
            "its prior", "a prior at most"
        )
    return lines


def _span(labels: Sequence[str]) -> str:
    return f"{labels[0]} to {labels[-1]} ({len(labels)})"


def _object_name(scenario: Scenario) -> str:
    """Return the name of the object that drifts; "under way" if the scenario has no distress."""
    own = scenario.itinerary
    return "under way" if own is not None and own.distress is None else scenario.object.name


def _source(case: Case, source: Source) -> str:
    """Describe a source of forcing, with the times within the run when it has no data."""
    missing = f"{notation.percent(source.missing)} missing; " if source.missing else ""
    text = f"{missing}{'; '.join(source.notes) or 'as is'}"
    holes = outlook.gaps_in_source(case, source)
    return f"{text}; {holes}: particles that drift then need another source" if holes else text


def _scenario(scenario: Scenario, dry: float, *, released: bool) -> str:
    """Describe a scenario; dry: share of its prior that is on land; released: by a spill, whose
    position stands in a line of its own.
    """
    own = scenario.itinerary
    adrift = f"{scenario.object.name}: {scenario.object.description}"
    if scenario.object.source not in ("", COAST_GUARD):
        adrift += f" ({scenario.object.source}; measured: {scenario.object.measured})"
    text = f"{_weight(scenario.weight)}, {adrift if own is None else voyage.itinerary_in_words(own, adrift)}"
    text += "" if released else _around(scenario.prior)
    if scenario.hazard is not None:
        text += f"; distress likelier {_hazard(scenario.hazard)}"
    if scenario.object.lull > 0 and (own is None or own.distress is not None):
        text += f"; leads upwind in winds below {scenario.object.lull:.1f} m/s"
    if scenario.object.measured == "direct" and not scenario.sources.get("stokes"):
        text += "; its lines leave out the Stokes drift: add [[stokes]]"
    if dry > 0:
        text += f"; {notation.percent(dry)} of its starting positions are on land and ignored"
    if scenario.survival is not None:
        text += f"; alive: {alive.basis(scenario)}"
    return "; ".join([text, *(_change(one, scenario) for one in scenario.changes)])


def _hazard(hazard: Hazard) -> str:
    """Describe where and when distress is likelier."""
    if hazard.wind is not None:
        at, width = (notation.number(speed, 3) for speed in hazard.wind)
        return f"in the wind, half of the greatest hazard at {at} m/s, within about {width} m/s"
    text = f"in proportion to {hazard.name}"
    if hazard.depth is not None:
        text = f"in less than {notation.number(hazard.depth, 3)} m of water by {hazard.name}"
        text += f" (elsewhere {notation.number(hazard.deeper, 3)} of that)"
    if hazard.outside is not None:
        text += f", {notation.number(hazard.outside, 3)} outside of it"
    return text


def _change(one: Change, scenario: Scenario) -> str:
    """Describe a change of state of a scenario's object."""
    names = (UNCHANGED, *(other.name for other in scenario.changes))
    leaves = "" if one.leaves == (0,) else f" from {' or '.join(names[k] for k in one.leaves)}"
    if one.time is None:
        comes = f"{notation.number(one.rate * 3600, 3)} /h"
        if one.wind is not None:
            at, width = (notation.number(speed, 3) for speed in one.wind)
            comes = f"up to {comes}, half of it at {at} m/s of wind, within about {width} m/s"
    else:
        low, high = (notation.number(time / 3600, 3) for time in (one.time.low, one.time.high))
        since = "that state" if one.after else "the start"
        comes = f"{low} h after {since}" if low == high else f"{low} to {high} h after {since}"
    then = f", then {one.object.name}" if one.object is not None else ""
    if one.object is None and one.leeway != 1:
        then = f", then {notation.percent(one.leeway, 0)} of its leeway"
    return f'"{one.name}"{leaves}: {comes}{", sinks" if one.sinks else then}'


def _around(prior: Any) -> str:
    """Return the reported position of a prior and its error as text; "" without such a position."""
    if prior is None or prior.reported is None:
        return ""
    place = notation.stated_position(*prior.reported)
    axes = [getattr(prior, name, 0.0) for name in ("major", "minor")]
    if axes[0] != axes[1]:
        along, across = (notation.number(axis / NMI, 3) for axis in axes)
        return f"; from {place}, standard deviations {along} x {across} nmi"
    radius = notation.number(axes[0] * math.sqrt(2 * math.log(2)) / NMI, 3)
    return f"; from {place}" + (f", 50 % within {radius} nmi" if axes[0] > 0 else "")


def _weight(weight: float) -> str:
    """Return a weight in percent: as stated, or to three digits if the case states it otherwise."""
    return f"{notation.number(100 * weight, 3)} %"


def _search(case: Case) -> dict[str, str]:
    """Describe sorties, contacts, sensors, and the units or arrays that a plan may use."""
    lines = {f'drifter "{own.name}"': _drifter(own) for own in case.drifters}
    lines |= {f'report "{own.name}"': _report(own) for own in case.reports}
    lines |= {f'sortie "{sortie.name}"': _sortie(sortie) for sortie in case.sorties}
    for contact in case.contacts:
        doubt = f"belief {notation.number(contact.belief)}"
        if contact.false_density > 0:
            doubt = f"false {notation.number(contact.false_density)} per unit"
        lines[f'contact "{contact.name}"'] = (
            f"{contact.kind}, {notation.stated_time(contact.time)}, "
            f"{_sensor_report(contact)}{doubt}"
        )
    for what in (*case.sensors.telling, *case.sensors.lines):
        lines[f'{type(what).__name__.lower()} "{what.name}"'] = _observation(what)
    for sensor in case.named_sensors.values():
        lines[f'sensor "{sensor.name}"'] = _named_sensor(sensor)
    for unit in case.units:
        lines[f'unit "{unit.name}"'] = (
            f"from {notation.stated_position(*unit.base)}, ready {notation.stated_time(unit.ready)}, "
            f"{notation.number(unit.endurance / 3600)} h on scene, W {_widths(unit.sweep_width)}"
            f"{', by daylight' if unit.daylight else ''}"
        )
    for tow in case.tows:
        lines[f'tow "{tow.name}"'] = _tow(tow)
    spec = case.plan
    span = f"{notation.stated_time(spec.begin)} to {notation.stated_time(spec.until)}"
    if case.units:
        lines["plan"] = f"{span}, for {spec.objective}, {spec.rounds} round(s)"
    elif case.tows:
        lines["plan"] = f"{span}, where ships tow their arrays"
    if case.processing:
        lines["processing"] = _processing(case.processing)
    return lines


def _tow(tow: Tow) -> str:
    """Describe a towed array of a plan: its speed, legs, ready time, and allowed areas."""
    words = [
        f'tows "{tow.sensor.name}" at {notation.number(tow.speed / KNOT)} kn on {"a leg" if tow.legs == 1 else "one or two legs"}'
    ]
    if tow.base is not None:
        words.append(
            f"from {notation.stated_position(*tow.base)} at {notation.number(tow.transit_speed / KNOT)} kn"
        )
    words.append(f"ready {notation.stated_time(tow.ready)}")
    if math.isfinite(tow.endurance):
        words.append(f"for {notation.number(tow.endurance / 3600)} h")
    words.append(f"begins in {_extent(tow.begin)}")
    if tow.allowed is not None:
        words.append(f"stays in {_extent(tow.allowed)}")
    if tow.courses is not None:
        low, high = (math.degrees(course) % 360 for course in tow.courses)
        words.append(f"courses {notation.bearing(low)} to {notation.bearing(high)}")
    return ", ".join(words)


def _extent(area: Area) -> str:
    """Return the corners of an area as text."""
    return " - ".join(
        f"{notation.position(*corner)}" for corner in zip(area.lon, area.lat, strict=True)
    )


def _processing(own: Processing) -> str:
    """Describe the processing plan: beams, number of processors, and time slots."""
    beams = ", ".join(
        f"{one.name} {many}" for one, many in zip(own.listeners, own.beams, strict=True)
    )
    slots = len(own.edges) - 1
    hours = (own.edges[1] - own.edges[0]) / np.timedelta64(1, "h")
    manned = (
        "" if own.manned.all() else f", {int(own.manned.sum())} of {own.manned.size} slots manned"
    )
    cost = f", a beam must add {notation.number(own.cost)}" if own.cost > 0 else ""
    span = f"{notation.format_dtg(own.edges[0])} to {notation.format_dtg(own.edges[-1])}"
    return f"{span}, {slots} slot(s) of {notation.number(hours)} h, {len(own.processors)} processor(s){manned}, beams: {beams}{cost}"


def _sensor_report(contact: Contact) -> str:
    """Describe what a sensor of the case reported of a contact; "" without such a sensor."""
    own = contact.heard
    if own is None:
        return ""
    words = [f'sensor "{own.sensor.name}"']
    if own.mirrored:
        image = math.degrees(contacts.mirrored_bearing(contact.bearing, own.heading))
        words.append(
            f"bearing {notation.bearing(math.degrees(contact.bearing))} or {notation.bearing(image)}"
        )
    if own.level is not None:
        words.append(f"received level {notation.number(own.level[0])} dB")
    if own.tone is not None:
        words.append(
            f"frequency {notation.number(own.tone.value)} Hz of {notation.number(own.tone.source)} Hz"
        )
    return "".join(f"{word}, " for word in words)


def _named_sensor(sensor: Sensor) -> str:
    """Describe a sensor by its kind and position."""
    sees = sensor.sees
    if isinstance(sees, Sonar):
        many = len(sees.gain.beams)
        beams = f", {many} beams" if many > 1 else ""
        kind = (
            f"sonar{beams}, transmission loss to {notation.number(sees.losses.range[-1] / NMI)} nmi"
        )
    else:
        kind = f"POD {sees.name}, {'by place' if sees.range is None else f'to {notation.number(sees.range[-1] / NMI)} nmi'}"
    where = (
        "on its carrier"
        if sensor.place is None
        else f"at {notation.stated_position(*sensor.place)}"
    )
    return f"{kind}, {where}"


def _observation(observation: Look | Presence | Barrier | Line) -> str:
    """Describe an observation of a sensor: its field, times and report."""
    if isinstance(observation, Line):
        return f"{len(observation.points)} points; its first crossing is reported"
    if isinstance(observation, Look):
        sees = "something" if observation.positive else "nothing"
        if observation.field is None:
            assert observation.sensor is not None
            return f'sensor "{observation.sensor.name}", {notation.stated_time(observation.time)}, sees {sees}'
        return f"{_field(observation.field)}, {notation.stated_time(observation.time)}, {observation.sight.kind.replace('_', ' ')}, sees {sees}"
    span = (
        f"{notation.stated_time(observation.start)} to "
        f"{notation.stated_time(observation.end)}, detection {notation.number(observation.detection)}"
    )
    if isinstance(observation, Presence):
        return f"{_field(observation.field)}, {span}, present {observation.present}"
    report = (
        "reports nothing"
        if observation.reported is None
        else f"reports {notation.stated_time(observation.reported)}"
    )
    return f"{len(observation.points)} points, {span}, {report}"


def _field(field: Field) -> str:
    if field.radius > 0:
        return f"{notation.number(field.radius / NMI)} nmi about {notation.stated_position(field.lon, field.lat)}"
    return f"{notation.number(field.width / NMI)} by {notation.number(field.height / NMI)} nmi about {notation.stated_position(field.lon, field.lat)}"


def _drifter(own: BuoyTrack) -> str:
    """Describe a drifting buoy: its fixes, and what was left out of them."""
    first, last = (
        notation.format_dtg(np.datetime64(int(t), "s")) for t in (own.time[0], own.time[-1])
    )
    facts = [
        f"{own.time.size} fixes, {first} to {last}, {(~own.fresh).sum()} displacements",
        f"windage {notation.percent(own.windage)}, fixes right to {notation.number(own.error)} m",
        *own.notes,
    ]
    return ", ".join(facts)


def _report(own: PointReport) -> str:
    """Describe a wind or current reported on scene."""
    speed = f"{notation.number(float(np.hypot(*own.velocity)) / KNOT, 3)} kn"
    moment = notation.stated_time(np.datetime64(int(own.time), "s"))
    toward = math.degrees(math.atan2(*own.velocity))
    way = (
        f"from {_rounded(toward + 180)}" if own.quantity == "wind" else f"toward {_rounded(toward)}"
    )
    return (
        f"{own.quantity} {speed} {way} at {notation.stated_position(own.lon, own.lat)}, {moment}, "
        f"right to {notation.number(own.error / KNOT, 3)} kn"
    )


def _rounded(degrees: float) -> str:
    return notation.bearing(round(degrees % 360, 1))


def _sortie(sortie: Sortie) -> str:
    """Describe a sortie: where it searched, when, and with which detection function."""
    kind = (
        "a watch"
        if sortie.watches
        else "an area"
        if sortie.legs is None
        else _legs(sortie.search_legs)
    )
    law = sortie.law.kind.replace("_", " ")
    if sortie.sensor:
        beams = (
            f" by beams {', '.join(str(beam + 1) for beam in sortie.beams)}" if sortie.beams else ""
        )
        detection = f'sensor "{sortie.sensor.name}"{beams}'
    elif sortie.watch:
        zones = zip(sortie.watch.inner, sortie.watch.outer, sortie.watch.pod, strict=True)
        detection = "zones " + ", ".join(
            f"{notation.number(a / NMI)} to {notation.number(b / NMI)} nmi {notation.hundredths(pod)} %"
            for a, b, pod in zones
        )
    elif sortie.coverage:
        detection = f"{law}, coverage {_by_scenario(sortie.coverage, '')}"
    else:
        detection = f"{law}, W {_widths(sortie.sweep_width)}"
    return f"{kind}, {notation.stated_time(sortie.start)} to {notation.format_dtg(sortie.end)}, {detection}"


def _legs(number: int) -> str:
    return f"{number} leg{'s' * (number != 1)}"


def _widths(widths: Sequence[float]) -> str:
    """Return sweep widths [m] as text; one number if all scenarios have the same."""
    words = [f"{notation.number(width / NMI)} nmi" for width in widths]
    return (
        words[0]
        if len(set(words)) == 1
        else _by_scenario([width / NMI for width in widths], " nmi")
    )


def _by_scenario(values: Sequence[float], unit: str) -> str:
    """Return a number for each scenario as text; the range if there are many."""
    words = [f"{notation.number(value)}{unit}" for value in values]
    if not likeliest.likeliest_scenarios(values).rest:
        return ", ".join(words)
    least, most = notation.number(min(values)), f"{notation.number(max(values))}{unit}"
    return most if f"{least}{unit}" == most else f"{least} to {most}"


def _spill(spill: Spill, stretches: Segments) -> dict[str, str]:
    """Describe a spill: objects, release, biases, reporting, finds and patrols."""
    low, high = spill.objects
    rates = ", ".join(
        f"{kind} {notation.number(86_400 * rate)} a day"
        for kind, rate in spill.reporting.rate.items()
    )
    lines = {
        "spill": f"{low:,}{f' to {high:,}' if high > low else ''} objects, "
        f"{spill.worlds:,} worlds of {spill.per_world:,} particles; "
        + _destroyed(*spill.destroyed),
        "released": f"{notation.format_dtg(spill.prior.release_start)} to {notation.format_dtg(spill.prior.release_end)}"
        + _around(spill.prior),
        "biases": f"windage a factor of {notation.number(math.exp(spill.windage_bias))}, current {notation.number(spill.current_bias)} m/s, "
        f"reporting a factor of {notation.number(math.exp(spill.reporting_bias))} (one standard deviation)",
        "reports": f"{rates}; other coast: {spill.reporting.coast}; removed {notation.number(86_400 * spill.reporting.removal)} a day",
        "stretches of coast": f"{len(stretches.name):,}, {stretches.length.sum() / 1000:,.0f} km",
    }
    for find in spill.finds:
        lines[find.name] = (
            f"{find.kind or 'class unknown'}, {notation.stated_time(find.time)}, by {find.by or 'the public'}"
        )
    if spill.finds or spill.patrols:
        last = max([find.time for find in spill.finds] + [patrol.time for patrol in spill.patrols])
        lines["assumed no other reports"] = (
            f"until {notation.stated_time(spill.reporting.until)} (spill.reporting.until)"
            if spill.reporting.until is not None
            else f"until {notation.format_dtg(last)}, the last find or patrol; set spill.reporting.until to change that"
        )
    for patrol in renewal.rows_of_patrols(spill, stretches):
        lines[f'patrol "{patrol["name"]}"'] = (
            f"{len(patrol['stretches'])} stretches, {patrol['length_km']:.0f} km"
        )
    for team in spill.teams:
        base = f", from {notation.stated_position(*team.base)}" if team.base else ""
        many = f"{len(team.times)} patrol{'s' * (len(team.times) > 1)} from {notation.format_dtg(team.times[0])}"
        lines[f'patrol_unit "{team.name}"'] = (
            f"{many}{base}, {notation.number(team.length / 1000)} km a day, finds {notation.hundredths(team.detection)} %"
        )
    return lines


def _destroyed(least: float, most: float) -> str:
    """Describe the share of a spill's objects that is destroyed at once."""
    if most == 0:
        return "none is destroyed at once"
    low, high = notation.hundredths(least), notation.hundredths(most)
    share = f"{low} %" if least == most else f"{low} to {high} %"
    return f"of which {share} are destroyed at once (they neither drift nor come ashore)"
