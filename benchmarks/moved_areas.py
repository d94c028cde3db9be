"""How long the POS of sub-areas takes that are moved by hand; prints one table.

    python benchmarks/moved_areas.py [--particles 100000] [--moves 20] [--threads N]

Two sub-areas, of a boat and a helicopter, are moved and turned at random, as on the page of `drift
serve`. The first line is the time to follow the particles, once per plan.
"""

import argparse
import math
import time
from pathlib import Path

import numpy as np
import smallest
from rich.console import Console
from rich.table import Table

from drift.case import file as case_file
from drift.case.record import Case
from drift.pipeline.run_options import Options, open_job
from drift.planning.search import moved
from drift.planning.search.moved import SubArea
from geo.notation import NMI

CENTRES = ((-5.43, 50.05), (-5.36, 49.96))  # [deg]
SIZES = ((6.9, 3.5), (8.5, 8.1))  # [nmi]
CASE = """
title = "moved"
start = "2026-11-28T11:30Z"
duration = "16 h"
particles = {particles}
coast.source = "none"
[[current]]
constant = {{ speed = "1 kn", toward = 75 }}
[uncertainty]
current = {{ std = "0.3 m/s", time = "11 h" }}
[[scenario]]
name = "kayak"
object = "water"
position = {{ at = "49 55.0N 005 40.0W", error = "1 nmi" }}
[plan]
begin = "+8 h"
until = "+16 h"
"""
SORTIES = """
[[sortie]]
name = "boat"
start = "+8 h"
speed = "14 kn"
sweep_width = "0.7 nmi"
sweep_width_uncertainty = "20 %"
pattern = { kind = "parallel", centre = [-5.43, 50.05], length = "6.9 nmi", width = "3.5 nmi", spacing = "0.5 nmi" }
[[sortie]]
name = "helicopter"
start = "+8 h"
speed = "90 kn"
sweep_width = "0.5 nmi"
pattern = { kind = "parallel", centre = [-5.36, 49.96], length = "8.5 nmi", width = "8.1 nmi", spacing = "0.45 nmi" }
"""


def areas_of(case: Case) -> list[SubArea]:
    """Return the sorties of a case as sub-areas."""
    return [
        SubArea(sortie, sortie.name, centre, 0.0, length * NMI, width * NMI)
        for sortie, centre, (length, width) in zip(case.sorties, CENTRES, SIZES, strict=True)
    ]


def main() -> None:
    """Time the moves and print the table."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--particles", type=int, default=100_000)
    options.add_argument("--moves", type=int, default=20)
    options.add_argument("--threads", type=int, default=None)
    given = smallest.parse(options, particles=2000, moves=2)
    text, path = CASE.format(particles=given.particles), Path("moved.toml")
    case = case_file.load_text(path, text)
    # the plan of a case does not know these sorties
    searched = case_file.load_text(path, text + SORTIES, {"plan.until": '"+16 h"'})
    areas = areas_of(searched)
    begun = time.perf_counter()
    particles = moved.particles_of(open_job(case, Options(threads=given.threads)))
    moved.pos(particles, areas)  # compiles
    took = [time.perf_counter() - begun]
    rng = np.random.default_rng(20261128)
    for _ in range(given.moves):
        begun = time.perf_counter()
        for area in areas:
            to = (area.centre[0] + rng.normal(0, 0.05), area.centre[1] + rng.normal(0, 0.03))
            turned = moved.moved(area, to, rng.uniform(0, math.pi), None, case.plan)
            areas = [turned if one.unit == area.unit else one for one in areas]
        moved.pos(particles, areas)
        took.append(time.perf_counter() - begun)
    table = Table("work", "ms", title=f"{given.particles:,} particles, two sub-areas")
    table.add_row("follow the particles, once", f"{1000 * took[0]:.0f}")
    table.add_row("a move, median", f"{1000 * np.median(took[1:]):.0f}")
    table.add_row("a move, longest", f"{1000 * max(took[1:]):.0f}")
    Console().print(table)


if __name__ == "__main__":
    main()
