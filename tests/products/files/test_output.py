"""Files of a run: what they hold, against the data that was written."""

import csv
import io
import json
from dataclasses import replace

import clouds
import numpy as np
import pyproj
import pytest
import shapely
import xarray as xr

from drift.engine.particles.status import Status
from drift.forecast import build as forecast_build
from drift.forecast.products import chapter as forecast_chapter
from drift.forecast.products import map as forecast_map
from drift.forecast.tracks import Trajectories
from drift.products.files import formats, writer
from drift.products.files.chapter import OutputBundle
from drift.products.maps.imprint import Imprint, Setting
from geo import notation, sphere

ATTRIBUTES = {
    "title": "test",
    "seed": "7",
    "source": "casp-drift 0",
    "case": "[case]\ntitle = 'test'",
}
TIMES = np.datetime64("2026-11-21T18:30:00") + np.array([0, 6, 12]) * np.timedelta64(3600, "s")


def scene(lon=179.9, lat=-17.2, n=3000):
    """Snapshots that drift east over the antimeridian; a tenth is ashore at the end."""
    rng = np.random.default_rng(3)
    east, north = rng.normal(0, 4000, n), rng.normal(0, 7000, n)
    scenario = rng.integers(0, 2, n).astype(np.int32)
    snapshots = []
    for i, time in enumerate(TIMES):
        x, y = sphere.destination(
            np.radians(lon), np.radians(lat), east + 9000 * i, north + 2000 * i
        )
        status = np.where((np.arange(n) % 10 == 0) & (i == 2), Status.ASHORE, Status.ADRIFT).astype(
            np.int32
        )
        snapshots.append(
            clouds.at(
                time,
                sphere.to_binary(np.degrees(x)),
                sphere.to_binary(np.degrees(y)),
                np.full(n, 1 / n),
                status,
                scenario,
            )
        )
    return snapshots


@pytest.fixture(scope="module")
def snapshots():
    return scene()


@pytest.fixture(scope="module")
def forecast(snapshots):
    return forecast_build.build_forecast(snapshots, scenarios=["raft alone", "boat"])


@pytest.fixture(scope="module")
def tracks(snapshots):
    some = np.arange(0, 3000, 50)
    columns = (
        np.stack([getattr(s, k)[some] for s in snapshots], 1)
        for k in ("lon", "lat", "status", "probability")
    )
    return Trajectories(TIMES, some, snapshots[0].scenario[some], *columns)


def ink(path):
    path.write_bytes(b"png")


def write(folder, forecast, tracks):
    matter = forecast_chapter.ForecastOutputs(forecast, tracks, Setting(Imprint("test")))
    whole = replace(forecast_chapter.forecast_bundle(matter), pictures={"map.png": ink})
    run = OutputBundle({"wall": {"advance": 1.5}}, facts=ATTRIBUTES)
    return writer.write(folder, [run, whole])


@pytest.fixture(scope="module")
def written(tmp_path_factory, forecast, tracks):
    """A folder of results, for those who read them."""
    folder = tmp_path_factory.mktemp("above") / "new" / "out"
    return folder, write(folder, forecast, tracks)


@pytest.fixture
def out(written):
    return written[0]


@pytest.mark.parametrize(("opens", "shown"), [(None, -1), (0, 0), (1, 1)])
def test_map_png_is_of_the_output_that_matters(
    monkeypatch, tmp_path, forecast, tracks, opens, shown
):
    drawn = []
    monkeypatch.setattr(forecast_map, "draw_map", lambda *_, time, **__: drawn.append(TIMES[time]))
    setting = Setting(
        Imprint("test"), opens=None if opens is None else TIMES[opens] + np.timedelta64(5, "s")
    )
    pictures = forecast_chapter.forecast_bundle(
        forecast_chapter.ForecastOutputs(forecast, tracks, setting)
    ).pictures
    pictures["map.png"](tmp_path / "map.png")
    assert drawn == [TIMES[shown]]


def test_all_files_and_nothing_else(written):
    folder, paths = written
    names = {
        "forecast.nc",
        "particles.nc",
        "summary.json",
        "contours.geojson",
        "track.csv",
        "ashore.csv",
        "map.png",
    } | {"manifest.json"}
    assert {p.name for p in paths} == names == {p.name for p in folder.iterdir()}
    assert [p.name for p in folder.parent.iterdir()] == ["out"]


def test_forecast_opens_decoded_and_follows_cf(out, forecast):
    with xr.open_dataset(out / "forecast.nc") as data:  # warnings are errors
        data.load()
    np.testing.assert_array_equal(data["time"].values, TIMES.astype("datetime64[ns]"))
    np.testing.assert_array_equal(data["probability"].values, forecast.data["probability"].values)
    np.testing.assert_array_equal(
        data["containment_area"].values, forecast.data["containment_area"].values
    )
    assert list(data["scenario"].values) == ["raft alone", "boat"]
    assert data.attrs["Conventions"] == "CF-1.11, ACDD-1.3"
    assert {*ATTRIBUTES, "history"} <= set(data.attrs)
    assert (np.diff(data["lon"].values) > 0).all()
    assert data["lon"].values[-1] > 180
    for name, variable in data.variables.items():
        if str(name).endswith("_bnds"):  # edges have the attributes of their coordinate (CF, 7.1)
            continue
        assert "long_name" in variable.attrs, name
        if variable.dtype.kind == "f":
            assert "units" in variable.attrs, name
        for other in variable.attrs.get("cell_measures", "").split()[1::2]:
            assert other in data
    # a label, by one call
    assert data.set_xindex("status").sel(status="ashore")["status_probability"].shape == (3,)
    assert data.attrs["time_coverage_start"] == notation.iso(TIMES[0])
    assert data.attrs["geospatial_lon_max"] == data["lon"].values[-1]
    np.testing.assert_allclose(data["lon_bnds"].mean("bnds"), data["lon"], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(data["lat_bnds"][1:, 0], data["lat_bnds"][:-1, 1])
    with xr.open_dataset(out / "forecast.nc", decode_cf=False) as raw:
        assert raw["time"].attrs["units"].startswith("seconds since")
        assert "_FillValue" not in raw["lon"].attrs


@pytest.mark.parametrize(
    ("file", "along"), [("forecast.nc", {"lat", "lon"}), ("particles.nc", {"trajectory", "time"})]
)
def test_every_file_says_on_which_earth_it_is(out, file, along):
    """PROJ makes the sphere of our distances of it, and leaves positions where they are on a chart."""
    # a reference that is broken is a warning
    with xr.open_dataset(out / file, decode_coords="all") as data:
        referring = {
            name for name, v in data.data_vars.items() if v.encoding.get("grid_mapping") == "crs"
        }
        assert referring == {name for name, v in data.data_vars.items() if along <= set(v.dims)}
        crs = pyproj.CRS.from_cf(data["crs"].attrs)
    assert crs.get_geod().a == crs.get_geod().b == sphere.RADIUS
    assert pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(
        179.9, -17.2
    ) == (179.9, -17.2)


def test_particles_are_cf_trajectories(out, tracks):
    with xr.open_dataset(out / "particles.nc") as data:
        data.load()
    assert data.attrs["featureType"] == "trajectory"
    assert data["trajectory"].attrs["cf_role"] == "trajectory_id"
    assert data["lon"].dims == ("trajectory", "time")
    assert set(data["status"].coords) >= {"lon", "lat", "time"}
    np.testing.assert_allclose(
        (data["lon"].values + 180) % 360 - 180, sphere.to_degrees(tracks.lon), atol=1e-9
    )
    assert np.abs(np.diff(data["lon"].values, axis=1)).max() < 1  # no jump of 360
    assert data["status"].attrs["flag_meanings"].split()[Status.ASHORE] == "ashore"


def test_same_data_bit_for_bit(tmp_path, out, snapshots, tracks):
    write(
        tmp_path / "b",
        forecast_build.build_forecast(snapshots, scenarios=["raft alone", "boat"]),
        tracks,
    )
    for file in ("forecast.nc", "particles.nc"):
        with xr.open_dataset(out / file) as one, xr.open_dataset(tmp_path / "b" / file) as two:
            assert one.equals(two)
    for file in ("track.csv", "ashore.csv"):
        assert (out / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_summary_is_strict_json(out):

    def refuse(token):
        raise AssertionError(token)

    summary = json.loads((out / "summary.json").read_text(), parse_constant=refuse)
    assert summary["seed"] == "7"
    assert summary["wall"] == {"advance": 1.5}
    last = summary["outputs"][-1]
    assert last["time"] == "2026-11-22T06:30:00Z"
    assert last["date_time_group"] == "220630ZNOV26"
    assert sum(last["probability"].values()) == pytest.approx(1)
    assert last["probability"]["ashore"] == pytest.approx(0.1)
    assert last["area_km2"]["95%"] / last["area_nmi2"]["95%"] == pytest.approx(1.852**2)
    assert last["mean"]["text"].startswith("17-09.")
    assert -180 <= last["mean"]["lon"] < -179  # it has crossed
    assert [s["name"] for s in summary["scenarios"]] == ["raft alone", "boat"]


def test_contours_are_valid_geojson(out):
    collection = json.loads((out / "contours.geojson").read_text())
    assert collection["type"] == "FeatureCollection"
    assert len(collection["features"]) == 9
    assert collection["title"] == "test"
    crossing = False
    for feature in collection["features"]:
        shape = shapely.geometry.shape(feature["geometry"])
        assert shape.is_valid
        west, _, east, _ = shape.bounds
        assert west >= -180
        assert east <= 180
        assert all(
            part.exterior.is_ccw and not any(hole.is_ccw for hole in part.interiors)
            for part in shape.geoms
        )
        # cut, not drawn round the globe
        assert all(part.bounds[2] - part.bounds[0] < 10 for part in shape.geoms)
        crossing |= west < -179 and east > 179
        # an equal-area projection of our own: cylinder at this latitude, 0.5 % from contour to
        # cells
        size = shapely.transform(
            shape, lambda xy: np.column_stack([np.radians(xy[:, 0]), np.sin(np.radians(xy[:, 1]))])
        ).area
        assert size * sphere.RADIUS**2 / 1e6 == pytest.approx(
            feature["properties"]["area_km2"], rel=0.01
        )
    assert crossing


def test_tables(out):
    run_id = json.loads((out / "summary.json").read_text())["run_id"]
    assert run_id.endswith("-s7")
    rows = list(csv.DictReader(io.StringIO((out / "track.csv").read_text())))
    assert {r["run_id"] for r in rows} == {run_id}
    # as many values as names, in one header row
    assert all(None not in r and None not in r.values() for r in rows)
    assert [r["date_time_group"] for r in rows] == ["211830ZNOV26", "220030ZNOV26", "220630ZNOV26"]
    assert float(rows[-1]["probability_ashore"]) == pytest.approx(0.1)
    assert float(rows[0]["mean_lat"]) == pytest.approx(-17.2, abs=0.02)
    rows = list(csv.DictReader(io.StringIO((out / "ashore.csv").read_text())))
    assert {r["run_id"] for r in rows} == {run_id}
    # four digits a row
    assert sum(float(r["probability_ashore"]) for r in rows) == pytest.approx(0.1, rel=1e-2)
    assert {r["first_time"] for r in rows} == {"2026-11-22T06:30:00Z"}


@pytest.mark.parametrize(
    ("lon", "lat", "text"),
    [
        (-87.5, 28.7, "28-42.0N 087-30.0W"),
        (180.25, -0.99999, "01-00.0S 179-45.0W"),
        (5.0, 60.0, "60-00.0N 005-00.0E"),
        (np.nan, 1.0, None),
    ],
)
def test_positions_in_degrees_and_minutes(lon, lat, text):
    assert notation.position(lon, lat) == text


@pytest.mark.parametrize("direction", [1, -1])
def test_release_and_end_of_trajectories(tmp_path, forecast, tracks, direction):
    m = len(tracks.slot)
    events = {
        "release": np.arange(m, dtype=np.int32),
        "ended": np.where(np.arange(m) % 2 == 0, 7201, 0).astype(np.int32),
        "edge": np.where(np.arange(m) % 2 == 0, 40, -1).astype(np.int32),
    }
    status = tracks.status.copy()
    status[:, -1] = np.where(np.arange(m) % 2 == 0, Status.ASHORE, Status.ADRIFT)
    write(
        tmp_path / "out",
        forecast,
        replace(tracks, time=TIMES[::direction], status=status, **events),
    )
    with xr.open_dataset(tmp_path / "out" / "particles.nc") as data:
        data.load()
    start, second = TIMES[::direction][0], np.timedelta64(direction, "s")
    np.testing.assert_array_equal(data["time_released"].values, start + np.arange(m) * second)
    assert (data["time_ended"].values[::2] == start + 7201 * second).all()
    assert np.isnat(data["time_ended"].values[1::2]).all()
    np.testing.assert_array_equal(data["coast_edge"].values, events["edge"])


def test_numbers_that_json_lacks_are_null_in_lists_too() -> None:
    given = {"a": [1.0, 2.5], "b": [1.0, float("nan")], "c": (3.0, float("-inf"), [float("inf")])}
    expected = {"a": [1.0, 2.5], "b": [1.0, None], "c": [3.0, None, [None]]}
    assert json.loads(json.dumps(formats.plain(given), allow_nan=False)) == expected
    assert json.loads(formats.json_text(given)) == expected


@pytest.mark.parametrize("last", [0.25, float("nan")])
def test_json_text_is_that_of_plain_values(last) -> None:
    """What JSON lacks, of any type, becomes the same text with and without a copy of it all."""
    given = {
        "one": [np.float32(0.1), np.float64(0.1), np.int64(7), np.bool_(True), (1, 2)],
        "two": {3: np.array([[1.5, 2.5]]), "when": np.datetime64("2026-11-22T06:30:00")},
        "last": last,
    }
    expected = json.dumps(formats.plain(given), allow_nan=False, separators=(",", ":"))
    assert formats.json_text(given, separators=(",", ":")) == expected
