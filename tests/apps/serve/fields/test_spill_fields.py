"""The fields of spills: release, classes, losses, finds, patrols and teams; tomllib is the oracle."""

import tomllib
from importlib import resources
from typing import Any

import pytest

from drift.apps.serve.answers import process
from drift.apps.serve.fields import form, search_fields, spill_fields
from drift.case.template import template_text
from geo.errors import UserError

ZOE, GULF = (
    resources.files("cases").joinpath(f"{name}.toml").read_text()
    for name in ("zoe_containers", "gulf_containers")
)
SEARCH = """\
# of the watch officer
title = "Lost" # as called in
start = "281130ZNOV26"
duration = "24 h"
particles = 100_000

[[current]] # guessed
name = "on scene"
constant = { speed = "1 kn", toward = 75 }

[[scenario]]
name = "last known position"
position = { at = "49 55.0N 005 40.0W", error = "1 nmi" } # plotted

[output]
every = "3 h" # outputs
"""


def changed(text: str, *changes: tuple[str, Any]) -> str:
    return form.set_fields(text, [{"field": name, "value": value} for name, value in changes])


def comments(text: str) -> list[str]:
    return [line.partition("#")[2].strip() for line in text.split("\n") if "#" in line]


def test_the_rows_of_shipped_cases() -> None:
    gulf = search_fields.read_rows(tomllib.loads(GULF))
    drum, box = gulf["rows"]["spill.class"]
    assert drum["values"]["number"] == 208  # 40 % of 520
    assert box["values"]["number"] == 312
    assert drum["values"]["object.immersion"] == [0.6, 0.9]
    assert drum["values"]["sinking.waterlogged"] == ["10 d", "60 d"]
    assert box["values"]["sinking.half_life"] == ["5 d", "60 d"]
    assert drum["in_text"] == box["in_text"] == []
    assert [row["values"]["name"] for row in gulf["rows"]["patrol_unit"]] == [
        "Cocodrie",
        "Burns Point",
    ]
    assert gulf["spill"]["in_text"] == ["per_world", "current_bias", "reporting.bias"]
    zoe = search_fields.read_rows(tomllib.loads(ZOE))
    assert zoe["spill"]["values"]["track"][0] == "53 25N 004 15E, 011700ZJAN2019"
    assert [row["values"]["share"] for row in zoe["rows"]["spill.loss"]] == [0.8, 0.2]
    assert form.read_fields(GULF)["fields"]["spill.position.at"]["value"] == "28 30N 090 30W"
    told = form.read_fields(ZOE)
    assert told["spill"] is True
    hidden = {key for key in told["unknown"] if key.startswith("spill.")}
    assert hidden == {"spill.per_world", "spill.current_bias", "spill.reporting.rate"}


@pytest.mark.parametrize(
    ("text", "field", "value"),
    [
        (GULF, "spill.objects", [480, 560]),
        (GULF, "spill.destroyed", 0.1),
        (GULF, "spill.class.1.name", "crate"),
        (GULF, "spill.class.0.object.immersion", [0.5, 0.8]),
        (GULF, "spill.class.0.sinking.waterlogged", "12 d"),
        (GULF, "spill.position.until", "+8 h"),
        (GULF, "spill.stretches.length", "5 km"),
        (GULF, "find.2.at", "29 14.0N 091 09.5W"),
        (GULF, "find.1.false", 0.2),
        (GULF, "patrol_unit.0.reach", "50 km"),
        (ZOE, "spill.track", "ais.csv"),
        (ZOE, "spill.ship", "ZOE"),
        (ZOE, "spill.loss.1.begin", "020030ZJAN2019"),
        (ZOE, "spill.loss.0.length", ["20 min", "1 h"]),
    ],
)
def test_one_field_changes_and_nothing_else(text: str, field: str, value: Any) -> None:
    expected: Any = tomllib.loads(text)
    *above, last = search_fields.place_of(field)
    node = expected
    for part in above:
        node = node.setdefault(part, {}) if isinstance(part, str) else node[part]
    node[last] = value
    made = changed(text, (field, value))
    assert tomllib.loads(made) == expected
    assert comments(made) == comments(text)


@pytest.mark.parametrize(
    ("number", "objects", "shares"),
    [
        (100, 412, [100 / 412, 312 / 412]),
        ([150, 250], [462, 562], [400 / 1024, 624 / 1024]),
        (0, 312, [0, 1]),
        (None, 312, [0, 1]),
    ],
)
def test_the_number_of_a_class(number: Any, objects: Any, shares: list[float]) -> None:
    """The other class keeps its 312; shares go by the middles of the numbers."""
    made = tomllib.loads(changed(GULF, ("spill.class.0.number", number)))["spill"]
    assert made["objects"] == objects
    assert [one["share"] for one in made["class"]] == pytest.approx(shares, abs=1e-6)
    assert spill_fields.numbers_of_classes(made)[1] == 312 or isinstance(objects, list)


def test_classes_are_added_and_removed_and_the_others_keep_their_numbers() -> None:
    one = changed(ZOE, ("spill.class.0.number", 340))
    assert tomllib.loads(one)["spill"]["objects"] == 340
    assert "share" not in tomllib.loads(one)["spill"]["class"][0]
    crate = {"name": "crate", "object": "water"}
    two = changed(one, ("spill.class.1", crate), ("spill.class.1.number", 60))
    spill = tomllib.loads(two)["spill"]
    assert (spill["objects"], spill_fields.numbers_of_classes(spill)) == (400, [340, 60])
    assert comments(two) == comments(ZOE)
    process_check = process.ANSWERS["check"]
    assert process_check({"path": "/x/a.toml", "text": two}, print) == {"messages": []}
    back = tomllib.loads(changed(two, ("spill.class.0", None)))["spill"]
    assert back["objects"] == 60
    assert [one["name"] for one in back["class"]] == ["crate"]
    spilled = tomllib.loads(changed(one, ("spill.class.0.number", None)))["spill"]
    assert "objects" not in spilled


def test_a_place_takes_the_place_of_the_track_and_back() -> None:
    made = changed(ZOE, ("spill.position.at", "53 30N 005 00E"), ("spill.position.error", "2 nmi"))
    spill = tomllib.loads(made)["spill"]
    assert spill["position"] == {"at": "53 30N 005 00E", "error": "2 nmi"}
    assert not spill.keys() & {"track", "loss", "clock_error", "ship"}
    lines = ["53 25N 004 15E, +0 h", "53 42N 006 00E, +3 h", "53 50N 006 40E,"]
    back = changed(made, ("spill.track", lines))
    spill = tomllib.loads(back)["spill"]
    assert "position" not in spill
    assert spill["track"] == [
        {"at": "53 25N 004 15E", "time": "+0 h"},
        {"at": "53 42N 006 00E", "time": "+3 h"},
        {"at": "53 50N 006 40E", "time": ""},
    ]
    assert search_fields.read_rows(tomllib.loads(back))["spill"]["values"]["track"] == [
        *lines[:2],
        "53 50N 006 40E, ",
    ]
    loss = {"begin": ["+1 h", "+2 h"], "length": "1 h"}
    assert tomllib.loads(changed(back, ("spill.loss.0", loss)))["spill"]["loss"] == [loss]


def test_a_search_becomes_a_spill_and_a_search_again() -> None:
    made = form.turn(SEARCH, True)
    data, before = tomllib.loads(made), tomllib.loads(SEARCH)
    assert data["spill"]["position"] == before["scenario"][0]["position"]
    assert not data.keys() & {"scenario", "particles"}
    assert {"of the watch officer", "as called in", "guessed", "outputs"} <= set(comments(made))
    whole = changed(
        made,
        ("spill.class.0.number", 50),
        ("wind", {"kind": "constant", "speed": "9 kn", "from": 8}),
    )
    assert process.ANSWERS["check"]({"path": "/x/a.toml", "text": whole}, print) == {"messages": []}
    back = tomllib.loads(form.turn(made, False))
    assert {**back, "particles": 100_000} == before
    new = form.turn(SEARCH.replace('"Lost"', '"New search"'), True)
    assert tomllib.loads(new)["title"] == "New spill"
    assert tomllib.loads(form.turn(new, False))["title"] == "New search"
    template = form.turn(template_text("position"), True)
    assert tomllib.loads(template)["spill"]["class"][0]["name"] == "cargo"


@pytest.mark.parametrize(
    ("text", "spill", "words"),
    [
        (GULF, True, "a spill already"),
        (SEARCH, False, "no spill"),
        (f"{SEARCH}\n[[sortie]]\nname = 'x'\n", True, "has sorties, which a spill cannot have"),
        (f"{SEARCH}\n[[scenario]]\nname = 'x'\n", True, "several scenarios"),
        (f"{SEARCH}\n[[scenario]]\n", True, "several scenarios"),
        (
            SEARCH.replace("[output]", "wind = ['on scene']\n[output]"),
            True,
            "scenario.0.wind has no",
        ),
        (GULF, False, "has finds and teams"),
        (ZOE.split("[[find]]")[0], False, "a ship's track cannot"),
    ],
)
def test_what_cannot_turn(text: str, spill: bool, words: str) -> None:
    with pytest.raises(UserError, match=words):
        form.turn(text, spill)


@pytest.mark.parametrize(
    ("text", "field", "value", "words"),
    [
        (GULF, "spill.class.0.number", 1.5, "no number of objects"),
        (GULF, "spill.class.0.number", [5, 3], "5 to 3 is no number of objects; write it like 120"),
        (GULF, "spill.class.0.number", "many", "no number of objects"),
        (GULF, "spill.class.0.share", 0.3, "there is no field"),
        (GULF, "scenario.0.position.at", "29N 90W", "a spill has no scenario"),
        (GULF, "spill.class.7", {"name": "x"}, "there is no such spill.class"),
        (GULF, "spill.redraws", 2, "there is no field"),
        (GULF, "find.0.at", ["29N 90W"], "one line"),
        (GULF, "patrol_unit.0.stretches", "x", "list of names"),
        (SEARCH, "spill.class.0", {"name": "x"}, "cannot make this change"),
        (
            ZOE.replace("immersion = [0.5, 0.9]", "windage = 0.03"),
            "spill.class.0.object",
            "water",
            "is set in the text",
        ),
    ],
)
def test_bad_changes(text: str, field: str, value: Any, words: str) -> None:
    with pytest.raises(UserError, match=words):
        changed(text, (field, value))


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("objects = 342", "objects = 'x'", "spill.class.0.number"),
        ('length = ["10 min", "2 h"]', 'length = ["10 min", "2 kg"]', "spill.loss.0.length"),
        ('"012130ZJAN2019"', '"011130ZJAN2019"', "spill.loss.0.begin"),
        ('time = "011700ZJAN2019" }', 'time = "x" }', "spill.track"),
        ('"011700ZJAN2019" },', '"011910ZJAN2019" },', "spill.loss.0.begin"),
        ('"020930ZJAN2019"', '"050930ZJAN2019"', "find.0"),
        ('at = "53 28.2N', 'at = "99 28.2N', "find.1.at"),
        ("immersion = [0.5, 0.9]", "immersion = [0.5, 1.9]", "spill.class.0.object.immersion"),
        (
            "[expect]",
            '[[patrol]]\nname = "p"\ntime = "+40 h"\ndetection = 3\nstretches = ["x"]\n[expect]',
            "patrol.0",
        ),
    ],
)
def test_messages_have_their_field(old: str, new: str, field: str) -> None:
    check = process.ANSWERS["check"]
    assert check({"path": "/x/a.toml", "text": ZOE}, print) == {"messages": []}
    told = check({"path": "/x/a.toml", "text": ZOE.replace(old, new, 1)}, print)["messages"]
    assert field in [one["field"] for one in told], told
