"""What each unit moves probabilities and mean positions by, against differences that a unit's own
weight makes.
"""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from drift.assess.compare import figures
from drift.assess.compare.record import Contrast
from drift.assess.compare.units import SamplingUnits
from drift.engine.particles.snapshot import Snapshot
from drift.engine.particles.status import Status
from geo import sphere

N, MANY = 400, 60
RANDOM = np.random.default_rng(14)
ORIGIN = (-179.97, 57.3)  # [deg]
EAST, NORTH = RANDOM.normal(4e3, 9e3, N), RANDOM.normal(-3e3, 6e3, N)  # [m]
WEIGHT = RANDOM.exponential(1.0, N)
FAMILY, STATUS = RANDOM.integers(0, MANY, N), RANDOM.choice([0, 0, 0, 1, 3, 4, 5, 6], N)
UNITS = SamplingUnits(np.zeros(MANY, int), np.ones(MANY, bool), worlds=False)


def snapshot(more: np.ndarray) -> Snapshot:
    """Return particles across the antimeridian; more: by which each unit's log weight is larger."""
    lon = ORIGIN[0] + np.degrees(EAST / sphere.RADIUS) / np.cos(np.radians(ORIGIN[1]))
    lat = ORIGIN[1] + np.degrees(NORTH / sphere.RADIUS)
    binary = [
        np.round(((x + 180) % 360 - 180) * 2**32 / 360).astype(np.int64).astype(np.int32)
        for x in (lon, lat)
    ]
    weight = WEIGHT * np.exp(more)[FAMILY]
    return Snapshot(
        np.datetime64("2026-03-01"), *binary, weight / weight.sum(), STATUS.astype(np.int32),
        (FAMILY % 3).astype(np.int32), family=FAMILY,
    )  # fmt: skip


STEPS = 1e-4 * np.eye(MANY)


@pytest.mark.parametrize(
    ("path", "text", "names"),
    [
        ("sea/a.toml", "std = 1", ("as it is", "the same")),
        ("sea/b.toml", "std = 1", ("as it is", "the same")),
        ("sea/b.toml", "std = 2", ("a.toml", "b.toml")),
        ("gulf/a.toml", "std = 2", ("sea/a.toml", "gulf/a.toml")),
        ("sea/a.toml", "std = 1\n# --set seed = 9", ("as it is", "seed = 9")),
        ("sea/b.toml", "std = 2\n# --set seed = 9", ("a.toml", "b.toml, seed = 9")),
    ],
)
def test_cases_of_one_title_are_named_by_their_difference(
    path: str, text: str, names: tuple[str, str]
) -> None:
    cases = [
        SimpleNamespace(title="adrift", path=Path(one), text=words)
        for one, words in (("sea/a.toml", "std = 1"), (path, text))
    ]
    found = Contrast(*(SimpleNamespace(case=case) for case in cases), (), (), None, 600)
    assert found.names == names


def test_of_a_probability() -> None:
    """Central differences of 1e-4 err by 1e-8."""
    found = figures.status_shares(snapshot(np.zeros(MANY)), ("a", "b", "c"), UNITS)
    up, down = (
        [figures.status_shares(snapshot(sign * one), ("a", "b", "c"), UNITS) for one in STEPS]
        for sign in (1, -1)
    )
    p = WEIGHT / WEIGHT.sum()
    assert {name: found["status", name, "1"].value for name in ("adrift", "sunk")} == pytest.approx(
        {"adrift": p[STATUS == Status.ADRIFT].sum(), "sunk": p[STATUS == Status.SUNK].sum()}
    )
    assert found["scenario", "b", "1"].value == pytest.approx(p[FAMILY % 3 == 1].sum())
    for key, figure in found.items():
        moved = [(a[key].value - b[key].value) / 2e-4 for a, b in zip(up, down, strict=True)]
        np.testing.assert_allclose(figure.influence, moved, atol=1e-9)
    assert ("scenario", "a", "1") not in figures.status_shares(
        snapshot(np.zeros(MANY)), ("a",), UNITS
    )


def test_of_a_mean_position() -> None:
    """Of what is on the map alone; the plane about the origin differs from that about the mean, 5
    km off, by 5 km / R tan 57 degrees.
    """
    at = snapshot(np.zeros(MANY))
    found = figures.mean_position(at, UNITS, ORIGIN)
    up, down = (
        [figures.mean_position(snapshot(sign * one), UNITS, ORIGIN) for one in STEPS]
        for sign in (1, -1)
    )
    on_map = np.isin(STATUS, [Status.ADRIFT, Status.ASHORE, Status.UNDER_WAY])
    for key, offset in zip(found, (EAST, NORTH), strict=True):
        assert found[key].value == pytest.approx(
            np.average(offset, weights=WEIGHT * on_map), abs=20.0
        )
        moved = np.array(
            [(a[key].value - b[key].value) / 2e-4 for a, b in zip(up, down, strict=True)]
        )
        np.testing.assert_allclose(found[key].influence, moved, atol=4e-3 * np.abs(moved).max())
        assert np.abs(moved).max() > 100
    gone = replace(at, status=np.full(N, int(Status.SUNK), np.int32))
    assert all(
        np.isnan(figure.value) for figure in figures.mean_position(gone, UNITS, ORIGIN).values()
    )


def test_of_an_area() -> None:
    """A map of a normal law on the equator, where all is known: the edge of the share s has a
    density of (1 - s) / (2 pi S^2).

    A particle inside moves the area by (s - 1) / density, one outside by s / density, by its
    weight: that is the derivative of -2 pi S^2 log(1 - s) where a little of another law is mixed
    in.
    """
    wide, degree = 8e3, np.radians(sphere.RADIUS)
    axis = np.arange(-50, 51) * 700.0
    x, y = np.meshgrid(0.4 * 700 + axis, axis)
    density = np.exp(-(x**2 + y**2) / (2 * wide**2)) / (2 * np.pi * wide**2)
    share = np.array([0.5, 0.87])
    weight = WEIGHT * np.isin(STATUS, [Status.ADRIFT, Status.ASHORE, Status.UNDER_WAY])
    mapped = weight.sum() / WEIGHT.sum()  # the map holds that much
    data = xr.Dataset(
        {
            "probability": (("time", "lat", "lon"), mapped * density[None] * 700.0**2),
            "containment": (
                ("time", "lat", "lon"),
                1 - np.exp(-(x**2 + y**2) / (2 * wide**2))[None],
            ),
            "cell_area": (("lat", "lon"), np.full(x.shape, 700.0**2)),
            "containment_area": (("time", "share"), -2 * np.pi * wide**2 * np.log(1 - share)[None]),
        },
        {
            "time": [np.datetime64("2026-03-01", "ns")],
            "share": share,
            "lon": x[0] / degree,
            "lat": y[:, 0] / degree,
        },
    )
    random = np.random.default_rng(3)
    east, north = random.normal(0, wide, (2, N))
    at = [np.round(v / degree * 2**32 / 360).astype(np.int32) for v in (east, north)]
    given = replace(
        snapshot(np.zeros(MANY)), lon=at[0], lat=at[1], time=np.datetime64("2026-03-01")
    )
    found = figures.area_figures(given, SimpleNamespace(data=data), 0, UNITS)
    assert [key[:2] for key in found] == [("area", "50 %"), ("area", "87 %")]
    for s, figure in zip(share, found.values(), strict=True):
        edge = wide * np.sqrt(-2 * np.log(1 - s))
        sure = np.abs(np.hypot(east, north) - edge) > 60  # on the edge it is one or the other
        pull = (
            weight
            / weight.sum()
            * (s - (np.hypot(east, north) < edge))
            * 2
            * np.pi
            * wide**2
            / (1 - s)
        )
        expected, doubt = (
            np.bincount(FAMILY, values, MANY) for values in (pull, ~sure * weight / weight.sum())
        )
        assert figure.value == pytest.approx(-2 * np.pi * wide**2 * np.log(1 - s))
        known = doubt == 0
        assert known.sum() > MANY / 2
        np.testing.assert_allclose(
            figure.influence[known], expected[known], rtol=0.02, atol=0.02 * np.abs(expected).max()
        )
