"""Noise of one level, of a table and of a file; what is no noise is refused in one line."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from drift.evidence.sensors import hearing, noise
from geo.errors import UserError

BEARING = np.arange(0.0, 360.0, 20.0)
TIMES = np.array(["2026-03-01T00", "2026-03-01T06", "2026-03-02T00"], "datetime64[ns]")
LEVEL = np.round(
    70.0 + 6 * np.sin(np.radians(BEARING - 50))[None] + np.array([0.0, 3.0, -2.0])[:, None], 2
)


def dataset(
    level: np.ndarray = LEVEL, bearing: np.ndarray = BEARING, unit: str = "dB re 1 uPa^2/Hz"
) -> xr.Dataset:
    data = xr.Dataset(
        {"noise": (("time", "bearing"), level, {"units": unit})},
        {"time": TIMES, "bearing": bearing},
    )
    data["bearing"].attrs["units"] = "degree"
    return data


def test_one_level() -> None:
    made = noise.constant(62.5)
    assert made.level.tolist() == [[62.5]]
    assert made.level.dtype == np.float32
    assert made.times.size == 0
    assert made.bearing.size == 1


def test_a_table_is_taken_in_order_round_the_circle() -> None:
    made = noise.of_table([[a, 60.0 + a / 10] for a in (-90, -135, -180, 0, -45, 90, 45, 135)])
    np.testing.assert_allclose(np.degrees(made.bearing), np.arange(0, 360, 45))
    np.testing.assert_allclose(made.level, [[60, 64.5, 69, 73.5, 42, 46.5, 51, 55.5]])


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d,
        lambda d: d.transpose("bearing", "time"),
        lambda d: d.isel(bearing=[3, 0, 17, *range(4, 17), 1, 2]),
        lambda d: d.rename(noise="ambient", bearing="azimuth"),
        lambda d: d.expand_dims(frequency=[300.0]),
        lambda d: d.assign(depth_of_array=("time", [1.0, 2.0, 3.0])),
        lambda d: d.assign_coords(
            bearing=d["bearing"] - 360.0 * (d["bearing"] > 180)
        ).assign_coords(bearing=lambda e: e["bearing"].assign_attrs(units="degrees_true")),
    ],
    ids=[
        "plain",
        "bearing first",
        "any order",
        "other names",
        "frequency",
        "beside another",
        "negative",
    ],
)
@pytest.mark.parametrize("packed", [False, True])
def test_each_way_of_writing_gives_the_same_table(
    change: Any, packed: bool, tmp_path: Path
) -> None:
    data = change(dataset())
    name = next(n for n in ("noise", "ambient") if n in data)
    how = {"dtype": "i2", "scale_factor": 0.01, "_FillValue": -9999} if packed else {}
    data.to_netcdf(tmp_path / "a.nc", encoding={name: how})
    made = noise.read_noise(tmp_path / "a.nc")
    np.testing.assert_allclose(np.degrees(made.bearing), BEARING, atol=1e-9)
    np.testing.assert_allclose(made.level, LEVEL, rtol=0, atol=4 * np.spacing(np.float32(100)))
    np.testing.assert_array_equal(made.times, TIMES.astype("datetime64[s]"))


def test_one_time_holds_always(tmp_path: Path) -> None:
    dataset().isel(time=[1]).to_netcdf(tmp_path / "a.nc")
    dataset().isel(time=1).to_netcdf(tmp_path / "b.nc")
    for file in ("a.nc", "b.nc"):
        made = noise.read_noise(tmp_path / file)
        assert made.times.size == 0
        np.testing.assert_allclose(made.level, LEVEL[1:2], atol=1e-4)


def changed(at: tuple[int, int], value: float) -> np.ndarray:
    level = LEVEL.copy()
    level[at] = value
    return level


BAD: dict[str, tuple[xr.Dataset, str]] = {
    "gap": (dataset(changed((1, 4), np.nan)), "1 of 54 values are missing, first at time 2026-03-01T06:00:00Z, bearing 80 deg"),
    "no dB": (dataset(unit="Pa"), 'the noise level is in "Pa"; allowed is dB'),
    "negative": (dataset(changed((0, 2), -3.0)), "a noise level of -3 dB at time 2026-03-01T00:00:00Z, bearing 40 deg; allowed are 0 to 200"),
    "too loud": (dataset(changed((0, 2), 250.0)), "a noise level of 250 dB; allowed are 0 to 200"),
    "no circle": (dataset().isel(bearing=slice(0, 9)), "between the bearings 160 and 0 degrees: a gap of 200"),
    "times reversed": (dataset().isel(time=[1, 0, 2]), "times do not increase: 2026-03-01T06:00:00Z is followed by 2026-03-01T00"),
    "two frequencies": (
        xr.concat([dataset(), dataset()], xr.IndexVariable("frequency", [100.0, 300.0])),
        r'2 values of "frequency" \(100, 300\); choose one with select',
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
def test_what_is_no_noise_is_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    data, said = BAD[kind]
    data.to_netcdf(tmp_path / "a.nc")
    with pytest.raises(UserError, match=f"^hull: .*{said}") as caught:
        noise.read_noise(tmp_path / "a.nc", name="hull")
    assert len(caught.value.lines) == 1


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([[a, 60.0] for a in range(0, 200, 20)], "between the bearings 180 and 0"),
        ([[0.0, 260.0]], "a noise level of 260 dB at bearing 0 deg; allowed are 0 to 200"),
        ([[0.0, np.nan]], "a noise level of nan dB"),
        ([], "at least one"),
        ([[1.0]], r"rows of \[true bearing in degrees, level in dB\]"),
    ],
)
def test_tables_that_are_no_noise_are_refused(rows: list[list[float]], said: str) -> None:
    with pytest.raises(UserError, match=f"^noise: .*{said}"):
        noise.of_table(rows)


@pytest.mark.parametrize("level", [-1.0, 201.0, np.nan, np.inf])
def test_a_level_that_no_noise_has_is_refused(level: float) -> None:
    with pytest.raises(
        UserError, match=r"^noise: a noise level of \S+ dB; allowed are 0 to 200 dB"
    ):
        noise.constant(level)


def test_a_rose_by_quarters_is_straight_in_between() -> None:
    """As a rose by eighths is whose others are the means of their neighbours."""
    quarters = noise.of_table([[0, 70], [90, 75], [180, 68], [270, 72]])
    eighths = noise.of_table(
        [[0, 70], [45, 72.5], [90, 75], [135, 71.5], [180, 68], [225, 70], [270, 72], [315, 71]]
    )
    at = np.radians(np.arange(0, 360, 7.5))
    levels = [
        hearing.round_circle(at, one.bearing, one.level.T)[:, 0] for one in (quarters, eighths)
    ]
    np.testing.assert_allclose(*levels, rtol=0, atol=1e-5)
    assert levels[0][9] == pytest.approx(70 + 5 * 67.5 / 90)
    # north-east, south-east, ..
    by_sector = noise.of_table([[45, 70], [135, 75], [225, 68], [315, 72]])
    assert hearing.round_circle(np.zeros(1), by_sector.bearing, by_sector.level.T)[
        0, 0
    ] == pytest.approx(71)


@pytest.mark.parametrize("bearings", [(0, 90, 180), (0, 120, 240), (0, 180)])
def test_less_than_four_quarters_is_refused(bearings: tuple[float, ...]) -> None:
    with pytest.raises(
        UserError, match=r"^noise: nothing between the bearings .* allowed are 90 degrees"
    ):
        noise.of_table([[bearing, 70.0] for bearing in bearings])
