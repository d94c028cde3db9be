"""Plans against what a planner would draw by hand, on particles that neither has seen; prints one
table.

    python benchmarks/plan_hand.py [--set moving | steered | normal] [--cases 20] [--first 0]
    [--particles 8000] [--threads N] [--file FILE]

Cases are those of moving_cases.py, steered_cases.py and plan_bound.py (normal), with the effort
that plan_bound.py gives them. Half of the particles are those on which the plan of one round is
made and on which legs are laid out by hand (hand_patterns.py): expanding square, sector, parallel
track, creeping line, in the best of a few sizes, on the ground or drifting, and legs that chase the
densest spot. Both are scored on the other half. Legs by hand keep units apart as plans do. A plan
is beaten where any of them finds more by two standard errors of the paired difference. Exits 1 if
one is.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from typing import Any

import hand_patterns
import numpy as np
import plan_bound
import smallest
from moving_cases import case as moving
from rich.console import Console
from rich.table import Table
from steered_cases import case as steered

from drift.engine.motion.scenario import Survival
from drift.evidence.filter.records import PlanSpec, Unit
from drift.pipeline.run_options import Options, open_job
from drift.planning.search import bins, follow, joint, optimiser, rectangle
from drift.planning.search import planning_tracks as record
from drift.planning.search.boats import availability
from drift.planning.search.optimiser import Proposal
from drift.planning.search.planning_tracks import Tracks
from geo import notation
from kernels.planning import rectangles, sweeps
from kernels.runtime import runtime

MANNERS = (*hand_patterns.DRAWN, *hand_patterns.CHASED)
# [s] rows of a bound by which the effort of a steered case is scaled; it takes minutes with finer
# ones
ROWS = 900.0
FEW = 1000  # particles for that
SETS = ("moving", "steered", "normal")


def found(
    made: Proposal,
    tracks: Tracks,
    units: Sequence[Unit],
    spec: PlanSpec,
    survival: Sequence[Survival | None],
) -> np.ndarray:
    """Return what a plan's sorties find of each particle of tracks (m,)."""
    plane = record.plane(tracks)
    swarm = optimiser.swarm_of(tracks, spec, survival, plane)
    factor, weights = joint.nodes(units)
    zero, finds = float(tracks.time[0]), []
    for task in made.taskings:
        u = [unit.name for unit in units].index(task.unit.name)
        can = availability.of_unit(task.unit, spec, (plane.lon, plane.lat))
        crew, sortie = rectangle.crew(task.unit, can, plane, zero, factor[u]), task.sortie
        start, end = (float(notation.epoch(time)) - zero for time in (sortie.start, sortie.end))
        if sortie.legs is not None:
            x, y = plane.flat(*np.radians([sortie.legs.lon, sortie.legs.lat]))
            nodes = np.column_stack([np.array(sortie.legs.time) - zero, x, y, np.ones(len(x))])
            chance, worth = sweeps.found(swarm, crew.table, nodes, crew.width, crew.factor)
        else:
            east, north = plane.flat(*np.radians(task.centre))
            sin, cos = np.sin(task.orientation), np.cos(task.orientation)
            row = np.array(
                [
                    float(east),
                    float(north),
                    sin,
                    cos,
                    task.length,
                    task.width,
                    start,
                    end - start,
                    1.0,
                ]
            )
            coverage = np.array([sortie.coverage, sortie.coverage_under_way or sortie.coverage])
            chance, worth = rectangles.found(
                swarm, True, row, coverage, crew.factor, rectangle.STEP, crew.curve
            )
        finds.append(joint.Find((start + end) / 2, chance, worth))
    return joint.worth(finds, weights) if finds else np.zeros(tracks.m)


def prepared(
    number: int, options: argparse.Namespace
) -> tuple[Tracks, Sequence[Unit], PlanSpec, Sequence[Survival | None], str]:
    """Return the tracks, units and plan of a case, its survival times, and what it is like."""
    if options.set == "normal":
        tracks, units, spec = plan_bound.case(number, options.particles)
        return tracks, units, spec, [None], f"{len(units)} units"
    made, data, told, goal = (steered if options.set == "steered" else moving)(
        number, options.particles
    )
    job = open_job(
        made, Options(datasets={} if data is None else {"field": data}, threads=options.threads)
    )
    tracks = follow.follow(made, job.where)
    if options.set == "steered":
        bins.FINEST, plan_bound.FEW = ROWS, FEW
    made = plan_bound.aimed(made, tracks, goal)
    return tracks, made.units, made.plan, [scenario.survival for scenario in made.scenarios], told


def compare(number: int, options: argparse.Namespace) -> dict[str, Any]:
    """Return what a plan and legs by hand find of particles that neither has seen."""
    tracks, units, spec, survival, told = prepared(number, options)
    half = np.arange(tracks.m) % 2 == 0
    known, fresh = (
        record.take(tracks, np.flatnonzero(part), tracks.weight[part]) for part in (half, ~half)
    )
    begun = time.process_time()
    made = optimiser.plan(known, units, spec, number, survival)
    took = time.process_time() - begun
    gain = found(made, fresh, units, spec, survival)
    hands = {}
    for manner in MANNERS:
        flights = hand_patterns.fly(known, units, spec, manner)
        other = hand_patterns.find(flights, fresh, units, spec, survival)
        less = float(fresh.weight @ (gain - other))
        error = float(np.sqrt(fresh.weight**2 @ (gain - other - less) ** 2))
        hands[manner] = {"value": float(fresh.weight @ other), "less": less, "error": error}
    patterns = [task.manner.pattern + " drifting" * task.manner.moves for task in made.taskings]
    value = float(fresh.weight @ gain)
    return {
        "case": number,
        "told": told,
        "seen": made.seen,
        "value": value,
        "hands": hands,
        "patterns": patterns,
        "plan_s": took,
    }


def beaten(one: dict[str, Any]) -> list[str]:
    """Return the manners in which legs by hand find more than the plan, by two standard errors."""
    return [manner for manner, hand in one["hands"].items() if hand["less"] < -2 * hand["error"]]


def main() -> None:
    """Compare the cases of a set; in the smallest mode of every set."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--set", choices=SETS, default="moving")
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--particles", type=int, default=8000)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--file", help="of results; by default one for each set, in this folder")
    options = smallest.parse(parser, cases=1, particles=1000)
    runtime.start("cpu", options.threads)
    if smallest.ASKED:
        with tempfile.TemporaryDirectory() as folder:
            sets = [
                argparse.Namespace(**vars(options) | {"set": name, "file": f"{folder}/{name}"})
                for name in SETS
            ]
            sys.exit(max(map(told, sets)) > 0)
    sys.exit(told(options) > 0)


def told(options: argparse.Namespace) -> int:
    """Compare cases that the file does not hold yet; print what all in it come to; return how many
    plans were beaten.
    """
    options.file = options.file or f"plan_hand_{options.set}.jsonl"
    done = plan_bound.resumed(compare, options)
    ran = sorted((one for one in done if "hands" in one), key=lambda one: int(one["case"]))
    if not ran:
        print(f"none ran, {len(done)} refused")
        return 1
    table = Table("case", "what", "seen", "plan", *MANNERS, "flown", "beaten by", "plan s")
    for one in ran:
        hands = [f"{one['hands'][manner]['value']:.3f}" for manner in MANNERS]
        table.add_row(
            str(one["case"]), one["told"], f"{one['seen']:.3f}", f"{one['value']:.3f}", *hands, ", ".join(one["patterns"]),
            ", ".join(beaten(one)), f"{one['plan_s']:.0f}",
        )  # fmt: skip
    console = Console(width=220)
    console.print(table)
    over = sum(bool(beaten(one)) for one in ran)
    ratio = [
        max(hand["value"] for hand in one["hands"].values()) / max(one["value"], 1e-9)
        for one in ran
    ]
    console.print(
        f"{len(ran)} ran, {len(done) - len(ran)} refused; best legs by hand as a share of the plan: median {np.median(ratio):.3f}, most {max(ratio):.3f}; "
        f"plans beaten by two standard errors: {over}"
    )
    return over


if __name__ == "__main__":
    main()
