"""All errors of a case come at once: any two of these give the lines that each gives alone, and no
other.
"""

import itertools
from pathlib import Path

import pytest

from drift.case import file as case_file
from geo.errors import UserError

CASE = """
start = "2026-11-21T18:00Z"
duration = "24 h"
particles = 1000
output = { every = "6 h" }
clock = { step = "10 min" }
coast = { source = "none" }
[[current]]
constant = { speed = "1 kn", toward = 90 }
[[wind]]
name = "on scene"
constant = { speed = "20 kn", from = 240 }
[[scenario]]
name = "raft"
weight = 0.5
object = "PIW-1"
search_object = "Person in Water"
position = { at = "60 00N 000 00E", error = "1 nmi" }
[[scenario]]
name = "swimmer"
weight = 0.5
object = "PIW-2"
search_object = "Person in Water"
position = { at = "60 00N 000 00E", error = "1 nmi" }
[[sortie]]
start = "+2 h"
end = "+3 h"
sweep_width = "1 nmi"
spacing = "1 nmi"
area = { centre = "60 00N 000 00E", length = "5 nmi", width = "5 nmi" }
[[sortie]]
name = "second"
start = "+4 h"
end = "+5 h"
sweep_width = { raft = "1 nmi", swimmer = "0.5 nmi" }
spacing = "1 nmi"
area = { centre = "60 00N 000 00E", length = "5 nmi", width = "5 nmi" }
[[contact]]
name = "seen"
time = "+6 h"
belief = 0.5
position = { at = "60 00N 000 00E", error = "1 nmi" }
[[look]]
name = "glance"
time = "+7 h"
sees = "nothing"
at = "60 00N 000 00E"
radius = "2 nmi"
law = { linear = 0.95 }
false_alarms = 0.01
[[unit]]
name = "lifeboat"
base = "60 00N 000 10E"
ready = "+9 h"
endurance = "3 h"
search_speed = "12 kn"
transit_speed = "25 kn"
sweep_width = "0.5 nmi"
[expect]
adrift = [1, 1]
areas = { 75 = ["1 nmi2", "100 nmi2"] }
"""
MISTAKES = {  # what stands there, and what in its place
    "unknown key": ("particles = 1000", "particels = 1000"),
    "strange key": ("particles = 1000", "frobnicate = 1000"),
    "value": ('step = "10 min"', 'step = "10 parsec"'),
    "no choice": ('source = "none"', 'source = "none", behaviour = "bounce"'),
    "speed": ('speed = "20 kn"', 'speed = "900 kn"'),
    "no file": ('constant = { speed = "1 kn", toward = 90 }', 'files = "nowhere.nc"'),
    "object": ('"PIW-1"', '"LIFERAFT-X"'),
    "key of a scenario": ('name = "swimmer"\nweight', 'name = "swimmer"\nwieght'),
    "no source": ('object = "PIW-2"', 'object = "PIW-2"\nwinds = ["off scene"]'),
    "sortie's value": ('start = "+2 h"', 'start = "at two"'),
    "sortie outside the run": ('start = "+4 h"\nend = "+5 h"', 'start = "+40 h"\nend = "+50 h"'),
    "no such scenario": ('{ raft = "1 nmi", swimmer', '{ raftt = "1 nmi", swimmer'),
    "contact's key": ("belief = 0.5", "belif = 0.5"),
    "contact outside the run": ('time = "+6 h"', 'time = "+60 h"'),
    "look's value": ("false_alarms = 0.01", "false_alarms = 7.5"),
    "look outside the run": ('time = "+7 h"', 'time = "+70 h"'),
    "unit's value": ('endurance = "3 h"', 'endurance = "3 kn"'),
    "area that is not made": ("areas = { 75 =", "areas = { 77 ="),
    "expected value": ("adrift = [1, 1]", "adrift = [1, 2]"),
}
# pairs in one table, whose value that cannot be read hides what the table as a whole does not fit
TOUCH = {
    frozenset(pair)
    for pair in [
        ("area that is not made", "expected value"),
        ("look's value", "look outside the run"),
    ]
}


def load(tmp_path: Path, *names: str) -> list[str]:
    """Return the error's lines of a case with some mistakes."""
    text = "".join(["title = 'all at once'", CASE])
    for name in names:
        old, new = MISTAKES[name]
        text = text.replace(old, new, 1)
    path = tmp_path / "case.toml"
    path.write_text(text)
    try:
        case_file.load(path)
    except UserError as error:
        return [line.replace(str(tmp_path), "") for line in error.lines]
    return []


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> dict[str, list[str]]:
    folder = tmp_path_factory.mktemp("alone")
    assert load(folder) == []
    return {name: load(folder, name) for name in MISTAKES}


def test_each_alone_is_one_line(alone):
    assert {name: len(lines) for name, lines in alone.items() if len(lines) != 1} == {}


@pytest.mark.thorough
def test_any_two_are_told_together(alone, tmp_path):
    wrong = {}
    for pair in itertools.combinations(MISTAKES, 2):
        if MISTAKES[pair[0]][0] in MISTAKES[pair[1]][0] or frozenset(pair) in TOUCH:
            continue
        found = load(tmp_path, *pair)
        if sorted(found) != sorted(alone[pair[0]] + alone[pair[1]]):
            wrong[pair] = found
    assert wrong == {}


def test_all_are_told_together(alone, tmp_path):
    """But for those that stand where another does, or in a table of which another value cannot be
    read.
    """
    names = [
        name for name in MISTAKES if name not in ("strange key", "expected value", "look's value")
    ]
    assert set(load(tmp_path, *names)) == {line for name in names for line in alone[name]}
