"""`drift plan` of scarce processing: from a case to the files of a plan, and what is refused."""

import csv
import itertools
import json

import numpy as np
import pytest

import drift
from drift.apps.cli.commands import main
from geo.errors import UserError

SONAR = """
loss = { transition = "8 km", frequency = "50 Hz", to = "150 nmi" }
noise = "72 dB"
gain = { line = { elements = 12, spacing = "12 m", frequency = "50 Hz", beams = 3 } }
threshold = "6 dB"
jump_rate = "0.2 /h"
"""
CASE = f"""
title = "scarce"
start = "2026-06-01T00:00Z"
duration = "12 h"
particles = 4000
seed = 3
[output]
times = ["+12 h"]
[coast]
source = "none"
[[scenario]]
name = "quiet"
source_level = "145 dB"
position = {{ at = "36N 179 40W", std = "25 nmi" }}
[[scenario.phase]]
course = {{ course = [40, 80], speed = ["3 kn", "8 kn"] }}
[[scenario]]
name = "loud"
source_level = "150 dB"
position = {{ at = "35 20N 179 30E", std = "30 nmi" }}
[[scenario.phase]]
course = {{ course = [200, 250], speed = ["6 kn", "12 kn"] }}
[[sensor]]
name = "west"
at = "35N 179E"
heading = 20
[sensor.sonar]{SONAR}
[[sensor]]
name = "east"
at = "36 40N 179W"
heading = 110
[sensor.sonar]{SONAR}
[[sensor]]
name = "buoy"
at = "36N 180E"
[sensor.sonar]
noise = "72 dB"
[[sensor]]
name = "tail"
[sensor.sonar]{SONAR}
[plan]
begin = "+4 h"
until = "+10 h"
particles = 2000
[plan.processing]
slot = "3 h"
processors = 2
sensors = ["west", "east"]
"""


def load(folder, text=CASE):
    path = folder / "scarce.toml"
    path.write_text(text)
    return drift.load(path)


def changed(*pairs):
    text = CASE
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def heard(plan, choice):
    """Return what a choice hears, by NumPy on dense tables: the best beam of an array in a slot,
    all of these apart.
    """
    missed = np.array(plan.hearing.weight)
    for slot, beams in enumerate(choice):
        chance = plan.hearing.chance[slot].toarray().astype(float)
        for array in (0, 1):
            own = [beam for beam in beams if beam // 3 == array]
            if own:
                missed = missed * (1 - chance[own].max(axis=0))
    return float(plan.hearing.weight.sum() - missed.sum())


@pytest.mark.thorough
def test_a_plan_by_the_command_is_the_best_of_all(tmp_path, capsys):
    load(tmp_path)
    assert main(["plan", str(tmp_path / "scarce.toml"), "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "POD" in told
    assert "010400ZJUN26" in told
    numbers = json.loads((tmp_path / "out" / "processing.json").read_text())
    plan, _ = drift.allocate(drift.load(tmp_path / "scarce.toml"))
    assert numbers["pod"] == plan.pod
    pairs = list(itertools.combinations(range(6), 2))
    every = {choice: heard(plan, choice) for choice in itertools.product(pairs, pairs)}
    best = max(every.values())
    assert plan.allocation.heard == pytest.approx(heard(plan, plan.allocation.chosen), rel=1e-9)
    assert numbers["heard"] == pytest.approx(best, rel=1e-6)
    assert best <= numbers["bound"] + 1e-9
    assert min(every.values()) < 0.8 * best  # there was something to choose
    rows = list(csv.DictReader((tmp_path / "out" / "processing.csv").read_text().splitlines()))
    first = {(row["array"], row["beam"]) for row in rows if row["time"] == "2026-06-01T04:00:00Z"}
    names = plan.names
    assert first == {
        (names.arrays[beam // 3], names.beams[beam]) for beam in plan.allocation.chosen[0]
    }
    assert {"processing.txt", "processing.png"} <= {
        path.name for path in (tmp_path / "out").iterdir()
    }
    text = (tmp_path / "out" / "processing.txt").read_text()
    assert max(map(len, text.splitlines())) <= 78
    assert f"POD {100 * plan.pod:.1f} %" in " ".join(text.split())
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["processing"]["pod"] == plan.pod
    assert "processing.txt" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.thorough
def test_its_pod_is_that_of_the_watch_that_was_planned(tmp_path):
    """One beam over the whole plan: a run with that watch, on other particles, finds as much."""
    case = load(
        tmp_path,
        changed(
            ('slot = "3 h"', 'slot = "6 h"'),
            ("processors = 2", "processors = 1"),
            ("particles = 2000", "particles = 20000"),
        ),
    )
    plan, _ = drift.allocate(case)
    ((beam,),) = plan.allocation.chosen
    name = ("west", "east")[beam // 3]
    watch = f'\n[[sortie]]\nname = "it"\nstart = "+4 h"\nend = "+10 h"\nwatch = {{ sensor = "{name}", beams = [{beam % 3 + 1}] }}\n'
    text = changed(("particles = 4000", "particles = 20000"))
    update = drift.run(load(tmp_path, text[: text.index("[plan]")] + watch)).updates.all[0]
    pos = float(np.asarray(update.pos)[-1])
    error = np.hypot(plan.standard_error, np.sqrt(pos * (1 - pos) / 20_000))
    assert pos == pytest.approx(plan.pod, abs=3 * error)
    assert plan.pod > 0.1
    # One slot, one beam: nothing is carried, nothing shared.
    assert plan.allocation.heard == pytest.approx(
        plan.pod, abs=3 * np.sqrt(2) * 0.5 / np.sqrt(plan.made_on)
    )
    assert plan.allocation.exact


@pytest.mark.thorough
def test_processors_by_name_work_in_their_hours_on_their_sensors(tmp_path):
    people = 'processors = [{ name = "day", sensors = ["west"], manned = [["+4 h", "+6 h"], ["+6 h", "+7.5 h"]] }, { name = "all" }]'
    case = load(
        tmp_path,
        changed(
            ("processors = 2", people),
            ('slot = "3 h"', 'slot = "2.5 h"\ncost = 0.001\ntoday = { west = [2], east = [1] }'),
        ),
    )
    asked = case.processing
    # 04-06.5, 06.5-9, 9-10: the last slot is what is left.
    assert [str(edge)[11:16] for edge in asked.edges] == ["04:00", "06:30", "09:00", "10:00"]
    assert asked.manned.tolist() == [[True, True], [False, True], [False, True]]
    assert asked.serves.tolist() == [[True, False], [True, True]]
    assert asked.beams == (3, 3)
    plan, _ = drift.allocate(case)
    rows = plan.allocation.processing
    assert rows[1:, 0].tolist() == [-1, -1]
    assert rows[0, 0] in (0, 1, 2)
    today = {other.name: other for other in plan.allocation.alternatives}["as today"]
    assert today.beams == ((1, 3), (1,), (1,))
    assert plan.allocation.value <= plan.allocation.heard


@pytest.mark.thorough
def test_an_array_that_is_towed_on_a_known_way(tmp_path):
    way = '{ sensor = "tail", name = "ship", waypoints = [["+5 h", "35 30N 179 40E"], ["+8 h", "35 50N 180E"]] }'
    case = load(tmp_path, changed(('["west", "east"]', f'["west", {way}]')))
    plan, _ = drift.allocate(case)
    assert plan.names.arrays == ("west", "ship")
    assert plan.names.beams[3:] == ("000R", "090R", "180R")
    assert plan.hearing.chance[0][3:].sum() > 0
    late = load(
        tmp_path,
        changed(('["west", "east"]', f'["west", {way}]'), ('slot = "3 h"', 'slot = "1 h"')),
    )
    plan, _ = drift.allocate(late)
    assert [float(table[3:].sum()) > 0 for table in plan.hearing.chance] == [
        False,
        True,
        True,
        True,
        False,
        False,
    ]


@pytest.mark.thorough
def test_ships_of_the_same_plan_are_placed_first(tmp_path):
    ship = (
        '[[tow]]\nname = "ship"\nsensor = "tail"\nbegin = { centre = "35 30N 180E", length = "40 nmi", width = "40 nmi" }\nspeed = "5 kn"\n'
        'endurance = "2 h"\n[plan]'
    )
    case = load(tmp_path, changed(("[plan]", ship), ('["west", "east"]', '["west", "tail"]')))
    plan, result = drift.allocate(case, tmp_path / "out")
    assert plan.names.arrays == ("west", "tail")
    assert [one.sea.tow.name for one in plan.towed.placement.placed] == ["ship"]
    legs = result.updates.sorties[0].legs
    assert legs.time[-1] - legs.time[0] <= 2 * 3600
    begin = (np.datetime64(round(legs.time[0]), "s") - case.plan.begin) / np.timedelta64(1, "h")
    assert begin < 3  # the ship listens in the first slot alone
    assert plan.hearing.chance[0][3:].sum() > 0
    assert plan.hearing.chance[1][3:].sum() == 0
    assert {
        "arrays.txt",
        "arrays.toml",
        "processing.txt",
        "processing.csv",
        "processing.json",
        "processing.png",
    } <= {path.name for path in (tmp_path / "out").iterdir()}


TWICE = '[[tow]]\nname = "{}"\nsensor = "tail"\nbegin = {{ centre = "35 30N 180E", length = "40 nmi", width = "40 nmi" }}\nspeed = "5 kn"\n'


def test_an_array_that_two_ships_tow_is_two(tmp_path):
    text = changed(
        ("[plan]", TWICE.format("one") + TWICE.format("two") + "[plan]"),
        ('["west", "east"]', '["tail"]'),
    )
    asked = load(tmp_path, text).processing
    assert [(one.name, one.tow) for one in asked.listeners] == [("one", "one"), ("two", "two")]
    asked = load(tmp_path, text.replace('["tail"]', '["two", "west"]')).processing
    assert [(one.name, one.tow) for one in asked.listeners] == [("two", "two"), ("west", "")]


WRONG = {
    "more processors than beams": (("processors = 2", "processors = 7"), "plan.processing.processors: 7 work at a time, and there are 6 beams"),
    "no processors": (("processors = 2", "processors = 0"), "plan.processing.processors: 0 processors; allowed are 1 to 200"),
    "a sensor without beams": (('["west", "east"]', '["west", "buoy"]'), 'plan.processing.sensors: sensor "buoy" has no beams to choose among'),
    "a sensor that is not there": (('["west", "east"]', '["west", "eats"]'), 'plan.processing.sensors: no sensor "eats"; did you mean "east"?'),
    "no sonar": (('name = "buoy"\nat = "36N 180E"\n[sensor.sonar]\nnoise = "72 dB"', 'name = "buoy"\nat = "36N 180E"\n[sensor.pod]\nfile = "pod.nc"'), 'sensor "buoy" is not a sonar'),
    "towed by nobody": (('["west", "east"]', '["west", "tail"]'), 'where is sensor "tail"? It has no position (at): give a [[tow]]'),
    "a slot that is too long": (('slot = "3 h"', 'slot = "7 h"'), "plan.processing.slot: 7 h is longer than the plan, 6 h from 010400ZJUN26"),
    "slots without end": (('slot = "3 h"', 'slot = "1 min"\ncost = 0\n'), ""),
    "a slot of a second": (('slot = "3 h"', 'slot = "1 s"'), "plan.processing.slot: 1 s; at least 60 s"),
    "twice the same": (('["west", "east"]', '["west", "west"]'), 'two arrays have the name "west"'),
    "a sensor of a processor": (("processors = 2", 'processors = [{ name = "P", sensors = ["north"] }]'), 'processors "P": sensors: no sensor "north"'),
    "hours outside": (("processors = 2", 'processors = [{ name = "P", manned = [["+0 h", "+4 h"]] }]'), 'processors "P": manned: no slot'),
    "two of a name": (("processors = 2", 'processors = [{ name = "P" }, { name = "P" }]'), "two processors have this name"),
    "a beam of today": (('slot = "3 h"', 'slot = "3 h"\ntoday = { west = [4] }'), "plan.processing.today: beams [4] must be numbers from 1 to 3"),
    "today elsewhere": (('slot = "3 h"', 'slot = "3 h"\ntoday = { tail = [1] }'), 'plan.processing.today: no sensor "tail"'),
    "an unknown key": (('slot = "3 h"', 'slots = "3 h"'), 'plan.processing: unknown key "slots"; did you mean "slot"?'),
    "units beside": (("[plan]", '[[unit]]\nname = "A"\nbase = "36N 180E"\nsearch_speed = "90 kn"\nendurance = "4 h"\nsweep_width = "1 nmi"\n[plan]'), "[[unit]] and [plan.processing]"),
}  # fmt: skip


@pytest.mark.parametrize("fault", WRONG)
def test_what_is_refused(tmp_path, fault):
    (old, new), words = WRONG[fault]
    if fault == "no sonar":
        write_pod(tmp_path / "pod.nc")
        text = changed((old, new), ('["west", "east"]', '["west", "buoy"]'))
    else:
        text = changed((old, new))
    if not words:
        assert len(load(tmp_path, text).processing.edges) == 361
        return
    with pytest.raises(UserError) as refused:
        load(tmp_path, text)
    assert len([line for line in refused.value.lines if words in line]) == 1, refused.value.lines


def write_pod(path):
    import xarray as xr

    xr.Dataset(
        {"pod": (("bearing", "range"), np.full((8, 3), 0.5), {"units": "1"})},
        {
            "bearing": ("bearing", np.arange(0.0, 360, 45), {"units": "degrees"}),
            "range": ("range", [0.0, 5000, 10_000], {"units": "m"}),
        },
    ).to_netcdf(path)


def test_processors_that_have_too_few_beams_between_them(tmp_path):
    """Enough beams in all, but not of the sensor that four of them serve."""
    some = ", ".join(f'{{ name = "W{k}", sensors = ["west"] }}' for k in range(4))
    with pytest.raises(
        UserError,
        match=r"plan\.processing\.processors: 4 that work from 010400ZJUN26 on can serve 3 beams",
    ):
        drift.allocate(load(tmp_path, changed(("processors = 2", f"processors = [{some}]"))))
    with pytest.raises(
        UserError, match=r"plan\.processing\.today: 3 beams, for which there are no processors"
    ):
        drift.allocate(
            load(
                tmp_path,
                changed(('slot = "3 h"', 'slot = "3 h"\ntoday = { west = [1, 2], east = [1] }')),
            )
        )


def test_a_case_without_processing_has_nothing_to_allocate(tmp_path):
    with pytest.raises(UserError, match=r"has no \[plan\.processing\] to allocate"):
        drift.allocate(load(tmp_path, CASE[: CASE.index("[plan.processing]")]))


def test_a_check_says_what_will_be_planned(tmp_path) -> None:
    tows = """
[[tow]]
name = "Tail"
sensor = "tail"
base = "35 30N 178E"
transit_speed = "11 kn"
endurance = "5 h"
begin = { polygon = ["35N 178E", "35N 179E", "36N 179E"] }
allowed = { polygon = ["34N 177E", "34N 179E", "37N 179E"] }
courses = [330, 40]
speed = "3 kn"
legs = 1
"""
    manned = CASE.replace(
        "processors = 2",
        'processors = [{ name = "P", sensors = ["west", "east"], manned = [["+4 h", "+7 h"]] }]',
    )
    said = drift.check(load(tmp_path, manned + "cost = 0.01\n" + tows))
    assert said["processing"] == (
        "010400ZJUN26 to 011000ZJUN26, 2 slot(s) of 3 h, 1 processor(s), 1 of 2 slots manned, beams: west 3, east 3, a beam must add 0.01"
    )
    assert said["plan"] == "010400ZJUN26 to 011000ZJUN26, where ships tow their arrays"
    assert said['tow "Tail"'] == (
        'tows "tail" at 3 kn on a leg, from 35-30.0N 178-00.0E at 11 kn, ready 010400ZJUN26, for 5 h, begins in '
        "35-00.0N 178-00.0E - 35-00.0N 179-00.0E - 36-00.0N 179-00.0E, stays in "
        "34-00.0N 177-00.0E - 34-00.0N 179-00.0E - 37-00.0N 179-00.0E, courses 330 to 040"
    )
    alone = drift.check(load(tmp_path))
    assert "plan" not in alone
    assert alone["processing"].endswith("2 processor(s), beams: west 3, east 3")
