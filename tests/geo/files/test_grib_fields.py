"""What is chosen among many messages of GRIB: levels, members, times and steps."""

from pathlib import Path
from typing import Any

import gribs
import numpy as np
import pytest
import writers
from grib_messages import (
    BOTH,
    CELL,
    LAMBERT,
    REGULAR,
    message,
    pair,
    refusal,
    settings,
    worst,
    written,
)

from geo.forcing import sources

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
