"""The period of a run against the calendar of the standard library."""

from datetime import datetime, timedelta

import numpy as np
import pytest

from drift.engine.motion.period import Period

START = datetime(2028, 2, 28, 21, 40, 7)  # before a leap day
LENGTH = timedelta(days=2, hours=3, minutes=11, seconds=29)


def of(direction: int) -> Period:
    return Period(
        np.datetime64(START, "s"), np.datetime64(START + direction * LENGTH, "s"), direction
    )


@pytest.mark.parametrize("direction", [1, -1])
def test_seconds_of_a_run_are_those_of_the_calendar(direction: int) -> None:
    """A run backward counts its seconds too from its start on, towards earlier times."""
    period = of(direction)
    assert period.epoch == (START - datetime(1970, 1, 1)).total_seconds()
    assert period.duration == LENGTH.total_seconds()
    assert period.span == tuple(
        np.datetime64(time, "s") for time in sorted((START, START + direction * LENGTH))
    )
    after = [timedelta(0), timedelta(hours=5, seconds=13), LENGTH, timedelta(days=-1, seconds=77)]
    times = [np.datetime64(START + direction * one, "s") for one in after]
    expected = [one.total_seconds() for one in after]
    assert [period.elapsed(time) for time in times] == expected
    assert period.seconds(times).tolist() == expected
    assert [period.time(int(one)) for one in expected] == times


def test_times_finer_and_coarser_than_seconds_are_understood() -> None:
    """A case that is varied in Python may hold minutes; files hold nanoseconds."""
    coarse = Period(
        np.datetime64("2028-02-28T21:40", "m"), np.datetime64("2028-02-29T21:40", "m"), 1
    )
    assert coarse.epoch == (datetime(2028, 2, 28, 21, 40) - datetime(1970, 1, 1)).total_seconds()
    assert coarse.duration == 86_400
    assert coarse.elapsed(np.datetime64("2028-02-28T22:40:30", "ns")) == 3630
    assert of(1).seconds([]).size == 0
