"""The box that a case is opened for: what drifts from its priors stays inside, on the sphere, and it is no larger than need be."""

from pathlib import Path

import numpy as np
import pytest
from pyproj import Geod

import drift
from drift import start
from drift.motion import domain, leeway
from geo import sphere

EARTH = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
CASE = """
start = "2026-11-21T06:00Z"
duration = "{hours} h"
[[current]]
constant = {{ speed = "0.3 m/s", toward = 70 }}
[[wind]]
constant = {{ speed = "9 m/s", from = 200 }}
[[scenario]]
name = "boat"
object = "{object}"
position = {{ at = [{lon}, {lat}], std = "3 km" }}
"""


@pytest.mark.parametrize(("lon", "lat"), [(179.2, 63.0), (-12.0, -71.0), (3.0, 2.0)])
@pytest.mark.parametrize("name", ["water", "PERSON-POWERED-VESSEL-2"])
def test_the_reach_holds_what_drifts_as_fast_as_it_is_reckoned_with(
    tmp_path: Path, name: str, lon: float, lat: float
) -> None:
    """Currents of 2.5 m/s and winds of 25 m/s through the largest slope: geodesics of that length, all round, end in it.

    A box in longitude and latitude holds a cap; on the parallel nearest to the pole it is as wide as there, no wider.
    """
    hours = 30
    (tmp_path / "case.toml").write_text(CASE.format(lon=lon, lat=lat, object=name, hours=hours))
    case = drift.load(tmp_path / "case.toml")
    found = leeway.find(name)
    slope = max(abs(line.slope) for line in (found.down, found.right, found.left))
    far = (2.5 + 25 * slope) * hours * 3600
    box = domain.reach(start.ensemble_spec(case))
    azimuth = np.linspace(0, 360, 721)
    x, y, _ = EARTH.fwd(np.full(721, lon), np.full(721, lat), azimuth, np.full(721, far))
    assert ((x - box.west) % 360 <= box.east - box.west).all()
    assert (y >= box.south).all()
    assert (y <= box.north).all()
    spread = 5 * 3000.0
    tall = np.degrees(2 * (far + spread) / sphere.RADIUS)
    assert box.north - box.south == pytest.approx(tall, rel=1e-6)
    nearest = abs(lat) + tall / 2
    assert box.east - box.west == pytest.approx(tall / np.cos(np.radians(nearest)), rel=1e-6)
