"""Lives of particles as columns tell them, against one particle after the other in plain Python."""

import numpy as np

from drift.engine.particles import life
from drift.engine.particles.life import Lives
from drift.engine.particles.status import Status

BEGIN, END = 3600, 7200  # [s] of the step that has been made
ENDS = (Status.ASHORE, Status.OUTSIDE, Status.LEFT, Status.SUNK)
RNG = np.random.default_rng(20)


def lives(n: int) -> Lives:
    """Return lives that could be: what waits is released later; what ends does so after it was
    released or refloated.
    """
    status = RNG.choice([Status.ADRIFT, Status.PENDING, *ENDS], n)
    release = np.where(status == Status.PENDING, END + 1, RNG.integers(0, END, n))
    moving = np.where(RNG.random(n) < 0.5, np.maximum(release, RNG.integers(0, END, n)), 0)
    since = np.maximum(np.maximum(release, moving), RNG.integers(0, END + 1, n))
    return Lives(*(values.astype(np.int32) for values in (status, release, since, moving)))


def one_at(status: int, release: int, since: int, moving: int, time: int) -> int:
    """Return what a particle is at a time within the step."""
    if time < release:
        return Status.PENDING
    if status in ENDS and time >= since:
        return status
    # before it refloated it lay on the beach
    return Status.ASHORE if time < moving else Status.ADRIFT


def one_way(status: int, release: int, since: int, moving: int) -> tuple[int, int]:
    """Return when a particle begins to move in the step, and when it ends."""
    finish = min(since, END) if status != Status.ADRIFT else END
    began = [BEGIN, release] + ([moving] if moving < finish else [])
    return max(began), finish


def test_status_within_the_step() -> None:
    some = lives(4000)
    rows = list(
        zip(
            *(column.tolist() for column in (some.status, some.release, some.since, some.moving)),
            strict=True,
        )
    )
    for time in (BEGIN, 4000, 5400, END - 1, END):
        assert some.at(time).tolist() == [one_at(*row, time) for row in rows]
        assert some.at(time).dtype == np.int32


def test_the_part_of_the_step_in_which_a_particle_moves() -> None:
    some = lives(4000)
    rows = list(
        zip(
            *(column.tolist() for column in (some.status, some.release, some.since, some.moving)),
            strict=True,
        )
    )
    assert list(zip(*(x.tolist() for x in some.way(BEGIN, END)), strict=True)) == [
        one_way(*row) for row in rows
    ]


def test_what_is_over() -> None:
    stopped = (Status.ARRIVED, Status.AGROUND)
    assert life.has_stopped(np.arange(len(Status))).tolist() == [
        status in (*ENDS, *stopped) for status in Status
    ]


def test_status_of_what_steers_first() -> None:
    """Pending until it departs, under way until its distress unless it ends before, then as all
    that drifts.
    """
    n = 4000
    departure, release = RNG.integers(0, END, n), RNG.integers(0, 2 * END, n)
    release = np.maximum(release, departure + 1)
    drifts = release < END
    choice = RNG.choice([Status.UNDER_WAY, Status.ARRIVED, Status.AGROUND, Status.LEFT], n)
    status = np.where(drifts, RNG.choice([Status.ADRIFT, *ENDS], n), choice)
    since = np.where(
        drifts,
        RNG.integers(release, np.maximum(release, END) + 1),
        RNG.integers(departure, END + 1),
    )
    moving = np.zeros(n, np.int64)
    some = Lives(
        *(values.astype(np.int32) for values in (status, release, since, moving, departure))
    )
    rows = list(zip(*(x.tolist() for x in (status, release, since, departure)), strict=True))
    for time in (BEGIN, 5000, END):
        expected = []
        for state, adrift_at, ended, left in rows:
            is_over = state not in (Status.ADRIFT, Status.UNDER_WAY) and time >= ended
            if time < left:
                expected.append(Status.PENDING)
            elif is_over:
                expected.append(state)
            else:
                expected.append(Status.UNDER_WAY if time < adrift_at else Status.ADRIFT)
        assert some.at(time).tolist() == expected
