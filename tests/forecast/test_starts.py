"""Where a forecast begins, for its charts: positions are marks, areas and tracklines lines without
a jump at 180 degrees.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drift.engine.motion.scenario import AreaPrior, PositionPrior, TracklinePrior
from drift.forecast.starts import prior_marks

BEGIN = np.datetime64("2026-11-21T18:30")


def scenario(name: str, prior: Any) -> Any:
    return SimpleNamespace(name=name, prior=prior)


def test_marks_and_lines() -> None:
    position = PositionPrior(
        np.radians(-87.5), np.radians(28.7), 900.0, 400.0, 0.3, None, BEGIN, BEGIN
    )
    lon, lat = np.radians([179.2, -179.6, -179.9]), np.radians([-17.1, -17.4, -18.2])
    area = AreaPrior(tuple(lon), tuple(lat), BEGIN, BEGIN)
    way = TracklinePrior(
        tuple(lon[:2]), tuple(lat[:2]), 1500.0, BEGIN, BEGIN, 5.0, 0.0, 1.0, None, BEGIN, BEGIN
    )
    (alone,), none = prior_marks([scenario("one", position)], "Last known position", "LKP")
    assert (alone.lon, alone.lat, alone.label, none) == (
        pytest.approx(-87.5),
        pytest.approx(28.7),
        "Last known position",
        [],
    )
    (mark,), lines = prior_marks(
        [scenario("one", position), scenario("two", area), scenario("three", way)], "Start", "LKP"
    )
    assert mark.label == "LKP, one"
    assert [(line.label, line.closed) for line in lines] == [("two", True), ("three", False)]
    np.testing.assert_allclose(lines[0].lon, [179.2, 180.4, 180.1], atol=1e-9)
    np.testing.assert_allclose(lines[1].lat, [-17.1, -17.4], atol=1e-9)
