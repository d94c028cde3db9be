"""Numbers and shapes of a search: against Bayes' rule by hand, geodesics of pyproj, and GDAL's
reader.
"""

import csv
import io
import json
import math
from dataclasses import replace

import numpy as np
import pyogrio
import pyproj
import pytest
import searches
import shapely

from drift.evidence.filter import shapes as search_shapes
from drift.evidence.filter.products import chapter
from drift.evidence.filter.products import tables as search_tables
from drift.evidence.filter.updates import Update, Updates
from drift.products.files import formats
from drift.products.maps.imprint import Imprint, Setting
from geo import sphere

GEOD = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS)
NMI = 1852.0


@pytest.fixture(scope="module")
def search():
    return searches.search()


def rows(updates):
    return list(csv.DictReader(io.StringIO(search_tables.csv(updates, "run-s1"))))


def test_the_table_obeys_bayes(search):
    updates = search[3]
    read = rows(updates)
    assert len(read) == len(updates.all) * 4
    assert {row["run_id"] for row in read} == {"run-s1"}
    failed = dict.fromkeys((*searches.NAMES, "all"), 1.0)
    prior = dict(zip(searches.NAMES, updates.prior, strict=True))
    for k in range(len(updates.all)):
        some = {row["scenario"]: row for row in read[4 * k : 4 * k + 4]}
        evidence = {name: math.exp(float(some[name]["log_evidence"])) for name in some}
        whole = sum(prior[name] * evidence[name] for name in searches.NAMES)
        assert evidence["all"] == pytest.approx(whole, rel=1e-6)
        for name in searches.NAMES:
            assert float(some[name]["prior"]) == pytest.approx(prior[name], rel=1e-6)
            posterior = prior[name] * evidence[name] / whole
            assert float(some[name]["posterior"]) == pytest.approx(posterior, rel=1e-6)
            odds = posterior / (1 - posterior) / (prior[name] / (1 - prior[name]))
            assert float(some[name]["bayes_factor"]) == pytest.approx(odds, rel=1e-6)
            prior[name] = posterior
        for name, row in some.items():
            if row["kind"] == "contact":
                assert {row[key] for key in ("pod", "poc", "pos", "pos_cumulative")} == {""}
                continue
            pos = float(row["pos"])
            assert float(row["poc"]) * float(row["pod"]) == pytest.approx(pos, abs=1e-7)
            assert pos == pytest.approx(1 - evidence[name], abs=1e-7)
            failed[name] *= 1 - pos
            assert float(row["pos_cumulative"]) == pytest.approx(1 - failed[name], abs=1e-6)


def update(log_evidence):
    return Update(
        "u",
        "sortie",
        searches.BEGIN,
        np.array(log_evidence),
        np.zeros(len(log_evidence) - 1),
        1.0,
        1.0,
    )


def test_bayes_factors_of_certainties_and_of_the_improbable():
    two = np.array([0.9, 0.1])
    found = search_tables.bayes_factors(update([math.log(0.3), math.log(0.6), 0]), two)
    np.testing.assert_allclose(found, [0.5, 2.0])
    # densities that underflow
    far = search_tables.bayes_factors(update([-2000.0, -2003.0, 0]), two)
    np.testing.assert_allclose(far, [math.exp(3), math.exp(-3)])
    assert search_tables.bayes_factors(update([0.0, -math.inf, 0]), two).tolist() == [math.inf, 0.0]
    assert np.isnan(search_tables.bayes_factors(update([-1.0, -1.0]), np.ones(1))).all()
    # one is out already
    out = search_tables.bayes_factors(update([-1.0, -5.0, -2.0, 0]), np.array([0.5, 0.0, 0.5]))
    np.testing.assert_allclose(out, [math.e, np.nan, 1 / math.e])


def test_the_summary_is_json_and_ends_where_the_table_does(search):
    updates = search[3]
    told = json.loads(
        json.dumps(formats.plain(search_tables.summary_of_search(updates)), allow_nan=False)
    )
    assert (told["sorties"], told["contacts"]) == (4, 2)
    last = rows(updates)[-1]
    assert told["cumulative_pos"]["all"] == pytest.approx(float(last["pos_cumulative"]))
    assert told["scenarios"]["on passage"]["posterior"] == pytest.approx(
        float(rows(updates)[-2]["posterior"]), rel=1e-6
    )
    assert "pos" not in next(u for u in told["updates"] if u["kind"] == "contact")
    nothing = search_tables.summary_of_search(Updates(searches.NAMES, searches.PRIOR, ()))
    assert nothing["cumulative_pos"] is None
    assert nothing["scenarios"]["on passage"] == {"prior": 0.2, "posterior": 0.2}


@pytest.mark.parametrize(("lon", "lat"), [(-88.2, 27.8), (179.9, -61.0)])
def test_gdal_reads_the_shapes(tmp_path, lon, lat):
    done, seen = (
        (*searches.sorties(lon, lat), searches.watch(lon, lat)),
        searches.contacts(lon, lat),
    )
    made = search_tables.shapes(
        done, seen, Updates(searches.NAMES, searches.PRIOR, ()), {"run_id": "r"}
    )
    path = tmp_path / "sorties.geojson"
    path.write_text(json.dumps(formats.plain(made), allow_nan=False))
    meta, _, geometry, columns = pyogrio.raw.read(path)
    fields = dict(zip(meta["fields"], columns, strict=True))
    shapes = shapely.from_wkb(geometry)
    bounds = shapely.total_bounds(shapes)
    assert bounds[0] >= -180
    assert bounds[2] <= 180
    # no part goes round the Earth
    assert (shapely.bounds(shapely.get_parts(shapes))[:, [0, 2]] @ [-1, 1] < 20).all()
    for name, shape, size in (
        ("C-130 first light", "area", 24 * 16),
        ("Helicopter, fishing ground", "area", 18 * 14),
    ):
        one = shapes[(fields["name"] == name) & (fields["shape"] == shape)]
        area, _ = GEOD.geometry_area_perimeter(one[0])
        assert area / NMI**2 == pytest.approx(size, rel=2e-3)  # positive: anticlockwise
    legs = shapes[(fields["name"] == "C-130 first light") & (fields["shape"] == "legs")][0]
    assert GEOD.geometry_length(legs) / NMI == pytest.approx(8 * 22 + 7 * 2, rel=1e-3)
    zones = shapes[fields["shape"] == "zones"][0]
    assert GEOD.geometry_length(zones) / NMI == pytest.approx(2 * math.pi * (5 + 28 + 32), rel=1e-3)
    assert sorted(set(fields["shape"])) == ["area", "legs", "line", "point", "region", "zones"]


def test_what_stands_still_is_a_point():
    """A buoy has one place at both ends of its watch: no line is drawn from it, which would be
    empty.
    """
    lon, lat = 179.9, -61.0
    towed = searches.watch(lon, lat)
    buoy = replace(towed, name="buoy", legs=replace(towed.legs, lon=(lon, lon), lat=(lat, lat)))
    made = search_tables.shapes(
        (buoy,), (), Updates(searches.NAMES, searches.PRIOR, ()), {"run_id": "r"}
    )
    told = {feature["properties"]["shape"]: feature["geometry"] for feature in made["features"]}
    assert set(told) == {"point", "zones"}
    assert told["point"] == {"type": "Point", "coordinates": [lon, lat]}


def test_legs_so_far_are_as_long_as_the_time_allows():
    sortie = searches.sorties(-88.2, 27.8)[0]
    for minutes in (7, 23.5):
        until = sortie.start + np.timedelta64(round(60 * minutes), "s")
        ((searching, points),) = search_shapes.flown(sortie, until)
        assert searching
        assert GEOD.line_length(points[:, 0], points[:, 1]) / NMI == pytest.approx(
            180 * minutes / 60, rel=1e-3
        )
    assert search_shapes.flown(sortie, sortie.start) == []


def test_transit_is_apart_from_search():
    sortie = searches.sorties(-88.2, 27.8)[0]
    legs = replace(sortie.legs, searching=(False, *sortie.legs.searching[1:-1], False))
    parts = search_shapes.flown(replace(sortie, legs=legs))
    assert [searching for searching, _ in parts] == [False, True, False]
    np.testing.assert_allclose(parts[0][1][-1], parts[1][1][0])


def test_what_drifts_with_its_marker_is_moved_with_it():
    """The last vertex is off by the marker's way since the datum: 3/8 of it an hour and a half
    after 1.5 of 8 hours.
    """
    sortie = searches.sorties(179.9, -17.0)[3]
    ((_, points),) = search_shapes.flown(sortie)
    fixed = search_shapes.flown(replace(sortie, frame="ground"))[0][1]
    share = (sortie.legs.time[-1] - sortie.marker.time[0]) / (
        sortie.marker.time[-1] - sortie.marker.time[0]
    )
    course, _, way = GEOD.inv(*sortie.datum, sortie.marker.lon[1], sortie.marker.lat[1])
    lon, lat, _ = GEOD.fwd(*fixed[-1], course, share * way)
    off = GEOD.inv(lon, lat, *points[-1])[2]
    assert share * way > 2 * NMI
    assert off < 30  # [m]: offsets in two tangent planes
    early, late = (search_shapes.searched(sortie, time)[0] for time in (sortie.start, sortie.end))
    assert GEOD.inv(*early, *late)[2] / NMI == pytest.approx(2.5 / 8 * way / NMI, rel=0.01)


def test_a_contacts_shapes_hold_what_they_say():
    """A bivariate normal is within 2.45 standard deviations with 95 %; 4 standard errors of 20,000
    draws.
    """
    fix, bearing, ring, box = searches.contacts(179.8, 60.0)
    rng, n = np.random.default_rng(2), 20_000
    tolerance = 4 * math.sqrt(0.95 * 0.05 / n)
    along, across = rng.normal(size=(2, n)) * [[fix.major], [fix.minor]]
    turn, reach = np.degrees(fix.orientation + np.arctan2(across, along)), np.hypot(along, across)
    lon, lat, _ = GEOD.fwd(np.full(n, fix.fixes[0].lon), np.full(n, fix.fixes[0].lat), turn, reach)
    shapes = search_shapes.contact(fix)
    assert [name for name, _ in shapes] == ["point", "region", "point", "region"]
    inside = shapely.contains_xy(shapely.Polygon(shapes[1][1]), lon % 360, lat)
    # an outline of 72 corners lacks 0.1 %
    assert inside.mean() == pytest.approx(0.95, abs=tolerance + 2e-3)

    course = np.degrees(bearing.bearing + bearing.bearing_std * rng.normal(size=n))
    far = rng.uniform(bearing.near, bearing.far, n)
    lon, lat, _ = GEOD.fwd(
        np.full(n, bearing.sensor[0]), np.full(n, bearing.sensor[1]), course, far
    )
    wedge = dict(search_shapes.contact(bearing))["region"]
    inside = shapely.contains_xy(shapely.Polygon(wedge), lon % 360, lat)
    assert inside.mean() == pytest.approx(0.95, abs=tolerance + 2e-3)

    middle = search_shapes.contact(ring)[2][1]
    away = GEOD.inv(
        np.full(len(middle), ring.sensor[0]), np.full(len(middle), ring.sensor[1]), *middle.T
    )[2]
    np.testing.assert_allclose(away, ring.range, rtol=1e-9)
    assert GEOD.polygon_area_perimeter(*search_shapes.contact(box)[0][1].T)[
        0
    ] / NMI**2 == pytest.approx(-60, rel=1e-3)


def test_planned_sorties_are_told_from_flown_ones(search):
    """In every row and shape of a sortie, and in no other; the report draws those that have been
    flown.
    """
    updates = replace(search[3], sorties=searches.sorties(-88.2, 27.8))
    first, *others = updates.sorties
    mixed = replace(updates, sorties=(replace(first, planned=True), *others))
    wanted = {
        sortie.name: "planned" if sortie.name == first.name else "flown"
        for sortie in updates.sorties
    }
    assert set(wanted.values()) == {"planned", "flown"}
    assert [row["status"] for row in rows(mixed)] == [
        wanted[row["name"]] if row["kind"] == "sortie" else "" for row in rows(mixed)
    ]
    told = search_tables.summary_of_search(mixed)["updates"]
    assert {u["name"]: u["status"] for u in told if u["kind"] == "sortie"} == wanted
    shapes = search_tables.shapes(
        mixed.sorties, searches.contacts(0.0, 0.0), mixed, {"run_id": "r"}
    )["features"]
    for properties in (feature["properties"] for feature in shapes):
        assert properties.get("status") == (
            wanted[properties["name"]] if properties["kind"] == "sortie" else None
        )
    drawn = chapter.search_bundle(
        chapter.SearchOutputs(mixed, (), None, Setting(Imprint("a plan"))), mapped=False
    ).leaves
    names = {
        name for leaf in drawn[0]() if leaf["leaf"] == "shapes" for name in leaf["where"]["name"]
    }
    assert names == {sortie.name for sortie in others}
