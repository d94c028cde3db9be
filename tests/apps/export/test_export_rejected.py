"""Exports that are rejected in one line: unfinished, damaged and wrong results."""

import hashlib
import importlib.util
import json
import math
import os
import random
import shutil
from pathlib import Path

import fuzz_results
import netCDF4
import pytest

import drift
from drift.apps.cli import commands
from drift.apps.export import exporter, raster
from drift.products.files import manifest
from geo.errors import UserError


@pytest.mark.parametrize(
    ("told", "words"),
    [
        (["{run}", "shp"], "argument FORMAT: invalid choice"),
        (["{run}", "kml", "--time", "+5 h"], '--time TIME: there is no output in the minute of "+5 h"; outputs go from 012000ZJUN26 to 020800ZJUN26'),
        (["{run}", "kml", "--time", "noon"], '--time TIME: "noon" is not a time'),
        (["nowhere", "kml"], "results nowhere: the folder does not exist"),
        (["{changed}", "kml"], 'not the complete result of a run: "contours.geojson" has been changed'),
        (["{export}", "kml"], "contain no forecast.nc; give a folder written by drift run, drift plan"),
        (["{unplanned}", "rtz"], "contain no plan, and rtz holds the routes of a plan"),
        (["{run}", "kml", "--out", "{export}"], "is not empty; name another with --out, or add --overwrite"),
    ],
)  # fmt: skip
def test_refusals_are_a_line_and_nothing_is_written(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    told: list[str], words: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    places = {"run": run, **{name: tmp_path / name for name in ("changed", "export", "unplanned")}}
    drift.export(run, "gpx", places["export"])
    for name in ("changed", "unplanned"):
        places[name].mkdir()
        for path in run.iterdir():
            (places[name] / path.name).write_bytes(path.read_bytes())
    with open(places["changed"] / "contours.geojson", "a") as file:
        file.write("\n")
    listed = json.loads((places["unplanned"] / "manifest.json").read_text())
    (places["unplanned"] / "plan.gpx").unlink()
    listed["files"] = [entry for entry in listed["files"] if entry["name"] != "plan.gpx"]
    (places["unplanned"] / "manifest.json").write_text(json.dumps(listed))
    before = (
        sorted(os.listdir(tmp_path)),
        hashlib.sha256((places["export"] / "forecast.gpx").read_bytes()).digest(),
    )
    assert commands.main(["export", *(word.format(**places) for word in told)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    after = (
        sorted(os.listdir(tmp_path)),
        hashlib.sha256((places["export"] / "forecast.gpx").read_bytes()).digest(),
    )
    assert before == after


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")  # of affine, in rasterio
def test_a_damaged_result_is_refused_in_a_line_or_written_so_that_it_can_be_read(
    run: Path, tmp_path: Path
) -> None:
    """A slice of benchmarks/fuzz_results.py."""
    told, written = [], 0
    forms = [
        form
        for form in exporter.FORMATS
        if form != "geotiff" or importlib.util.find_spec("rasterio")
    ]
    for number in range(16):
        rng, folder = random.Random(number), tmp_path / str(number)
        folder.mkdir()
        how, copy = fuzz_results.tried(run, folder, rng)
        try:
            written += fuzz_results.exported(Path(copy), folder, rng.choice(forms)) == "written"
        except UserError as error:
            told.append(str(error))
            assert "\n" not in told[-1], how
            assert len(told[-1]) < 600, how
            assert not (folder / "out").exists()
    assert written > 2
    assert len(told) > 2
    assert all("run the case again" in line for line in told)


WRONG = {
    "contours.geojson": [
        (lambda whole: whole["features"][0]["properties"].pop("level"), "feature 1 has level missing"),
        (lambda whole: whole["features"][1]["properties"].update(level=0.123), "level 0.123 is not a share of forecast.nc"),
        (lambda whole: whole["features"][1]["properties"].update(time="soon"), "feature 2 has time 'soon'"),
        (lambda whole: whole["features"][0]["geometry"].update(coordinates=[[[[0, 91]] * 4]]), "[0, 91] is not a longitude and a latitude"),
        (lambda whole: whole["features"][0]["geometry"].update(coordinates=[[[[math.nan, 1]] * 4]]), "is no JSON (NaN is no number of JSON)"),
        (lambda whole: whole["features"][0].update(geometry={"type": "Point", "coordinates": [0, 0]}), "has the geometry 'Point'; it must be a MultiPolygon"),
        (lambda whole: whole.update(features=None), "holds no list of features"),
    ],
    "sorties.geojson": [(lambda whole: [f["properties"].pop("start") for f in whole["features"]], "a sortie has no start")],
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "number"), [(name, k) for name, cases in WRONG.items() for k in range(len(cases))]
)
def test_what_is_wrong_in_a_result_is_told_with_its_place(
    run: Path, tmp_path: Path, name: str, number: int
) -> None:
    change, words = WRONG[name][number]
    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    whole = json.loads((copy / name).read_text())
    change(whole)
    (copy / name).write_text(json.dumps(whole))
    listed = manifest.read_manifest(run)
    (copy / manifest.NAME).write_text(
        manifest.manifest_text(
            manifest.manifest_of(listed.run_id, [copy / entry.name for entry in listed.files])
        )
    )
    with pytest.raises(UserError) as refused:
        drift.export(copy, "gpx", tmp_path / "out")
    assert words in str(refused.value)
    assert str(refused.value).startswith(f"results {copy}: {name} is damaged")


@pytest.mark.parametrize("value", [math.inf, math.nan])
def test_cell_edges_that_are_no_numbers_are_told(run: Path, tmp_path: Path, value: float) -> None:
    """The first and the last, beside which no difference is taken, among them."""
    pytest.importorskip("rasterio")
    for k in (0, -1):
        copy = tmp_path / f"copy{k}"
        shutil.copytree(run, copy)
        with netCDF4.Dataset(copy / "forecast.nc", "a") as file:
            file["lon_bnds"][k, :] = value
        listed = manifest.read_manifest(run)
        (copy / manifest.NAME).write_text(
            manifest.manifest_text(
                manifest.manifest_of(listed.run_id, [copy / entry.name for entry in listed.files])
            )
        )
        with pytest.raises(UserError, match="lon_bnds are not cell edges; run the case again"):
            drift.export(copy, "geotiff", tmp_path / "out")


def test_an_export_replaces_another_if_told_to(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert commands.main(["export", str(run), "gpx"]) == 0
    assert capsys.readouterr().out.strip() == "forecast.gpx in raft-plan-gpx"
    assert commands.main(["export", str(run), "kml", "--out", "raft-plan-gpx", "--overwrite"]) == 0
    assert sorted(os.listdir(tmp_path / "raft-plan-gpx")) == ["forecast.kml", "manifest.json"]


def test_without_rasterio_a_line_says_what_to_install(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rasterio", None)
    with pytest.raises(UserError, match=r"geotiff needs rasterio: pip install -e '\.\[geotiff\]'"):
        drift.export(run, "geotiff", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert raster.BANDS
