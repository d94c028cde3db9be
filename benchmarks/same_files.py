"""Do two states of the code write the same files? Every shipped case is run, planned and traced;
the folders are compared.

    python benchmarks/same_files.py write FOLDER [--threads 1] [--only TEXT]
    python benchmarks/same_files.py compare ONE OTHER

`write` runs all that the shipped cases ask for, one after another (half an hour on two cores), with
the code that PYTHONPATH finds; cases whose data are not there are left out, with a word. `compare`
holds the netCDF files against each other variable by variable and attribute by attribute, JSON by
its values, all else byte by byte. Dates of making, wall times and digests of files are set aside.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NoReturn

import netCDF4
import numpy as np
import smallest

COMMANDS = {
    "overdue_boat": (("run",), ("plan",), ("check",)),
    "convergence_zones": (("run",), ("check",)),
    "gulf_containers": (("run",), ("plan",), ("origin",), ("check",)),
    "norkyst_raft": (("run",), ("check",)),
    "washington_piw": (("run",), ("check",)),
    "washington_drums": (("run",), ("check",)),
    "biscay_drifter": (("run",), ("check",)),
    "paria_boat": (("run",), ("check",)),
    "paria": (("run",), ("check",)),
    "overdue_yacht": (("run",), ("check",)),
    "cast_submarine": (("run",), ("check",)),
    "medsearch_transit": (("run",), ("check",)),
    "smuggler_bridge": (("run",), ("check",)),
}
TIMES = {"date_created", "history", "wall_time_s"}  # of making, not of what is made
# The first follows from the other files; the second shows what they hold, with dates and times
# packed among it.
DIGESTS = {"manifest.json", "report.html"}


def write(folder: Path, threads: int, only: str) -> None:
    """Write all that the cases ask for, each command's files and words into a folder of its own."""
    for case, commands in COMMANDS.items():
        for (command,) in commands:
            name = f"{Path(case).stem}-{command}"
            if only not in name:
                continue
            folder.mkdir(parents=True, exist_ok=True)
            out = (
                []
                if command == "check"
                else ["--out", str(folder / name), "--overwrite", "--threads", str(threads)]
            )
            begin = time.perf_counter()
            done = subprocess.run(
                [sys.executable, "-m", "drift", command, case, *out], capture_output=True, text=True, env={**os.environ, "COLUMNS": "100"}
            )  # fmt: skip
            (folder / f"{name}.txt").write_text(
                done.stdout.replace(str(folder), ""), encoding="utf-8"
            )
            told = (
                ""
                if done.returncode == 0
                else f"  rc {done.returncode}: {done.stderr.strip().splitlines()[-1:]}"
            )
            print(f"{time.perf_counter() - begin:6.1f} s  {name}{told}", flush=True)


def differences(one: Path, other: Path) -> list[str]:
    """Return what differs between two folders, a line each."""
    names = [{str(p.relative_to(f)) for p in f.rglob("*") if p.is_file()} for f in (one, other)]
    found = [f"only in {one}: {name}" for name in sorted(names[0] - names[1])]
    found += [f"only in {other}: {name}" for name in sorted(names[1] - names[0])]
    for name in sorted(names[0] & names[1]):
        a, b = one / name, other / name
        if a.name in DIGESTS:
            continue
        if a.suffix == ".nc":
            found += [f"{name}: {what}" for what in _netcdf(a, b)]
        elif a.suffix in (".json", ".geojson"):
            parts = [_without(json.loads(path.read_text(encoding="utf-8"))) for path in (a, b)]
            found += [f"{name}: {what}" for what in _values(parts[0], parts[1], "")]
        elif a.read_bytes() != b.read_bytes():
            found.append(f"{name}: bytes differ")
    return found


def _netcdf(one: Path, other: Path) -> list[str]:
    """Return which dimensions, variables and attributes of two files differ."""
    with netCDF4.Dataset(one) as a, netCDF4.Dataset(other) as b:
        for data in (a, b):
            data.set_auto_maskandscale(False)
        found = [] if _sizes(a) == _sizes(b) else ["dimensions"]
        found += _values(_attributes(a), _attributes(b), "")
        for name in sorted(set(a.variables) | set(b.variables)):
            if name not in a.variables or name not in b.variables:
                found.append(f"{name}: in one only")
                continue
            x, y = a[name], b[name]
            found += _values(_attributes(x), _attributes(y), f"{name}:")
            here, there = np.asarray(x[...]), np.asarray(y[...])
            alike = (
                here.tolist() == there.tolist()
                if here.dtype == object
                else here.tobytes() == there.tobytes()
            )
            if here.dtype != there.dtype or here.shape != there.shape or not alike:
                found.append(f"{name}: {_apart(here, there)}")
    return found


def _apart(here: np.ndarray, there: np.ndarray) -> str:
    """Return in words by how much two arrays differ."""
    if here.shape != there.shape or here.dtype.kind not in "fiu":
        return f"{here.dtype} {here.shape}, {there.dtype} {there.shape}"
    apart = np.abs(here.astype(float) - there.astype(float))
    differ = ~((here == there) | (np.isnan(here.astype(float)) & np.isnan(there.astype(float))))
    return f"{differ.mean():.2%} of the values differ, by up to {np.nanmax(apart, initial=0):.3g}"


def _sizes(data: netCDF4.Dataset) -> dict[str, int]:
    return {name: len(dimension) for name, dimension in data.dimensions.items()}


def _attributes(of: Any) -> dict[str, Any]:
    return {
        name: np.asarray(of.getncattr(name)).tolist() for name in of.ncattrs() if name not in TIMES
    }


def _without(value: Any) -> Any:
    """Return parsed JSON without what tells when and how fast it was made."""
    if isinstance(value, dict):
        return {key: _without(part) for key, part in value.items() if key not in TIMES}
    return [_without(part) for part in value] if isinstance(value, list) else value


def _values(one: Any, other: Any, where: str) -> list[str]:
    """Return where two parsed values differ."""
    if isinstance(one, dict) and isinstance(other, dict):
        lines = [f"{where}{key}: in one only" for key in sorted(set(one) ^ set(other))]
        return lines + [
            line
            for key in one
            if key in other
            for line in _values(one[key], other[key], f"{where}{key}.")
        ]
    same = json.dumps(one) == json.dumps(other)
    return (
        []
        if same
        else [f"{where.rstrip('.')}: {json.dumps(one)[:60]} and {json.dumps(other)[:60]}"]
    )


def main() -> None:
    """Write, or compare; the exit status says whether all is the same."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = options.add_subparsers(dest="command", required=not smallest.ASKED)
    writer = commands.add_parser("write")
    writer.add_argument("folder", type=Path)
    writer.add_argument("--threads", type=int, default=1)
    writer.add_argument(
        "--only", default="", help="commands whose name, such as overdue_boat-plan, holds this text"
    )
    comparer = commands.add_parser("compare")
    comparer.add_argument("one", type=Path)
    comparer.add_argument("other", type=Path)
    given = smallest.parse(options)
    if smallest.ASKED:
        COMMANDS.clear()
        COMMANDS[str(smallest.CASE)] = (("run",), ("check",))
        with tempfile.TemporaryDirectory() as name:
            given.one, given.other = Path(name, "one"), Path(name, "other")
            for folder in (given.one, given.other):
                write(folder, 1, "")
            compare(given.one, given.other)
    if given.command == "write":
        write(given.folder.resolve(), given.threads, given.only)
        return
    compare(given.one, given.other)


def compare(one: Path, other: Path) -> NoReturn:
    """Print what differs between two folders, and end with a status that says whether anything
    does.
    """
    for folder in (one, other):
        if not folder.is_dir() or not any(folder.iterdir()):
            sys.exit(f"{folder}: holds no files to compare")
    found = differences(one, other)
    print("\n".join(found) or "the same")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
