"""Files of a plan: read by GDAL and tomllib, in the order of elements of their standards, and back
by our own input.
"""

import json
import math
import tomllib
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyogrio
import pyproj
import pytest
import searches
import shapely

from drift.case.search import sortie as sortie_table
from drift.evidence.filter.records import Law
from drift.planning.search.products import files as plan_files
from drift.products.files import formats
from geo import polyline, sphere

GEOD = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS)
NMI = 1852.0
PLACES = [(-88.2, 27.8), (179.9, -61.0)]
# The sequences of GPX 1.1 (topografix.com/GPX/1/1/gpx.xsd)
SEQUENCE = {
    "gpx": ["metadata", "wpt", "rte", "trk", "extensions"],
    "metadata": ["name", "desc", "author", "copyright", "link", "time", "keywords", "bounds", "extensions"],
    "wpt": ["ele", "time", "magvar", "geoidheight", "name", "cmt", "desc", "src", "link", "sym", "type"],
    "rte": ["name", "cmt", "desc", "src", "link", "number", "type", "extensions", "rtept"],
    # and of KML 2.2 (OGC 07-147r2, ogckml22.xsd), as far as they are used
    "Document": ["name", "visibility", "open", "description", "TimeSpan", "styleUrl", "Style", "ExtendedData", "Folder"],
    "Folder": ["name", "visibility", "open", "description", "TimeSpan", "styleUrl", "Style", "Placemark"],
    "Placemark": ["name", "visibility", "open", "description", "TimeSpan", "styleUrl", "Style", "ExtendedData",
                  "Point", "LineString", "Polygon", "MultiGeometry"],
    "Polygon": ["extrude", "tessellate", "altitudeMode", "outerBoundaryIs", "innerBoundaryIs"],
    "LineString": ["extrude", "tessellate", "altitudeMode", "coordinates"],
    "Style": ["IconStyle", "LabelStyle", "LineStyle", "PolyStyle"],
}  # fmt: skip
SEQUENCE["rtept"] = SEQUENCE["wpt"]


def in_order(root):
    for element in root.iter():
        wanted = SEQUENCE.get(element.tag.split("}")[1])
        if wanted is not None:
            order = [wanted.index(child.tag.split("}")[1]) for child in element]
            assert order == sorted(order)


def read(path, layer=None):
    meta, _, geometry, columns = pyogrio.raw.read(path, layer=layer)
    return shapely.from_wkb(geometry), dict(zip(meta["fields"], columns, strict=True))


def write(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(("lon", "lat"), PLACES)
def test_routes_lead_from_base_over_the_legs_home(tmp_path, lon, lat):
    plan = searches.plan(lon, lat, rounds=2)
    text = plan_files.gpx(plan, 'A & B <"bo\x00at">', "run-s1")
    in_order(ET.fromstring(text))
    path = write(tmp_path, "plan.gpx", text)
    lines, fields = read(path, "routes")
    assert fields["name"].tolist() == [
        "A-1 CG 1503",
        "A-2 Rescue 6021, a helicopter",
        "A-3 Cutter Venturous",
        "B-1 CG 1503",
    ]
    points, told = read(path, "route_points")
    for k, (line, one) in enumerate(zip(lines, plan.taskings, strict=True)):
        legs = np.array([one.sortie.legs.lon, one.sortie.legs.lat]).T
        way = np.array([one.unit.base, *legs, one.unit.return_to])
        way[:, 0] = (way[:, 0] + 180) % 360 - 180
        np.testing.assert_allclose(shapely.get_coordinates(line), way, atol=1e-7)
        mine = told["route_fid"] == k
        assert told["name"][mine][1].endswith("CSP")
        assert len(set(told["name"][mine])) == mine.sum()
        times = told["time"][mine].astype("datetime64[s]")
        assert (np.diff(times) >= np.timedelta64(0, "s")).all()
        assert times[[0, 1, -1]].tolist() == [
            t.item() for t in (one.takeoff, one.on_scene, one.home)
        ]
    assert len(points) == sum(len(one.sortie.legs.lon) + 2 for one in plan.taskings)
    waypoints, named = read(path, "waypoints")
    assert named["name"].tolist() == ["A-1 CSP", "A-2 CSP", "A-3 CSP", "B-1 CSP"]
    assert (np.abs(shapely.get_x(waypoints)) <= 180).all()


@pytest.mark.parametrize(("lon", "lat"), PLACES)
def test_kml_holds_the_rectangles(tmp_path, lon, lat):
    plan = searches.plan(lon, lat)
    text = plan_files.kml(plan, 'A & B <"boat">')
    in_order(ET.fromstring(text))
    path = write(tmp_path, "plan.kml", text)
    layers = [name for name, _ in pyogrio.list_layers(path)]
    assert layers == ["A-1 CG 1503", "A-2 Rescue 6021, a helicopter", "A-3 Cutter Venturous"]
    for layer, one in zip(layers, plan.taskings, strict=True):
        shapes, fields = read(path, layer)
        shapes = dict(zip(fields["Name"], shapely.force_2d(shapes), strict=True))
        name = layer.split()[0]
        size = GEOD.geometry_area_perimeter(shapes[name])[0] / (one.length * one.width)
        assert size == pytest.approx(1, rel=2e-3)
        assert GEOD.geometry_length(shapes[f"{name} legs"]) == pytest.approx(
            polyline.lengths(one.sortie.legs).sum(), rel=1e-6
        )
        csp = shapes[f"{name} csp"]
        assert GEOD.inv(csp.x, csp.y, one.sortie.legs.lon[0], one.sortie.legs.lat[0])[2] < 0.1
        bounds = shapely.bounds(shapely.get_parts(list(shapes.values())))
        assert bounds[:, 0].min() >= -180
        assert bounds[:, 2].max() <= 180
        assert (bounds[:, 2] - bounds[:, 0]).max() < 20


@pytest.mark.parametrize(("lon", "lat"), PLACES)
def test_geojson_is_cut_and_turns_left(tmp_path, lon, lat):
    plan = searches.plan(lon, lat)
    made = plan_files.geojson(plan, {"run_id": "r", "title": "t"})
    path = write(tmp_path, "plan.geojson", json.dumps(formats.plain(made), allow_nan=False))
    shapes, fields = read(path)
    assert fields["shape"].tolist() == ["area", "legs", "transit", "csp"] * 3
    assert fields["area"].tolist() == [name for name in ("A-1", "A-2", "A-3") for _ in range(4)]
    for shape, one in zip(shapes[::4], plan.taskings, strict=True):
        assert GEOD.geometry_area_perimeter(shape)[0] / (one.length * one.width) == pytest.approx(
            1, rel=2e-3
        )
        west, _, east, _ = shape.bounds
        assert -180 <= west < east <= 180
    if lon > 179:
        assert shapely.get_num_geometries(shapes[0]) == 2


def test_the_numbers_are_json():
    told = json.loads(
        json.dumps(formats.plain(plan_files.plan_as_json(searches.plan())), allow_nan=False)
    )
    assert told["share_of_bound"] == pytest.approx(0.471 / 0.528)  # on the same particles
    assert (told["bound"], told["bound_error"], told["no_bound"]) == (0.528, 0.004, None)
    none = json.loads(
        json.dumps(
            formats.plain(
                plan_files.plan_as_json(replace(searches.plan(), bound=None, unbounded="few"))
            )
        )
    )
    assert (none["bound"], none["bound_error"], none["share_of_bound"], none["no_bound"]) == (
        None,
        None,
        None,
        "few",
    )
    assert told["optimism"] == pytest.approx(0.008)
    assert told["taskings"][0]["spacing_nmi"] == pytest.approx(3)
    assert told["taskings"][0]["altitude_ft"] == pytest.approx(500)
    assert told["taskings"][2]["search_speed_kn"] == pytest.approx(14)
    assert told["pos_by_scenario"]["on passage"] == 0.49


def sorties(text):
    """Return the records that a case file's reader makes of tables."""
    rows = [sortie_table.SortieTable.model_validate(row) for row in tomllib.loads(text)["sortie"]]
    scenarios = [
        SimpleNamespace(name=name, search_object=None, itinerary=None, family=None, changes=())
        for name in searches.NAMES
    ]
    return sortie_table.build_sorties(
        rows, sortie_table.Run(searches.BEGIN, searches.hours(48), scenarios, Path())
    )


@pytest.mark.parametrize(("lon", "lat"), PLACES)
def test_the_tables_give_the_sorties_back(lon, lat):
    plan = searches.plan(lon, lat, rounds=2)
    text = plan_files.toml(plan, taken=["A-1 CG 1503"])
    names = [row["name"] for row in tomllib.loads(text)["sortie"]]
    assert names == [
        "A-1 CG 1503 (2)",
        "A-2 Rescue 6021, a helicopter",
        "A-3 Cutter Venturous",
        "B-1 CG 1503",
    ]
    assert all(row["pattern"]["kind"] == "parallel" for row in tomllib.loads(text)["sortie"])
    back = {sortie.name: sortie for sortie in sorties(text)}
    for name, one in zip(names, plan.taskings, strict=True):
        made, sortie = back[name], one.sortie
        apart = sphere.distance(
            *np.radians([made.legs.lon, made.legs.lat, sortie.legs.lon, sortie.legs.lat])
        )
        assert apart.max() < 3  # [m]
        np.testing.assert_allclose(made.legs.time, sortie.legs.time, atol=1.0)
        np.testing.assert_allclose(made.sweep_width, sortie.sweep_width)
        assert (made.law, made.kind, made.group) == (sortie.law, sortie.kind, sortie.group)
        assert made.shape == pytest.approx(sortie.shape, rel=1e-6)
        assert made.spacing == pytest.approx(sortie.spacing)
        assert made.altitude == pytest.approx(sortie.altitude)


def test_other_legs_are_written_as_waypoints_and_areas_with_their_coverage():
    plan = searches.plan()
    first, second, third = plan.taskings
    legs = first.sortie.legs
    odd = replace(legs, lon=(legs.lon[0] + 0.01, *legs.lon[1:]))
    ring = third.sortie.area
    areas = replace(
        third.sortie, legs=None, law=Law("random"), coverage=(0.5, 0.5, 0.8125), area=ring
    )
    curve = Law("curve", ranges=(0.0, 1000.0, 2000.0), chances=(0.9, 0.4, 0.0))
    taskings = (
        replace(first, sortie=replace(first.sortie, legs=odd)),
        replace(second, sortie=replace(second.sortie, law=curve)),
        replace(third, sortie=areas),
    )
    back = {
        sortie.name: sortie for sortie in sorties(plan_files.toml(replace(plan, taskings=taskings)))
    }
    np.testing.assert_allclose(back["A-1 CG 1503"].legs.lon, odd.lon, atol=2e-6)
    np.testing.assert_allclose(back["A-1 CG 1503"].legs.time, odd.time, atol=1.0)
    assert back["A-2 Rescue 6021, a helicopter"].law == curve
    made = back["A-3 Cutter Venturous"]
    np.testing.assert_allclose(made.coverage, areas.coverage, rtol=1e-6)
    assert (made.start, made.end, made.legs) == (areas.start, areas.end, None)
    assert (
        GEOD.inv(
            made.area.lon[0],
            made.area.lat[0],
            *min(ring.ring, key=lambda p: math.dist(p, (made.area.lon[0], made.area.lat[0]))),
        )[2]
        < 3
    )


def test_names_that_are_hard_to_write_are_kept():
    plan = searches.plan()
    name = 'Sæbjørn "II" \\ \x7f \t – 1'
    taskings = (replace(plan.taskings[0], unit=replace(plan.taskings[0].unit, name=name)),)
    odd = replace(plan, taskings=taskings, scenarios=('a "b"', "c.d", "é\n"))
    (row,) = tomllib.loads(plan_files.toml(odd))["sortie"]
    assert row["name"] == f"A-1 {name}"
    assert list(row["sweep_width"]) == ['a "b"', "c.d", "é\n"]
    assert ET.fromstring(plan_files.gpx(odd)).find(
        ".//{*}rte/{*}name"
    ).text == f"A-1 {name}".replace("\t", "")
    assert "Sæbjørn" in ET.fromstring(plan_files.kml(odd)).find(".//{*}Folder/{*}name").text


def test_sweep_widths_of_a_family_are_written_once() -> None:
    """A family has that of most of its scenarios; one that differs, and one of no family, has its
    own.
    """
    plan = replace(
        searches.plan(), scenarios=("f, a", "f, b", "f, c", "own"), families=("f", "f", "f", None)
    )
    told = plan_files._widths([1852.0, 3704.0, 1852.0, 0.0], plan)
    assert told == '{ "f" = "1 nmi", "f, b" = "2 nmi", "own" = "0 nmi" }'
    assert plan_files._widths([1852.0] * 4, plan) == '"1 nmi"'
