"""The animation of a finished run across the antimeridian: frames, outlines, and when sorties show."""

import json
from pathlib import Path
from typing import Any

import finished
import numpy as np
import pytest
import shapely
import xarray as xr
from PIL import Image

import drift
from drift.apps.export import animation
from drift.apps.export.finished import Finished, open_result
from drift.forecast.products import animation as frames
from geo.errors import UserError

FLOWN = (0x0D, 0x3B, 0x2E)  # colour of legs


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    (folder / "raft.toml").write_text(finished.CASE, encoding="utf-8")
    drift.run(drift.load(folder / "raft.toml"), folder / "raft")
    return folder / "raft"


def opened(folder: Path, times: tuple[str, ...] = ()) -> Finished:
    held = open_result(folder, times)
    assert isinstance(held, Finished)
    return held


def pictures(path: Path) -> list[Any]:
    with Image.open(path) as file:
        found = []
        for number in range(file.n_frames):
            file.seek(number)
            found.append(np.asarray(file.convert("RGB")).astype(int))
    return found


def leg_pixels(picture: Any) -> int:
    """Return how many points have the colour of legs, which a line thinner than one is mixed to."""
    return int((np.abs(picture - FLOWN).max(axis=-1) < 40).sum())


def test_a_frame_for_each_output_with_the_legs_begun_by_then(run: Path, tmp_path: Path) -> None:
    """Outputs every 4 h and where the sortie begins and ends; it begins at 2 h."""
    (path,) = (one for one in drift.export(run, "gif", tmp_path / "out") if one.suffix == ".gif")
    shown = pictures(path)
    times = opened(run).forecast["time"].values
    assert len(shown) == len(times) >= 4
    assert len({picture.tobytes() for picture in shown}) == len(shown)
    legs = np.array([leg_pixels(picture[140:780, 70:830]) for picture in shown])
    begun = times >= times[0] + np.timedelta64(2, "h")
    assert legs[begun].min() > legs[~begun].max() + 200
    with Image.open(path) as file:
        assert file.info["loop"] == 0
        assert file.info["comment"].decode().startswith("run ")
        assert file.size == (960, 840)
    wanted = drift.export(run, "gif", tmp_path / "some", times=["+12 h", "+4 h"])
    assert len(pictures(next(one for one in wanted if one.suffix == ".gif"))) == 2


def test_outlines_are_those_of_the_run_without_the_cut(run: Path) -> None:
    """Of each area the parts east and west of 180 degrees, moved together, and as large."""
    held = opened(run)
    features = json.loads((run / "contours.geojson").read_text())["features"]
    contours = animation._contours(held)
    assert len(contours) == len(features)
    by_key = {(f["properties"]["time"], f["properties"]["level"]): f for f in features}
    crossed = 0
    for contour in contours:
        name = f"{np.datetime_as_string(contour.time, 's')}Z"
        cut = shapely.from_geojson(json.dumps(by_key[name, contour.share]["geometry"]))
        assert contour.polygon.area == pytest.approx(cut.area, rel=1e-9)
        west, _, east, _ = contour.polygon.bounds
        assert east - west < 2
        crossed += west < 180 < east
    assert crossed > 0


def test_scenarios_and_statuses_are_named_as_in_a_run(run: Path) -> None:
    data = animation._as_in_a_run(opened(run, ("+8 h",)))
    with xr.open_dataset(run / "forecast.nc") as whole:
        np.testing.assert_array_equal(
            data["probability_ashore"].values[0],
            whole["probability_ashore"].sel(time=data["time"].values[0]).values,
        )
    assert data["scenario"].values.tolist() == ["last call", "drift, of a raft"]
    assert float(data["status_probability"].sel(status="adrift")[0]) == pytest.approx(1.0)


def test_a_shoreline_that_is_gone_is_said_and_not_drawn(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = opened(run)
    held.forecast.attrs["coast"] = "bay.geojson"
    shown: list[Any] = []
    monkeypatch.setattr(frames, "animate", lambda *given: shown.append(given) or b"")
    assert animation.files(held) == {"forecast.gif": b""}
    setting = shown[0][1]
    assert setting.imprint.footer.startswith("Land is not drawn: bay.geojson is not here. run ")
    assert len(setting.polygons(None)) == 0


def test_a_format_that_is_not_known_is_refused_with_those_that_are(
    run: Path, tmp_path: Path
) -> None:
    with pytest.raises(
        UserError, match="there are kml, kmz, gpx, geojson, geotiff, rtz, gif, sitrep"
    ):
        drift.export(run, "mp4", tmp_path / "out")
