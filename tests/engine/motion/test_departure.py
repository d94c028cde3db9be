"""A voyage whose beginning is uncertain in time and place, against draws in float64."""

import math
from pathlib import Path

import numpy as np
import pytest

import drift
from drift.case import file as case_file
from drift.engine.particles.status import Status
from geo.errors import UserError

N, M = 20_000, 1_000_000
CASE = """
title = "left some time, from about there"
start = "2026-03-05T00:00Z"
duration = "9 h"
particles = {n}
seed = 3
uncertainty = "none"
coast = {coast}
output.trajectories = {n}
output.times = ["+1 h", "+6 h"]
[[current]]
constant = {{ speed = "0 kn", toward = 90 }}
[[scenario]]
name = "yacht"
vessel = {{ land = "{land}" }}
[[scenario.phase]]
voyage = {{ waypoints = [[179.6, 0.1], [-179.4, 0.1], [-178.4, 0.1]], speed = "5 kn", departure = ["+0 h", "+2 h"], departure_error = "{error} nmi", cross_track = "3 nmi" }}
"""


def test_where_it_is_on_its_first_leg(tmp_path: Path) -> None:
    """A share s of the leg on, it lies s of the way from where it began to where it keeps off the
    second way point.
    """
    path = tmp_path / "case.toml"
    path.write_text(CASE.format(n=N, coast='{ source = "none" }', land="ignore", error=5))
    tracks = drift.run(case_file.load(path)).trajectories
    rng = np.random.default_rng(7)
    late = rng.uniform(0, 2, M)
    std = 5 / math.sqrt(
        2 * math.log(2)
    )  # half of a normal law in two dimensions lies within 1.1774 of its standard deviations
    begin, off = rng.normal(0, std, (2, M)), rng.normal(0, 3, M)
    mile = math.radians(1 / 60) * 6_371_008.8 / 1852  # [nmi] of an arc minute
    hours = [0, 1, 6, 9]
    for hour in (1, 6):
        k = hours.index(hour)
        away = late <= hour
        s = (5 * (hour - late) / (60 * mile))[away]
        x, y = 60 * mile * s + (1 - s) * begin[0][away], (1 - s) * begin[1][away] - s * off[away]
        there = tracks.status[:, k] == Status.UNDER_WAY
        share = away.mean()
        assert abs(there.mean() - share) <= 3 * math.sqrt(share * (1 - share) / N) + 1e-12
        lon = np.degrees(tracks.lon[there, k].astype(float) * 2 * math.pi / 2**32) % 360
        lat = np.degrees(tracks.lat[there, k].astype(float) * 2 * math.pi / 2**32)
        for found, truth in (((lon - 179.6) * 60 * mile, x), ((lat - 0.1) * 60 * mile, y)):
            n = there.sum()
            assert abs(found.mean() - truth.mean()) < 3 * truth.std() / math.sqrt(n) + 0.01
            fourth = ((truth - truth.mean()) ** 4).mean()
            assert (
                abs(found.var() - truth.var())
                < 3 * math.sqrt((fourth - truth.var() ** 2) / n) + 0.02
            )


def test_land_within_four_standard_deviations_of_it_is_refused(tmp_path: Path) -> None:
    """An islet 14 nmi off the first leg: 4 standard deviations of 3 nmi are 12, of an error of 5
    nmi 17.
    """
    y = 0.1 + 14 / 60
    ring = [[179.9, y], [179.92, y], [179.92, y + 0.02], [179.9, y + 0.02], [179.9, y]]
    (tmp_path / "islet.geojson").write_text(
        str({"type": "Polygon", "coordinates": [ring]}).replace("'", '"')
    )
    path = tmp_path / "case.toml"
    coast = '{ source = "islet.geojson" }'
    path.write_text(CASE.format(n=100, coast=coast, land="refuse", error=0))
    drift.run(case_file.load(path))
    path.write_text(CASE.format(n=100, coast=coast, land="refuse", error=5))
    with pytest.raises(UserError, match=r"leg 1, 3. nmi wide .* touches land"):
        drift.run(case_file.load(path))
