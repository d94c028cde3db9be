"""Exports of tracks and routes for plotters: GPX and RTZ."""

import json
import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
import xarray as xr
from exported import HALF, contours, layer

import drift
from drift.apps.export import plotter
from drift.apps.export.finished import Finished
from geo import notation

RTZ = "{http://www.cirm.org/RTZ/1/0}"


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
