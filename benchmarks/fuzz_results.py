"""What `drift export` makes of damaged or strange results: one line, or files that can be read;
nothing else may be.

A plan at sea, a plan of patrols and an origin are made once. Of each trial one of their files is
damaged (JSON, CSV and XML in their structure and values, netCDF in its variables, all of them in
their bytes), its manifest is written again, as somebody would who means it, and the folder is
exported in one of the formats. What is written is read back.

python benchmarks/fuzz_results.py [--trials-of 2000] [--seed 0]
"""

import argparse
import csv
import io
import json
import random
import shutil
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path[:0] = [
    *(str(ROOT / "tests" / "oracles" / kind) for kind in ("files", "spill_cases")),
    str(ROOT),
]

import finished
import numpy as np
import smallest
import spills
import watched
import xarray as xr

import drift
from drift.apps.export import exporter
from drift.apps.export import finished as result_files
from drift.products.files import manifest

STRANGE: tuple[Any, ...] = (
    None, "", "x", "x" * 100_000, "1e400", True, -1, 0, 91, 1e308, float("nan"), float("inf"), [], {}, [[]], [None], {"type": "Point"},
    "2026-06-01T20:00:00Z", "9999999-01-01T00:00:00Z", "\0\ufffe", 10**400,
)  # fmt: skip
SUFFIXES = (".nc", ".geojson", ".csv", ".gpx")
READ = {*result_files.READ, "forecast.nc", "origin.nc", "plan.gpx"}
TEAM = """
[[find]]
at = [0.0, 0.05]
time = "+30 h"
[[patrol_unit]]
name = "walkers"
length = "21 km"
detection = 0.6
first = "+40 h"
"""


def results(folder: Path) -> list[Path]:
    """Make the whole results in a folder and return theirs."""
    sea, shore = folder / "sea", folder / "shore"
    for place in (sea, shore):
        place.mkdir()
    case = spills.case_of(shore, worlds=100)
    case.path.write_text(case.path.read_text() + TEAM)
    case = drift.load(case.path)
    drift.patrol(case, folder / "patrols")
    drift.origin(case, folder / "origin")
    return [finished.plan(sea), folder / "patrols", folder / "origin"]


def damaged(path: Path, rng: random.Random) -> str:
    """Damage a file and return how."""
    if rng.random() < 0.25:
        return _bytes(path, rng)
    kind = path.suffix.removeprefix(".")
    return {"nc": _netcdf, "geojson": _json, "csv": _csv, "gpx": _xml}[kind](path, rng)


def _bytes(path: Path, rng: random.Random) -> str:
    data = bytearray(path.read_bytes())
    at = rng.randrange(len(data))
    if rng.random() < 0.5:
        data = data[:at]
    else:
        data[at : at + 8] = rng.randbytes(8)
    path.write_bytes(data)
    return "bytes"


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every (container, key) of a JSON value."""
    keys = (
        value.keys()
        if isinstance(value, dict)
        else range(len(value))
        if isinstance(value, list)
        else ()
    )
    for key in list(keys):
        yield value, key
        yield from _places(value[key])


def _json(path: Path, rng: random.Random) -> str:
    whole = json.loads(path.read_text())
    places = list(_places(whole))
    named = [place for place in places if isinstance(place[1], str)]  # coordinates outnumber them
    held, key = rng.choice(named if named and rng.random() < 0.6 else places)
    if isinstance(held, dict) and rng.random() < 0.3:
        del held[key]
    else:
        held[key] = rng.choice(STRANGE)
    path.write_text(json.dumps(whole).replace('"1e400"', "1e400"))
    return f"json {key}"


def _csv(path: Path, rng: random.Random) -> str:
    rows = list(csv.reader(io.StringIO(path.read_text())))
    row = rng.choice(rows)
    at = rng.randrange(len(row))
    row[at] = "" if rng.random() < 0.3 else str(rng.choice(STRANGE)).replace("\0", "")
    if rng.random() < 0.2:
        del row[at]
    path.write_text("\n".join(",".join(cell for cell in line) for line in rows))
    return "csv"


def _xml(path: Path, rng: random.Random) -> str:
    tree = ET.parse(path)
    element = rng.choice(list(tree.iter()))
    word = str(rng.choice(STRANGE)).replace("\0", "").replace("\ufffe", "")
    if element.attrib and rng.random() < 0.6:
        element.attrib[rng.choice(list(element.attrib))] = word
    elif rng.random() < 0.5:
        element.text = word
    else:
        for child in list(element):
            element.remove(child)
    tree.write(path)
    return f"xml {element.tag.rpartition('}')[2]}"


def _netcdf(path: Path, rng: random.Random) -> str:
    data = xr.load_dataset(path)
    name = str(rng.choice(list(data.variables)))
    how = rng.choice(
        ("drop", "text", "huge", "nan", "inf", "rename", "flat", "attribute", "none", "integers")
    )
    if how == "drop" or (how == "flat" and name in data.sizes):
        data = data.drop_vars(name)
    elif how == "attribute":
        data.attrs[rng.choice(list(data.attrs))] = rng.choice((1.5, [1, 2], "", "x" * 1000))
    elif how == "rename":
        data = data.rename({str(rng.choice(list(data.sizes))): "strange"})
    elif how == "none":
        data = data.isel({str(rng.choice(list(data.sizes))): slice(0, 0)})
    else:
        old = data[name]
        if how == "flat":
            values: Any = np.float64(1.0)
            data[name] = ((), values)
        else:
            word = {"text": "x", "huge": 1e30, "nan": np.nan, "inf": np.inf, "integers": 7}[how]
            data = data.drop_vars(name)
            data[name] = (old.dims, np.full(old.shape, word))
    for variable in data.variables.values():
        variable.encoding = {}
    data.to_netcdf(path)
    return f"nc {name} {how}"


def tried(whole: Path, folder: Path, rng: random.Random) -> tuple[str, str]:
    """Export a result of which one file is damaged; return what was damaged, and "written" if that
    could be done.

    Raises UserError where it is rejected, and ValueError or ET.ParseError where what was written
    cannot be read.
    """
    copy = folder / "result"
    shutil.copytree(whole, copy)
    names = [entry.name for entry in manifest.read_manifest(copy).files]
    some = [name for name in sorted(names) if name.endswith(SUFFIXES)]
    read = [name for name in some if name in READ]
    victim = copy / rng.choice(read if rng.random() < 0.9 else some)
    how = f"{victim.name} {damaged(victim, rng)}"
    found = manifest.read_manifest(whole)
    (copy / manifest.NAME).write_text(
        manifest.manifest_text(manifest.manifest_of(found.run_id, [copy / name for name in names]))
    )
    return how, str(copy)


def exported(copy: Path, folder: Path, form: str) -> str:
    """Export a folder and read what was written."""
    for path in exporter.export(copy, form, folder / "out"):
        if path.suffix in (".kml", ".gpx", ".rtz"):
            root = ET.parse(path).getroot()
            told = [
                (float(e.get("lon")), float(e.get("lat"))) for e in root.iter() if "lat" in e.attrib
            ]
            for text in root.iter("{http://www.opengis.net/kml/2.2}coordinates"):
                told += [
                    tuple(map(float, point.split(",")[:2])) for point in (text.text or "").split()
                ]
            if not all(abs(lon) <= 180 and abs(lat) <= 90 for lon, lat in told):
                raise ValueError(f"{path.name} has a position beyond the Earth")
        elif path.suffix == ".geojson":
            json.loads(
                path.read_text(),
                parse_constant=lambda word: (_ for _ in ()).throw(ValueError(word)),
            )
    return "written"


def trials(numbers: list[int], made: Path) -> None:
    """Damage and export results, one a number."""
    wholes = [made / "sea" / "raft-plan", made / "patrols", made / "origin"]
    for number in numbers:
        rng = random.Random(number)
        whole, form = rng.choice(wholes), rng.choice(list(exporter.FORMATS))
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            how, copy = tried(whole, folder, rng)
            watched.trial(
                number, f"{form} {how}", lambda c=copy, f=folder, k=form: exported(Path(c), f, k)
            )


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials-of", type=int, default=2000, dest="count")
    parser.add_argument("--seed", type=int, default=0, help="of the first trial")
    parser.add_argument("--trials", help=argparse.SUPPRESS)
    parser.add_argument("--made", type=Path, help=argparse.SUPPRESS)
    given = smallest.parse(parser, count=10)
    if given.trials is not None:
        trials([int(number) for number in given.trials.split(",")], given.made)
        return
    with tempfile.TemporaryDirectory() as name:
        results(Path(name))
        bad = watched.table(
            watched.run(__file__, range(given.seed, given.seed + given.count), ["--made", name])
        )
    sys.exit(bad)


if __name__ == "__main__":
    main()
