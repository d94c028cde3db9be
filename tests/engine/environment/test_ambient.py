"""Winds and currents on the host against fields that are linear in longitude, latitude and time,
which interpolation keeps.
"""

from dataclasses import replace

import numpy as np
import pytest

from drift.engine.environment import ambient, layers, report
from drift.engine.motion.forcing import Sources
from geo.box import Box
from geo.forcing import sources
from geo.forcing.sources import Source
from geo.grids.grid import Grid

START = np.datetime64("2026-03-01T00:00:00")
TIMES = START + np.arange(4) * np.timedelta64(3, "h")


def exact(lon, lat, hours, scale=1.0):
    """Return (east, north) of the field [m/s]; longitudes run on from 170."""
    return np.stack(
        [
            scale * (0.1 + 0.02 * (lon - 170) - 0.03 * lat + 0.01 * hours),
            0.3 - 0.05 * (lon - 170) + 0.004 * lat - 0.02 * hours,
        ],
        -1,
    )


def source(name, grid, missing=None, scale=1.0, times=TIMES):
    """Return a source of the field on a grid; missing: a function of the nodes' (lon, lat), where
    it has no value.
    """
    lon, lat = np.meshgrid(grid.lon, grid.lat)

    def read(index):
        hours = 3.0 * index
        values = exact(lon, lat, hours, scale).astype(np.float32)
        if missing is not None:
            values[missing(lon, lat)] = np.nan
        return values

    return Source("current", name, grid, times, read, 0.0, (), name)


GRID = Grid(172.0, -21.0, 0.5, 0.25, 33, 41)  # across 180, to 188 E


def test_a_linear_field_comes_back_across_180():
    """At nodes, between them, at times between slices, and at the very first and last."""
    rng = np.random.default_rng(3)
    lon, lat = rng.uniform(172, 188, 50), rng.uniform(-21, -11, 50)
    moments = np.array([0, 1, 4.5, 9]) * np.timedelta64(3600, "s").astype(float)
    times = START + moments.astype("timedelta64[s]")
    found = ambient.ambient_at(
        Sources({"current": (source("a", GRID),)}), "current", times, (lon + 180) % 360 - 180, lat
    )
    for k, hours in enumerate(moments / 3600):
        # float32 of values near 1
        np.testing.assert_allclose(found[k], exact(lon, lat, hours), atol=2e-6)


def test_nothing_beyond_its_box_and_times():
    one = Sources({"current": (source("a", GRID),)})
    outside = ambient.ambient_at(
        one, "current", TIMES[:1], np.array([171.0, 180.0]), np.array([-15.0, -10.0])
    )
    assert np.isnan(outside).all()
    late = ambient.ambient_at(
        one, "current", TIMES[-1:] + np.timedelta64(1, "h"), np.array([180.0]), np.array([-15.0])
    )
    assert np.isnan(late).all()


def test_the_first_with_a_value_counts_and_sums_need_all():
    west = source("fine", GRID, missing=lambda lon, lat: lon > 180)
    whole, more = (
        source("coarse", GRID, scale=3.0),
        source("tide", GRID, missing=lambda lon, lat: lat > -13, scale=0.5),
    )
    lon, lat = np.array([175.2, 186.3, 186.3]), np.array([-16.1, -16.1, -12.1])
    two = ambient.ambient_at(Sources({"current": (west, whole)}), "current", TIMES[1:2], lon, lat)[
        0
    ]
    np.testing.assert_allclose(two[0], exact(lon[0], lat[0], 3), atol=2e-6)
    np.testing.assert_allclose(two[1:], exact(lon[1:], lat[1:], 3, 3.0), atol=2e-6)
    added = frozenset({("current", "tide")})
    three = ambient.ambient_at(
        Sources({"current": (west, whole, more)}, added=added), "current", TIMES[1:2], lon, lat
    )[0]
    np.testing.assert_allclose(
        three[1], exact(lon[1], lat[1], 3, 3.0) + exact(lon[1], lat[1], 3, 0.5), atol=4e-6
    )
    assert np.isnan(three[2]).all()


@pytest.mark.parametrize(
    "box", [Box(170.0, -21.0, 190.0, -11.0), Box(4.0, 60.0, 4.2, 62.0), Box(0.0, 0.0, 0.0, 0.0)]
)
def test_places_are_spread_over_a_box(box):
    """Inside it, as many along its longer side as asked for, evenly in miles."""
    lon, lat = ambient.lattice(box, 10)
    assert (lon >= box.west).all()
    assert (lon <= box.east).all()
    assert (lat >= box.south).all()
    assert (lat <= box.north).all()
    assert max(len(np.unique(lon)), len(np.unique(lat))) in (
        (1,) if box.west == box.east else (9, 10)
    )


def test_what_flows_is_read_once_for_maps_and_report():
    """Every quantity that has sources, at the same places; of the wind a map shows a third of the
    rows and columns.
    """
    box = Box(178.0, -20.0, 184.0, -14.0)
    found = ambient.over(Sources({"current": (source("a", GRID),), "wind": ()}), box, TIMES)
    assert list(found) == ["current"]
    flow = found["current"]
    np.testing.assert_allclose(flow.velocity[1], exact(flow.lon, flow.lat, 3.0), atol=2e-6)
    some = layers._some(flow)
    rows, columns = (np.unique(place).size for place in (flow.lat, flow.lon))
    assert max(rows, columns) == ambient.ACROSS
    assert some.sum() == -(-(rows - 1) // 3) * -(-(columns - 1) // 3)
    assert layers._some(
        ambient.Flow(TIMES, flow.lon[:1], flow.lat[:1], flow.velocity[:, :1])
    ).tolist() == [True]
    (leaf,) = report.flows(found)
    assert (len(leaf["lon"]), leaf["shown"]) == (rows * columns, True)


def test_of_an_ensemble_the_mean_of_its_members() -> None:
    every = [
        sources.constant_field("current", east, north)
        for east, north in ((0.4, 0.0), (0.1, -0.3), (-0.2, 0.9))
    ]
    together = Sources(
        {
            "current": (
                sources.combine_members(
                    [replace(one, label=str(k)) for k, one in enumerate(every)]
                ),
            )
        }
    )
    told = ambient.ambient_at(
        together,
        "current",
        np.array(["2026-01-01"], "datetime64[s]"),
        np.array([3.0]),
        np.array([50.0]),
    )
    assert told[0, 0] == pytest.approx([0.1, 0.2])
