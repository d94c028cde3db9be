"""The stretches and patrols on the page against the run's own files, read by csv and netCDF4."""

import csv
import json
import tomllib
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import shapely
from spill_cases import island_spill

import drift
from drift.apps.serve.answers import process
from geo.errors import UserError

RUN = "lost-plan"
TEAM = """
[[patrol_unit]]
name = "islanders"
base = [-87.99, 27.2]
reach = "20 km"
length = "12 km"
detection = 0.6
first = "+11 h"
"""
ROUNDED = 5.1e-4  # relative error of numbers of four digits


def ask(do: str, folder: Path, run: str = RUN, **request: Any) -> Any:
    return process.ANSWERS[do]({"folder": str(folder), "run": run, **request}, print)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Containers and drums lost off an island, a find, and a team's patrols planned."""
    place = tmp_path_factory.mktemp("spills")
    (place / "shore.geojson").write_text(json.dumps(island_spill.ISLAND))
    box = island_spill.BOX.replace("2 %", "4 %")
    text = island_spill.HEAD + island_spill.SPILL + island_spill.DRUM + "share = 0.25\n" + box
    text += island_spill.FIND + island_spill.AT + 'time = "+9 h"\n' + TEAM
    (place / "lost.toml").write_text(text)
    drift.patrol(drift.load(place / "lost.toml"), place / RUN)
    return place


@pytest.fixture(scope="module")
def told(folder: Path) -> Any:
    return ask("washup", folder)


def rows(folder: Path, name: str) -> list[dict[str, str]]:
    with open(folder / RUN / name, encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.thorough
def test_stretches_are_those_of_the_table(folder: Path, told: Any) -> None:
    table = rows(folder, "washup.csv")
    assert [one["id"] for one in told["stretches"]] == [row["stretch_id"] for row in table]
    assert told["number"] == len(table)
    for k, row in enumerate(table):
        stretch = told["stretches"][k]
        assert row["name"] in stretch["name"]
        assert stretch["length_km"] == pytest.approx(float(row["length_km"]), rel=ROUNDED)
        assert stretch["first"] == (row["first_50"] or None)
        assert stretch["at"] == pytest.approx([float(row["lon"]), float(row["lat"])], abs=6e-6)
        assert told["low"][-1][k] == int(row["number_10"])
        assert told["high"][-1][k] == int(row["number_90"])
        assert told["probability"][-1][k] == pytest.approx(float(row["probability"]), rel=ROUNDED)
    for k, column in enumerate(("expected", "expected_drum", "expected_box")):
        values = [float(row[column]) for row in table]
        np.testing.assert_allclose(told["expected"][k][-1], values, rtol=ROUNDED)
    assert told["classes"] == ["drum", "box"]


def test_numbers_at_all_times_are_those_of_the_dataset(folder: Path, told: Any) -> None:
    with netCDF4.Dataset(folder / RUN / "washup.nc") as data:
        data.set_auto_mask(False)
        order = [list(data["segment"][:]).index(one["segment"]) for one in told["stretches"]]
        for name in ("expected", "probability"):
            mine = told["expected"][0] if name == "expected" else told["probability"]
            np.testing.assert_allclose(mine, data[name][:][:, order], rtol=ROUNDED)
        by_kind = data["expected_by_kind"][:][:, :, order]
        np.testing.assert_allclose(told["expected"][1:], by_kind, rtol=ROUNDED)
        number = data["number"][:][..., order]
        np.testing.assert_array_equal([told["low"], told["high"]], number[[0, 2]])
        fates = [str(one) for one in netCDF4.chartostring(data["fate"][:])] if data["fate"].ndim > 1 else list(data["fate"][:])  # fmt: skip
        ashore = fates.index("ashore")
        np.testing.assert_allclose(
            [row[0] for row in told["ashore"]], data["total"][:][ashore], rtol=ROUNDED
        )
        times = netCDF4.num2date(data["time"][:], data["time"].units)
    assert told["times"] == [f"{time:%Y-%m-%dT%H:%M:%SZ}" for time in times]
    assert len(told["times"]) == 3
    assert told["lost"] == 20  # objects of the case: ashore, afloat, found or broken up


def test_lines_follow_the_stretches(folder: Path, told: Any) -> None:
    """What is drawn lies within 2e-4 degrees, and rounding, of the line of the GIS file."""
    features = json.loads((folder / RUN / "washup.geojson").read_text())["features"]
    whole = {one["properties"]["segment"]: one["geometry"] for one in features}
    for one in told["stretches"]:
        drawn = shapely.multilinestrings([shapely.linestrings(line) for line in one["lines"]])
        own = shapely.geometry.shape(whole[one["segment"]])
        assert shapely.hausdorff_distance(drawn, own, densify=0.1) < 2.2e-4


def test_finds_and_patrols_are_those_of_the_files(folder: Path, told: Any) -> None:
    (find,) = told["finds"]
    (row,) = rows(folder, "finds.csv")
    assert find["at"] == [float(row["lon_deg"]), float(row["lat_deg"])]
    assert (find["name"], find["odd"]) == (row["name"], row["odd"] == "yes")
    table = rows(folder, "patrols.csv")
    (patrol,) = told["patrols"]
    visits = patrol["visits"]
    assert [one["segment"] for one in visits] == [int(row["segment"]) for row in table]
    assert patrol["found"] == pytest.approx(sum(float(row["found"]) for row in table), rel=ROUNDED)
    assert patrol["length_km"] <= 12
    assert patrol["team"] == "islanders"
    summary = json.loads((folder / RUN / "summary.json").read_text())
    assert told["plan"]["found"] == summary["patrol_plan"]["found"]


def test_a_patrol_is_kept_once(folder: Path, told: Any) -> None:
    name = told["patrols"][0]["name"]
    text = (folder / "lost.toml").read_text()
    kept = ask("washup/keep", folder, patrol=name, text=text)
    assert kept["name"] == name
    made, planned = (tomllib.loads(one) for one in (kept["text"], (folder / RUN / "patrols.toml").read_text()))  # fmt: skip
    assert made == {**tomllib.loads(text), "patrol": planned["patrol"]}
    with pytest.raises(UserError, match="has this patrol already"):
        ask("washup/keep", folder, patrol=name, text=kept["text"])
    with pytest.raises(UserError, match="has no patrol 'north'"):
        ask("washup/keep", folder, patrol="north", text=text)


def test_files_of_someone_else(folder: Path, told: Any, tmp_path: Path) -> None:
    """A result whose tables do not fit together is one line."""
    import shutil

    shutil.copytree(folder / RUN, tmp_path / RUN)
    (tmp_path / RUN / "washup.geojson").write_text('{"features": [{"properties": {}}]}')
    with pytest.raises(UserError, match="holds no stretches of coast that the page can show"):
        ask("washup", tmp_path)
    with pytest.raises(UserError, match="nowhere: holds no stretches"):
        ask("washup", tmp_path, "nowhere")


def test_a_first_map_has_stretches(folder: Path) -> None:
    """Of few worlds; it writes no file."""
    before = sorted(folder.iterdir())
    request = {"path": str(folder / "lost.toml"), "text": (folder / "lost.toml").read_text()}
    sketch = process.ANSWERS["sketch"](request, lambda *_: None)
    assert "objects are expected ashore" in sketch["words"]
    washup = sketch["washup"]
    assert washup["classes"] == ["drum", "box"]
    assert washup["times"] == sketch["times"]
    by_kind = np.sum(washup["expected"][1:], axis=0)
    np.testing.assert_allclose(by_kind, washup["expected"][0], rtol=4 * ROUNDED, atol=1e-6)
    assert sum(washup["expected"][0][-1]) == pytest.approx(washup["ashore"][-1][0], rel=5e-3)
    assert sorted(folder.iterdir()) == before
