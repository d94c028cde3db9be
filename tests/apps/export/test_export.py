"""Exports of areas and plans across the antimeridian, read by GDAL and ElementTree and compared
with forecast.nc and plan.json.
"""

import json
import math
import xml.etree.ElementTree as ET
import zipfile
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
import xarray as xr
from exported import HALF, METRES, contours, layer

import drift
from drift.apps.cli import export as export_command
from drift.apps.export import exporter
from drift.apps.export.finished import _chosen as chosen
from drift.products.files import manifest
from drift.products.maps.marks import Mark
from drift.spills.backtrack import backward, outlines
from drift.spills.backtrack.backward import Origin
from geo import notation
from geo.errors import UserError


@pytest.mark.thorough
def test_kml_shows_the_areas_at_their_times(
    run: Path, forecast: xr.Dataset, tmp_path: Path
) -> None:
    """GDAL reads the shapes of contours.geojson; their areas are those of forecast.nc to half a
    cell along the outline.
    """
    (path,) = (p for p in drift.export(run, "kml", tmp_path / "out") if p.suffix == ".kml")
    assert drift.results(tmp_path / "out") == [path, tmp_path / "out/manifest.json"]
    known, seen = contours(run), set()
    root = ET.parse(path).getroot()
    days = [
        f.findtext("{*}name")
        for f in root.findall(".//{*}Folder")
        if f.findtext("{*}name").startswith("Forecast ")
    ]
    assert days == ["Forecast 2026-06-01", "Forecast 2026-06-02"]
    half = (
        math.hypot(*(float(np.ptp(forecast[f"{axis}_bnds"].values[0])) for axis in ("lon", "lat")))
        / 2
    )
    times = [notation.iso(time) for time in forecast["time"].values]
    for day in days:
        fields, shapes = layer(path, day)
        for k, (name, begin, shape) in enumerate(
            zip(fields["Name"], fields["begin"], shapes, strict=True)
        ):
            share = float(name.split()[0]) / 100
            time = notation.iso(np.datetime64(str(begin)[:19].replace("/", "-")))
            assert name.endswith(notation.format_dtg(np.datetime64(time[:-1])))
            seen.add((time, share))
            plane = shapely.force_2d(shape)
            assert shapely.hausdorff_distance(plane, known[time, share]) <= math.sqrt(2) * HALF
            assert shapely.bounds(plane)[0] >= -180
            assert shapely.bounds(plane)[2] <= 180
            flat = shapely.transform(
                plane, lambda xy: xy * [math.cos(math.radians(41.0)), 1] * METRES
            )
            told = float(
                forecast["containment_area"].sel(time=time[:-1])[
                    list(forecast["share"]).index(share)
                ]
            )
            assert abs(shapely.area(flat) - told) < shapely.length(flat) * half * METRES, (k, name)
    assert seen == known.keys()
    ends = {
        p.findtext("{*}TimeSpan/{*}begin"): p.findtext("{*}TimeSpan/{*}end")
        for p in root.findall(".//{*}Placemark")
        if p.findtext("{*}styleUrl", "").startswith("#area")
    }
    for time, following in pairwise(times):
        assert ends[time] == notation.iso(np.datetime64(following[:-1]) - np.timedelta64(1, "s"))
    for name in ("datum", "mean"):
        places = {
            p.findtext("{*}TimeSpan/{*}begin"): p.findtext("{*}Point/{*}coordinates")
            for p in root.findall(".//{*}Placemark")
            if p.findtext("{*}name").startswith(f"{name} ")
        }
        assert list(places) == times
        lon, lat = np.array([[float(x) for x in text.split(",")] for text in places.values()]).T
        assert np.abs((lon - forecast[f"{name}_lon"].values + 180) % 360 - 180).max() <= HALF
        assert np.abs(lat - forecast[f"{name}_lat"].values).max() <= HALF


@pytest.mark.thorough
def test_kml_has_the_search_and_the_plan_and_needs_no_colour(run: Path, tmp_path: Path) -> None:
    drift.export(run, "kml", tmp_path / "out")
    root = ET.parse(tmp_path / "out/forecast.kml").getroot()
    folders = [folder.findtext("{*}name") for folder in root.findall(".//{*}Folder")]
    assert {"Search", "Orion <1>", "Plan", "A-1 plane", "A-2 boat"} <= set(folders)
    looks = {
        style.get("id"): (
            style.findtext("{*}LineStyle/{*}width"),
            style.findtext("{*}PolyStyle/{*}color", "")[:2],
        )
        for style in root.findall(".//{*}Style")
    }
    areas = [looks[f"area{k}"] for k in range(3)]
    # by width and by fill
    assert len({width for width, _ in areas}) == len({fill for _, fill in areas}) == 3
    assert {
        place.findtext("{*}styleUrl", "#legs")[1:] for place in root.findall(".//{*}Placemark")
    } <= looks.keys()
    named = next(
        p for p in root.findall(".//{*}Placemark") if p.findtext("{*}name") == "Orion <1> legs"
    )
    summary = json.loads((run / "summary.json").read_text())
    flown = [f["properties"] for f in json.loads((run / "sorties.geojson").read_text())["features"]]
    pos = next(told["pos"] for told in flown if told["name"] == "Orion <1>")
    assert f"POS {100 * pos:.1f} %" in named.findtext("{*}description")
    told = root.findtext("{*}Document/{*}description")
    assert summary["run_id"] in told
    assert summary["uncertainty"]["told"] in told


@pytest.mark.thorough
def test_files_say_who_made_them(run: Path, forecast: xr.Dataset) -> None:
    told = {
        "creator_name": "MRCC <test>",
        "license": "CC BY 4.0",
        "naming_authority": "org.example",
    }
    for held in (forecast.attrs, json.loads((run / "summary.json").read_text()),
                 json.loads((run / "contours.geojson").read_text())):  # fmt: skip
        assert told.items() <= held.items()


def test_kmz_is_the_same_and_the_same_every_time(run: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        drift.export(run, "kmz", tmp_path / name)
    drift.export(run, "kml", tmp_path / "plain")
    assert (tmp_path / "a/forecast.kmz").read_bytes() == (tmp_path / "b/forecast.kmz").read_bytes()
    with zipfile.ZipFile(tmp_path / "a/forecast.kmz") as archive:
        assert archive.namelist() == ["doc.kml"]
        assert archive.read("doc.kml") == (tmp_path / "plain/forecast.kml").read_bytes()


def test_outputs_that_are_wanted(run: Path, tmp_path: Path) -> None:
    drift.export(run, "kml", tmp_path / "out", times=["+0 h", "020800ZJUN26"])
    root = ET.parse(tmp_path / "out/forecast.kml").getroot()
    (folder,) = (
        f for f in root.findall(".//{*}Folder") if f.findtext("{*}name").startswith("Datum")
    )
    begins = [
        p.findtext("{*}TimeSpan/{*}begin")
        for p in folder.findall("{*}Placemark")
        if p.find("{*}Point") is not None
    ]
    assert begins == ["2026-06-01T20:00:00Z", "2026-06-02T08:00:00Z"]


def test_outputs_of_a_backward_run_come_in_ascending_order() -> None:
    outputs = np.datetime64("2026-06-01T20:00:40", "ns") - np.arange(4) * np.timedelta64(4, "h")
    assert chosen(outputs, []) == [3, 2, 1, 0]
    assert chosen(outputs, ["011200ZJUN26", "-4 h"]) == [2, 1]


def test_one_time_may_be_text_and_the_message_names_the_argument(run: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r'^times: "noon" is not a time'):
        drift.export(run, "kml", tmp_path / "out", times="noon")
    one = drift.export(run, "kml", tmp_path / "one", times="+0 h")
    several = drift.export(run, "kml", tmp_path / "several", times=["+0 h"])
    assert [path.read_bytes() for path in one if path.suffix == ".kml"] == [
        path.read_bytes() for path in several if path.suffix == ".kml"
    ]


def test_geojson_holds_positions_and_the_areas(
    run: Path, forecast: xr.Dataset, tmp_path: Path
) -> None:
    made = {
        path.name: path
        for path in drift.export(run, "geojson", tmp_path / "out", times=["+0 h", "020800ZJUN26"])
    }
    assert {"areas.geojson", "positions.geojson", "sorties.geojson", "plan.geojson"} <= made.keys()
    points = json.loads(made["positions.geojson"].read_text())["features"]
    told = [(p["properties"]["kind"], *p["geometry"]["coordinates"]) for p in points]
    at = forecast.isel(time=[0, -1])
    for name in ("datum", "mean"):
        lon, lat = np.array([place for kind, *place in told if kind == name]).T
        assert np.abs((lon - at[f"{name}_lon"].values + 180) % 360 - 180).max() <= HALF
        assert np.abs(lat - at[f"{name}_lat"].values).max() <= HALF
    known = contours(run)
    areas = json.loads(made["areas.geojson"].read_text())["features"]
    assert len(areas) == 2 * len(forecast["share"])
    for area in areas:
        shape = known[area["properties"]["time"], area["properties"]["level"]]
        assert shapely.equals(shapely.from_geojson(json.dumps(area["geometry"])), shape)


@pytest.fixture
def released(tmp_path: Path) -> Path:
    """Return the folder of an origin across the antimeridian: a normal law of 5 km, and two finds."""
    lon, lat = 180 + np.linspace(-0.3, 0.3, 61), np.linspace(-0.3, 0.3, 61)
    east, north = np.meshgrid((lon - 180) * METRES, lat * METRES)
    law = np.exp(-((east / 5e3) ** 2 + (north / 5e3) ** 2) / 2)[None]
    when = np.array(["2026-06-01T00:00"], "datetime64[s]")
    seconds = float(when.astype("int64")[0])
    origin = Origin(
        lon,
        lat,
        when,
        law / law.sum(),
        law / law.sum(),
        (180.0, 0.0, seconds),
        (5e3, 5e3, 0.0),
        (1.0,) * 3,
        9,
        9.0,
    )
    finds = [Mark(179.9, 0.1, "1 first <box>, 011200Z"), Mark(-179.9, 0.1, "2 second, 011200Z")]
    about = {"title": "Boxes", "run_id": "abc-s1"}
    folder = tmp_path / "origin"
    folder.mkdir()
    backward.origin_dataset(origin).assign_attrs(about).to_netcdf(folder / "origin.nc")
    (folder / "origin.geojson").write_text(
        json.dumps(outlines.origin_geojson(origin, finds, about))
    )
    files = [folder / "origin.nc", folder / "origin.geojson"]
    (folder / manifest.NAME).write_text(
        manifest.manifest_text(manifest.manifest_of("abc-s1", files))
    )
    return folder


def test_an_origin_for_other_programs(released: Path, tmp_path: Path) -> None:
    """The areas of a circular normal law are 2 pi s^2 log(1 / (1 - share)), to a cell along the
    outline.
    """
    made = {form: drift.export(released, form, tmp_path / form)[-1] for form in exporter.OF_RELEASE}
    assert {path.name for path in made.values()} == {"origin.kml", "origin.gpx", "origin.geojson"}
    features = json.loads(made["geojson"].read_text())["features"]
    assert [f["properties"]["kind"] for f in features] == ["area", "area", "mean", "find", "find"]
    fields, shapes = layer(made["kml"], "Release")
    by_name = dict(zip(fields["Name"], shapes, strict=True))
    cell = 0.01 * METRES
    for share, feature in zip((0.5, 0.9), features, strict=False):
        exact = 2 * math.pi * 5e3**2 * math.log(1 / (1 - share))
        assert abs(feature["properties"]["area_km2"] * 1e6 - exact) < cell * math.sqrt(
            4 * math.pi * exact
        )
        for shape in (
            shapely.from_geojson(json.dumps(feature["geometry"])),
            by_name[f"{100 * share:.0f} % of the release"],
        ):
            flat = shapely.transform(shapely.force_2d(shape), lambda xy: xy * METRES)
            assert abs(flat.area - exact) < cell * math.sqrt(4 * math.pi * exact)
            assert shapely.bounds(shape)[0] == -180
            assert shapely.bounds(shape)[2] == 180
    names, points = layer(made["gpx"], "waypoints")
    assert names["name"] == ["MEAN", "F1", "F2"]
    assert shapely.get_coordinates(points).tolist() == [[-180.0, 0.0], [179.9, 0.1], [-179.9, 0.1]]
    segments = [
        [float(p.get("lon")) for p in part]
        for part in ET.parse(made["gpx"]).getroot().findall(".//{*}trkseg")
    ]
    assert max(abs(b - a) for part in segments for a, b in pairwise(part)) < 0.1
    for form in ("rtz", "geotiff", "kmz"):
        with pytest.raises(
            UserError,
            match=f"come from drift origin, which {form} does not support; use kml, gpx, geojson",
        ):
            drift.export(released, form, tmp_path / "no")
    with pytest.raises(UserError, match="has no output times; remove time"):
        drift.export(released, "kml", tmp_path / "no", times=["+0 h"])


def test_the_command_names_the_formats_that_there_are() -> None:
    assert tuple(exporter.FORMATS) == export_command.FORMATS
