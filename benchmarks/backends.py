"""Does every command run on another backend, and do its results agree with the CPU's?

    python benchmarks/backends.py [vulkan ...] [--particles 4000] [--only TEXT] [--out FOLDER]

Each command that moves particles runs on the CPU and on each backend in a process of its own;
results that FOLDER holds already are not made again. The table in Markdown: whether it ran, seconds
on both, how far particles are apart [m] (median, 99 %, most), how many have another status, and the
largest differences of POS or another probability, and of an area, in `summary.json` or its like.
Rows that end in `=` compare a backend with itself: the same run twice, and cut into three shards;
there every file must be the same to the bit. Without data (DRIFT_DATA) the cases that need them are
left out, with a word. What resamples draws other particles where a rounding decides: particles of
such runs can't be told apart one by one, and their areas scatter.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import smallest
import xarray as xr

from geo import sphere

ROOT = Path(__file__).parents[1]
SMALL = ROOT / "docs" / "generate"
RUNS = [path.stem for path in sorted((ROOT / "cases").glob("*.toml"))]
PROBABILITIES = ("pos.", "poc.", "pod.", "probability", "account.", "posterior.", "weight")
TRACKING = [path.stem for path in sorted((ROOT / "cases" / "tracking").glob("*.toml"))]


def commands(particles: int) -> dict[str, list[str]]:
    """Return the arguments of drift by the name of what is tried."""
    few = ["--set", f"particles={particles}"]
    found = {}
    for case in RUNS:
        spill = "\n[spill]\n" in (ROOT / "cases" / f"{case}.toml").read_text(encoding="utf-8")
        found[f"run {case}"] = ["run", case, *(["--set", "spill.worlds=100"] if spill else few)]
    found |= {
        "run small (members, a line)": ["run", str(SMALL / "small.toml"), *few],
        "plan overdue_boat (searches)": ["plan", "overdue_boat", *few, "--set", "plan.particles=2000"],
        "plan small_arrays (arrays)": ["plan", str(SMALL / "small_arrays.toml")],
        "plan small_spill (patrols)": ["plan", str(SMALL / "small_spill.toml")],
        "origin small_spill": ["origin", str(SMALL / "small_spill.toml")],
        "compare small": [
            "compare", str(SMALL / "small.toml"), "--set-b", "uncertainty.current.std='0.1 m/s'", "--set", f"particles={particles}",
        ],
    }  # fmt: skip
    for case in TRACKING:
        if case == "lost_contact":
            found["track lost_contact"] = ["track", "lost_contact"]
        else:
            found[f"experiment {case}"] = ["experiment", case, "--runs", "2"]
    return found


def tried(arguments: list[str], backend: str, out: Path) -> tuple[str, float]:
    """Run a command unless its results are there; return what went wrong, "" if nothing did, and
    seconds.
    """
    told = out.with_suffix(".json")
    if told.exists():
        kept = json.loads(told.read_text())
        return kept["wrong"], kept["seconds"]
    command = [
        sys.executable,
        "-m",
        "drift",
        *arguments,
        "--out",
        str(out),
        "--overwrite",
        "--quiet",
    ]
    if arguments[0] not in ("compare", "sensor") or backend != "cpu":
        command += ["--backend", backend]
    begin = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - begin
    lines = done.stderr.strip().splitlines() or ["failed"]
    # so few particles miss what a case expects
    whole = done.returncode == 0 or "missed [expect]" in done.stderr
    wrong = "" if whole else lines[-1]
    told.write_text(json.dumps({"wrong": wrong, "seconds": seconds}))
    return wrong, seconds


def numbers(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Yield all numbers of a JSON value by their paths."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield from numbers(each, f"{path}.{key}")
    elif isinstance(value, list):
        for k, each in enumerate(value):
            yield from numbers(each, f"{path}[{k}]")
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path, float(value)


def told(folder: Path) -> dict[str, float]:
    """Return all numbers of a folder's JSON files of results."""
    found: dict[str, float] = {}
    for file in sorted(folder.glob("*.json")):
        if file.name != "manifest.json":
            found |= dict(numbers(json.loads(file.read_text()), file.stem))
    return found


def particles_apart(one: Path, other: Path) -> str:
    """Return how far the particles of two results are apart, in columns of the table."""
    if not (one / "particles.nc").exists():
        return "| | "
    with xr.open_dataset(one / "particles.nc") as a, xr.open_dataset(other / "particles.nc") as b:
        if a.sizes != b.sizes:
            return "| other particles | "
        places = [
            np.radians(each[name].values.astype(float))
            for each in (a, b)
            for name in ("lon", "lat")
        ]
        apart = sphere.distance(*places)
        apart = apart[np.isfinite(apart)]
        other_status = int((a.status.values != b.status.values).sum()) if "status" in a else 0
    if not apart.size:
        return f"| | {other_status}"
    median, most = np.quantile(apart, [0.5, 0.99])
    return f"| {median:.2g}, {most:.2g}, {apart.max():.3g} | {other_status}"


def figures_apart(one: Path, other: Path) -> str:
    """Return the largest difference of a probability, and relative one of an area, with their
    paths.
    """
    a, b = told(one), told(other)
    cells = []
    for words, relative in ((PROBABILITIES, False), (("area",), True)):
        rows = [
            (
                abs(a[key] - b[key]) / (max(abs(a[key]), abs(b[key]), 1e-30) if relative else 1.0),
                key,
            )
            for key in a.keys() & b.keys()
            if any(word in key.lower() for word in words)
            and not any(word in key for word in ("ess", "effective"))
        ]
        rows = [row for row in rows if np.isfinite(row[0])]
        cells.append("| {:.1e} {}".format(*max(rows)) if rows else "| ")
    return " ".join(cells)


def same_bits(one: Path, other: Path) -> str:
    """Return whether the particles and the forecast of two results are the same to the bit."""
    for name in ("particles.nc", "forecast.nc"):
        with xr.open_dataset(one / name) as a, xr.open_dataset(other / name) as b:
            if not a.drop_attrs().identical(b.drop_attrs()):
                return f"{name} differs"
    return "the same bits"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("backends", nargs="*", default=["vulkan"])
    parser.add_argument("--particles", type=int, default=4000)
    parser.add_argument("--only", default="", help="only commands whose name has this text")
    parser.add_argument("--out", type=Path, help="folder that keeps the results")
    given = smallest.parse(parser, backends=["cpu"], particles=9000, only="run small")
    folder = given.out or Path(tempfile.mkdtemp())
    print(
        "| command | backend | ran | s | CPU s | apart m: median, 99 %, most | other status | probability | area, relative |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name, arguments in commands(given.particles).items():
        if given.only not in name:
            continue
        own = folder / "".join(c if c.isalnum() else "-" for c in name)
        own.mkdir(parents=True, exist_ok=True)
        wrong, cpu_seconds = tried(arguments, "cpu", own / "cpu")
        if wrong:
            print(f"| {name} | cpu | {wrong[:80]} |", flush=True)
            continue
        for backend in given.backends:
            out = own / f"on {backend}"  # the processor against itself, too
            wrong, seconds = tried(arguments, backend, out)
            row = (
                f"| {name} | {backend} | {wrong[:80] or 'yes'} | {seconds:.1f} | {cpu_seconds:.1f} "
            )
            if not wrong:
                row += f"{particles_apart(own / 'cpu', out)} {figures_apart(own / 'cpu', out)} |"
            print(row, flush=True)
    own = folder / "same"
    own.mkdir(parents=True, exist_ok=True)
    case = str(smallest.CASE) if smallest.ASKED else "overdue_boat"
    again = ["run", case, "--set", "plan={}", "--set", f"particles={given.particles}"]
    for backend in given.backends if smallest.ASKED or given.only in "run overdue_boat =" else []:
        for kind, more in (("once", []), ("twice", []), ("three shards", ["--shards", "3"])):
            if smallest.ASKED and kind == "twice":
                continue
            wrong, seconds = tried([*again, *more], backend, own / f"{backend} {kind}")
            row = f"| run {Path(case).stem}, {kind} = | {backend} | {wrong[:80] or 'yes'} | {seconds:.1f} |"
            print(
                row
                if wrong or kind == "once"
                else f"{row} | {same_bits(own / f'{backend} once', own / f'{backend} {kind}')} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
