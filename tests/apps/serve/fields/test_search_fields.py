"""The fields of searches, contacts, units and the plan: tomllib is the oracle."""

import tomllib
from typing import Any

import pytest

from drift.apps.serve.answers import process
from drift.apps.serve.fields import form, search_fields
from geo.errors import UserError

TEXT = """\
title = "Overdue"
start = "281130ZNOV26"
duration = "24 h"

[[current]]
name = "on scene"
constant = { speed = "1 kn", toward = 75 }

[[scenario]]
name = "kayak"
object = "water"
position = { at = "49 55.0N 005 40.0W", error = "1 nmi" }

[[sortie]] # of the coordinator
name = "lifeboat" # by radio
unit = "Boat"
start = "+4 h"
speed = "14 kn"
law = "definite_range"
sweep_width = "0.6 nmi" # told by the crew
[sortie.pattern] # as flown
kind = "parallel"
centre = [-5.5, 50.1]
length = "6 nmi"
width = "3 nmi"
spacing = "1 nmi"

[[sortie]]
name = "helicopter"
start = "+5 h"
speed = "90 kn"
sweep_width = { kayak = "0.3 nmi" }
waypoints = [["+5 h", "50N 005W"], ["+6 h", "50N 006W"]]

[plan] # tomorrow
begin = "+8 h"
objective = "pos"
"""


def changed(text: str, *changes: tuple[str, Any]) -> str:
    return form.set_fields(text, [{"field": name, "value": value} for name, value in changes])


def comments(text: str) -> list[str]:
    return [line.partition("#")[2].strip() for line in text.split("\n") if "#" in line]


def test_the_rows_of_a_text() -> None:
    told = search_fields.read_rows(tomllib.loads(TEXT))
    boat, helicopter = told["rows"]["sortie"]
    assert boat["values"]["pattern.centre"] == "50-06.0N 005-30.0W"
    assert boat["values"]["pattern.spacing"] == "1 nmi"
    assert boat["in_text"] == ["law"]
    assert set(helicopter["in_text"]) == {"sweep_width.kayak", "waypoints"}
    assert told["plan"] == {"values": {"begin": "+8 h"}, "in_text": ["objective"]}
    assert told["rows"]["unit"] == []
    assert form.read_fields(TEXT)["unknown"] == [
        "plan.objective",
        "sortie.0.law",
        "sortie.1.sweep_width.kayak",
        "sortie.1.waypoints",
    ]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("sortie.0.pattern.spacing", "0.7 nmi"),
        ("sortie.0.completed", "60 %"),
        ("sortie.1.name", "Rescue 193"),
        ("sortie.1.track", "lifeboat.gpx"),
        ("plan.until", "+20 h"),
        ("plan.rounds", 2),
        ("plan.ashore", True),
        ("scenario.0.search_object", "Person in Water"),
    ],
)
def test_one_field_changes_and_nothing_else(field: str, value: Any) -> None:
    expected: Any = tomllib.loads(TEXT)
    *above, last = search_fields.place_of(field)
    node = expected
    for part in above:
        node = node[part]
    node[last] = value
    made = changed(TEXT, (field, value))
    assert tomllib.loads(made) == expected
    assert comments(made) == comments(TEXT)
    if field.count(".") > 1 or value == 2:
        removed: Any = tomllib.loads(changed(made, (field, None)))
        del node[last]
        assert removed == expected


def test_rows_are_added_and_removed() -> None:
    unit = {"name": "cutter", "base": "50N 005W", "search_speed": "14 kn", "daylight": False}
    find = {"name": "paddle", "time": "+3 h", "position": {"at": "50N 5W", "error": "1 nmi"}}
    made = changed(TEXT, ("unit.0", unit), ("contact.0", find), ("sortie.0", None))
    expected = tomllib.loads(TEXT)
    del expected["sortie"][0]
    assert tomllib.loads(made) == {**expected, "unit": [unit], "contact": [find]}
    assert "\n\n[[unit]]\n" in made
    back = changed(made, ("unit.0", None), ("contact.0", None), ("sortie.0", None))
    assert set(tomllib.loads(back)) == set(tomllib.loads(TEXT)) - {"sortie"}
    assert tomllib.loads(changed(back, ("plan.begin", None)))["plan"] == {"objective": "pos"}


def test_a_width_by_conditions_takes_the_place_of_one() -> None:
    made = changed(TEXT, ("sortie.0.sweep_width.visibility", "5 nmi"))
    assert tomllib.loads(made)["sortie"][0]["sweep_width"] == {"visibility": "5 nmi"}
    again = changed(made, ("sortie.0.sweep_width", "0.8 nmi"))
    assert tomllib.loads(again)["sortie"][0]["sweep_width"] == "0.8 nmi"


BAD: dict[str, tuple[Any, Any, str]] = {
    "a key of the text": ("sortie.0.law", "random", "there is no field"),
    "a table of the text": ("sensor.0.name", "x", "there is no field"),
    "of no row": ("sortie.2.name", "x", "there is no such sortie"),
    "far off": ("sortie.7", {"name": "x"}, "there is no such sortie"),
    "too far": ("sortie.60", {"name": "x"}, "there is no field"),
    "a row that exists": ("sortie.0", {"name": "x"}, "exists already"),
    "a row of nothing": ("sortie.2", {}, "give the keys"),
    "a row of a word": ("sortie.2", "x", "give the keys"),
    "a row with a key of the text": ("sortie.2", {"law": "random"}, "there is no field 'law'"),
    "a row in a row": ("sortie.2", {"pattern": {"kind": {"x": 1}}}, "one line"),
    "two lines": ("sortie.0.name", "a\nb", "one line"),
    "a list": ("sortie.0.name", ["a"], "one line"),
    "no list": ("sortie.0.pattern.waypoints", "50N 5W", "list of positions"),
    "not a number": ("plan.rounds", float("nan"), "too large"),
    "hidden by the text": ("sortie.1.sweep_width", "1 nmi", "is set in the text"),
    "waypoints with times": ("sortie.1.waypoints", ["50N 5W"], "is set in the text"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_changes(name: str) -> None:
    field, value, words = BAD[name]
    with pytest.raises(UserError, match=words):
        changed(TEXT, (field, value))


def test_a_plan_that_is_no_table() -> None:
    with pytest.raises(UserError, match="plan is set in the text"):
        changed('plan = "x"\n', ("plan.begin", "+1 h"))
    with pytest.raises(UserError, match="sortie is set in the text"):
        changed("sortie = 3\n", ("sortie.0", {"name": "x"}))


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ('"1 nmi"\n\n', '"1 kg"\n\n', "sortie.0.pattern.spacing"),
        ('"14 kn"', '"14 furlong"', "sortie.0.speed"),
        ('begin = "+8 h"', 'begin = "+80 h"', "plan.begin"),
    ],
)
def test_messages_have_their_field(old: str, new: str, field: str) -> None:
    text = TEXT.replace('sweep_width = { kayak = "0.3 nmi" }', 'sweep_width = "0.3 nmi"')
    check = process.ANSWERS["check"]
    assert check({"path": "/x/a.toml", "text": text}, print) == {"messages": []}
    told = check({"path": "/x/a.toml", "text": text.replace(old, new)}, print)["messages"]
    assert field in [one["field"] for one in told], told


def test_a_number_that_is_none_names_its_field() -> None:
    with pytest.raises(UserError, match=r"spill\.class\.0\.number: inf is too large a number"):
        search_fields.check_value("spill.class.0.number", [1, float("inf")])
