"""What is judged once a source, whatever the domain: zeros that are land, undeclared fill values,
speeds that can't be.
"""

from pathlib import Path
from typing import Any
from unittest import mock

import netCDF4
import numpy as np
import pytest
import writers
import xarray as xr

import drift
from geo.box import Box
from geo.errors import UserError
from geo.forcing import sources, survey
from geo.grids import fill
from geo.grids.grid import Grid, sample

LON, LAT = np.arange(2.0, 8.01, 0.1), np.arange(57.0, 63.01, 0.05)
HOURS = np.arange(0, 97, 6)
RNG = np.random.default_rng(11)


def swirl(lon: Any, lat: Any, hour: float) -> tuple[Any, Any]:
    """A current [m/s] that is nowhere zero for long and has no symmetry."""
    x, y = np.radians(lon * 40), np.radians(lat * 55)
    return (
        0.31 + 0.22 * np.sin(x + 0.07 * hour) * np.cos(0.7 * y),
        -0.12 + 0.27 * np.cos(1.3 * x - y + 0.05 * hour),
    )


def fields(lon: Any = LON, lat: Any = LAT, hours: Any = HOURS) -> tuple[Any, Any]:
    x, y = np.meshgrid(lon, lat)
    both = [swirl(x, y, float(h)) for h in hours]
    return np.stack([u for u, _ in both]), np.stack([v for _, v in both])


def saved(
    path: Path, u: Any, v: Any, lon: Any = LON, lat: Any = LAT, hours: Any = HOURS, **more: Any
) -> Path:
    """A file of currents over (time, lat, lon); more: encoding of both, or attributes."""
    attributes = more.pop("attributes", {})
    dims = ("time", "lat", "lon")
    data = xr.Dataset(
        {
            "uo": (dims, np.asarray(u), writers.EAST | attributes),
            "vo": (dims, np.asarray(v), writers.NORTH | attributes),
        },
        {"time": ("time", hours, {"units": "hours since 2026-03-01"}), "lon": lon, "lat": lat},
    )
    if "dtype" in more and more["dtype"].startswith("int"):
        more["_FillValue"] = np.iinfo(more["dtype"]).min
    data.to_netcdf(path, encoding={n: {"_FillValue": None} | more for n in ("uo", "vo")})
    return path


def shore(lon: Any, lat: Any) -> Any:
    """A coast aslant across the north-east of the field."""
    return 0.8 * (lon - 5.3) + (lat - 60.1) > 0.9


def zero_land(path: Path) -> tuple[Path, Any, Any, Any]:
    """A file whose land is zero and whose south-west corner is missing; its values, and where the
    land is.
    """
    u, v = fields()
    land = shore(*np.meshgrid(LON, LAT))
    u[:, land], v[:, land] = 0.0, 0.0
    u[:, :12, :9], v[:, :12, :9] = np.nan, np.nan
    return saved(path, u, v), u, v, land


CASE = """
start = "2026-03-01T00:00Z"
duration = "96 h"
particles = 40
max_lost = 1.0
[output]
trajectories = 40
[coast]
source = "none"
[clock]
step = "30 min"
[domain]
{domain}
[[current]]
files = "{files}"
[[scenario]]
name = "a"
object = "water"
position = {{ at = [4.6, 60.0], error = "3 nmi" }}
"""

SMALL = "west = 3.5\nsouth = 58.9\neast = 7.5\nnorth = 61.6"  # holds no missing value
WIDE = "west = 2.0\nsouth = 57.0\neast = 8.0\nnorth = 63.0"


def ends(folder: Path, files: Path, domain: str) -> Any:
    (folder / "a.toml").write_text(CASE.format(domain=domain, files=files))
    tracks = drift.run(drift.load(folder / "a.toml")).trajectories
    return tracks.lon, tracks.lat, tracks.status


@pytest.mark.thorough
def test_zeros_that_are_land_are_land_whatever_the_domain(tmp_path: Path) -> None:
    """Land is zero and a far corner is missing: two domains, one with that corner, give the same
    tracks.

    Taken as still water, land within one domain alone moved these tracks by kilometres. Places in a
    tile are float32 numbers of cells from its own corner, here up to 60, so 4e-6 of a cell: 0.02 m
    in a field that changes by a tenth a cell.
    """
    path = zero_land(tmp_path / "a.nc")[0]
    small, wide = ends(tmp_path, path, SMALL), ends(tmp_path, path, WIDE)
    assert (small[2][:, -1] == 0).sum() > 20
    # those that stay inside both
    afloat = (small[2] == wide[2]).all(axis=1) & (small[2][:, -1] == 0)
    assert afloat.sum() > 20
    for a, b in zip(small[:2], wide[:2], strict=True):
        assert np.abs(a[afloat].astype(int) - b[afloat])[:, -1].max() * 0.0093 < 0.1  # [m]
    for box in (Box(3.5, 58.9, 7.5, 61.6), Box(2.0, 57.0, 8.0, 63.0), None):
        source = sources.open_source("current", path, box=box)
        values = source.read(3)
        lon, lat = np.meshgrid(source.grid.lon, source.grid.lat)
        inside = lat > 58.0
        np.testing.assert_array_equal(np.isnan(values[..., 0])[inside], shore(lon, lat)[inside])
        assert any(
            "exactly zero at all 8 times looked at: taken as land" in note for note in source.notes
        )


def test_tracks_beside_zero_land_are_those_of_a_float64_integration(tmp_path: Path) -> None:
    """Where three nodes round a particle are wet, RK4 in float64 on the raw values gives the same
    track to metres.
    """
    path, u, v, land = zero_land(tmp_path / "a.nc")
    (tmp_path / "a.toml").write_text(CASE.format(domain=WIDE, files=path))
    tracks = drift.run(drift.load(tmp_path / "a.toml", {"uncertainty": "none"})).trajectories
    grid = Grid(float(LON[0]), float(LAT[0]), 0.1, 0.05, len(LON), len(LAT))
    u[:, land], v[:, land] = np.nan, np.nan
    both = np.stack((u, v), axis=-1)

    def velocity(lon: Any, lat: Any, hour: float) -> Any:
        k = min(int(hour // 6), len(HOURS) - 2)
        share = hour / 6 - k
        gone = ~np.isfinite(lon + lat)  # it met a missing corner: NaN from there on
        at = np.where(gone, 4.6, lon), np.where(gone, 60.0, lat)
        result = (1 - share) * sample(grid, both[k], *at) + share * sample(grid, both[k + 1], *at)
        return np.where(gone[:, None], np.nan, result)

    degrees = 180 / np.pi / 6_371_008.8
    lon, lat = (np.asarray(c[:, 0], float) * 360 / 2**32 for c in (tracks.lon, tracks.lat))
    way = np.zeros(len(lon))
    h = 0.5
    for n in range(192):
        stages = []
        for back, t in ((None, 0.0), (0, h / 2), (1, h / 2), (2, h)):
            at = (
                (lon, lat)
                if back is None
                else (lon + t * stages[back][0], lat + t * stages[back][1])
            )
            e, nn = velocity(*at, n * h + t).T * 3600 * degrees
            stages.append((e / np.cos(np.radians(at[1])), nn))
        step = [
            sum(w * s[i] for w, s in zip((1, 2, 2, 1), stages, strict=True)) * h / 6 for i in (0, 1)
        ]
        way += np.hypot(step[0] * np.cos(np.radians(lat)), step[1]) / degrees
        lon, lat = lon + step[0], lat + step[1]
    last = [np.asarray(c[:, -1], float) * 360 / 2**32 for c in (tracks.lon, tracks.lat)]
    apart = np.hypot((last[0] - lon) * np.cos(np.radians(lat)), last[1] - lat) / degrees
    free = np.isfinite(apart)  # the oracle fills no coast: it ends where a corner is missing
    assert free.sum() > 12
    print(
        f"median {np.median(apart[free]):.2f} m, worst {apart[free].max():.2f} m, {(apart / way)[free].max():.2e} of the way"
    )
    # 192 steps of float32 increments (1e-7 of some 700 m each) and of 9 mm positions, grown by the
    # shear and by velocities off by 4e-7 m/s for 96 h, 0.14 m
    assert apart[free].max() < 0.3


def test_zeros_packed_with_an_offset_are_zeros_too(tmp_path: Path) -> None:
    u, v = fields()
    x, y = np.meshgrid(LON, LAT)
    land = shore(x, y)
    u[:, land], v[:, land] = 0.0, 0.0
    path = saved(
        tmp_path / "a.nc",
        u,
        v,
        dtype="int16",
        scale_factor=np.float32(0.00031),
        add_offset=np.float32(0.2337),
    )
    with netCDF4.Dataset(path) as raw:
        assert (raw["uo"][0][land] != 0).all()  # none of them decodes to zero
    source = sources.open_source("current", path)
    np.testing.assert_array_equal(np.isnan(source.read(5)[..., 0]), land)


def test_still_water_stays_where_the_file_or_the_case_says_so(tmp_path: Path) -> None:
    u, v = fields()
    u[:, 20:40, 20:40], v[:, 20:40, 20:40] = 0.0, 0.0
    path = saved(tmp_path / "a.nc", u, v)
    assert sources.open_source("current", path, variables={"mask": "none"}).missing == 0
    u[3:6] = 0.0  # slack everywhere for a while is no land
    v[3:6] = 0.0
    u[:3, 20:40, 20:40] = 0.01
    assert sources.open_source("current", saved(tmp_path / "b.nc", u, v)).missing == 0
    calm = saved(tmp_path / "c.nc", 0 * u, 0 * v)
    assert sources.open_source("current", calm).missing == 0


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
    text = CASE.format(domain=SMALL, files="").replace(
        'files = ""', "constant = {{ speed = {speed}, toward = 31 }}"
    )
    path = tmp_path / "a.toml"
    path.write_text(text.replace("{{", "{").replace("}}", "}").replace("{speed}", "7.9"))
    drift.load(path)
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


@pytest.mark.parametrize("later", [0, 1])
def test_zeros_of_files_that_are_packed_differently(later: int, tmp_path: Path) -> None:
    """Whichever of the two comes first in time: each number is zero by its own file's packing."""
    u, v = fields()
    x, y = np.meshgrid(LON, LAT)
    land = shore(x, y)
    u[:, land], v[:, land] = 0.0, 0.0
    packings = ((0.00031, 0.2337), (0.00047, 0.0))
    paths = [
        saved(
            tmp_path / f"{k}.nc",
            u,
            v,
            hours=HOURS + 100 * (k == later),
            dtype="int16",
            scale_factor=a,
            add_offset=b,
        )
        for k, (a, b) in enumerate(packings)
    ]
    source = sources.open_source("current", paths)
    for k in (0, 20):
        np.testing.assert_array_equal(np.isnan(source.read(k)[..., 0]), land)


def test_only_both_components_at_zero_are_land_and_missing_values_are_not_called_zero(
    tmp_path: Path,
) -> None:
    u, v = fields()
    x, y = np.meshgrid(LON, LAT)
    land = shore(x, y)
    u[:, 10:25], v[:, :, 5:9] = 0.0, 0.0  # flows due north, and due east
    missing = saved(tmp_path / "a.nc", np.where(land, np.nan, u), np.where(land, np.nan, v))
    both = np.zeros(land.shape, bool)
    both[10:25, 5:9] = True  # 60 points where they cross, 0.8 %: still water, taken as land
    source = sources.open_source("current", missing)
    np.testing.assert_array_equal(np.isnan(source.read(4)[..., 0]), land | both)
    zero = saved(tmp_path / "b.nc", np.where(land, 0.0, u + 1e-3 * both), np.where(land, 0.0, v))
    np.testing.assert_array_equal(
        np.isnan(sources.open_source("current", zero).read(4)[..., 0]), land
    )
    plain = fields()
    source = sources.open_source(
        "current", saved(tmp_path / "c.nc", *(np.where(land, np.nan, w) for w in plain))
    )
    assert not any("exactly zero" in note for note in source.notes)


def test_a_mask_says_which_of_its_values_is_water_and_one_of_ones_says_nothing(
    tmp_path: Path,
) -> None:
    u, v = fields()
    x, y = np.meshgrid(LON, LAT)
    land = shore(x, y)
    u[:, land], v[:, land] = 0.0, 0.0
    masks = {
        "plain": ((~land).astype("int8"), {}),
        "flags": (
            land.astype("int8"),
            {"flag_values": np.int8([0, 1]), "flag_meanings": "water land"},
        ),
        "ones": (np.ones(land.shape, "int8"), {}),
    }
    for name, (values, said) in masks.items():
        path = saved(tmp_path / f"{name}.nc", u, v)
        with xr.open_dataset(path, decode_times=False) as data:
            data.load().assign(tmask=(("lat", "lon"), values, said)).to_netcdf(
                tmp_path / f"{name}2.nc"
            )
        source = sources.open_source("current", tmp_path / f"{name}2.nc")
        np.testing.assert_array_equal(np.isnan(source.read(2)[..., 0]), land, err_msg=name)


@pytest.mark.parametrize(("points", "dry"), [(61, True), (30, False)])
def test_over_half_a_percent_of_zeros_is_land_and_less_is_not(
    points: int, dry: bool, tmp_path: Path
) -> None:
    """61 points of 7,381 are 0.8 %, 30 are 0.4 %; at the first time, which is looked at, they are
    missing.
    """
    u, v = fields()
    u[:, -1, :points], v[:, -1, :points] = 0.0, 0.0
    u[0, -1], v[0, -1] = np.nan, np.nan
    source = sources.open_source("current", saved(tmp_path / "a.nc", u, v))
    assert np.isnan(source.read(5)[-1, :30]).all() == dry
    assert np.isfinite(source.read(5)[:-1]).all()


def test_a_lee_of_stokes_drift_is_no_land_where_land_is_missing(tmp_path: Path) -> None:
    u, v = fields()
    x, y = np.meshgrid(LON, LAT)
    u[:, shore(x, y)], v[:, shore(x, y)] = np.nan, np.nan
    u[:, 40:60, 20:30], v[:, 40:60, 20:30] = 0.0, 0.0
    chosen = {"east": "uo", "north": "vo"}
    source = sources.open_source("stokes", saved(tmp_path / "a.nc", u, v), variables=chosen)
    np.testing.assert_array_equal(np.isnan(source.read(4)[..., 0]), shore(x, y))


def test_what_stands_still_until_the_last_times_is_water(tmp_path: Path) -> None:
    """A river that starts to flow after three quarters of the file: all eight slices count, to the
    last.

    It does not make land of 30 points that are still all the time: they are too few.
    """
    u, v = fields()
    u[:, -1, :30], v[:, -1, :30] = 0.0, 0.0
    u[:13, 50:70, 10:20], v[:13, 50:70, 10:20] = 0.0, 0.0
    source = sources.open_source("current", saved(tmp_path / "a.nc", u, v))
    assert source.missing == 0
    assert all(np.isfinite(source.read(k)).all() for k in (0, 12, 16))


def test_water_that_flows_due_east_makes_no_land_of_a_few_still_points(tmp_path: Path) -> None:
    """A quarter of one component is zero, but only 30 points of 7,381 are in both: too few to be
    land.
    """
    u, v = fields()
    u[:, 10:40] = 0.0
    v[:, 12, 10:40] = 0.0
    source = sources.open_source("current", saved(tmp_path / "a.nc", u, v))
    assert np.isfinite(source.read(5)).all()


def test_a_calm_is_no_land(tmp_path: Path) -> None:
    """Winds blow over land too, and are zero in a calm that lasts."""
    u, v = fields()
    u[:, 50:70, 10:20], v[:, 50:70, 10:20] = 0.0, 0.0
    path = saved(tmp_path / "a.nc", 20 * u, 20 * v)
    source = sources.open_source("wind", path, variables={"east": "uo", "north": "vo"})
    assert (source.read(5)[50:70, 10:20] == 0.0).all()


def test_what_is_filled_does_not_depend_on_the_box(tmp_path: Path) -> None:
    """Boxes whose edge lies beside the coast, as a 30 km bay of the whole file is filled there."""
    lon, lat = np.arange(2.0, 8.0, 0.05), np.arange(57.0, 63.0, 0.03)
    u, v = fields(lon, lat)
    x, y = np.meshgrid(lon, lat)
    land = shore(x, y) | (np.abs(x - 4.3) < 0.31) & (y > 59.2)
    u[:, land], v[:, land] = np.nan, np.nan
    path = saved(tmp_path / "a.nc", u, v, lon=lon, lat=lat)

    def filled(box: Box | None) -> tuple[Any, Any]:
        source = sources.open_source("current", path, box=box)
        grid = source.grid
        return grid, fill.fill(
            source.read(3), 3, reach=fill.REACH, bands=fill.bands(grid), within=source.domain
        )

    grid, whole = filled(None)
    for box in (Box(4.3, 59.4, 5.4, 60.8), Box(4.0, 58.0, 4.35, 61.0), Box(4.4, 60.0, 7.0, 60.6)):
        own, part = filled(box)
        j = np.flatnonzero((grid.lat >= box.south) & (grid.lat <= box.north))
        i = np.flatnonzero((grid.lon >= box.west) & (grid.lon <= box.east))
        rows = np.searchsorted(own.lat, grid.lat[j] - 1e-6)
        columns = np.searchsorted(own.lon, grid.lon[i] - 1e-6)
        np.testing.assert_array_equal(part[np.ix_(rows, columns)], whole[np.ix_(j, i)])


@pytest.mark.filterwarnings("error")
def test_damaged_numbers_are_looked_at_without_a_warning() -> None:
    """A signalling NaN, as a damaged file may hold, and a number whose product is beyond float32."""
    x, y = np.full((2, 5), 0.3, np.float32), np.full((2, 5), 0.4, np.float32)
    x.view(np.uint32)[1, 2] = 0x7F800001
    y[0, 3] = 3e38
    component = mock.Mock(factor=2.0)
    np.testing.assert_allclose(survey._speeds((component, component), [x, y]), [1.0] * 8, rtol=1e-6)
