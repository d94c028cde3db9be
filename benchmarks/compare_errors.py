"""Are the standard errors of `drift compare` right? Two cases with 200 seeds: their mean against
the spread.

A spread of n values of a normal law errs by 1 / sqrt(2 (n - 1)) of itself: a ratio within two of
these of 1 is right.

    python benchmarks/compare_errors.py [SEEDS]
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import smallest

import drift

CASE = """
title = "what if"
start = "2026-11-21T00:00Z"
duration = "12 h"
particles = 2000
coast.source = "none"
output = { every = "12 h", grid = { west = -88.6, south = 27, east = -86.6, north = 28.4, spacing = "2 nmi" } }
[[current]]
constant = { speed = "0.6 kn", toward = 70 }
[[wind]]
constant = { speed = "14 kn", from = 250 }
[uncertainty]
current = { std = "0.2 m/s", time = "6 h" }
wind = { std = "2 m/s", time = "6 h" }
[[scenario]]
name = "last call"
weight = 0.7
object = "PIW-1"
position = { at = "27 30N 088 00W", std = "3 nmi" }
[[scenario]]
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
CHANGES = {"wind.0.constant.speed": "17 kn", "scenario.1.weight": 0.4, "scenario.0.weight": 0.6}


def main() -> None:
    """Print a row for each figure at the end of the run, and one for the cells of the map."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("seeds", nargs="?", type=int, default=200)
    seeds = smallest.parse(parser, seeds=3).seeds
    path = Path(tempfile.mkdtemp()) / "what_if.toml"
    path.write_text(CASE)
    case = drift.load(path)
    values: dict[tuple[str, str], list[tuple[float, float]]] = {}
    maps = []
    for seed in range(seeds):
        a = drift.vary(case, {"seed": seed})
        found = drift.compare(a, drift.vary(a, CHANGES))
        for row in found.rows:
            if row.time == found.times[-1]:
                values.setdefault((row.quantity, row.name), []).append((row.difference, row.error))
        at = found.data.isel(time=-1)
        maps.append(np.stack([at["difference"].values, at["difference_error"].values]))
    print(f"{'figure':<34}{'mean':>12}{'spread':>11}{'error':>11}{'ratio':>8}   of {seeds} seeds, "
          f"right within 1 +- {2 / np.sqrt(2 * (seeds - 1)):.2f}")  # fmt: skip
    for (quantity, name), pairs in values.items():
        differences, errors = np.array(pairs).T
        spread = differences.std(ddof=1)
        if spread > 1e-9 * np.abs(differences).max() + 1e-12:  # else it is rounding
            error = float(np.sqrt(np.mean(errors**2)))
            row = f"{differences.mean():12.4g}{spread:11.4g}{error:11.4g}{error / spread:8.2f}"
            print(f"{f'{quantity}, {name}':<34}{row}")
    cells, errors = np.stack(maps, axis=1)
    spread, error = cells.std(axis=0, ddof=1), np.sqrt(np.mean(errors**2, axis=0))
    busy = spread > 0.1 * spread.max()
    ratio = np.sqrt(np.mean(error[busy] ** 2) / np.mean(spread[busy] ** 2))
    print(f"{f'map, {busy.sum()} cells':<34}{'':12}{np.sqrt(np.mean(spread[busy] ** 2)):11.4g}"
          f"{np.sqrt(np.mean(error[busy] ** 2)):11.4g}{ratio:8.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
