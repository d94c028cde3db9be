"""drift beside OpenDrift, Parcels and OceanTracker in one run, on the same forcing and release.

    python benchmarks/peers.py [--opendrift PYTHON] [--parcels PYTHON] [--oceantracker PYTHON]
    [--particles 1e5] [--hours 48] [--json FILE]

Each PYTHON is an interpreter of an environment that holds that program; those not given are left
out. A program runs as its own documentation advises, by a script in benchmarks/peers, in processes
of its own: with empty caches, with full caches, and with a fifth of the particles. The sea is that
of closed forms on a grid of 0.05 degrees, hourly; drift, OpenDrift and Parcels read it as it is,
OceanTracker as triangles between the same nodes, which are prepared before the clock starts.

Two jobs: *rafts*, which drift with leeway in a sea with a coast (out of reach), and *passive*
particles in the current alone. Measured are the seconds from the start of a process to its first
picture and to its end, the time of a particle and day from the difference of two runs (start-up
and compilation fall out), and the peak of memory of the largest process. What makes the work differ
stands in the table: drift also writes maps of probability, areas and a report, but 200 tracks only.

All must drift to the same place: the mean drift of each program is compared with drift's own. Where
it differs by more than the schemes explain (see `tolerance`), the comparison is void, and no
figures are kept. Nothing else should run meanwhile: the load of the machine is printed.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import smallest
import xarray as xr
from rich.console import Console
from rich.table import Table

START, STEP, EVERY = "2026-01-01T00:00:00", 600, 3600
PLACE, STD = (-90.0, 25.0), 10.0  # release: mean [degrees], standard deviation [km]
# Its lines right and left of downwind mirror each other, without offset: so it does not matter that
# OpenDrift turns them the other way, and jibes by the sign of the slope alone (docs/leeway.md).
RAFT = "LIFE-RAFT-SB-8"
DEGREE = 111.195  # [km]
SCRIPTS = Path(__file__).parent / "peers"


class Program(NamedTuple):
    """A program and what it does: its job, its physics, what else differs in its work."""

    of: str
    job: str
    physics: str
    differs: str


PROGRAMS = {
    "drift, rafts": Program(
        "drift",
        "rafts",
        "leeway, RK4, coast",
        "all cores; all files: maps, areas, report; 200 tracks",
    ),
    "OpenDrift, rafts": Program(
        "opendrift",
        "rafts",
        "Leeway, Euler, coast",
        "one core (NumPy); one plot; all tracks in memory, no file",
    ),
    "drift, passive": Program(
        "drift", "passive", "RK4, no coast", "all cores; all files: maps, areas, report; 200 tracks"
    ),
    "OpenDrift, passive": Program(
        "opendrift",
        "passive",
        "OceanDrift, RK4, no coast",
        "one core (NumPy); one plot; all tracks in memory, no file",
    ),
    "Parcels, passive": Program(
        "parcels", "passive", "RK4, no coast", "one core (NumPy); one plot; file of all tracks"
    ),
    "OceanTracker, passive": Program(
        "oceantracker",
        "passive",
        "RK4, depth, dry cells",
        "all cores (numba); one plot; file of all tracks",
    ),
}


def write_sea(folder: Path, hours: int, spacing: float, triangles: bool) -> None:
    """Write current and wind by closed forms as cur.nc and wnd.nc, and the current on triangles."""
    lon = np.arange(-98, -78, spacing)
    lat = np.arange(18, 33, spacing)
    hour = np.arange(hours + 2)
    x, y = np.meshgrid(lon, lat)
    day = (2 * np.pi * hour / 24)[:, None, None]
    current = (0.3 + 0.4 * np.sin(1.1 * y + day / 4), 0.15 + 0.4 * np.cos(0.9 * x - day / 4))
    wind = (-6 + 3 * np.sin(day + x / 5), 2 + 2 * np.cos(day + y / 4))
    times = np.datetime64(START, "ns") + hour * np.timedelta64(1, "h")
    coordinates = {
        "time": ("time", times, {"standard_name": "time"}),
        "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
        "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
    }
    for name, values, names, standard in (
        ("cur.nc", current, ("uo", "vo"), "{}_sea_water_velocity"),
        ("wnd.nc", wind, ("u10", "v10"), "{}_wind"),
    ):
        variables = {
            variable: (
                ("time", "lat", "lon"),
                value.astype(np.float32),
                {"standard_name": standard.format(axis), "units": "m s-1"},
            )
            for variable, value, axis in zip(names, values, "xy", strict=True)
        }
        xr.Dataset(variables, coordinates).to_netcdf(folder / name)
    if triangles:
        _write_triangles(folder, x, y, times, np.stack(current, axis=-1))


def _write_triangles(
    folder: Path, x: np.ndarray, y: np.ndarray, times: np.ndarray, current: np.ndarray
) -> None:
    """Write the current as a model on triangles would, each cell cut in two."""
    node = 1 + np.arange(x.size).reshape(x.shape)
    corners = [
        part.ravel() for part in (node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1])
    ]
    one, two, three, four = corners
    faces = np.concatenate([np.stack([one, two, three], 1), np.stack([one, three, four], 1)])
    nodes, cells, count = "nSCHISM_hgrid_node", "nSCHISM_hgrid_face", times.size
    variables = {
        "SCHISM_hgrid_node_x": (nodes, x.ravel()),
        "SCHISM_hgrid_node_y": (nodes, y.ravel()),
        "SCHISM_hgrid_face_nodes": ((cells, "corner"), faces.astype(np.int32)),
        "depth": (nodes, np.full(x.size, 1000, np.float32)),
        "elev": (("time", nodes), np.zeros((count, x.size), np.float32)),
        "wetdry_elem": (("time", cells), np.zeros((count, len(faces)), np.float32)),
        "dahv": (("time", nodes, "two"), current.reshape(count, x.size, 2).astype(np.float32)),
    }
    xr.Dataset(variables, {"time": times}).to_netcdf(folder / "triangles.nc")


def write_starts(folder: Path, n: int) -> None:
    """Write the release of the other programs; drift draws its own of the same distribution."""
    rng = np.random.default_rng(20260101)
    lat = PLACE[1] + rng.normal(0, STD / DEGREE, n)
    lon = PLACE[0] + rng.normal(0, STD / DEGREE, n) / np.cos(np.radians(lat))
    np.save(folder / "starts.npy", np.stack([lon, lat]))


def case(folder: Path, rafts: bool, hours: int, n: int) -> str:
    """Return drift's case of a job."""
    wind = f'[[wind]]\nfiles = "{folder / "wnd.nc"}"' if rafts else ""
    coast = "gshhg" if rafts else "none"
    drifter = f'"{RAFT}"' if rafts else '{ windage = "0 %" }'
    return f"""title = "Peers"
start = "{START}Z"
duration = "{hours} h"
particles = {n}
uncertainty = "none"
coast = {{ source = "{coast}" }}
clock = {{ step = "{STEP} s", scheme = "rk4" }}
output = {{ every = "{EVERY} s" }}
[[current]]
files = "{folder / "cur.nc"}"
{wind}
[[scenario]]
name = "afloat"
object = {drifter}
position = {{ at = [{PLACE[0]}, {PLACE[1]}], std = "{STD} km" }}
"""


def timed(name: str, python: str, folder: Path, caches: Path, hours: int, n: int) -> dict[str, Any]:
    """Run a program in a fresh process with its caches under `caches`.

    Returns:
        picture_s and whole_s from the start of the process, run_s of the stepping (with outputs),
        peak_gb, version, and the mean drift [km] to the east and north.
    """
    program = PROGRAMS[name]
    rafts = program.job == "rafts"
    out = Path(tempfile.mkdtemp(dir=folder))
    if program.of == "drift":
        (out / "case.toml").write_text(case(folder, rafts, hours, n), encoding="utf-8")
        results = out / "results"
        picture = results / "map.png"
        command = [python, "-m", "drift", "run", str(out / "case.toml"), "--out", str(results)]
    else:
        picture = out / "picture.png"
        job = {
            "folder": str(folder),
            "out": str(out),
            "picture": str(picture),
            "start": START,
            "hours": hours,
            "step": STEP,
            "every": EVERY,
            "particles": n,
            "object": RAFT if rafts else None,
        }
        command = [python, str(SCRIPTS / f"{program.of}_run.py"), json.dumps(job)]
    where = {
        "HOME": str(caches),
        "XDG_CACHE_HOME": str(caches / "cache"),
        "NUMBA_CACHE_DIR": str(caches / "numba"),
        "MPLCONFIGDIR": str(caches / "matplotlib"),
        "TI_OFFLINE_CACHE_FILE_PATH": str(caches / "taichi"),
        "DRIFT_CACHE": str(caches / "drift"),
    }
    if smallest.ASKED:  # no time to compile: with the caches that there are
        where = {}
    caches.mkdir(exist_ok=True)
    with (out / "told.txt").open("w+", encoding="utf-8") as told:
        begun = time.time()
        process = subprocess.Popen(
            command,
            env={**os.environ, **where, "MPLBACKEND": "Agg"},
            cwd=out,
            stdout=told,
            stderr=subprocess.STDOUT,
        )
        _, status, usage = os.wait4(process.pid, 0)
        whole = time.time() - begun
        process.returncode = os.waitstatus_to_exitcode(status)
        told.seek(0)
        text = told.read()
    if process.returncode or not picture.is_file():
        raise SystemExit(f"{name} failed:\n{text[-2000:]}")
    found = _of_drift(results) if program.of == "drift" else _of_peer(text, folder, n)
    return {
        **found,
        "picture_s": picture.stat().st_mtime - begun,
        "whole_s": whole,
        "peak_gb": usage.ru_maxrss / 2**20,
    }


def _of_drift(results: Path) -> dict[str, Any]:
    """Return what drift's own files tell of a run."""
    summary = json.loads((results / "summary.json").read_text(encoding="utf-8"))
    first, last = (summary["outputs"][k]["mean"] for k in (0, -1))
    return {
        "version": metadata.version("casp-drift"),
        "run_s": summary["wall_time_s"]["drift"],
        "drift_km": _apart(first["lon"], first["lat"], last["lon"], last["lat"]),
    }


def _of_peer(text: str, folder: Path, n: int) -> dict[str, Any]:
    """Return what a peer's script prints of a run."""
    lines = [line for line in text.splitlines() if line.startswith('{"version"')]
    found = json.loads(lines[-1])
    if found["particles"] != n:
        raise SystemExit(f"void: of {n} particles {found['particles']} are left at the end")
    lon, lat = np.load(folder / "starts.npy")[:, :n].mean(axis=1)
    drift = _apart(lon, lat, found["lon"], found["lat"])
    return {"version": found["version"], "run_s": found["run_s"], "drift_km": drift}


def _apart(lon: float, lat: float, to_lon: float, to_lat: float) -> tuple[float, float]:
    """Return how far a place lies to the east and north of another [km]."""
    across = math.cos(math.radians((lat + to_lat) / 2))
    return DEGREE * (to_lon - lon) * across, DEGREE * (to_lat - lat)


def tolerance(program: Program, drifted: float, n: int) -> float:
    """Return by how much the mean drift of a program may differ from drift's own [km].

    1 % of the way: sphere or ellipsoid differ by up to 0.7 % in a degree's length, triangles and
    rectangles in the current between nodes. Three standard errors of the difference of two means
    of n particles whose drifts scatter by no more than twice the release does. Euler steps: half a
    step's lag in a velocity that changes by up to 1 m/s on the way.
    """
    scatter = 3 * 2 * STD * math.sqrt(2 / n)
    lag = STEP / 2 * 1e-3 if "Euler" in program.physics else 0.0
    return 0.01 * drifted + scatter + lag


def measure(name: str, python: str, folder: Path, hours: int, n: int) -> dict[str, Any]:
    """Return the figures of a program."""
    caches = folder / f"caches of {name}"
    counts = (n, n // 5) if smallest.ASKED else (n, n, n // 5)
    runs = [timed(name, python, folder, caches, hours, count) for count in counts]
    empty, full, few = runs[0], runs[-2], runs[-1]
    days = (n - n // 5) * hours / 24
    return {
        "version": full["version"],
        "empty_caches_s": empty["picture_s"],
        "full_caches_s": full["picture_s"],
        "whole_s": full["whole_s"],
        "us_a_particle_day": 1e6 * (full["run_s"] - few["run_s"]) / days,
        "peak_gb": full["peak_gb"],
        "drift_km": full["drift_km"],
    }


def check(found: dict[str, dict[str, Any]], n: int) -> bool:
    """Add to each program the distance from drift's own mean drift; whether all are near it."""
    valid = True
    for name, row in found.items():
        ours = found[f"drift, {PROGRAMS[name].job}"]["drift_km"]
        allowed = tolerance(PROGRAMS[name], math.hypot(*ours), n)
        row["from_ours_km"] = math.dist(row["drift_km"], ours)
        if row["from_ours_km"] > allowed:
            print(f"void: {name} ends {row['from_ours_km']:.2f} km from ours, not {allowed:.2f}")
            valid = False
    return valid


def show(found: dict[str, dict[str, Any]], title: str) -> None:
    """Print the table."""
    table = Table(title=title)
    for heading in (
        "program", "first picture, empty caches [s]", "full caches [s]", "all [s]",
        "particle-day [us]", "peak [GB]", "mean drift [km]", "from ours [km]", "physics", "also",
    ):  # fmt: skip
        table.add_column(heading, justify="left" if heading in ("program", "also") else "right")
    for name, row in found.items():
        program = PROGRAMS[name]
        table.add_row(
            f"{name} ({row['version']})",
            f"{row['empty_caches_s']:.1f}",
            f"{row['full_caches_s']:.1f}",
            f"{row['whole_s']:.1f}",
            f"{row['us_a_particle_day']:.1f}",
            f"{row['peak_gb']:.2f}",
            f"{math.hypot(*row['drift_km']):.1f}",
            f"{row['from_ours_km']:.2f}",
            program.physics,
            program.differs,
        )
    Console(width=200).print(table)


def main() -> None:
    """Measure all programs that are there, print the table, and write JSON where asked."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    others = ("opendrift", "parcels", "oceantracker")
    for other in others:
        options.add_argument(f"--{other}", metavar="PYTHON", help="interpreter that has it")
    options.add_argument("--particles", type=float, default=1e5)
    options.add_argument("--hours", type=int, default=48)
    given = smallest.parse(options, saves=True, particles=1000, hours=6)
    pythons = {name: path for name in others if (path := getattr(given, name))}
    missing = [name for name in others if name not in pythons]
    if missing:
        print(f"left out, not given: {', '.join(missing)}")
    pythons["drift"] = sys.executable
    n, load = int(given.particles), os.getloadavg()[0]
    jobs = ("passive",) if smallest.ASKED else ("rafts", "passive")
    found: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        spacing = 0.5 if smallest.ASKED else 0.05
        write_sea(folder, given.hours, spacing, "oceantracker" in pythons)
        write_starts(folder, n)
        for name, program in PROGRAMS.items():
            if program.of in pythons and program.job in jobs:
                found[name] = measure(name, pythons[program.of], folder, given.hours, n)
                print(f"{name}: measured", flush=True)
    valid = check(found, n)
    show(found, f"{n:,} particles, {given.hours} h, steps of {STEP} s, outputs each hour")
    print(f"load of the machine: {load:.1f} before, {os.getloadavg()[0]:.1f} after")
    if not valid:
        raise SystemExit("the programs do not agree: no figures are kept")
    if given.json and missing:
        raise SystemExit("not saved: the table of figures needs all programs")
    smallest.save(given, {"particles": n, "hours": given.hours, "load": load, "programs": found})


if __name__ == "__main__":
    main()
