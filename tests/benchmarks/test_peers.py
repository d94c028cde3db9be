"""The comparison with other programs: when it is void, and what its triangles hold."""

import math
from pathlib import Path

import numpy as np
import peers
import pytest
import xarray as xr


def rows(north: float) -> dict[str, dict[str, tuple[float, float]]]:
    """Return figures in which Parcels' particles drift 30 km east and so many km north."""
    return {
        "drift, passive": {"drift_km": (30.0, 40.0)},
        "Parcels, passive": {"drift_km": (30.0, north)},
    }


# 1 % of 50 km, and 3 * 20 km * sqrt(2 / 80,000)
@pytest.mark.parametrize(("apart", "valid"), [(0.79, True), (0.81, False), (-0.81, False)])
def test_programs_that_drift_elsewhere_make_it_void(apart: float, valid: bool) -> None:
    """The limit is 0.5 + 0.3 km."""
    found = rows(40 + apart)
    assert peers.check(found, 80_000) is valid
    assert found["Parcels, passive"]["from_ours_km"] == pytest.approx(abs(apart))
    assert found["drift, passive"]["from_ours_km"] == 0


def test_euler_steps_lag_by_half_a_step() -> None:
    """At a change of 1 m/s in steps of 600 s: 0.3 km more than of a Runge-Kutta scheme."""
    euler, other = (peers.PROGRAMS[f"{name}, rafts"] for name in ("OpenDrift", "drift"))
    more = peers.tolerance(euler, 50, 1000) - peers.tolerance(other, 50, 1000)
    assert more == pytest.approx(0.3)


def test_the_triangles_cover_the_grid_with_its_own_currents(tmp_path: Path) -> None:
    """Their areas add up to the grid's, all turn one way, and a node has its cell's current."""
    peers.write_sea(tmp_path, hours=2, spacing=1.5, triangles=True)
    with (
        xr.open_dataset(tmp_path / "cur.nc") as grid,
        xr.open_dataset(tmp_path / "triangles.nc") as cut,
    ):
        place = np.stack([cut["SCHISM_hgrid_node_x"], cut["SCHISM_hgrid_node_y"]], axis=-1)
        one, two, three = np.moveaxis(place[cut["SCHISM_hgrid_face_nodes"].values - 1], 1, 0)
        (east, north), (far_east, far_north) = (two - one).T, (three - one).T
        areas = (east * far_north - north * far_east) / 2
        assert (areas > 0).all()
        width, height = (np.ptp(grid[name].values) for name in ("lon", "lat"))
        assert math.isclose(areas.sum(), width * height)
        k = 17
        there = grid.sel(lon=place[k, 0], lat=place[k, 1], method="nearest")
        assert cut["dahv"].values[2, k].tolist() == [there["uo"].values[2], there["vo"].values[2]]
