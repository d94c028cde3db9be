"""Wall time of a plan for four units, 10^6 particles and 12 h, by phase; and what ten minutes would
find.

    python benchmarks/plan_time.py [--particles 1e6] [--minutes 10] [--threads N] [--json FILE]

The first part runs `drift plan` in a process of its own. The second plans again and again on the
same tracks with other seeds for as long as asked, and compares the best of these plans with the
first. Nothing else should run meanwhile.
"""

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import smallest
from rich.console import Console
from rich.table import Table

from drift.case import file as case_file
from drift.pipeline.run_setup import open_for
from drift.planning.search import bound, follow, optimiser
from kernels.maths import noise
from kernels.maths.noise import Purpose
from kernels.runtime import runtime

TEXT = """
title = "Four units, 12 h"
start = "231200ZNOV26"
duration = "12 h"
[output]
every = "6 h"
[[current]]
analytic = "gulf"
[[wind]]
analytic = "breeze"
[uncertainty]
current = { std = "0.15 m/s", time = "6 h" }
wind = { std = "1.5 m/s", time = "6 h" }
diffusivity = "10 m2/s"
[[scenario]]
name = "skiff"
weight = 0.6
object = "SKIFF-1"
[scenario.position]
at = "27 54.5N 088 34.0W"
error = "12 nmi"
[[scenario]]
name = "raft"
weight = 0.4
object = "LIFE-RAFT-NB-1"
[scenario.area]
polygon = ["28 20N 089 05W", "28 25N 088 35W", "28 05N 088 20W", "27 50N 088 50W"]
[plan]
separation = "2 nmi"
"""
UNITS = (
    ("HC-144", "30 37.6N 088 04.1W", 150, 210, 4.0, 1.6, 0.9),
    ("HC-130", "27 54.6N 082 41.2W", 180, 290, 5.0, 1.4, 0.8),
    ("MH-60", "29 49.5N 090 01.2W", 90, 125, 2.5, 1.7, 1.0),
    ("cutter", "28 05.0N 088 40.0W", 14, 14, 10.0, 1.7, 1.5),
)


def text() -> str:
    """Return the case."""
    tables = [TEXT]
    for name, base, search, transit, hours, skiff, raft in UNITS[: 1 if smallest.ASKED else None]:
        tables.append(
            f'[[unit]]\nname = "{name}"\nbase = "{base}"\nready = "231200ZNOV26"\nsearch_speed = "{search} kn"\n'
            f'transit_speed = "{transit} kn"\nendurance = "{hours} h"\ndaylight = false\n'
            f'sweep_width = {{ skiff = "{skiff} nmi", raft = "{raft} nmi" }}\n'
        )
    return "\n".join(tables)


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--particles", type=float, default=1e6)
    options.add_argument("--minutes", type=float, default=10)
    options.add_argument("--threads", type=int)
    given = smallest.parse(options, saves=True, particles=1000, minutes=1e-3)
    show = Console(width=120)
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "four_units.toml", Path(folder) / "out"
        path.write_text(
            text().replace('duration = "12 h"', 'duration = "4 h"') if smallest.ASKED else text()
        )
        command = [
            sys.executable,
            "-m",
            "drift",
            "plan",
            str(path),
            "--set",
            f"particles={int(given.particles)}",
        ]
        begin = time.perf_counter()
        subprocess.run([*command, "--out", str(out)], check=True, capture_output=True)
        wall = time.perf_counter() - begin
        phases = json.loads((out / "summary.json").read_text())["wall_time_s"]
        plan = json.loads((out / "plan.json").read_text())
        case = case_file.load(path, {"particles": str(int(given.particles))})
        hours = case.period.duration / 3600
        table = Table(
            "phase",
            "s",
            title=f"drift plan, {int(given.particles):,} particles, {hours:g} h, {len(case.units)} units",
        )
        for phase, seconds in phases.items():
            table.add_row(phase, f"{seconds:.1f}")
        table.add_row("imports, files, pictures", f"{wall - sum(phases.values()):.1f}")
        table.add_row("wall", f"{wall:.1f}")
        show.print(table)
        show.print(
            f"POS {plan['pos']:.4f}, optimism {plan['optimism']:.4f}, bound {plan['bound'] or math.nan:.4f}"
        )
        smallest.save(
            given, {"particles": int(given.particles), "wall_s": wall, "phases_s": phases}
        )
        if given.minutes <= 0:
            return
        runtime.start("cpu", given.threads)
        tracks = follow.follow(case, open_for(case))
        survival = [scenario.survival for scenario in case.scenarios]
        most = bound.bound(tracks, case.units, case.plan, survival)
        seen, begin = [], time.perf_counter()
        while not seen or time.perf_counter() - begin < 60 * given.minutes:
            seed = noise.seed_for(case.seed, Purpose.OPTIMISER, 1 + len(seen))
            seen.append(optimiser.plan(tracks, case.units, case.plan, seed, survival).seen)
        spread = Table(
            "first",
            "best",
            "first / best",
            "median / best",
            "worst / best",
            "bound",
            title=f"{len(seen)} plans",
        )
        ordered = sorted(seen)
        shares = [seen[0], ordered[len(seen) // 2], ordered[0]]
        spread.add_row(
            f"{seen[0]:.4f}",
            f"{ordered[-1]:.4f}",
            *(f"{x / ordered[-1]:.4f}" for x in shares),
            f"{most.value:.4f}",
        )
        show.print(spread)


if __name__ == "__main__":
    main()
