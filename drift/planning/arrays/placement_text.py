"""Text outputs of a plan of towed arrays: text, JSON and [[sortie]] tables for the case."""

import json
import math
from typing import Any

import numpy as np

from drift.products.files.text_sheet import paragraph, text_sheet
from geo import notation, sphere
from geo.notation import KNOT, NMI

LOOSE = 0.99  # a bound above this is not reported
RELAXED = (
    "The bound lets each array use the best position, heading and beam of its cell at every moment, turn at will, draw its "
    "fluctuation again in each time slot, and divide its time among several ways"
)


def _worth(plan: Any) -> str:
    """Return one line with the plan's POD and its upper bound."""
    chosen, found = plan.placement, plan.bound
    line = f"POD {notation.percent(plan.pos)} on the case's own particles; {notation.percent(chosen.value)} on the {chosen.particles:,} planning particles"
    if found.value >= LOOSE:
        return line + "; no useful upper bound is known"
    return (
        line
        + f"; no plan exceeds {notation.percent(found.value)} (bound on {found.particles:,} of these, where this plan has {notation.percent(found.plan)})"
    )


def placement_as_text(plan: Any, title: str, run: str) -> str:
    """Return the plan as text for the ships."""
    ships: list[str] = []
    for placed, sortie, pos in zip(plan.placement.placed, plan.sorties, plan.pos_of, strict=True):
        tow = placed.sea.tow
        ships += [
            "",
            *paragraph(
                f'{tow.name} tows "{tow.sensor.name}" at {notation.number(tow.speed / KNOT)} kn, POD {notation.percent(pos)} after those before it',
                3,
            ),
        ]
        for time, lon, lat, what in vertices(placed, sortie):
            ships += paragraph(
                f"{notation.format_dtg(time)}  {notation.position(lon, lat)}  {what}", 6, 10
            )
    alternatives = [
        line
        for name, value in plan.placement.alternatives
        for line in paragraph(f"{name}: {notation.percent(value)}", 3, 6)
    ]
    notes = (
        f"POD: probability that any ship hears the target by {notation.format_dtg(plan.until)}.",
        f"{RELAXED}; {plan.bound.slots} slots, cells of {plan.bound.cell / NMI:.0f} nmi.",
        "The POD of alternatives is computed on the planning particles.",
    )
    sections = (
        ("WORTH", paragraph(f"{_worth(plan)}.", 3)),
        ("SHIPS", ships),
        ("ALTERNATIVES", alternatives),
        ("NOTES", [line for note in notes for line in paragraph(note, 3)]),
    )
    return text_sheet(
        "TOWED ARRAYS", title, run, sections, conventions="Times are UTC, courses true"
    )


def vertices(placed: Any, sortie: Any) -> list[tuple[np.datetime64, float, float, str]]:
    """Return the points of a ship's way: start, turn and end.

    Args:
        placed: the ship with its way.
        sortie: its planned sortie.

    Returns:
        For each point the time, longitude [deg], latitude [deg], and what the ship does there with
            its new course.
    """
    legs = sortie.legs
    found = []
    for k, (time, lon, lat) in enumerate(zip(legs.time, legs.lon, legs.lat, strict=True)):
        if k < len(legs.time) - 1:
            course = _course(lon, lat, legs.lon[k + 1], legs.lat[k + 1])
            what = f"{'begins' if k == 0 else 'turns'}, course {course:03.0f}"
        else:
            what = "ends"
        found.append((np.datetime64(round(time), "s"), float(sphere.wrap_degrees(lon)), lat, what))
    return found


def _course(lon: float, lat: float, to_lon: float, to_lat: float) -> float:
    """Return the initial course [deg] from one position [deg] to another."""
    east, north = sphere.offset(*(math.radians(x) for x in (lon, lat, to_lon, to_lat)))
    return math.degrees(math.atan2(float(east), float(north))) % 360


def toml(plan: Any) -> str:
    """Return the planned watches as [[sortie]] tables for the case file."""
    parts = [
        "# The watches of the plan. Append them to the case if the ships kept them and heard nothing."
    ]
    for sortie in plan.sorties:
        points = [
            f"    [{json.dumps(notation.iso(np.datetime64(round(t), 's')))}, [{sphere.wrap_degrees(x):.5f}, {y:.5f}]],"
            for t, x, y in zip(sortie.legs.time, sortie.legs.lon, sortie.legs.lat, strict=True)
        ]
        parts += [
            "",
            "[[sortie]]",
            f"name = {json.dumps(sortie.name, ensure_ascii=False)}",
            "waypoints = [",
            *points,
            "]",
        ]
        parts += [f"watch = {{ sensor = {json.dumps(sortie.sensor.name, ensure_ascii=False)} }}"]
    return "\n".join(parts) + "\n"


def summary_of_placement(plan: Any) -> dict[str, Any]:
    """Return the plan as JSON data."""
    chosen = plan.placement
    return {
        "pod": plan.pos,
        "pod_made_on": chosen.value,
        "pod_made_on_standard_error": chosen.standard_error,
        "bound": plan.bound.value,
        "bound_of_plan": plan.bound.plan,
        "bound_particles": plan.bound.particles,
        "ships": [
            {
                "name": placed.sea.tow.name,
                "sensor": placed.sea.tow.sensor.name,
                "pod": pos,
                "pod_alone": placed.value,
                "speed_kn": placed.sea.tow.speed / KNOT,
                "legs": [
                    {"time": notation.iso(time), "lon_deg": lon, "lat_deg": lat, "what": what}
                    for time, lon, lat, what in vertices(placed, sortie)
                ],
            }
            for placed, sortie, pos in zip(chosen.placed, plan.sorties, plan.pos_of, strict=True)
        ],
        "alternatives": [{"name": name, "pod": value} for name, value in chosen.alternatives],
    }


def placement_facts(plan: Any) -> dict[str, str]:
    """Return the plan as a few labelled lines for a terminal."""
    rows = {"plan": _worth(plan)}
    for placed, sortie, pos in zip(plan.placement.placed, plan.sorties, plan.pos_of, strict=True):
        way = "; ".join(
            f"{notation.format_dtg(t)[:6]}Z {notation.position(x, y)} {what}"
            for t, x, y, what in vertices(placed, sortie)
        )
        rows[placed.sea.tow.name] = f"{way}; POD {notation.percent(pos)}"
    rows |= {
        f"else {k}": f"{name}: {notation.percent(value)}"
        for k, (name, value) in enumerate(plan.placement.alternatives, 1)
    }
    return rows
