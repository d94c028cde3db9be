"""The table of speeds in docs/performance.md, from the files in benchmarks/figures.

    python docs/generate/figures.py

Each file there is what a benchmark wrote with `--json`. After a new one run this: it writes the
table between the marks in the page. A test holds the two equal.
"""

import json
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "performance.md"
FILES = ("throughput", "sweep_cost", "cold_start", "plan_time", "many")
BEGIN, END = "<!-- figures: begin -->\n", "<!-- figures: end -->\n"


def measured(name: str) -> dict[str, Any]:
    """Return what a benchmark wrote."""
    text = (ROOT / "benchmarks" / "figures" / f"{name}.json").read_text(encoding="utf-8")
    held: dict[str, Any] = json.loads(text)
    return held


def table() -> str:
    """Return the table in Markdown, with the machines above it."""
    parts = [*_steps(), *_runs(), *_forecasts()]
    machines = {
        f"{held['cores']} cores of {held['machine']}" for held in map(measured, sorted(FILES))
    }
    head = f"On {' and '.join(sorted(machines))}:\n\n| what | measured | command |\n|---|---|---|\n"
    return head + "".join(f"| {' | '.join(row)} |\n" for row in parts)


def page() -> str:
    """Return docs/performance.md with the newest table."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    return before + BEGIN + table() + END + rest.partition(END)[2]


def _steps() -> list[tuple[str, str, str]]:
    """Return the rows on a step of particles."""
    command = "`python benchmarks/throughput.py --yardsticks FOLDER`"
    held = measured("throughput")
    ns = {row["case"].strip(): row["1e+06"] for row in held["ns_per_particle_step"]}
    plain = ns["RK4 current, wind, leeway (the yardstick's work)"]
    full = ns["+ both, coast (open sea)"]
    bare = min(held["limit"])
    sweep = measured("sweep_cost")["ns_per_particle_and_leg"]
    return [
        (
            "a particle and step: RK4 through current and wind, with leeway",
            f"{plain:.0f} ns",
            command,
        ),
        ("the same with errors, diffusion and the coast", f"{full:.0f} ns", command),
        (
            "a bare C kernel that does the work of the first row, in the same run",
            f"{bare:.0f} ns",
            command,
        ),
        (
            "the first two rows relative to that C kernel",
            f"{plain / bare:.2f} and {full / bare:.2f}",
            command,
        ),
        (
            "memory of a particle on the device",
            f"{held['bytes_per_particle']} bytes",
            command,
        ),
        (
            "a sortie, by particle and leg",
            f"{sweep['inverse cube']:.1f} ns",
            "`python benchmarks/sweep_cost.py`",
        ),
    ]


def _runs() -> list[tuple[str, str, str]]:
    """Return the rows on whole runs."""
    held, plan = measured("cold_start"), measured("plan_time")
    warm, cold = (held[name]["whole"] for name in ("full_caches", "empty_caches"))
    planning = plan["phases_s"]["plan"]
    cold_start = "`python benchmarks/cold_start.py`"
    return [
        ("the default case with its six sorties, all files", f"{warm:.0f} s", cold_start),
        ("the same on its very first run, with empty caches", f"{cold:.0f} s", cold_start),
        (
            f"a plan for four units, 12 h and {plan['particles']:,} particles",
            f"{plan['wall_s']:.0f} s, of which {planning:.0f} s are planning",
            "`python benchmarks/plan_time.py`",
        ),
    ]


def _forecasts() -> list[tuple[str, str, str]]:
    """Return the rows on many small forecasts."""
    held = measured("many")
    kinds = [
        held["forecasts"][name]
        for name in (
            "open sea, no coast: run_many, no map",
            "open sea, no coast: run_many, one map",
            "Norwegian coast: run_many, one map",
        )
    ]
    speeds = [f"{kind['a_second']:.0f}" for kind in kinds]
    costs = [f"{kind['processor_ms']:.0f}" for kind in kinds]
    command = "`python benchmarks/many.py`"
    return [
        (
            f"forecasts a second of {held['particles']:,} particles over 24 h by `drift.run_many`",
            f"{speeds[0]} without maps; {speeds[1]} with a map in the open sea; {speeds[2]} with a map along the Norwegian coast",
            command,
        ),
        (
            "processor time of one of these forecasts, on all cores together",
            f"{costs[0]}, {costs[1]} and {costs[2]} ms",
            command,
        ),
    ]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
