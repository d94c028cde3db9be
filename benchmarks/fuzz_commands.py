"""What odd inputs and numbers at their limits do to the commands other than run: success, an error
in lines, or something else.

`track`, `experiment`, `bridge`, `fit-bridge`, `compare`, `verify`, `fit-errors` and `sensor` are
started as on the command line, in one process, with a file or two of their options changed: keys of
a case, cells of a table, numbers of options. Each writes over the results of the trial before:
after it the folder holds the new results whole, or the old ones ("mixture": 0).

python benchmarks/fuzz_commands.py [--trials-each 100] [--seed 0]
"""

import argparse
import contextlib
import copy
import io
import math
import random
import sys
import tempfile
from importlib import resources
from pathlib import Path
from typing import Any

import fuzz_cases
import smallest
import watched

from drift.case.file import tomllib

MIXTURE = "mixture"
watched.NEVER = (*watched.NEVER, MIXTURE)
LARGEST = 2000  # particles, runs and the like: a trial is to end

CASE = """
title = "Raft"
start = "2026-11-21T00:00Z"
duration = "4 h"
particles = 300
seed = 4
max_lost = 0.9
coast.source = "none"
output = { every = "2 h" }
domain = { west = "100W", east = "80W", south = "20N", north = "33N" }
[[current]]
constant = { speed = "0.6 kn", toward = 70 }
[[wind]]
table = [{ time = "+0 h", speed = "14 kn", from = 250 }, { time = "+3 h", speed = "9 kn", from = 300 }]
[uncertainty]
current = { std = "0.1 m/s", time = "6 h" }
wind = { std = "1.5 m/s", time = "6 h" }
diffusivity = "10 m2/s"
[[scenario]]
name = "last call"
object = "LIFE-RAFT-DB-10"
position = { at = "27 30N 088 00W", std = "3 nmi" }
"""
SONAR = """
[[sensor]]
name = "buoy"
at = "27 30N 088 20W"
sonar = { loss = { file = "LOSSES" }, noise = "70 dB", threshold = "10 dB", fluctuation = "6 dB", jump_rate = "2 /h" }
[[sortie]]
name = "watch"
start = "+0 h"
end = "+1 h"
watch = { sensor = "buoy" }
"""
BRIDGE = """
title = "Go-fast"
k = "12 nmi/sqrt(h)"
[[point]]
name = "departure"
at = "11 20N 075 10W"
time = "010000ZJUN26"
ellipse = { major = "30 nmi", minor = "12 nmi", orientation = 70, probability = 0.9 }
[[point]]
name = "arrival"
at = "17 40N 077 30W"
time = "+60 h"
error = "15 nmi"
correlation = 0.3
[[line]]
name = "14 30 N"
through = ["14 30N 079 00W", "14 30N 073 00W"]
[output]
every = "20 h"
areas = [50, 90]
percentiles = [5, 50, 95]
coast = "none"
"""
LIMITS = (
    "", " ", "0", "-0", "-1", "1", "1e-320", "1e-300 h", "1e308", "1e400", "-1e308", "nan", "inf", "-inf", "9" * 400, "1e9 m", "1e-300 m", "0 kn",
    "-5 kn", "1e300 kn", "1e-300 kn", "1e9 h", "0 s", "1e-9 s", "200%", "x", "é", "\u202e", "1,2", "-98,18,-80,31", "0,0,0,0", "1e308,0,1,1",
    "nan,0,1,1", "0,-90,360,90", "190 00E", "90N 0E", "-27.5,-88", "2026-02-30", "+1e9 h", "999999999 h", "1e300 nmi/sqrt(h)", "1e-300 nmi/sqrt(h)",
    "0 nmi/sqrt(h)", "fit", "=", "a=b", "\x00", "6 h", "2 nmi", "5 kn", "1e6 m", "1e-6 s",
)  # fmt: skip
PLACES = (  # of the case, that options change
    "duration", "clock.step", "scenario.0.position.std", "scenario.0.position.at", "wind.0.table.0.speed", "wind.0.table.1.time",
    "current.0.constant.speed", "uncertainty.wind.time", "uncertainty.diffusivity", "output.every", "domain.west", "seed", "max_lost",
)  # fmt: skip
CELLS = (
    *LIMITS,
    "1e18",
    "-91",
    "91",
    "181",
    "-181",
    "2021-03-20",
    "20/03/21",
    "0001-01-01T00:00Z",
    "9999-12-31T23:59Z",
    '"',
    "\n",
    ",",
)


def shipped(name: str) -> dict[str, Any]:
    """Return a tracking case that ships, made small."""
    data = tomllib.loads(
        resources.files("cases").joinpath(f"tracking/{name}.toml").read_text(encoding="utf-8")
    )
    data["particles"] = 300
    if name == "lost_contact":
        return data | {"show": ["45 min"]}
    data["method"] = data["method"][:2]
    return data | {"duration": "30 min", "every": "3 min", "experiment": {"runs": 2}}


def table(rng: random.Random) -> list[list[str]]:
    """Return fixes of three drifters in 30 hours, with currents and winds in columns."""
    rows = [["id", "time", "lon", "lat", "u", "v", "wu", "wv"]]
    for name in ("a", "b", "c"):
        lon, lat = -88.0 + rng.random(), 27.5 + rng.random()
        for hour in range(0, 30, 2):
            lon, lat = lon + rng.gauss(0.02, 0.01), lat + rng.gauss(0.01, 0.01)
            moment = f"2026-11-{21 + hour // 24}T{hour % 24:02d}:00Z"
            rows.append([name, moment, f"{lon:.5f}", f"{lat:.5f}", "0.2", "0.1", "5", "2"])
    return rows


def seen() -> list[list[str]]:
    """Return the detections of a tracking case that ships."""
    text = (
        resources.files("cases").joinpath("tracking/lost_contact.csv").read_text(encoding="utf-8")
    )
    return [line.split(",") for line in text.splitlines()]


def with_sonar() -> dict[str, Any]:
    """Return the case with a sonar."""
    losses = str(resources.files("cases").joinpath("losses/sargasso.nc"))
    data = tomllib.loads(CASE + SONAR.replace("LOSSES", losses))
    data["scenario"][0]["source_level"] = "160 dB"
    return data


COLUMNS = "current_east=u,current_north=v,wind_east=wu,wind_north=wv"
# A command: its case, its words after it, options with good values, whether it writes a folder, a
# table of rows it reads.
COMMANDS: dict[str, tuple[Any, list[str], dict[str, str], bool, Any]] = {
    "track": (lambda: shipped("lost_contact"), [], {"--seed": "3"}, True, seen),
    "experiment": (lambda: shipped("triangulation"), [], {"--runs": "2", "--seed": "3"}, True, None),
    "experiment ": (
        lambda: tomllib.loads(CASE), [], {"--runs": "2", "--with": "b: duration=3 h", "--figure": "outputs.-1.area_nmi2.95%"}, True, None,
    ),
    "bridge": (lambda: tomllib.loads(BRIDGE), [], {"--k": "9 nmi/sqrt(h)"}, False, None),
    "fit-bridge": (
        None, ["table.csv"], {
            "--every": "4 h", "--max-gap": "8 h", "--min-speed": "0.01 kn", "--max-speed": "30 kn", "--error": "10 m", "--by": "steady",
            "--without": "-60,10,-50,20",
        }, False, table,
    ),
    "compare": (lambda: tomllib.loads(CASE), [], {"--set-b": "duration='3 h'", "--seed": "5"}, True, None),
    "verify": (
        lambda: tomllib.loads(CASE), ["--drifters", "table.csv"], {
            "--columns": COLUMNS, "--max-gap": "3 h", "--max-speed": "3 m/s", "--every": "12 h", "--hours": "6", "--error": "100 m",
            "--particles": "500",
        }, True, table,
    ),
    "fit-errors": (
        lambda: tomllib.loads(CASE), ["--drifters", "table.csv"], {"--columns": COLUMNS, "--max-gap": "3 h", "--max-speed": "3 m/s"}, False, table,
    ),
    "sensor": (with_sonar, ["buoy"], {"--time": "+1 h", "--at": "27 00N 088 00W", "--speed": "8 kn", "--heading": "20", "--beams": "1"}, True, None),
}  # fmt: skip


def words(number: int, folder: Path) -> tuple[str, list[str]]:
    """Write the files of a trial into a folder; return what was changed, and the words of the
    command line.
    """
    rng = random.Random(number)
    name = list(COMMANDS)[number % len(COMMANDS)]
    made, after, options, writes, rows = COMMANDS[name]
    kinds = (
        ["option"] * bool(options)
        + ["case", "case"] * (made is not None)
        + ["table", "table"] * (rows is not None)
    )
    kind, done = rng.choice(kinds), ""
    given = [name.strip()]
    if made is not None:
        data = copy.deepcopy(made())
        if kind == "case":
            done = ", ".join(fuzz_cases.changed(data, rng))
        (folder / "case.toml").write_text(
            fuzz_cases.written(bounded(data)), encoding="utf-8", errors="surrogatepass"
        )
        given.append(str(folder / "case.toml"))
    if rows is not None:
        cells = rows() if rows is seen else rows(rng)
        if kind == "table":
            done = change_table(cells, rng)
        path = folder / ("lost_contact.csv" if rows is seen else "table.csv")
        path.write_text(
            "\n".join(",".join(row) for row in cells) + "\n",
            encoding="utf-8",
            errors="surrogatepass",
        )
    given += [str(folder / word) if word == "table.csv" else word for word in after]
    chosen = [option for option in options if rng.random() < 0.5]
    odd = rng.choice(list(options)) if kind == "option" else ""
    for option in dict.fromkeys([*chosen, *([odd] * bool(odd))]):
        value = options[option]
        if option == odd:
            value = (rng.choice(PLACES) + "=" if "=" in value else "") + rng.choice(LIMITS)
            value = value if option != "--with" else f"b: {value}"
            done = f"{option} {value[:20]!r}"
        given += [option, value]
    if writes:
        given += ["--out", str(folder / f"out-{name.strip()}"), "--overwrite"]
    return f"{name.strip()} {done}"[:60], given


def bounded(data: dict[str, Any]) -> dict[str, Any]:
    """Return tables in which no number of particles or runs keeps a trial from its end; other
    numbers stay odd.
    """
    for holder, key in ((data, "particles"), (data.get("experiment"), "runs")):
        if (
            isinstance(holder, dict)
            and isinstance(value := holder.get(key), int | float)
            and not isinstance(value, bool)
        ):
            holder[key] = value if math.isnan(value) or value <= LARGEST else LARGEST
    return data


def change_table(rows: list[list[str]], rng: random.Random) -> str:
    """Change cells, rows or columns of a table in place; return what was done."""
    kind = rng.choice(
        ("cell", "cell", "cell", "cells", "column", "head", "out", "double", "short", "same")
    )
    row, column = rng.randrange(1, len(rows)), rng.randrange(len(rows[0]))
    value = rng.choice(CELLS)
    if kind in ("cell", "cells"):
        for _ in range(1 if kind == "cell" else 10):
            rows[rng.randrange(1, len(rows))][column] = value
    elif kind == "column":
        for line in rows[1:]:
            line[column] = value
    elif kind == "head":
        rows[0][column] = value
    elif kind == "out":
        del rows[rng.choice((0, 1)) : row]
    elif kind == "double":
        rows[row:row] = [rows[row]] * 3
    elif kind == "short":
        rows[row] = rows[row][:column]
    else:
        rows[1:] = [list(rows[1]) for _ in rows[1:]]
    return f"{kind} {value[:20]!r}"


def tried(given: list[str], folder: Path) -> str:
    """Do a command; return what came of it, and raise where it was an error of drift itself."""
    from drift.apps.cli import commands

    out = Path(given[given.index("--out") + 1]) if "--out" in given else None
    before = held(out)
    told = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(told):
        status = commands.main(given)
    if status not in (0, 2):
        raise RuntimeError(f"status {status}: {told.getvalue()[-600:]}")
    after = held(out)
    hidden = [path.name for path in folder.iterdir() if path.name.startswith(".")]
    if hidden or (status and after != before) or (not status and out is not None and after is None):
        return f"{MIXTURE}: status {status}, {hidden}"
    if status and not any(line.startswith("drift: ") for line in told.getvalue().splitlines()):
        return f"more than its lines: {told.getvalue()!r}"
    return f"refused: {told.getvalue().splitlines()[-1]}" if status else "done"


def held(out: Path | None) -> dict[str, int] | None:
    """Return names and sizes of results that are whole; None where there are none."""
    from drift.products.files import manifest

    listed = None if out is None else manifest.read_manifest(out)
    if out is None or listed is None:
        return None
    sizes = {entry.name: entry.size for entry in listed.files}
    there = {path.name: path.stat().st_size for path in out.iterdir() if path.name != manifest.NAME}
    return sizes | {"made": (out / manifest.NAME).stat().st_mtime_ns} if there == sizes else None


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials-each", type=int, default=100, help="of each command")
    parser.add_argument("--seed", type=int, default=0, help="of the first")
    parser.add_argument(
        "--told", action="store_true", help="print every trial, not only what must not be"
    )
    parser.add_argument("--trials", help=argparse.SUPPRESS)
    given = smallest.parse(parser, trials_each=1)
    if given.trials is not None:
        with tempfile.TemporaryDirectory() as folder:
            for number in map(int, given.trials.split(",")):
                name, line = words(number, Path(folder))
                watched.trial(number, name, lambda line=line: tried(line, Path(folder)))
        return
    count = given.trials_each * len(COMMANDS)
    sys.exit(
        watched.table(watched.run(__file__, range(given.seed, given.seed + count), told=given.told))
    )


if __name__ == "__main__":
    main()
