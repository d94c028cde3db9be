"""`drift plan` of ships that tow arrays: from a case to the files of a plan, and what is refused."""

import json
import tomllib

import numpy as np
import pytest

import drift
from geo import sphere
from geo.errors import UserError

CASE = """
title = "towed"
start = "2026-06-01T00:00Z"
duration = "20 h"
particles = 4000
seed = 3
[output]
times = ["+20 h"]
[coast]
source = "none"
[[scenario]]
name = "quiet"
weight = 0.4
source_level = "141 dB"
position = { at = "36N 179 40W", std = "25 nmi" }
[[scenario.phase]]
course = { course = [40, 80], speed = ["3 kn", "8 kn"] }
[[scenario]]
name = "loud"
source_level = [["3 kn", "139 dB"], ["12 kn", "150 dB"]]
position = { at = "35 20N 179 30E", std = "30 nmi" }
[[scenario.phase]]
course = { course = [200, 250], speed = ["6 kn", "12 kn"] }
[[sensor]]
name = "line"
[sensor.sonar]
loss = { transition = "8 km", frequency = "50 Hz", zones = [["27 nmi", "33 nmi", "10 dB"]], to = "100 nmi" }
noise = "72 dB"
gain = { line = { elements = 12, spacing = "15 m", frequency = "50 Hz" } }
threshold = "8 dB"
[[tow]]
name = "one"
sensor = "line"
begin = { centre = "36N 179 50W", length = "100 nmi", width = "70 nmi", orientation = 30 }
speed = "4 kn"
courses = [300, 120]
[[tow]]
name = "two"
sensor = "line"
begin = { polygon = ["36N 179E", "36N 179 30W", "34 30N 179 30W", "34 30N 179E"] }
base = "37N 179E"
transit_speed = "16 kn"
speed = "4 kn"
legs = 1
endurance = "8 h"
[plan]
begin = "+4 h"
particles = 4000
"""


def load(folder, text=CASE):
    path = folder / "towed.toml"
    path.write_text(text)
    return drift.load(path)


@pytest.mark.thorough
@pytest.mark.parametrize("planned", [1000, pytest.param(4000, marks=pytest.mark.thorough)])
def test_a_plan_is_worth_what_its_watches_hear(tmp_path, planned):
    of = CASE.replace("\nparticles = 4000\n", f"\nparticles = {planned}\n")
    case = load(tmp_path, of)
    plan, _ = drift.place(case, tmp_path / "out")
    told = json.loads((tmp_path / "out" / "arrays.json").read_text())
    assert told["pod"] == plan.pos
    # Another sample of particles than that on which it was made: both have a standard error.
    error = np.hypot(
        plan.placement.standard_error, np.sqrt(plan.pos * (1 - plan.pos) / case.particles)
    )
    assert plan.pos == pytest.approx(plan.placement.value, abs=3 * error)
    assert all(value <= plan.placement.value + 1e-9 for _, value in plan.placement.alternatives)
    assert plan.bound.plan <= plan.bound.value
    # The watches appended to the case, as if they had been kept, leave the same.
    kept = load(tmp_path, of + (tmp_path / "out" / "arrays.toml").read_text())
    result = drift.run(kept)
    missed = np.prod([1 - np.asarray(update.pos)[-1] for update in result.updates.all])
    # of places rounded to a metre and times to a second
    assert 1 - missed == pytest.approx(plan.pos, abs=2e-3)
    two = next(sortie for sortie in plan.sorties if sortie.name.startswith("two"))
    far = sphere.distance(*np.radians([179.0, 37.0, two.legs.lon[0], two.legs.lat[0]]))
    begun = (two.start - case.plan.begin) / np.timedelta64(1, "s")
    assert begun == pytest.approx(far / (16 * 1852 / 3600), abs=2)
    assert two.end - two.start <= np.timedelta64(8, "h")
    assert {"arrays.txt", "arrays.png", "arrays.toml", "arrays.json"} <= {
        path.name for path in (tmp_path / "out").iterdir()
    }
    tomllib.loads((tmp_path / "out" / "arrays.toml").read_text())


WRONG = {
    "an unknown sensor": (('sensor = "line"\nbegin = { centre', 'sensor = "lime"\nbegin = { centre'), 'tow "one": no sensor "lime"; did you mean "line"?'),
    "a sensor that stands": (('name = "line"', 'name = "line"\nat = "36N 170W"\nheading = 0'), "has a fixed position"),
    "courses of one": (("courses = [300, 120]", "courses = [300]"), "must be [from, to]"),
    "a course beyond": (("courses = [300, 120]", "courses = [300, 420]"), "0 to 360 degrees"),
    "three legs": (("legs = 1", "legs = 3"), "legs"),
    "a ship that stands": (('speed = "4 kn"\ncourses', 'speed = "0.1 kn"\ncourses'), "too slow to tow"),
    "transit from nowhere": (('base = "37N 179E"\n', ""), "give base"),
    "ready too late": (('endurance = "8 h"', 'ready = "+20 h"'), "not before the plan's end"),
    "units beside": (("[plan]", '[[unit]]\nname = "A"\nbase = "36N 180E"\nsearch_speed = "90 kn"\nendurance = "4 h"\nsweep_width = "1 nmi"\n[plan]'), "plan one"),
}  # fmt: skip


@pytest.mark.parametrize("fault", WRONG)
def test_what_is_refused_of_a_tow(tmp_path, fault):
    (old, new), words = WRONG[fault]
    assert CASE.count(old) == 1
    with pytest.raises(UserError) as refused:
        load(tmp_path, CASE.replace(old, new))
    assert (
        any(words in line for line in refused.value.lines)
        if hasattr(refused.value, "lines")
        else words in str(refused.value)
    )


def test_a_case_without_ships_has_nothing_to_place(tmp_path):
    text = CASE[: CASE.index("[[tow]]")] + CASE[CASE.index("[plan]") :]
    with pytest.raises(UserError, match=r"has no \[\[tow\]\]"):
        drift.place(load(tmp_path, text))


@pytest.mark.thorough
def test_a_ship_without_a_way_is_named(tmp_path):
    text = CASE.replace(
        'speed = "4 kn"\ncourses',
        'allowed = { polygon = ["10N 10W", "10N 9W", "9N 9W"] }\nspeed = "4 kn"\ncourses',
    )
    with pytest.raises(UserError, match='tow "one": one has no track'):
        drift.place(load(tmp_path, text))
