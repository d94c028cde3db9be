"""Datasets in memory as forcing: the same bits as from a file, however they were opened; and what
is refused.
"""

import gc
import threading
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cftime
import dask.array
import numpy as np
import pandas as pd
import pytest
import trial_case
import xarray as xr
from dask.callbacks import Callback

import drift
from drift.apps.check import check
from drift.pipeline import run_setup
from geo.errors import UserError
from geo.forcing import sources
from geo.forcing.reading import memory
from geo.forcing.sources import Source

HELD = "roms"


def curved(
    path: Path,
    units: str = "hours since 2026-11-21 12:00:00",
    calendar: str = "standard",
    **time: Any,
) -> Path:
    """Write a turned grid across the antimeridian: packed, with land, rotated vectors, a level and
    coordinates by name.
    """
    j, i = np.mgrid[0:14, 0:17].astype(float)
    lon, lat = 179.2 + 0.11 * i - 0.03 * j, -17.9 + 0.02 * i + 0.1 * j
    hours = np.arange(0.0, 37.0, 3.0)
    phase = hours[:, None, None] / 7 + 0.3 * i - 0.2 * j
    u, v = 0.4 + 0.3 * np.cos(phase), -0.2 + 0.5 * np.sin(phase)
    for values in (u, v):
        values[:, (i > 12) & (j > 9)] = np.nan
    dims = ("time", "depth", "y", "x")
    packed = {"dtype": "i2", "scale_factor": 0.0007, "add_offset": 0.1, "_FillValue": -32768}
    data = xr.Dataset(
        {
            "u": (dims, u[:, None], {"standard_name": "sea_water_x_velocity", "units": "m s-1"}),
            "v": (dims, v[:, None], {"standard_name": "sea_water_y_velocity", "units": "m s-1"}),
            "salt": (dims, 35 + u[:, None], {"units": "1"}),
        },
        {
            "longitude": (
                ("y", "x"),
                (lon + 180) % 360 - 180,
                {"units": "degrees_east", "standard_name": "longitude"},
            ),
            "latitude": (("y", "x"), lat, {"units": "degrees_north", "standard_name": "latitude"}),
            "depth": ("depth", [0.0], {"units": "m", "positive": "down"}),
            "time": ("time", hours, {"units": units, "calendar": calendar}),
        },
    )
    data.time.encoding = time
    data.to_netcdf(path, encoding={"u": packed, "v": packed})
    return path


WAYS: dict[str, Callable[[Path], xr.Dataset]] = {
    "loaded": lambda path: xr.load_dataset(path),
    "lazy": lambda path: xr.open_dataset(path),
    "raw": lambda path: xr.load_dataset(path, decode_cf=False),
    "raw and lazy": lambda path: xr.open_dataset(path, decode_cf=False),
    "dask": lambda path: xr.open_dataset(path, chunks={"time": 1, "x": 5}),
    "raw dask": lambda path: xr.open_dataset(path, decode_cf=False, chunks={"time": 2}),
    "cftime": lambda path: xr.load_dataset(
        path, decode_times=xr.coders.CFDatetimeCoder(use_cftime=True)
    ),
    "all coordinates": lambda path: xr.load_dataset(path, decode_coords="all"),
    "no index": lambda path: xr.load_dataset(path).drop_indexes("time"),
    "not masked": lambda path: xr.load_dataset(path, mask_and_scale=False),
}


def same(one: Source, other: Source) -> None:
    assert one.times.tolist() == other.times.tolist()
    assert one.grid == other.grid
    for k in range(len(one.times)):
        assert one.read(k).tobytes() == other.read(k).tobytes()


@pytest.mark.parametrize("way", WAYS)
def test_a_dataset_gives_the_bits_of_its_file_however_it_was_opened(
    tmp_path: Path, way: str
) -> None:
    path = curved(tmp_path / "roms.nc")
    data = WAYS[way](path)
    before = data.copy(deep=False)
    encodings = {name: dict(variable.encoding) for name, variable in data.variables.items()}
    source = sources.open_source("current", memory.wrap_datasets({HELD: data})[HELD])
    same(source, sources.open_source("current", str(path)))
    assert np.isnan(source.read(3)).any()
    assert data.identical(before)
    assert {name: dict(variable.encoding) for name, variable in data.variables.items()} == encodings


@pytest.mark.parametrize(
    ("calendar", "units", "kind"),
    [
        ("noleap", "days since 2026-11-21 12:00:00", "f8"),
        ("julian", "seconds since 2026-11-21", "i8"),
        ("standard", "days since 1950-01-01", "f4"),  # to 337 s: rounded, and said
        ("360_day", "hours since 2026-11-21", "f4"),
    ],
)
def test_calendars_and_single_precision_are_read_as_from_the_file(
    tmp_path: Path, calendar: str, units: str, kind: str
) -> None:
    path = curved(tmp_path / "roms.nc")
    with xr.open_dataset(path, decode_times=False) as data:
        hours = data.time.values
        run_setup = cftime.datetime(2026, 11, 21, 12, calendar=calendar)
        dates = [run_setup + pd.Timedelta(hours=h).to_pytimedelta() for h in hours]
        numbers = np.asarray(cftime.date2num(dates, units, calendar)).astype(kind)
        data = data.assign_coords(
            time=("time", numbers, {"units": units, "calendar": calendar})
        ).load()
    other = tmp_path / "dated.nc"
    data.to_netcdf(other)
    file = sources.open_source("current", str(other))
    for way in ("loaded", "raw", "cftime"):
        source = sources.open_source(
            "current", memory.wrap_datasets({HELD: WAYS[way](other)})[HELD]
        )
        same(source, file)
        assert [note for note in file.notes if "calendar" in note or "precision" in note] == [
            note for note in source.notes if "calendar" in note or "precision" in note
        ]


def held(data: xr.Dataset, **how: Any) -> Source:
    return sources.open_source("current", memory.wrap_datasets({HELD: data})[HELD], **how)


def test_dates_that_are_none_are_refused(tmp_path: Path) -> None:
    data = xr.load_dataset(curved(tmp_path / "roms.nc"))
    holed = data.time.values.copy()
    holed[4] = np.datetime64("NaT", "ns")
    with pytest.raises(UserError, match=r'dataset "roms": "time" has missing values'):
        held(data.assign_coords(time=holed))
    with pytest.raises(UserError, match=r'dataset "roms": "time" has units ""'):
        held(data.assign_coords(time=[f"day {k}" for k in range(data.time.size)]))
    thirtieth = [
        cftime.datetime(2026, 2, 28 + k % 3, k // 3, calendar="360_day")
        for k in range(data.time.size)
    ]
    with pytest.raises(UserError, match=r'dataset "roms": .* calendar "360_day" that do not exist'):
        held(data.assign_coords(time=sorted(thirtieth)))


def test_times_of_a_zone_are_brought_to_utc(tmp_path: Path) -> None:
    """14:00 in Paris in November is 13:00 UTC."""
    data = xr.load_dataset(curved(tmp_path / "roms.nc"))
    aware = pd.date_range("2026-11-21 14:00", periods=data.time.size, freq="3h", tz="Europe/Paris")
    utc = np.datetime64("2026-11-21T13:00:00") + np.arange(data.time.size) * np.timedelta64(3, "h")
    for times in (aware, np.array(list(aware), object), [time.to_pydatetime() for time in aware]):
        assert (held(data.assign_coords(time=times)).times == utc).all()


def test_a_digest_tells_contents_apart_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = curved(tmp_path / "roms.nc")
    data = xr.load_dataset(path)
    first = held(data).fingerprint
    assert held(data.copy(deep=True)).fingerprint == first
    assert held(xr.open_dataset(path, chunks={"time": 1})).fingerprint == first
    assert held(data.assign(salt=data.salt + 1)).fingerprint == first  # not what is read
    changed = {
        "value": data.copy(deep=True),
        "place": data.copy(deep=True),
        "words": data.copy(deep=True),
    }
    changed["value"].u[-1, 0, 2, 5] += 0.01
    changed["place"] = data.assign_coords(latitude=data.latitude + 1e-4)
    changed["words"].u.attrs["units"] = "cm/s"
    changed["time"] = data.assign_coords(time=data.time + np.timedelta64(1, "h"))
    prints = {first} | {held(one).fingerprint for one in changed.values()}
    assert len(prints) == 5
    # so that all are large: by samples, of the last slice too
    monkeypatch.setattr(memory, "WHOLE", 100)
    assert len({held(one).fingerprint for one in (data, *changed.values())}) == 5


def test_what_is_lazy_is_read_slice_by_slice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No one computation of dask ever holds more than the two slices between which a hash's piece
    begins and ends.
    """
    monkeypatch.setattr(memory, "PIECE", 14 * 17 * 4)
    data = xr.load_dataset(curved(tmp_path / "roms.nc"))
    seen: list[set[int]] = [set()]
    lock = threading.Lock()

    def slice_of(block: np.ndarray, block_info: Any = None) -> np.ndarray:
        with lock:
            seen[-1].add(block_info[0]["chunk-location"][0])
        return block

    for name in ("u", "v"):
        whole = dask.array.from_array(data[name].values, chunks=(1, 1, 14, 17))
        data[name] = (
            data[name].dims,
            whole.map_blocks(slice_of, dtype=whole.dtype, meta=whole._meta),
            data[name].attrs,
        )
    with Callback(start=lambda dsk: seen.append(set())):
        source = held(data)
        count = len(seen)
        source.read(5)
    assert {k for one in seen[:count] for k in one} == set(range(13))  # its hash is that of all
    assert max(map(len, seen)) <= 2
    assert {k for one in seen[count:] for k in one} == {5}
    assert isinstance(data.u.data, dask.array.Array)


def case_of(folder: Path, source: str) -> drift.Case:
    return trial_case.load(
        folder,
        f'[[current]]\nname = "model"\n{source}',
        start="211200ZNOV26",
        duration="30 h",
        particles=2000,
        max_lost=1.0,
        domain={"west": 179.0, "east": -179.0, "south": -18.0, "north": -16.4},
        current=None,
        scenario={"position": {"at": [179.9, -17.3], "std": "2 km"}},
    )


@pytest.mark.thorough
def test_a_run_gives_the_bits_of_a_run_from_the_file_and_lets_the_dataset_go(
    tmp_path: Path,
) -> None:
    path = curved(tmp_path / "roms.nc")
    file = drift.run(case_of(tmp_path, 'files = "roms.nc"'))
    data = xr.load_dataset(path)
    before, gone, values = data.copy(deep=True), weakref.ref(data), weakref.ref(data.u.values)
    result = drift.run(case_of(tmp_path, 'dataset = "roms"'), datasets={HELD: data})
    for name in ("lon", "lat", "status"):
        assert (
            getattr(result.trajectories, name).tobytes()
            == getattr(file.trajectories, name).tobytes()
        )
    assert result.probability.values.tobytes() == file.probability.values.tobytes()
    (told,) = result.summary["forcing"]
    assert told["name"] == "model"
    assert len(told["fingerprint"]) == 16
    assert data.identical(before)
    del data
    gc.collect()
    assert gone() is None
    assert values() is None


def test_names_and_types_that_do_not_fit_are_refused_in_one_line(tmp_path: Path) -> None:
    data = xr.load_dataset(curved(tmp_path / "roms.nc"))
    case = case_of(tmp_path, 'dataset = "roms"')
    for given, message in (
        (None, r'case.toml: current "model": dataset = "roms" is an xarray.Dataset in memory, which only Python .* name files'),
        ({}, "which only Python can give"),
        ({"roms": data, "arome": data}, r'"arome" is given, and no source of case.toml has dataset = "arome"; named: "roms"'),
        (data, "datasets: a Dataset is given; must be"),
        ([data], "datasets: a list is given; must be"),
        ({"roms": data.u}, r'"roms" is a DataArray; must be an xarray.Dataset; its to_dataset\(\) makes one'),
        ({"roms": pd.DataFrame({"u": [1.0]})}, r'"roms" is a DataFrame; must be an xarray.Dataset'),
        ({"roms": tmp_path / "roms.nc"}, "Path; must be an xarray.Dataset; files are named in the case"),
        ({"roms": data.drop_vars("v")}, r'current "model": .*u is one component'),
        ({"roms": data.drop_vars(["u", "v"])}, r'current "model": no current .*\[\[current\]\] dataset'),
        ({"roms": data.assign({0: data.u, "0": data.u})}, r'dataset "roms" cannot be decoded \(.*conflicts'),
        ({"roms": data.isel(time=[3])}, r'current "model": .*one time only'),
    ):  # fmt: skip
        with pytest.raises(UserError, match=message) as refused:
            check.check(case, given)
        assert "\n" not in str(refused.value)
    with pytest.raises(
        UserError, match="steady belongs to files and to a dataset; this source is constant"
    ):
        case_of(tmp_path, "constant = { east = 0.1, north = 0.2 }\nsteady = true")
    with pytest.raises(UserError, match="found files and dataset"):
        case_of(tmp_path, 'dataset = "roms"\nfiles = "roms.nc"')


def test_the_keys_of_files_belong_to_a_dataset_too(tmp_path: Path) -> None:
    """Names, units, a level, times and steadiness as the case says; a name that is no text; two
    sources of one dataset.
    """
    data = xr.load_dataset(curved(tmp_path / "roms.nc")).rename(u=0, v=1)
    for name in (0, 1):
        del data[name].attrs["units"], data[name].attrs["standard_name"]
    keys = (
        'dataset = "roms"\nvariables = { east = "0", north = "1", axes = "grid" }\nunits = "cm/s"\n'
    )
    twice = keys + '[[current]]\nname = "again"\nadd = true\n' + keys + "steady = true\n"
    found = run_setup.open_for(case_of(tmp_path, twice), {HELD: data})
    one, two = found.sources
    steady = sources.open_source("current", str(tmp_path / "roms.nc"), box=found.box).read(0)
    assert one.read(0) == pytest.approx(steady / 100, abs=1e-7, nan_ok=True)
    assert two.read(0).tobytes() == one.read(0).tobytes()
    assert (one.times.size, two.times.size) == (13, 0)
