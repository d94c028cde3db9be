"""How long each kernel takes to compile, the first time on a machine: every variant in a fresh
process with an empty cache.

    python benchmarks/compile_times.py [--runs 1] [--only TEXT] [--backend cpu] [--json FILE]

The time is that of the first launch on a handful of particles, after another kernel has started the
compiler itself; the least of the runs counts, of the clock and of the processor's own, which other
work on the machine does not stretch as much. Kernels that take less than a quarter of a second are
left out.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import shapely
import smallest
from rich.console import Console
from rich.table import Table

from drift.engine.motion.models.drift import COLUMNS
from drift.engine.motion.period import Period
from drift.engine.motion.steering import itinerary_tables
from drift.engine.motion.steering import steer as steering
from drift.engine.motion.steering.itinerary import Itinerary, Near, Spread, WayPoint, Ways
from drift.engine.particles import ensemble as record
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.shore import Shore
from geo.grids.grid import Grid
from kernels.evidence import observe, sweep
from kernels.planning import allocate, rectangles, sweeps
from kernels.runtime import runtime
from kernels.steering import pieces, steer
from kernels.step import advance as kernel
from kernels.step import bridge
from kernels.step import coast as device_coast
from kernels.step import prior as draws
from kernels.step.sample import Ranges, Tiles

BOX = Box(-1.5, -1.5, 1.5, 1.5)
ALL = {"current": (0, 1), "wind": (1, 2), "stokes": (2, 3)}
DOMAIN = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
ERRORS = kernel.Physics(0.1, 21_600.0, 1.0, 21_600.0, jibe_rate=1e-5)
WALK = ERRORS._replace(diffusivity=10.0)
N = 8
KEY = (1, 0)


def coast() -> device_coast.DeviceCoast:
    """Return an island off which the particles lie."""
    land = Shore(np.array([shapely.box(0.1, -1.4, 1.4, 1.4)], object), "test", (), BOX)
    return device_coast.upload(shoreline.build_coast(land, BOX))


def ensemble() -> record.Ensemble:
    """Return a handful of particles at (0, 0)."""
    return record.empty(1, (0, N), COLUMNS)


def move(
    physics: kernel.Physics, coastal: bool, ranges: Ranges = ALL, **place: object
) -> Callable[[], object]:
    """Return a job that moves particles over one step."""
    tiles = Tiles([Grid(-1, -1, 1, 1, 3, 3)] * 3)
    for tile in range(3):
        tiles.place(tile, np.full((3, 3, 2), 0.1, np.float32), later=False)
    tiles.blend([(0.0, 0.1)] * 3)
    where = kernel.Surroundings(DOMAIN, coast() if coastal else None, **place)
    own = ensemble()
    return lambda: kernel.advance(
        own, (0, N, 0), tiles, ranges, physics, kernel.Step(0, 0, 600, 1), where
    )


def inside() -> Callable[[], object]:
    """Return a job that places particles inside a step."""
    device, own, bend = coast(), ensemble(), runtime.upload(np.zeros(4 * N, np.float32))
    asked = bridge.Inside(runtime.copy(own.lon), runtime.copy(own.lat), bend, 0, 600, 0, 300, 1, 0)
    return lambda: bridge.between(own, asked, np.array([10.0]), own.batch([0]).shift, device)


def drawn(name: str, *numbers: float) -> Callable[[], object]:
    """Return a job that draws positions in water."""
    device, own, tries = coast(), ensemble(), runtime.upload(np.zeros(2, np.int64))
    return lambda: getattr(draws, name)(
        True, 0, N, 0, own.lon, own.lat, tries, *KEY, *numbers, device.pack
    )


def trackline() -> Callable[[], object]:
    """Return a job that draws positions along a track."""
    device, own, tries = coast(), ensemble(), runtime.upload(np.zeros(2, np.int64))
    points = runtime.upload(np.zeros(2, np.int32))
    numbers = [runtime.upload(np.ones(1, np.float32)) for _ in range(3)]
    args = (True, 0, N, 0, own.lon, own.lat, own.release, tries, *KEY, points, *numbers)
    tilt = (False, *(numbers[0],) * 4)
    return lambda: draws.draw_trackline(*args, 1.0, 0.0, 1.0, -1.0, 0, 60.0, *tilt, device.pack)


def objects() -> Callable[[], object]:
    """Return a job that draws the objects of worlds."""
    device, own, tries = coast(), ensemble(), runtime.upload(np.zeros(2, np.int64))
    worlds = [runtime.upload(np.zeros(1, np.int32)) for _ in range(3)]
    args = (True, 0, N, 0, N, own.lon, own.lat, own.release, own.world, tries, *KEY, *worlds)
    return lambda: draws.draw_objects(*args, 10.0, 60.0, device.pack)


def exposed(kind: int, steers: bool) -> Callable[[], object]:
    """Return a job that exposes what drifts, or what steers, to a sensor's track."""
    own, exposure, passed = ensemble(), runtime.empty(N), runtime.empty(N)
    time_, place, ones = (
        np.array([0, 300, 600], np.float32),
        np.zeros(6, np.int32),
        np.ones(8, np.float32),
    )
    track = sweep.Track(time_, place, ones[:6], ones, np.ones(2, np.int32), np.ones(2, np.int32))
    table = np.array([0, 1, 100, 0.5, 100, 100, 0, 100], np.float32)
    args = (
        own,
        paths(own, steers),
        kind,
        track,
        table,
        np.ones(1, np.float32),
        exposure,
        True,
        np.ones(1),
        passed,
    )
    return lambda: sweep.expose(*args)


def paths(own: Any, steers: bool) -> Any:
    """Return paths in a step of what drifts, or of what steers."""
    if steers:
        room = pieces.Room(N)  # of each target one piece, the whole step
        for name, column in room.columns.items():
            column.fill({"piece_next": pieces.NONE, "piece_end": 600}.get(name, 0))
        return pieces.steered(own.batch([0]), room.pack, kernel.Step(0, 0, 600, 1))
    return pieces.straight(own, own.batch([0]), (own.lon, own.lat), (own.lon, own.lat), 0, 600)


def fail() -> Callable[[], object]:
    """Return a job that takes a sortie's miss into weights."""
    one, columns = np.ones(2, np.float32) / 2, [runtime.empty(2 * N) for _ in range(2)]
    return lambda: sweep.fail(
        runtime.upload(np.zeros(N, np.int32)),
        sweep.HAZARD,
        columns[0],
        one,
        one,
        columns[1],
        runtime.empty(N),
    )


def swarm() -> rectangles.Swarm:
    """Return tracks of a handful of particles on a plane."""
    zeros = np.zeros((3, N))
    return rectangles.swarm(
        np.array([0.0, 60.0, 120.0]), zeros, zeros, zeros + 1, np.zeros(N, np.int32)
    )


ONE = np.ones(1)
TWO = np.ones((N, 1))
PATH = np.array([[0, 0, 0, 1], [60, 9, 5, 1]], np.float32)
CURVE = np.array([0, 1, 1, 0], np.float32)
BOXED = np.array([[0, 0, 0, 1, 90, 90, 0, 60, 1]], np.float32)


def spread(gain: bool) -> Callable[[], object]:
    """Return a job of the bound: effort over cells."""
    cell = np.zeros((1, N), np.int32)
    one, curve = np.ones((1, N)), (np.array([3.0, 2.0, 1.0]),) * 3
    field = allocate.Field(
        cell, 1, one, one, cell[0], one[0], np.ones((1, 1)), np.ones(1), curve, 0.1
    )
    return field.gain if gain else lambda: field.spend(np.ones((1, 1)))


def steered(name: str) -> Callable[[], object]:
    """Return a job on targets that steer along a bridge: `born`, `mover` (their step) or `inside`."""
    whole = Spread(0.0, 0.0, 0.0)
    points = tuple(WayPoint(Near(lon, 0.0, 0.0, 0.0, 0.0), whole) for lon in (0.0, -0.01))
    period = Period(np.datetime64("2026-03-05T00:00:00"), np.datetime64("2026-03-06T00:00:00"), 1)
    plan = itinerary_tables.plan([Itinerary((Ways(points, period.start, k=10.0),))], period)
    own = record.empty(1, (0, N), steering.COLUMNS)
    columns, tries = (
        {key: own.columns[key] for key in steer.COLUMNS},
        runtime.upload(np.zeros(2, np.int64)),
    )
    step, begin = kernel.Step(0, 0, 600, 1), (runtime.copy(own.lon), runtime.copy(own.lat))
    fixed = columns, own.batch([0]), plan, 1, DOMAIN, coast()
    jobs = {
        "born": lambda: steer.born(*fixed, tries),
        "mover": lambda: steer.mover(*fixed)(step),
        "inside": lambda: steer.inside(*fixed, step, begin, 0, 300, 0),
    }
    return jobs[name]


def observed(kind: int, besides: int, steering: bool) -> Callable[[], object]:
    """Return a job that asks a sensor that stands still of what drifts, or of what steers."""
    own, stayed, told = ensemble(), runtime.empty(N), runtime.empty(N)
    shape = observe.Shape(
        kind, 0, 0, 1.0, 0.0, 9.0, 9.0, (0, 0, 9, 9), np.array([0, 0, 9, 9], np.float32)
    )
    places, window = (own.lon, own.lat), observe.Window(0, 0, 0, 600)
    args = (
        own,
        paths(own, steering),
        places,
        places,
        window,
        0.0,
        shape,
        besides,
        (0.0, 1.0),
        stayed,
        told,
    )
    return lambda: observe.observe_along(*args)


def crossing(name: str) -> Callable[[], object]:
    """Return a job that asks the coast."""
    device, zeros = coast(), np.zeros(N, np.int32)
    more = () if name == "wet" else (zeros + 9, zeros + 7)
    return lambda: getattr(device_coast, name)(device, zeros, zeros, *more)


BEACH = kernel.Beach(21_600.0, 50.0)
SLIDES = kernel.Beach(slides=True)
VARIANTS: dict[str, Callable[[], Callable[[], object]]] = {
    "advance, current alone": lambda: move(kernel.Physics(), False, {"current": (0, 1)}),
    "advance, open sea": lambda: move(WALK, False, bias=True),
    "advance, backward": lambda: move(WALK, False, bias=True, divergence=True),
    "advance, coast, no noise": lambda: move(kernel.Physics(), True),
    "advance, coast, no diffusion": lambda: move(ERRORS, True, bias=True),
    "advance, coast": lambda: move(WALK, True, bias=True),
    "advance, coast, debris": lambda: move(WALK, True, bias=True, debris=1),
    "advance, slide, no diffusion": lambda: move(ERRORS, True, bias=True, beach=SLIDES),
    "advance, slide": lambda: move(WALK, True, bias=True, beach=SLIDES),
    "advance, refloat, no diffusion": lambda: move(ERRORS, True, bias=True, beach=BEACH),
    "advance, refloat": lambda: move(WALK, True, bias=True, beach=BEACH),
    "advance, spill": lambda: move(WALK, True, bias=True, beach=BEACH, sinks=True),
    "advance, spill, backward": lambda: move(
        WALK, True, bias=True, beach=BEACH, sinks=True, divergence=True
    ),
    "bridge": inside,
    "coast, crossings": lambda: crossing("crossings"),
    "coast, meets": lambda: crossing("meets"),
    "coast, wet": lambda: crossing("wet"),
    "prior, position": lambda: drawn("draw_position", 0, 0, 9.0, 5.0, 0.0, 0.0, 9.0, 0.0, 1.0),
    "prior, trackline": trackline,
    "prior, objects of worlds": objects,
    "sweep, inverse cube": lambda: exposed(sweep.CUBE, False),
    "sweep, abeam": lambda: exposed(sweep.ABEAM, False),
    "sweep, zones": lambda: exposed(sweep.ZONES, False),
    "sweep, inside": lambda: exposed(sweep.INSIDE, False),
    "sweep, fail": fail,
    "steer, born": lambda: steered("born"),
    "steer, a step": lambda: steered("mover"),
    "steer, inside a step": lambda: steered("inside"),
    "targets, inverse cube": lambda: exposed(sweep.CUBE, True),
    "targets, abeam": lambda: exposed(sweep.ABEAM, True),
    "targets, zones": lambda: exposed(sweep.ZONES, True),
    "targets, inside": lambda: exposed(sweep.INSIDE, True),
    "targets, line": lambda: observed(observe.LINE, observe.WHETHER, True),
    "targets, line, when": lambda: observed(observe.LINE, observe.WHEN, True),
    "targets, stays in a disc": lambda: observed(observe.IN_DISC, observe.WHETHER, True),
    "observe, line": lambda: observed(observe.LINE, observe.WHETHER, False),
    "observe, line, when": lambda: observed(observe.LINE, observe.WHEN, False),
    "observe, stays in a disc": lambda: observed(observe.IN_DISC, observe.WHETHER, False),
    "planner, legs by inverse cube": lambda: (
        lambda: sweeps.gains(swarm(), None, [PATH], 90 * ONE, ONE, TWO, TWO)
    ),
    "planner, legs by a curve": lambda: (
        lambda: sweeps.gains(swarm(), CURVE, [PATH], 90 * ONE, ONE, TWO, TWO)
    ),
    "planner, one path by a curve": lambda: (
        lambda: sweeps.found(swarm(), CURVE, PATH, 90 * ONE, ONE)
    ),
    "planner, rectangles swept": lambda: (
        lambda: rectangles.gains(swarm(), False, BOXED, np.ones((1, 1)), ONE, 0.1, CURVE, TWO, TWO)
    ),
    "planner, rectangles at random": lambda: (
        lambda: rectangles.gains(swarm(), True, BOXED, np.ones((1, 1)), ONE, 0.1, CURVE, TWO, TWO)
    ),
    "planner, one rectangle": lambda: (
        lambda: rectangles.found(swarm(), False, BOXED, np.ones((1, 1)), ONE, 0.1, CURVE)
    ),
    "planner, bound: spend": lambda: spread(False),
    "planner, bound: gain": lambda: spread(True),
}
SHOWN = 0.25  # [s]
SMALLEST = "coast, wet"


def timed(name: str, backend: str) -> tuple[float, float]:
    """Return the time [s] of the first launch of a variant, here: by the clock, and of the
    processor.
    """
    runtime.start(backend)
    from kernels.maths import sphere as first

    zeros = np.zeros(1, np.int32)
    first.displace(zeros, zeros, np.zeros(1, np.float32), np.zeros(1, np.float32))
    job = VARIANTS[name]()
    runtime.wait()
    begin, worked = time.perf_counter(), time.process_time()
    job()
    runtime.wait()
    return time.perf_counter() - begin, time.process_time() - worked


def fresh(name: str, backend: str) -> tuple[float, float]:
    """Return what `timed` returns, of a process of its own that finds nothing compiled."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, __file__, "--child", name, "--backend", backend]
        env = {**os.environ, "TI_OFFLINE_CACHE_FILE_PATH": folder}
        done = subprocess.run(command, env=env, check=True, capture_output=True, text=True)
    wall, processor = (float(word) for word in done.stdout.split()[-2:])
    return wall, processor


def main() -> None:
    """Measure, print the table, and write JSON where asked."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--runs", type=int, default=1)
    options.add_argument("--only", default="")
    options.add_argument("--backend", default="cpu")
    options.add_argument("--child", help=argparse.SUPPRESS)
    given = smallest.parse(options, saves=True, only=SMALLEST)
    if given.child:
        print(*timed(given.child, given.backend))
        return
    if smallest.ASKED:  # the others here, as far as they have been compiled before
        for name in VARIANTS:
            timed(name, given.backend)
    names = [name for name in VARIANTS if given.only in name]
    found = {}
    for name in names:
        runs = [fresh(name, given.backend) for _ in range(given.runs)]
        found[name] = tuple(min(one) for one in zip(*runs, strict=True))
    table = Table(title=f"seconds to compile ({given.backend})")
    table.add_column("kernel")
    table.add_column("clock", justify="right")
    table.add_column("processor", justify="right")
    for name, seconds in found.items():
        if seconds[1] >= SHOWN or given.only:
            table.add_row(name, *(f"{s:.2f}" for s in seconds))
    Console(width=100).print(table)
    smallest.save(given, {"backend": given.backend, "seconds": found})


if __name__ == "__main__":
    main()
