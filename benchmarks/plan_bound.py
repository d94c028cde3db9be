"""What plans find as a share of their bound, over random cases with motion; prints one table.

    python benchmarks/plan_bound.py [--cases 20] [--first 0] [--particles 40000] [--threads N]
    [--moving | --steered] [--file FILE] [--hand]

Objects: 1 to 4 normal clouds of 3 to 12 nmi, up to 40 nmi apart, drifting with up to 1.5 kn, the
speed of each particle off by up to 0.5 kn, 12 h. Units: 1 to 4, boats of 12 to 25 kn, helicopters
and aircraft of 70 to 180 kn, sweep widths of 0.3 to 2 nmi, 1.5 to 8 h of search, from bases up to
60 nmi away, ready within 3 h. Three in four cases sweep by inverse cube, one by any law.

--moving: whole cases (benchmarks/moving_cases.py), planned and executed as `drift plan` does. Their
effort is scaled so that the bound lies between 0.3 and 0.9: a bound near 1 cannot be beaten. A case
that the file (plan_moving.jsonl) holds already is not run again. --steered: the same for targets
that steer (benchmarks/steered_cases.py); --hand: with legs laid by hand alone, which takes a
fraction of the time.

Beside the plan, legs by hand are scored on the same particles (hand_patterns.py): patterns of the
manuals, and legs that chase the densest spot. plan_hand.py compares plans with them on others.
Exits 1 if anything finds more than the bound.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import hand_patterns
import numpy as np
import smallest
from moving_cases import case as moving
from moving_cases import scaled
from rich.console import Console
from rich.table import Table
from steered_cases import case as steered

from drift.case.record import Case
from drift.engine.motion.scenario import Survival
from drift.evidence.filter.records import Law, PlanSpec, Unit
from drift.pipeline.run_options import Options, open_job
from drift.planning.search import bins, bound, follow, optimiser, planner
from drift.planning.search import planning_tracks as record
from drift.planning.search.planning_tracks import Tracks
from geo import sphere
from geo.errors import UserError
from kernels.runtime import runtime

NMI, HOUR = 1852.0, 3600.0
BEGIN = np.datetime64("2026-06-20T06:00:00", "s")
BINS = 24
MANNERS = (*hand_patterns.DRAWN, *hand_patterns.CHASED)
FEW = 2500  # particles on which effort is aimed
LEAST, MOST = 1e-3, 1e2  # that it is scaled by
HALVINGS = 2 if smallest.ASKED else 6
COARSE = 1800.0  # [s] rows of a bound in the smallest mode


def case(number: int, particles: int) -> tuple[Tracks, list[Unit], PlanSpec]:
    """Return a random case."""
    rng = np.random.Generator(np.random.Philox(key=number))
    clouds = int(rng.integers(1, 5))
    share = rng.dirichlet(np.full(clouds, 2.0))
    of = rng.choice(clouds, particles, p=share)
    centre, spread = rng.uniform(-20, 20, (clouds, 2)), rng.uniform(3, 12, (clouds, 2))
    turn, drift, off = (
        rng.uniform(0, np.pi, clouds),
        rng.uniform(-1, 1, (clouds, 2)),
        rng.uniform(0, 0.5, clouds),
    )
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
    return tracks, units_of(rng, number), PlanSpec(BEGIN, BEGIN + np.timedelta64(12, "h"))


def units_of(rng: np.random.Generator, number: int) -> list[Unit]:
    """Return random units; every fourth case has any laws."""
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
    return units


def by_hand(
    tracks: Tracks,
    units: Sequence[Unit],
    spec: PlanSpec,
    manner: str,
    survival: Sequence[Survival | None],
) -> float:
    """Return what units find in one sortie laid out by hand, on the particles that it is laid out
    on.
    """
    flights = hand_patterns.fly(tracks, units, spec, manner)
    return float(tracks.weight @ hand_patterns.find(flights, tracks, units, spec, survival))


def aimed(case: Case, tracks: Tracks, goal: float) -> Case:
    """Return a case whose units' effort is scaled so that the bound on few of its particles is
    about as large as told.
    """
    few = record.sample(tracks, min(tracks.m, FEW))
    low, high = LEAST, MOST
    survival = [scenario.survival for scenario in case.scenarios]
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        units = [
            replace(unit, endurance=unit.endurance * case.plan.rounds)
            for unit in scaled(case.units, middle)
        ]
        if bound.bound(few, units, case.plan, survival).value > goal:
            high = middle
        else:
            low = middle
    return replace(case, units=scaled(case.units, np.sqrt(low * high)))


def move(number: int, options: argparse.Namespace) -> dict[str, object]:
    """Return what a random case that moves comes to: planned, executed, bounded, searched by hand."""
    made, data, told, goal = (steered if options.steered else moving)(number, options.particles)
    job = open_job(
        made, Options(datasets={} if data is None else {"field": data}, threads=options.threads)
    )
    tracks = follow.follow(made, job.where)
    made = aimed(made, tracks, goal)
    survival = [scenario.survival for scenario in made.scenarios]
    begun = time.perf_counter()
    several = [replace(unit, endurance=unit.endurance * made.plan.rounds) for unit in made.units]
    reckoned = bound.bound(tracks, several, made.plan, survival)
    limit = reckoned.value
    middle = time.perf_counter()
    hands = {manner: by_hand(tracks, made.units, made.plan, manner, survival) for manner in MANNERS}
    one = {"case": number, "told": told, "limit": limit, "hands": hands, "bound_s": middle - begun}
    if options.hand:
        best, words = max(hands.values()), reckoned.none
        return one | {"seen": best, "executed": 0.0, "error": 0.0, "silent": words, "plan_s": 0.0}
    plan, _, _ = planner.scheme(replace(job, case=made))
    return one | {
        "seen": plan.seen, "executed": plan.value, "error": plan.bound_error, "silent": plan.unbounded,
        "plan_s": time.perf_counter() - middle,
    }  # fmt: skip


def beaten(one: dict[str, Any]) -> list[str]:
    """Return what finds more than the bound: on the same particles, or by two standard errors on
    others.
    """
    over = [
        name
        for name, value in {**one["hands"], "the plan": one["seen"]}.items()
        if value > one["limit"]
    ]
    return over + ["the plan executed"] * (one["executed"] > one["limit"] + 2 * one["error"])


def resumed(
    compute: Callable[[int, argparse.Namespace], dict[str, Any]], options: argparse.Namespace
) -> list[dict[str, Any]]:
    """Return the results that the file holds, after computing those of options that it lacks and
    appending them to it.
    """
    path = Path(options.file)
    done = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    known = {one["case"] for one in done}
    for number in range(options.first, options.first + options.cases):
        if number in known:
            continue
        try:
            one = compute(number, options)
        except UserError as error:  # no unit can search, or nothing is left to be found
            one = {"case": number, "refused": str(error)}
        done.append(one)
        with path.open("a") as file:
            file.write(json.dumps(one) + "\n")
        print(one, flush=True)
    return done


def moved(options: argparse.Namespace) -> int:
    """Try cases that move and that the file does not hold yet; print what all in it come to; return
    how many bounds were beaten.
    """
    options.file = (
        options.file
        or f"plan_{'steered' if options.steered else 'moving'}{'_hand' * options.hand}.jsonl"
    )
    done = resumed(move, options)
    ran = sorted((one for one in done if "limit" in one), key=lambda one: int(one["case"]))
    if not ran:
        print(f"none ran, {len(done)} refused")
        return 1
    table = Table(
        "case", "what", "bound", "seen", "executed", *MANNERS, "beaten by", "plan s", "bound s"
    )
    for one in ran:
        table.add_row(
            str(one["case"]), one["told"], f"{one['limit']:.3f}", f"{one['seen']:.3f}", f"{one['executed']:.3f}",
            *(f"{one['hands'][manner]:.3f}" for manner in MANNERS), ", ".join(beaten(one)) or one["silent"],
            f"{one['plan_s']:.0f}", f"{one['bound_s']:.1f}",
        )  # fmt: skip
    console = Console(width=200)
    console.print(table)
    limits = np.array([one["limit"] for one in ran])
    shares = np.array([one["seen"] for one in ran]) / limits
    by_hands = sum(max(one["hands"].values()) > one["seen"] for one in ran)
    over = sum(bool(beaten(one)) for one in ran)
    console.print(
        f"{len(ran)} ran, {len(done) - len(ran)} refused; bound: {np.min(limits):.2f} to {np.max(limits):.2f}, {np.sum(limits > bound.NEARLY)} above {bound.NEARLY}; "
        f"plan as a share of it: median {np.median(shares):.3f}, worst {np.min(shares):.3f}; no figure given: {sum(bool(one['silent']) for one in ran)}; "
        f"legs by hand find more than the plan: {by_hands}; bounds beaten: {over}"
    )
    return over


def main() -> None:
    """Plan, bound, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--particles", type=int, default=40_000)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--moving", action="store_true")
    parser.add_argument("--steered", action="store_true")
    parser.add_argument("--hand", action="store_true")
    parser.add_argument(
        "--file", help="of results; by default one for each kind of case, in this folder"
    )
    options = smallest.parse(parser, cases=1, particles=1000)
    runtime.start("cpu", options.threads)
    if smallest.ASKED:
        bins.FINEST = COARSE
        with tempfile.TemporaryDirectory() as folder:
            kinds = ({"moving": True, "hand": True}, {"steered": True})
            over = [moved(small(options, folder, **kind)) for kind in kinds]
        sys.exit(max(*over, still(options)) > 0)
    if options.moving or options.steered:
        sys.exit(moved(options) > 0)
    sys.exit(still(options) > 0)


def small(options: argparse.Namespace, folder: str, **kind: bool) -> argparse.Namespace:
    """Return options for another kind of case, with its file in a folder."""
    return argparse.Namespace(
        **vars(options) | kind | {"file": str(Path(folder) / f"{min(kind)}.jsonl")}
    )


def still(options: argparse.Namespace) -> int:
    """Try cases of which all particles are given; print what they come to; return how many bounds
    were beaten.
    """
    table = Table("case", "units", "hours", "POS", "bound", "share", *MANNERS, "plan s", "bound s")
    shares, over = [], 0
    for number in range(options.first, options.first + options.cases):
        tracks, units, spec = case(number, options.particles)
        clock = time.perf_counter()
        limit = bound.bound(tracks, units, spec, [None])
        middle = time.perf_counter()
        made = optimiser.plan(tracks, units, spec, number, [None])
        end = time.perf_counter()
        hands = [by_hand(tracks, units, spec, manner, [None]) for manner in MANNERS]
        shares.append(made.seen / limit.value)
        over += max(made.seen, *hands) > limit.value
        row = (
            str(number), str(len(units)), f"{(tracks.time[-1] - tracks.time[0]) / HOUR:.0f}", f"{made.seen:.4f}", f"{limit.value:.4f}", f"{shares[-1]:.3f}",
            *(f"{hand:.4f}" for hand in hands), f"{end - middle:.1f}", f"{middle - clock:.1f}",
        )  # fmt: skip
        table.add_row(*row)
        print(*row, flush=True)
    console = Console(width=140)
    console.print(table)
    console.print(
        f"share of the bound: median {np.median(shares):.3f}, worst {min(shares):.3f}; above the bound: {over}"
    )
    return over


if __name__ == "__main__":
    main()
