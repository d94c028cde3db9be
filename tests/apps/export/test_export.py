"""Exports of a finished run across the antimeridian, read by GDAL and ElementTree and held against
forecast.nc and plan.json.
"""

import hashlib
import importlib.util
import json
import math
import os
import random
import shutil
import xml.etree.ElementTree as ET
import zipfile
from itertools import pairwise
from pathlib import Path

import finished
import fuzz_results
import netCDF4
import numpy as np
import pyogrio
import pytest
import shapely
import xarray as xr
from plans import few_trials  # noqa: F401 (a fixture)

import drift
from drift.apps.cli import commands
from drift.apps.cli import export as export_command
from drift.apps.export import exporter, plotter, raster
from drift.apps.export.finished import Finished
from drift.apps.export.finished import _chosen as chosen
from drift.products.files import geojson, gpx, manifest
from drift.products.maps.marks import Mark
from drift.spills.backtrack import backward, outlines
from drift.spills.backtrack.backward import Origin
from geo import notation
from geo.errors import UserError

HALF = 0.5e-7 + 1e-12  # [deg] half of the last digit that is written
RTZ = "{http://www.cirm.org/RTZ/1/0}"
NMI = 1852.0
METRES = math.radians(6_371_008.8)  # in a degree of the sphere


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, few_trials: None) -> Path:  # noqa: F811
    return finished.plan(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def forecast(run: Path) -> xr.Dataset:
    return xr.load_dataset(run / "forecast.nc")


def contours(run: Path) -> dict[tuple[str, float], shapely.Geometry]:
    features = json.loads((run / "contours.geojson").read_text())["features"]
    return {
        (f["properties"]["time"], f["properties"]["level"]): shapely.from_geojson(
            json.dumps(f["geometry"])
        )
        for f in features
    }


def layer(path: Path, name: str) -> tuple[dict[str, list], np.ndarray]:
    meta, _, geometry, columns = pyogrio.raw.read(path, layer=name)
    return dict(zip(meta["fields"], map(list, columns), strict=True)), shapely.from_wkb(geometry)


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


def test_gpx_for_plotters(
    run: Path, forecast: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # so that outlines are those of contours.geojson, point by point
    monkeypatch.setattr(plotter, "MOST", 1_000_000)
    drift.export(run, "gpx", tmp_path / "out")
    path = tmp_path / "out/forecast.gpx"
    fields, points = layer(path, "waypoints")
    times = forecast["time"].values
    assert fields["name"] == [f"D{notation.day_time(time)}" for time in times]
    assert max(map(len, fields["name"])) <= 8
    np.testing.assert_array_equal(
        np.array(fields["time"], "datetime64[s]"), times.astype("datetime64[s]")
    )
    at = shapely.get_coordinates(points)
    assert at[:, 0].min() >= -180
    assert at[:, 0].max() < 180
    assert np.abs((at[:, 0] - forecast["datum_lon"].values + 180) % 360 - 180).max() <= HALF
    assert np.abs(at[:, 1] - forecast["datum_lat"].values).max() <= HALF
    fields, lines = layer(path, "tracks")
    told = dict(zip(fields["name"], lines, strict=True))
    known = contours(run)
    assert any(shape.bounds[2] == 180 for shape in known.values()), (
        "the case is made so that areas lie across"
    )
    for (time, share), shape in known.items():
        line = told[f"{notation.hundredths(share)}% {notation.day_time(np.datetime64(time[:-1]))}"]
        # The outline, without the edges at 180 degrees where it was cut; 180 in the east is written
        # a last digit less.
        edges = np.array(
            [
                pair
                for ring in shapely.get_rings(shapely.get_parts(shape))
                for pair in pairwise(ring.coords)
            ]
        )
        wanted = shapely.linestrings(edges[~(np.abs(edges[:, :, 0]) == 180).all(axis=1)])
        assert len(wanted) < len(edges) or shape.bounds[2] < 180
        drawn = np.array(
            [pair for part in shapely.get_parts(line) for pair in pairwise(part.coords)]
        )[:, :, :2]
        assert len(drawn) == len(wanted)
        assert (
            shapely.hausdorff_distance(
                shapely.multilinestrings(shapely.linestrings(drawn)),
                shapely.multilinestrings(wanted),
            )
            <= 4 * HALF
        )
    assert set(told) - {"MEAN", "Orion <1>"} == {
        f"{notation.hundredths(share)}% {notation.day_time(np.datetime64(time[:-1]))}"
        for time, share in known
    }


def test_no_segment_of_gpx_jumps_at_180_degrees(run: Path, tmp_path: Path) -> None:
    """The case lies across: outlines, mean and search are on both sides, and no two points that
    follow are a turn apart.
    """
    drift.export(run, "gpx", tmp_path / "out")
    segments = [
        [float(point.get("lon")) for point in segment]
        for path in sorted((tmp_path / "out").glob("*.gpx"))
        for segment in ET.parse(path).getroot().findall(".//{*}trkseg")
    ]
    assert max(abs(b - a) for segment in segments for a, b in pairwise(segment)) < 1
    assert {np.sign(segment[0]) for segment in segments} == {1.0, -1.0}


@pytest.mark.parametrize("east", [1, -1])
def test_a_line_is_cut_where_it_crosses(east: int) -> None:
    """Halfway in longitude: halfway in latitude and time; a point on the line belongs to both
    sides.
    """
    root, lon = ET.Element("trk"), [179.5, -179.5, -179.0] if east > 0 else [-179.5, 179.5, 179.0]
    times = [
        np.datetime64("2026-06-01T00:00", "ns"),
        np.datetime64("2026-06-01T02:00", "ns"),
        np.datetime64("2026-06-01T03:00", "ns"),
    ]
    gpx.segments(root, lon, [10.0, 20.0, 30.0], times)
    told = [
        [(float(p.get("lon")), float(p.get("lat")), p.findtext("time")) for p in part]
        for part in root
    ]
    ends = (179.9999999, -180.0) if east > 0 else (-180.0, 179.9999999)
    assert told == [
        [(lon[0], 10.0, "2026-06-01T00:00:00Z"), (ends[0], 15.0, "2026-06-01T01:00:00Z")],
        [(ends[1], 15.0, "2026-06-01T01:00:00Z"), (lon[1], 20.0, "2026-06-01T02:00:00Z"), (lon[2], 30.0, "2026-06-01T03:00:00Z")],
    ]  # fmt: skip
    root = ET.Element("trk")
    gpx.segments(root, [179.0, 180.0, -179.0], [0.0, 1.0, 2.0])
    assert [[float(p.get("lon")) for p in part] for part in root] == [
        [179.0, 179.9999999],
        [-180.0, -179.0],
    ]


def test_lines_of_geojson_go_the_short_way_however_they_are_written() -> None:
    for lon in ([179.0, -179.0], [179.0, 181.0], [-181.0, -179.0]):
        found = geojson.lines([shapely.LineString([(lon[0], 0), (lon[1], 2)])])
        assert found["coordinates"] == [
            [[179.0, 0.0], [180.0, 1.0]],
            [[-180.0, 1.0], [-179.0, 2.0]],
        ]


def test_outlines_of_cut_shapes() -> None:
    """A square against 180 degrees, one that the line only touches, and a hole through which it was
    cut twice.
    """
    square = [[179.0, 0.0], [180.0, 0.0], [180.0, 1.0], [179.0, 1.0], [179.0, 0.0]]
    assert list(plotter.open_rings(square)) == [
        [[180.0, 1.0], [179.0, 1.0], [179.0, 0.0], [180.0, 0.0]]
    ]
    touching = [[179.0, 0.0], [180.0, 0.5], [179.0, 1.0], [179.0, 0.0]]
    assert list(plotter.open_rings(touching)) == [touching]
    letter_c = [
        [-180.0, 0],
        [-178, 0],
        [-178, 3],
        [-180, 3],
        [-180, 2],
        [-179, 2],
        [-179, 1],
        [-180, 1],
        [-180, 0],
    ]
    found = list(plotter.open_rings(letter_c))
    assert sorted(map(len, found)) == [4, 4]
    assert [-179, 2] in found[0] or [-179, 2] in found[1]


def test_a_long_forecast_has_a_file_a_day(tmp_path: Path) -> None:
    """Each point and no other is in that of its day; a day on which nothing is anywhere has none."""
    times = np.datetime64("2026-06-01T18:00", "ns") + np.arange(10) * np.timedelta64(6, "h")
    lon, lat = np.linspace(179.5, 180.5, 10), np.linspace(-41.0, -40.0, 10)
    lat[5:9] = np.nan  # 3 June, all of it
    data = xr.Dataset(
        {
            f"{name}_{axis}": ("time", v)
            for name in ("mean", "datum")
            for axis, v in (("lon", lon), ("lat", lat))
        },
        {"time": times, "share": [0.5]},
        {"title": "t", "run_id": "r"},
    )
    made = plotter.files(Finished(tmp_path, frozenset(), data))
    assert list(made) == ["forecast-20260601.gpx", "forecast-20260602.gpx", "forecast-20260604.gpx"]
    told = [
        (point.findtext("{*}time"), float(point.get("lon")), float(point.get("lat")))
        for text in made.values()
        for point in ET.fromstring(text).findall("{*}wpt")
    ]
    kept = np.isfinite(lat)
    assert [time for time, _, _ in told] == [notation.iso(time) for time in times[kept]]
    assert np.abs((np.array([x for _, x, _ in told]) - lon[kept] + 180) % 360 - 180).max() <= HALF
    data["datum_lat"][:] = data["mean_lat"][:] = np.nan
    assert list(plotter.files(Finished(tmp_path, frozenset(), data))) == ["forecast-20260601.gpx"]


@pytest.mark.parametrize(
    ("corners", "tolerance"),
    [(1900, 0), (4000, 50), pytest.param(60_000, 500, marks=pytest.mark.thorough)],
)
def test_outlines_are_thinned_and_the_file_says_so(
    tmp_path: Path, corners: int, tolerance: int
) -> None:
    """A ragged circle of 20 nmi at 60 N: no point farther off than is told, in metres by the
    sphere, and fewer than 2,000 of them.
    """
    rng = np.random.default_rng(1)
    turn = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    metres = 20 * NMI + (
        60 * rng.uniform(-1, 1, corners) if corners < 50_000 else 400 * rng.uniform(-1, 1, corners)
    )
    ring = np.column_stack(
        [4 + metres * np.sin(turn) / METRES / 0.5, 60 + metres * np.cos(turn) / METRES]
    )
    speck = np.array([[3.0, 60.0], [3.0001, 60.0], [3.0001, 60.0001], [3.0, 60.0]])
    rings = [[[*ring.tolist(), ring[0].tolist()]], [speck.tolist()]]
    time = np.array(["2026-06-01T18:00"], "datetime64[ns]")
    names = {
        f"{name}_{axis}": ("time", [float(v)])
        for name in ("mean", "datum")
        for axis, v in (("lon", 4), ("lat", 60))
    }
    data = xr.Dataset(names, {"time": time, "share": [0.5]}, {"title": "t", "run_id": "r"})
    told = {"time": "2026-06-01T18:00:00Z", "level": 0.5, "area_nmi2": 1256.0}
    area = {
        "type": "Feature",
        "properties": told,
        "geometry": {"type": "MultiPolygon", "coordinates": rings},
    }
    (tmp_path / "contours.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": [area]})
    )
    contact = {"name": "flare", "kind": "contact", "time": "2026-06-01T12:00:00Z", "belief": 0.7}
    shapes = [
        ("point", {"type": "Point", "coordinates": [4.5, 60.5]}),
        ("line", {"type": "MultiLineString", "coordinates": [[[4.0, 60.0], [4.5, 60.5]]]}),
        ("region", {"type": "Polygon", "coordinates": [[[4, 60], [5, 60], [5, 61], [4, 60]]]}),
    ]
    features = [
        {"type": "Feature", "properties": {**contact, "shape": shape}, "geometry": g}
        for shape, g in shapes
    ]
    (tmp_path / "sorties.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": features})
    )
    (text,) = plotter.files(
        Finished(tmp_path, frozenset(["contours.geojson", "sorties.geojson"]), data)
    ).values()
    root = ET.fromstring(text)
    tracks = {
        track.findtext("{*}name"): track
        for track in root.findall("{*}trk")
        if track.findtext("{*}type") == "area"
    }
    (area_track,) = tracks.values()
    lines = [
        [(float(p.get("lon")), float(p.get("lat"))) for p in s]
        for s in area_track.findall("{*}trkseg")
    ]
    assert len(lines) == (2 if tolerance == 0 else 1)  # the speck is no wider than the tolerance
    assert sum(map(len, lines)) <= plotter.MOST
    said = f"their error is up to {tolerance} m"
    assert (said in text.decode()) == (tolerance > 0)
    flat = shapely.LineString(np.array(lines[0]) * (0.5 * METRES, METRES))
    off = shapely.distance(shapely.points(ring * (0.5 * METRES, METRES)), flat).max()
    assert off <= 1.03 * tolerance + 0.2  # the cosine is that of its middle, and digits are rounded
    assert ("flare", 4.5, 60.5) in [
        (p.findtext("{*}name"), float(p.get("lon")), float(p.get("lat")))
        for p in root.findall("{*}wpt")
    ]
    drawn = [
        t.findtext("{*}desc") for t in root.findall("{*}trk") if t.findtext("{*}type") == "contact"
    ]
    assert [words.split(", ")[1] for words in drawn] == ["line", "region"]


def test_waypoints_have_a_name_each() -> None:
    start = np.datetime64("2026-06-01T20:00:10", "s")
    close = plotter._names(start + np.array([0, 30, 80, 400]) * np.timedelta64(1, "s"))
    assert list(close.values()) == ["012000Z", "012000Zb", "012001Z", "012006Z"]
    months = plotter._names(start + np.arange(0, 70, 7) * np.timedelta64(1, "D"))
    assert len(set(months.values())) == 10
    assert months[start] == "06012000Z"


def test_rtz_of_the_plan(run: Path, tmp_path: Path) -> None:
    """By the rules of the schema of RTZ 1.0 (IEC 61174:2015), and with the ways and times of
    plan.json.
    """
    drift.export(run, "rtz", tmp_path / "out")
    taskings = json.loads((run / "plan.json").read_text())["taskings"]
    assert len(taskings) == 2
    for task in taskings:
        root = ET.parse(tmp_path / f"out/plan-{task['area']}.rtz").getroot()
        assert (root.tag, root.get("version")) == (f"{RTZ}route", "1.0")
        assert [child.tag for child in root] == [
            f"{RTZ}{name}" for name in ("routeInfo", "waypoints", "schedules")
        ]
        info = root[0].attrib
        assert info["routeName"] == f"{task['area']} {task['unit']}"
        assert (info["validityPeriodStart"], info["validityPeriodStop"]) == (
            task["takeoff"],
            task["home"],
        )
        points = list(root[1])
        assert [point.tag for point in points] == [f"{RTZ}waypoint"] * len(points)
        numbers = [point.get("id") for point in points]
        assert numbers == [str(k + 1) for k in range(len(points))]
        assert len(points) == 1 + 2 * task["legs"] + 1
        places = {point.get("name"): point.find(f"{RTZ}position").attrib for point in points}
        assert len(places) == len(points)
        assert all(
            -180 <= float(at["lon"]) < 180 and -90 <= float(at["lat"]) <= 90
            for at in places.values()
        )
        begin, csp = task["commence_search_point"], places[f"{task['area']} CSP"]
        assert abs((float(csp["lon"]) - begin["lon"] + 180) % 360 - 180) <= HALF
        assert abs(float(csp["lat"]) - begin["lat"]) <= HALF
        assert {leg.get("geometryType") for leg in root.iter(f"{RTZ}leg")} == {"Orthodrome"}
        (calculated,) = root.iter(f"{RTZ}calculated")
        # so it is spelled there
        assert {child.tag for child in calculated} == {f"{RTZ}sheduleElement"}
        assert [child.get("waypointId") for child in calculated] == numbers
        times = [child.get("etd") or child.get("eta") for child in calculated]
        assert times == sorted(times)
        assert times[0] == task["takeoff"]
        assert times[-1] == task["home"]
        assert task["on_scene"] in times


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


def test_the_command_names_the_formats_that_there_are() -> None:
    assert tuple(exporter.FORMATS) == export_command.FORMATS
