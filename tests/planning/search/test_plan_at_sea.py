"""A plan with a boat behind an island: its way, its cut legs and its POS as its files tell them."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from plans import few_trials  # noqa: F401 (a fixture)

import drift
from drift.case.record import Case
from drift.planning.search import planner
from drift.planning.search.boats import courses
from drift.planning.search.products import subareas, unit_sheet
from drift.planning.search.records import Plan
from drift.products.maps.imprint import Imprint
from geo.box import Box
from geo.coast import shore
from geo.errors import UserError

pytestmark = pytest.mark.usefixtures("few_trials")

CASE = """
title = "A boat behind an island"
start = "2026-06-01T06:00Z"
duration = "6 h"
particles = 4000
[output]
every = "6 h"
[clock]
step = "30 min"
[coast]
source = "islands.geojson"
[[current]]
constant = { speed = "0.3 kn", toward = 70 }
[uncertainty]
diffusivity = "10 m2/s"
[[scenario]]
name = "water"
object = "water"
position = { at = [179.93, 20.0], std = "1.2 nmi" }
[plan]
particles = 2000
[[unit]]
name = "plane"
kind = "Aircraft"
base = [179.2, 20.3]
search_speed = "120 kn"
endurance = "0.4 h"
daylight = false
sweep_width = "0.5 nmi"
[[unit]]
name = "boat"
kind = "Boat"
base = [179.786, 20.02]
search_speed = "12 kn"
transit_speed = "20 kn"
endurance = "3 h"
daylight = false
sweep_width = "0.5 nmi"
"""
# A bay that opens to the west, in which the boat lies, and islets where the object may be
BAY = [(179.74, 19.95), (179.82, 19.95), (179.82, 20.09), (179.74, 20.09), (179.74, 20.07), (179.80, 20.07), (179.80, 19.97), (179.74, 19.97)]  # fmt: skip
ISLETS = [(179.93, 20.005), (179.962, 19.985), (179.945, 20.03), (179.915, 19.98), (179.992, 20.02)]


def place(folder: Path, text: str = CASE) -> Case:
    """Return the case in a folder, with its coast."""
    rings = [
        BAY,
        *(
            [(x + 0.006 * math.cos(a), y + 0.004 * math.sin(a)) for a in np.arange(7) * 0.9]
            for x, y in ISLETS
        ),
    ]
    features = [
        {
            "type": "Feature",
            "properties": {},
            "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]},
        }
        for ring in rings
    ]
    (folder / "islands.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": features})
    )
    (folder / "boat.toml").write_text(text)
    return drift.load(folder / "boat.toml")


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory, few_trials: None) -> tuple[Path, Plan]:  # noqa: F811
    """The plan and the folder of its files."""
    folder = tmp_path_factory.mktemp("boat")
    made, _ = planner.plan(place(folder), folder / "out")
    return folder, made


def one(made: Plan, name: str) -> drift.planning.search.records.Tasking:
    return next(task for task in made.taskings if task.unit.name == name)


@pytest.mark.thorough
def test_a_boat_goes_round_and_an_aircraft_over(planned: tuple[Path, Plan]) -> None:
    folder, made = planned
    boat, plane = one(made, "boat"), one(made, "plane")
    assert (plane.out, plane.back, plane.cut) == ((), (), ())
    land = shore.read_land(folder / "islands.geojson", Box(179.0, 19.5, 181.0, 20.6)).polygons
    assert boat.out[0] == pytest.approx(boat.unit.base)
    legs = boat.sortie.legs
    assert legs is not None
    for way in (boat.out, boat.back, tuple(zip(legs.lon, legs.lat, strict=True))):
        assert courses.on_land(land, *np.array(way).T) == 0
    for told, way, straight in subareas.by_sea(boat):
        assert way > straight + 5000, told  # out of the bay first
    # times are those of its way at transit speed, its legs at search speed
    (_, out, _), (_, back, _) = subareas.by_sea(boat)
    sail = (boat.on_scene - boat.takeoff) / np.timedelta64(1, "s")
    assert out / boat.unit.transit_speed == pytest.approx(sail, abs=1.01)
    assert back / boat.unit.transit_speed == pytest.approx(
        (boat.home - boat.off_scene) / np.timedelta64(1, "s"), abs=1.01
    )
    # 85 % of its endurance, ways round included
    assert legs.time[-1] - legs.time[0] <= 0.85 * boat.unit.endurance
    assert boat.takeoff >= made.spec.begin
    assert boat.off_scene <= made.spec.until


@pytest.mark.thorough
def test_what_is_told_is_what_is_scored(planned: tuple[Path, Plan]) -> None:
    folder, made = planned
    boat = one(made, "boat")
    assert boat.cut, "the case is made so that islets lie across its legs"
    assert boat.sortie.legs is not None
    assert not all(boat.sortie.legs.searching)
    executed = folder / "executed.toml"
    executed.write_text(CASE + "\n" + (folder / "out/plan.toml").read_text())
    again = drift.run(drift.load(executed))
    assert again.updates is not None
    evidence = sum(update.log_evidence[-1] for update in again.updates.all)
    assert 1 - math.exp(evidence) == pytest.approx(made.pos, abs=3e-4)
    # Searching what it only passes would find more
    text = (folder / "out/plan.toml").read_text()
    assert text.count("transit_legs = [") == 1
    whole = folder / "whole.toml"
    whole.write_text(
        CASE
        + "\n"
        + "\n".join(
            line for line in text.splitlines() if not line.startswith("transit_legs")
        ).replace('speed = "12 kn"', 'speed = "24 kn"')
    )
    more = drift.run(drift.load(whole))
    assert more.updates is not None
    assert sum(update.log_evidence[-1] for update in more.updates.all) < evidence - 1e-3


@pytest.mark.thorough
def test_files_and_sheets_carry_the_way(planned: tuple[Path, Plan]) -> None:
    folder, made = planned
    boat, out = one(made, "boat"), folder / "out"
    text = (out / "plan.txt").read_text()
    assert "nmi by sea" in text
    assert "Cut legs" in text
    assert " in pieces of up to " in text
    assert "check each way on a chart" in " ".join(text.split())
    told = next(
        task
        for task in json.loads((out / "plan.json").read_text())["taskings"]
        if task["unit"] == "boat"
    )
    assert told["legs_cut"] == list(boat.cut)
    assert told["transit"][0]["by_sea_nmi"] > told["transit"][0]["straight_nmi"]
    _, _, lines, columns = pyogrio.raw.read(out / "plan.gpx", layer="routes")
    route = shapely.from_wkb(lines)[[name.endswith("boat") for name in columns[0]].index(True)]
    points = shapely.get_coordinates(route)
    points[:, 0] %= 360
    legs = boat.sortie.legs
    assert legs is not None
    want = np.concatenate(
        [np.array(boat.out)[:-1], np.column_stack([legs.lon, legs.lat]), np.array(boat.back)[1:]]
    )
    want[:, 0] %= 360
    np.testing.assert_allclose(points, want, atol=1e-6)
    shapes = {f["properties"]["shape"]: f["geometry"] for f in json.loads((out / "plan.geojson").read_text())["features"]
              if f["properties"]["unit"] == "boat"}  # fmt: skip
    for shape, seeks in (("legs", True), ("round", False)):
        lines = shapely.get_coordinates(shapely.from_geojson(json.dumps(shapes[shape])))
        mine = np.array(legs.searching) == seeks
        ends = np.column_stack([legs.lon, legs.lat])[:-1][mine]
        assert np.all(
            np.abs(
                (lines[None, :, 0] - ends[:, None, 0] + 180) % 360
                - 180
                + 1j * (lines[None, :, 1] - ends[:, None, 1])
            ).min(axis=1)
            < 2e-7
        )
    way = subareas.route("A-1", boat)
    assert np.all(np.diff([point.time for point in way]) >= np.timedelta64(0, "s"))
    assert len({point.name for point in way}) == len(way)
    sheets = [name for name, _, _ in unit_sheet.pages(made)]
    assert sheets == ["plan-A-1.png", "plan-A-2.png"]
    assert all((out / name).stat().st_size > 20_000 for name in sheets)


@pytest.mark.thorough
def test_a_long_search_goes_on_on_further_pages(planned: tuple[Path, Plan], tmp_path: Path) -> None:
    _, made = planned
    boat = one(made, "boat")
    legs = boat.sortie.legs
    assert legs is not None
    many = 300
    time = tuple(legs.time[0] + 10.0 * k for k in range(many))
    turns = (
        [legs.lon[0] + 0.01 * (k % 2) for k in range(many)],
        [legs.lat[0] + 1e-4 * k for k in range(many)],
    )
    long = replace(
        legs, time=time, lon=tuple(turns[0]), lat=tuple(turns[1]), searching=(True,) * (many - 1)
    )
    plan = replace(made, taskings=(replace(boat, sortie=replace(boat.sortie, legs=long)),))
    names = unit_sheet.pages(plan)
    assert [name for name, _, _ in names] == ["plan-A-1.png", "plan-A-1-2.png"]
    unit_sheet.plot_unit_sheet(plan, 0, tmp_path / "two.png", imprint=Imprint("t"), number=2)
    assert (tmp_path / "two.png").stat().st_size > 20_000


@pytest.mark.thorough
def test_a_boat_that_cannot_get_there_is_said_by_name(tmp_path: Path) -> None:
    walled = CASE.replace('source = "islands.geojson"', 'source = "wall.geojson"')
    ring = [(178.9, 19.0), (179.88, 19.0), (179.88, 21.0), (178.9, 21.0)]
    feature = {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]},
    }
    (tmp_path / "wall.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": [feature]})
    )
    few = walled.replace("particles = 4000", "particles = 1000").replace(
        "particles = 2000", "particles = 1000"
    )
    made, _ = planner.plan(place(tmp_path, few))
    assert made.idle == ("boat",)
    assert any(
        words.startswith("boat is not sent: no route by sea leads from 20-01.2N 179-47.2E")
        for words in made.said
    )


def test_keys_of_boats_are_refused_of_what_flies(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r'unit "plane".*clear_of_land applies only to boats'):
        place(
            tmp_path,
            CASE.replace('endurance = "0.4 h"', 'endurance = "0.4 h"\nclear_of_land = "1 nmi"'),
        )


def test_legs_that_do_not_search_are_named_by_number(tmp_path: Path) -> None:
    sortie = """
[[sortie]]
name = "round"
start = "+0 h"
speed = "10 kn"
sweep_width = "0.5 nmi"
waypoints = [[179.9, 20.0], [179.95, 20.02], [179.96, 20.05], [179.9, 20.06]]
transit_legs = [2]
"""
    (flown,) = place(tmp_path, CASE + sortie).sorties
    assert flown.legs is not None
    assert flown.legs.searching == (True, False, True)
    for wrong in ("[4]", "[0]", "[1, 2, 3]", "[]"):
        with pytest.raises(
            UserError, match="must list some of its 3 legs by number, from 1, and not all of them"
        ):
            place(tmp_path, CASE + sortie.replace("[2]", wrong))
    with pytest.raises(UserError, match="give them with waypoints"):
        place(
            tmp_path,
            CASE
            + sortie.replace(
                "waypoints = ", 'pattern = { kind = "trackline", waypoints = '
            ).replace("]]\ntr", "]] }\ntr"),
        )
