"""Time per particle-step and memory per particle, each physical term on and off, beside yardsticks
where they are.

    python benchmarks/throughput.py [--json FILE] [--most 1e7] [--yardsticks FOLDER] [--opendrift
    PYTHON]

The job is that of a plain C kernel (limit.c in FOLDER, built here with gcc if it is there): RK4,
current and wind on a 400 x 300 grid, bilinear in space, linear in time, leeway. PYTHON is an
interpreter that has OpenDrift; with FOLDER's opendrift_leeway.py it runs the same job. The best of
several runs counts; nothing else should run meanwhile.
"""

import argparse
import re
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import smallest
from rich.console import Console
from rich.table import Table

from drift.engine.motion.models.drift import COLUMNS
from drift.engine.particles import ensemble as record
from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast import shore
from geo.grids.grid import Grid
from kernels.runtime import runtime
from kernels.step import advance as kernel
from kernels.step import coast as device_coast
from kernels.step.sample import Tiles

BYTES = 4 * (len(record.CORE) + len(COLUMNS))  # a particle on the device
GRID = Grid(-98.0, 18.0, 0.05, 0.05, 400, 300)
BOX = Box(-98.0, 18.0, -78.0, 33.0)
RANGES = {"current": (0, 1), "wind": (1, 2)}
ERRORS = kernel.Physics(0.1, 21_600.0, 1.0, 21_600.0)
FULL = ERRORS._replace(diffusivity=10.0)
CASES: list[tuple[str, str, kernel.Physics, bool, bool]] = [  # name, scheme, physics, wind, coast
    ("RK2 current", "rk2", kernel.Physics(), False, False),
    ("RK4 current", "rk4", kernel.Physics(), False, False),
    ("RK2 current, wind, leeway", "rk2", kernel.Physics(), True, False),
    ("RK4 current, wind, leeway (the yardstick's work)", "rk4", kernel.Physics(), True, False),
    ("  + jibing", "rk4", kernel.Physics(jibe_rate=1e-5), True, False),
    ("  + diffusion", "rk4", kernel.Physics(diffusivity=10.0), True, False),
    ("  + Ornstein-Uhlenbeck errors", "rk4", ERRORS, True, False),
    ("  + both", "rk4", FULL, True, False),
    ("  + both, coast (open sea)", "rk4", FULL, True, True),
]


def fields(finer: int = 1) -> Tiles:
    """Return the yardstick's current and wind on the device; finer: that many times as many nodes a
    side.
    """
    nlon, nlat = finer * GRID.nlon, finer * GRID.nlat
    grid = Grid(GRID.lon0, GRID.lat0, GRID.dlon / finer, GRID.dlat / finer, nlon, nlat)
    tiles = Tiles([grid, grid])
    y, x = np.meshgrid(
        np.arange(nlat, dtype=np.float32) / finer,
        np.arange(nlon, dtype=np.float32) / finer,
        indexing="ij",
        sparse=True,
    )

    def field(east: np.ndarray, north: np.ndarray) -> np.ndarray:
        return np.stack(np.broadcast_arrays(east, north), axis=-1)

    current = field(0.5 * np.sin(y / 30), 0.5 * np.cos(x / 30))
    wind = field(5 * np.cos(y / 50), 5 * np.sin(x / 50))
    for tile, values in enumerate((current, wind)):
        tiles.place(tile, values, later=False)
        tiles.place(tile, values, later=True)
    tiles.blend([(0.0, 0.1), (0.0, 0.1)])
    return tiles


def domain() -> kernel.Domain:
    """Return the yardstick's box as kernels take it."""
    west, south = (int(sphere.to_binary(x)) for x in (BOX.west, BOX.south))
    return kernel.Domain(west, south, int(20 / 360 * sphere.TURN), int(15 / 360 * sphere.TURN))


def particles(n: int, coast: shoreline.Coast) -> record.Ensemble:
    """Return n particles of the yardstick's box, all in water."""
    rng = np.random.default_rng(1)
    lon, lat = np.empty(0, np.int32), np.empty(0, np.int32)
    while lon.size < n:
        x, y = sphere.to_binary(rng.uniform(-95, -85, n)), sphere.to_binary(rng.uniform(20, 30, n))
        wet = ~shoreline.is_land(coast, x, y)
        lon, lat = np.concatenate([lon, x[wet]]), np.concatenate([lat, y[wet]])
    return ensemble_at(lon[:n], lat[:n])


def ensemble_at(lon: np.ndarray, lat: np.ndarray) -> record.Ensemble:
    """Return particles at these places [binary angles], with the yardstick's leeway."""
    ensemble = record.empty(1, (0, lon.size), COLUMNS)
    ensemble.lon.from_numpy(lon)
    ensemble.lat.from_numpy(lat)
    for name, value in (
        ("down_slope", 0.03),
        ("down_offset", 0.02),
        ("right_slope", 0.01),
        ("left_slope", -0.01),
    ):
        ensemble.own[name].fill(value)
    return ensemble


def best(job: Callable[[int], None], runs: int) -> float:
    """Return the shortest time [s] of a job, after one run that compiles."""
    job(0)
    times = []
    for k in range(1, runs + 1):
        begin = time.perf_counter()
        job(k)
        times.append(time.perf_counter() - begin)
    return min(times)


def measure(most: int) -> list[dict[str, object]]:
    """Return one row a case: ns per particle-step for each number of particles."""
    tiles = fields()
    land = shore.read_land("gshhg", BOX)
    coast = shoreline.build_coast(land, BOX)
    device = device_coast.upload(coast)
    box = domain()
    rows: list[dict[str, object]] = [{"case": case[0]} for case in CASES]
    for n in (10**k for k in range(4, 8) if 10**k <= most):
        ensemble = particles(n, coast)
        for row, (_, scheme, physics, wind, coastal) in zip(rows, CASES, strict=True):
            ranges = RANGES if wind else {"current": (0, 1)}

            def job(
                k: int,
                ranges=ranges,
                physics=physics,
                coastal=coastal,
                scheme=scheme,
                n=n,
                ensemble=ensemble,
            ) -> None:  # type: ignore[no-untyped-def]
                step = kernel.Step(k, 600 * k, 600, 1)
                shore_or_none = device if coastal else None
                kernel.advance(
                    ensemble,
                    (0, n, 0),
                    tiles,
                    ranges,
                    physics,
                    step,
                    kernel.Surroundings(box, shore_or_none, scheme=scheme),
                )
                runtime.wait()

            row[f"{n:.0e}"] = round(best(job, max(4, min(200, 8_000_000 // n))) * 1e9 / n, 1)
    return rows


def yardstick(folder: Path, n: int) -> float | None:
    """Return ns per particle-step of the C kernel, or None where it can't be built."""
    source = folder / "limit.c"
    if not source.is_file():
        return None
    with tempfile.TemporaryDirectory() as place:
        program = Path(place) / "limit"
        build = [
            "gcc",
            "-O3",
            "-march=native",
            "-ffast-math",
            "-fopenmp",
            str(source),
            "-lm",
            "-o",
            str(program),
        ]
        try:
            subprocess.run(build, check=True, capture_output=True)
        except (OSError, subprocess.CalledProcessError):
            return None
        found = [
            subprocess.run([str(program), str(n)], capture_output=True, text=True).stdout
            for _ in range(3)
        ]
    return min(float(text.split()[0]) for text in found)


def opendrift(python: str, folder: Path, n: int = 100_000, hours: int = 6) -> str | None:
    """Return what OpenDrift's own run of the job prints."""
    with tempfile.TemporaryDirectory() as place:
        for script in ("forcing.py", "opendrift_leeway.py"):
            if not (folder / script).is_file():
                return None
        subprocess.run([python, str((folder / "forcing.py").resolve())], cwd=place, check=True)
        command = [python, str((folder / "opendrift_leeway.py").resolve()), str(n), str(hours)]
        done = subprocess.run(command, cwd=place, capture_output=True, text=True)
    lines = [line for line in done.stdout.splitlines() if "particle-step" in line]
    return lines[-1] if lines else None


def main() -> None:
    """Measure, print the table, and write JSON where asked."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--most", type=float, default=1e7)
    options.add_argument("--yardsticks", type=Path)
    options.add_argument("--opendrift")
    options.add_argument("--backend", default="cpu")
    given = smallest.parse(options, saves=True, most=1e4)
    runtime.start(given.backend)
    before = yardstick(given.yardsticks, 10**6) if given.yardsticks else None
    rows = measure(int(given.most))
    after = yardstick(given.yardsticks, 10**6) if given.yardsticks else None
    limit = min(before, after) if before and after else None
    sizes = [key for key in rows[0] if key != "case"]
    table = Table(title=f"ns per particle-step ({given.backend})")
    table.add_column("job")
    for size in sizes:
        table.add_column(size, justify="right")
    if limit:
        table.add_column("x limit at 1e+06", justify="right")
    for row in rows:
        ratio = [f"{float(str(row['1e+06'])) / limit:.2f}"] if limit and "1e+06" in row else []
        table.add_row(str(row["case"]), *(str(row[size]) for size in sizes), *ratio)
    result = {"backend": given.backend, "ns_per_particle_step": rows, "bytes_per_particle": BYTES}
    console = Console(width=140)
    console.print(table)
    console.print(f"memory: {BYTES} bytes a particle on the device, plus the window of forcing")
    if before and after:
        console.print(f"limit.c: {before} ns before, {after} ns after")
        result["limit"] = [before, after]
    if given.opendrift and given.yardsticks:
        peer = opendrift(given.opendrift, given.yardsticks)
        console.print(f"OpenDrift Leeway: {peer}")
        match = re.search(r"([\d.]+) ns per", peer or "")
        result["opendrift_ns"] = float(match[1]) if match else None
    smallest.save(given, result)


if __name__ == "__main__":
    main()
