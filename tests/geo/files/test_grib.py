"""GRIB as forcing: grids against eccodes' own points and values, and directions from differences of
those points.
"""

from pathlib import Path
from typing import Any

import gribs
import numpy as np
import pytest
import trial_case
import writers
from grib_messages import (
    BOTH,
    CELL,
    GRIDS,
    LAMBERT,
    REGULAR,
    direction,
    message,
    pair,
    refusal,
    settings,
    worst,
    written,
)

import drift
from drift.apps.cli.commands import main
from geo import sphere
from geo.files import dataset
from geo.forcing import sources
from geo.grids import grid as grids


@pytest.mark.parametrize("edition", [1, 2])
@pytest.mark.parametrize("along", [False, True])
@pytest.mark.parametrize("kind", GRIDS)
def test_grids(kind: str, along: bool, edition: int, tmp_path: Path) -> None:
    """Without the turn a wind of 0.9 m/s along these axes, 10 to 50 degrees from east, would be
    wrong by 0.15 to 0.7.
    """
    path = written(tmp_path / "a.grib", pair(GRIDS[kind], along=along, edition=edition))
    source = sources.open_source("wind", path, steady=True)
    error, present = worst(source)
    # bilinear twice; edition 1 rounds the first point to 0.001 degrees, 100 m, over which the field
    # changes by 3e-4
    assert error < 2 * writers.tolerance(CELL) + 1e-3
    assert present > 0.4  # the part of the box round a turned grid
    assert any("turned" in note or "rotated" in note for note in source.notes) == (
        along and kind not in ("regular", "mercator")
    )


@pytest.mark.thorough
def test_each_of_many_forecasts_in_a_wind_along_the_grid_is_the_run_of_its_case_alone(
    tmp_path: Path,
) -> None:
    parts = [one for hour in (0.0, 6.0) for one in pair(LAMBERT, along=True, hour=hour)]
    base = trial_case.load(
        tmp_path,
        start="2024-03-05T00:20Z",
        duration="5 h",
        particles=200,
        max_lost=1.0,
        output={"trajectories": 200},
        wind={"files": written(tmp_path / "wind.grib", parts)},
        uncertainty={"wind": {"std": "1.3 m/s", "time": "7 h"}},
        scenario={
            "object": "LIFE-RAFT-DB-11",
            "position": {"at": [4.1, 58.9], "error": "2 nmi"},
        },
    )
    cases = [base, drift.vary(base, {"seed": 3, "scenario.0.position.at": [4.12, 58.91]})]
    for one, own in zip(drift.run_many(cases), cases, strict=True):
        assert one.error is None
        alone = drift.run(own).trajectories
        assert (one.lon * (sphere.TURN / 360) == alone.lon.T).all()
        assert (one.lat * (sphere.TURN / 360) == alone.lat.T).all()


def test_points_are_eccodes_own(tmp_path: Path) -> None:
    for kind, keys in GRIDS.items():
        raw = message("10u", keys)
        lon, lat = gribs.points("GRIB2", settings(keys, 2, 0.0, False, "10u", {}))
        path = written(tmp_path / f"{kind}.grib", [raw])
        data = dataset.open_one(str(path), "wind")
        assert data["10u"].shape == (1, 25, 36)
        if "latitude" in data.variables:
            np.testing.assert_allclose(data["latitude"], lat.reshape(25, 36)[:, 0], atol=1e-9)
            np.testing.assert_allclose(data["longitude"], lon.reshape(25, 36)[0], atol=1e-9)
        else:
            assert "projection" in data.variables  # a plane, found right by its own points


@pytest.mark.parametrize("edition", [1, 2])
@pytest.mark.parametrize(
    "flags", [(0, 0, 0, 0), (1, 0, 0, 0), (0, 1, 1, 0), (1, 0, 1, 0), (0, 1, 0, 1), (1, 0, 0, 1)]
)
def test_orders_of_scanning(flags: tuple[int, int, int, int], edition: int, tmp_path: Path) -> None:
    leftwards, upwards, consecutive, alternating = flags
    if alternating and edition == 1:
        pytest.skip("edition 1 has no such order")
    keys = dict(REGULAR)
    if leftwards:
        keys["longitudeOfFirstGridPointInDegrees"], keys["longitudeOfLastGridPointInDegrees"] = (
            5.7,
            2.2,
        )
    if not upwards:
        keys["latitudeOfFirstGridPointInDegrees"], keys["latitudeOfLastGridPointInDegrees"] = (
            60.0,
            57.6,
        )
    keys |= {
        "iScansNegatively": leftwards,
        "jScansPositively": upwards,
        "jPointsAreConsecutive": consecutive,
    }
    if edition == 2:
        keys["alternativeRowScanning"] = alternating
    lon, lat = np.meshgrid(2.2 + 0.1 * np.arange(36), 57.6 + 0.1 * np.arange(25))

    def ordered(values: Any) -> Any:
        values = values[:, ::-1] if leftwards else values
        values = values if upwards else values[::-1]
        values = values.T if consecutive else values.copy()
        if alternating:
            values[1::2] = values[1::2, ::-1]
        return values.ravel()

    u, v = writers.field(lon, lat, 0.0)
    parts = [
        message(n, keys, ordered(w), edition=edition) for n, w in zip(BOTH, (u, v), strict=True)
    ]
    source = sources.open_source("wind", written(tmp_path / "a.grib", parts), steady=True)
    assert (source.grid.nlon, source.grid.nlat) == (36, 25)
    np.testing.assert_allclose(source.read(0)[..., 0], u, atol=1e-5)
    np.testing.assert_allclose(source.read(0)[..., 1], v, atol=1e-5)


def test_round_the_earth_and_across_its_seam(tmp_path: Path) -> None:
    keys = {
        "gridType": "regular_ll", "Ni": 72, "Nj": 37, "latitudeOfFirstGridPointInDegrees": 90.0,
        "longitudeOfFirstGridPointInDegrees": 0.0, "latitudeOfLastGridPointInDegrees": -90.0,
        "longitudeOfLastGridPointInDegrees": 355.0, "iDirectionIncrementInDegrees": 5.0,
        "jDirectionIncrementInDegrees": 5.0, "jScansPositively": 0,
    }  # fmt: skip
    lon, lat = np.meshgrid(5.0 * np.arange(72), 90.0 - 5.0 * np.arange(37))
    u, v = np.sin(np.radians(lon + 20)) + lat / 90, np.cos(np.radians(2 * lon)) - lat / 45
    parts = [message(n, keys, w.ravel()) for n, w in zip(BOTH, (u, v), strict=True)]
    source = sources.open_source("wind", written(tmp_path / "a.grib", parts), steady=True)
    assert source.grid.seamless
    got = grids.sample(
        source.grid,
        source.read(0),
        [-5.0, 355.0, 180.0, -180.0, 130.0],
        [40.0, 40.0, -35.0, -35.0, 5.0],
    )
    wanted = [(u[10, 71], v[10, 71])] * 2 + [(u[25, 36], v[25, 36])] * 2 + [(u[17, 26], v[17, 26])]
    np.testing.assert_allclose(got, wanted, atol=1e-5)


def test_reduced_gaussian_grid_is_filled_up_row_by_row(tmp_path: Path) -> None:
    """N32: rows of at most 128 points; between two of a row the error is h^2 / 8 |f''|, h up to 5.6
    degrees of 30 N.
    """
    parts, sample = [], "reduced_gg_sfc_grib2"
    lon, lat = gribs.points(sample, {})
    for name, values in zip(BOTH, (5 + 3 * np.sin(np.radians(lon + 30)), lat / 20), strict=True):
        parts.append(gribs.pack(sample, {"shortName": name}, values))
    source = sources.open_source("wind", written(tmp_path / "a.grib", parts), steady=True)
    lon, lat = np.meshgrid(source.grid.lon, source.grid.lat)
    near = np.abs(lat) < 60
    got = source.read(0).astype(float)
    assert source.grid.seamless
    assert (
        np.abs(got[..., 0] - (5 + 3 * np.sin(np.radians(lon + 30))))[near].max()
        < 3 * np.radians(4.5) ** 2 / 8 * 2
    )
    assert np.abs(got[..., 1] - lat / 20)[near].max() < 1e-3


def test_a_grid_without_rows_is_refused_by_name(tmp_path: Path) -> None:
    raw = gribs.pack("sh_sfc_grib2", {"shortName": "10u"}, np.empty(0))
    told = refusal("wind", written(tmp_path / "a.grib", [raw]), steady=True)
    assert '"sh"' in told
    assert "regular" in told


def test_times_joined_from_files_of_both_editions(tmp_path: Path) -> None:
    first = written(
        tmp_path / "a.grib", pair(REGULAR, hour=3.0) + pair(REGULAR, hour=0.0, edition=1)
    )
    second = written(tmp_path / "b.grib", pair(REGULAR, hour=6.0))
    source = sources.open_source("wind", [second, first])
    assert (source.times == writers.TIMES.astype("datetime64[s]")).all()
    for k in range(3):
        assert worst(source, k, 3.0 * k)[0] < 2e-3  # edition 1: to 0.001 degrees
    steps = written(
        tmp_path / "c.grib",
        [m for k in (1, 2) for m in pair(REGULAR, stepUnits=1, endStep=6 * k, startStep=6 * k)],
    )
    assert (
        sources.open_source("wind", steps).times
        == np.array(["2024-03-05T06", "2024-03-05T12"], "M8[s]")
    ).all()


def test_nam(data: Path) -> None:
    """NAM's 10 m wind counts along a Lambert grid of 81 km: turned by differences of eccodes' own
    points.
    """
    path = data / "grib" / "nam_lambert.grib2"
    raw = gribs.unpack(str(path), BOTH)
    angle = np.radians(direction(raw["lon"], raw["lat"]))
    u = raw["10u"] * np.cos(angle) - raw["10v"] * np.sin(angle)
    v = raw["10u"] * np.sin(angle) + raw["10v"] * np.cos(angle)
    source = sources.open_source("wind", path, steady=True)
    inner = slice(3, -3), slice(3, -3)
    got = grids.sample(
        source.grid, source.read(0), raw["lon"][inner].ravel(), raw["lat"][inner].ravel()
    )
    error = got - np.stack((u[inner].ravel(), v[inner].ravel()), axis=-1)
    speed = np.sqrt(np.mean(u**2 + v**2))
    rms = np.sqrt(np.nanmean(np.sum(error**2, axis=-1)))
    assert np.isfinite(got).all()
    assert rms < 0.08 * speed  # bilinear twice on cells of 81 km; unturned it is 0.2
    # a turn the wrong way, or none, leaves a mean angle: that of ours is below a tenth of a degree
    turned = np.angle(
        np.sum((got[:, 0] + 1j * got[:, 1]) * np.conj(u[inner].ravel() + 1j * v[inner].ravel())),
        deg=True,
    )
    assert abs(turned) < 0.1
    assert "10u, 10v" in source.notes[0]


def test_real_files_that_are_refused(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = data / "grib"
    told = refusal("wind", folder / "uv_on_different_levels.grib")
    assert "1000, 850, 700, 500, 400 hPa" in told
    told = refusal("wind", folder / "regular_gg_sfc.grib")
    assert "10u is one component of the wind, but the northward one is missing" in told
    assert main(["info", str(folder / "regular_gg_sfc.grib")]) != 0
    assert "northward one is missing" in capsys.readouterr().err
