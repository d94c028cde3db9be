"""A table of losses is the same however its file is written."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from loss_tables import FOUR, PLACES, ROUNDING, WHOLE, same
from sensor_tables import BEARING, LAT, LON, RANGE, Table, loss

from drift.evidence.sensors import losses
from geo.errors import UserError

VARIANTS: dict[str, Table] = {
    "plain": Table(),
    "range first": Table(dims=("range", "bearing")),
    "packed": Table(dtype="i2"),
    "single precision": Table(dtype="f4"),
    "km": Table(units={"range": "km"}),
    "nmi": Table(units={"range": "nmi"}),
    "radians": Table(units={"bearing": "rad"}),
    "radials": Table(names={"bearing": "radial"}),
    "azimuth, dist": Table(names={"bearing": "azimuth", "range": "dist"}),
    "dB re 1 m": Table(units={"tl": "dB re 1 m"}),
    "dB//1m": Table(units={"tl": "dB//1m"}),
    "no unit of loss": Table(units={"tl": None}),
    "depth of size 1": Table(further={"depth": np.array([100.0])}),
    "standard names": Table(
        names={"bearing": "n1", "range": "n2"},
        attributes={
            "n1": {"standard_name": "sensor_azimuth_angle"},
            "n2": {"standard_name": "projection_range_coordinate"},
        },
    ),
    "long names": Table(
        names={"bearing": "n1", "range": "n2"},
        attributes={
            "n1": {"long_name": "bearing of the radial"},
            "n2": {"long_name": "range from the array"},
        },
    ),
    "an angle": Table(names={"bearing": "n1"}),
    "loss by another name": Table(
        variable="field", attributes={"field": {"long_name": "transmission loss"}}
    ),
}


@pytest.mark.parametrize("kind", VARIANTS)
def test_each_way_of_writing_gives_the_same_table(kind: str, tmp_path: Path) -> None:
    read = losses.read_losses(VARIANTS[kind].write(tmp_path / "a.nc"))
    same(read)
    assert read.lon.size == read.lat.size == 0
    assert read.name == "a.nc"


def shuffled(draw: st.DrawFn, count: int) -> np.ndarray:
    return np.array(draw(st.permutations(range(count))))


@st.composite
def written(draw: st.DrawFn) -> tuple[Table, np.ndarray]:
    """A file of four places, and the order of its places."""
    rows = [shuffled(draw, 4), shuffled(draw, len(BEARING)), shuffled(draw, len(RANGE))]
    turns = 360.0 * np.array(
        draw(st.lists(st.integers(-1, 0), min_size=len(BEARING), max_size=len(BEARING)))
    )
    table = FOUR.but(
        bearing=BEARING + turns,
        rows=rows,
        values=PLACES,
        dims=draw(st.permutations(["place", "bearing", "range", "depth"])),
        units={
            "bearing": draw(st.sampled_from(["degree", "rad"])),
            "range": draw(st.sampled_from(["m", "km", "nmi"])),
        },
        further={"depth": np.array([50.0])} if draw(st.booleans()) else {},
        dtype=draw(st.sampled_from(["f8", "f4", "i2"])),
        places=(LON + 360.0 * (LON < 0) if draw(st.booleans()) else LON, LAT),
    )
    return table, rows[0]


@settings(
    max_examples=40,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(written())
def test_any_order_and_packing_gives_the_same_table(
    tmp_path: Path, case: tuple[Table, np.ndarray]
) -> None:
    table, order = case
    read = losses.read_losses(table.write(tmp_path / "a.nc"))
    same(read, PLACES[order])
    np.testing.assert_allclose(np.degrees(read.lon), LON[order], atol=1e-9)
    np.testing.assert_allclose(np.degrees(read.lat), LAT[order], atol=1e-9)


@pytest.mark.parametrize("unit", ["degree", "rad"])
@pytest.mark.parametrize("end", [360.0, 359.9999, -1e-5])
def test_0_and_360_both_there_count_once(end: float, unit: str, tmp_path: Path) -> None:
    both = np.append(BEARING, end)
    same(
        losses.read_losses(
            Table(bearing=both, values=loss(both, RANGE), units={"bearing": unit}).write(
                tmp_path / "a.nc"
            )
        )
    )


def test_bearings_in_single_precision_radians_close_the_circle(tmp_path: Path) -> None:
    path = Table(bearing=np.append(BEARING, 360.0), units={"bearing": "rad"}).write(
        tmp_path / "a.nc"
    )
    with xr.open_dataset(path) as data:
        data.load()
    data["bearing"] = data["bearing"].astype("f4")  # 2 pi becomes a little more than a turn
    data.to_netcdf(tmp_path / "b.nc")
    same(losses.read_losses(tmp_path / "b.nc"))


@pytest.mark.parametrize("bearing", [None, np.array([45.0])], ids=["none", "one"])
def test_without_bearings_the_loss_holds_all_round(
    bearing: np.ndarray | None, tmp_path: Path
) -> None:
    read = losses.read_losses(
        Table(bearing=bearing, units={"bearing": None}).write(tmp_path / "a.nc")
    )
    assert read.loss.shape == (1, 1, len(RANGE))
    assert len(read.bearing) == 1


def test_a_coordinate_beside_a_numbered_dimension_is_found(tmp_path: Path) -> None:
    with xr.open_dataset(Table(names={"bearing": "radial"}).write(tmp_path / "a.nc")) as data:
        data.load()
    azimuth = (
        "radial",
        data["radial"].values,
        {"units": "degree", "standard_name": "sensor_azimuth_angle"},
    )
    data = data.drop_vars("radial").assign(heading_of_ray=azimuth)
    data.to_netcdf(tmp_path / "b.nc")
    same(losses.read_losses(tmp_path / "b.nc"))


def test_one_place_without_a_dimension_is_a_place(tmp_path: Path) -> None:
    with xr.open_dataset(Table().write(tmp_path / "a.nc")) as data:
        data.load()
    data["lon"], data["lat"] = (
        ((), 170.0, {"units": "degrees_east"}),
        ((), -20.0, {"units": "degrees_north"}),
    )
    data.to_netcdf(tmp_path / "b.nc")
    read = losses.read_losses(tmp_path / "b.nc")
    same(read)
    np.testing.assert_allclose(np.degrees([read.lon[0], read.lat[0]]), [170.0, -20.0])
    assert losses.between(read, 1.0, 0.2) is not None


def test_positions_of_cells_and_of_the_whole_are_no_places(tmp_path: Path) -> None:
    """Files give the longitude and latitude of each cell of a radial, too, and one position for all
    places.
    """
    with xr.open_dataset(FOUR.write(tmp_path / "a.nc")) as data:
        data.load()
    cell = ("bearing", "range"), np.ones((len(BEARING), len(RANGE)))
    data = data.assign(
        cell_lon=(*cell, {"units": "degrees_east", "standard_name": "longitude"}),
        cell_lat=(*cell, {"units": "degrees_north", "standard_name": "latitude"}),
        longitude=((), 5.0, {"units": "degrees_east", "standard_name": "longitude"}),
        latitude=((), 6.0, {"units": "degrees_north", "standard_name": "latitude"}),
    )
    data.to_netcdf(tmp_path / "b.nc")
    read = losses.read_losses(tmp_path / "b.nc")
    same(read, PLACES)
    np.testing.assert_allclose(np.degrees(read.lon), LON)
    data.isel(place=0, drop=True).drop_vars(["lon", "lat", "longitude", "latitude"]).to_netcdf(
        tmp_path / "c.nc"
    )
    read = losses.read_losses(tmp_path / "c.nc")
    same(read)
    assert read.lon.size == 0


def test_places_on_a_grid_are_places(tmp_path: Path) -> None:
    values = PLACES[:4].reshape(2, 2, len(BEARING), len(RANGE))
    data = xr.Dataset(
        {"tl": (("lat", "lon", "bearing", "range"), values, {"units": "dB"})},
        {
            "lat": ("lat", [40.0, 42.0]),
            "lon": ("lon", [350.0, 353.0]),
            "bearing": BEARING,
            "range": RANGE,
        },
    )
    data["bearing"].attrs["units"], data["range"].attrs["units"] = "degree", "m"
    data.transpose("range", "lon", "bearing", "lat").to_netcdf(tmp_path / "a.nc")
    read = losses.read_losses(tmp_path / "a.nc")
    lon, lat = np.degrees(read.lon), np.degrees(read.lat)
    for k in range(4):  # in whatever order
        j, i = int(lat[k] > 41), int(lon[k] > -8.5)
        np.testing.assert_allclose(read.loss[k], values[j, i], atol=ROUNDING)
    assert sorted(lon.round(9)) == [-10, -10, -7, -7]


@pytest.mark.parametrize(
    ("select", "higher"),
    [({"depth": 100.0}, 1.0), ({"depth": 30}, 0.0), ({"depth": 100.0, "season": "winter"}, 2.0)],
)
def test_a_further_dimension_is_chosen(
    select: dict[str, Any], higher: float, tmp_path: Path
) -> None:
    further: dict[str, Any] = {"depth": np.array([30.0, 100.0, 250.0])}
    if "season" in select:
        further["season"] = np.array(["summer", "winter"])
    path = Table(further=further).write(tmp_path / "a.nc")
    same(losses.read_losses(path, select=select), WHOLE + higher)


def test_a_time_is_chosen_by_its_date(tmp_path: Path) -> None:
    times = np.array(["2026-01-01", "2026-07-01"], "datetime64[ns]")
    path = Table(further={"time": times}).write(tmp_path / "a.nc")
    same(losses.read_losses(path, select={"time": "2026-07-01T00:00:00Z"}), WHOLE + 1)


def test_units_are_stated_where_the_file_lacks_them(tmp_path: Path) -> None:
    path = Table(metres=RANGE, units={"range": None}).write(tmp_path / "a.nc")
    same(losses.read_losses(path, units={"range": "m"}))


def test_what_else_lies_along_the_range_is_not_taken_for_it(tmp_path: Path) -> None:
    with xr.open_dataset(Table().write(tmp_path / "a.nc")) as data:
        data.load()
    bottom = (
        "range",
        np.linspace(50.0, 4000.0, len(RANGE)),
        {"units": "m", "long_name": "sea floor along the range"},
    )
    data = data.assign(bathymetry=bottom)
    data.to_netcdf(tmp_path / "b.nc")
    same(losses.read_losses(tmp_path / "b.nc"))
    data.drop_vars("range").to_netcdf(tmp_path / "c.nc")
    with pytest.raises(UserError, match='the dimension "range" has no coordinate'):
        losses.read_losses(tmp_path / "c.nc")
