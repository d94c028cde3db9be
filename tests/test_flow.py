"""The whole flow: the same bits on any number of threads, backward as forward, accounts that add
up, no one inland.
"""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trial_case
from one_thread import Process

import drift
from drift.engine.particles.status import Status
from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast import shore


def case_of(folder: Path, wind_from: int = 200, std: str = "1 nmi", **changes: Any) -> drift.Case:
    """Return a case with a reported wind, of which 3 % drive the raft."""
    wind = {
        "table": [
            {"time": "211200ZNOV26", "speed": "10 kn", "from": wind_from},
            {"time": "231800ZNOV26", "speed": "20 kn", "from": wind_from},
        ]
    }
    at, windage = changes.pop("at", "27 30N 088 00W"), changes.pop("windage", "3 %")
    plain = {
        "start": "211830ZNOV26",
        "duration": "12 h",
        "particles": 4000,
        "output": {"every": "3 h"},
        "wind": wind,
        "scenario": {"object": {"windage": windage}, "position": {"at": at, "std": std}},
    }
    return trial_case.load(folder, **{**plain, **changes})


ONE = """
import pickle
import drift
case = drift.load("overdue_boat", dict(one.split("=", 1) for one in given[1:]))
data = drift.run(case, threads=1).forecast.data
with open(given[0], "wb") as file:
    pickle.dump({name: data[name].values for name in data.variables}, file)
"""


@pytest.mark.thorough
def test_one_thread_gives_the_bits_of_all(one_thread: Process, tmp_path: Path) -> None:
    """The default case, smaller; one thread in a process of its own, since a process keeps its
    threads.
    """
    smaller = ("particles=8_000", "duration='18 h'", "sortie=[]", "unit=[]", "plan={}")
    one_thread.ask(ONE, str(tmp_path / "one"), *smaller)
    one = pickle.loads((tmp_path / "one").read_bytes())
    two = drift.run(
        drift.load("overdue_boat", dict(one.split("=", 1) for one in smaller))
    ).forecast.data
    assert set(one) == set(two.variables)
    for name, values in one.items():
        assert bits(values) == bits(two[name].values), name


def bits(values: np.ndarray) -> bytes:
    # of texts, no addresses
    return (values.astype(str) if values.dtype == object else values).tobytes()


def test_reported_wind_and_current_need_no_file_and_move_as_they_should(tmp_path: Path) -> None:
    """Current 0.257 m/s east; 3 % of a wind from 200 degrees that grows from 10 kn at 1200Z to 20
    kn 54 h later.
    """
    result = drift.run(case_of(tmp_path))
    data = result.forecast.data
    knot = 1852 / 3600
    hours = 12.0
    mean_wind = (10 + 10 * (6.5 + hours / 2) / 54) * knot
    east = 0.5 * knot * hours * 3600 + 0.03 * mean_wind * np.sin(np.radians(20)) * hours * 3600
    north = 0.03 * mean_wind * np.cos(np.radians(20)) * hours * 3600
    here = np.radians([-88, 27.5])
    lon, lat = (np.radians(float(data[f"mean_{x}"].isel(time=-1))) for x in ("lon", "lat"))
    moved = sphere.offset(*here, lon, lat)
    # The sample's mean lies within 4.5 standard errors of the prior's centre, 1852 m / sqrt(4000).
    assert moved == pytest.approx([east, north], abs=4.5 * 1852 / np.sqrt(4000) + 15)
    assert data["status_probability"].sum("status").values == pytest.approx(1, abs=1e-9)
    assert result.probability.sum(("lat", "lon")).values == pytest.approx(1, abs=1e-5)


def test_a_backward_run_returns_to_where_a_forward_run_came_from(tmp_path: Path) -> None:
    forward = drift.run(case_of(tmp_path, std="0 m"))
    end = {x: float(forward.forecast.data[f"mean_{x}"].isel(time=-1)) for x in ("lon", "lat")}
    at = [end["lon"], end["lat"]]
    result = drift.run(
        case_of(tmp_path, start="220630ZNOV26", direction="backward", std="0 m", at=at)
    )
    data = result.forecast.data
    lon, lat = (np.radians(float(data[f"mean_{x}"].isel(time=-1))) for x in ("lon", "lat"))
    assert sphere.distance(lon, lat, *np.radians([-88, 27.5])) < 5
    assert (np.diff(data["time"].values).astype(int) < 0).all()


@pytest.mark.thorough
def test_nobody_is_inland_and_strandings_are_kept(tmp_path: Path) -> None:
    """A strong wind onto the coast of Norway at steps of 5 and 60 minutes: all end in water, on the
    sea side of islets.
    """
    box = Box(4, 60, 6.5, 62)
    land = shore.read_land("gshhg", box)
    coast = shoreline.build_coast(land, box)
    for step in ("5 min", "60 min"):
        onshore = case_of(
            tmp_path,
            wind_from=250,
            particles=8_000,
            coast={"source": "gshhg"},
            at="60 50N 004 40E",
            windage="8 %",
            clock={"step": step},
        )
        result = drift.run(onshore)
        tracks = result.trajectories
        assert not shoreline.is_land(coast, tracks.lon.ravel(), tracks.lat.ravel()).any()
        ashore = result.summary["account"]["ashore"]
        assert ashore > 0.3
        gone = tracks.status == Status.ASHORE
        first = gone.argmax(axis=1)
        for track in np.flatnonzero(gone.any(axis=1)):  # for good: where it went ashore it stays
            assert (tracks.lon[track, first[track] :] == tracks.lon[track, first[track]]).all()


@pytest.mark.thorough
def test_a_picture_that_cannot_be_drawn_costs_no_other_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from drift.forecast.products import map as forecast_map

    def broken(*_: object, **__: object) -> None:
        raise ValueError("Axis limits cannot be NaN")

    monkeypatch.setattr(forecast_map, "draw_map", broken)
    with pytest.warns(
        UserWarning, match=r"map\.png could not be drawn .*; all other files are complete"
    ):
        drift.run(case_of(tmp_path), tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert "map.png" not in names
    assert {"forecast.nc", "particles.nc", "summary.json", "snapshots.png"} <= names


@pytest.mark.thorough
def test_nobody_is_inland_at_outputs_inside_a_step(tmp_path: Path) -> None:
    """Outputs every 7 minutes within steps of an hour, diffusion on: bridges to the coast of Norway
    stay in water.
    """
    land = shore.read_land("gshhg", Box(4, 60, 6.5, 62))
    coast = shoreline.build_coast(land, Box(4, 60, 6.5, 62))
    case = case_of(
        tmp_path,
        wind_from=250,
        duration="1 h",
        particles=3_000,
        coast={"source": "gshhg"},
        at="60 50N 004 40E",
        output={"every": "7 min", "trajectories": 3000},
        clock={"step": "60 min"},
        uncertainty={"diffusivity": "100 m2/s"},
    )
    tracks = drift.run(case).trajectories
    assert tracks.lon.shape == (3000, 10)
    assert not shoreline.is_land(coast, tracks.lon.ravel(), tracks.lat.ravel()).any()
