"""Files of washup say what the data say."""

import csv
import io
import json

import numpy as np
import pytest
import shapely
import xarray as xr
from washup_spills import START, build, level, once, random_spill, spill, stretches

from drift.spills.worlds.fates import FOREVER
from drift.spills.worlds.products import tables as washup_tables
from geo.coast.segments import Segments


def test_netcdf_there_and_back(tmp_path):
    fates, draws = random_spill(np.random.default_rng(4))
    made = build(fates, stretches(4), draws, level(5), np.arange(0, 40, 8), START, ["drum", "box"])
    made.to_netcdf(tmp_path / "washup.nc")
    with xr.open_dataset(tmp_path / "washup.nc") as back:
        assert back["first_arrival"].dtype.kind == "M"
        assert back["first_arrival_se"].dtype.kind == "f"
        np.testing.assert_array_equal(back["expected"].values, made["expected"].values)
        assert set(back["name"].values) == set(made["name"].values)


def test_tables_say_what_the_data_say():
    fates, draws = random_spill(np.random.default_rng(5), worlds=40)
    outputs = np.arange(-8, 40, 8)
    made = build(fates, stretches(4), draws, level(40), outputs, START, ["drum", "box"])
    rows = list(csv.DictReader(io.StringIO(washup_tables.washup_csv(made, "abc-s1"))))
    assert [int(row["rank"]) for row in rows] == list(range(1, 1 + made.sizes["segment"]))
    worst = [float(row["expected"]) for row in rows]
    assert worst == sorted(worst, reverse=True)
    for row in rows:
        at = made.sel(segment=int(row["segment"]))
        assert float(row["expected"]) == pytest.approx(at["expected"].values[-1], rel=1e-5)
        assert float(row["number_90"]) == at["number"].values[2, -1]
        assert float(row["expected_drum"]) == pytest.approx(
            at["expected_by_kind"].values[0, -1], rel=1e-5
        )
        moment = np.datetime64(row["first_50"].removesuffix("Z"))
        assert moment == np.datetime64(round(at["first_arrival"].values[1].item()), "s")
        assert float(row["first_50_h"]) == pytest.approx(
            (moment - START) / np.timedelta64(1, "h"), abs=0.01
        )
        assert list(row)[-1] == "run_id"
        assert row["run_id"] == "abc-s1"
    rows = list(csv.DictReader(io.StringIO(washup_tables.washup_times_csv(made, "abc-s1"))))
    assert len(rows) == np.count_nonzero(made["arrived"].values) < made["arrived"].size
    for row in rows:
        at = made.sel(
            segment=int(row["segment"]), time=np.datetime64(row["time"].removesuffix("Z"))
        )
        assert float(row["probability"]) == pytest.approx(at["probability"].item(), abs=1e-6)
    rows = list(csv.DictReader(io.StringIO(washup_tables.totals_csv(made, "abc-s1"))))
    every = [float(row["expected"]) for row in rows]
    np.testing.assert_allclose(np.reshape(every, (-1, 7)), made["total"].values.T, rtol=1e-5)


def test_geojson_is_cut_at_the_antimeridian():
    lines = np.array(
        [
            shapely.LineString([(179.9, -17), (180.1, -16.9), (180.2, -16.9)]),
            shapely.LineString([(-190, 3), (-191, 4)]),
        ],
        object,
    )
    where = Segments(("across", "wrapped"), np.array([3e4, 1e5]), np.array([-180.0, 169.5]), np.array([-17.0, 3.5]),
                     np.arange(2), lines, ("wild", "town"))  # fmt: skip
    fates = spill([0, 0], [(0, 0, 5, FOREVER), (1, 1, 5, FOREVER)])
    made = build(fates, where, [once([3, 1], 1)], level(1), np.array([10]), START)
    made = json.loads(
        json.dumps(
            washup_tables.washup_geojson(made, where, {"run_id": "x", "title": "T"}),
            allow_nan=False,
        )
    )
    assert made["run_id"] == "x"
    across, wrapped = (shapely.geometry.shape(f["geometry"]) for f in made["features"])
    assert across.geom_type == wrapped.geom_type == "MultiLineString"
    assert [part.bounds for part in across.geoms] == [
        (179.9, -17, 180, -16.95),
        (-180, -16.95, -179.8, -16.9),
    ]
    np.testing.assert_allclose(wrapped.bounds, (169, 3, 170, 4))
    properties = made["features"][0]["properties"]
    assert (properties["name"], properties["expected"], properties["rank"]) == ("across", 3, 1)
    assert properties["first_50"] == "1973-11-21T18:00:05Z"
    assert properties["expected_se"] is None
