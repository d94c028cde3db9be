"""Where two ships tow their arrays in random seas with convergence zones; prints one table.

    python benchmarks/placement.py [--cases 3] [--first 1] [--particles 100000] [--hours 24]
    [--threads 2]

Seconds are those of placing, without the bound. The share is that of one ship on one leg against 13
x 13 begins and 24 courses, the best 40 of which on 600 particles are valued on those on which the
plan was made: above 1, no way of the grid hears as much.
"""

import argparse
import math
import time
from dataclasses import replace

import numpy as np
import smallest
from rich.console import Console
from rich.table import Table

from drift.evidence.sensors import line_array, noise, spreading
from drift.evidence.sensors.records import Levels, Sensor, Sonar, Tow
from drift.planning.arrays import heard, placement, placement_bound, ways
from drift.planning.arrays.ways import Sea, Ways
from drift.planning.search import planning_tracks
from drift.planning.search.planning_tracks import Tracks
from geo import sphere
from geo.polyline import Area
from kernels.runtime import runtime

NMI, KNOT = 1852.0, 1852.0 / 3600
BEGIN = 1.78e9
MIDDLE = math.radians(-150), math.radians(38)
# of the grid of brute force: a side, and a turn
BEGINS, COURSES = (4, 6) if smallest.ASKED else (13, 24)


def case(seed: int, m: int, hours: float) -> tuple[Tracks, list[Tow]]:
    """Return particles of one to three groups on their ways, and two ships."""
    rng = np.random.default_rng(seed)
    moments = BEGIN + np.linspace(0, hours * 3600, 49)
    groups = int(rng.integers(1, 4))
    which = rng.choice(groups, m, p=rng.dirichlet(np.full(groups, 3.0)))
    centre = rng.uniform(-150, 150, (2, groups)) * NMI
    x, y = centre[:, which] + rng.normal(0, 1, (2, m)) * rng.uniform(15, 60) * NMI
    course = rng.uniform(0, 2 * math.pi, groups)[which] + rng.normal(0, 0.3, m)
    gone = (moments - BEGIN)[:, None] * rng.uniform(4, 12, m) * KNOT
    lon, lat = sphere.destination(*MIDDLE, x + gone * np.sin(course), y + gone * np.cos(course))
    tracks = Tracks(
        moments, sphere.to_binary(np.degrees(lon)), sphere.to_binary(np.degrees(lat)), np.ones(lon.shape, bool), np.full(m, 1 / m),
        which.astype(np.int32), np.full(m, BEGIN),
    )  # fmt: skip
    first = (rng.uniform(26, 30) * NMI, rng.uniform(31, 35) * NMI, rng.uniform(8, 14))
    second = (rng.uniform(54, 60) * NMI, rng.uniform(62, 68) * NMI, rng.uniform(8, 12))
    water = spreading.losses(200 * NMI, transition=8000.0, absorption=0.01, zones=(first, second))
    wind = noise.of_table([[b, 72 + 3 * math.sin(math.radians(b))] for b in range(0, 360, 30)])
    levels = Levels(np.zeros(1), np.full((groups, 1), rng.uniform(138, 146), np.float32))
    array = Sensor(
        "towed", Sonar(levels, water, wind, line_array.of_line(24, 15.0, 50.0), 8.0, 6.0, 1 / 3600)
    )
    half, (east, north) = rng.uniform(60, 120), rng.uniform(-80, 80, 2)
    ships = [
        Tow(
            f"ship {k}",
            array,
            _box(east + 40 * k, north, half),
            5 * KNOT,
            np.datetime64(int(BEGIN), "s"),
        )
        for k in range(2)
    ]
    return tracks, ships


def _box(east: float, north: float, half: float) -> Area:
    x, y = (
        np.array([east - half, east + half, east + half, east - half]),
        np.array([north - half] * 2 + [north + half] * 2),
    )
    lon, lat = np.degrees(sphere.destination(*MIDDLE, x * NMI, y * NMI))
    return Area(tuple(lon.tolist()), tuple(lat.tolist()))


def brute(sea: Sea, tracks: Tracks) -> float:
    """Return what the best of a grid of straight ways hears of the particles of the last stage."""
    last = placement._sampled(
        planning_tracks.coarser(tracks, placement.BINS), placement.STAGES[-1][0]
    )
    few = planning_tracks.sample(last, 600)
    west, south, east, north = sea.begins.shape.bounds
    # what lies on the edge of the area counts as outside
    share = np.linspace(1e-3, 1 - 1e-3, BEGINS)
    x, y, course = (
        v.ravel()
        for v in np.meshgrid(
            west + (east - west) * share,
            south + (north - south) * share,
            np.arange(COURSES) * 2 * math.pi / COURSES,
        )
    )
    every = Ways(*sphere.destination(*sea.middle, x, y), course, course, np.ones(course.size))
    every = every.take(np.flatnonzero(ways.possible(sea, every, last.time)))
    rough = placement.worth(heard.hearer(sea, few), every, few.weight[:, None], placement.COARSE)
    best = every.take(np.argsort(-rough)[:40])
    return float(
        placement.worth(heard.hearer(sea, last), best, last.weight[:, None], placement.FINE).max()
    )


def main() -> None:
    """Print the table."""
    asked = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    for name, value in (
        ("cases", 3),
        ("first", 1),
        ("particles", 100_000),
        ("hours", 24),
        ("threads", 2),
    ):
        asked.add_argument(f"--{name}", type=int, default=value)
    given = smallest.parse(asked, cases=1, particles=500, hours=6)
    runtime.start("cpu", given.threads)
    table = Table(
        "case",
        "wall s",
        "processor s",
        "hears",
        "of the bound's particles",
        "bound",
        "share of brute force",
    )
    for seed in range(given.first, given.first + given.cases):
        tracks, ships = case(seed, given.particles, given.hours)
        seas = [ways.sea(ship, BEGIN, float(tracks.time[-1])) for ship in ships]
        wall, used = time.perf_counter(), time.process_time()
        plan = placement.best_ways(seas, tracks, seed)
        wall, used = time.perf_counter() - wall, time.process_time() - used
        found = placement_bound.bound(seas, tracks, plan)
        one = ways.sea(replace(ships[0], legs=1), BEGIN, float(tracks.time[-1]))
        share = placement.best_ways([one], tracks, seed).value / brute(one, tracks)
        table.add_row(
            str(seed),
            f"{wall:.1f}",
            f"{used:.1f}",
            f"{plan.value:.4f}",
            f"{found.plan:.4f}",
            f"{found.value:.4f}",
            f"{share:.3f}",
        )
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
