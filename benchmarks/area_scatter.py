"""How far do areas and the mean of a forecast scatter by chance alone? Runs with other seeds, by
number of particles.

The scatter of n runs errs by 1 / sqrt(2 (n - 1)) of itself.

    python benchmarks/area_scatter.py [SEEDS]
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import smallest

import drift
from geo import sphere

ONE = """
title = "{title}"
start = "2026-11-21T00:00Z"
duration = "24 h"
coast.source = "none"
output = {{ every = "24 h" }}
[[current]]
constant = {{ speed = "0.6 kn", toward = 70 }}
[[wind]]
constant = {{ speed = "14 kn", from = 250 }}
[uncertainty]
current = {{ std = "0.2 m/s", time = "6 h" }}
wind = {{ std = "2 m/s", time = "6 h" }}
[[scenario]]
name = "last call"
weight = 0.7
object = "{object}"
position = {{ at = "27 30N 088 00W", std = "3 nmi" }}
"""
TWO = """[[scenario]]
name = "late call"
weight = 0.3
object = "LIFE-RAFT-DB-11"
position = { at = "27 36N 087 54W", std = "5 nmi", time = "+2 h" }
[[sortie]]
name = "first"
start = "+8 h"
end = "+10 h"
sweep_width = "1 nmi"
speed = "90 kn"
area = { centre = "27 36N 087 48W", length = "15 nmi", width = "12 nmi", orientation = 70 }
"""
CASES = (
    ONE.format(title="person in water", object="PIW-1"),
    ONE.format(title="raft, jibes", object="LIFE-RAFT-DB-11"),
    ONE.format(title="two stories, a sortie", object="PIW-1") + TWO,
)
SIZES = (1_000, 5_000, 20_000)
SMALLEST = (500, 1_000)


def main() -> None:
    """Print a row for each case and number of particles: mean areas, and scatter of areas and of
    the mean position.
    """
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("seeds", nargs="?", type=int, default=100)
    seeds = smallest.parse(parser, seeds=2).seeds
    print(
        f"{seeds} seeds: scatter (one standard deviation) known to {100 / np.sqrt(2 * (seeds - 1)):.0f} % of itself"
    )
    print(
        f"{'case':<24}{'particles':>10}  areas 50, 75, 95 % [nmi2]    scatter [%]          mean position [m]"
    )
    for text in CASES:
        path = Path(tempfile.mkdtemp()) / "case.toml"
        path.write_text(text, encoding="utf-8")
        case = drift.load(path)
        for size in SMALLEST if smallest.ASKED else SIZES:
            runs = [drift.vary(case, {"seed": seed, "particles": size}) for seed in range(seeds)]
            areas, means = [], []
            for one in drift.run_many(runs, maps="last"):
                assert one.forecast is not None, one.error
                areas.append(one.forecast.data["containment_area"].values[-1] / 1852.0**2)
                means.append(one.mean[-1])
            held, at = np.array(areas), np.radians(np.array(means))
            scatter = 100 * held.std(axis=0, ddof=1) / held.mean(axis=0)
            apart = at.std(axis=0, ddof=1) * sphere.RADIUS * [np.cos(at[:, 1].mean()), 1.0]
            print(
                f"{case.title:<24}{size:>10,}  {'  '.join(f'{x:8.1f}' for x in held.mean(axis=0))}  "
                f"{'  '.join(f'{x:5.2f}' for x in scatter)}  {np.hypot(*apart):8.0f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
