"""Longitudes and latitudes are known by their units before their names, whatever the order of
dimensions.
"""

from pathlib import Path
from typing import Any

import linear
import numpy as np
import pytest
import xarray as xr

from geo.errors import UserError
from geo.forcing import sources

HOURS = [0.0, 3.0]
EAST, NORTH = {"units": "degrees_east"}, {"units": "degrees_north"}
NEAR = 1e-6


def swapped(more: Any = None) -> xr.Dataset:
    """Return a field whose longitudes are called lat, and its latitudes lon; more: attributes of
    both.
    """
    extra = more or ({}, {})
    data = linear.dataset(HOURS).rename(lon="lat", lat="lon")
    data["lat"].attrs, data["lon"].attrs = EAST | extra[0], NORTH | extra[1]
    return data


@pytest.mark.parametrize(
    "dims", [("time", "lon", "lat"), ("time", "lat", "lon"), ("lat", "time", "lon")]
)
@pytest.mark.parametrize(
    "more", [None, ({"standard_name": "longitude"}, {"standard_name": "latitude"})]
)
def test_units_count_more_than_names(dims: Any, more: Any, tmp_path: Path) -> None:
    path = linear.written(tmp_path / "a.nc", swapped(more).transpose(*dims))
    assert linear.worst(sources.open_source("current", path)) < NEAR


def test_square_fields_are_not_transposed(tmp_path: Path) -> None:
    """As many columns as rows, and values that both could have: only units tell them apart."""
    data = linear.dataset(HOURS, lon=np.linspace(-33.0, -25.0, 17), lat=np.linspace(38.0, 42.0, 17))
    data = data.rename(lon="lat", lat="lon")
    data["lat"].attrs, data["lon"].attrs = EAST, NORTH
    assert (
        linear.worst(sources.open_source("current", linear.written(tmp_path / "a.nc", data))) < NEAR
    )
    data = data.transpose("time", "lat", "lon")
    assert (
        linear.worst(sources.open_source("current", linear.written(tmp_path / "b.nc", data))) < NEAR
    )


def test_curved_and_unstructured_coordinates_too(tmp_path: Path) -> None:
    data = linear.dataset(HOURS).rename(lon="x", lat="y").drop_vars(["x", "y"])
    x, y = np.meshgrid(linear.LON, linear.LAT)
    u, v = linear.field(x + 0.02 * (y - 40), y, np.array(HOURS)[:, None, None])
    curved = data.assign(
        uo=data.uo.copy(data=u), vo=data.vo.copy(data=v),
        lat=(("y", "x"), x + 0.02 * (y - 40), EAST), lon=(("y", "x"), y, NORTH),
    )  # fmt: skip
    assert (
        linear.worst(sources.open_source("current", linear.written(tmp_path / "a.nc", curved)))
        < 1e-4
    )
    points = curved.stack(node=("y", "x")).reset_index("node").drop_vars(["x", "y"])
    assert (
        linear.worst(sources.open_source("current", linear.written(tmp_path / "b.nc", points)))
        < 1e-4
    )  # edges are great circles


def test_dimensions_whose_names_say_nothing(tmp_path: Path) -> None:
    for k, dims in enumerate((("time", "a", "b"), ("time", "b", "a"))):
        held = linear.dataset(HOURS)
        data = xr.Dataset(
            {
                "uo": (("time", "a", "b"), held.uo.values, held.uo.attrs),
                "vo": (("time", "a", "b"), held.vo.values, held.vo.attrs),
                "lon": ("b", linear.LON, EAST),
                "lat": ("a", linear.LAT, NORTH),
                "time": held.time,
            }
        ).transpose(*dims)
        assert (
            linear.worst(sources.open_source("current", linear.written(tmp_path / f"{k}.nc", data)))
            < NEAR
        )


def test_units_against_standard_names_are_refused_with_a_key_that_works(tmp_path: Path) -> None:
    data = swapped(({"standard_name": "latitude"}, {"standard_name": "longitude"}))
    for k, dims in enumerate((("time", "lon", "lat"), ("time", "lat", "lon"))):
        path = linear.written(tmp_path / f"{k}.nc", data.transpose(*dims))
        with pytest.raises(
            UserError, match=r"units of a (longitude|latitude).*variables = \{ lon = "
        ):
            sources.open_source("current", path)
        source = sources.open_source("current", path, variables={"lon": "lat", "lat": "lon"})
        assert linear.worst(source) < NEAR


@pytest.mark.parametrize("chosen", [{"lon": "lat"}, {"lat": "lon"}])
def test_axes_that_the_case_takes_for_the_wrong_ones(chosen: Any, tmp_path: Path) -> None:
    path = linear.written(tmp_path / "a.nc", linear.dataset(HOURS))
    with pytest.raises(UserError, match=r"are not the columns and rows.*variables = \{ lon"):
        sources.open_source("current", path, variables=chosen)
    assert (
        linear.worst(sources.open_source("current", path, variables={"lon": "lon", "lat": "lat"}))
        < NEAR
    )
