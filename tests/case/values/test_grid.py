"""A grid of the user's own: the same cells whatever drifts, what lies outside it, and what it is
too coarse or too fine for.
"""

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from drift.case.values.grid import GridTable
from drift.engine.particles.snapshot import Snapshot
from drift.forecast import build as forecast_build
from drift.forecast import off_grid
from geo import sphere
from geo.errors import UserError

TIME = np.datetime64("2026-11-21T18:30:00", "s")
N = 10_000
STD = np.array([4000.0, 9000.0])  # [m] east and north


def grid(**changed: Any) -> GridTable:
    return GridTable.model_validate(
        {"west": 3.4, "south": 59.9, "east": 5.1, "north": 60.8, "spacing": "0.5 km"} | changed
    )


def cloud(lon: float, lat: float, seed: int = 3, size: float = 1.0) -> Snapshot:
    """A bivariate normal about a place [deg]."""
    east, north = size * STD[:, None] * np.random.default_rng(seed).normal(size=(2, N))
    x, y = sphere.destination(np.radians(lon), np.radians(lat), east, north)
    none = np.zeros(N, np.int32)
    here = (sphere.to_binary(np.degrees(angle)) for angle in (x, y))
    return Snapshot(TIME, *here, np.full(N, 1 / N), none, none)


def made(table: GridTable, *snapshots: Snapshot) -> forecast_build.Forecast:
    return forecast_build.build_forecast(snapshots, scenarios=["only"], grid=table.cells())


def test_cells_are_where_they_were_asked_for() -> None:
    table = grid(spacing="0.02 deg")
    data = made(table, cloud(4.2, 60.3)).data
    # Cells are whole 16ths of binary angles: off by 8 units in 238,609, and so by 85 times as much
    # at the far end.
    unit = 360 / sphere.TURN
    assert data.lon.values == pytest.approx(
        3.4 + 0.02 * (np.arange(85) + 0.5), abs=85 * 8 * unit + unit
    )
    assert data.lat.values == pytest.approx(
        59.9 + 0.02 * (np.arange(45) + 0.5), abs=45 * 8 * unit + unit
    )


def test_runs_are_on_the_same_cells_and_can_be_subtracted() -> None:
    one, other = made(grid(), cloud(4.2, 60.3)).data, made(grid(), cloud(4.31, 60.22, 8, 0.3)).data
    assert one.lon.values.tolist() == other.lon.values.tolist()
    assert one.lat.values.tolist() == other.lat.values.tolist()
    change = (other["probability"] - one["probability"]).isel(time=0)
    assert change.shape == one["probability"].shape[1:]
    # float32 cells
    assert float(change.sum()) == pytest.approx(
        float(one.off_grid[0] - other.off_grid[0]), abs=1e-5
    )


@pytest.mark.parametrize("place", [(4.2, 60.3), (3.4, 60.37), (4.3, 60.8)])
def test_cells_hold_what_does_not_lie_outside(place: tuple[float, float]) -> None:
    """Against the law itself: the share of 10^6 draws outside the box, within 4 standard errors of
    N particles.

    Edges run through the middle of the cloud or far from it, where smoothing takes as much across
    as it brings.
    """
    table = grid()
    data = made(table, cloud(*place)).data.isel(time=0)
    east, north = STD[:, None] * np.random.default_rng(99).normal(size=(2, 10**6))
    lon, lat = np.degrees(
        sphere.destination(np.radians(place[0]), np.radians(place[1]), east, north)
    )
    cells = table.cells()
    unit = 360 / sphere.TURN
    x, y = (lon / unit - cells.lon0) / cells.width, (lat / unit - cells.lat0) / cells.height
    share = 1 - np.mean((x >= 0) & (x < cells.nlon) & (y >= 0) & (y < cells.nlat))
    assert float(data.off_grid) == pytest.approx(
        share, abs=4 * np.sqrt(share * (1 - share) / N) + 1e-4
    )
    assert float(data["probability"].astype(float).sum()) == pytest.approx(
        1 - float(data.off_grid), abs=1e-5
    )
    told = off_grid.fixed_grid_warnings(made(table, cloud(*place)).data)
    assert bool(told) == (share > off_grid.OFF)


@pytest.mark.parametrize("place", [(4.2, 60.3), (4.2, 60.75), (40.0, 10.0)])
def test_areas_count_what_lies_outside(place: tuple[float, float]) -> None:
    """2 pi sx sy ln(1 / (1 - p)), wherever the grid is; 4 standard errors of the sample's own
    quantile plus 1 %.
    """
    data = made(grid(), cloud(*place)).data.isel(time=0)
    exact = 2 * np.pi * STD.prod() * -np.log(1 - data["share"].values)
    assert data["containment_area"].values == pytest.approx(exact, rel=0.06)
    inside = (data["cell_area"] * (data["containment"] <= 0.5)).sum()
    # the area is on the grid: its cells make it up, but for those that its edge cuts
    if place == (4.2, 60.3):
        edge = 2 * np.sqrt(np.pi * exact[0] * 9 / 4) * 500
        assert float(inside) == pytest.approx(exact[0], abs=0.06 * exact[0] + edge / 2)
    if place[0] == 40.0:
        assert float(data.off_grid) == 1.0
        assert float(data["probability"].sum()) == 0.0


def test_a_grid_across_the_antimeridian_runs_on() -> None:
    table = grid(west=179.2, east=-179.1, south=-18.0, north=-17.0)
    for lon in (179.95, -179.95):
        data = made(table, cloud(lon, -17.5, size=0.5)).data.isel(time=0)
        assert (np.diff(data.lon.values) > 0).all()
        assert data.lon.values[0] == pytest.approx(179.2, abs=0.01)
        assert float(data["probability"].sum()) > 0.999
        mean = float((data["probability"] * data["lon"]).sum() / data["probability"].sum())
        assert mean == pytest.approx(
            lon % 360, abs=4 * 0.5 * STD[0] / np.sqrt(N) / 111_000 / 0.95 + 1e-3
        )


def test_a_grid_too_coarse_for_the_particles_says_so() -> None:
    # 16 by 36 m on cells of 500 m, of which maps are made on 16ths
    narrow = cloud(4.2, 60.3, size=0.004)
    told = off_grid.fixed_grid_warnings(made(grid(), cloud(4.2, 60.3), narrow).data)
    assert len(told) == 1
    assert "too coarse for the particles at 211830ZNOV26: areas are too large" in told[0]
    assert off_grid.fixed_grid_warnings(made(grid(), cloud(4.2, 60.3)).data) == []
    assert (
        off_grid.fixed_grid_warnings(
            forecast_build.build_forecast([narrow], scenarios=["only"]).data
        )
        == []
    )  # these cells follow it


def test_a_grid_too_fine_for_the_particles_is_refused() -> None:
    fine = grid(spacing="5 m", west=4.2, east=4.25, south=60.3, north=60.32)
    with pytest.raises(
        UserError,
        match=r"output\.grid: the particles are .* km across, .* make spacing .* times as large",
    ):
        made(fine, cloud(4.2, 60.3))


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"spacing": "30 nmi"}, "at least 8 each way"),
        ({"spacing": "50 m"}, r"makes .* cells; at most 1,000,000: make spacing .* times as large"),
        ({"south": 61}, "is not below north"),
        ({"north": 89.5}, "beyond 89 degrees"),
        ({"spacing": "0 deg"}, "must be above 0"),
        ({"spacing": "3 kn"}, "another kind"),
    ],
)
def test_grids_that_cannot_be_are_refused(changed: dict[str, Any], told: str) -> None:
    with pytest.raises(ValidationError, match=told):
        grid(**changed)


def test_cells_of_a_length_are_as_wide_as_high_at_the_middle_latitude():
    """1 nmi is 1/60 degree of the meridian, to 1 in 800 on our sphere, and 1/60/cos(61 degrees) of
    the parallel.
    """
    made = GridTable(west=-6.3, east=-4.1, south=60.0, north=62.0, spacing="1 nmi").cells()
    assert made.width / made.height == pytest.approx(1 / np.cos(np.radians(61.0)), rel=1e-3)
    assert made.height * 360 / 2**32 == pytest.approx(1852 / 6_371_008.8 * 180 / np.pi, rel=1e-3)
