"""The short text about a result."""

import json
import os
import shutil
from pathlib import Path

import pytest
import small_case
import xarray as xr
from desks import Server, finished

import drift
from drift.apps.serve.answers import note_answers
from geo import notation
from geo.errors import UserError


@pytest.mark.thorough
def test_what_is_no_result_gets_a_line(tmp_path: Path) -> None:
    finished(tmp_path / "other")
    with Server(tmp_path.resolve()) as served:
        for name in ("other", "case.toml", "nowhere"):
            (line,) = served.json("POST", "/api/note", {"run": name})["mistakes"]
            assert line == f"{name}: is not a result with a forecast"
        for name in ("../result", ".hidden", "", 1, None):
            assert served.ask("POST", "/api/note", {"run": name})[0] == 400


def test_what_stands_for_a_forecast_and_is_none(tmp_path: Path) -> None:
    """A pipe that is never written to, a link, a file that no manifest lists, and a deep summary."""
    (tmp_path / "outside.nc").write_bytes(b"CDF")
    for name in ("pipe", "link", "deep"):
        finished(tmp_path / name, forecast_nc="x")
        (tmp_path / name / "forecast.nc").unlink()
    os.mkfifo(tmp_path / "pipe" / "forecast.nc")
    (tmp_path / "link" / "forecast.nc").symlink_to(tmp_path / "outside.nc")
    shutil.copy(tmp_path / "outside.nc", tmp_path / "deep" / "forecast.nc")
    (tmp_path / "deep" / "summary.json").write_text("[" * 100_000, encoding="utf-8")
    finished(tmp_path / "unlisted")
    shutil.copy(tmp_path / "outside.nc", tmp_path / "unlisted" / "forecast.nc")
    for name in ("pipe", "link", "deep", "unlisted"):
        with pytest.raises(UserError) as caught:
            note_answers.note({"path": str(tmp_path / name)})
        assert str(caught.value) == f"{name}: is not a result with a forecast"


@pytest.mark.thorough
def test_a_short_text_has_what_the_files_have(tmp_path: Path) -> None:
    """Title, sizes of the areas, the mean and the run."""
    (tmp_path / "case.toml").write_text(small_case.STEADY, encoding="utf-8")
    drift.run(drift.load(tmp_path / "case.toml"), out=tmp_path / "result")
    with Server(tmp_path.resolve()) as served:
        text = served.json("POST", "/api/note", {"run": "result"})["text"]
    summary = json.loads((tmp_path / "result" / "summary.json").read_text(encoding="utf-8"))
    with xr.open_dataset(tmp_path / "result" / "forecast.nc") as data:
        last = data.isel(time=-1)
        when = notation.format_dtg(last["time"].values)
        mean = notation.position(float(last["mean_lon"]), float(last["mean_lat"]))
        areas = [float(area) / notation.NMI**2 for area in last["containment_area"].values]
    lines = text.splitlines()
    assert lines[0] == summary["title"]
    assert f"At {when} " in lines[1]
    told = [float(part.split(" in ")[1].split()[0]) for part in lines[2].split(": ")[1].split(", ")]
    assert told == pytest.approx(areas, rel=0.05)  # two digits
    assert lines[3] == f"Mean position: {mean}."
    assert summary["run_id"] in lines[-1]
