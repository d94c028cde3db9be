"""What a chart shows of ships that tow arrays."""

import numpy as np

from drift.planning.arrays import layers


def test_a_point_has_its_time_and_the_course_from_there_on():
    moment = np.datetime64("2026-06-01T13:12:00", "s")
    assert layers.label(moment, "turns, course 050") == "011312Z 050°"
    assert layers.label(moment, "ends") == "011312Z"
