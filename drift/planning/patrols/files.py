"""Text outputs of a patrol plan: a schedule, tables, GeoJSON and [[patrol]] tables for the case.

The [[patrol]] tables are meant to be appended to the case after the patrols were made.
"""

import json
import math
from collections.abc import Mapping
from typing import Any

from drift.forecast import effective
from drift.planning.patrols import planner as patrol_planner
from drift.planning.patrols.planner import PatrolPlan, Slot, Visit
from drift.products.files import formats, geojson
from drift.products.files.text_sheet import SYNTHETIC, paragraph, text_sheet
from drift.spills.worlds.products import tables as washup_tables
from drift.spills.worlds.renewal import SpillResult
from geo import notation

HEADER = (
    "date_time_group",
    "time",
    "patrol_unit",
    "segment",
    "stretch_id",
    "stretch",
    "position",
    "access",
    "length_km",
    "lying",
    "found",
    "found_se",
    "effective_worlds",
)
LONGEST = 4  # most stretches named in a warning


def patrol_text(plan: PatrolPlan, after: SpillResult, title: str, run: str, synthetic: bool) -> str:
    """Return the schedule as text."""
    value = paragraph(f"Objective: the most objects found on average. {_worth(plan)}.", 3)
    if plan.daily:
        value += paragraph(
            "Planned day by day: the bound is the sum of the best of each day alone, and is loose.",
            3,
        )
    value += paragraph(f"Not sent: {', '.join(plan.idle)}", 3) if plan.idle else []
    lines: list[str] = []
    for slot, visits in patrol_planner.by_patrol(plan):
        length = sum(float(after.segments.length[visit.segment]) for visit in visits) / 1000
        total = sum(visit.found for visit in visits)
        head = f"{notation.format_dtg(slot.when)}  {slot.team.name}: {length:.1f} of {slot.team.length / 1000:.1f} km"
        lines += [
            "",
            *paragraph(f"{head}, detection {slot.team.detection:.2f}, {total:.2g} found", 3, 6),
        ]
        for visit in sorted(visits, key=lambda visit: -visit.found):
            name = washup_tables.stretch_with_town(after.segments, visit.segment)
            size = float(after.segments.length[visit.segment]) / 1000
            figures = f"{visit.found:.2g} +- {visit.error:.1g} found of {visit.lying:.2g}   {size:.1f} km   {name}"
            lines += paragraph(figures, 6, 10)
    notes = (
        "Found: expected number of objects, without those that the public reports or removes before the patrol "
        "arrives; on a second visit, those that the first one missed and later arrivals.",
        "Unless it crosses water a team stays on one land mass, and its reach is measured over land.",
        f"A stretch is visited at most {patrol_planner.VISITS} times, over its whole length. Travel between stretches is not included. "
        f"Stretches that would add under {100 * patrol_planner.TRIFLE:g} % to a patrol are left out.",
        "After the patrols append patrols.toml to the case, corrected to what was done, and each object found as a [[find]].",
    )
    remarks = [line for note in notes for line in paragraph(f"- {note}", 3, 5)]
    sections = (("WORTH", value), ("PATROLS", lines), ("NOTES", remarks))
    return text_sheet(
        "PATROL PLAN", title, run, sections, warnings=warnings(plan, after, synthetic)
    )


def _worth(plan: PatrolPlan) -> str:
    """Return one line with the expected number found and its upper bound."""
    expected = f"{plan.found:.3g} +- {plan.error:.2g} objects found on average (sampling)"
    return f"{expected}; no plan of these teams finds more than {_up(plan.bound)} on average"


def _up(value: float) -> str:
    """Return a bound rounded up to three digits."""
    if value <= 0:
        return "0"
    step = 10.0 ** (math.floor(math.log10(value)) - 2)
    return f"{math.ceil(value / step) * step:.3g}"


def warnings(plan: PatrolPlan, after: SpillResult, synthetic: bool) -> list[str]:
    """Return warnings about the reliability of a plan."""
    lines = [SYNTHETIC] if synthetic else []
    count = effective.Count(after.posterior.effective, after.spill.worlds, "worlds")
    if count.few:
        lines.append(effective.sentence(count, "", "numbers and the choice of stretches are rough"))
    return [*lines, *plan.notes, *too_long(plan, after)]


def too_long(plan: PatrolPlan, after: SpillResult, *, most: int = LONGEST) -> list[str]:
    """Return a warning for each team with stretches longer than its daily length.

    Args:
        plan: of the patrols.
        after: the spill's result.
        most: how many of the stretches are named.
    """
    lines = []
    for team in after.spill.teams:
        rows = [row for row in plan.left_out if row.team is team]
        if not rows:
            continue
        length = [float(after.segments.length[row.segment]) / 1000 for row in rows]
        named = [
            f"{washup_tables.stretch_with_town(after.segments, row.segment)} ({km:.1f} km, {row.lying:.2g} objects)"
            for row, km in zip(rows[:most], length, strict=False)
        ]
        if len(rows) > most:
            named.append(
                f"and {len(rows) - most} others, see patrols_left_out.csv"
                if most
                else "see patrols_left_out.csv"
            )
        many = f"{len(rows)} stretch{'es' * (len(rows) > 1)}, {sum(length):.1f} km"
        lines.append(
            f"{team.name} leaves out {many}, where {sum(row.lying for row in rows):.2g} objects lie: longer than its "
            f"{team.length / 1000:g} km a day: {'; '.join(named)}; cut them shorter ([spill.stretches])"
        )
    return lines


def left_out(plan: PatrolPlan, after: SpillResult, run: str) -> str:
    """Return a CSV row for each stretch that is longer than the team's daily length."""
    rows = [
        {
            "patrol_unit": row.team.name,
            "day_km": f"{row.team.length / 1000:g}",
            **_stretch(after, row.segment),
            "lying": row.lying,
            "effective_worlds": after.posterior.effective,
        }
        for row in plan.left_out
    ]
    return formats.csv_rows(rows, run=run, digits=".6g")


def csv(plan: PatrolPlan, after: SpillResult, run: str) -> str:
    """Return a CSV row for each visit, by time and team."""
    worlds = after.posterior.effective
    rows = [
        [
            notation.format_dtg(slot.when),
            slot.when,
            slot.team.name,
            *_stretch(after, visit.segment).values(),
            visit.lying,
            visit.found,
            visit.error,
            worlds,
        ]
        for slot, visits in patrol_planner.by_patrol(plan)
        for visit in visits
    ]
    return formats.csv_text(HEADER, rows, run=run, digits=".6g")


def _stretch(after: SpillResult, number: int) -> dict[str, Any]:
    """Return what all files say of a stretch, by the names of their columns."""
    segments = after.segments
    lon, lat = float(segments.lon[number]), float(segments.lat[number])
    return {
        "segment": number,
        "stretch_id": segments.id[number],
        "stretch": segments.name[number],
        "position": notation.position(lon, lat) or "",
        "access": segments.access[number],
        "length_km": float(segments.length[number]) / 1000,
    }


def toml(plan: PatrolPlan, after: SpillResult) -> str:
    """Return the plan as [[patrol]] tables for the case file."""
    used_names = {patrol.name for patrol in after.spill.patrols}
    parts = [
        "# The plan's patrols. Append them to the case after the patrols. Correct "
        "what was done differently: stretches left out, the time, the",
        "# detection. Objects found are [[find]] tables with by = the patrol's name.",
    ]
    for slot, visits in patrol_planner.by_patrol(plan):
        name, number = patrol_planner.heading(slot), 2
        while name in used_names:
            name, number = f"{patrol_planner.heading(slot)} ({number})", number + 1
        used_names.add(name)
        parts += [
            "",
            "[[patrol]]",
            f"name = {json.dumps(name, ensure_ascii=False)}",
            f"stretches = [{', '.join(json.dumps(_spelled(after, visit), ensure_ascii=False) for visit in visits)}]",
            f'time = "{notation.iso(slot.when)}"',
            f"detection = {slot.team.detection:g}",
        ]
    return "\n".join(parts) + "\n"


def lines(plan: PatrolPlan, after: SpillResult, attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the visited stretches as a GeoJSON FeatureCollection, by time and team.

    Lines are cut at the antimeridian.
    """
    segments, features = after.segments, []
    for slot, visits in patrol_planner.by_patrol(plan):
        for visit in visits:
            s = visit.segment
            properties = {
                "patrol_unit": slot.team.name,
                "time": notation.iso(slot.when),
                **_stretch(after, s),
                "stretch": washup_tables.stretch_with_town(segments, s),
                "length_km": float(f"{segments.length[s] / 1000:.6g}"),
                "detection": slot.team.detection,
                "lying": float(f"{visit.lying:.6g}"),
                "found": float(f"{visit.found:.6g}"),
                "found_se": float(f"{visit.error:.6g}"),
            }
            features.append(geojson.feature(geojson.lines([segments.lines[s]]), properties))
    return geojson.collection(features, attributes)


def summary_of_patrols(plan: PatrolPlan) -> dict[str, Any]:
    """Return the plan as JSON data."""
    return {
        "found": plan.found,
        "found_se": plan.error,
        "bound": plan.bound,
        "day_by_day": plan.daily,
        "left_out": [
            {"patrol_unit": row.team.name, "segment": row.segment, "lying": row.lying}
            for row in plan.left_out
        ],
        "patrols": [
            {
                "patrol_unit": slot.team.name,
                "time": slot.when,
                "segments": [visit.segment for visit in visits],
                "found": sum(visit.found for visit in visits),
            }
            for slot, visits in patrol_planner.by_patrol(plan)
        ],
    }


def patrol_facts(plan: PatrolPlan, after: SpillResult) -> dict[str, str]:
    """Return the plan as labelled lines for a terminal."""
    lines = {"plan": _worth(plan)}
    for slot, visits in patrol_planner.by_patrol(plan):
        names = "; ".join(
            washup_tables.stretch_with_town(after.segments, visit.segment) for visit in visits
        )
        lines[_key(slot)] = f"{sum(visit.found for visit in visits):.2g} found: {names}"
    if plan.idle:
        lines["not sent"] = ", ".join(plan.idle)
    return lines | {
        f"warning {k}": warning
        for k, warning in enumerate(warnings(plan, after, synthetic=False), 1)
    }


def _key(slot: Slot) -> str:
    """Return the label of a patrol: time and team."""
    return f"{notation.format_dtg(slot.when)} {slot.team.name}"


def _spelled(after: SpillResult, visit: Visit) -> str:
    """Return a stretch as a case file names it: by the user's name, else by its id."""
    name, place = after.segments.name[visit.segment], after.segments.id[visit.segment]
    where = notation.position(
        float(after.segments.lon[visit.segment]), float(after.segments.lat[visit.segment])
    )
    return place if where and where in name else name
