"""Families: what their scenarios are, and what is refused, each mistake in one line however many
scenarios it has.
"""

import time
from pathlib import Path

import numpy as np
import pytest

from drift.case import file as case_file
from drift.case.record import Case
from geo.errors import UserError

HEAD = """
start = "2026-11-21T00:00Z"
duration = "96 h"
particles = 30000
coast.source = "none"
current = [{ constant = { speed = "0.3 kn", toward = 70 } }]
wind = [{ constant = { speed = "9 kn", from = 240 } }]
[voyage.north]
waypoints = ["40 00N 150 00W", "45 00N 140 00W"]
speed = "8 kn"
[voyage.middle]
waypoints = ["38 00N 150 00W", "40 00N 138 00W"]
speed = "8 kn"
[voyage.south]
waypoints = ["35 00N 150 00W", "33 00N 138 00W"]
speed = "8 kn"
"""
FAMILY = """
[[family]]
name = "transit"
scenario.phase = [{ voyage = { cross_track = "20 nmi" } }]
axis.route = { key = "phase.1.voyage.like", values = ["north", "middle", "south"], weights = [3, 2, 1] }
axis.speed = { key = "phase.1.voyage.speed", from = "6 kn", to = "16 kn", ranges = 10 }
axis.departure = { key = "phase.1.voyage.departure", from = "+0 h", to = "+54 h", count = 10 }
"""
OWN = """
[[scenario]]
name = "adrift"
weight = 0.25
object = "SAILBOAT-3"
position = { at = "38 30N 149 00W", error = "20 nmi" }
"""


def load(tmp_path: Path, text: str, changes: dict[str, str] | None = None) -> Case:
    path = tmp_path / "trial.toml"
    path.write_text(text)
    return case_file.load(path, changes)


def refused(tmp_path: Path, changes: dict[str, str], text: str = HEAD + FAMILY) -> list[str]:
    """Return the lines by which a case is refused, without the file's name."""
    with pytest.raises(UserError) as told:
        load(tmp_path, text, changes)
    return [line.removeprefix("trial.toml: ") for line in told.value.lines]


def test_all_combinations_in_order_with_the_product_of_weights(tmp_path: Path) -> None:
    case = load(tmp_path, HEAD + OWN + FAMILY)
    assert len(case.scenarios) == 301
    first, *rest = case.scenarios
    assert (first.name, first.weight, first.family) == ("adrift", pytest.approx(0.2), None)
    assert [s.name for s in rest[:3]] == [f"transit, north, 6-7 kn, +{h} h" for h in (0, 6, 12)]
    assert rest[-1].name == "transit, south, 15-16 kn, +54 h"
    for k, share in enumerate((3, 2, 1)):  # four fifths are the family's
        own = [s.weight for s in rest[100 * k : 100 * (k + 1)]]
        np.testing.assert_allclose(own, 0.8 * share / 6 / 100, rtol=1e-12)
    assert rest[137].family is not None
    assert rest[137].family.labels == {"route": "middle", "speed": "9-10 kn", "departure": "+42 h"}
    assert rest[137].itinerary is not None
    (phase,) = rest[137].itinerary.phases
    assert (phase.speed.low, phase.speed.high) == (
        pytest.approx(9 * 1852 / 3600),
        pytest.approx(10 * 1852 / 3600),
    )
    assert phase.after.low == 0
    assert phase.start == np.datetime64("2026-11-22T18:00")


def test_it_is_what_the_same_scenarios_written_out_are(tmp_path: Path) -> None:
    written = "".join(
        f'[[scenario]]\nname = "transit, {route}, {v}-{v + 1} kn, +{6 * t} h"\nweight = {weight}\n'
        f'phase = [{{ voyage = {{ like = "{route}", cross_track = "20 nmi", speed = ["{v} kn", "{v + 1} kn"], departure = "+{6 * t} h" }} }}]\n'
        for route, weight in (("north", 3), ("middle", 2), ("south", 1))
        for v in range(6, 16)
        for t in range(10)
    )
    a, b = load(tmp_path, HEAD + FAMILY).scenarios, load(tmp_path, HEAD + written).scenarios
    assert [(s.name, s.itinerary) for s in a] == [(s.name, s.itinerary) for s in b]
    np.testing.assert_allclose([s.weight for s in a], [s.weight for s in b], rtol=1e-12)


def test_values_that_set_several_keys_and_lists_of_lists(tmp_path: Path) -> None:
    """A value may be a table of keys; tables are made where they are not there, numbers count lists
    from 1, None is shared.
    """
    text = """
[[family]]
name = "lost"
scenario.position = { at = [-149.0, 38.5], error = "20 nmi" }
[family.axis.what.values]
raft = { object = "LIFE-RAFT-DB-10", search_object = "Raft 4 person" }
swimmer = { object = "PIW-1", survival.median = "18 h", position.error = "5 nmi" }
[family.axis.where]
key = "position.at.2"
values = [38.5, 39.5]
weights = { "38.5" = 1, "39.5" = 3 }
"""
    case = load(tmp_path, HEAD + text)
    assert [s.name for s in case.scenarios] == [
        "lost, raft, 38.5", "lost, raft, 39.5", "lost, swimmer, 38.5", "lost, swimmer, 39.5"
    ]  # fmt: skip
    assert [s.weight for s in case.scenarios] == pytest.approx([0.125, 0.375, 0.125, 0.375])
    raft, _, swimmer, north = case.scenarios
    assert (raft.search_object, swimmer.search_object, raft.survival) == (
        "Raft 4 person",
        None,
        None,
    )
    assert swimmer.survival is not None
    assert north.prior is not None
    assert north.prior.reported == pytest.approx((-149.0, 39.5))
    assert swimmer.prior.major == pytest.approx(raft.prior.major / 4)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("axis", "labels"),
    [
        ('{ key = "weightless", from = 1, to = 2, count = 3 }', ["1", "1.5", "2"]),
        ('{ key = "x", from = "-2 h", to = "+4 h", ranges = 2 }', ["-2 to +1 h", "+1 to +4 h"]),
        ('{ key = "x", from = "211830ZNOV26", to = "211930ZNOV26", count = 2 }', ["211830ZNOV26", "211930ZNOV26"]),
        ('{ key = "x", from = 2026-11-21T18:00:00Z, to = 2026-11-21T20:00:00Z, ranges = 1 }', ["211800ZNOV26 to 212000ZNOV26"]),
        ('{ key = "x", from = "1 nmi", to = "1.0003 nmi", count = 4 }', ["1 nmi", "1.0001 nmi", "1.0002 nmi", "1.0003 nmi"]),
        ('{ key = "x", values = [["4 kn", "5 kn"], true, 7, { a = 1 }] }', ["4-5 kn", "true", "7", "a 4"]),
        ('{ key = "x", values = [1, 2], labels = ["one", 2] }', ["one", "2"]),
    ],
)  # fmt: skip
def test_what_values_are_called(axis: str, labels: list[str]) -> None:
    from drift.case.scenario.family import FamilyTable

    table = FamilyTable.model_validate(
        {"name": "f", "axis": {"a": case_file.tomllib.loads(f"axis = {axis}")["axis"]}}
    )
    assert [story["name"] for story in table.stories()] == [f"f, {label}" for label in labels]


def test_what_is_left_out_gives_its_weight_to_all_others(tmp_path: Path) -> None:
    out = '[{ route = "north", speed = ["6-7 kn", "7-8 kn"] }, { departure = "+54 h" }]'
    case = load(tmp_path, HEAD + FAMILY, {"family.0.leave_out": out})
    names = [s.name for s in case.scenarios]
    assert len(names) == 9 * 28
    assert not any(
        name.startswith("transit, north, 7-8 kn") or name.endswith("+54 h") for name in names
    )
    weights = dict(zip(names, (s.weight for s in case.scenarios), strict=True))
    assert weights["transit, north, 8-9 kn, +0 h"] == pytest.approx(3 / (9 * (8 * 3 + 10 * 2 + 10)))


def test_set_and_vary_change_families(tmp_path: Path) -> None:
    case = load(
        tmp_path,
        HEAD + FAMILY,
        {
            "family.0.axis.speed.ranges": "2",
            "family.0.axis.route.values": '["south"]',
            "family.0.axis.route.weights": "[1]",
        },
    )
    assert len(case.scenarios) == 20
    again = case_file.vary(case, {"family.0.axis.departure.count": 3})
    assert [s.name for s in again.scenarios][:3] == [
        f"transit, south, 6-11 kn, +{h} h" for h in (0, 27, 54)
    ]


def test_files_that_values_name_are_inputs(tmp_path: Path) -> None:
    network = '[[node]]\nname = "a"\nat = [-150.0, 38.0]\n[[node]]\nname = "b"\nat = [-149.0, 38.5]\n[[lane]]\nfrom = "a"\nto = "b"\nwidth = "8 nmi"\n'
    for name in ("one", "two"):
        (tmp_path / f"{name}.toml").write_text(network)
    text = """
[[family]]
name = "by"
scenario.phase = [{ lanes = { route = ["a", "b"], speed = "8 kn" } }]
axis.lanes = { key = "phase.1.lanes.network", values = { one = "one.toml", two = "two.toml" } }
"""
    inputs = load(tmp_path, HEAD + text).inputs
    assert {Path(path).name for path in inputs} == {"one.toml", "two.toml"}


def test_a_family_stands_for_its_scenarios_in_tables_by_scenario(tmp_path: Path) -> None:
    area = '["41 00N 149 00W", "41 00N 146 00W", "39 00N 146 00W", "39 00N 149 00W"]'
    sortie = (
        f'[[sortie]]\nstart = "+6 h"\nend = "+9 h"\nlaw = "random"\narea = {{ polygon = {area} }}\n'
    )
    told = 'pod = { transit = 0.5, adrift = 0.1, "transit, north, 6-7 kn, +0 h" = 0 }\n'
    (flown,) = load(tmp_path, HEAD + OWN + FAMILY + sortie + told).sorties
    assert len(flown.coverage) == 301
    assert flown.coverage[1] == 0
    assert len({*flown.coverage[2:]}) == 1
    assert flown.coverage[2] > flown.coverage[0] > 0
    (line,) = refused(tmp_path, {}, HEAD + OWN + FAMILY + sortie + "pod = { adrift = 0.1 }\n")
    assert (
        line
        == 'sortie "sortie 1": pod lacks family "transit"; give one for each, 0 for an object that cannot be seen'
    )
    (line,) = refused(
        tmp_path, {}, HEAD + OWN + FAMILY + sortie + "pod = { adrift = 0.1, transits = 0.5 }\n"
    )
    assert (
        line
        == 'sortie "sortie 1": pod: no scenario "transits"; did you mean "transit"? there are: transit, adrift'
    )


REFUSED = [
    ({"family": "3"}, "family: must be a valid list; given 3"),
    ({"family.0.wight": "3"}, 'family "transit": unknown key "wight"; did you mean "weight"?'),
    ({"family.0.weight": "-1"}, 'family "transit".weight: weight -1 must be at least 0'),
    ({"family.0.scenario.name": '"x"'}, 'family "transit": scenario.name: its scenarios are named by their values'),
    ({"family.0.scenario.weight": "2"}, 'family "transit": scenario.weight: give the family\'s weight'),
    ({"family.0.axis": "{}"}, 'family "transit".axis: '),
    ({"family.0.axis.speed": "3"}, 'family "transit".axis.speed: must be a table, not 3'),
    ({"family.0.axis.speed.form": '"1 kn"'}, 'family "transit".axis.speed: unknown key "form"; did you mean "from"?'),
    ({"family.0.axis.route.values": "[]"}, 'family "transit".axis.route.values: [] must be a list of values, or a table'),
    ({"family.0.axis.route.values": '{ "" = "north" }'}, "family \"transit\".axis.route.values: '' must be one line of letters"),
    ({"family.0.axis.route.values": '["north", "north", "south"]'}, 'family "transit".axis.route: two values have the label "north"'),
    ({"family.0.axis.route.from": "1"}, 'family "transit".axis.route: give values, or from and to; found values and from'),
    ({"family.0.axis.speed.count": "3"}, 'family "transit".axis.speed: give values, or from and to with count'),
    ({"family.0.axis.speed.ranges": "0"}, 'family "transit".axis.speed: ranges 0 must be at least 1'),
    ({"family.0.axis.speed.ranges": "2.5"}, 'family "transit".axis.speed.ranges: 2.5 is not a whole number'),
    ({"family.0.axis.departure.count": "1"}, 'family "transit".axis.departure: count 1 must be at least 2'),
    ({"family.0.axis.speed.to": '"6 kn"'}, "family \"transit\".axis.speed: from '6 kn' must be below to '6 kn'"),
    ({"family.0.axis.speed.to": '"9 m/s"'}, "family \"transit\".axis.speed: from '6 kn' and to '9 m/s' must have the same unit"),
    ({"family.0.axis.speed.to": "inf"}, "must be two numbers, two quantities of one unit or two times"),
    ({"family.0.axis.speed.from": "nan", "family.0.axis.speed.to": "1"}, "from nan and to 1 must be finite"),
    ({"family.0.axis.speed.to": "[1]"}, "must be two numbers, two quantities of one unit or two times"),
    ({"family.0.axis.route.weights": "[1, 2]"}, 'family "transit".axis.route: weights: 2 given for 3 values; give one per value'),
    ({"family.0.axis.route.weights": "[0, 0, 0]"}, 'family "transit".axis.route: weights add up to 0'),
    ({"family.0.axis.route.weights": "[1, -1, 1]"}, 'family "transit".axis.route.weights: weight -1 must be at least 0'),
    ({"family.0.axis.route.weights": "7"}, 'family "transit".axis.route.weights: 7 must be a list with one weight per value, or a table'),
    ({"family.0.axis.route.weights": "{ north = 1 }"}, 'weights: given for "north"; give one for each value: "north", "middle", "south"'),
    ({"family.0.axis.route.labels": '["a", "b"]'}, 'family "transit".axis.route: labels: 2 given for 3 values'),
    ({"family.0.axis.route.labels": '"a"'}, "family \"transit\".axis.route.labels: 'a' must be a list with one label per value"),
    ({"family.0.axis.route.labels": '["a", ["b"], "c"]'}, "family \"transit\".axis.route.labels: ['b'] is not a label"),
    ({"family.0.axis.route.key": '"phase.3.voyage.like"'}, 'family "transit": axis.route.key: "phase.3": "3" is not a number in the list; give 1, or 2 for one more'),
    ({"family.0.axis.route.key": '"phase..like"'}, 'family "transit": axis.route.key: ".like" has nothing between two points'),
    ({"family.0.axis.route.key": '"name"'}, 'family "transit": axis.route.key: name is set by the family; use labels to name values'),
    ({"family.0.axis.route.key": '"weight"'}, 'family "transit": axis.route.key: weight is set by the family; use weights to weight values'),
    ({"family.0.scenario.phase.0.voyage": '"north"'}, "axis.route.key: \"phase.1.voyage.like\": phase.1.voyage is 'north', not a table in which \"like\" could be set; write it { like = \"north\", .. }"),
    ({"family.0.leave_out": "[{}]"}, 'family "transit": leave_out 1: is empty'),
    ({"family.0.leave_out": '[{ rout = "north" }]'}, 'family "transit": leave_out 1: no axis "rout"; there are: "route", "speed", "departure"'),
    ({"family.0.leave_out": '[{ route = "nort" }]'}, 'family "transit": leave_out 1.route: no value is called "nort"; there are: "north", "middle", "south"'),
    ({"family.0.leave_out": '[{ route = ["north", "middle", "south"] }]'}, 'family "transit": leave_out: leaves no scenario'),
    ({"family.0.axis.speed.ranges": "500"}, 'family "transit": 3 x 500 x 10 = 15,000 scenarios; at most 10,000. Take fewer values'),
    ({"family.0.axis.speed.ranges": "20000"}, 'family "transit".axis.speed: 20,000 values; at most 10,000 scenarios are allowed'),
    # Of the scenarios that are made:
    ({"family.0.scenario.fase": "3"}, 'family "transit": unknown key "fase"; did you mean "phase"?'),
    ({"family.0.axis.speed.key": '"phase.1.voyage.sped"'}, 'family "transit".phase 1.voyage: unknown key "sped"; did you mean "speed"?'),
    ({"family.0.axis.speed.from": '"0 kn"'}, 'family "transit", speed "0-1.6 kn".phase 1.voyage.speed: speed \'0 kn\' must be above 0 m/s'),
    ({"family.0.axis.route.values": '["nort", "middle", "south"]'}, 'family "transit", route "nort".phase 1.voyage: no voyage \'nort\'; there are: [voyage.north]'),
    ({"family.0.axis.departure.to": '"+99 h"'}, 'family "transit", departure "+99 h": it may get under way at 250300ZNOV26, outside the run'),
    ({"family.0.scenario.object": '"LIFERAFT-X"'}, 'family "transit".object: no leeway class "LIFERAFT-X"; nearest is'),
    ({"family.0.scenario.currents": '["gulf"]'}, 'family "transit".currents: no source "gulf"; there are: current 1'),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "told"), REFUSED, ids=[told[:60] for _, told in REFUSED])
def test_one_line_for_a_mistake(tmp_path: Path, changes: dict[str, str], told: str) -> None:
    (line,) = refused(tmp_path, changes)
    assert told in line


def test_no_table_of_keys(tmp_path: Path) -> None:
    text = FAMILY.replace('key = "phase.1.voyage.like", ', "")
    (line,) = refused(tmp_path, {}, HEAD + text)
    assert 'family "transit".axis.route: value "north" is not a table of keys; give key' in line
    text = FAMILY.replace(
        '{ key = "phase.1.voyage.like", values = ["north", "middle", "south"], weights = [3, 2, 1] }',
        "{ values = { a = { weight = 2 } } }",
    )
    (line,) = refused(tmp_path, {}, HEAD + text)
    assert (
        'family "transit": axis.route, value "a": weight is set by the family; leave it out' in line
    )


def test_names_that_come_twice(tmp_path: Path) -> None:
    (line,) = refused(tmp_path, {}, HEAD + FAMILY + FAMILY)
    assert line == 'family "transit": two families have this name; give each its own'
    (line,) = refused(tmp_path, {}, HEAD + OWN.replace('"adrift"', '"transit"') + FAMILY)
    assert line == 'family "transit": a scenario has this name too; give each its own'
    (line,) = refused(
        tmp_path, {}, HEAD + OWN.replace('"adrift"', '"transit, south, 6-7 kn, +0 h"') + FAMILY
    )
    assert (
        'family "transit", route "south", speed "6-7 kn", departure "+0 h": two scenarios have this name'
        in line
    )


def test_a_family_beside_a_spill(tmp_path: Path) -> None:
    lines = refused(tmp_path, {"spill": "{}"})
    assert any("spill" in line for line in lines)


@pytest.mark.thorough
def test_too_many_together(tmp_path: Path) -> None:
    other = FAMILY.replace('"transit"', '"other"').replace("ranges = 10", "ranges = 330")
    (line,) = refused(tmp_path, {}, HEAD + FAMILY + other)
    assert line == "10,200 scenarios of families and others; at most 10,000"


def test_three_hundred_load_quickly(tmp_path: Path) -> None:
    """Measured 0.1 s; 25 times as much is a fault that a slow machine does not explain."""
    load(tmp_path, HEAD + FAMILY)  # imports
    begin = time.process_time()
    load(tmp_path, HEAD + FAMILY)
    assert time.process_time() - begin < 2.5
