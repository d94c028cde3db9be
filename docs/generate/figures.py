"""The table of speeds in docs/performance.md and the history of them in docs/history.md, from the
files in benchmarks/figures.

    python docs/generate/figures.py

Each file there holds the runs of one benchmark, the newest last, as it writes them with `--json`.
After a new one run this: it writes the table between the marks in the first page, and the second
page. A test holds both equal to the files.
"""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "benchmarks" / "figures"
PAGE = ROOT / "docs" / "performance.md"
HISTORY = ROOT / "docs" / "history.md"
BEGIN, END = "<!-- figures: begin -->\n", "<!-- figures: end -->\n"
WORSE = 1.15  # a figure that is marked, relative to that of the run before

Run = dict[str, Any]
INTRODUCTION = f"""# Performance over time

Each table holds the runs of one benchmark, the newest last. A figure in bold is at least {WORSE - 1:.0%} worse than that of the run before. Compare runs of one machine
only. Where other programs share it, whole runs scatter by a quarter: repeat a bold figure, and run the earlier commit beside it, before you look for a cause. A `+`
after a commit: files differed from it.

To add a run: `python benchmarks/throughput.py --json benchmarks/figures/throughput.json`, and so on, then `python docs/generate/figures.py`.
"""


class Figure(NamedTuple):
    """A number of a benchmark.

    Attributes:
        label: what it is, in the table of its history.
        of: its value in a run.
        pattern: its format.
        greater_is_better: rates; seconds and bytes are better where they are less.
    """

    label: str
    of: Callable[[Run], float]
    pattern: str = ".0f"
    greater_is_better: bool = False


class Row(NamedTuple):
    """A line of the table of speeds: what is measured, its figures put into words, the options."""

    what: str
    words: str
    figures: tuple[Figure, ...]
    options: str = ""


def _ns(case: str) -> Callable[[Run], float]:
    """Return what reads the nanoseconds a particle and step of one kind of step."""

    def of(run: Run) -> float:
        rows = run["ns_per_particle_step"]
        return next(float(row["1e+06"]) for row in rows if row["case"].strip() == case)

    return of


def _bare(run: Run) -> float:
    return float(min(run["limit"]))


def _forecasts(name: str, key: str) -> Callable[[Run], float]:
    """Return what reads a number of one kind of forecasts."""
    return lambda run: float(run["forecasts"][name][key])


def _peers(figure: str, job: str, *programs: str) -> tuple[Figure, ...]:
    """Return a number of several programs that did one job of benchmarks/peers.py."""

    def of(program: str) -> Callable[[Run], float]:
        return lambda run: float(run["programs"][f"{program}, {job}"][figure])

    short = {"full_caches_s": "picture [s]", "empty_caches_s": "first run [s]"}
    unit = short.get(figure, "particle-day [us]")
    pattern = ".3g" if unit.endswith("[us]") else ".1f"
    return tuple(Figure(f"{one}, {job}: {unit}", of(one), pattern) for one in programs)


_plain = _ns("RK4 current, wind, leeway (the yardstick's work)")
_full = _ns("+ both, coast (open sea)")
SEA, SEA_MAP = "open sea, no coast: run_many, no map", "open sea, no coast: run_many, one map"
COAST_MAP = "Norwegian coast: run_many, one map"
YARDSTICKS = " --yardsticks FOLDER"
PEERS = " --opendrift PYTHON --parcels PYTHON --oceantracker PYTHON"
ALL = ("drift", "OpenDrift", "Parcels", "OceanTracker")
BESIDE = "drift {} {unit}, OpenDrift {} {unit}, Parcels {} {unit}, OceanTracker {} {unit}"
ROWS: dict[str, tuple[Row, ...]] = {
    "throughput": (
        Row(
            "a particle and step: RK4 through current and wind, with leeway",
            "{} ns",
            (Figure("step [ns]", _plain),),
            YARDSTICKS,
        ),
        Row(
            "the same with errors, diffusion and the coast",
            "{} ns",
            (Figure("with errors and coast [ns]", _full),),
            YARDSTICKS,
        ),
        Row(
            "a bare C kernel that does the work of the first row, in the same run",
            "{} ns",
            (Figure("C kernel [ns]", _bare),),
            YARDSTICKS,
        ),
        Row(
            "the first two rows relative to that C kernel",
            "{} and {}",
            (
                Figure("step by C", lambda run: _plain(run) / _bare(run), ".2f"),
                Figure("with errors by C", lambda run: _full(run) / _bare(run), ".2f"),
            ),
            YARDSTICKS,
        ),
        Row(
            "memory of a particle on the device",
            "{} bytes",
            (Figure("bytes a particle", lambda run: run["bytes_per_particle"]),),
            YARDSTICKS,
        ),
    ),
    "sweep_cost": (
        Row(
            "a sortie, by particle and leg",
            "{} ns",
            (
                Figure(
                    "a particle and leg [ns]",
                    lambda run: run["ns_per_particle_and_leg"]["inverse cube"],
                    ".1f",
                ),
            ),
        ),
    ),
    "cold_start": (
        Row(
            "the default case with its six sorties, all files",
            "{} s",
            (Figure("full caches [s]", lambda run: run["full_caches"]["whole"]),),
        ),
        Row(
            "the same on its very first run, with empty caches",
            "{} s",
            (Figure("empty caches [s]", lambda run: run["empty_caches"]["whole"]),),
        ),
    ),
    "plan_time": (
        Row(
            "a plan for four units, 12 h and 1,000,000 particles",
            "{} s, of which {} s are planning",
            (
                Figure("in all [s]", lambda run: run["wall_s"]),
                Figure("planning [s]", lambda run: run["phases_s"]["plan"]),
            ),
        ),
    ),
    "many": (
        Row(
            "forecasts a second of 4,000 particles over 24 h by `drift.run_many`",
            "{} without maps; {} with a map in the open sea; {} with a map along the Norwegian coast",
            (
                Figure("a second", _forecasts(SEA, "a_second"), greater_is_better=True),
                Figure("with a map", _forecasts(SEA_MAP, "a_second"), greater_is_better=True),
                Figure("at a coast", _forecasts(COAST_MAP, "a_second"), greater_is_better=True),
            ),
        ),
        Row(
            "processor time of one of these forecasts, on all cores together",
            "{}, {} and {} ms",
            (
                Figure("processor [ms]", _forecasts(SEA, "processor_ms")),
                Figure("with a map [ms]", _forecasts(SEA_MAP, "processor_ms")),
                Figure("at a coast [ms]", _forecasts(COAST_MAP, "processor_ms")),
            ),
        ),
    ),
    "peers": (
        Row(
            "first picture, from nothing, of {particles:,} rafts (leeway, coast) over {hours} h",
            "drift {} s, OpenDrift's Leeway {} s",
            _peers("full_caches_s", "rafts", *ALL[:2]),
            PEERS,
        ),
        Row(
            "the same on the very first run, with empty caches",
            "drift {} s, OpenDrift's Leeway {} s",
            _peers("empty_caches_s", "rafts", *ALL[:2]),
            PEERS,
        ),
        Row(
            "first picture of {particles:,} passive particles in a current over {hours} h",
            BESIDE.replace("{unit}", "s"),
            _peers("full_caches_s", "passive", *ALL),
            PEERS,
        ),
        Row(
            "the same on the very first run, with empty caches",
            BESIDE.replace("{unit}", "s"),
            _peers("empty_caches_s", "passive", *ALL),
            PEERS,
        ),
        Row(
            "a particle-day of rafts, 144 steps: drift RK4, OpenDrift Euler",
            "drift {} us, OpenDrift's Leeway {} us",
            _peers("us_a_particle_day", "rafts", *ALL[:2]),
            PEERS,
        ),
        Row(
            "a particle-day of passive particles, 144 RK4 steps",
            BESIDE.replace("{unit}", "us"),
            _peers("us_a_particle_day", "passive", *ALL),
            PEERS,
        ),
    ),
}


def runs(name: str) -> list[Run]:
    """Return the runs of a benchmark, the newest last."""
    held: list[Run] = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return held


def table() -> str:
    """Return the table of the newest runs in Markdown, with the machines above it."""
    newest = {name: runs(name)[-1] for name in ROWS}
    machines = sorted({f"{run['cores']} cores of {run['machine']}" for run in newest.values()})
    lines = [f"On {' and '.join(machines)}:", "", *_line("what", "measured", "command"), *_rule(3)]
    for name, rows in ROWS.items():
        for row in rows:
            shown = [f"{figure.of(newest[name]):{figure.pattern}}" for figure in row.figures]
            told = row.words.format(*shown)
            what = row.what.format_map(newest[name])
            lines += _line(what, told, f"`python benchmarks/{name}.py{row.options}`")
    return "\n".join(lines) + "\n"


def page() -> str:
    """Return docs/performance.md with the newest table."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    return before + BEGIN + table() + END + rest.partition(END)[2]


def history() -> str:
    """Return docs/history.md: a table of all runs for each benchmark."""
    lines = []
    for name, rows in ROWS.items():
        figures = [figure for row in rows for figure in row.figures]
        lines += ["", f"## {name}", ""]
        lines += _line("day", "commit", "machine", *(figure.label for figure in figures))
        lines += _rule(3 + len(figures))
        lines += _history_of(name, figures)
    return INTRODUCTION + "\n".join(lines) + "\n"


def _history_of(name: str, figures: list[Figure]) -> Iterator[str]:
    """Yield the lines of a benchmark's runs."""
    earlier: Run | None = None
    for run in runs(name):
        cells = []
        for figure in figures:
            told = f"{figure.of(run):{figure.pattern}}"
            cells.append(f"**{told}**" if earlier and _is_worse(figure, earlier, run) else told)
        machine = f"{run['cores']} cores of {run['machine']}"
        yield from _line(run["day"], run["commit"], machine, *cells)
        earlier = run


def _is_worse(figure: Figure, earlier: Run, run: Run) -> bool:
    """Whether a run's figure is clearly worse than that of the run before it."""
    before, now = figure.of(earlier), figure.of(run)
    ratio = before / now if figure.greater_is_better else now / before
    return ratio >= WORSE


def _line(*cells: str) -> list[str]:
    return [f"| {' | '.join(cells)} |"]


def _rule(columns: int) -> list[str]:
    return ["|" + "---|" * columns]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    HISTORY.write_text(history(), encoding="utf-8")
