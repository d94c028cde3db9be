"""Valid ranges and quality flags: what a file calls invalid is missing, and said."""

from pathlib import Path
from typing import Any

import linear
import numpy as np
import pytest
import xarray as xr

from geo.forcing import sources
from geo.forcing.reading import memory

HOURS = np.arange(0.0, 7.0)
SPOT = (3, 5, 7)  # slice, row and column that hold what is invalid
WRONG = 2.5  # [m/s] a speed that a current may have
NEAR = 1e-6


def spoilt(**attributes: Any) -> xr.Dataset:
    data = linear.dataset(HOURS, **attributes)
    for name in ("uo", "vo"):
        data[name].values[SPOT] = WRONG
    return data


def held(source: Any) -> tuple[bool, float]:
    """Whether the value that is invalid is missing, and the largest error of all others [m/s]."""
    right = np.stack(linear.values(HOURS), -1)
    got = np.stack([source.read(k) for k in range(len(HOURS))]).astype(float)
    missing = bool(np.isnan(got[SPOT]).all())
    got[SPOT] = right[SPOT]
    return missing, float(np.abs(got - right).max())


LIMITS: dict[str, dict[str, Any]] = {
    "range": {"valid_range": np.array([-1.5, 1.5], np.float32)},
    "whole numbers": {"valid_range": np.array([-2, 2])},
    "least and greatest": {"valid_min": -1.5, "valid_max": 1.5},
    "greatest": {"valid_max": np.float32(1.5)},
    "text": {"valid_range": "-1.5, 1.5"},
}


@pytest.mark.parametrize("key", LIMITS)
def test_values_outside_their_range_are_missing(key: str, tmp_path: Path) -> None:
    path = linear.written(tmp_path / "a.nc", spoilt(**LIMITS[key]))
    source = sources.open_source("current", path)
    missing, error = held(source)
    assert missing
    assert error < NEAR
    assert any(
        next(iter(LIMITS[key])) in note and "plausible = true" in note for note in source.notes
    )
    vouched = sources.open_source("current", path, plausible=True)
    assert vouched.read(SPOT[0])[SPOT[1:]] == pytest.approx((WRONG, WRONG))


# scale, offset, type and limits in packed numbers, or in m/s where they are floating
PACKED: dict[str, tuple[float, float, str, Any]] = {
    "packed": (0.001, 0.0, "i2", np.array([-1500, 1500], np.int16)),
    "offset": (0.001, 5.0, "i2", np.array([-6500, -3500], np.int16)),
    "scale below 0": (-0.001, 0.0, "i2", np.array([-1500, 1500], np.int16)),
    "unpacked": (0.001, 0.0, "i2", np.array([-1.5, 1.5])),
    "wider": (0.001, 0.0, "i2", np.array([-1500, 1500], np.int32)),
}


@pytest.mark.parametrize("key", PACKED)
def test_packed_limits(key: str, tmp_path: Path) -> None:
    """netCDF4 masks by the same limits where they are packed numbers of the variable's type."""
    scale, offset, kind, limits = PACKED[key]
    how = {"dtype": kind, "scale_factor": scale, "add_offset": offset, "_FillValue": -32768}
    path = linear.written(tmp_path / "a.nc", spoilt(valid_range=limits), uo=how, vo=how)
    missing, error = held(sources.open_source("current", path))
    assert missing
    assert error < 0.51 * abs(scale)
    for opened in (xr.open_dataset(path), xr.open_dataset(path, decode_cf=False)):
        with opened:
            assert held(sources.open_source("current", memory.wrap_datasets({"a": opened})["a"]))[0]


def test_a_value_at_its_limit_is_valid(tmp_path: Path) -> None:
    data = linear.dataset(HOURS)
    top = float(data.uo.max())
    how = {"dtype": "i2", "scale_factor": top / 9999, "_FillValue": -32768}
    data.uo.attrs["valid_max"] = np.int16(9999)
    assert (
        sources.open_source("current", linear.written(tmp_path / "a.nc", data, uo=how)).missing == 0
    )
    data.uo.attrs["valid_max"] = np.float32(top)
    path = linear.written(tmp_path / "b.nc", data, uo={"dtype": "f4"})
    source = sources.open_source("current", path)
    assert np.isfinite(source.read(len(HOURS) - 1)).all()


def test_unsigned_limits(tmp_path: Path) -> None:
    """Bytes that are unsigned by an attribute: -56 stands for 200, which unpacks to 1.5 m/s."""
    data = spoilt(valid_range=np.array([0, -56], np.int8))
    how = {
        "dtype": "u1",
        "scale_factor": 0.02,
        "add_offset": -2.5,
        "_FillValue": 255,
        "_Unsigned": "true",
    }
    path = linear.written(tmp_path / "a.nc", data, uo=how, vo=how)
    missing, error = held(sources.open_source("current", path))
    assert missing
    assert error < 0.0101


def flagged(
    data: xr.Dataset, numbers: Any, dims: tuple[str, ...] = ("time", "lat", "lon"), **said: Any
) -> xr.Dataset:
    """Return the dataset with a variable of flags, `qc`, that both components list."""
    for name in ("uo", "vo"):
        data[name].attrs["ancillary_variables"] = "error qc"
    return data.assign(qc=(dims, numbers, said))


def marked(good: int, bad: int, shape: Any = None) -> Any:
    numbers = np.full(shape or (len(HOURS), len(linear.LAT), len(linear.LON)), good, np.int8)
    numbers[SPOT if shape is None else SPOT[1:]] = bad
    return numbers


FLAGS: dict[str, dict[str, Any]] = {
    "values": {
        "numbers": marked(1, 4),
        "flag_values": np.array([1, 3, 4], np.int8),
        "flag_meanings": "good suspect bad",
    },
    "words": {
        "numbers": marked(1, 4),
        "flag_values": "1b, 2b, 4b",
        "flag_meanings": "good_data probably_good bad_data",
    },
    "masks": {
        "numbers": marked(2, 5),
        "flag_masks": np.array([1, 2, 4], np.int8),
        "flag_meanings": "near_coast interpolated range_test_failed",
    },
    "highest bit": {
        "numbers": marked(0, -128),
        "flag_masks": np.array([1, -128], np.int8),
        "flag_meanings": "interpolated invalid",
    },
    "values of masks": {
        "numbers": marked(1, 3),
        "flag_masks": np.array([3, 3, 3], np.int8),
        "flag_values": np.array([1, 2, 3], np.int8),
        "flag_meanings": "good not_evaluated erroneous",
    },
}


@pytest.mark.parametrize("key", FLAGS)
def test_values_that_are_flagged_are_missing(key: str, tmp_path: Path) -> None:
    said = dict(FLAGS[key])
    path = linear.written(tmp_path / "a.nc", flagged(spoilt(), said.pop("numbers"), **said))
    source = sources.open_source("current", path)
    missing, error = held(source)
    assert missing
    assert error < NEAR
    assert any('"qc"' in note for note in source.notes)
    assert not held(sources.open_source("current", path, plausible=True))[0]


def test_flags_by_their_standard_name_and_of_all_times(tmp_path: Path) -> None:
    said = {"flag_values": np.array([1, 4], np.int8), "flag_meanings": "pass fail"}
    shape = (len(linear.LON), len(linear.LAT))
    numbers = marked(1, 4, shape[::-1]).T
    for k, standard in enumerate(("quality_flag", "eastward_sea_water_velocity status_flag")):
        data = spoilt().assign(q=(("lon", "lat"), numbers, said | {"standard_name": standard}))
        source = sources.open_source("current", linear.written(tmp_path / f"{k}.nc", data))
        got = source.read(0)
        assert np.isnan(got[SPOT[1:]]).all()
        assert np.isnan(got[..., 0]).sum() == 1
    data = spoilt().assign(
        sst_qc=(("lon", "lat"), numbers, said | {"standard_name": "quality_flag"})
    )
    data["sst"] = data.uo.assign_attrs(
        standard_name="sea_surface_temperature", ancillary_variables="sst_qc"
    )
    source = sources.open_source("current", linear.written(tmp_path / "sst.nc", data))
    assert source.missing == 0  # flags of another variable


def test_missing_value_and_fill_value_are_both_missing(tmp_path: Path) -> None:
    data = spoilt()
    data.uo.values[0, 0, 0] = 77.0
    data.uo.attrs["missing_value"] = WRONG
    data.vo.attrs["missing_value"] = WRONG
    path = tmp_path / "a.nc"
    linear.written(path, data, uo={"_FillValue": None}, vo={"_FillValue": None})
    import netCDF4

    with netCDF4.Dataset(path, "a") as file:
        file["uo"].setncattr("missing_value", np.array([WRONG, 77.0]))
    source = sources.open_source("current", path)
    assert np.isnan(source.read(0)[0, 0]).all()
    assert np.isnan(source.read(SPOT[0])[SPOT[1:]]).all()
