"""The Stokes drift and leeway lines that include it or not: displacements in closed form, and what
each output says.

In a wind, current and Stokes drift that are the same everywhere, a drifter has a constant velocity
(u, v) east and north. On the sphere lat = lat0 + v t / R, and lon = lon0 + u / v times the
difference of asinh(tan lat), the isometric latitude.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trial_case
import xarray as xr

import drift
from drift.apps.cli import commands
from drift.engine.motion import simulate
from drift.pipeline import run_setup
from geo import sphere
from geo.errors import UserError
from kernels.runtime import runtime

HOURS = 7
FROM = (-88.25, 27.5)
CURRENT = (0.23, np.radians(105))  # [m/s], toward
WIND = (9.0, np.radians(37))
STOKES = (0.11, np.radians(65))
LINES = {"downwind": (0.031, 0.02), "right": (0.012, -0.03), "left": (-0.009, -0.01)}
CLASS = """
[[class]]
name = "BOAT"
text = "An open boat"
downwind = {{ slope = "3.1 %", offset = "2 cm/s", std = "0 cm/s" }}
right = {{ slope = "1.2 %", offset = "-3 cm/s", std = "0 cm/s" }}
left = {{ slope = "-0.9 %", offset = "-1 cm/s", std = "0 cm/s" }}
measured = "{measured}"
source = "Trials off Bodo, 2019"
{more}
"""
NOT_ADDED = "the Stokes drift of [[stokes]] is not added to "


def blowing(speed: float, toward: float) -> dict[str, Any]:
    east, north = (speed * part for part in (np.sin(toward), np.cos(toward)))
    return {"constant": {"east": float(east), "north": float(north)}}


def case_of(
    folder: Path, measured: str = "unknown", more: str = "", waves: bool = True, **tables: Any
) -> drift.Case:
    (folder / "objects.toml").write_text(CLASS.format(measured=measured, more=more))
    scenario = {"object": "boat", "jibe": 0, "position": {"at": list(FROM), "std": 0.0}}
    own = {
        "duration": f"{HOURS} h",
        "current": blowing(*CURRENT),
        "wind": blowing(*WIND),
        "stokes": [blowing(*STOKES)] if waves else None,
        "uncertainty": "none",
        "scenario": scenario,
        "leeway": {"catalogue": "objects.toml"},
    }
    return trial_case.load(folder, **own | tables)


def ends(case: drift.Case) -> np.ndarray:
    """Return the particles' last places [rad], (n, 2)."""
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    list(simulate.run(begin.ensemble, begin.scene, begin.clock, np.empty(0)))
    begin.scene.forcing.close()
    return np.stack(
        [place.to_numpy() * sphere.UNIT for place in (begin.ensemble.lon, begin.ensemble.lat)], -1
    )


def expected(waves: bool) -> np.ndarray:
    """Return the two places [rad] in closed form: to the right and to the left of the wind."""
    places = []
    for side in ("right", "left"):
        along, across = (
            slope * WIND[0] + offset for slope, offset in map(LINES.get, ("downwind", side))
        )  # type: ignore[misc]
        parts = [
            CURRENT,
            (along, WIND[1]),
            (across, WIND[1] + np.pi / 2),
            *([STOKES] if waves else []),
        ]
        u = sum(speed * np.sin(toward) for speed, toward in parts)
        v = sum(speed * np.cos(toward) for speed, toward in parts)
        lon, lat = np.radians(FROM)
        end = lat + v * HOURS * 3600 / sphere.RADIUS
        stretch = np.arcsinh(np.tan(end)) - np.arcsinh(np.tan(lat))
        places.append((lon + u / v * stretch, end))
    return np.array(places)


@pytest.mark.parametrize(
    ("measured", "own", "whole", "added"),
    [
        ("direct", None, None, True),
        ("indirect", None, None, False),
        ("unknown", None, None, False),
        ("estimated", None, None, False),
        ("direct", "inside", None, False),
        ("indirect", "added", None, True),
        ("indirect", None, "added", True),
        ("direct", "added", "inside", False),
    ],
)
def test_displacement_by_the_way_in_which_a_class_was_measured(
    tmp_path: Path, measured: str, own: str | None, whole: str | None, added: bool
) -> None:
    more = f'stokes = "{own}"' if own else ""
    table = {"catalogue": "objects.toml"} | ({"stokes": whole} if whole else {})
    found = ends(case_of(tmp_path, measured, more, leeway=table))
    # float32 velocities over 15 km: 1 mm a term; positions on a lattice of 9 mm, 7 steps of 1 h
    apart = np.abs(found[:, None] - expected(added)[None]).max(axis=2) * sphere.RADIUS
    assert apart.min(axis=1).max() < 0.5
    assert set(apart.argmin(axis=1)) == {0, 1}  # both sides of the wind
    # the other answer is 2.8 km away
    wrong = np.abs(found[:, None] - expected(not added)[None]).max(axis=2) * sphere.RADIUS
    assert wrong.min() > 100


def test_lines_that_include_it_drift_as_without_waves_to_the_bit(tmp_path: Path) -> None:
    np.testing.assert_array_equal(ends(case_of(tmp_path)), ends(case_of(tmp_path, waves=False)))


def test_water_and_windage_move_with_the_waves(tmp_path: Path) -> None:
    for thing in ("water", {"windage": "3 %"}, {"immersion": "60 %"}):
        place = {"position": {"at": list(FROM), "std": 0.0}}
        with_waves, without = (
            ends(case_of(tmp_path, waves=waves, scenario={"object": thing, **place}))
            for waves in (True, False)
        )
        moved = (with_waves - without).mean(axis=0)
        want = np.array([np.sin(STOKES[1]), np.cos(STOKES[1])]) * STOKES[0] * HOURS * 3600
        # metres on the sphere; the cosine is that of the start, 0.3 % off after 15 km
        scale = sphere.RADIUS * np.array([np.cos(np.radians(FROM[1])), 1.0])
        np.testing.assert_allclose(moved * scale, want, rtol=5e-3)


def test_water_has_no_lines_that_could_include_it(tmp_path: Path) -> None:
    case = case_of(tmp_path, leeway={"stokes": "inside"}, scenario={"object": "water"})
    assert case.scenarios[0].object.stokes == "added"
    case = case_of(tmp_path, leeway={"stokes": "inside"}, scenario={"object": {"windage": 0.03}})
    assert case.scenarios[0].object.stokes == "inside"


def test_a_marker_buoy_without_lines_moves_with_the_waves(tmp_path: Path) -> None:
    case = case_of(tmp_path, scenario={"object": "SLDMB"})
    assert case.scenarios[0].object.stokes == "added"


def test_every_output_says_that_it_is_not_added(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case, out = case_of(tmp_path), tmp_path / "out"
    words = f"{NOT_ADDED}BOAT"
    assert commands.main(["check", str(case.path)]) == 0
    assert words in " ".join(capsys.readouterr().out.split())
    assert commands.main(["run", str(case.path), "--out", str(out)]) == 0
    assert words in " ".join(capsys.readouterr().out.split())
    summary = json.loads((out / "summary.json").read_text())
    assert [line.startswith(words) for line in summary["warnings"]].count(True) == 1
    (told,) = summary["leeway"]
    assert (told["name"], told["measured"], told["stokes"]) == ("BOAT", "unknown", "inside")
    assert told["source"] == "Trials off Bodo, 2019"
    with xr.open_dataset(out / "forecast.nc") as data:
        assert words in data.attrs["warning"]
    assert words in json.loads((out / "contours.geojson").read_text())["warning"]
    report = (out / "report.html").read_text()
    assert "is not added to BOAT" in report
    assert "Trials off Bodo, 2019" in report


@pytest.mark.parametrize(
    "tables",
    [
        {"leeway": {"catalogue": "objects.toml", "stokes": "added"}},  # the remedy that it names
        {"scenario": {"object": "BOAT", "stokes": []}},  # the scenario leaves waves out itself
        {"stokes": None},
        {"scenario": {"object": "CONTAINER-2"}},
        {"scenario": {"object": "water"}},
    ],
)
def test_nothing_is_said_where_it_is_added_or_there_is_none(
    tmp_path: Path, tables: dict[str, Any]
) -> None:
    told = drift.check(case_of(tmp_path, **tables))
    assert not any(NOT_ADDED in text for text in told.values())


def test_containers_without_waves_are_told_to_lack_them(tmp_path: Path) -> None:
    box = {"scenario": {"object": "CONTAINER-2"}}
    words = "its lines leave out the Stokes drift: add [[stokes]]"
    assert words in drift.check(case_of(tmp_path, waves=False, **box))['scenario "raft"']
    assert words not in drift.check(case_of(tmp_path, **box))['scenario "raft"']


@pytest.mark.thorough
def test_a_buoy_drifts_with_waves_that_lines_of_the_object_include(tmp_path: Path) -> None:
    where = run_setup.open_for(case_of(tmp_path))
    assert where.scenarios[0].of("stokes") == ()
    assert [source.name for source in where.water[0].of("stokes")] == ["stokes 1"]
    # a buoy that moves exactly with current and Stokes drift shows no error of the current
    u, v = (
        sum(speed * turn(toward) for speed, toward in (CURRENT, STOKES))
        for turn in (np.sin, np.cos)
    )
    hours = np.arange(6)
    lat = FROM[1] + np.degrees(v * hours * 3600 / sphere.RADIUS)
    lon = FROM[0] + np.degrees(u * hours * 3600 / sphere.RADIUS) / np.cos(np.radians(FROM[1]))
    rows = [
        f"2026-11-21T{hour:02}:00:00Z,{x:.7f},{y:.7f}"
        for hour, x, y in zip(hours, lon, lat, strict=True)
    ]
    (tmp_path / "buoy.csv").write_text("\n".join(["time,lon,lat", *rows]) + "\n")
    case = case_of(
        tmp_path,
        uncertainty={"current": {"std": "0.2 m/s", "time": "9 h", "length": "20 km"}},
        drifter=[{"track": "buoy.csv", "error": "20 m"}],
    )
    (shown,) = drift.run(case).summary["drifters"]["buoys"]
    # without the waves it would be 0.11 m/s; fixes of 20 m over 5 h show 2 mm/s, the cosine 1 mm/s
    assert shown["excess_m_s"] < 0.005


@pytest.mark.thorough
def test_a_change_to_an_object_of_the_other_kind_is_refused_with_a_remedy_that_works(
    tmp_path: Path,
) -> None:
    change = {"name": "box", "rate": "0.1/h", "object": "CONTAINER-2"}
    raft = {"object": "BOAT", "change": [change]}
    with pytest.raises(UserError) as refused:
        case_of(tmp_path, scenario=raft)
    (line,) = refused.value.lines
    assert (
        'scenario "raft".change "box": the Stokes drift is not in the lines of CONTAINER-2' in line
    )
    remedy = {"catalogue": "objects.toml", "stokes": "added"}
    assert case_of(tmp_path, scenario=raft, leeway=remedy).scenarios[0].changes
    same = {"object": "BOAT", "change": [{**change, "object": "PANGA"}]}
    case = case_of(tmp_path, scenario=same)
    told = drift.check(case)
    assert f"{NOT_ADDED}BOAT, PANGA:" in told["leeway, note 1"]
    assert told["leeway, note 2"].startswith("object PANGA: ")


def test_debris_of_the_other_kind_is_refused_with_a_remedy_that_works(tmp_path: Path) -> None:
    found = {
        "time": "+5 h",
        "position": {"at": list(FROM), "error": "10 nmi"},
        "of": "water",
        "name": "oar",
    }
    with pytest.raises(UserError) as refused:
        case_of(tmp_path, contact=[found])
    (line,) = refused.value.lines
    assert 'contact "oar".of: the Stokes drift is not in the lines of water, and in the' in line
    assert 'give leeway.stokes = "added"' in line
    remedy = {"catalogue": "objects.toml", "stokes": "added"}
    assert case_of(tmp_path, contact=[found], leeway=remedy).contacts
    assert case_of(tmp_path, contact=[found], waves=False).contacts
    assert case_of(tmp_path, contact=[{**found, "of": "PIW-1"}]).contacts
