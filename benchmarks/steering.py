"""What does steering cost, and what does resampling do for paths that wander? One table each; by
the clock, on a machine at rest.

    python benchmarks/steering.py [--only filter,roughening,laws] [--particles 1e6] [--threads 2]

`filter`: 20,000 paths of a Brownian bridge, 500 steps, three looks: seconds of motion and filter,
once compiled (aim: under 1 s; Nunez, Singham and Atkinson 2020 took 10 s to minutes in MATLAB).
`roughening`: three sharp looks, how many paths are left without it, and how many different ones
after it (section 3.4 there; aims: under 5 %, and all). `laws`: nanoseconds a particle and step of
each law of motion: the difference between a run of many steps and one of few, so that beginnings
and ends do not count. Steps are an hour of the run's. 300 scenarios beside one:
benchmarks/scenarios.py --only steer.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import smallest

import drift
from drift.pipeline.result import Result

PATHS, STEPS = (4_000, 100) if smallest.ASKED else (20_000, 500)
FEW, MANY = 4, 24  # steps of the runs whose difference is told

HEAD = """
title = "steering"
start = "2026-03-05T00:00Z"
duration = "{hours} h"
particles = {particles}
seed = {seed}
clock.step = "{minutes} min"
coast.source = "none"
uncertainty = "none"
output.times = ["+{hours} h"]
output.trajectories = {tracks}
"""
STORY = '[[scenario]]\nname = "target"\n'
BRIDGE = """
[[scenario.phase]]
[scenario.phase.bridge]
k = "12 nmi/sqrt(h)"
points = [{ at = [-95.5, 1.7], std = "20 nmi", time = "+0 h" }, { at = [-101.0, 13.0], std = "20 nmi", time = "+120 h" }]
"""
LOOKS = "".join(
    f'[[look]]\nname = "look {hour}"\ntime = "+{hour} h"\nat = [{lon}, {lat}]\nradius = "{radius} nmi"\nsees = "something"\n'
    for hour, lon, lat, radius in ((20, -96.1, 3.8, 30), (50, -97.6, 6.6, 30), (80, -99.4, 9.0, 30))
)
NETWORK = """
[[node]]
name = "a"
at = [-100, 0]
[[node]]
name = "b"
at = [-98, 1]
[[node]]
name = "c"
at = [-90, -1]
[[lane]]
through = ["a", "b", "c"]
width = "12 nmi"
"""
SPEED = 'speed = { low = "4 kn", best = "7 kn", high = "13 kn", ratio = 4 }'
AT = 'position = { at = [-100, 0], std = "10 nmi" }\n'
LAWS = {  # of a scenario: its keys, and its phase
    "drift": (AT + 'object = "PIW-1"\n', ""),
    "course": (AT, f"course = {{ course = [20, 340], {SPEED} }}"),
    "course with changes": (AT, f'course = {{ course = [20, 340], {SPEED}, change = "3 h" }}'),
    "track": (
        "",
        'track = { points = [{ at = [-100, 0], std = "9 nmi", after = "0 h" }, { at = [-99, 0.5], radius = "9 nmi", after = ["9 h", "12 h"] }, '
        '{ at = [-97, 0], std = "9 nmi", after = ["30 h", "40 h"] }] }',
    ),
    "lanes": ("", f'lanes = {{ network = "network.toml", route = ["a", "b", "c"], {SPEED} }}'),
    "voyage": (
        "",
        f'voyage = {{ waypoints = [[-100, 0], [-98, 1], [-90, -1]], cross_track = "3 nmi", {SPEED} }}',
    ),
    "loiter": (
        "area = { polygon = [[-101, -1], [-99, -1.2], [-98.8, 1], [-101, 0.8]] }\n",
        f'loiter = {{ polygon = [[-101, -1], [-99, -1.2], [-98.8, 1], [-101, 0.8]], {SPEED}, leg = "12 nmi" }}',
    ),
    "bridge": (
        "",
        'bridge = { k = "5 nmi/sqrt(h)", points = [{ at = [-100, 0], std = "9 nmi", time = "+0 h" }, { at = [-96, 1], std = "9 nmi", time = "+30 h" }] }',
    ),
}


class Runs:
    """Runs of cases in one process, so that kernels are compiled once."""

    def __init__(self, folder: Path, threads: int) -> None:
        """folder: for the cases."""
        self.folder, self.threads = folder, threads
        (folder / "network.toml").write_text(NETWORK)

    def run(self, text: str) -> tuple[Result, float]:
        """Return the result of a case, and the seconds of its motion and filter."""
        path = self.folder / "case.toml"
        path.write_text(text)
        result = drift.run(drift.load(path), threads=self.threads)
        return result, result.summary["wall_time_s"]["drift"]


def head(particles: int, hours: int, minutes: float = 60, seed: int = 1, tracks: int = 10) -> str:
    """Return the top of a case."""
    return HEAD.format(particles=particles, hours=hours, minutes=minutes, seed=seed, tracks=tracks)


def filtered(runs: Runs) -> None:
    """Tell what bridges and looks take."""
    text = head(PATHS, 100, 100 * 60 // STEPS) + STORY + BRIDGE
    print(f"{PATHS:,} paths of a bridge, {STEPS} steps: seconds of motion and filter")
    for name, more, top in (
        ("no look", "", ""),
        ("three looks", LOOKS, ""),
        ("three looks, resampling", LOOKS, "resampling.below = 0.5\n"),
    ):
        taken, used = [], []
        for _ in range(4):  # the first one compiles
            begun = time.process_time()
            taken.append(runs.run(top + text + more)[1])
            used.append(time.process_time() - begun)
        print(
            f"{name:26}{min(taken[1:]):8.3f}  (first {taken[0]:.2f}; processor, of the whole run, {min(used[1:]):.2f})"
        )


def roughened(runs: Runs) -> None:
    """Tell how many paths three sharp looks leave."""
    print(
        f"\nthree sharp looks, {PATHS:,} paths: share left, share of ancestors left, share of places that differ"
    )
    for name, top in (("without roughening", ""), ("resampling", "resampling.below = 0.99\n")):
        result, _ = runs.run(top + head(PATHS, 100, 12, tracks=PATHS) + STORY + BRIDGE + LOOKS)
        tracks, last = result.trajectories, result.updates.all[-1] if result.updates else None
        alive = tracks.weight[:, -1] > 0
        places = np.unique(np.stack([tracks.lon[alive, -1], tracks.lat[alive, -1]]), axis=1).shape[
            1
        ]
        ancestors = last.distinct if last and top else alive.sum() / PATHS
        print(f"{name:26}{alive.sum() / PATHS:8.2%}{ancestors:10.2%}{places / PATHS:10.2%}")


def laws(runs: Runs, particles: int) -> None:
    """Tell what a step costs by each law."""
    print(f"\n{particles:,} particles, {runs.threads} threads: ns a particle and step of an hour")
    for name, (keys, phase) in LAWS.items():
        story = STORY + keys + (f"[[scenario.phase]]\n{phase}\n" if phase else "")
        if not phase:
            story = (
                '[[current]]\nconstant = { speed = "0.5 kn", toward = 60 }\n[[wind]]\nconstant = { speed = "10 kn", from = 200 }\n'
                + story
            )
        runs.run(head(1_000, FEW) + story)  # compiles
        took = [
            min(runs.run(head(particles, hours) + story)[1] for _ in range(2))
            for hours in (FEW, MANY)
        ]
        print(f"{name:26}{(took[1] - took[0]) / (MANY - FEW) / particles * 1e9:8.2f}", flush=True)


def main() -> None:
    """Run what is asked for and print it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="filter,roughening,laws")
    parser.add_argument("--particles", type=float, default=1e6)
    parser.add_argument("--threads", type=int, default=2)
    asked = smallest.parse(parser, particles=1000)
    with tempfile.TemporaryDirectory() as folder:
        runs = Runs(Path(folder), asked.threads)
        if "filter" in asked.only:
            filtered(runs)
        if "roughening" in asked.only:
            roughened(runs)
        if "laws" in asked.only:
            laws(runs, int(asked.particles))


if __name__ == "__main__":
    main()
