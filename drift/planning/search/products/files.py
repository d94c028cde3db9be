"""Search plan as GPX 1.1 routes, KML 2.2, GeoJSON and [[sortie]] tables for the case."""

import json
import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drift.evidence.filter import patterns
from drift.evidence.filter import shapes as search_shapes
from drift.evidence.filter.detection import laws
from drift.planning.search.products import subareas
from drift.planning.search.products import text as plan_text
from drift.planning.search.records import Plan, Tasking
from drift.products.files import gpx as gpx_file
from drift.products.files import kml as kml_file
from drift.products.files import markup
from geo import notation, sphere
from geo.notation import KNOT, NMI

SAME = 20.0  # [m] largest deviation of legs from a pattern that is written in their place
INKS = ("ff2a00c8", "ffb04f0b", "ff008a1c", "ff7a0f9b", "ff006a8a", "ff3a3a3a")  # aabbggrr


def plan_as_json(plan: Plan) -> dict[str, Any]:
    """Return a plan's numbers for plan.json; see drift.planning.search.products.subareas."""
    return {**subareas.summary_of_plan(plan), "warnings": plan_text.rough(plan)}


def gpx(plan: Plan, title: str = "Search plan", run: str = "") -> str:
    """Return a GPX document: a route for each tasking, and its search point as a waypoint.

    The route leads from the base over the ends of all legs to home.
    """
    root = gpx_file.document(title, _about(plan, run))
    named = list(zip(subareas.names(plan), plan.taskings, strict=True))
    for name, tasking in named:
        start = next(point for point in subareas.route(name, tasking) if point.what == "csp")
        _point(root, "wpt", start, f"commence search, {tasking.unit.name}")
    for number, (name, tasking) in enumerate(named, 1):
        way = ET.SubElement(root, "rte")
        markup.leaf(way, "name", f"{name} {tasking.unit.name}")
        markup.leaf(way, "desc", _description(tasking))
        markup.leaf(way, "number", str(number))
        markup.leaf(way, "type", "search")
        for point in subareas.route(name, tasking):
            _point(way, "rtept", point, "")
    return markup.document_text(root)


def _point(parent: ET.Element, tag: str, at: subareas.Waypoint, words: str) -> None:
    """Append a GPX point."""
    gpx_file.point(
        parent, tag, at.lon, at.lat, time=at.time, name=at.name, words=words, kind=at.what
    )


def kml(plan: Plan, title: str = "Search plan", run: str = "") -> str:
    """Return a KML document with a folder for each tasking.

    It holds sub-area, legs, ways out and home, and search point; lines are cut at 180 degrees.
    """
    root, document = kml_file.document(title, _about(plan, run))
    for k, ink in enumerate(INKS):
        kml_file.style(document, f"area{k}", ink, "3", fill=f"22{ink[2:]}")
        kml_file.style(document, f"legs{k}", ink, "1.5")
        kml_file.style(document, f"transit{k}", f"99{ink[2:]}", "1")
    for k, (name, tasking) in enumerate(zip(subareas.names(plan), plan.taskings, strict=True)):
        folder = kml_file.folder(document, f"{name} {tasking.unit.name}")
        for shape, geometry in _shapes(tasking).items():
            ends = (
                (tasking.takeoff, tasking.home)
                if shape == "transit"
                else (tasking.on_scene, tasking.off_scene)
            )
            kml_file.append_place(
                folder,
                name if shape == "area" else f"{name} {shape}",
                _description(tasking),
                (notation.iso(ends[0]), notation.iso(ends[1])),
                ""
                if shape == "csp"
                else f"{'transit' if shape == 'round' else shape}{k % len(INKS)}",
                geometry,
            )
    return markup.document_text(root)


def geojson(plan: Plan, attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a plan as GeoJSON (RFC 7946; shapes are cut at 180 degrees).

    Its shapes are areas, legs, ways round land, ways out and home (transit) and search points.
    """
    features = []
    numbers = plan_as_json(plan)
    counts = {
        f"effective_particles_{name}": value
        for name, value in numbers["effective_particles"].items()
    }
    for row, tasking in zip(numbers["taskings"], plan.taskings, strict=True):
        for shape, geometry in _shapes(tasking).items():
            properties = {"shape": shape, **row, **counts}
            features.append({"type": "Feature", "geometry": geometry, "properties": properties})
    return {
        "type": "FeatureCollection",
        **{k: attributes[k] for k in sorted(attributes)},
        "features": features,
    }


def _shapes(tasking: Tasking) -> dict[str, dict[str, Any]]:
    """Return a tasking's shapes as GeoJSON geometries."""
    area = patterns.rectangle(tasking.centre, tasking.length, tasking.width, tasking.orientation)
    shapes = {"area": search_shapes.polygon([search_shapes.outline(area)])}
    if legs := search_shapes.flown(tasking.sortie):
        shapes["legs"] = search_shapes.lines([points for searching, points in legs if searching])
        if ways := [points for searching, points in legs if not searching]:
            shapes["round"] = search_shapes.lines(ways)
    if ways := subareas.transits(tasking):
        shapes["transit"] = search_shapes.lines(ways)
    return {**shapes, "csp": search_shapes.point(*subareas.begin(tasking))}


def _description(tasking: Tasking) -> str:
    """Return a tasking in one line."""
    return (
        f"{tasking.unit.name}: on scene {notation.format_dtg(tasking.on_scene)}, off {notation.format_dtg(tasking.off_scene)}; "
        f"{tasking.length / NMI:.1f} x {tasking.width / NMI:.1f} nmi, spacing {tasking.spacing / NMI:.2f} nmi, "
        f"creep {subareas.degrees(tasking.creep):03d}T, {notation.number(tasking.unit.search_speed / KNOT)} kn; "
        f"POS {notation.probability(tasking.pos)}"
    )


def _about(plan: Plan, run: str) -> str:
    """Return the head of a file: the run, and warnings about few particles."""
    return ". ".join(
        [
            *([f"run {run}"] if run else []),
            *(f"WARNING: {warning}" for warning in plan_text.rough(plan)),
        ]
    )


def toml(plan: Plan, taken: Sequence[str] = ()) -> str:
    """Return the plan's sorties as [[sortie]] tables that can be appended to its case.

    A sortie is written as its pattern, or as waypoints with times if its legs differ from the
    pattern.

    Args:
        plan: with the sorties.
        taken: names of the case's own sorties, which new names must avoid.
    """
    used, parts = (
        set(taken),
        [
            "# The plan's sorties. Append them to the case after they were flown and found nothing; enter what was done with",
            '# completed = "60 %" or actual = "track.gpx".',
        ],
    )
    parts += [f"# WARNING: {warning}" for warning in plan_text.rough(plan)]
    for name, tasking in zip(subareas.names(plan), plan.taskings, strict=True):
        title, number = f"{name} {tasking.unit.name}", 2
        while title in used:
            title, number = f"{name} {tasking.unit.name} ({number})", number + 1
        used.add(title)
        table = _table(title, tasking, plan)
        parts += ["", "[[sortie]]", *(f"{key} = {value}" for key, value in table.items())]
    return "\n".join(parts) + "\n"


def _table(name: str, tasking: Tasking, plan: Plan) -> dict[str, str]:
    """Return the keys of a [[sortie]] table with their values in TOML."""
    sortie = tasking.sortie
    table = {"name": _quoted(name)}
    if sortie.kind:
        table["unit"] = _quoted(sortie.kind)
    table["start"] = _quoted(notation.iso(sortie.start))
    if sortie.legs is None:
        table["end"] = _quoted(notation.iso(sortie.end))
    if not sortie.ashore:
        table["ashore"] = "false"
    table["law"] = laws.formulas_of(sortie.law).written(sortie.law)
    table["sweep_width"] = _widths(sortie.sweep_width, plan)
    if sortie.width_under_way not in ((), sortie.sweep_width):
        table["sweep_width_under_way"] = _widths(sortie.width_under_way, plan)
    if math.isfinite(sortie.shape):
        table["sweep_width_uncertainty"] = f"{1 / math.sqrt(sortie.shape):.9g}"
    if sortie.group:
        table["sweep_group"] = _quoted(sortie.group)
    table["speed"] = _quoted(f"{tasking.unit.search_speed / KNOT:.9g} kn")
    if math.isfinite(sortie.altitude):
        table["altitude"] = _quoted(f"{sortie.altitude / 0.3048:.9g} ft")
    return table | _where(tasking)


def _where(tasking: Tasking) -> dict[str, str]:
    """Return the search of a sortie: a pattern, waypoints, or an area with its spacing."""
    sortie = tasking.sortie
    shape = {
        "centre": _quoted(navigators_position(*tasking.centre)),
        "length": _quoted(f"{tasking.length / NMI:.9g} nmi"),
        "width": _quoted(f"{tasking.width / NMI:.9g} nmi"),
        "orientation": f"{math.degrees(tasking.orientation) % 360:.9g}",
    }
    if sortie.legs is None:
        # Write the spacing that gives the plan's coverage with these sweep widths.
        pairs = zip(sortie.sweep_width, sortie.coverage, strict=True)
        apart = next(
            (width / coverage for width, coverage in pairs if width > 0 and coverage > 0),
            tasking.spacing,
        )
        return {"area": _inline(shape), "spacing": _quoted(f"{apart / NMI:.9g} nmi")}
    if _is_parallel(tasking):
        spacing, corner = (
            f"{tasking.spacing / NMI:.9g} nmi",
            navigators_position(*subareas.begin(tasking)),
        )
        shape |= {"spacing": _quoted(spacing), "corner": _quoted(corner)}
        return {"pattern": _inline({"kind": '"parallel"', **shape})}
    legs = sortie.legs
    rows = [
        f"[{_quoted(notation.iso(np.datetime64(round(t), 's')))}, {_quoted(navigators_position(x, y))}]"
        for t, x, y in zip(legs.time, legs.lon, legs.lat, strict=True)
    ]
    searched = {"waypoints": "[\n  " + ",\n  ".join(rows) + ",\n]"}
    if not all(legs.searching):
        searched["transit_legs"] = str(
            [k for k, seeks in enumerate(legs.searching, 1) if not seeks]
        )
    return searched


def _is_parallel(tasking: Tasking) -> bool:
    """Return True if the legs equal the parallel pattern of this size and time."""
    legs = tasking.sortie.legs
    assert legs is not None
    start = search_shapes.epoch(tasking.sortie.start)
    size = tasking.length, tasking.width, tasking.orientation, tasking.spacing
    if not tasking.manner.plain:
        return False
    for corner in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        try:
            pattern = patterns.parallel(
                tasking.centre, *size, start, tasking.unit.search_speed, corner
            ).legs
        except ValueError:
            return False
        if len(pattern.lon) != len(legs.lon) or not all(legs.searching):
            return False
        apart = sphere.distance(*np.radians([pattern.lon, pattern.lat, legs.lon, legs.lat]))
        late = np.abs(np.subtract(pattern.time, legs.time))
        if apart.max() < SAME and late.max() < SAME / tasking.unit.search_speed + 1:
            return True
    return False


def _widths(widths: Sequence[float], plan: Plan) -> str:
    """Return sweep widths in TOML: one, or one for each scenario.

    A family is written by its own name, with the width of most of its scenarios.
    """
    values = [_quoted(f"{width / NMI:.9g} nmi") for width in widths]
    if len(set(values)) == 1:
        return values[0]
    families = plan.families or (None,) * len(values)
    by_family: dict[str, Counter[str]] = {}
    for family, value in zip(families, values, strict=True):
        if family is not None:
            by_family.setdefault(family, Counter())[value] += 1
    table = {family: many.most_common(1)[0][0] for family, many in by_family.items()}
    table |= {
        name: value
        for name, family, value in zip(plan.scenarios, families, values, strict=True)
        if family is None or table[family] != value
    }
    return _inline({_quoted(name): value for name, value in table.items()})


def _inline(table: Mapping[str, str]) -> str:
    """Return a TOML inline table."""
    return "{ " + ", ".join(f"{key} = {value}" for key, value in table.items()) + " }"


def _quoted(text: str) -> str:
    """Return a TOML basic string; JSON's escapes are valid except for the delete character."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def navigators_position(lon: float, lat: float) -> str:
    """Return a position in degrees and minutes to 0.2 m: 27 30.5000N 088 15.0000W."""
    lon = sphere.wrap_degrees(lon)
    return (
        f"{_minutes(lat, 2)}{'N' if lat >= 0 else 'S'} {_minutes(lon, 3)}{'E' if lon >= 0 else 'W'}"
    )


def _minutes(angle: float, digits: int) -> str:
    """Return an angle in degrees and minutes."""
    tenthousandths = round(abs(angle) * 600_000)  # [1e-4 arc minutes]
    return f"{tenthousandths // 600_000:0{digits}d} {tenthousandths % 600_000 / 10_000:07.4f}"
