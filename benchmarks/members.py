"""What an ensemble of currents costs beside one member: memory, drift time, and reading told apart.

Eddying currents, hourly, on 0.05 degrees: a file of one member, and one of many. CPU time of the
whole process less that of the thread that reads ahead; "reading" is that thread's. Each run is a
process of its own, for its memory.

    python benchmarks/members.py [MEMBERS] [PARTICLES]
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import smallest
import xarray as xr

import drift
from drift.engine.motion import simulate
from drift.pipeline import run_setup
from geo.forcing.reading.stream import Slices
from kernels.runtime import runtime

CASE = """
title = "cost of members"
start = "2026-01-01T00:00Z"
duration = "24 h"
particles = {particles}
uncertainty = "none"
clock.step = "30 min"
coast.source = "none"
domain = {{ west = -19.5, south = 38.5, east = -10.5, north = 45.5 }}
[[current]]
files = "{file}"
members = {several}
[[scenario]]
name = "water"
object = "water"
position = {{ at = [-15.0, 43.0], error = "10 nmi" }}
"""
LON, LAT, HOURS = np.linspace(-20, -10, 201), np.linspace(38, 46, 161), np.arange(26)
WAVES = 12


def write(path: Path, members: int) -> None:
    """Write sums of plane waves, other ones for each member, chunk by chunk of one slice."""
    x, y = np.meshgrid(LON, LAT)
    data = np.empty((2, members, HOURS.size, LAT.size, LON.size), np.float32)
    for member in range(members):
        rng = np.random.default_rng(member)
        kx, ky, phase = (
            rng.normal(0, 3, WAVES),
            rng.normal(0, 3, WAVES),
            rng.uniform(0, 2 * np.pi, WAVES),
        )
        rate, size = rng.normal(0, 0.1, WAVES), rng.normal(0, 0.15, WAVES)
        for hour in HOURS:
            angle = (
                kx[:, None, None] * x + ky[:, None, None] * y + (phase + rate * hour)[:, None, None]
            )
            data[0, member, hour], data[1, member, hour] = (
                np.tensordot(size, wave, 1) for wave in (np.cos(angle), np.sin(angle + 1))
            )
    dims = ("number", "time", "lat", "lon")
    names = ("eastward_sea_water_velocity", "northward_sea_water_velocity")
    xr.Dataset(
        {
            name: (dims, own, {"units": "m s-1", "standard_name": name})
            for name, own in zip(names, data, strict=True)
        },
        coords={
            "time": ("time", HOURS, {"units": "hours since 2026-01-01"}),
            "lat": ("lat", LAT, {"units": "degrees_north"}),
            "lon": ("lon", LON, {"units": "degrees_east"}),
        },
    ).to_netcdf(path, encoding={name: {"chunksizes": (1, 1, LAT.size, LON.size)} for name in names})


def measure(path: str) -> None:
    """Print what one case takes, as JSON."""
    spent = 0.0
    plain = Slices._read

    def timed(self: Slices, index: int) -> np.ndarray:
        nonlocal spent
        begun = time.thread_time()
        values = plain(self, index)
        spent += time.thread_time() - begun
        return values

    Slices._read = timed  # type: ignore[method-assign]
    runtime.start()
    case = drift.load(path)
    begin = run_setup.prepare(case, run_setup.open_for(case))
    read, begun = spent, time.process_time()
    with closing(begin.scene.forcing):
        for _ in simulate.run(
            begin.ensemble, begin.scene, begin.clock, np.array([case.period.duration])
        ):
            pass
    reading = spent - read
    told = {"drift": time.process_time() - begun - reading, "reading": reading}
    print(json.dumps({**told, "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}))


def main() -> None:
    """Print a row for one member and a row for many."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("members", nargs="?", type=int, default=51)
    parser.add_argument("particles", nargs="?", type=int, default=1_000_000)
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    given = smallest.parse(parser, members=2, particles=1000)
    if given.measure:
        measure(given.measure)
        return
    members, particles = given.members, given.particles
    with tempfile.TemporaryDirectory() as folder:
        rows = []
        for many in (1, members):
            write(Path(folder) / f"{many}.nc", many)
            case = Path(folder) / f"{many}.toml"
            case.write_text(
                CASE.format(file=f"{many}.nc", particles=particles, several=str(many > 1).lower())
            )
            told = subprocess.run(
                [sys.executable, __file__, "--measure", str(case)],
                check=True,
                capture_output=True,
                text=True,
            ).stdout
            rows.append(json.loads(told.splitlines()[-1]))
    print(
        f"{particles:,} particles, 24 h in steps of 30 min, hourly currents of {LON.size * LAT.size:,} nodes"
    )
    print(f"{'members':>8} {'drift [CPU s]':>14} {'reading [CPU s]':>16} {'memory [MiB]':>13}")
    for many, row in zip((1, members), rows, strict=True):
        print(f"{many:>8} {row['drift']:>14.2f} {row['reading']:>16.2f} {row['memory']:>13.0f}")
    print(f"drift: {rows[1]['drift'] / rows[0]['drift']:.2f} x one member")


if __name__ == "__main__":
    main()
