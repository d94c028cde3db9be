"""Datum markers against closed forms of their way."""

from dataclasses import replace

import numpy as np
import pytest

from drift.engine.motion.forcing import Forcing, Sources
from drift.evidence.filter import markers
from drift.evidence.filter.markers import Marker
from geo import sphere
from geo.forcing import sources
from kernels.runtime import runtime

T0 = np.datetime64("2026-11-21T18:00:00", "s")
HOUR = 3600


@pytest.mark.parametrize("step", [1200, HOUR])
def test_a_marker_goes_by_the_integral_of_a_current_that_turns(step: int) -> None:
    """The current is linear from hour to hour: its integral is the trapezoids', at any step and
    inside it, and past 180 degrees.

    The marker's first step is cut.
    """
    runtime.start()
    east, north = np.array([0.5, -0.2, 0.9, 0.1, -0.7]), np.array([-0.3, 0.8, 0.25, -0.6, 0.4])
    hours = T0 + np.arange(5) * np.timedelta64(HOUR, "s")
    source = sources.uniform_field("current", hours, east, north)
    begin, end = 0.4 * HOUR, 4.0 * HOUR
    marker, field = Marker(179.99, 61.3, begin, 0), Forcing([Sources({"current": (source,)})], 1)
    start = int((T0 - np.datetime64(0, "s")) / np.timedelta64(1, "s"))
    for elapsed in range(0, int(end), step):
        field.set(start + elapsed, start + elapsed + step)
        marker.drift(field, elapsed, step)
    field.close()
    fine = np.linspace(begin, end, 10_001)
    u, v = (np.interp(fine, np.arange(5) * HOUR, one) for one in (east, north))
    way = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(fine))])
    y = np.radians(61.3) + way / sphere.RADIUS
    rate = u / (sphere.RADIUS * np.cos(y))
    x = np.radians(179.99) + np.concatenate(
        [[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(fine))]
    )
    lon, lat = marker.where(fine)
    off = np.hypot((lon - x) * np.cos(y), lat - y) * sphere.RADIUS
    # A binary angle is a centimetre, speeds are float32; the trapezoids of the oracle err by less.
    assert off[-1] < 0.02
    turn = np.hypot(np.diff(east), np.diff(north)).max() / HOUR
    assert off.max() < 0.02 + turn * markers.NODE**2 / 8  # the chord of a minute
    assert np.degrees(x[-1]) > 180


def test_a_marker_drifts_in_the_mean_of_the_members() -> None:
    """Three uniform currents: at the equator it goes by their mean."""
    runtime.start()
    flow = np.array([[0.5, 0.1], [-0.1, 0.2], [0.2, -0.9]])
    every = sources.combine_members(
        [
            replace(sources.constant_field("current", *own), label=str(k))
            for k, own in enumerate(flow)
        ]
    )
    marker, field = Marker(10.0, 0.0, 0.0, 0), Forcing([Sources({"current": (every,)})], 1)
    field.set(0, HOUR)
    marker.drift(field, 0, HOUR)
    field.close()
    lon, lat = marker.where(np.array([float(HOUR)]))
    assert np.array([lon[0] - np.radians(10.0), lat[0]]) * sphere.RADIUS == pytest.approx(
        flow.mean(0) * HOUR, abs=0.02
    )
