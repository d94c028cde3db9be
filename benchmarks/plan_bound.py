"""What plans find as a share of the bound that no plan exceeds, over random cases with motion; prints one table.

    python benchmarks/plan_bound.py [--cases 20] [--first 0] [--particles 40000] [--threads N]

Objects: 1 to 4 normal clouds of 3 to 12 nmi, up to 40 nmi apart, drifting with up to 1.5 kn, the speed of each particle off by up to
0.5 kn, 12 h. Units: 1 to 4, boats of 12 to 25 kn, helicopters and aircraft of 70 to 180 kn, sweep widths of 0.3 to 2 nmi, 1.5 to 8 h of search, from bases up to
60 nmi away, ready within 3 h. Three in four cases sweep by inverse cube, one by any law.
"""

import argparse
import time

import numpy as np
from rich.console import Console
from rich.table import Table

from drift import bound, optimise
from drift.sortie import Law, PlanSpec, Unit
from drift.tracks import Tracks
from geo import sphere
from kernels import runtime

NMI, HOUR = 1852.0, 3600.0
BEGIN = np.datetime64("2026-06-20T06:00:00", "s")
BINS = 24


def case(number: int, particles: int) -> tuple[Tracks, list[Unit], PlanSpec]:
    """Return a random case."""
    rng = np.random.Generator(np.random.Philox(key=number))
    clouds = int(rng.integers(1, 5))
    share = rng.dirichlet(np.full(clouds, 2.0))
    of = rng.choice(clouds, particles, p=share)
    centre, spread = rng.uniform(-20, 20, (clouds, 2)), rng.uniform(3, 12, (clouds, 2))
    turn, drift, off = rng.uniform(0, np.pi, clouds), rng.uniform(-1, 1, (clouds, 2)), rng.uniform(0, 0.5, clouds)
    a = rng.standard_normal((particles, 2)) * spread[of]
    c, s = np.cos(turn[of]), np.sin(turn[of])
    place = centre[of] + np.stack([a[:, 0] * c - a[:, 1] * s, a[:, 0] * s + a[:, 1] * c], axis=1)
    speed = drift[of] + rng.standard_normal((particles, 2)) * off[of, None]
    hours = np.arange(BINS + 1) * 12 / BINS
    at = (place + hours[:, None, None] * speed) * NMI
    lon, lat = sphere.destination(np.radians(3.0), np.radians(58.0), at[..., 0], at[..., 1])
    begin = float(BEGIN.astype(np.int64))
    tracks = Tracks(
        time=begin + hours * HOUR,
        lon=sphere.to_binary(np.degrees(lon)),
        lat=sphere.to_binary(np.degrees(lat)),
        adrift=np.ones(lon.shape, bool),
        weight=np.full(particles, 1 / particles),
        scenario=np.zeros(particles, np.int32),
        release=np.full(particles, begin),
    )
    any_law = number % 4 == 3
    laws = [Law(), Law("random"), Law("definite_range"), Law("m_beta", beta=0.8)]
    units = []
    for u in range(int(rng.integers(1, 5))):
        boat = rng.random() < 0.4
        knots = rng.uniform(12, 25) if boat else rng.uniform(70, 180)
        east, north = rng.uniform(-60, 60, 2) * NMI * (0.4 if boat else 1.0)
        lon, lat = sphere.destination(np.radians(3.0), np.radians(58.0), east, north)
        base = (float(np.degrees(lon)), float(np.degrees(lat)))
        units.append(
            Unit(
                name=f"unit {u}",
                kind="Boat" if boat else "Aircraft",
                base=base,
                return_to=base,
                ready=BEGIN + np.timedelta64(int(rng.uniform(0, 3) * HOUR), "s"),
                search_speed=knots * NMI / HOUR,
                transit_speed=1.3 * knots * NMI / HOUR,
                endurance=float(rng.uniform(4, 8) if boat else rng.uniform(1.5, 5)) * HOUR / 0.85,
                law=laws[int(rng.integers(4))] if any_law else laws[0],
                sweep_width=(float(rng.uniform(0.3, 2.0)) * NMI,),
                daylight=False,
            )
        )
    return tracks, units, PlanSpec(BEGIN, BEGIN + np.timedelta64(12, "h"))


def main() -> None:
    """Plan, bound, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--particles", type=int, default=40_000)
    parser.add_argument("--threads", type=int)
    options = parser.parse_args()
    runtime.start("cpu", options.threads)
    table = Table(
        "case", "units", "POS", "bound", "moved", "share", "against alone", "against by hand", "plan s", "bound s"
    )
    shares = []
    for number in range(options.first, options.first + options.cases):
        tracks, units, spec = case(number, options.particles)
        clock = time.perf_counter()
        limit = bound.bound(tracks, units, spec, [None])
        middle = time.perf_counter()
        made = optimise.plan(tracks, units, spec, number, [None])
        end = time.perf_counter()
        shares.append(made.seen / limit.value)
        table.add_row(
            str(number), str(len(units)), f"{made.seen:.4f}", f"{limit.value:.4f}", f"{limit.moved:.4f}", f"{shares[-1]:.3f}",
            *[""] * (2 - len(made.alternatives)), *(f"{a.difference:+.4f}" for a in made.alternatives), f"{end - middle:.1f}", f"{middle - clock:.1f}",
        )  # fmt: skip
        print(number, len(units), f"{shares[-1]:.3f}", flush=True)
    console = Console(width=140)
    console.print(table)
    console.print(f"share of the bound: median {np.median(shares):.3f}, worst {min(shares):.3f}")


if __name__ == "__main__":
    main()
