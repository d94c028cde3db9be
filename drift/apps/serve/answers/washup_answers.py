"""What the warm process answers about a spill's result: stretches of coast over time, and patrols.

A first map, which writes no file, is answered in the same form.
"""

import csv
import io
import json
import tomllib
from collections.abc import Mapping, Sequence
from copy import deepcopy
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import xarray as xr

from drift.apps.serve import shelf
from drift.apps.serve.answers import result_answers
from drift.apps.serve.fields import form
from drift.pipeline.result import Result
from drift.products.maps import gazetteer
from drift.spills.worlds import washup as spill_washup
from drift.spills.worlds.products import headline, tables
from geo import notation, sphere
from geo.array import Array
from geo.errors import UserError

NAME, SHOWN = "washup.nc", "stretches of coast"
LARGEST = 2**26  # [bytes] of a file
MOST_STRETCHES, MOST_TIMES = 300, 200
COARSE = 2e-4  # [deg] detail of a stretch that is left out
DIGITS = 4  # significant, of figures
SKETCH = {"spill.worlds": "400", "spill.per_world": "50", "spill.redraws": "0"}  # of a first map


def washup(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the stretches of a result, its finds and its planned patrols.

    Args:
        request: `folder` and `run`, the folder of the results.
    """
    run = request["run"]
    try:
        with result_answers.opened_file(request, NAME, SHOWN) as data:
            lines = json.loads(_content(request, "washup.geojson"))["features"]
            told = _washup(data.load(), lines)
        summary = json.loads(_content(request, "summary.json"))
        plan = summary.get("patrol_plan")
        return {
            "run": run,
            **told,
            "finds": _finds(request),
            "patrols": [] if plan is None else _patrols(request),
            "plan": None
            if plan is None
            else {name: float(plan[name]) for name in ("found", "found_se", "bound")},
            "warnings": [str(line)[:300] for line in summary["warnings"]],
        }
    except UserError:
        raise
    except (OSError, ValueError, KeyError, IndexError, TypeError, AttributeError) as error:
        words = "" if isinstance(error, OSError) else f" ({str(error)[:100]})"
        raise UserError(f"{run}: holds no {SHOWN} that the page can show{words}") from None


def washup_of_sketch(result: Result) -> dict[str, Any] | None:
    """Return the stretches of a first map; None if it is not of a spill."""
    after = result.aftermath
    if after is None:
        return None
    lines = tables.washup_geojson(after.washup, after.segments, {})["features"]
    told = _washup(after.washup, lines)
    return {"run": "", **told, "finds": [], "patrols": [], "plan": None, "warnings": []}


def words_of_sketch(result: Result) -> str | None:
    """Return the headline of a first map of a spill; None if it is not of one."""
    return None if result.washup is None else headline.washup_headline(result.washup)


def _washup(data: xr.Dataset, lines: Sequence[Any]) -> dict[str, Any]:
    """Return the worst stretches by time and class, with their lines."""
    chosen = spill_washup.worst_stretches(data, MOST_STRETCHES)
    times = data["time"].values[:MOST_TIMES]
    at = data.isel(segment=chosen)
    segments = at["segment"].values.tolist()
    shapes = {one["properties"]["segment"]: one["geometry"] for one in lines}
    kinds = [str(kind) for kind in data["kind"].values]
    expected = [at["expected"].values]
    if len(kinds) > 1:
        expected += list(at["expected_by_kind"].values)
    low, _, high = at["number"].values
    fates = [str(fate) for fate in data["fate"].values]
    k = fates.index("ashore")
    total = data["total"].values
    range_ = data["total_number"].values[[0, 2], k]
    ashore = np.stack([total[k], *range_], axis=1)[: len(times)]
    first = at["first_arrival"].values[1]
    if first.dtype.kind != "M":  # not read from a file: seconds since 1970
        first = np.where(np.isfinite(first), np.rint(first), np.nan).astype("datetime64[s]")
    return {
        "times": [f"{time.astype('datetime64[s]')}Z" for time in times],
        "classes": kinds,
        "lost": float(f"{total[:, -1].sum():.6g}"),
        "ashore": _rounded(ashore),
        "expected": [_rounded(one[: len(times)]) for one in expected],
        "low": low[: len(times)].tolist(),
        "high": high[: len(times)].tolist(),
        "probability": _rounded(at["probability"].values[: len(times)]),
        "number": int(data.sizes["segment"]),
        "stretches": [
            {
                "id": str(at["stretch_id"].values[k]),
                "segment": segment,
                "name": _name(at, k),
                "at": [
                    round(float(sphere.wrap_degrees(at["lon"].values[k])), 5),
                    round(float(at["lat"].values[k]), 5),
                ],
                "length_km": float(f"{at['length'].values[k] / 1000:.4g}"),
                "first": None if np.isnat(first[k]) else notation.iso(first[k]),
                "lines": _lines(shapes[segment]),
            }
            for k, segment in enumerate(segments)
        ],
    }


def _name(at: xr.Dataset, k: int) -> str:
    """Return the name of a stretch, with the nearest town if it is only a position."""
    name = str(at["name"].values[k])
    lon, lat = float(at["lon"].values[k]), float(at["lat"].values[k])
    place = notation.position(lon, lat) or ""
    town = ""
    if place and place in name and at["near"].values[k]:
        town = gazetteer.place_in_words(
            gazetteer.Near(
                str(at["near"].values[k]),
                float(at["near_distance"].values[k]),
                bool(at["near_across_water"].values[k] > 0),
            )
        )
    return tables.stretch_name(int(at["segment"].values[k]), name, place) + (
        f", {town}" if town else ""
    )


def _lines(geometry: Any) -> list[list[list[float]]]:
    """Return the lines of a stretch without detail that the map does not show."""
    shape = shapely.simplify(shapely.geometry.shape(geometry), COARSE)
    parts = shapely.get_parts(shape)
    return [np.round(shapely.get_coordinates(part), 5).tolist() for part in parts]


def _rounded(values: Array) -> list[Any]:
    """Return numbers to some significant digits; what is unknown is 0."""
    values = np.nan_to_num(np.asarray(values, float))
    power = DIGITS - 1 - np.floor(np.log10(np.maximum(np.abs(values), 1e-12)))
    rounded: list[Any] = np.round(np.round(values * 10.0**power) / 10.0**power, 10).tolist()
    return rounded


def _content(request: Mapping[str, Any], name: str) -> bytes:
    return shelf.content_of_run(Path(request["folder"]), request["run"], name, LARGEST)


def _rows(request: Mapping[str, Any], name: str) -> list[dict[str, str]]:
    """Return the rows of a CSV file of a result; none if there is no such file."""
    try:
        text = _content(request, name).decode()
    except FileNotFoundError:
        return []
    return list(csv.DictReader(io.StringIO(text)))


def _finds(request: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [
        {
            "name": row["name"],
            "at": [float(row["lon_deg"]), float(row["lat_deg"])],
            "stretch": row["stretch"],
            "chance": float(row["probability_beforehand"]),
            "odd": row["odd"] == "yes",
        }
        for row in _rows(request, "finds.csv")
    ]


def _patrols(request: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the planned patrols: team, time and stretches, and its table as in patrols.toml."""
    rows = _rows(request, "patrols.csv")
    groups = [
        (key, list(visits))
        for key, visits in groupby(rows, lambda row: (row["time"], row["patrol_unit"]))
    ]
    return [
        {
            "name": table["name"],
            "team": team,
            "time": time,
            "length_km": float(f"{sum(float(row['length_km']) for row in visits):.4g}"),
            "found": float(f"{sum(float(row['found']) for row in visits):.4g}"),
            "visits": [
                {
                    "segment": int(row["segment"]),
                    "name": row["stretch"],
                    "lying": float(row["lying"]),
                    "found": float(row["found"]),
                }
                for row in visits
            ],
        }
        for ((time, team), visits), table in zip(groups, _tables(request), strict=True)
    ]


def _tables(request: Mapping[str, Any]) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = tomllib.loads(_content(request, "patrols.toml").decode()).get(
        "patrol", []
    )
    return found


def keep_patrol(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return a text with a planned patrol as one that was carried out.

    Args:
        request: `folder` and `run`, the name of the `patrol`, and the `text`.
    """
    run = request["run"]
    try:
        held = {table["name"]: table for table in _tables(request)}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise UserError(f"{run}: holds no patrols that the page can show") from None
    if request["patrol"] not in held:
        raise UserError(f"{run}: has no patrol {request['patrol'][:100]!r}")
    row = deepcopy(held[request["patrol"]])
    data = form.parse_text(request["text"])
    rows = data.get("patrol", [])
    if row["name"] in {one.get("name") for one in rows if isinstance(one, dict)}:
        raise UserError(f"{row['name']}: the case has this patrol already")
    return {"text": form.add_table(request["text"], "patrol", row), "name": row["name"]}
