"""The form of the desk: fields read from a text and written into it; tomllib is the oracle."""

import re
import tomllib
from copy import deepcopy
from typing import Any

import numpy as np
import pytest

from drift.apps.serve.answers import process
from drift.apps.serve.fields import form, form_sources
from drift.case.template import TEMPLATES, template_text
from geo.errors import UserError

TEXT = """\
# of the watch officer
title = "Overdue" # as called in
start = "281130ZNOV26"
duration = "24 h"
strange = { kept = true } # an unknown key

[output]
every = "3 h" # outputs

[[wind]]
name = "ship"
constant = { speed = "18 kn", from = 235 } # by radio

[[scenario]]
name = "kayak"
object = "PIW-1" # to be changed
[scenario.position] # of the call
at = "50 02.2N 005 31.7W" # plotted
error = "1 nmi"

[[scenario]] # the other one
name = "raft"
position = { at = [-5.5, 50.1], std = "2 nmi" }
"""


def comments(text: str) -> list[str]:
    return [line.partition("#")[2].strip() for line in text.split("\n") if "#" in line]


@pytest.mark.parametrize(
    ("field", "keys", "value"),
    [
        ("title", ("title",), 'a "new" one'),
        ("particles", ("particles",), 20_000),
        ("coast.source", ("coast", "source"), "none"),
        ("scenario.0.object", ("scenario", 0, "object"), "PERSON-POWERED-VESSEL-1"),
        ("scenario.0.position.at", ("scenario", 0, "position", "at"), "49 58.4N 005 40.1W"),
        ("scenario.0.position.time", ("scenario", 0, "position", "time"), "+2 h"),
        ("scenario.1.position.at", ("scenario", 1, "position", "at"), "49 58.4N 005 40.1W"),
        ("scenario.1.name", ("scenario", 1, "name"), "life raft"),
    ],
)
def test_one_field_changes_and_nothing_else(field: str, keys: Any, value: Any) -> None:
    """tomllib finds the change and nothing else; every comment is still there, in order."""
    expected: Any = tomllib.loads(TEXT)
    node = expected
    for key in keys[:-1]:
        node = node.setdefault(key, {}) if isinstance(node, dict) else node[key]
    node[keys[-1]] = value
    made = form.set_fields(TEXT, [{"field": field, "value": value}])
    assert tomllib.loads(made) == expected
    assert comments(made) == comments(TEXT)
    assert form.read_fields(made)["fields"][field]["value"] == value


def test_what_is_written_back_changes_no_byte() -> None:
    assert form.set_fields(TEXT, []) == TEXT
    for name in TEMPLATES:
        assert form.set_fields(template_text(name), []) == template_text(name)


def test_the_fields_of_a_text() -> None:
    told = form.read_fields(TEXT)
    fields = told["fields"]
    assert fields["start"] == {"value": "281130ZNOV26", "read": "2026-11-28T11:30:00Z"}
    at = fields["scenario.0.position.at"]["read"]
    np.testing.assert_allclose(at, [-(5 + 31.7 / 60), 50 + 2.2 / 60], rtol=1e-12)
    assert fields["scenario.0.position.error"]["read"] == 1852.0
    assert fields["scenario.1.position.at"]["value"] == "50-06.0N 005-30.0W"
    assert fields["wind"]["value"] == {"kind": "constant", "speed": "18 kn", "from": 235}
    assert fields["current"]["value"] is None
    assert told["unknown"] == ["strange", "output", "scenario.1.position.std"]
    assert told["scenarios"] == 2


def test_another_kind_of_start_takes_the_place_of_the_first() -> None:
    corners = ["50N 006W", "50N 005W", "49 30N 005 10W"]
    made = form.set_fields(TEXT, [{"field": "scenario.0.area.polygon", "value": corners}])
    scenario = tomllib.loads(made)["scenario"][0]
    assert scenario == {"name": "kayak", "object": "PIW-1", "area": {"polygon": corners}}
    assert form.read_fields(made)["fields"]["scenario.0.area.polygon"]["read"][0] == [-6.0, 50.0]


@pytest.mark.parametrize("quantity", ["wind", "current"])
def test_a_source_and_its_error(quantity: str) -> None:
    """What is typed has an error, which files take back, as they have defaults; one of the user's
    stays."""
    direction = form_sources.SOURCES[quantity]
    base = form.new_text(np.datetime64("2026-11-28T11:30"))
    rows = [{"time": f"+{h} h", "speed": "9 kn", direction: 31.5 + h} for h in (0, 7)]
    typed = form.set_fields(base, [{"field": quantity, "value": {"kind": "table", "rows": rows}}])
    tables = tomllib.loads(typed)
    assert tables[quantity] == [{"name": "on scene", "table": rows}]
    assert set(tables["uncertainty"]) == {quantity}
    files = {"kind": "files", "files": ["a.nc", "b.nc"]}
    read = form.set_fields(typed, [{"field": quantity, "value": files}])
    assert tomllib.loads(read)[quantity][0]["files"] == ["a.nc", "b.nc"]
    assert "uncertainty" not in tomllib.loads(read)
    assert form.read_fields(read)["fields"][quantity]["value"] == files
    mine = f'{base}\n[uncertainty]\n{quantity} = {{ std = "1 m/s", time = "5 h" }}\n'
    for value in ({"kind": "table", "rows": rows}, files, None):
        mine = form.set_fields(mine, [{"field": quantity, "value": value}])
        assert tomllib.loads(mine)["uncertainty"][quantity]["std"] == "1 m/s"
    assert quantity not in tomllib.loads(mine)


def test_several_sources_are_left_to_the_text() -> None:
    text = TEXT + '\n[[wind]]\nname = "other"\nfiles = "x.nc"\n'
    told = form.read_fields(text)
    assert told["fields"]["wind"] == {"in_text": True}
    assert "wind" in told["unknown"]
    with pytest.raises(UserError, match="wind is set in the text; change it there"):
        form.set_fields(text, [{"field": "wind", "value": None}])


BAD: dict[str, tuple[Any, Any, str]] = {
    "no such field": ("output.every", "3 h", "there is no field"),
    "no text": (7, "3 h", "there is no field"),
    "two lines": ("title", "a\nb", "one line"),
    "a table": ("title", {"a": 1}, "one line"),
    "long": ("title", "x" * 2000, "one line"),
    "truth for a number": ("particles", True, "one line"),
    "not a number": ("particles", float("nan"), "too large"),
    "no list": ("scenario.0.area.polygon", "50N 006W", "list of positions"),
    "far": ("scenario.7.name", "x", "no such scenario"),
    "no kind": ("wind", {"kind": "analytic"}, "give its kind"),
    "no direction": ("wind", {"kind": "constant", "speed": "3 kn"}, "give from and speed"),
    "the other direction": (
        "wind",
        {"kind": "constant", "speed": "3 kn", "toward": 5},
        "give from",
    ),
    "no rows": ("current", {"kind": "table", "rows": []}, "1 to 500 rows"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_changes(name: str) -> None:
    field, value, words = BAD[name]
    with pytest.raises(UserError, match=words):
        form.set_fields(TEXT, [{"field": field, "value": deepcopy(value)}])


def test_a_text_that_is_no_toml() -> None:
    for work in (form.read_fields, lambda text: form.set_fields(text, [])):
        with pytest.raises(UserError, match=r"not valid TOML.*line 2"):
            work('title = "x"\nstart == 3\n')


def test_messages_have_their_field_and_line() -> None:
    """Each mistake is put into one line of a text; its message names that line and that field."""
    text = TEXT.replace("strange = { kept = true }", "particles = 2000").replace(
        'std = "2 nmi" }', 'std = "2 nmi" }\nobject = "PIW-1"'
    )
    text += '[[current]]\nname = "tide"\nconstant = { speed = "1 kn", toward = 75 }\n'
    check = process.ANSWERS["check"]
    assert check({"path": "/x/a.toml", "text": text}, print) == {"messages": []}
    for old, new, field in (
        ('"24 h"', '"24 parsec"', "duration"),
        ('"50 02.2N', '"50 72.2N', "scenario.0.position.at"),
        ('"1 nmi"', '"1 kg"', "scenario.0.position.error"),
        ('"18 kn"', '"18 furlong"', "wind"),
        ('"1 kn"', '"1 V"', "current"),
        ('object = "PIW-1" #', 'object = "PIW-99" #', "scenario.0.object"),
        ('object = "PIW-1" #', "#", "scenario.0.object"),
    ):
        wrong = text.replace(old, new, 1)
        (told,) = check({"path": "/x/a.toml", "text": wrong}, print)["messages"]
        assert told["field"] == field, told
        if new != "#":
            assert wrong.split("\n")[told["line"] - 1].count(new.strip(" #")) == 1, told
    (told,) = check({"path": "/x/a.toml", "text": 'title = "x"\nstart == 3\n'}, print)["messages"]
    assert (told["line"], told["field"]) == (2, None)


def test_what_is_missing_is_said_without_toml() -> None:
    """Of a new case, and of tables that the form has begun: beside its field, in a planner's words."""
    new = form.new_text(np.datetime64("2026-11-21T18:30"))
    place = 'position = { at = "50 02.2N 005 31.7W", error = "1 nmi" }\nobject = "PIW-1"\n'
    contact = f'{place}[[contact]]\nname = "a flare"\ntime = ""\n'
    contact += 'position = { at = "50 02.2N 005 31.7W", error = "1 nmi" }\n'
    seen: dict[str, str] = {}
    for text in (new, new + place, new + contact, f'{new}{place}[[unit]]\nname = "lifeboat"\n'):
        for one in process.ANSWERS["check"]({"path": "/x/a.toml", "text": text}, print)["messages"]:
            assert not re.search(r"\[|drift objects|\"\"|no default", one["message"]), one
            seen[one["field"]] = one["message"]
    expected = {"scenario.0.position.at", "scenario.0.object", "wind", "current", "contact.0.time", "unit.0.base"}  # fmt: skip
    assert expected <= seen.keys()
    assert all("missing" in seen[field] for field in expected)
