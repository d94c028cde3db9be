"""[[scenario.change]]: what is read of it, what is rejected, and that docs/changes.md names it."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trial_case
from places import ROOT

import drift
from drift.case import file as case_file
from drift.case.scenario.change import ChangeTable
from geo.errors import UserError

TEXT = (ROOT / "docs" / "changes.md").read_text(encoding="utf-8")
BREEZE = {"constant": {"speed": "9 kn", "from": 205}}
CAPSIZED = {"name": "capsized", "rate": "0.2/h"}


def changed(folder: Path, *own: dict[str, Any], **tables: Any) -> drift.Case:
    """Return a trial case of a raft with these changes."""
    scenario = {"object": "LIFE-RAFT-DB-10", "change": list(own), **tables.pop("scenario", {})}
    return trial_case.load(folder, **{"wind": BREEZE, "scenario": scenario, **tables})


def test_a_change_as_it_is_read(tmp_path: Path) -> None:
    case = changed(
        tmp_path,
        {**CAPSIZED, "wind": "14 m/s", "leeway": "40 %", "search_object": "Raft 4 person"},
        {
            "name": "out",
            "from": ["unchanged", "capsized"],
            "at": ["+1 h", "+3 h"],
            "object": "PIW-1",
        },
        {"name": "sunk", "from": "capsized", "after": "90 min", "sinks": True},
    )
    first, second, third = case.scenarios[0].changes
    assert (first.leaves, first.wind, first.leeway) == ((0,), (14.0, 2.5), 0.4)
    assert first.rate == pytest.approx(0.2 / 3600)
    assert (second.leaves, second.object.name, second.after) == ((0, 1), "PIW-1", False)
    assert (second.time.low, second.time.high) == (3600, 10_800)
    assert (third.leaves, third.sinks, third.after, third.time.mean) == ((1,), True, True, 5400)
    assert [one.memoryless for one in case.scenarios[0].changes] == [True, False, False]
    # a class with two sides jibes, though water does not
    out = {"name": "out", "rate": "1/h", "object": "LIFE-RAFT-DB-10"}
    jibes = changed(tmp_path, out, scenario={"object": "water"})
    assert jibes.scenarios[0].jibe_rate == pytest.approx(0.04 / 3600)


WRONG: list[tuple[list[dict[str, Any]], str]] = [
    ([{"name": "a"}], "exactly one of rate, at, after must be given; found none"),
    ([{"name": "a", "rate": "1/h", "at": "+1 h"}], "found rate and at"),
    ([{"name": "a", "rate": "0/h"}], "it never comes; give a rate above 0"),
    ([{"name": "a", "rate": "-0.2/h"}], "rate '-0.2/h' must be 0 to 1 per second"),
    ([{"name": "a", "rate": 0.2}], "needs a unit"),
    ([{"name": "a", "at": "+1 h", "wind": "9 m/s"}], "wind belongs to rate"),
    ([CAPSIZED | {"width": "2 m/s"}], "width belongs to wind"),
    ([CAPSIZED | {"object": "PIW-1", "leeway": 0.4}], "object and leeway both say"),
    ([CAPSIZED | {"object": {"immersion": 0.5}}], "object: immersion differs between objects"),
    ([CAPSIZED | {"sinks": True, "leeway": 0.4}], "leeway belongs to an object that floats"),
    ([CAPSIZED | {"from": "swamped"}], 'no state "swamped" before it; allowed here: "unchanged"'),
    ([CAPSIZED, CAPSIZED], "two states have this name"),
    ([CAPSIZED | {"from": []}], "it leaves no state"),
    (
        [CAPSIZED | {"sinks": True}, {"name": "b", "from": "capsized", "rate": "1/h"}],
        '"capsized" has sunk, and nothing comes after that',
    ),
    ([CAPSIZED | {"survival": {"median": "3 h"}}], "the scenario has no survival"),
    ([{"name": "a", "at": {"at": "+1 h", "std": "1 h"}}], "at has no std"),
    ([{"name": f"{k}", "rate": "1/h"} for k in range(17)], "17 changes; at most 16 are allowed"),
]


@pytest.mark.parametrize(("own", "words"), WRONG, ids=[words[:30] for _, words in WRONG])
def test_what_is_rejected(tmp_path: Path, own: list[dict[str, Any]], words: str) -> None:
    with pytest.raises(UserError) as error:
        changed(tmp_path, *own)
    assert words in str(error.value)
    assert len(error.value.args) == 1


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"wind": None, "scenario": {"object": "water"}}, "comes by the wind and there is none"),
        ({"duration": "-6 h"}, "changes of state need a forward run"),
        ({"contact": [{"state": "awash"}]}, 'no state "awash"; there are: "unchanged", "capsized"'),
        ({"contact": [{"state": "capsized", "of": "PIW-1"}]}, "state is that of the search object"),
        ({"sortie": [{"sweep_width_after": {"sunk": "1 nmi"}}]}, 'no change leads to "sunk"'),
        (
            {"sortie": [{"sweep_width_after": {"capsized": "1 nmi"}, "pod": 0.5}]},
            "belongs to sweep_width",
        ),
    ],
)
def test_what_does_not_fit_the_case(tmp_path: Path, tables: dict[str, Any], words: str) -> None:
    square = [[-88.2, 27.4], [-87.9, 27.4], [-87.9, 27.7], [-88.2, 27.7]]
    if "contact" in tables:
        at = {"time": "+1 h", "position": {"at": "27 30N 088 00W", "error": "3 nmi"}}
        tables["contact"] = [{**at, **tables["contact"][0]}]
    if "sortie" in tables:
        own = {"start": "+1 h", "end": "+2 h", "area": {"polygon": square}}
        width = {} if "pod" in tables["sortie"][0] else {"sweep_width": "1 nmi", "speed": "60 kn"}
        tables["sortie"] = [{**own, **width, **tables["sortie"][0]}]
    if tables.get("duration") == "-6 h":
        tables = {"direction": "backward"}
    with pytest.raises(UserError) as error:
        changed(tmp_path, CAPSIZED | {"wind": "12 m/s"}, **tables)
    assert words in str(error.value)


def test_a_state_where_no_object_changes(tmp_path: Path) -> None:
    at = {"at": "27 30N 088 00W", "error": "3 nmi"}
    with pytest.raises(UserError, match="no object changes its state; add"):
        trial_case.load(tmp_path, contact=[{"time": "+1 h", "state": "sunk", "position": at}])


def test_an_own_model_and_a_target_that_stays_under_way_have_none(tmp_path: Path) -> None:
    (tmp_path / "ice.py").write_text("def velocity(current):\n    return current\n")
    with pytest.raises(UserError, match="change replaces leeway"):
        changed(tmp_path, CAPSIZED, scenario={"object": None, "motion": "ice.py"})
    phase = [{"course": {"course": 70, "speed": "6 kn"}}]
    with pytest.raises(UserError, match="change belongs to an object adrift"):
        changed(tmp_path, CAPSIZED, scenario={"object": None, "phase": phase})


def test_sweep_widths_after_changes(tmp_path: Path) -> None:
    """By name, by the tables, else that of the scenario; the tables' row of the other object is
    that of a scenario with this object.
    """
    seen = {"visibility": "5 nmi", "wind": "12 kn", "seas": "2 ft"}
    sortie = {
        "unit": "Helicopter", "start": "+1 h", "end": "+2 h", "speed": "90 kn", "altitude": "500 ft",
        "sweep_width": seen, "sweep_width_after": {"out": "0.3 nmi"},
        "area": {"polygon": [[-88.2, 27.4], [-87.9, 27.4], [-87.9, 27.7], [-88.2, 27.7]]},
    }  # fmt: skip
    own = (
        CAPSIZED | {"search_object": "Person in water"},
        {"name": "out", "rate": "1/h"},
        {"name": "silent", "rate": "1/h"},
    )
    raft = {"search_object": "Raft 4 person"}
    (first,) = changed(tmp_path, *own, sortie=[sortie], scenario=raft).sorties
    del sortie["sweep_width_after"]
    person = {"search_object": "Person in water"}
    (other,) = changed(tmp_path, sortie=[sortie], scenario=person).sorties
    widths = [one[0][0] for one in first.changed]
    np.testing.assert_allclose(widths, [other.sweep_width[0], 0.3 * 1852, first.sweep_width[0]])
    assert len({*widths}) == 3
    coverages = [one[1][0] for one in first.changed]
    np.testing.assert_allclose(
        np.divide(coverages, widths), first.coverage[0] / first.sweep_width[0]
    )


def test_the_page_names_every_key() -> None:
    (section,) = re.findall(r"^## `\[\[scenario.change\]\]`\n(.*?)(?=^##)", TEXT, re.M | re.S)
    named = re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE)
    assert named == [field.alias or name for name, field in ChangeTable.model_fields.items()]


def test_the_example_of_the_page_loads(tmp_path: Path) -> None:
    (example,) = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    flows = '[[current]]\nanalytic = "gulf"\n[[wind]]\nanalytic = "breeze"\n'
    path = tmp_path / "trial.toml"
    path.write_text(f'title = "trial"\nstart = "141800ZOCT26"\nduration = "84 h"\n{flows}{example}')
    assert len(case_file.load(path).scenarios[0].changes) == 3
