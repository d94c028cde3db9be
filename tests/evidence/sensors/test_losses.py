"""A table of losses is the same however its file is written; what misleads is refused in one line."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sensor_tables import BEARING, LAT, LON, RANGE, Table, loss

from drift.evidence.sensors import losses
from geo.errors import UserError

ROUNDING = 4 * float(np.spacing(np.float32(128)))  # [dB] unpacked and stored in single precision
WHOLE = loss(BEARING, RANGE)
PLACES = loss(BEARING, RANGE, np.arange(4) * 1.0)
FOUR = Table(places=(LON, LAT))


def same(read: losses.Losses, table: np.ndarray = WHOLE) -> None:
    """The record holds this table (p, b, r) over BEARING and RANGE."""
    # from radians in single precision
    np.testing.assert_allclose(np.degrees(read.bearing), BEARING, atol=2e-5)
    np.testing.assert_allclose(read.range, RANGE, rtol=1e-6)
    np.testing.assert_allclose(read.loss, table, rtol=0, atol=ROUNDING)
    assert read.loss.dtype == np.float32
    assert read.bearing.dtype == read.range.dtype == np.float64
    assert (np.diff(read.bearing) > 0).all()
    assert read.bearing[0] >= 0
    assert read.bearing[-1] < 2 * np.pi


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


def holed(count: int) -> np.ndarray:
    values = WHOLE.copy()
    values.reshape(-1)[[k * 7 + 3 for k in range(4, 4 + count)]] = np.nan
    return values


BAD: dict[str, tuple[Table, dict[str, Any], str]] = {
    "gaps": (Table(values=holed(3)), {}, r"3 of 168 values are missing, first at bearing 60 deg, range 9000 m; fill"),
    "packed gaps": (Table(values=holed(1), dtype="i2"), {}, "1 of 168 values are missing"),
    "gap of a place": (
        FOUR.but(values=np.where(np.arange(4)[:, None, None] == 2, np.nan, PLACES)),
        {},
        "168 of 672 values are missing, first at place 3, bearing 0 deg, range 100 m",
    ),
    "infinite": (Table(values=np.where(WHOLE.max() == WHOLE, np.inf, WHOLE)), {}, "1 of 168 values are missing"),
    "negative": (
        Table(values=np.where(np.arange(168).reshape(WHOLE.shape) == 8, -3.0, WHOLE)),
        {},
        r"1 of 168 losses are negative, first -3 dB at bearing 15 deg, range 500 m; a loss is at least 0",
    ),
    "sign": (Table(values=-WHOLE), {}, "all losses are negative, .* their sign is reversed"),
    "no dB by units": (Table(units={"tl": "Pa"}), {}, 'the transmission loss is in "Pa"; allowed is dB'),
    "dB/km": (Table(units={"tl": "dB/km"}), {}, 'the transmission loss is in "dB/km"; allowed is dB'),
    "no dB by values": (Table(values=WHOLE * 0 + 0.08), {}, "a loss of 0.08 is no loss in dB, whose largest is at least 20"),
    "undeclared fill": (Table(values=np.where(WHOLE.max() == WHOLE, 9999.0, WHOLE)), {}, "9999 dB; allowed are 0 to 500"),
    "no circle": (Table(bearing=np.arange(0.0, 181, 15)), {}, "between the bearings 180 and 0 degrees: a gap of 180"),
    "a radial forgotten": (
        Table(bearing=np.delete(BEARING, [5, 6])), {}, r"between the bearings 60 and 105 degrees: a gap of 45; .* \(15\)"
    ),
    "four bearings": (Table(bearing=np.arange(4) * 90.0), {}, "a gap of 90; allowed are 60 degrees"),
    "0 is not 360": (
        Table(bearing=np.append(BEARING, 360.0), values=np.concatenate((WHOLE, WHOLE[:, :1] + 1), axis=1)), {},
        r"bearing 0 degrees stands twice \(as 0 and 360\), with values 1 dB apart; they must agree",
    ),
    "bearing missing": (Table(bearing=np.where(BEARING == 30, np.nan, BEARING), values=WHOLE), {}, '1 of the bearings "bearing" are missing'),
    "bearings in mils": (Table(bearing=BEARING * 17.8), {}, "bearing 6141 degrees; allowed are -720 to 720"),
    "range twice": (Table(metres=np.append(RANGE[:-1], 500.0)), {}, "the range 500 m stands twice"),
    "range below 0": (
        Table(metres=np.append(-5.0, RANGE[1:]), values=WHOLE), {}, "the range -5 m is below 0"
    ),
    "range missing": (Table(metres=np.append(RANGE[:-1], np.nan), values=WHOLE), {}, "1 of the ranges .* missing"),
    "one range": (Table(metres=RANGE[3:4]), {}, "one range only; at least two"),
    "no unit of range": (Table(units={"range": None}), {}, 'the ranges "range" are in no unit; allowed are m, km or nmi'),
    "M": (Table(units={"range": "M"}), {}, 'the ranges "range" are in "M"; allowed are m, km or nmi'),
    "no unit of bearing": (Table(units={"bearing": None}), {}, 'the bearings "bearing" are in no unit; allowed are degree'),
    "no variable": (Table(), {"variable": "ttl"}, r'no variable "ttl" \(the nearest name is "tl"\); it holds tl'),
    "units of nothing": (Table(), {"units": {"rnge": "m"}}, 'units "rnge": no such variable'),
    "nothing over range": (Table(names={"range": "depth"}), {}, "no transmission loss over bearing and range; it holds"),
    "depth by its long name": (
        Table(names={"range": "depth"}, attributes={"depth": {"long_name": "distance below the surface"}}),
        {},
        "no transmission loss over bearing and range; it holds",
    ),
    "not over range": (
        Table(names={"range": "depth"}), {"variable": "tl"}, r'"tl" \(bearing = 24, depth = 7\) has no dimension of range'
    ),
    "further dimension": (
        Table(further={"depth": np.array([30.0, 100.0])}), {},
        r'2 values of "depth" \(30, 100\); choose one with select = \{ depth = ... \}',
    ),
    "not there": (
        Table(further={"depth": np.array([30.0, 100.0])}), {"select": {"depth": 60.0}},
        r'select "depth" = 60.0: it is not there; there are 30, 100',
    ),
    "no such dimension": (
        Table(further={"depth": np.array([30.0])}), {"select": {"dept": 30}},
        r'select "dept": .* does not depend on it \(the nearest name is "depth"\); allowed are',
    ),
    "place twice": (
        FOUR.but(places=(np.append(LON[:3], LON[1]), np.append(LAT[:3], LAT[1]))), {},
        r"places 2 and 4 are the same \(179 E, 36 N\); leave one of them out",
    ),
    "place twice, a turn apart": (
        FOUR.but(places=(np.append(LON[:3], LON[1] - 360), np.append(LAT[:3], LAT[1]))), {}, "places 2 and 4 are the same"
    ),
    "place nowhere": (FOUR.but(places=(np.append(LON[:3], np.nan), LAT)), {}, "place 4 of 4 is at longitude nan"),
    "place beyond the pole": (FOUR.but(places=(LON, LAT + 60)), {}, "place 1 of 4 is at longitude -178, latitude 91 degrees"),
    "places all round": (
        FOUR.but(places=(np.array([0.0, 90.0, 180.0, 270.0]), np.zeros(4))), {}, "surround the globe"
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
def test_what_misleads_is_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    table, keys, said = BAD[kind]
    path = table.write(tmp_path / "a.nc")
    with pytest.raises(UserError, match=said) as caught:
        losses.read_losses(path, name='sensor "towed".losses', **keys)
    assert len(caught.value.lines) == 1
    assert str(caught.value).startswith('sensor "towed".losses: ')


def test_two_variables_that_may_be_the_loss_are_named(tmp_path: Path) -> None:
    with xr.open_dataset(Table().write(tmp_path / "a.nc")) as data:
        data.load()
    data["loss"] = data["tl"] + 1
    data.to_netcdf(tmp_path / "b.nc")
    with pytest.raises(
        UserError,
        match="tl, loss may each be the transmission loss over bearing and range; set variable",
    ):
        losses.read_losses(tmp_path / "b.nc")
    same(losses.read_losses(tmp_path / "b.nc", variable="loss"), WHOLE + 1)


def test_half_a_position_is_refused(tmp_path: Path) -> None:
    with xr.open_dataset(FOUR.write(tmp_path / "a.nc")) as data:
        data.drop_vars("lat").to_netcdf(tmp_path / "b.nc")
    with pytest.raises(
        UserError, match="its places have a longitude only; give the file both, over place"
    ):
        losses.read_losses(tmp_path / "b.nc")


def test_places_without_positions_must_be_chosen(tmp_path: Path) -> None:
    with xr.open_dataset(FOUR.write(tmp_path / "a.nc")) as data:
        data.drop_vars(["lat", "lon"]).to_netcdf(tmp_path / "b.nc")
    with pytest.raises(
        UserError, match=r'4 values of "place" \(0, 1, 2, 3\); choose one with select'
    ):
        losses.read_losses(tmp_path / "b.nc")
    same(losses.read_losses(tmp_path / "b.nc", select={"place": 2}), PLACES[2:3])


def test_a_dimension_without_numbers_is_refused(tmp_path: Path) -> None:
    with xr.open_dataset(Table().write(tmp_path / "a.nc")) as data:
        data.drop_vars("range").to_netcdf(tmp_path / "b.nc")
    with pytest.raises(UserError, match='the dimension "range" has no coordinate'):
        losses.read_losses(tmp_path / "b.nc")


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


def test_what_is_no_netcdf_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.nc").write_text("bearing,range,loss\n")
    (tmp_path / "empty.nc").write_bytes(b"")
    Table().write(tmp_path / "whole.nc")
    (tmp_path / "cut.nc").write_bytes((tmp_path / "whole.nc").read_bytes()[:3000])
    for file, said in (
        ("a.nc", "is not a netCDF file"), ("none.nc", "no such file"), ("empty.nc", "it is empty"),
        ("cut.nc", "truncated or damaged"), ("", "is a folder"),
    ):  # fmt: skip
        with pytest.raises(UserError, match=said) as caught:
            losses.read_losses(tmp_path / file)
        assert re.search("name a netCDF file$", str(caught.value))
        assert "[[" not in str(caught.value)
