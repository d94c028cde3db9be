"""Are the standard errors of `drift budget` right? One case with 40 seeds: their mean against the
spread.

A spread of n values of a normal law errs by 1 / sqrt(2 (n - 1)) of itself: a ratio within two of
these of 1 is right.

    python benchmarks/budget_errors.py [SEEDS]
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import smallest

import drift

CASE = """
title = "what drives it"
start = "2026-11-21T00:00Z"
duration = "12 h"
coast.source = "none"
clock.step = "15 min"
output.areas = [50, 95]
[[current]]
constant = { speed = "0.6 kn", toward = 70 }
[[wind]]
constant = { speed = "14 kn", from = 250 }
[uncertainty]
current = { std = "0.2 m/s", time = "6 h" }
wind = "none"
[[scenario]]
name = "last call"
object = "PIW-1"
position = { at = "27 30N 088 00W", std = "3 nmi" }
"""


def main() -> None:
    """Print a row for each source, area and figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("seeds", nargs="?", type=int, default=40)
    parser.add_argument("--particles", type=int, default=10_000)
    asked = smallest.parse(parser, seeds=2, particles=4000)
    path = Path(tempfile.mkdtemp()) / "budget.toml"
    path.write_text(CASE)
    case = drift.load(path)
    found = [
        drift.budget(drift.vary(case, {"seed": seed}), particles=asked.particles)
        for seed in range(asked.seeds)
    ]
    wide = 2 / np.sqrt(2 * (asked.seeds - 1))
    print(f"{'source, area, figure':<40}{'mean':>10}{'spread':>10}{'error':>10}{'ratio':>8}   "
          f"of {asked.seeds} seeds, right within 1 +- {wide:.2f}")  # fmt: skip
    for k, source in enumerate(found[0].sources):
        for s, share in enumerate(found[0].shares):
            for figure in ("share", "without"):
                estimates = [getattr(one, figure) for one in found]
                values = np.array([one.value[k, -1, s] for one in estimates])
                errors = np.array([one.error[k, -1, s] for one in estimates])
                spread, error = values.std(ddof=1), float(np.sqrt(np.mean(errors**2)))
                row = f"{values.mean():10.4f}{spread:10.5f}{error:10.5f}{error / spread:8.2f}"
                print(f"{f'{source.name}, {100 * share:g} %, {figure}':<40}{row}")


if __name__ == "__main__":
    main()
