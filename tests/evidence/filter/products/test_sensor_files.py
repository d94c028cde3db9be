"""What a run with sensors and lines writes: tables, shapes for a GIS, pictures; and the words about
it.
"""

import csv
import io
import json
import math
from pathlib import Path

import numpy as np
import pyproj
import pytest
from PIL import Image

import drift
from drift.apps.check import check
from drift.apps.cli import outcome
from drift.case import file as case_file
from drift.evidence.filter import crossings
from drift.evidence.filter import shapes as search_shapes
from drift.evidence.filter.products import layers, report
from drift.evidence.filter.records import Line
from drift.pipeline import run_setup
from geo import sphere

NMI = 1852.0
GEOD = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS)
CASE = """
title = "picket in the sound"
start = "2026-11-21T00:00Z"
duration = "9 h"
particles = 3000
output.every = "3 h"
[clock]
step = "90 min"
[coast]
source = "none"
[[current]]
constant = { speed = "1.1 kn", toward = 58 }
[uncertainty]
diffusivity = "700 m2/s"
[[scenario]]
name = "raft"
object = "water"
weight = 0.7
position = { at = [-179.95, 51.3], std = "3 nmi" }
[[scenario]]
name = "later"
object = "water"
weight = 0.3
position = { at = [179.85, 51.2], std = "5 nmi", time = "+1 h", until = "+4 h" }
"""
LINES = """
[[line]]
name = "sound"
points = [[-179.75, 51.6], [-179.8, 51.1]]
[[line]]
name = "far away"
points = [[-170.0, 51.6], [-170.1, 51.1]]
"""
SENSORS = """
[[look]]
name = "dip"
time = "+2.2 h"
at = [-179.9, 51.4]
width = "7 nmi"
height = "3 nmi"
turned = 25
sees = "nothing"
[[presence]]
name = "buoys"
start = "+3 h"
end = "+5.3 h"
at = [179.97, 51.25]
radius = "4 nmi"
present = "never"
detection = 0.9
[[barrier]]
name = "picket"
points = [[-179.9, 51.55], [179.97, 51.3], [-179.95, 51.0]]
start = "+1 h"
end = "+8 h"
detection = 0.6
reported = "+4.4 h"
error = "50 min"
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return (case, result, folder) of a run with everything."""
    folder = tmp_path_factory.mktemp("sensors")
    (folder / "case.toml").write_text(CASE + SENSORS + LINES)
    case = drift.load(folder / "case.toml")
    return case, drift.run(case, folder / "out"), folder / "out"


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.thorough
def test_the_table_of_updates_names_sensors(written) -> None:
    """In the order in which they took effect, with the posterior that Bayes makes of their
    evidence.
    """
    found = rows(written[2] / "sorties.csv")
    assert [(row["name"], row["kind"]) for row in found[::3]] == [
        ("dip", "look"),
        ("buoys", "presence"),
        ("picket", "barrier"),
    ]
    for raft, later, _ in zip(found[::3], found[1::3], found[2::3], strict=True):
        odds = math.exp(float(raft["log_evidence"]) - float(later["log_evidence"]))
        before, now = (float(raft[key]) / float(later[key]) for key in ("prior", "posterior"))
        assert now == pytest.approx(before * odds, rel=1e-4)
        assert raft["pod"] == raft["pos"] == ""


@pytest.mark.thorough
def test_the_table_of_lines_is_that_of_the_summary(written) -> None:
    found = rows(written[2] / "lines.csv")
    summary = json.loads((written[2] / "summary.json").read_text())
    assert [(row["line"], row["scenario"]) for row in found] == [
        (line, scenario) for line in ("sound", "far away") for scenario in ("raft", "later", "all")
    ]
    told = summary["search"]["lines"]
    assert float(found[2]["probability"]) == pytest.approx(told[0]["probability"]["all"], rel=1e-5)
    assert 0.1 < float(found[2]["probability"]) < 0.99
    assert (
        found[0]["first_05"] < found[0]["first_50"] < found[0]["first_95"] <= "2026-11-21T09:00:00Z"
    )
    assert found[2]["first_50"] == told[0]["first"]["50 %"]
    assert found[5]["probability"] == "0"
    assert found[5]["first_50"] == ""
    assert told[1]["first"]["5 %"] is None


@pytest.mark.thorough
def test_every_shape_is_in_one_layer_of_the_report(written) -> None:
    case, result, folder = written
    layers_of = [
        leaf["where"]
        for leaf in report.search_leaves(result.updates, (), (), case.sensors)
        if leaf["leaf"] == "shapes"
    ]
    for feature in json.loads((folder / "sorties.geojson").read_text())["features"]:
        own = feature["properties"]
        held = [
            all(own[key] == value or own[key] in value for key, value in where.items())
            for where in layers_of
        ]
        assert sum(held) == 1, own["name"]


@pytest.mark.thorough
def test_shapes_are_as_large_as_they_are_said_to_be(written) -> None:
    """Areas and lengths by geodesics, across the antimeridian."""
    made = json.loads((written[2] / "sorties.geojson").read_text())["features"]
    by_name = {feature["properties"]["name"]: feature for feature in made}
    assert {name: f["properties"]["shape"] for name, f in by_name.items()} == {
        "dip": "field", "buoys": "field", "picket": "line", "sound": "line", "far away": "line",
    }  # fmt: skip
    sensors = written[0].sensors
    sizes = {"dip": 21.0, "buoys": 16 * math.pi}
    for what in (*sensors.looks, *sensors.presences):
        points = search_shapes.sensor(what)
        area, _ = GEOD.polygon_area_perimeter(*points.T)
        assert abs(area) / NMI**2 == pytest.approx(sizes[what.name], rel=2e-3)
    points = search_shapes.sensor(sensors.barriers[0])
    exact = GEOD.line_length(*np.array(sensors.barriers[0].points).T)
    assert GEOD.line_length(*points.T) == pytest.approx(exact, rel=1e-6)
    assert by_name["picket"]["properties"]["reported"] == "2026-11-21T04:24:00Z"
    assert by_name["dip"]["properties"]["log_evidence"] < 0
    assert by_name["sound"]["properties"]["probability"] > 0.1
    for feature in made:
        for part in feature["geometry"]["coordinates"]:
            ring = np.array(part[0] if feature["geometry"]["type"] == "MultiPolygon" else part)
            assert np.ptp(ring[:, 0]) < 180


def test_pictures_are_drawn(written) -> None:
    """What has begun is on a map, and each sort has a row of the legend; a picture of few particles
    has room for a banner.
    """
    assert written[1].updates.all[-1].ess_after < 200
    for name in ("lines.png", "evidence.png", "map.png"):
        with Image.open(written[2] / name) as picture:
            assert len(picture.convert("L").getcolors()) > 20
            assert name != "lines.png" or picture.size == (1680, 588 + 38)
    sensors, begin = written[0].sensors, written[0].start
    at = [layers.begun_sensors(sensors, begin + np.timedelta64(h, "h")) for h in (0, 2, 4)]
    assert [[what.name for what in seen] for seen in at] == [
        ["sound", "far away"],
        ["picket", "sound", "far away"],
        ["dip", "buoys", "picket", "sound", "far away"],
    ]
    assert [words for _, words in layers.sensor_key(at[2])] == [
        "Field, nothing there",
        "Barrier, reported",
        "Line asked about",
    ]
    assert set(layers.sensor_places(at[2])) == {
        'look "dip"',
        'presence "buoys"',
        'barrier "picket"',
    }


@pytest.mark.thorough
def test_lines_alone_make_no_search(tmp_path) -> None:
    """Their files, and none of sorties and evidence."""
    (tmp_path / "case.toml").write_text(CASE + LINES)
    result = drift.run(drift.load(tmp_path / "case.toml"), tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"lines.csv", "lines.png"} < names
    assert not names & {"sorties.csv", "sorties.geojson", "evidence.png", "search.png"}
    assert result.updates.crossings.all[0].line.name == "sound"
    with Image.open(tmp_path / "out" / "lines.png") as picture:
        assert picture.size == (1680, 588)
    words = outcome.forecast(json.loads((tmp_path / "out" / "summary.json").read_text()))
    assert words['line "sound"'].startswith("crossed with ")


def test_a_check_says_how_sensors_were_understood(written) -> None:
    case = written[0]
    where = run_setup.open_for(case)
    begin = run_setup.prepare(case, where)
    begin.scene.forcing.close()
    lines = check._search(case)
    assert (
        lines['look "dip"']
        == "7 by 3 nmi about 51-24.0N 179-54.0W, 210212ZNOV26, cookie cutter, sees nothing"
    )
    assert lines['barrier "picket"'].endswith("detection 0.6, reports 210424ZNOV26")
    assert lines['line "sound"'] == "2 points; its first crossing is reported"


def test_a_line_without_first_crossings_has_no_times() -> None:
    never, none = np.full((2, 3), "NaT", "datetime64[s]"), np.zeros(2)
    bar = Line("bar", ((0.0, 0.0), (1.0, 0.0)))
    crossing = crossings.Crossing(bar, none, none, never, np.zeros((2, crossings.BINS)))
    found = crossings.Crossings(("a",), np.empty(0, "datetime64[s]"), (crossing,))
    head, *rows = csv.reader(io.StringIO(crossings.csv(found, "r")))
    times = [k for k, name in enumerate(head) if name.startswith(("first_", "date_time_group_"))]
    assert [row[:4] for row in rows] == [["bar", name, "0", "0"] for name in ("a", "all")]
    assert len(times) == 6
    assert all(row[k] == "" for row in rows for k in times)


@pytest.mark.thorough
def test_a_plan_begins_after_sensors(tmp_path) -> None:
    """And is scored on what they left."""
    unit = """
[[unit]]
name = "boat"
base = [179.9, 51.3]
search_speed = "60 kn"
endurance = "1 h"
daylight = false
sweep_width = "1 nmi"
[plan]
particles = 1000
"""
    (tmp_path / "case.toml").write_text(
        CASE + SENSORS.replace('end = "+8 h"', 'end = "+6.5 h"') + unit
    )
    case = case_file.load(tmp_path / "case.toml")
    plan, result = drift.plan(case)
    assert case.plan.begin == case.start + np.timedelta64(390, "m")
    assert [update.kind for update in result.updates.all] == [
        "look",
        "presence",
        "barrier",
        "sortie",
    ]
    assert plan.pos == pytest.approx(float(result.updates.all[-1].pos[-1]))
