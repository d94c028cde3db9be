"""How a case was understood: all opened and a few particles drawn, nothing run."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from drift.apps.check import outlook, voyage
from drift.case.record import Case
from drift.engine.motion.scenario import Scenario
from drift.evidence.filter import contacts
from drift.evidence.filter.records import Barrier, Contact, Field, Line, Look, Presence, Sortie
from drift.evidence.sensors.records import Processing, Sensor, Sonar, Tow
from drift.evidence.suspend import alive
from drift.forecast import likeliest
from drift.pipeline import run_metadata, run_setup
from drift.pipeline.run_options import in_turn
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

NAMED = 4  # values on an axis of a family that are all named
CHECKED = 10_000  # particles that a check draws


@in_turn
def check(case: Case, datasets: Mapping[str, Any] | None = None) -> dict[str, str]:
    """Return how a case was understood, having opened all and drawn a few particles; run nothing.

    Args:
        case: of `drift.load` or `drift.vary`.
        datasets: the xarray.Datasets that sources of the case with `dataset = "name"` name, by that
            name; they are only read, and not kept.

    Returns:
        Facts by name, in the words of `drift check`: "run", "errors", "coast" .. A fact "warning"
        says what a run would reject at its end.

    Raises:
        UserError: what a user can change, one line for each mistake (`error.lines`): all that a run
            would reject at its start.
    """
    runtime.start()
    where = run_setup.open_for(case, datasets, shore.thinned)
    # each scenario needs a particle of each, and has a tenth of an equal share at least
    members = len(where.members)
    few = replace(
        case, particles=min(case.particles, max(CHECKED, 20 * members * len(case.scenarios)))
    )
    if case.spill:
        few = replace(
            few, spill=replace(case.spill, worlds=max(CHECKED // case.spill.per_world, 2, members))
        )
    begin = run_setup.prepare(few, where)
    try:
        stretches = run_setup.stretches(few, where, begin.worlds)
        nodes = sum(s.grid.nlon * s.grid.nlat * len(s.members) for s in where.sources if s.others)
        work = outlook.work(case, begin.clock.step, nodes) + outlook.advised(case, where, begin)
        ends, refused = outlook.ends(case, begin)
    finally:
        begin.scene.forcing.close()
    box, span = where.box, f"{notation.stated_time(case.start)} to {notation.stated_time(case.end)}"
    lines = {
        "warning": refused,
        "run": f"{span}, {case.particles:,} particles, step {begin.clock.step} s",
        "domain": _domain(case.domain, box),
        "work": work,
        "by the end": ends,
        "errors": run_metadata.errors(case),
        "coast": f"{where.coast.source}; {run_metadata.behaviour(case)}"
        if where.coast
        else "none in the domain",
    }
    lines = {name: text for name, text in lines.items() if text}
    lines |= {f"coast, note {k}": note for k, note in enumerate(where.notes, 1)}
    lines |= {f"{source.quantity} {source.name}": _source(case, source) for source in where.sources}
    if members:
        one = "world" if case.spill else "particle"
        each = (case.spill.worlds if case.spill else case.particles) // members
        lines["members"] = (
            f"{members}, all as likely; each {one} drifts in one of them for its life, about {each:,} in each"
        )
    if case.spill and stretches:
        lines |= _spill(case.spill, stretches)
    story = "class" if case.spill else "scenario"
    lines |= _families(case, begin.dry)
    own = [k for k, scenario in enumerate(case.scenarios) if scenario.family is None]
    weights = np.array([case.scenarios[k].weight for k in own])
    shown = likeliest.likeliest_scenarios(weights)
    for scenario, dry in ((case.scenarios[own[k]], begin.dry[own[k]]) for k in shown.alone):
        lines[f'{story} "{scenario.name}"'] = _scenario(scenario, dry)
    if shown.rest:
        objects = {_becomes(case.scenarios[own[k]]) for k in shown.rest}
        some = ", ".join(sorted(objects)[:3]) + (
            f" and {len(objects) - 3} more" if len(objects) > 3 else ""
        )
        name = shown.names([case.scenarios[k].name for k in own])[-1]
        lines[name] = f"{notation.percent(shown.sums(weights)[-1])} together: {some}"
    return lines | _search(case)


def _domain(stated: Box | None, box: Box) -> str:
    """Return the limits of the domain [deg]: as stated, or rounded where the run chose it."""
    west, east, south, north = (
        notation.number(angle) if stated else f"{angle:.2f}"
        for angle in (box.west, box.east, box.south, box.north)
    )
    return f"{west} to {east} E, {south} to {north} N"


def _families(case: Case, dry: Sequence[float]) -> dict[str, str]:
    """Return how families of scenarios were understood, each by its axes and its likeliest
    scenario; dry: as of `_scenario`.
    """
    lines: dict[str, str] = {}
    for family in dict.fromkeys(
        scenario.family.family for scenario in case.scenarios if scenario.family
    ):
        own = [
            k
            for k, s in enumerate(case.scenarios)
            if s.family is not None and s.family.family == family
        ]
        first = case.scenarios[max(own, key=lambda k: case.scenarios[k].weight)]
        axes = [
            f"{axis.name} {', '.join(axis.labels) if len(axis.labels) <= NAMED else _span(axis.labels)}"
            for axis in family.axes
        ]
        lines[f'family "{family.name}"'] = (
            f"{_weight(sum(case.scenarios[k].weight for k in own))}, {len(own):,} scenarios: {'; '.join(axes)}"
        )
        name = f'such as "{first.name}"'
        lines[name] = _scenario(first, max(dry[k] for k in own)).replace(
            "its prior", "a prior at most"
        )
    return lines


def _span(labels: Sequence[str]) -> str:
    return f"{labels[0]} to {labels[-1]} ({len(labels)})"


def _becomes(scenario: Scenario) -> str:
    """Return what drifts in a scenario; of what never goes adrift, that it is under way."""
    own = scenario.itinerary
    return "under way" if own is not None and own.distress is None else scenario.object.name


def _source(case: Case, source: Source) -> str:
    """Return how a source was understood, and when within the run it has nothing."""
    missing = f"{notation.percent(source.missing)} missing; " if source.missing else ""
    text = f"{missing}{'; '.join(source.notes) or 'as is'}"
    holes = outlook.holes(case, source)
    return f"{text}; {holes}: what drifts then needs another source" if holes else text


def _scenario(scenario: Scenario, dry: float) -> str:
    """Return how a scenario was understood; dry: share of its prior that is on land."""
    own = scenario.itinerary
    adrift = f"{scenario.object.name}: {scenario.object.description}"
    text = f"{_weight(scenario.weight)}, {adrift if own is None else voyage.itinerary_in_words(own, adrift)}"
    if scenario.object.lull > 0 and (own is None or own.distress is not None):
        text += f"; leads upwind in winds below {scenario.object.lull:.1f} m/s"
    if dry > 0:
        text += f"; {notation.percent(dry)} of its starting positions are on land and ignored"
    if scenario.survival is not None:
        text += f"; alive: {alive.basis(scenario)}"
    return text


def _weight(weight: float) -> str:
    """Return a weight in percent: as stated, or to three digits where the case states it in other
    units.
    """
    return f"{notation.number(100 * weight, 3)} %"


def _search(case: Case) -> dict[str, str]:
    """Return how sorties, contacts, sensors and what a plan may send were understood."""
    lines = {f'sortie "{sortie.name}"': _sortie(sortie) for sortie in case.sorties}
    for contact in case.contacts:
        doubt = f"belief {notation.number(contact.belief)}"
        if contact.false_density > 0:
            doubt = f"false {notation.number(contact.false_density)} per unit"
        lines[f'contact "{contact.name}"'] = (
            f"{contact.kind}, {notation.stated_time(contact.time)}, {_heard(contact)}{doubt}"
        )
    for what in (*case.sensors.telling, *case.sensors.lines):
        lines[f'{type(what).__name__.lower()} "{what.name}"'] = _sensor(what)
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
    """Return what a ship tows, from when on, how, and where it may."""
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
    """Return the corners of an area."""
    return " - ".join(
        f"{notation.stated_position(*corner)}" for corner in zip(area.lon, area.lat, strict=True)
    )


def _processing(own: Processing) -> str:
    """Return whose beams are processed, by how many, and when."""
    beams = ", ".join(
        f"{one.name} {many}" for one, many in zip(own.listeners, own.beams, strict=True)
    )
    slots = len(own.edges) - 1
    hours = (own.edges[1] - own.edges[0]) / np.timedelta64(1, "h")
    manned = (
        "" if own.manned.all() else f", {int(own.manned.sum())} of {own.manned.size} slots manned"
    )
    cost = f", a beam must add {notation.number(own.cost)}" if own.cost > 0 else ""
    span = f"{notation.group(own.edges[0])} to {notation.group(own.edges[-1])}"
    return f"{span}, {slots} slot(s) of {notation.number(hours)} h, {len(own.processors)} processor(s){manned}, beams: {beams}{cost}"


def _heard(contact: Contact) -> str:
    """Return what a sensor of the case told of a contact; "" where none did."""
    own = contact.heard
    if own is None:
        return ""
    words = [f'sensor "{own.sensor.name}"']
    if own.mirrored:
        image = math.degrees(contacts.image(contact.bearing, own.heading))
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
    """Return what a sensor is, and where."""
    sees = sensor.sees
    if isinstance(sees, Sonar):
        many = len(sees.gain.beams)
        beams = f", {many} beams" if many > 1 else ""
        kind = f"sonar{beams}, losses {sees.losses.name} to {notation.number(sees.losses.range[-1] / NMI)} nmi"
    else:
        kind = f"POD {sees.name}, {'by place' if sees.range is None else f'to {notation.number(sees.range[-1] / NMI)} nmi'}"
    where = (
        "on what carries it"
        if sensor.place is None
        else f"at {notation.stated_position(*sensor.place)}"
    )
    return f"{kind}, {where}"


def _sensor(what: Look | Presence | Barrier | Line) -> str:
    """Return what a sensor was, when it looked on, and what it said."""
    if isinstance(what, Line):
        return f"{len(what.points)} points; its first crossing is reported"
    if isinstance(what, Look):
        sees = "something" if what.positive else "nothing"
        if what.field is None:
            assert what.sensor is not None
            return f'sensor "{what.sensor.name}", {notation.stated_time(what.time)}, sees {sees}'
        return f"{_field(what.field)}, {notation.stated_time(what.time)}, {what.sight.kind.replace('_', ' ')}, sees {sees}"
    span = f"{notation.stated_time(what.start)} to {notation.stated_time(what.end)}, detection {notation.number(what.detection)}"
    if isinstance(what, Presence):
        return f"{_field(what.field)}, {span}, present {what.present}"
    report = (
        "reports nothing"
        if what.reported is None
        else f"reports {notation.stated_time(what.reported)}"
    )
    return f"{len(what.points)} points, {span}, {report}"


def _field(field: Field) -> str:
    if field.radius > 0:
        return f"{notation.number(field.radius / NMI)} nmi about {notation.stated_position(field.lon, field.lat)}"
    return f"{notation.number(field.width / NMI)} by {notation.number(field.height / NMI)} nmi about {notation.stated_position(field.lon, field.lat)}"


def _sortie(sortie: Sortie) -> str:
    """Return what a sortie searched, when, and how well."""
    kind = (
        "a watch"
        if sortie.watches
        else "an area"
        if sortie.legs is None
        else _legs(sortie.search_legs)
    )
    law = sortie.law.kind.replace("_", " ")
    if sortie.sensor:
        some = (
            f" by beams {', '.join(str(beam + 1) for beam in sortie.beams)}" if sortie.beams else ""
        )
        how = f'sensor "{sortie.sensor.name}"{some}'
    elif sortie.watch:
        zones = zip(sortie.watch.inner, sortie.watch.outer, sortie.watch.pod, strict=True)
        how = "zones " + ", ".join(
            f"{notation.number(a / NMI)} to {notation.number(b / NMI)} nmi {notation.hundredths(pod)} %"
            for a, b, pod in zones
        )
    elif sortie.coverage:
        how = f"{law}, coverage {_by_scenario(sortie.coverage, '')}"
    else:
        how = f"{law}, W {_widths(sortie.sweep_width)}"
    return f"{kind}, {notation.stated_time(sortie.start)} to {notation.group(sortie.end)}, {how}"


def _legs(number: int) -> str:
    return f"{number} leg{'s' * (number != 1)}"


def _widths(widths: Sequence[float]) -> str:
    """Return sweep widths [m] in words; once where they are the same for all scenarios."""
    words = [f"{notation.number(width / NMI)} nmi" for width in widths]
    return (
        words[0]
        if len(set(words)) == 1
        else _by_scenario([width / NMI for width in widths], " nmi")
    )


def _by_scenario(values: Sequence[float], unit: str) -> str:
    """Return a number of each scenario in words; from least to most where they are many."""
    words = [f"{notation.number(value)}{unit}" for value in values]
    if not likeliest.likeliest_scenarios(values).rest:
        return ", ".join(words)
    least, most = notation.number(min(values)), f"{notation.number(max(values))}{unit}"
    return most if f"{least}{unit}" == most else f"{least} to {most}"


def _spill(spill: Spill, stretches: Segments) -> dict[str, str]:
    """Return how a spill was understood."""
    low, high = spill.objects
    rates = ", ".join(
        f"{kind} {notation.number(86_400 * rate)} a day"
        for kind, rate in spill.reporting.rate.items()
    )
    lines = {
        "spill": f"{low:,}{f' to {high:,}' if high > low else ''} objects, "
        f"{spill.worlds:,} worlds of {spill.per_world:,} particles; "
        + _destroyed(*spill.destroyed),
        "released": f"{notation.group(spill.prior.release_start)} to {notation.group(spill.prior.release_end)}",
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
        lines["besides, none reported"] = (
            f"until {notation.stated_time(spill.reporting.until)} (spill.reporting.until)"
            if spill.reporting.until is not None
            else f"until {notation.group(last)}, the last find or patrol; say otherwise by spill.reporting.until"
        )
    for patrol in renewal.patrols(spill, stretches):
        lines[f'patrol "{patrol["name"]}"'] = (
            f"{len(patrol['stretches'])} stretches, {patrol['length_km']:.0f} km"
        )
    for team in spill.teams:
        many = f"{len(team.times)} patrol{'s' * (len(team.times) > 1)} from {notation.group(team.times[0])}"
        lines[f'patrol_unit "{team.name}"'] = (
            f"{many}, {notation.number(team.length / 1000)} km a day, finds {notation.hundredths(team.detection)} %"
        )
    return lines


def _destroyed(least: float, most: float) -> str:
    """Return in words what share of a spill's objects is lost at once."""
    if most == 0:
        return "none is lost at once"
    low, high = notation.hundredths(least), notation.hundredths(most)
    share = f"{low} %" if least == most else f"{low} to {high} %"
    return f"of which {share} are lost at once (destroyed: they neither drift nor come ashore)"
