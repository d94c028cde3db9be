"""Sub-areas of a plan that are moved by hand: their POS against the plan's own and brute force."""

import json
import math
import tomllib
from pathlib import Path
from typing import Any

import desk_plans
import jsonschema
import numpy as np
import pytest
from desk_plans import CASE, NMI, PARTICLES, RUN

import drift
from drift.apps.serve.answers import plan_answers, process
from drift.apps.serve.routes import search_routes
from drift.case import file as case_file
from drift.case.values import units
from geo.errors import UserError

WIDTHS = {"cutter": 0.7 * NMI, "aircraft": 0.5 * NMI}


DESCRIBED = {"plan": search_routes.PLAN, "plan/pos": search_routes.MOVED_PLAN}


def ask(do: str, **request: Any) -> Any:
    """Return an answer, which is as the description of the interface says."""
    told = json.loads(json.dumps(process.ANSWERS[do](request, lambda phase, share: None)))
    jsonschema.validate(told, DESCRIBED.get(do, {}))
    return told


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("planned")
    desk_plans.write_plan(place)
    plan_answers._kept.clear()
    return place


@pytest.fixture(scope="module")
def planned(folder: Path) -> Any:
    return ask("plan", folder=str(folder), run=RUN)


def moved(folder: Path, moves: Any) -> Any:
    return ask("plan/pos", folder=str(folder), run=RUN, moves=moves)


@pytest.mark.thorough
def test_the_plan_as_its_files_state_it(folder: Path, planned: Any) -> None:
    stated = json.loads((folder / RUN / "plan.json").read_text())
    assert planned["total"] == stated["pos"]
    for area, row in zip(planned["areas"], stated["taskings"], strict=True):
        assert (area["name"], area["unit"], area["pos"]) == (row["area"], row["unit"], row["pos"])
        assert abs(area["track_nmi"] - row["track_nmi"]) < 0.06  # rounded to 0.1
        assert area["start"] == row["on_scene"]


def test_unmoved_areas_have_the_pos_of_the_plan(folder: Path, planned: Any) -> None:
    """The particles are those on which the plan was scored; in a run they go straight for a step.

    In a step of 30 min a random walk of 2 m2/s goes sqrt(2 x 2 x 1800) = 85 m, a tenth of the sweep
    width: a particle's POD changes by about 0.1, at random: 0.1 / sqrt(2000) = 0.002.
    """
    found = moved(folder, {})
    assert abs(found["total"] - planned["total"]) < 3 * 0.002
    assert found["as_planned"] == found["total"]
    for own, area in zip(found["areas"], planned["areas"], strict=True):
        assert abs(own["pos"] - area["pos"]) < 3 * 0.002
        assert own["legs"] == area["legs"]


@pytest.fixture(scope="module")
def tracks(folder: Path) -> Any:
    return desk_plans.positions(folder)


@pytest.mark.thorough
def test_moved_areas_as_by_brute_force(folder: Path, planned: Any, tracks: Any) -> None:
    """Two areas moved and turned: each POS given the failure before it, and both together."""
    first, second = planned["areas"]
    moves = {
        first["name"]: {"at": [first["centre"][0] + 0.03, first["centre"][1] - 0.02], "turned": 35},
        second["name"]: {"at": [second["centre"][0] - 0.02, second["centre"][1]], "turned": -80},
    }
    found = moved(folder, moves)
    left = np.ones(PARTICLES)
    for area in found["areas"]:
        before = left.mean()
        left = left * desk_plans.missed(area, WIDTHS[area["unit"]], *tracks)
        # points of legs are rounded to 1 m, and the integral steps by 230 m of an aircraft's way
        assert abs(area["pos"] - (1 - left.mean() / before)) < 0.006, area["name"]
    assert abs(found["total"] - (1 - left.mean())) < 0.006
    assert found["by_scenario"] == {"raft": pytest.approx(found["total"])}
    assert found["total"] < planned["total"]


def test_a_sub_area_keeps_its_shape(folder: Path, planned: Any) -> None:
    """Lengths and angles stay; all points turn about the centre, clockwise."""
    area = planned["areas"][0]
    to = [area["centre"][0] + 0.4, area["centre"][1] + 0.3]
    own = moved(folder, {area["name"]: {"at": to, "turned": 50}})["areas"][0]

    def relative(one: Any) -> Any:
        x, y = np.array(one["legs"][0]["points"]).T
        lon, lat = one["centre"]
        east = ((x - lon + 180) % 360 - 180) * math.cos(math.radians(lat))
        return (east + 1j * (y - lat)) * desk_plans.METRES

    turned = relative(area) * np.exp(-1j * math.radians(50))
    # in a plane whose scale is that of the centre: half a width off, 5 nmi, is 0.1 % in latitude
    np.testing.assert_allclose(relative(own), turned, atol=30)
    assert own["track_nmi"] == pytest.approx(area["track_nmi"], abs=0.11)


def test_a_unit_that_comes_too_late(folder: Path, planned: Any) -> None:
    """The cutter is sent 40 nmi off: it goes 40 nmi / 14 kn, and what is left of the plan is
    searched."""
    area = next(one for one in planned["areas"] if one["unit"] == "cutter")
    far = [179.5, -41.5 + 40 / 60 + 40 / 60]
    own = next(
        one
        for one in moved(folder, {area["name"]: {"at": far, "turned": 0}})["areas"]
        if one["unit"] == "cutter"
    )
    begin = np.datetime64(own["start"].rstrip("Z"))
    there = np.datetime64("2026-11-21T19:00") + np.timedelta64(80 * 3600 // 14, "s")
    assert abs(begin - there) < np.timedelta64(25, "m")  # its search begins at a corner
    assert np.datetime64(own["end"].rstrip("Z")) <= np.datetime64("2026-11-22T02:00")
    assert "cannot be there before" in own["notes"][0]
    assert ("are left out" in own["notes"][-1]) == (own["track_nmi"] < area["track_nmi"] - 0.2)


def test_a_kept_area_is_searched_as_shown(folder: Path, planned: Any) -> None:
    """The text with the sorties is run: its POS of them is the one that was shown."""
    first, second = planned["areas"]
    moves = {
        second["name"]: {"at": [second["centre"][0] - 0.05, second["centre"][1]], "turned": 205}
    }
    text = CASE
    for area in (first, second):
        told = ask(
            "plan/keep", folder=str(folder), run=RUN, moves=moves, area=area["name"], text=text
        )
        text = told["text"]
        assert tomllib.loads(text)["sortie"][-1]["name"] == told["name"]
    shown = moved(folder, moves)["areas"]
    for row, area in zip(tomllib.loads(text)["sortie"], shown, strict=True):
        begins = units.position(row["pattern"]["corner"])
        off = np.subtract(begins, area["legs"][0]["points"][0])
        assert np.all(np.abs((off + 180) % 360 - 180) < 2e-5)  # 2 m
    again = ask("plan/keep", folder=str(folder), run=RUN, moves={}, area=first["name"], text=text)
    assert again["name"] == f"{first['name']} {first['unit']} (2)"
    case = drift.vary(case_file.load_text(folder / "case.toml", text), {"unit": None, "plan": None})
    updates = drift.run(case).updates.all
    for update, area in zip(updates, shown, strict=True):
        assert abs(float(np.asarray(update.pos)[-1]) - area["pos"]) < 3 * 0.002


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("plan.json", "{", "cannot be read"),
        ("plan.json", "[]", "cannot be read"),
        ("plan.geojson", "{}", "cannot be read"),
        ("plan.toml", "sortie = 5", "cannot be read"),
        ("plan.toml", "", "cannot be read"),
        ("manifest.json", "{}", "holds no plan"),
    ],
)
def test_a_result_that_is_no_plan(folder: Path, name: str, text: str, words: str) -> None:
    path = folder / RUN / name
    before = path.read_bytes()
    try:
        path.write_text(text)
        with pytest.raises(UserError, match=words):
            ask("plan", folder=str(folder), run=RUN)
    finally:
        path.write_bytes(before)


def test_there_is_no_such_sub_area(folder: Path) -> None:
    with pytest.raises(UserError, match="no sub-area 'Z-9'"):
        moved(folder, {"Z-9": {"at": [0, 0], "turned": 0}})
    with pytest.raises(UserError, match="no plan"):
        ask("plan", folder=str(folder), run="elsewhere")
