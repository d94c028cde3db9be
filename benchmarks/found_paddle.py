"""A found paddle that would leave 21 of 50,000 particles, guided and by brute force; prints one
table.

    python benchmarks/found_paddle.py [--pairs 10000000] [--particles 50000] [--seed 1] [--threads
    N] [--open] [--keep brute.npz]

The case is the kayaker off Portsall of ../shared/data/faults/kayak.toml without its sorties and its
belief: errors of the current of 0.3 m/s over 6 h, a paddle found after 22 h and known to 0.2 nmi.
The brute force (tests/oracles/second_opinions/finds.py) moves as many pairs of object and paddle as are asked for
in float64 NumPy, with GSHHG in shapely's tree, and shares no code with the program. Compared are
the evidence of each scenario, its probability, and the mean and covariance of where the object is:
in standard errors of their difference. Exits 1 where one is beyond 4, or where fewer than 5 % of
the particles are effective.

--open: without a coast. --keep: a file that takes what the brute force has found, and goes on from
it. 10,000,000 pairs take some 10 minutes on one core.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import smallest
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "oracles" / "second_opinions"))

import finds
import oracle

import drift

CASE = Path(__file__).with_suffix(".toml")
NAMES = {"on his kayak": ("PERSON-POWERED-VESSEL-1", 0.6), "in the water": ("PIW-1", 0.4)}
START = np.datetime64("2026-11-24T16:50")
CURRENT = [  # day and hour UTC, knots, toward
    ("24T16:00", 0.1, 60), ("24T19:00", 2.0, 60), ("24T22:00", 0.1, 60), ("25T01:00", 2.2, 240), ("25T04:00", 0.1, 240),
    ("25T07:15", 2.0, 60), ("25T10:30", 0.1, 60), ("25T13:30", 2.2, 240), ("25T16:30", 0.1, 240),
]  # fmt: skip
WIND = [("24T16:00", 14, 220), ("25T06:00", 20, 240), ("25T18:00", 18, 280)]  # from
FOUND = np.datetime64("2026-11-25T15:00")
BATCH = 100_000


def flow(rows, turned):
    """Return a flow of rows (time, speed [kn], direction) after the start."""
    found = []
    for when, speed, direction in rows:
        seconds = (np.datetime64(f"2026-11-{when}") - START) / np.timedelta64(1, "s")
        angle = np.radians(direction + turned)
        found.append(
            (
                float(seconds),
                speed * oracle.KNOT * np.sin(angle),
                speed * oracle.KNOT * np.cos(angle),
            )
        )
    return finds.interpolated(found)


def setup(coastal):
    """Return what the pairs go through."""
    half = np.sqrt(2 * np.log(2))  # of a radius that holds half
    return finds.Setup(
        -(4 + 44 / 60), 48 + 36 / 60, oracle.NMI / half, -(4 + 35 / 60), 48 + 39 / 60, 0.2 * oracle.NMI / half,
        float((FOUND - START) / np.timedelta64(1, "s")), flow(CURRENT, 0), flow(WIND, 180),
        (0.3, 6 * 3600.0), (2.0, 12 * 3600.0), (0.015, 0.005),
        oracle.gshhg(-7, 47, -2, 50) if coastal else None,
    )  # fmt: skip


def brute(pairs, coastal, keep, seed):
    """Return sums of so many pairs, from a file as far as that goes."""
    sums, held = finds.Sums(), {}
    if keep and keep.exists():
        held = dict(np.load(keep))
        sums.pairs, sums.weight, sums.places = (
            int(held["pairs"]),
            [held["weight"]],
            [held["places"]],
        )
    own, rows = setup(coastal), [leeway(kind) for kind, _ in NAMES.values()]
    for first in range(int(held.get("done", 0)), pairs, BATCH):
        rng = np.random.default_rng([seed, first])
        finds.add_pairs(sums, rng, min(BATCH, pairs - first), own, rows)
        sums.weight, sums.places = (
            [np.concatenate(sums.weight)],
            [np.concatenate(sums.places, axis=2)],
        )
        if keep:
            np.savez(
                keep,
                done=min(first + BATCH, pairs),
                pairs=sums.pairs,
                weight=sums.weight[0],
                places=sums.places[0],
            )
    return sums


def leeway(kind):
    """Return a row of the published table."""
    import csv

    path = Path(__file__).parents[1] / "drift" / "data" / "leeway.csv"
    rows = csv.DictReader(
        line for line in path.read_text().splitlines() if not line.startswith("#")
    )
    row = next(row for row in rows if row["name"] == kind)
    return {
        key: float(value)
        for key, value in row.items()
        if key.split("_")[0] in ("down", "right", "left")
    }


def ours(particles, seed, coastal, threads):
    """Return a run of the case, and the seconds that it took."""
    begin = time.perf_counter()
    text = CASE.read_text().replace("particles = 50_000", f"particles = {particles}\nseed = {seed}")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.toml"
        path.write_text(text + ("" if coastal else '\n[coast]\nsource = "none"\n'))
        case = drift.load(path)
        (brief,) = drift.run_many([case], threads=threads)
        result = drift.run(case, threads=threads)
    return brief, result.updates, time.perf_counter() - begin


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--pairs", type=int, default=10_000_000)
    parser.add_argument("--particles", type=int, default=50_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--open", action="store_true")
    parser.add_argument("--keep", type=Path)
    asked = smallest.parse(parser, pairs=20_000, particles=2000, open=True)
    brief, updates, seconds = ours(asked.particles, asked.seed, not asked.open, asked.threads)
    if brief.error:
        raise brief.error
    begin = time.perf_counter()
    sums = brute(asked.pairs, not asked.open, asked.keep, 7)
    taken = time.perf_counter() - begin
    counts = [round(float(w) * asked.particles) for _, w in NAMES.values()]
    bounds = np.cumsum([0, *counts])
    rows, worst = [], 0.0
    evidences = []
    for number, (name, (_, weight)) in enumerate(NAMES.items()):
        own = slice(bounds[number], bounds[number + 1])
        exact = finds.told(sums.weight[0], *sums.places[0][number], sums.pairs)
        mine = finds.told(
            brief.probability[-1, own],
            brief.lon[-1, own],
            brief.lat[-1, own],
            bounds[number + 1] - bounds[number],
        )
        evidences.append((weight * exact.evidence, weight * exact.evidence_error, mine.effective))
        unit = np.array([np.cos(exact.mean[1] * oracle.DEG), 1.0]) * oracle.DEG * oracle.R
        apart = (mine.mean - exact.mean) * unit
        for what, a, b, error in [
            ("mean east [m]", 0.0, apart[0], np.hypot(exact.mean_error[0], mine.mean_error[0])),
            ("mean north [m]", 0.0, apart[1], np.hypot(exact.mean_error[1], mine.mean_error[1])),
            *(
                (f"covariance {i}{j} [km2]", exact.covariance[i, j] / 1e6, mine.covariance[i, j] / 1e6,
                 np.hypot(exact.covariance_error[i, j], mine.covariance_error[i, j]) / 1e6)
                for i, j in ((0, 0), (0, 1), (1, 1))
            ),
            (
                "log evidence [1/m2]", np.log(exact.evidence), float(updates.all[-1].log_evidence[number]),
                np.hypot(exact.evidence_error / exact.evidence, 1 / np.sqrt(mine.effective)),
            ),
        ]:  # fmt: skip
            rows.append((name, what, a, b, error, exact.effective, mine.effective))
    total = sum(e for e, _, _ in evidences)
    share = evidences[0][0] / total
    error = share * (1 - share) * np.hypot(
        *(np.hypot(s / e, 1 / np.sqrt(m)) for e, s, m in evidences)
    )  # fmt: skip
    update = updates.all[-1]
    rows.append(
        (
            "all",
            f'probability of "{next(iter(NAMES))}"',
            share,
            update.posterior[0],
            error,
            np.nan,
            update.ess_after,
        )
    )
    table = Table(
        title=f"{asked.particles:,} particles ({seconds:.0f} s), {asked.pairs:,} pairs ({taken:.0f} s)"
    )
    for column in (
        "scenario",
        "what",
        "brute force",
        "guided",
        "standard errors",
        "effective, brute force",
        "effective, guided",
    ):
        table.add_column(column)
    for name, what, a, b, error, left, right in rows:
        off = (b - a) / error
        worst = max(worst, abs(off))
        table.add_row(
            name, what, f"{a:.5g}", f"{b:.5g}", f"{off:+.2f}", f"{left:.0f}", f"{right:.0f}"
        )
    Console(width=140).print(table)
    few = update.ess_after < 0.05 * asked.particles
    return int(worst > 4 or few)


if __name__ == "__main__":
    sys.exit(main())
