"""A misleading or incomplete table of losses is rejected in one line."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from loss_tables import FOUR, PLACES, WHOLE, holed, same
from sensor_tables import BEARING, LAT, LON, RANGE, Table

from drift.evidence.sensors import losses
from geo.errors import UserError

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
    "no dB by values": (Table(values=WHOLE * 0 + 0.08), {}, "a loss of 0.08 cannot be in dB, where the largest is at least 20"),
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
