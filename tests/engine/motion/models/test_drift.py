"""The model of what drifts: the speeds that a run's box is drawn with, against the leeway law
itself.
"""

import itertools

import numpy as np
import pytest

from drift.engine.motion.models import drift as model
from drift.engine.motion.objects.leeway import Drifter, Line


@pytest.mark.parametrize(
    ("down", "cross"),
    [(0.031, 0.017), (0.012, 0.029), (0.02, 0.02)],
    ids=["down the wind", "across it", "both alike"],
)
@pytest.mark.parametrize("spreads", [0.0, 3.0, 7.0])
def test_no_particle_goes_faster_through_the_water(
    down: float, cross: float, spreads: float
) -> None:
    """Every corner of lines that many standard deviations out: downwind and crosswind speeds are at
    right angles.
    """
    lines = Line(down, 0.04, 0.05), Line(cross, 0.04, 0.05), Line(-cross, -0.04, 0.05)
    wind, speeds = 23.0, []
    for along, across in itertools.product((-spreads, spreads), repeat=2):
        for side in lines[1:]:
            ways = [
                (line.slope + xi * line.slope_std) * wind + line.offset + xi * line.offset_std
                for line, xi in ((lines[0], along), (side, across))
            ]
            speeds.append(np.hypot(*ways))
    fastest = model.fastest(Drifter("raft", "made up", *lines), wind, spreads)
    assert fastest >= max(speeds) * (1 - 1e-12)
    if down == cross:  # then it is the speed itself
        assert fastest == pytest.approx(max(speeds), rel=1e-12)


def test_the_usual_speed_is_that_of_the_steepest_line() -> None:
    lines = Line(0.011, 0.3), Line(0.007, 0.3), Line(-0.024, 0.3)
    assert model.usual(Drifter("raft", "made up", *lines), 25.0) == pytest.approx(0.6)
