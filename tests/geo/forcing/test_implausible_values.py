"""Undeclared fill values and speeds that cannot be are judged once a source, whatever the domain."""

from pathlib import Path
from typing import Any
from unittest import mock

import netCDF4
import numpy as np
import pytest
import writers
import xarray as xr
from surveyed_files import HOURS, LAT, LON, SMALL, case, fields, saved, shore

import drift
from geo.box import Box
from geo.errors import UserError
from geo.forcing import sources, survey

RNG = np.random.default_rng(11)


@pytest.mark.parametrize("fill", [99.0, -99.0, 99.9, -9.99, 9999.0, -999.9, 1e10, -32768.0])
def test_undeclared_fill_values_are_found_and_named(fill: float, tmp_path: Path) -> None:
    u, v = fields()
    x, y = np.meshgrid(LON, LAT)
    land = shore(x, y)
    u[:, land], v[:, land] = fill, fill
    u[0, 5, 5] = 1.7  # the fastest, once: no fill value
    source = sources.open_source("current", saved(tmp_path / "a.nc", u, v, dtype="float32"))
    np.testing.assert_array_equal(np.isnan(source.read(0)[..., 0]), land)
    assert source.read(0)[5, 5, 0] == np.float32(1.7)
    assert any(
        f'"uo" holds {fill:g} at {100 * land.mean():.1f} % of its points' in note
        for note in source.notes
    )


def test_a_packed_field_that_saturates_keeps_its_extreme(tmp_path: Path) -> None:
    """The largest number of int8 recurs where the current is faster than can be packed: no gap sets
    it apart.
    """
    u, v = fields()
    path = saved(tmp_path / "a.nc", np.minimum(u, 0.4), v, dtype="int8", scale_factor=0.4 / 127)
    source = sources.open_source("current", path)
    assert source.missing == 0
    assert (source.read(2)[..., 0] > 0.399).sum() > 100
    # two values, far apart, both real
    two = saved(tmp_path / "b.nc", np.where(u > 0.3, 0.99, 0.1), v)
    assert sources.open_source("current", two).missing == 0


def test_undeclared_is_decided_by_recurrence_gap_and_number() -> None:
    rest = RNG.normal(0.0, 0.3, 5_000)

    def of(*more: float, factor: float = 1.0, quantity: str = "current") -> tuple[float, ...]:
        return survey.undeclared(np.concatenate((rest, more)), factor, quantity)

    assert of(*[99.0] * 3) == (99.0,)
    assert of(*[99.0] * 2) == ()  # not often enough
    assert of(*[12.0] * 9) == (12.0,)  # faster than any current
    assert of(*[7.0] * 9) == ()  # it might be one
    assert set(of(*[-99.0] * 9, *[9999.0] * 9)) == {-99.0, 9999.0}
    assert of(*[99.9] * 9, quantity="wind") == (99.9,)
    assert of(*[50.0] * 9, factor=0.01) == ()  # 0.5 m/s in cm/s


WIND = (
    6.0 + 4.0 * RNG.normal(size=(len(HOURS), len(LAT), len(LON))),
    3.0 * RNG.normal(size=(len(HOURS), len(LAT), len(LON))),
)


def test_a_wind_is_no_current_and_a_current_hardly_a_wind(tmp_path: Path) -> None:
    path = saved(tmp_path / "wind.nc", *WIND)
    speed = np.hypot(*WIND)
    with pytest.raises(
        UserError,
        match=r"wind\.nc: uo, vo can't be a current: mean (\S+), 99\.9th .*plausible = true",
    ) as told:
        sources.open_source("current", path)
    # of 8 of 17 slices, 39,000 points: mean and rounding to two digits within 2 %
    assert float(str(told.value).split("mean ")[1].split(",")[0]) == pytest.approx(
        speed.mean(), rel=0.02
    )
    vouched = sources.open_source("current", path, plausible=True)
    assert any("accepted because plausible = true" in note for note in vouched.notes)
    np.testing.assert_allclose(vouched.read(4)[..., 0], WIND[0][4], rtol=1e-6)
    chosen = {"east": "uo", "north": "vo"}
    slow = sources.open_source("wind", saved(tmp_path / "b.nc", *fields()), variables=chosen)
    assert any("WARNING: this wind never exceeds 0.66" in note for note in slow.notes)
    gale = sources.open_source("wind", path, variables=chosen)
    assert not any("WARNING" in note for note in gale.notes)


@pytest.mark.parametrize(
    ("quantity", "factor", "good"),
    [("current", 6.4, True), ("current", 6.9, False), ("wind", 130.0, True), ("wind", 140.0, False), ("stokes", 4.4, True),
     ("stokes", 4.7, False)],
)  # fmt: skip
def test_ceilings(quantity: str, factor: float, good: bool, tmp_path: Path) -> None:
    """The field's mean is 0.377 and its largest speed 0.658 m/s: at 6.63 times that the mean is
    2.5, at 137 and 4.56 the largest 90 and 3.
    """
    u, v = fields()
    path = saved(tmp_path / "a.nc", factor * u, factor * v)
    chosen = {"east": "uo", "north": "vo"}
    if good:
        assert sources.open_source(quantity, path, variables=chosen).missing == 0
    else:
        with pytest.raises(UserError, match="plausible = true"):
            sources.open_source(quantity, path, variables=chosen)


def test_the_same_is_judged_whatever_the_box(tmp_path: Path) -> None:
    """A jet as fast as a wind, in one corner: refused from anywhere."""
    u, v = fields()
    u[:, :20, :20] += 14.0
    path = saved(tmp_path / "a.nc", u, v)
    for box in (None, Box(6.0, 61.0, 7.0, 62.0), Box(2.0, 57.0, 3.0, 58.0)):
        with pytest.raises(UserError, match="can't be a current"):
            sources.open_source("current", path, box=box)


def test_large_sources_are_sampled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a 2,000th of the bytes the same is found, and no more than that is read."""
    u, v = fields()
    x, y = np.meshgrid(LON, LAT)
    u[:, shore(x, y)], v[:, shore(x, y)] = 0.0, 0.0
    path = saved(tmp_path / "a.nc", u, v)
    monkeypatch.setattr(survey, "READ", 32_768)
    seen, block = [], survey.slices.block

    def counted(*given: Any) -> Any:
        seen.append(block(*given).nbytes)
        return block(*given)

    monkeypatch.setattr(survey.slices, "block", counted)
    source = sources.open_source("current", path)
    assert 0 < sum(seen) <= 32_768
    np.testing.assert_array_equal(np.isnan(source.read(0)[..., 0]), shore(x, y))


def test_typed_speeds_have_ceilings(tmp_path: Path) -> None:
    path = case(tmp_path, SMALL, constant={"speed": 7.9, "toward": 31}).path
    with pytest.raises(
        UserError, match=r"constant: 8\.1 m/s is too fast for a current; at most 8 m/s"
    ):
        drift.load(path, {"current.0.constant.speed": "8.1"})
    calm = drift.load(path, {"current.0.constant.speed": "0"})
    assert calm.forcing["current"][0].constant == (0.0, 0.0)
    gust = {
        "wind": '[{table = [{time = "+0 h", east = 1, north = 2}, {time = "+9 h", east = -60, north = 68}]}]'
    }
    with pytest.raises(UserError, match=r"row 2: 90\.69 m/s is too fast for a wind"):
        drift.load(path, gust)
    for key, value, most in (("current", "2.6", "2.5"), ("wind", "21", "20")):
        with pytest.raises(UserError, match=f"must be at most {most}"):
            drift.load(path, {f"uncertainty.{key}": f'{{std = {value}, time = "3 h"}}'})
    with pytest.raises(UserError, match="at most 10000"):
        drift.load(path, {"uncertainty.diffusivity": "10001"})
    with pytest.raises(UserError, match="plausible belongs to files"):
        drift.load(path, {"current.0.plausible": "true"})


def test_a_bad_slice_between_those_looked_at_is_met_where_it_is_read(tmp_path: Path) -> None:
    hours = np.arange(97)
    u, v = fields(hours=hours)
    u[50], v[50] = 99.0, 99.0
    v[51, 3, 4] = -32.767
    for quantity, factor in (("current", 1.0), ("wind", 10.0)):
        both = (np.where(np.abs(x) < 3, factor * x, x) for x in (u, v))
        path = saved(tmp_path / f"{quantity}.nc", *both, hours=hours)
        source = sources.open_source(quantity, path, variables={"east": "uo", "north": "vo"})
        assert np.isnan(source.read(50)).all()
        assert np.isfinite(source.read(49)).all()
        assert np.isnan(source.read(51)[3, 4, 1]) == (quantity == "current")


def test_a_slow_number_of_nines_is_a_fill_value_only_where_both_components_have_it(
    tmp_path: Path,
) -> None:
    u, v = fields()
    cm = {"attributes": {"units": "cm s-1"}}
    x, y = np.meshgrid(LON, LAT)
    land = shore(x, y)
    river = np.where(land, 99.0, 100 * u), np.where(land, 0.3, 100 * v)  # an inflow of 99 cm/s
    assert sources.open_source("current", saved(tmp_path / "a.nc", *river, **cm)).missing == 0
    filled = (np.where(land, 99.0, 100 * w) for w in (0.5 * u, 0.5 * v))
    source = sources.open_source("current", saved(tmp_path / "b.nc", *filled, **cm))
    np.testing.assert_array_equal(np.isnan(source.read(4)[..., 0]), land)
    assert any("both components hold 99 at" in note for note in source.notes)
    # a wind that is the same behind a front
    front = np.where(land, 9.9, 4 * u), np.where(land, 0.0, 4 * v)
    chosen = {"east": "uo", "north": "vo"}
    assert (
        sources.open_source("wind", saved(tmp_path / "c.nc", *front), variables=chosen).missing == 0
    )


def test_what_a_packed_number_is_by_default_is_a_fill_value(tmp_path: Path) -> None:
    """Land holds -32767, netCDF's own default, which at this scale is a wind of 19.7 m/s."""
    u, v = fields()
    x, y = np.meshgrid(LON, LAT)
    land = shore(x, y)
    scale, offset = 0.001, 13.0
    path = tmp_path / "a.nc"
    saved(path, 8 * u, 8 * v, dtype="int16", scale_factor=scale, add_offset=offset)
    with netCDF4.Dataset(path, "a") as raw:
        raw.set_auto_maskandscale(False)
        for name in ("uo", "vo"):
            values = raw[name][:]
            values[:, land] = -32767
            raw[name][:] = values
    source = sources.open_source("wind", path, variables={"east": "uo", "north": "vo"})
    np.testing.assert_array_equal(np.isnan(source.read(3)[..., 0]), land)


def test_files_of_one_source_are_in_the_same_units_and_places(tmp_path: Path) -> None:
    u, v = fields()
    first = saved(tmp_path / "a.nc", 100 * u, 100 * v, attributes={"units": "cm s-1"})
    second = saved(tmp_path / "b.nc", u, v, hours=HOURS + 100)
    for pair in ([first, second], [second, first]):
        joined = sources.open_source("current", pair)
        np.testing.assert_allclose(joined.read(0), np.stack((u[0], v[0]), -1), atol=1e-6)
        np.testing.assert_allclose(joined.read(len(HOURS)), np.stack((u[0], v[0]), -1), atol=1e-6)
    other = saved(tmp_path / "p.nc", u, v, hours=HOURS + 100, attributes={"units": "Pa"})
    with pytest.raises(UserError, match=r'"uo" is in "Pa", and in .* in "cm s-1"; give it as a'):
        sources.open_source("current", [first, other])
    assert sources.open_source("current", [first, second], units="cm/s").missing == 0
    x, y = np.meshgrid(LON, LAT)
    for name, shift in (("c.nc", 0.0), ("d.nc", 2.0)):
        dims = ("time", "y", "x")
        xr.Dataset(
            {"uo": (dims, u, writers.EAST), "vo": (dims, v, writers.NORTH)},
            {
                "time": ("time", HOURS + 100 * shift, {"units": "hours since 2026-03-01"}),
                "lon": (("y", "x"), x + 0.02 * (y - 60) + shift),
                "lat": (("y", "x"), y + 0.03 * x),
            },
        ).to_netcdf(tmp_path / name)
    with pytest.raises(
        UserError, match=r"d\.nc has another grid than .*c\.nc: other values of .lon"
    ):
        sources.open_source("current", [tmp_path / "c.nc", tmp_path / "d.nc"])


@pytest.mark.filterwarnings("error")
def test_damaged_numbers_are_looked_at_without_a_warning() -> None:
    """A signalling NaN, as a damaged file may hold, and a number whose product is beyond float32."""
    x, y = np.full((2, 5), 0.3, np.float32), np.full((2, 5), 0.4, np.float32)
    x.view(np.uint32)[1, 2] = 0x7F800001
    y[0, 3] = 3e38
    component = mock.Mock(factor=2.0)
    np.testing.assert_allclose(survey._speeds((component, component), [x, y]), [1.0] * 8, rtol=1e-6)
