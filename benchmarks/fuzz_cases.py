"""What thousands of mutated cases do to us: they run, they are refused in lines, or something else,
which must not be.

A case that uses everything, and those that ship without data, are changed in one to three places:
keys taken out, renamed or doubled, values of other kinds, extreme numbers, other units, other times
and places, bytes of the text. Each is loaded; what loads is checked, and of what can be checked the
first --runs are run with few particles and their results read back.

python benchmarks/fuzz_cases.py [--cases 3000] [--runs 300] [--seed 0]
"""

import argparse
import copy
import random
import sys
import tempfile
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import smallest
import watched

from drift.case.file import tomllib

EVERYTHING = """
title = "everything"
start = "2026-11-21T18:30Z"
duration = "9 h"
particles = 400
seed = 5
max_lost = 0.9
[output]
every = "3 h"
trajectories = 20
[clock]
step = "15 min"
scheme = "rk4"
[domain]
west = "3 00.0E"
south = "59 00.0N"
east = "7 30.0E"
north = "61 15.0N"
[coast]
source = "none"
[[current]]
name = "tidal"
analytic = "inertial"
parameters = { speed = "0.4 kn", mean_east = 0.1 }
[[current]]
name = "set"
constant = { speed = "0.5 kn", toward = 35 }
add = true
[[wind]]
table = [{ time = "+0 h", speed = "18 kn", from = 240 }, { time = "+12 h", east = 3.5, north = -6.25 }]
[[stokes]]
constant = { east = 0.05, north = 0.02 }
[uncertainty]
current = { std = "0.1 m/s", time = "6 h" }
wind = { std = "1.5 m/s", time = "6 h" }
diffusivity = "10 m2/s"
[[scenario]]
name = "last call"
weight = 0.6
object = "LIFE-RAFT-DB-11"
jibe = "0.04 / h"
position = { at = "60 10.5N 004 20.0E", error = "3 nmi", time = "+0 h" }
[[scenario]]
name = "=passage"
weight = 0.4
object = { windage = "3 %" }
trackline = { waypoints = ["59 40N 004 10E", "60 20N 005 00E"], speed = "8 kn", departure = "+10 min", cross_track = "2 nmi" }
[[sortie]]
name = "first"
start = "+2 h"
speed = "90 kn"
sweep_width = "0.6 nmi"
pattern = { kind = "parallel", centre = "60 12N 004 30E", length = "20 nmi", width = "8 nmi", orientation = 40, spacing = "2 nmi" }
[[sortie]]
name = "second"
start = "+4 h"
end = "+6 h"
sweep_width = "0.8 nmi"
pod = 0.4
area = { centre = "60 15N 004 40E", length = "12 nmi", width = "9 nmi", orientation = 10 }
law = "random"
[[contact]]
name = "flare"
time = "+5 h"
belief = 0.6
bearing = { from = "60 00N 004 00E", bearing = 40, std = 12, far = "40 nmi" }
[[look]]
name = "dip"
time = "+3 h"
at = "60 10N 004 20E"
width = "5 nmi"
height = "3 nmi"
turned = 20
sees = "nothing"
law = { table = [[0, 0.9], [1.5, 0.1]] }
false_alarms = 0.05
[[presence]]
name = "buoys"
start = "+2 h"
end = "+5 h"
at = "60 12N 004 25E"
radius = "2 nmi"
present = "never"
detection = 0.8
[[barrier]]
name = "picket"
start = "+1 h"
end = "+6 h"
points = ["60 00N 004 30E", "60 20N 004 45E"]
detection = 0.7
reported = "+4 h"
error = "2 h"
false_alarms = "0.1 /h"
[[line]]
name = "sound"
points = ["60 00N 004 20E", "60 20N 004 20E"]
[resampling]
below = 0.1
"""

ODD: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**63, 10**400, -0.0, 1e308, -1e308, float("nan"), float("inf"), 1e-320, 0.5, "", " ", "x", "\u202e",
    "12 kn", "5 nm", "3 nmi", "-4 h", "1e9 h", "90 deg", "12 furlong", "100 %", "2 m/s/s/s", "60N", "91 00N 004 00E", "60 10N 190 00E",
    "004 20E 60 10N", "N 60 E 4", "60,5 4,2", "2026-11-21", "2026-02-30T00:00Z", "310000ZFEB26", "+999999 h", "auto", "none", "all",
    "../../etc/passwd", "/dev/null", "*", "~", "$NOTHING/x.nc", "http://127.0.0.1:9/x", [], [[]], {}, {"at": 1}, [1, 2], ["a", "b"], "é" * 300,
    "\x00", "true", "3 nmi\n", "=cmd()", "cycle" * 500,
)  # fmt: skip


def bases() -> list[dict[str, Any]]:
    """Return the cases that mutation starts from."""
    texts = [EVERYTHING] * 6
    for name in ("overdue_boat", "convergence_zones", "gulf_containers"):
        texts.append(resources.files("cases").joinpath(f"{name}.toml").read_text(encoding="utf-8"))
    return [tomllib.loads(text) for text in texts]


def places(here: Any, above: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the paths of all values in tables and lists."""
    if isinstance(here, dict):
        inner = [(key, value) for key, value in here.items()]
    elif isinstance(here, list):
        inner = list(enumerate(here))
    else:
        return [above]
    return [above, *(place for key, value in inner for place in places(value, (*above, key)))]


def changed(data: dict[str, Any], rng: random.Random) -> list[str]:
    """Change a case's tables in one to three places; return what was done."""
    done = []
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        place = rng.choice(places(data)[1:])
        holder = data
        for key in place[:-1]:
            holder = holder[key]
        last, kind = (
            place[-1],
            rng.choice(("odd", "odd", "odd", "out", "rename", "double", "swap", "scale")),
        )
        done.append(f"{kind} {'.'.join(map(str, place))}")
        if kind == "odd":
            holder[last] = rng.choice(ODD)
        elif kind == "out":
            del holder[last]
        elif kind == "rename" and isinstance(holder, dict):
            holder[rng.choice(("nmae", "x", "", "a.b", str(last).upper()))] = holder.pop(last)
        elif kind == "double" and isinstance(holder, list):
            holder.insert(0, copy.deepcopy(holder[last]))
        elif kind == "swap":
            other = rng.choice(places(data)[1:])
            value: Any = data
            for key in other:
                value = value[key]
            holder[last] = copy.deepcopy(value)
        elif isinstance(holder[last], int | float) and not isinstance(holder[last], bool):
            holder[last] = holder[last] * rng.choice((-1, 0, 1e-9, 1e3, 1e9))
    return done


def mutated(number: int) -> tuple[str, str]:
    """Return what was done to a case, and its text."""
    rng = random.Random(number)
    data = copy.deepcopy(rng.choice(bases()))
    if "particles" in data or "scenario" in data:
        data["particles"] = 400
    if "spill" in data:
        data["spill"] |= {"worlds": 20, "per_world": 20}
    done = changed(data, rng)
    text = written(data)
    if rng.random() < 0.08:
        at = rng.randrange(len(text))
        text = (
            text[:at]
            + rng.choice(("", "\x00", '"', "]", "=", "\n", "é"))
            + text[at + rng.randrange(4) :]
        )
        done.append("bytes")
    return ", ".join(done)[:60], text


def written(data: dict[str, Any]) -> str:
    """Return tables as TOML text, all of them inline, which says the same."""

    def one(value: Any) -> str:
        if isinstance(value, bool):
            return "true" if value else "false"
        if isinstance(value, dict):
            return (
                "{ "
                + ", ".join(f"{one(str(k))} = {one(v)}" for k, v in value.items() if v is not None)
                + " }"
            )
        if isinstance(value, list):
            return "[" + ", ".join(one(v) for v in value if v is not None) + "]"
        if isinstance(value, str):
            return (
                '"'
                + "".join(
                    c if c.isprintable() and c not in '"\\' else f"\\u{ord(c):04x}" for c in value
                )
                + '"'
            )
        return repr(value) if not hasattr(value, "isoformat") else value.isoformat()

    return "\n".join(
        f"{one(str(key))} = {one(value)}" for key, value in data.items() if value is not None
    )


def tried(text: str, folder: Path, run: bool) -> str:
    """Load a case, check it and, if so wanted, run it and read back what it wrote; return what came
    of that.
    """
    import drift
    from drift.apps.check import check

    path = folder / "case.toml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    case = drift.load(path)
    check.check(replace(case, particles=min(case.particles, 400)))
    if not run:
        return "checked"
    out = folder / "out"
    small = replace(case, particles=min(case.particles, 400))
    drift.run(small, out=out, overwrite=True)
    drift.results(out)
    return "run"


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=3000)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0, help="of the first case")
    parser.add_argument("--trials", help=argparse.SUPPRESS)
    parser.add_argument("--run", action="store_true", help=argparse.SUPPRESS)
    given = smallest.parse(parser, cases=8, runs=1)
    if given.trials is not None:
        with tempfile.TemporaryDirectory() as folder:
            for number in map(int, given.trials.split(",")):
                name, text = mutated(number)
                watched.trial(number, name, lambda text=text: tried(text, Path(folder), given.run))
        return
    outcomes = watched.run(__file__, range(given.seed, given.seed + given.cases))
    bad = watched.table(outcomes)
    good = [number for number, (_, told) in outcomes.items() if told == "checked"]
    bad |= watched.table(watched.run(__file__, good[: given.runs], ["--run"]))
    sys.exit(bad)


if __name__ == "__main__":
    main()
