"""Fetching by OPeNDAP and ERDDAP from servers on this machine: values to the bit."""

from dataclasses import replace
from pathlib import Path

import hostile
import model_writers
import netCDF4
import numpy as np
import pyproj
import pytest
import trial_case
import writers
import xarray as xr
from hostile import Variable
from ocean_servers import AXES, BEGIN, END, TABLE, by_component, fetched, ocean

import drift
from drift.apps.fetch import opendap
from drift.apps.fetch.catalogue import Provider
from drift.apps.fetch.order import Order
from geo.box import Box
from geo.errors import UserError
from geo.forcing import sources


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("axes", "protocol"),
    [  # each way of counting by one protocol; by the other one too in the thorough stage
        pytest.param(axes, protocol, marks=[pytest.mark.thorough] * ((k + j) % 2))
        for k, axes in enumerate(AXES)
        for j, protocol in enumerate(("opendap", "erddap"))
    ],
)
def test_a_subset_is_the_source_to_the_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, axes: str, protocol: str
) -> None:
    lon, lat, box = AXES[axes]
    sea = ocean(lon, lat)
    monkeypatch.setattr(opendap, "PART", 9_000)  # several parts
    seen: list[str] = []
    with hostile.serving(hostile.speaking_dap(sea, seen)) as address:
        got = fetched(tmp_path, address, box, protocol=protocol)
    assert all(("/griddap/sea." in target) == (protocol == "erddap") for target in seen)
    files = sorted(path for path in got.files if path.suffix == ".nc")
    assert len(files) > 1
    hours = []
    for path in files:
        with netCDF4.Dataset(path) as data:
            data.set_auto_maskandscale(False)
            t = data["time"][:].astype(int)
            rows = np.array([int(np.flatnonzero(lat == y)[0]) for y in data["lat"][:]])
            columns = np.array(
                [int(np.flatnonzero((lon - x) % 360 == 0)[0]) for x in data["lon"][:]]
            )
            for name in ("u", "v"):
                expected = sea[name].values[np.ix_(t, rows, columns)]
                assert data[name].dtype == expected.dtype
                assert data[name][:].tobytes() == expected.tobytes()
            assert data["u"].getncattr("scale_factor") == np.float32(0.001)
            assert data["u"].getncattr("_FillValue") == np.int16(-32767)
            assert (np.diff(data["lon"][:]) > 0).all()
            # no jump at any seam
            assert np.diff(data["lon"][:]).max() == pytest.approx(lon[1] - lon[0])
            edges = data["lon"][0], data["lon"][-1], data["lat"][:].min(), data["lat"][:].max()
        hours += list(t)
    assert hours == list(range(2, 59))  # 02:30 lies between 2 and 3, 58 is the end
    west, south, east, north = box
    if axes != "whole":
        assert (west - edges[0]) % 360 < 3 * (lon[1] - lon[0])
        assert (edges[1] - east) % 360 < 3 * (lon[1] - lon[0])
        assert edges[1] - edges[0] >= (east - west) % 360
    assert edges[2] <= south
    assert edges[3] >= north
    source = sources.open_source("current", [str(path) for path in files])
    assert source.times.size == len(hours)


def two(folder: Path, address: str, names: tuple[str, str], level: float) -> Path:
    """Write a catalogue of one product whose components have an address each."""
    root = address.rpartition("/")[0]
    text = TABLE.format(address="", protocol="opendap").replace(
        'address = ""', f'address = ["{root}/0/a", "{root}/1/b"]'
    )
    text = text.replace('["u", "v"]', f'["{names[0]}", "{names[1]}"]')
    path = folder / "two.toml"
    path.write_text(f"{text}level = {level}\n", encoding="utf-8")
    return path


@pytest.mark.thorough
def test_what_a_part_holds_is_what_it_is_known_by(monkeypatch: pytest.MonkeyPatch) -> None:
    """A part that is kept serves another order only if both hold the same: box, times, and the
    state of the dataset.
    """
    lon, lat, box = AXES["plain"]
    sea = ocean(lon, lat)
    u = sea["u"]
    monkeypatch.setattr(opendap, "PART", 9_000)
    with hostile.serving(hostile.speaking_dap(sea)) as address:

        def keys(where: tuple[float, ...], begin: str, said: dict[str, object]) -> list[str]:
            sea["u"] = replace(u, attributes={**u.attributes, **said})
            times = [np.datetime64(when.rstrip("Z"), "s") for when in (begin, END)]
            one = Provider("trial", "trial", "current", "opendap", ("u", "v"), (address,))
            shipment = opendap.ship(
                Order(
                    one,
                    Box(where[0], where[1], where[2], where[3]),
                    times[0],
                    times[1],
                    5.0,
                    times[0],
                )
            )
            return [part.key for part in shipment.parts]

        first = keys(box, BEGIN, {})
        assert len(set(first)) == len(first) > 2
        assert keys(box, BEGIN, {"history": "asked just now"}) == first
        assert keys(box, "2024-03-01T02:10Z", {}) == first  # between the same two times
        moved = (box[0] + 3, box[1], box[2] + 3, box[3])  # as many columns
        for other in (
            keys(moved, BEGIN, {}),
            keys(box, "2024-03-01T01:10Z", {})[:-1],
            keys(box, BEGIN, {"scale_factor": np.float32(0.002)}),
        ):
            assert not set(other) & set(first)


@pytest.mark.thorough
@pytest.mark.parametrize("level", [pytest.param(0, marks=pytest.mark.thorough), 2.4, -15])
def test_components_at_two_addresses_at_a_level(tmp_path: Path, level: float) -> None:
    """As HYCOM has them: each address holds one component, at depths of which the nearest is taken."""
    lon, lat, box = AXES["plain"]
    rng = np.random.default_rng(11)
    depths = np.array([0.0, 2.0, 4.0, 12.0])
    values = {
        name: rng.uniform(-1, 1, (72, 4, lat.size, lon.size)).astype(np.float32) for name in "uv"
    }
    sea = ocean(lon, lat)
    sea["depth"] = Variable(
        ("depth",), depths, {"units": "m", "positive": "down", "standard_name": "depth"}
    )
    served = [
        {n: v for n, v in sea.items() if n not in "uv"}
        | {name: Variable(("time", "depth", "lat", "lon"), values[name], sea["v"].attributes)}
        for name in "uv"
    ]
    with hostile.serving(by_component(served)) as address:
        got = drift.fetch(
            box=box, begin=BEGIN, end=END, providers=["trial"], out=tmp_path / "out", timeout=5.0,
            catalogue=two(tmp_path, address, ("u", "v"), level),
        )  # fmt: skip
    (path,) = (path for path in got.files if path.suffix == ".nc")
    wanted = {0: 0, 2.4: 1, -15: 3}[level]
    # a run takes nothing so deep for the surface by itself
    assert ('depth = "15 m"' in got.tables) == (level == -15)
    with netCDF4.Dataset(path) as data:
        t, rows, columns = (
            data["time"][:].astype(int), np.searchsorted(lat, data["lat"][:]), np.searchsorted(lon, data["lon"][:]),
        )  # fmt: skip
        assert list(data["depth"][:]) == [depths[wanted]]
        for name in "uv":
            assert np.array_equal(
                data[name][:, 0], values[name][np.ix_(t, [wanted], rows, columns)][:, 0]
            )


def test_a_curvilinear_grid_whose_components_lie_along_it(tmp_path: Path) -> None:
    """As MEPS has them: longitudes and latitudes in two dimensions, components along a projection's
    axes.
    """
    whole = writers.projected(tmp_path / "whole.nc")
    with xr.open_dataset(whole, decode_times=False) as data:
        to = pyproj.Proj(writers.STEREO)
        lon, lat = to(*np.meshgrid(data["X"].values, data["Y"].values), inverse=True)
        more = data.load().assign_coords(
            longitude=(("Y", "X"), lon, {"units": "degrees_east", "standard_name": "longitude"}),
            latitude=(("Y", "X"), lat, {"units": "degrees_north", "standard_name": "latitude"}),
        )
    more.to_netcdf(tmp_path / "both.nc")
    west, south, east, north = box = (3.2, 58.4, 4.7, 59.3)
    with hostile.serving(hostile.speaking_dap(hostile.held(tmp_path / "both.nc"))) as address:
        got = fetched(tmp_path, address, box, begin="2024-03-05T00:00Z", end="2024-03-05T05:00Z")
    files = [str(path) for path in got.files if path.suffix == ".nc"]
    source = sources.open_source("current", files, variables={"east": "u", "north": "v"})
    assert source.times.size == 3
    lon, lat = np.meshgrid(source.grid.lon, source.grid.lat)
    inside = (lon > west) & (lon < east) & (lat > south) & (lat < north)
    assert inside.sum() > 500
    # of the grid, which is larger than the box by its turn and two cells
    assert inside.mean() > 0.2
    for k in range(3):
        got_there = source.read(k)
        for axis, expected in enumerate(writers.field(lon, lat, 3.0 * k)):
            assert np.abs(got_there[..., axis] - expected)[inside].max() < writers.tolerance()


@pytest.mark.thorough
def test_components_at_other_points_are_refused(tmp_path: Path) -> None:
    """NEMO's grid_U and grid_V hold their own points under the same names."""
    served = [hostile.held(path) for path in model_writers.nemo(tmp_path)]
    names = [next(name for name, one in held.items() if one.values.ndim == 4) for held in served]
    with (
        hostile.serving(by_component(served)) as address,
        pytest.raises(UserError, match="are on different points"),
    ):
        drift.fetch(
            box=(3.2, 58.4, 4.7, 59.3), begin="2024-03-05T00:00Z", end="2024-03-05T05:00Z", providers=["trial"],
            out=tmp_path / "out", timeout=5.0, catalogue=two(tmp_path, address, (names[0], names[1]), 0),
        )  # fmt: skip


@pytest.mark.thorough
def test_a_run_reads_what_was_fetched(tmp_path: Path) -> None:
    lon, lat, box = AXES["-180..180, across 180"]
    with hostile.serving(hostile.speaking_dap(ocean(lon, lat))) as address:
        got = fetched(tmp_path, address, box)
    case = trial_case.load(
        tmp_path,
        got.tables,
        start="2024-03-01T12:00Z",
        domain={"west": 171, "south": -44, "east": 189, "north": -32},
        current=None,
        uncertainty={"wind": {"std": "1 m/s", "time": "6 h"}},
        wind={"constant": {"speed": "10 kn", "from": 270}},
        scenario={"object": "PIW-1", "position": {"at": "38 00S 179 57E", "std": "1 nmi"}},
    )
    result = drift.run(case)
    assert result.probability.sizes["time"] > 1
    assert result.summary["account"]["outside"] == 0
