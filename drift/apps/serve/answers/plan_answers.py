"""What the warm process answers about a plan: its sub-areas, their POS once moved, and a sortie.

All is read from the files of the plan: the case as it was planned, and its sorties. The particles
of the last plan are kept, so that the POS of a moved sub-area takes a moment.
"""

import json
import math
import os
import time
import tomllib
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drift.apps.serve import shelf
from drift.apps.serve.answers import search_answers
from drift.apps.serve.fields import form
from drift.case import file as case_file
from drift.case.record import Case
from drift.pipeline import run_options
from drift.pipeline.run_options import Options
from drift.planning.search import moved
from drift.planning.search.moved import Particles, Pos, SubArea
from drift.planning.search.products import files as plan_files
from geo import notation
from geo.errors import UserError
from geo.notation import NMI

LARGEST = 2**25  # [bytes] of a file of a plan
MOVED = ", moved by hand"


@dataclass(frozen=True, eq=False)
class Planned:
    """A plan as its files state it."""

    case: Case  # as it was planned
    areas: tuple[SubArea, ...]
    names: tuple[str, ...]
    tables: Sequence[dict[str, Any]]  # [[sortie]] of each, as in plan.toml
    numbers: Mapping[str, Any]  # plan.json


@dataclass(frozen=True, eq=False)
class Kept:
    """A plan with its particles, and the POS of the plan as it stands."""

    planned: Planned
    particles: Particles
    as_planned: Pos


_kept: dict[tuple[str, str, int], Kept] = {}  # the last plan, by folder, run and time of change


def plan(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the sub-areas of a plan, with the POS that the plan states.

    Args:
        request: `folder` and `run`, the folder of the results.
    """
    planned = _read_plan(request["folder"], request["run"])
    numbers = planned.numbers
    return {
        "run": request["run"],
        "areas": [
            {**_described(planned, k, area), "pos": float(numbers["taskings"][k]["pos"])}
            for k, area in enumerate(planned.areas)
        ],
        "total": float(numbers["pos"]),
        "objective": str(numbers["objective"]),
        "bound": numbers["bound"] if isinstance(numbers["bound"], float) else None,
        "warnings": [str(line)[:300] for line in numbers["warnings"]],
    }


def pos(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the POS of a plan whose sub-areas were moved.

    Args:
        request: `folder`, `run`, and `moves`: by name of a sub-area its `at` (lon, lat) [deg] and
            its `turned` [deg], clockwise from the orientation planned.
    """
    begun = time.monotonic()
    kept = _keep(request["folder"], request["run"])
    planned = kept.planned
    areas = _with_moves(planned, request["moves"])
    found = moved.pos(kept.particles, areas)
    return {
        "run": request["run"],
        "areas": [
            {
                **_described(planned, k, _with_land(kept.particles, planned, area)),
                "pos": found.each[k],
                "as_planned": kept.as_planned.each[k],
            }
            for k, area in enumerate(areas)
        ],
        "total": found.total,
        "as_planned": kept.as_planned.total,
        "by_scenario": {
            scenario.name: None if math.isnan(value) else value
            for scenario, value in zip(planned.case.scenarios, found.by_scenario, strict=True)
        },
        "took_ms": round(1000 * (time.monotonic() - begun)),
    }


def keep(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return a text with a sub-area of a plan as one more [[sortie]].

    Args:
        request: `folder`, `run` and `moves` as of `pos`, the `area` to keep, and the `text`.
    """
    planned = _read_plan(request["folder"], request["run"])
    k = _number(planned, request["area"])
    area = _with_moves(planned, request["moves"])[k]
    row = _moved_table(planned.tables[k], planned.areas[k], area)
    data = form.parse_text(request["text"])
    sorties = data.get("sortie", [])
    taken = {one.get("name") for one in sorties if isinstance(one, dict)}
    name, number = row["name"], 2
    while row["name"] in taken:
        row["name"], number = f"{name} ({number})", number + 1
    return {"text": form.add_table(request["text"], "sortie", row), "name": row["name"]}


def _keep(folder: str, run: str) -> Kept:
    """Return a plan with its particles, which are followed unless they are those of the last."""
    changed = os.stat(Path(folder) / run, follow_symlinks=False).st_mtime_ns
    key = (folder, run, changed)
    if key not in _kept:
        planned = _read_plan(folder, run)
        _kept.clear()
        particles = moved.particles_of(run_options.open_job(planned.case, Options()))
        _kept[key] = Kept(planned, particles, moved.pos(particles, planned.areas))
    return _kept[key]


def _read_plan(folder: str, run: str) -> Planned:
    """Return a plan as its files state it; raise UserError if they are not those of a plan."""
    try:
        numbers = json.loads(_content(folder, run, "plan.json"))
        text = json.loads(_content(folder, run, "plan.geojson"))["case"]
        written = _content(folder, run, "plan.toml").decode()
        tables = tomllib.loads(written).get("sortie", [])
        begin = f'"{numbers["begin"]}"'
        return _planned(Path(folder) / f"{run}.toml", text, written, begin, tables, numbers)
    except OSError:
        raise UserError(f"{run}: holds no plan of units that the page can show") from None
    except UserError as error:
        raise UserError(f"{run}: its plan cannot be read ({error.lines[0][:300]})") from None
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, RecursionError) as error:
        raise UserError(f"{run}: its plan cannot be read ({error})") from None


def _content(folder: str, run: str, name: str) -> bytes:
    return shelf.content_of_run(Path(folder), run, name, LARGEST)


def _planned(
    path: Path,
    text: str,
    written: str,
    begin: str,
    tables: Sequence[dict[str, Any]],
    numbers: Mapping[str, Any],
) -> Planned:
    case = case_file.load_text(path, text)
    # the case's own plan would begin after these sorties
    flown = case_file.load_text(path, f"{text}\n{written}", {"plan.begin": begin})
    by_name = {sortie.name: sortie for sortie in flown.sorties}
    areas = []
    for table, row in zip(tables, numbers["taskings"], strict=True):
        sortie = replace(by_name[table["name"]], planned=True)
        centre = row["centre"]
        takeoff = np.datetime64(row["takeoff"].rstrip("Z"), "s")
        areas.append(
            SubArea(
                sortie,
                unit=str(row["unit"]),
                centre=(float(centre["lon"]), float(centre["lat"])),
                orientation=math.radians(float(row["orientation_deg"])),
                length=float(row["length_nmi"]) * NMI,
                width=float(row["width_nmi"]) * NMI,
                takeoff=float(notation.epoch(takeoff)),
                round=int(row["round"]),
            )
        )
    labels = tuple(str(row["area"]) for row in numbers["taskings"])
    return Planned(case, tuple(areas), labels, tables, numbers)


def _number(planned: Planned, name: str) -> int:
    if name not in planned.names:
        raise UserError(f"the plan has no sub-area {name[:100]!r}")
    return planned.names.index(name)


def _with_moves(planned: Planned, moves: Mapping[str, Any]) -> list[SubArea]:
    areas = list(planned.areas)
    for name, move in moves.items():
        k = _number(planned, name)
        area = areas[k]
        turn = area.orientation + math.radians(move["turned"])
        unit = moved.case_of_unit(planned.case, area.unit)
        lon, lat = move["at"]
        areas[k] = moved.moved(area, (lon, lat), turn, unit, planned.case.plan)
    return areas


def _with_land(particles: Particles, planned: Planned, area: SubArea) -> SubArea:
    """Return a sub-area of a boat with a note if its legs cross land."""
    unit = moved.case_of_unit(planned.case, area.unit)
    if unit is None or not unit.afloat:
        return area
    length = moved.on_land(particles, area)
    if length <= 0:
        return area
    words = f"{length / NMI:.1f} nmi of its legs lie on land: the boat cannot go there"
    return replace(area, notes=(*area.notes, words))


def _described(planned: Planned, k: int, area: SubArea) -> dict[str, Any]:
    """Return what a map shows of a sub-area."""
    return {
        "name": planned.names[k],
        "unit": area.unit,
        "centre": [round(one, 6) for one in area.centre],
        "orientation": math.degrees(area.orientation) % 360,
        "length_nmi": area.length / NMI,
        "width_nmi": area.width / NMI,
        "place": notation.position(*area.centre),
        "notes": list(area.notes),
        **search_answers.sortie_shapes(area.sortie),
    }


def _moved_table(table: Mapping[str, Any], before: SubArea, area: SubArea) -> dict[str, Any]:
    """Return the [[sortie]] table of a moved sub-area."""
    row = deepcopy(dict(table))
    if area == before:
        return row
    sortie = area.sortie
    row["name"] += MOVED
    if "start" in row:
        row["start"] = notation.iso(sortie.start)
    if "end" in row:
        row["end"] = notation.iso(sortie.end)
    inner = row.get("pattern") or row.get("area")
    legs = sortie.legs
    if inner is not None:
        inner["centre"] = plan_files.navigators_position(*area.centre)
        inner["orientation"] = round(math.degrees(area.orientation) % 360, 6)
        if "corner" in inner and legs is not None:
            inner["corner"] = plan_files.navigators_position(legs.lon[0], legs.lat[0])
        if sortie.completed < 1:
            row["completed"] = max(math.floor(1e4 * sortie.completed) / 1e4, 1e-4)
    elif legs is not None:  # they are cut already
        row["waypoints"] = [
            [
                notation.iso(np.datetime64(round(t), "s")),
                plan_files.navigators_position(lon, lat),
            ]
            for t, lon, lat in zip(legs.time, legs.lon, legs.lat, strict=True)
        ]
        if silent := [k for k, seeks in enumerate(legs.searching, 1) if not seeks]:
            row["transit_legs"] = silent
        else:
            row.pop("transit_legs", None)
    return row
