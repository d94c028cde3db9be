"""What the coast costs a step: the same particles with and without it, on the Norwegian coast and
in open sea.

    DRIFT_DATA=... python benchmarks/coast_cost.py [PARTICLES]

A raft case on NorKyst and AROME with errors and diffusion, GSHHG at full resolution. Every round
moves the same particles over the same hour with the coast and without; those that go ashore are set
afloat again between rounds. The best of the rounds counts, and so does the best of the rounds
without.
"""

import argparse
import tempfile
import time

import numpy as np
import smallest

import drift
from drift.pipeline import run_setup
from kernels.runtime import runtime
from kernels.step import advance as kernel

CASE = """
start = "2015-11-16T00:00Z"
duration = "12 h"
particles = {particles}
max_lost = 1.0
clock.step = "10 min"
[[current]]
name = "norkyst"
files = "${{DRIFT_DATA}}/norkyst/norkyst800*.nc"
[[wind]]
name = "arome"
files = "${{DRIFT_DATA}}/norkyst/arome*.nc"
[uncertainty]
current = {{ std = "0.15 m/s", time = "6 h" }}
wind = {{ std = "2 m/s", time = "6 h" }}
diffusivity = "10 m2/s"
[coast]
{coast}
[[scenario]]
name = "raft"
object = "LIFE-RAFT-DB-11"
area.polygon = {area}
"""
AREAS = {
    "along the coast": '["60 10N 004 50E", "60 10N 005 30E", "61 30N 005 20E", "61 30N 004 40E"]',
    "open sea": '["60 30N 003 00E", "60 30N 004 00E", "61 20N 004 00E", "61 20N 003 00E"]',
}
KINDS = {
    "strand": 'behaviour = "strand"',
    "refloat": 'behaviour = "refloat"\nhalf_life = "6 h"',
    "slide": 'behaviour = "slide"',
}
ROUNDS, STEPS = 1 if smallest.ASKED else 7, 6


def measure(area: str, coast: str, particles: int) -> tuple[float, float, float, float]:
    """Return ns per particle-step with and without the coast; shares ashore after the steps, and
    what the coast adds to the step of each that still moves.
    """
    with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
        file.write(CASE.format(particles=particles, area=area, coast=coast))
        file.flush()
        case = drift.load(file.name)
    where = run_setup.open_for(case)
    run = run_setup.prepare(case, where)
    place = run.scene.place
    columns = ("lon", "lat", "status", "release", "status_since", "edge", "side")
    before = {name: run.ensemble.columns[name].to_numpy() for name in columns}
    best = {True: np.inf, False: np.inf}
    ashore, moving = 0.0, {True: 1.0, False: 1.0}
    steps = list(run.clock.steps())[:STEPS]
    for _ in range(ROUNDS):
        for coastal in (True, False):
            for name, column in before.items():
                run.ensemble.columns[name].from_numpy(column)
            chosen = place if coastal else place._replace(coast=None)
            total = afloat = 0.0
            for low, high, step in steps:
                run.scene.forcing.set(low, high)
                begin = time.perf_counter()
                kernel.advance(
                    run.ensemble, (0, particles, 0), run.scene.forcing.tiles, run.scene.forcing.ranges[0],
                    run.scene.motions[0].terms, step, chosen,
                )  # fmt: skip
                runtime.wait()
                total += time.perf_counter() - begin
                afloat += float((run.ensemble.status.to_numpy() == 0).mean()) / STEPS
            best[coastal] = min(best[coastal], total / STEPS / particles * 1e9)
            moving[coastal] = afloat
            if coastal:
                ashore = float((run.ensemble.status.to_numpy() == 1).mean())
    run.scene.forcing.close()
    return (
        best[True],
        best[False],
        ashore,
        (best[True] / moving[True]) / (best[False] / moving[False]) - 1,
    )


def main() -> None:
    """Measure each place and behaviour and print a line each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("particles", nargs="?", type=float, default=1e6)
    particles = int(smallest.parse(parser, particles=500).particles)
    smallest.data()
    runtime.start()
    for place, area in AREAS.items():
        for kind, coast in KINDS.items():
            with_coast, without, ashore, each = measure(area, coast, particles)
            print(f"{place}, {kind}: {with_coast:.1f} ns per particle-step with the coast, {without:.1f} without: "
                  f"{with_coast - without:+.1f} ns, {with_coast / without - 1:+.1%}; {ashore:.1%} ashore after an hour; for each that still "
                f"moves {each:+.0%}")  # fmt: skip


if __name__ == "__main__":
    main()
