"""GRIB as forcing, against eccodes' own points and values, and directions from differences of those
points.
"""

import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gribs
import numpy as np
import pytest
import writers
from pace import Watch
from pyproj import Geod

import drift
from drift.apps.cli.commands import main
from drift.engine.motion import forcing as engine
from geo import sphere, waiting
from geo.errors import UserError
from geo.files import dataset, decoder, messages
from geo.files.child import FAREWELL
from geo.forcing import sources
from geo.grids import grid as grids

SPHERE = Geod(a=6371229.0, b=6371229.0)
BOTH = ("10u", "10v")
CELL = 0.1  # [deg of latitude] of every grid here, 11 km

LAMBERT = {
    "gridType": "lambert", "Nx": 36, "Ny": 25, "Latin1InDegrees": 50.0, "Latin2InDegrees": 62.0, "LoVInDegrees": 20.0,
    "LaDInDegrees": 56.0, "latitudeOfFirstGridPointInDegrees": 57.8, "longitudeOfFirstGridPointInDegrees": 1.5,
    "DxInMetres": 9000, "DyInMetres": 11000,
}  # fmt: skip
STEREOGRAPHIC = {
    "gridType": "polar_stereographic", "Nx": 36, "Ny": 25, "orientationOfTheGridInDegrees": 58.0, "LaDInDegrees": 60.0,
    "latitudeOfFirstGridPointInDegrees": 58.9, "longitudeOfFirstGridPointInDegrees": 0.3, "DxInMetres": 9000,
    "DyInMetres": 11000,
}  # fmt: skip
ROTATED = {
    "gridType": "rotated_ll", "Ni": 36, "Nj": 25, "latitudeOfSouthernPoleInDegrees": -34.0,
    "longitudeOfSouthernPoleInDegrees": -20.0, "angleOfRotationInDegrees": 0.0,
    "latitudeOfFirstGridPointInDegrees": 4.0, "longitudeOfFirstGridPointInDegrees": 11.5,
    "latitudeOfLastGridPointInDegrees": 6.4, "longitudeOfLastGridPointInDegrees": 15.0,
    "iDirectionIncrementInDegrees": 0.1, "jDirectionIncrementInDegrees": 0.1,
}  # fmt: skip
REGULAR = {
    "gridType": "regular_ll", "Ni": 36, "Nj": 25, "latitudeOfFirstGridPointInDegrees": 57.6,
    "longitudeOfFirstGridPointInDegrees": 2.2, "latitudeOfLastGridPointInDegrees": 60.0,
    "longitudeOfLastGridPointInDegrees": 5.7, "iDirectionIncrementInDegrees": 0.1, "jDirectionIncrementInDegrees": 0.1,
}  # fmt: skip
MERCATOR = {
    "gridType": "mercator", "Ni": 36, "Nj": 25, "latitudeOfFirstGridPointInDegrees": 57.6,
    "longitudeOfFirstGridPointInDegrees": 2.2, "latitudeOfLastGridPointInDegrees": 60.12,
    "longitudeOfLastGridPointInDegrees": 5.7, "LaDInDegrees": 58.0, "DiInMetres": 5900, "DjInMetres": 5900,
}  # fmt: skip
GRIDS = {
    "lambert": LAMBERT,
    "stereographic": STEREOGRAPHIC,
    "rotated": ROTATED,
    "regular": REGULAR,
    "mercator": MERCATOR,
}


def settings(
    keys: dict[str, Any], edition: int, hour: float, along: bool, name: str, more: dict[str, Any]
) -> dict[str, Any]:
    """All keys of a message in an order in which eccodes takes them."""
    flags = {
        "iScansNegatively": 0,
        "jScansPositively": 1,
        "jPointsAreConsecutive": 0,
        "resolutionAndComponentFlags": 8 * along,
    }
    own = (
        keys
        | {k: keys.get(k, v) for k, v in flags.items()}
        | {"dataDate": 20240305, "dataTime": 100 * int(hour)}
    )
    if edition == 1:
        lacking = {"angleOfRotationInDegrees"} | (
            {"LaDInDegrees"} if keys["gridType"] != "mercator" else set()
        )
        own = {k: v for k, v in own.items() if k not in lacking} | {
            "indicatorOfTypeOfLevel": 1,
            "level": 0,
        }
    return own | ({"shortName": name} if name else {}) | more


def message(
    name: str,
    keys: dict[str, Any],
    values: Any = None,
    edition: int = 2,
    hour: float = 0.0,
    along: bool = False,
    **more: Any,
) -> bytes:
    """One field. values: of its points, in the file's order; None: the field of the writers, of the
    side of `name`.

    along: components count along the grid, whose x axis is taken from differences of eccodes' own
    points.
    """
    sample, all_keys = f"GRIB{edition}", settings(keys, edition, hour, along, name, more)
    if values is None:
        lon, lat = gribs.points(sample, all_keys)
        u, v = writers.field((lon + 180.0) % 360.0 - 180.0, lat, hour)
        if along:
            angle = np.radians(direction(lon.reshape(25, 36), lat.reshape(25, 36))).ravel()
            u, v = u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)
        values = (
            v if name in ("10v", "v", "ocv", "vst") or more.get("parameterNumber") in (3, 22) else u
        )
    return gribs.pack(sample, all_keys, values)


def direction(lon: Any, lat: Any) -> Any:
    """Direction of the grid's x axis [deg from east] at points (ny, nx): bearings to the neighbours
    on both sides.
    """
    ahead = 90.0 - SPHERE.inv(lon[:, :-1], lat[:, :-1], lon[:, 1:], lat[:, 1:])[0]
    back = 270.0 - SPHERE.inv(lon[:, 1:], lat[:, 1:], lon[:, :-1], lat[:, :-1])[0]
    at_start, at_end = ahead[:, :1], back[:, -1:]
    turn = (back[:, :-1] - ahead[:, 1:] + 180.0) % 360.0 - 180.0
    # at the ends the change of direction along half a cell is carried on
    return np.concatenate(
        (at_start - turn[:, :1] / 2, ahead[:, 1:] + turn / 2, at_end + turn[:, -1:] / 2), axis=1
    )


def written(path: Path, parts: Sequence[bytes]) -> Path:
    path.write_bytes(b"".join(parts))
    return path


def pair(keys: dict[str, Any], **options: Any) -> list[bytes]:
    return [message(name, keys, **options) for name in BOTH]


def worst(source: sources.Source, k: int = 0, hour: float = 0.0) -> tuple[float, float]:
    """The greatest error [m/s] of slice k against the field that was written, and the share of
    nodes present.
    """
    lon, lat = np.meshgrid(source.grid.lon, source.grid.lat)
    got = source.read(k).astype(float)
    u, v = writers.field((lon + 180.0) % 360.0 - 180.0, lat, hour)
    return float(np.nanmax(np.hypot(got[..., 0] - u, got[..., 1] - v))), float(
        np.isfinite(got[..., 0]).mean()
    )


def refusal(quantity: str, path: Any, **options: Any) -> str:
    with pytest.raises(UserError) as caught:
        sources.open_source(quantity, path, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


# --- grids, and vectors along them --------------------------------------------------------------------------------


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
    text = f"""
start = "2024-03-05T00:20Z"
duration = "5 h"
particles = 200
max_lost = 1.0
output.trajectories = 200
coast = {{ source = "none" }}
current = [{{ constant = {{ speed = "0.4 m/s", toward = 75 }} }}]
wind = [{{ files = "{written(tmp_path / "wind.grib", parts)}" }}]
uncertainty.wind = {{ std = "1.3 m/s", time = "7 h" }}
[[scenario]]
name = "raft"
object = "LIFE-RAFT-DB-11"
position = {{ at = [4.1, 58.9], error = "2 nmi" }}
"""
    (tmp_path / "raft.toml").write_text(text)
    base = drift.load(tmp_path / "raft.toml")
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


# --- what is chosen among many messages ---------------------------------------------------------------------------


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


LEVELS = {"typeOfFirstFixedSurface": 100, "scaleFactorOfFirstFixedSurface": 0}


def test_ten_metres_among_many_levels(tmp_path: Path) -> None:
    def at(metres: int, values: Any) -> list[bytes]:
        fixed = {
            "typeOfFirstFixedSurface": 103,
            "scaleFactorOfFirstFixedSurface": 0,
            "scaledValueOfFirstFixedSurface": metres,
        }
        return [
            message("", REGULAR, values, parameterCategory=2, parameterNumber=k, **fixed)
            for k in (2, 3)
        ]

    still = np.full(900, 25.0)
    upper = [
        message(n, REGULAR, still, **LEVELS, scaledValueOfFirstFixedSurface=p)
        for p in (50000, 85000)
        for n in "uv"
    ]
    ten = [message("", REGULAR, None, parameterCategory=2, parameterNumber=k, typeOfFirstFixedSurface=103,
                   scaleFactorOfFirstFixedSurface=0, scaledValueOfFirstFixedSurface=10) for k in (2, 3)]  # fmt: skip
    path = written(tmp_path / "a.grib", upper + at(80, still) + ten + at(100, still))
    source = sources.open_source("wind", path, steady=True)
    assert worst(source)[0] < 1e-5
    told = refusal("wind", written(tmp_path / "b.grib", upper), steady=True)
    assert "500, 850 hPa" in told
    assert "variables.isobaricInhPa" in told
    aloft = sources.open_source(
        "wind", tmp_path / "b.grib", steady=True, variables={"isobaricInhPa": "1"}
    )
    assert float(aloft.read(0)[3, 3, 0]) == pytest.approx(25.0)
    told = refusal("wind", written(tmp_path / "c.grib", at(80, still)), steady=True)
    assert "80 m" in told
    told = refusal("wind", written(tmp_path / "d.grib", ten[:1]), steady=True)
    assert "the northward one is missing" in told


def test_currents_and_stokes_drift(tmp_path: Path) -> None:
    """NCEP's currents, whose names eccodes does not know, ECMWF's, and Stokes drift, in both
    editions.
    """
    sea = {"discipline": 10, "parameterCategory": 1, "scaleFactorOfFirstFixedSurface": 0}
    for k, (kind, depth) in enumerate([(1, 0), (160, 0), (160, 3)]):
        fixed = {"typeOfFirstFixedSurface": kind, "scaledValueOfFirstFixedSurface": depth}
        parts = [message("", REGULAR, parameterNumber=n, **sea, **fixed) for n in (2, 3)]
        path = written(tmp_path / f"{k}.grib", parts)
        assert worst(sources.open_source("current", path, steady=True))[0] < 1e-5
    deep = {"typeOfFirstFixedSurface": 160, "scaledValueOfFirstFixedSurface": 200}
    both = parts + [
        message("", REGULAR, np.ones(900), parameterNumber=n, **sea, **deep) for n in (2, 3)
    ]
    path = written(tmp_path / "several.grib", both)
    assert worst(sources.open_source("current", path, steady=True))[0] < 1e-5
    assert float(
        sources.open_source("current", path, steady=True, depth=200.0).read(0)[3, 3, 0]
    ) == pytest.approx(1.0)
    path = written(tmp_path / "deep.grib", both[2:])
    assert "200 m" in refusal("current", path, steady=True)
    for names, quantity in ((("ocu", "ocv"), "current"), (("ust", "vst"), "stokes")):
        for edition in (1, 2):
            if names[0] == "ocu" and edition == 2:
                continue
            path = written(
                tmp_path / f"{names[0]}{edition}.grib",
                [message(n, REGULAR, edition=edition) for n in names],
            )
            assert worst(sources.open_source(quantity, path, steady=True))[0] < 2e-3


def test_missing_values(tmp_path: Path) -> None:
    lon, lat = np.meshgrid(2.2 + 0.1 * np.arange(36), 57.6 + 0.1 * np.arange(25))
    u, v = writers.field(lon, lat, 0.0)
    u[3:9, 5:7] = v[3:9, 5:7] = np.nan
    for edition in (1, 2):
        parts = [
            message(n, REGULAR, w.ravel(), edition=edition)
            for n, w in zip(BOTH, (u, v), strict=True)
        ]
        source = sources.open_source(
            "wind", written(tmp_path / f"{edition}.grib", parts), steady=True
        )
        np.testing.assert_array_equal(np.isnan(source.read(0)[..., 0]), np.isnan(u))
        np.testing.assert_allclose(source.read(0)[..., 1], v, atol=1e-5)


def test_members_of_an_ensemble_must_be_chosen(tmp_path: Path) -> None:
    parts = []
    for member in (1, 2, 3):
        own = {
            "productDefinitionTemplateNumber": 1,
            "perturbationNumber": member,
            "numberOfForecastsInEnsemble": 3,
        }
        fixed = {
            "typeOfFirstFixedSurface": 103,
            "scaleFactorOfFirstFixedSurface": 0,
            "scaledValueOfFirstFixedSurface": 10,
        }
        for k in (2, 3):
            parts.append(
                message(
                    "",
                    REGULAR,
                    np.full(900, member + k / 10),
                    **own,
                    parameterCategory=2,
                    parameterNumber=k,
                    **fixed,
                )
            )
    path = written(tmp_path / "a.grib", parts)
    assert "variables.member" in refusal("wind", path, steady=True)
    source = sources.open_source("wind", path, steady=True, variables={"member": "1"})
    assert float(source.read(0)[3, 3, 0]) == pytest.approx(2.2)
    lone = sources.open_source("wind", written(tmp_path / "b.grib", parts[2:4]), steady=True)
    assert any("10u_member2" in note for note in lone.notes)
    every = sources.open_source("wind", path, steady=True, members=True)
    assert [member.label for member in every.members] == ["1", "2", "3"]
    assert [float(member.read(0)[3, 3, 0]) for member in every.members] == pytest.approx(
        [1.2, 2.2, 3.2]
    )
    entries = [[str(written(tmp_path / f"{k}.grib", parts[2 * k : 2 * k + 2]))] for k in range(3)]
    apart = sources.open_source(
        "wind", [p for (p,) in entries], steady=True, members=True, entries=entries
    )
    assert [float(member.read(0)[3, 3, 1]) for member in apart.members] == pytest.approx(
        [1.3, 2.3, 3.3]
    )


def test_two_grids_of_one_wind_are_not_confused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.grib", pair(REGULAR) + pair(LAMBERT, along=True))
    assert "10u_grid1, 10u_grid2" in refusal("wind", path, steady=True)
    for k in (1, 2):
        source = sources.open_source(
            "wind", path, steady=True, variables={"east": f"10u_grid{k}", "north": f"10v_grid{k}"}
        )
        assert worst(source)[0] < 2 * writers.tolerance(CELL)
    mixed = written(tmp_path / "b.grib", [*pair(LAMBERT, along=True), *pair(LAMBERT, hour=3.0)])
    assert "along the grid in some messages" in refusal("wind", mixed)


def test_one_time_given_twice(tmp_path: Path) -> None:
    once = pair(REGULAR)
    assert (
        worst(sources.open_source("wind", written(tmp_path / "a.grib", once + once), steady=True))[
            0
        ]
        < 1e-5
    )
    told = refusal(
        "wind",
        written(tmp_path / "b.grib", [*once, message("10u", REGULAR, np.ones(900))]),
        steady=True,
    )
    assert "twice" in told
    assert "messages 1 and 3" in told


def test_several_fields_of_one_message(tmp_path: Path) -> None:
    """NCEP puts u and v into one message that share grid and bitmap: sections 4 to 7 are repeated."""
    u, v = writers.field(*np.meshgrid(2.2 + 0.1 * np.arange(36), 57.6 + 0.1 * np.arange(25)), 0.0)
    u[2, 3] = v[2, 3] = np.nan
    one, two = (message(n, REGULAR, w.ravel()) for n, w in zip(BOTH, (u, v), strict=True))

    def sections(raw: bytes) -> dict[int, bytes]:
        at, found = 16, {}
        while raw[at : at + 4] != b"7777":
            size = int.from_bytes(raw[at : at + 4], "big")
            found[raw[at + 4]] = raw[at : at + size]
            at += size
        return found

    a, b = sections(one), sections(two)
    again = b"\0\0\0\x06\x06\xfe"  # the bitmap of the field before
    body = b"".join([*(a[k] for k in sorted(a)), b[4], b[5], again, b[7], b"7777"])
    joined = one[:8] + (16 + len(body)).to_bytes(8, "big") + body
    source = sources.open_source("wind", written(tmp_path / "a.grib", [joined]), steady=True)
    np.testing.assert_allclose(source.read(0)[..., 0], u, atol=1e-5)
    np.testing.assert_allclose(source.read(0)[..., 1], v, atol=1e-5)


@pytest.mark.thorough
def test_nothing_is_written_beside_a_file_and_nothing_is_imported_here(tmp_path: Path) -> None:
    written(tmp_path / "a.grib", pair(REGULAR))
    code = "import sys; from geo.forcing import sources; s = sources.open_source('wind', sys.argv[1], steady=True); s.read(0); print('eccodes' in sys.modules)"
    told = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "a.grib")],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert told.stdout.strip() == "False", told.stderr
    assert told.stderr == ""
    assert [p.name for p in tmp_path.iterdir()] == ["a.grib"]


# --- damage -------------------------------------------------------------------------------------------------------


def test_truncated_files(tmp_path: Path) -> None:
    for edition in (1, 2):
        whole = b"".join(pair(REGULAR, edition=edition))
        for length in (5, 40, 150, len(whole) // 2 - 3, len(whole) // 2 + 60, len(whole) - 1):
            told = refusal("wind", written(tmp_path / "cut.grib", [whole[:length]]), steady=True)
            assert "cut.grib" in told
            assert "damaged" in told
            assert "[[wind]] files" in told


def test_bytes_between_messages(tmp_path: Path) -> None:
    one, two = pair(REGULAR)
    heading = b"\r\r\nUXUK98 EGRR 050000\r\r\n"
    path = written(tmp_path / "a.grib", [heading, one, b"\r\n", heading, two, bytes(300)])
    assert worst(sources.open_source("wind", path, steady=True))[0] < 1e-5
    late = written(
        tmp_path / "late.grib", [bytes(9000), one]
    )  # no other backend of xarray's is asked, cfgrib above all
    assert "unknown format" in refusal("wind", late, steady=True)
    assert not list(tmp_path.glob("*.idx"))
    # a message whose first bytes are damaged
    lost = written(tmp_path / "b.grib", [one, b"grib" + two[4:], one])
    assert "belong to no message" in refusal("wind", lost, steady=True)


def outcome(path: Path, quantity: str = "wind") -> str:
    """What reading all of a file comes to: "read", or one line that names it or the key that does."""
    try:
        source = sources.open_source(quantity, path, lenient=True)
        for k in range(max(1, len(source.times))):
            source.read(k)
    except UserError as error:
        one = "\n" not in str(error) and (
            path.name in str(error) or f"[[{quantity}]]" in str(error)
        )
        return "refused" if one else f"refused badly: {error}"
    return "read"


def test_damaged_bytes_never_end_the_process(tmp_path: Path) -> None:
    """A slice of what benchmarks do at length: any bytes changed, wherever they stand."""
    random = np.random.default_rng(7)
    files = [b"".join(pair(LAMBERT, along=True)), b"".join(pair(REGULAR, edition=1))]
    seen = set()
    for k in range(20):
        damaged = bytearray(files[k % 2])
        for at in random.integers(0, len(damaged) if k % 4 < 2 else 250, 4):
            damaged[at] = random.integers(256)
        seen.add(outcome(written(tmp_path / f"{k}.grib", [bytes(damaged)])))
    assert seen == {"read", "refused"}


@pytest.mark.thorough
def test_a_library_that_crashes_or_hangs_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path / "a.grib", pair(REGULAR))
    raw = messages.whole(messages.split_messages(str(path))[0])
    first = decoder._running().process
    first.kill()
    first.wait()
    # a helper that went away between two questions is started again
    assert decoder.values(raw).size == 900
    assert decoder._running().process.pid != first.pid

    os.kill(decoder._running().process.pid, 19)  # stopped: it will never answer
    monkeypatch.setattr(decoder, "LIMIT", 0.3)
    with pytest.raises(decoder.DecodeError, match="did not answer within"):
        decoder.values(raw)
    monkeypatch.undo()

    helper = decoder._running().process
    os.kill(helper.pid, 19)
    killer = threading.Timer(0.3, helper.kill)
    killer.start()
    with pytest.raises(decoder.DecodeError, match=r"the GRIB library crashed \(SIGKILL\)"):
        decoder.values(raw)
    killer.join()
    assert decoder.values(raw).size == 900


@pytest.mark.thorough
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("size", [100, 2**20])  # the second is more than fits into a pipe
def test_closing_forcing_does_not_wait_for_a_library_that_hangs(size: int, tmp_path: Path) -> None:
    raw = pair(REGULAR)[0]
    stopped = decoder._running()
    os.kill(stopped.process.pid, signal.SIGSTOP)
    still = replace(
        sources.constant_field("wind", 7.0, -3.0), read=lambda i: decoder.values(bytes(size))
    )
    winds = engine.Forcing([engine.Sources({"wind": (still,)})], 1)
    reading = winds._slices[0][0]._request(0)
    time.sleep(0.5)
    assert reading.running()
    watch = Watch()
    winds.close()
    assert watch.seconds() < 2
    assert isinstance(reading.exception(), waiting.WaitInterrupted)
    assert stopped.process.returncode == -signal.SIGKILL
    assert decoder.values(raw).size == 900  # another one is started


@pytest.mark.thorough
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("name", ["SIGINT", "SIGKILL"])
def test_a_signal_ends_a_wait_for_a_library_that_hangs(name: str, tmp_path: Path) -> None:
    """Within two seconds, and the process that hangs soon after ours, even where that is killed."""
    path = written(tmp_path / "a.grib", pair(REGULAR))
    os.mkfifo(tmp_path / "held")  # open in the process that hangs, for as long as that lives
    hanging = f"lambda *_: (os.write(os.open({str(tmp_path / 'held')!r}, os.O_WRONLY), b'asked'), time.sleep(600))"
    start = f"import os, time; from geo.files import decoder; decoder._answer = {hanging}; decoder.serve()"
    code = (
        "import sys; from drift.apps.cli.commands import main; from geo.files import decoder; "
        f"decoder.START = {start!r}; sys.exit(main(['info', sys.argv[1]]))"
    )
    held = os.open(tmp_path / "held", os.O_RDONLY | os.O_NONBLOCK)
    ours = subprocess.Popen(
        [sys.executable, "-c", code, str(path)], stderr=subprocess.PIPE, text=True
    )
    try:
        assert select.select([held], [], [], 60)[0]
        assert os.read(held, 5) == b"asked"
        watch = Watch()
        ours.send_signal(getattr(signal, name))
        _, told = ours.communicate(timeout=30)
        assert watch.seconds() < 2
        assert select.select([held], [], [], FAREWELL + 10)[0]
        assert os.read(held, 1) == b""
    finally:
        ours.kill()
        os.close(held)
    if name == "SIGINT":
        assert ours.returncode == 130
        assert told.strip().splitlines()[-1].startswith("drift: interrupted")


@pytest.mark.skipif(os.name != "posix", reason="limits of POSIX")
def test_limits_hold_under_a_limit_of_the_system() -> None:
    """A soft limit cannot be more than a finite hard one, which once left the process without any."""
    code = (
        "import resource as r; from geo.files.child import limit; most = 2**40\n"
        "r.setrlimit(r.RLIMIT_AS, (most, most)); r.setrlimit(r.RLIMIT_FSIZE, (2**20, 2**20))\n"
        "limit(RLIMIT_AS=2**33, RLIMIT_FSIZE=2**30, RLIMIT_NONE=1)\n"
        "print([r.getrlimit(n)[0] for n in (r.RLIMIT_AS, r.RLIMIT_FSIZE, r.RLIMIT_CORE)])"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert told.stdout.strip() == str([2**33, 2**20, 0]), told.stderr


# --- real files ---------------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize("edition", [1, 2])
def test_averages_stand_at_the_middle_of_their_steps(edition: int, tmp_path: Path) -> None:
    more: dict[str, Any] = {"stepUnits": 1}
    if edition == 2:
        more |= {"productDefinitionTemplateNumber": 8, "typeOfStatisticalProcessing": 0}
    parts = []
    for begin in (0, 6, 12):  # the mean of a field that is linear in time is that of the middle
        steps = (
            {"timeRangeIndicator": 3, "P1": begin, "P2": begin + 6}
            if edition == 1
            else {"stepRange": f"{begin}-{begin + 6}"}
        )
        for side, name in enumerate(BOTH):
            lon, lat = gribs.points(
                f"GRIB{edition}", settings(REGULAR, edition, 0.0, False, name, {})
            )
            values = writers.field((lon + 180.0) % 360.0 - 180.0, lat, begin + 3.0)[side]
            keys = (
                {"shortName": name} if edition == 1 else WIND_AT_10 | {"parameterNumber": 2 + side}
            )
            parts.append(
                gribs.pack(
                    f"GRIB{edition}",
                    settings(REGULAR, edition, 0.0, False, "", more | keys | steps),
                    values,
                )
            )
    source = sources.open_source("wind", written(tmp_path / "a.grib", parts))
    start = np.datetime64("2024-03-05T00:00:00", "s")
    assert [int((t - start) / np.timedelta64(1, "h")) for t in source.times] == [0, 3, 9, 15, 18]
    for k, hour in ((1, 3.0), (2, 9.0), (3, 15.0)):
        assert worst(source, k, hour)[0] < 2e-3
    assert any("means over 6 h" in note for note in source.notes)


WIND_AT_10 = {
    "discipline": 0, "parameterCategory": 2, "typeOfFirstFixedSurface": 103, "scaleFactorOfFirstFixedSurface": 0,
    "scaledValueOfFirstFixedSurface": 10,
}  # fmt: skip
