"""How a case was understood: all opened and a few particles drawn, nothing run."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from drift import facts, start
from drift.case.record import Case
from drift.job import in_turn
from drift.preview import outlook
from drift.spill import renewal
from drift.spill.records import Spill
from drift.suspend import decision
from geo import notation
from geo.coast import shore
from geo.coast.segments import Segments
from geo.notation import NMI
from kernels import runtime

CHECKED = 10_000  # particles that a check draws


@in_turn
def check(case: Case, datasets: Mapping[str, Any] | None = None) -> dict[str, str]:
    """Return how a case was understood, having opened all and drawn a few particles; run nothing.

    datasets: the xarray.Datasets that its sources name.

    Raises UserError for all that a run would refuse at its start.
    """
    runtime.start()
    where = start.open_for(case, datasets, shore.thinned)
    few = replace(case, particles=min(case.particles, CHECKED))
    if case.spill:
        few = replace(few, spill=replace(case.spill, worlds=max(CHECKED // case.spill.per_world, 2)))
    begin = start.prepare(few, where)
    try:
        stretches = start.stretches(few, where, begin)
        told = {
            "work": outlook.work(case, begin.clock.step) + outlook.advised(case, where, begin),
            "by the end": outlook.ends(case, begin),
        }
    finally:
        begin.scene.forcing.close()
    box = where.box
    found: dict[str, str] = {
        "run": f"{notation.group(case.start)} to {notation.group(case.end)}, {case.particles:,} particles, step {begin.clock.step} s",
        "domain": f"{box.west:.2f} to {box.east:.2f} E, {box.south:.2f} to {box.north:.2f} N",
        **told,
        "errors": facts.errors(case),
        "coast": f"{where.coast.source}; {facts.behaviour(case)}" if where.coast else "none in the domain",
    }
    found |= {f"coast, note {k}": note for k, note in enumerate(where.notes, 1)}
    for source in where.sources:
        missing = f"{source.missing:.1%} missing; " if source.missing else ""
        found[f"{source.quantity} {source.name}"] = f"{missing}{'; '.join(source.notes) or 'as is'}"
        if lacking := outlook.holes(case, source):
            found[f"{source.quantity} {source.name}"] += f"; {lacking}: what drifts then needs another source"
    if case.spill and stretches:
        found |= _spill(case.spill, stretches)
    story = "class" if case.spill else "scenario"
    for scenario, dry in zip(case.scenarios, begin.dry, strict=True):
        found[f'{story} "{scenario.name}"'] = (
            f"{scenario.weight:.0%}, {scenario.object.name}: {scenario.object.description}"
        )
        if scenario.object.lull > 0:
            found[f'{story} "{scenario.name}"'] += f"; leads upwind in winds below {scenario.object.lull:.1f} m/s"
        if dry > 0:
            found[f'{story} "{scenario.name}"'] += f"; {dry:.1%} of its prior is on land and left out"
        if scenario.survival is not None:
            found[f'{story} "{scenario.name}"'] += f"; alive: {decision.basis(scenario)}"
    return found | _search(case)


def _search(case: Case) -> dict[str, str]:
    """Return how sorties, contacts and units were understood."""

    def seen(widths: Sequence[float]) -> str:
        told = [f"{width / NMI:.2f} nmi" for width in widths]
        return told[0] if len(set(told)) == 1 else ", ".join(told)

    found = {}
    for one in case.sorties:
        kind = "a watch" if one.watch else "an area" if one.legs is None else f"{len(one.legs.searching)} legs"
        law = one.law.kind.replace("_", " ")
        if one.watch:
            zones = zip(one.watch.inner, one.watch.outer, one.watch.pod, strict=True)
            how = "zones " + ", ".join(f"{a / NMI:g} to {b / NMI:g} nmi {pod:.0%}" for a, b, pod in zones)
        elif one.coverage:
            how = f"{law}, coverage {', '.join(f'{c:.2f}' for c in one.coverage)}"
        else:
            how = f"{law}, W {seen(one.sweep_width)}"
        found[f'sortie "{one.name}"'] = f"{kind}, {notation.group(one.start)} to {notation.group(one.end)}, {how}"
    for seen_then in case.contacts:
        doubt = (
            f"belief {seen_then.belief:g}"
            if seen_then.false_density == 0
            else f"false {seen_then.false_density:.3g} per unit"
        )
        found[f'contact "{seen_then.name}"'] = f"{seen_then.kind}, {notation.group(seen_then.time)}, {doubt}"
    for unit in case.units:
        found[f'unit "{unit.name}"'] = (
            f"from {notation.position(*unit.base)}, ready {notation.group(unit.ready)}, {unit.endurance / 3600:g} h on scene, "
            f"W {seen(unit.sweep_width)}{', by daylight' if unit.daylight else ''}"
        )
    if case.units:
        spec = case.plan
        found["plan"] = (
            f"{notation.group(spec.begin)} to {notation.group(spec.until)}, for {spec.objective}, {spec.rounds} round(s)"
        )
    return found


def _spill(spill: Spill, stretches: Segments) -> dict[str, str]:
    """Return how a spill was understood."""
    low, high = spill.objects
    rates = ", ".join(f"{kind} {86_400 * rate:g} a day" for kind, rate in spill.reporting.rate.items())
    told = {
        "spill": f"{low:,}{f' to {high:,}' if high > low else ''} objects, {spill.worlds:,} worlds of {spill.per_world:,} particles; "
        f"{spill.destroyed[0]:.0%} to {spill.destroyed[1]:.0%} destroyed at once",
        "released": f"{notation.group(spill.prior.release_start)} to {notation.group(spill.prior.release_end)}",
        "biases": f"windage a factor of {math.exp(spill.windage_bias):.2f}, current {spill.current_bias:g} m/s, reporting a factor "
        f"of {math.exp(spill.reporting_bias):.2f} (one standard deviation)",
        "reports": f"{rates}; other coast: {spill.reporting.coast}; removed {86_400 * spill.reporting.removal:g} a day",
        "stretches of coast": f"{len(stretches.name):,}, {stretches.length.sum() / 1000:,.0f} km",
    }
    for find in spill.finds:
        told[find.name] = f"{find.kind or 'class unknown'}, {notation.group(find.time)}, by {find.by or 'the public'}"
    for patrol in renewal.patrols(spill, stretches):
        told[f'patrol "{patrol["name"]}"'] = f"{len(patrol['stretches'])} stretches, {patrol['length_km']:.0f} km"
    for team in spill.teams:
        many = f"{len(team.times)} patrol{'s' * (len(team.times) > 1)} from {notation.group(team.times[0])}"
        told[f'patrol_unit "{team.name}"'] = f"{many}, {team.length / 1000:g} km a day, finds {team.detection:.0%}"
    return told
