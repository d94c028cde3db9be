"""GeoTIFFs of a small map across the antimeridian, read by rasterio: each cell lies where it was."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from drift.apps.export import raster
from drift.apps.export.finished import Finished

rasterio = pytest.importorskip("rasterio", reason="pip install -e '.[geotiff]'")
pytestmark = pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")  # of affine
WIDE, HIGH = 0.25, 0.125  # [deg] of a cell, exact in binary
WEST, SOUTH = 179.5, -41.0
SHAPE = (2, 3, 5)  # times, rows, columns: two columns lie west of 180 degrees, three east of it


def run(west: float = WEST) -> Finished:
    """Return a run of two outputs whose cells all have other values."""
    edges = {
        "lon": west + WIDE * np.arange(SHAPE[2] + 1),
        "lat": SOUTH + HIGH * np.arange(SHAPE[1] + 1),
    }
    values = np.arange(1, 1 + np.prod(SHAPE)).reshape(SHAPE) / 1024.0
    dims = ("time", "lat", "lon")
    forecast = xr.Dataset(
        {
            "probability": (dims, values),
            "containment": (dims, 1 - values),
            **{
                f"{name}_bnds": ((name, "bnds"), np.stack([edge[:-1], edge[1:]], axis=1))
                for name, edge in edges.items()
            },
        },
        {
            "time": np.array(["2026-06-01T20:00", "2026-06-02T00:00:30"], "datetime64[ns]"),
            **{name: (edge[:-1] + edge[1:]) / 2 for name, edge in edges.items()},
        },
        {"title": "Raft", "run_id": "abc-s1"},
    )
    return Finished(Path("raft"), frozenset(), forecast)


def sample(content: bytes, lon: float, lat: float) -> tuple[float, ...]:
    """Return the values of both bands at a place."""
    with rasterio.io.MemoryFile(content) as memory, memory.open() as file:
        return tuple(next(file.sample([(lon, lat)])))


def test_both_sides_of_180_hold_their_own_cells() -> None:
    """Within -180 to 180 degrees, north up, to the edges of the cells."""
    finished = run()
    made = raster.files(finished)
    stamps = ("20260601T2000Z", "20260602T000030Z")
    assert set(made) == {f"probability-{stamp}-{side}.tif" for stamp in stamps for side in "EW"}
    bounds = {"E": (179.5, 180.0), "W": (-180.0, -179.25)}
    for k, stamp in enumerate(stamps):
        for side, (west, east) in bounds.items():
            content = made[f"probability-{stamp}-{side}.tif"]
            with rasterio.io.MemoryFile(content) as memory, memory.open() as file:
                assert tuple(file.bounds) == (west, SOUTH, east, SOUTH + 3 * HIGH)
                assert file.transform.e < 0 < file.transform.a  # north up
                assert file.tags()["run_id"] == "abc-s1"
        for column, lon in enumerate((179.625, 179.875, -179.875, -179.625, -179.375)):
            content = made[f"probability-{stamp}-{'E' if lon > 0 else 'W'}.tif"]
            for row in range(SHAPE[1]):
                value = (1 + column + 5 * row + 15 * k) / 1024
                place = lon, SOUTH + (row + 0.5) * HIGH
                assert sample(content, *place) == (value, 1 - value)


@pytest.mark.parametrize("west", [12.25, 372.25, -347.75])
def test_a_map_on_one_side_is_one_file(west: float) -> None:
    """Whole turns are taken off."""
    made = raster.files(run(west))
    assert list(made) == ["probability-20260601T2000Z.tif", "probability-20260602T000030Z.tif"]
    with rasterio.io.MemoryFile(next(iter(made.values()))) as memory, memory.open() as file:
        assert tuple(file.bounds) == (12.25, SOUTH, 13.5, SOUTH + 3 * HIGH)
