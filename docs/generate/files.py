"""The reference of files: every file that a result may hold, and every variable, column and name in
it, from real results.
"""

import csv
import json
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from drift.assess.budget import chapter as budgets
from drift.assess.compare import chapter as contrast
from drift.assess.score import chapter as scores
from drift.assess.verify import chapter as drifters
from drift.evidence.filter.products import chapter as search
from drift.evidence.posterior import chapter as posterior
from drift.evidence.suspend import chapter as suspend
from drift.forecast import by_member
from drift.forecast.products import chapter as forecast
from drift.pipeline import flow
from drift.planning.arrays import chapter as arrays
from drift.planning.arrays import processing_chapter as processing
from drift.planning.patrols import chapter as patrols
from drift.planning.search.products import chapter as planner
from drift.products.files import manifest, writer
from drift.spills.backtrack import chapter as backtrack
from drift.spills.worlds.products import chapter as spill

TOLD = Path(__file__).with_name("files.toml")
CHAPTERS: dict[str, tuple[str, Iterable[str]]] = {  # when they are written, and which
    "Every result": ("", (flow.REPORT, writer.SUMMARY, manifest.NAME)),
    "Every forecast": (
        "`drift run`, and the forecast in a plan.",
        (*forecast.FILES, *forecast.PICTURES, *forecast.SCENARIO_PICTURES),
    ),
    "Ensembles": ("Where a wind or a current has members.", (*by_member.FILES,)),
    "Searches": (
        "Where a case has sorties, contacts, sensors, lines or survival times.",
        (
            *search.FILES,
            *search.PICTURES,
            *search.MAPS,
            *search.LINE_FILES,
            *search.LINE_PICTURES,
            *posterior.FILES,
            *posterior.PICTURES,
            *posterior.RANKED,
            *posterior.MANY,
            *suspend.FILES,
            *suspend.PICTURES,
        ),
    ),
    "Plans of a search": ("`drift plan`.", (*planner.FILES, *planner.PICTURES, "plan-A-1.png")),
    "Plans of arrays": (
        "`drift plan` of a case with `[[tow]]` or `[plan.processing]`.",
        (*arrays.FILES, *arrays.PICTURES, *processing.FILES, *processing.PICTURES),
    ),
    "Spills": ("Where a case has a `[spill]`.", (*spill.FILES, *spill.FIND_FILES, *spill.PICTURES)),
    "Plans of patrols": (
        "`drift plan` of a spill.",
        (*patrols.FILES, *patrols.LEFT_OUT_FILES, *patrols.PICTURES),
    ),
    "Origins": ("`drift origin`.", (*backtrack.FILES, *backtrack.PICTURES)),
    "Comparisons": ("`drift compare`.", (*contrast.FILES, *contrast.PICTURES)),
    "Budgets": ("`drift budget`.", budgets.NAMES),
    "Scores": (
        "`drift score`; the columns are in [Scores of past cases](../score.md).",
        (*scores.FILES, *scores.PICTURES),
    ),
    "Verifications": ("`drift verify`.", (*drifters.FILES, *drifters.PICTURES)),
}
WHERE = {  # the run whose file is looked at
    "forecast.nc": "overdue_boat",
    "particles.nc": "overdue_boat",
    "track.csv": "overdue_boat",
    "ashore.csv": "overdue_boat",
    "sorties.csv": "overdue_boat",
    "posteriors.csv": "overdue_boat",
    "scenarios.csv": "overdue_boat",
    "lines.csv": "small-run",
    "members.csv": "small-run",
    "washup.nc": "gulf_containers",
    "washup.csv": "gulf_containers",
    "washup_times.csv": "gulf_containers",
    "totals.csv": "gulf_containers",
    "finds.csv": "gulf_containers",
    "unknowns.csv": "gulf_containers",
    "processing.csv": "small-arrays",
    "origin.nc": "small-origin",
    "origin.csv": "small-origin",
    "patrols.csv": "small-patrols",
    "patrols_left_out.csv": "small-patrols",
    "compare.nc": "small-compare",
    "compare.csv": "small-compare",
    "budget.csv": "small-budget",
    "consensus.csv": "small-budget",
    "consensus.nc": "small-budget",
    "verify.nc": "small-verify",
    "verify.csv": "small-verify",
}
EXTENT = re.compile(r"geospatial_|time_coverage_|Conventions|keywords|standard_name_vocabulary")

INTRODUCTION = """# Files and variables

Every file that a result may hold, and every variable and column in it. The tables of variables and columns are read from results that were
made for this page. Longitudes and latitudes are degrees, times UTC. All files carry the run's `run_id`, its case, its forcing's digests and
its versions; how they follow the conventions is in [Formats](../formats.md), exports to other programs too."""


def told() -> dict[str, Any]:
    """Return what is said of files and columns; refuse a file that nothing is said of, and one that
    is not written.
    """
    said = tomllib.loads(TOLD.read_text(encoding="utf-8"))
    written = {name for _, names in CHAPTERS.values() for name in names}
    if written != set(said["files"]):
        raise LookupError(
            f"{TOLD.name}: files that are not both written and described: {sorted(written ^ set(said['files']))}"
        )
    return said


def variables(path: Path) -> str:
    """Return the table of a netCDF file's variables and the names of its attributes."""
    entries = []
    with xr.open_dataset(path, decode_cf=False) as data:
        for name, values in data.variables.items():
            about = values.attrs
            what = about.get("long_name", "")
            if "standard_name" in about:
                what += f" (`{about['standard_name']}`)"
            if "flag_meanings" in about and "scenario" not in str(name):
                what += ": " + ", ".join(
                    f"{value} {word}"
                    for value, word in zip(
                        about.get("flag_values", []), about["flag_meanings"].split(), strict=False
                    )
                )
            if "comment" in about:
                what += f"; {about['comment']}"
            where = f"({', '.join(map(str, values.dims))})" if values.dims else "(one value)"
            unit = about.get("units", "")
            unit = f", {unit}" if unit not in ("", "1") else ""
            what = what or "edges of the cells"
            entries.append(f"`{name}` {where}{unit}\n: {what[:1].upper()}{what[1:]}")
        names = ", ".join(f"`{name}`" for name in data.attrs if not EXTENT.match(str(name)))
    return (
        "\n\n".join(entries) + f"\n\nAttributes, besides those of extent and conventions: {names}."
    )


def columns(path: Path, said: Mapping[str, Mapping[str, str]]) -> str:
    """Return the table of a CSV file's columns, those of one meaning in one row; refuse a column of
    which nothing is said.
    """
    with open(path, newline="", encoding="utf-8") as file:
        names = next(csv.reader(file))
    meanings = [*said.get(path.stem, {}).items(), *said["every"].items()]
    rows: dict[str, list[str]] = {}
    for name in names:
        what = next((words for pattern, words in meanings if re.fullmatch(pattern, name)), None)
        if what is None:
            raise LookupError(f"{path.name}: column {name} is not described in {TOLD.name}")
        rows.setdefault(what, []).append(f"`{name}`")
    for pattern, words in said.get(path.stem, {}).items():
        if words not in rows:
            raise LookupError(f"{TOLD.name}: {path.name} has no column {pattern}")
    return "\n\n".join(
        f"{', '.join(found)}\n: {what[:1].upper()}{what[1:]}" for what, found in rows.items()
    )


def names(path: Path) -> str:
    """Return the names that stand at the top of a JSON file."""
    return ", ".join(f"`{name}`" for name in json.loads(path.read_text(encoding="utf-8")))


def page(results: Mapping[str, Path]) -> str:
    """Return the page of all files; results: folders by the name of the run."""
    said, parts = told(), [INTRODUCTION]
    for title, (when, listed) in CHAPTERS.items():
        rows = [f"| `{name}` | {said['files'][name]} |" for name in listed]
        parts += [f"## {title}", when, "\n".join(["| file | what |", "|---|---|", *rows])]
        if title == "Every result":
            parts.append(
                f"In `summary.json` of a search: {names(results['overdue_boat'] / writer.SUMMARY)}."
            )
        for name in listed:
            if name in WHERE:
                path = results[WHERE[name]] / name
                parts += [
                    f"### `{name}`",
                    variables(path) if path.suffix == ".nc" else columns(path, said["columns"]),
                ]
    return "\n\n".join(part for part in parts if part) + "\n"


def count(results: Mapping[str, Path]) -> tuple[int, int]:
    """Return the number of files, and of variables and columns, that the page tells."""
    total = 0
    for name, run in WHERE.items():
        path = results[run] / name
        if path.suffix == ".nc":
            with xr.open_dataset(path, decode_cf=False) as data:
                total += len(data.variables)
        else:
            with open(path, newline="", encoding="utf-8") as file:
                total += len(next(csv.reader(file)))
    return sum(len(tuple(listed)) for _, listed in CHAPTERS.values()), total
