"""A result on the map: areas by scenario and the value at a place, against its own cells."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import trial_case
import xarray as xr

import drift
from drift.apps.serve.answers import process, result_answers
from geo.errors import UserError

RUN = "two"


def ask(do: str, folder: Path, **request: Any) -> Any:
    return process.ANSWERS[do]({"folder": str(folder), "run": RUN, **request}, print)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenarios of unequal weight and place, across the antimeridian."""
    place = tmp_path_factory.mktemp("results")
    scenarios = [
        trial_case.RAFT | {"position": {"at": "41 12S 179 58E", "std": "2 nmi"}, "weight": 0.7},
        {
            **trial_case.RAFT,
            "name": "swimmer",
            "position": {"at": "41 02S 179 52W", "std": "1 nmi"},
            "weight": 0.3,
        },
    ]
    path = trial_case.write(place, particles=2000, scenario=scenarios)
    drift.run(drift.load(path), place / RUN)
    return place


@pytest.fixture(scope="module")
def cells(folder: Path) -> Any:
    with xr.open_dataset(folder / RUN / "forecast.nc") as data:
        return data.load()


def test_areas_of_a_scenario_hold_their_shares(folder: Path, cells: Any) -> None:
    """Cells whose middles lie in an area hold its share of the scenario, but for those on its edge.

    The edge of an area goes through about the root of 4 pi times its number of cells; each holds at
    most the mean of the area's cells, and half of them are counted on either side.
    """
    told = ask("result", folder, scenario="swimmer")
    assert [one["name"] for one in told["scenarios"]] == ["raft", "swimmer"]
    np.testing.assert_allclose([one["probability"][0] for one in told["scenarios"]], [0.7, 0.3])
    lon, lat = np.meshgrid(cells["lon"].values, cells["lat"].values)
    seen = set()
    for one in told["areas"]["features"]:
        k = told["times"].index(one["properties"]["time"])
        mass = cells["probability_by_scenario"].values[k, 1] / 0.3
        shape = shapely.geometry.shape(one["geometry"])
        inside = np.zeros(mass.shape, bool)
        for turn in (-360, 0, 360):
            inside |= shapely.contains_xy(shape, lon + turn, lat)
        level, number = one["properties"]["level"], inside.sum()
        edge = np.sqrt(4 * np.pi * number) / number * level / 2
        assert abs(mass[inside].sum() - level) < max(edge, 0.01)
        seen.add((k, level))
    assert len(seen) == 3 * len(told["times"])
    assert ask("result", folder, scenario=None)["areas"]["features"] == []


def test_what_is_compared_with_another_run(folder: Path, cells: Any) -> None:
    """The densest cell, the share ashore and the particles at each time, as the files have them."""
    told = ask("result", folder, scenario=None)
    density = (cells["probability"] / cells["cell_area"]).values
    assert not cells["probability_ashore"].any()
    for k, (only,) in enumerate(told["likely"]):
        assert not only["ashore"]
        lon, lat = only["at"]
        row, column = np.argwhere(density[k] == density[k].max())[0]
        assert lat == pytest.approx(float(cells["lat"][row]), abs=5e-5)
        assert abs((lon - float(cells["lon"][column]) + 180) % 360 - 180) < 5e-5
        assert -180 <= lon <= 180
    ashore = cells["status_probability"].sel(status="ashore").values
    np.testing.assert_allclose(told["ashore"], ashore, atol=5e-7)
    with xr.open_dataset(folder / RUN / "particles.nc") as tracks:
        assert tracks.sizes["trajectory"] <= result_answers.MOST_PARTICLES
        drawn = told["particles"]
        there = np.isfinite(tracks["lon"].values.T)
        np.testing.assert_allclose(
            np.array(drawn["lon"])[there], tracks["lon"].values.T[there], atol=5e-5
        )
        np.testing.assert_array_equal(
            np.array(drawn["status"])[there], tracks["status"].values.T[there]
        )
    assert told["words"].startswith("At ")
    assert "% of the probability" in told["words"]


def test_a_result_without_particles(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(result_answers, "PARTICLES", "absent.nc")
    told = ask("result", folder, scenario=None)
    assert told["statuses"] == []
    assert told["particles"] == {"lon": [], "lat": [], "status": []}
    assert told["likely"]


@pytest.mark.parametrize("count", [2, 9, 10, 57])
@pytest.mark.parametrize("opens", [None, 0, 1, -1])
def test_a_first_map_has_few_of_the_times(count: int, opens: int | None) -> None:
    """The first, the last and the one shown first among them, in order, without long gaps."""
    outputs = np.datetime64("2026-11-21T18:30", "s") + np.arange(count) * np.timedelta64(3599, "s")
    shown = None if opens is None else outputs[opens]
    few = process.few_outputs(outputs, shown)
    assert few.size <= process.MOST_OUTPUTS
    assert few.size == min(count, process.MOST_OUTPUTS) or opens is not None
    assert (few[0], few[-1]) == (outputs[0], outputs[-1])
    assert shown is None or shown in few
    number = np.flatnonzero(np.isin(outputs, few))
    assert (outputs[number] == few).all()
    assert np.diff(number).max() <= np.ceil((count - 1) / (process.MOST_OUTPUTS - 2))


@pytest.mark.parametrize("scenario", [None, "raft", "swimmer"])
def test_the_value_at_a_place(folder: Path, cells: Any, scenario: str | None) -> None:
    """At the middle of a cell, and 0.4 cells off, also given with another turn of longitude."""
    rows, columns = np.nonzero(cells["probability_by_scenario"].values[-1, 1] > 0)
    i, j = rows[len(rows) // 3], columns[len(rows) // 3]
    last = cells.sizes["time"] - 1
    share = {None: 1.0, "raft": 0.7, "swimmer": 0.3}[scenario]
    which = {"raft": 0, "swimmer": 1}.get(scenario or "")
    mass = cells["probability"] if which is None else cells["probability_by_scenario"][:, which]
    square = float(cells["cell_area"][i, j]) / 1852**2
    step = float(cells["lon"][1] - cells["lon"][0])
    for turn in (0, 360, -360):
        at = [float(cells["lon"][j]) - 0.4 * step + turn, float(cells["lat"][i])]
        told = ask("result/value", folder, scenario=scenario, time=last, at=at)
        expected = float(mass[last, i, j]) / share / square
        assert told["per_nmi2"] == pytest.approx(expected, rel=1e-5)
        assert (told["within"] is None) == (scenario is not None)
    far = ask("result/value", folder, scenario=scenario, time=last, at=[10.0, 50.0])
    assert far == {"per_nmi2": 0.0, "within": None}


@pytest.mark.parametrize(
    ("do", "request_", "words"),
    [
        ("result", {"scenario": "whale"}, "no scenario 'whale'"),
        (
            "result/value",
            {"scenario": "whale", "time": 0, "at": [179.9, -41.1]},
            "no such scenario",
        ),
        ("result/value", {"scenario": None, "time": 99, "at": [0, 0]}, "no output 99"),
    ],
)
def test_what_a_result_has_not(folder: Path, do: str, request_: Any, words: str) -> None:
    with pytest.raises(UserError, match=words):
        ask(do, folder, **request_)
