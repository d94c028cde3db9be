"""The upper bound of plans against targets that steer: legs by hand, targets that stand still, and
the length of bins.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import plans
import pytest
from plans import HOUR, NMI

from drift.evidence.filter.records import Law
from drift.planning.search import (
    bins,
    bound,
    optimiser,
)
from drift.planning.search import planning_tracks as record
from drift.planning.search.planning_tracks import Tracks
from geo import sphere
from kernels.planning import sweeps


def placed(some: Tracks) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times [s] of tracks since they begin, and where particles are then [m]."""
    plane = record.plane(some)
    return some.time - some.time[0], *plane.flat(some.lon * sphere.UNIT, some.lat * sphere.UNIT)


def hunted(some: Tracks, speed: float, search: float, width: np.ndarray, count: int) -> float:
    """Return the most that legs by hand find of tracks in some hours of search, which may begin
    anywhere and at any time.

    Half of them go from one particle that they can meet to the next, at most half an hour away; the
    others go to and fro in a place where one is some time, along its course, across it, or with it.
    """
    rng = np.random.default_rng(2)
    time, x, y = placed(some)
    swarm = optimiser.swarm_of(some, plans.spec(), [None], record.plane(some))

    def at(i: int, t: float) -> np.ndarray:
        return np.array([np.interp(t, time, v[:, i]) for v in (x, y)])

    best = 0.0
    for number in range(count):
        now, i = float(rng.uniform(0, time[-1] - search * HOUR)), int(rng.integers(some.m))
        spot, end = at(i, now), now + search * HOUR
        path = [(now, *spot, 1.0)]
        course = at(i, now + 300) - at(i, now - 300)
        turn = np.arctan2(*course[::-1]) + (number // 2 % 2) * np.pi / 2
        drift_by = course / 600 * (number // 4 % 2)
        reach = float(rng.uniform(0.3, 3) * width.max())
        while now < end - 60:
            if number % 2:
                way = (-1) ** len(path) * reach * np.array([np.cos(turn), np.sin(turn)])
                way += drift_by * np.hypot(*way) / speed
            else:
                i = int(rng.integers(some.m))
                goal = at(i, now)
                for _ in range(5):
                    goal = at(i, min(now + float(np.hypot(*(goal - spot))) / speed, end))
                way = goal - spot
                if not 60 < np.hypot(*way) / speed < 1800 and rng.random() < 0.98:
                    continue
            share = min(1.0, (end - now) * speed / float(np.hypot(*way)))
            now, spot = now + share * float(np.hypot(*way)) / speed, spot + share * way
            path.append((now, *spot, 1.0))
        chance, _ = sweeps.found(swarm, None, np.array(path), width, np.ones(1))
        best = max(best, float(some.weight @ chance[:, 0]))
    return best


def strait(m: int) -> Tracks:
    """Return ships from far and wide at 4 to 7 m/s through a gap of 0.3 nmi, one after the other,
    and on fanwise.
    """
    rng = np.random.default_rng(6)
    time = np.arange(49) * 300.0
    passes, gap, speed = (
        rng.uniform(0.5, 3.5, m) * HOUR,
        rng.normal(0, 0.3 * NMI, m),
        rng.uniform(4, 7, m),
    )
    before, after = rng.uniform(-0.8, 0.8, m), rng.uniform(-0.5, 1.2, m)
    ahead = speed * (time[:, None] - passes)
    turn = np.where(ahead < 0, before, after)
    return plans.steered(time, ahead * np.cos(turn), gap + ahead * np.sin(turn))


def burst(m: int) -> Tracks:
    """Return boats that leave a place of 0.4 nmi by all courses at 2 to 6 m/s: a cloud that spreads
    more than tenfold.
    """
    rng = np.random.default_rng(3)
    time = np.arange(37) * 300.0
    turn, speed = rng.uniform(0, 2 * np.pi, m), rng.uniform(2, 6, m)
    x, y = (
        0.4 * NMI * rng.standard_normal(m) + time[:, None] * speed * part(turn)
        for part in (np.sin, np.cos)
    )
    assert np.hypot(x[-1].std(), y[-1].std()) > 10 * np.hypot(x[0].std(), y[0].std())
    return plans.steered(time, x, y)


def mixed(m: int) -> Tracks:
    """Return yachts of one course at 3 m/s through rafts that drift; most yachts go adrift some
    time.
    """
    rng = np.random.default_rng(4)
    time = np.arange(37) * 300.0
    sails = np.arange(m) % 3 > 0
    turn = np.where(sails, rng.uniform(0, 4, m) * HOUR, -np.inf)
    x = np.where(sails, rng.normal(-8, 4, m), rng.normal(0, 5, m)) * NMI
    y = np.where(sails, rng.normal(0, 0.7, m), rng.normal(1, 4, m)) * NMI
    sailed = np.clip(time[:, None], None, np.maximum(turn, 0.0))
    return plans.steered(
        time, x + 3.0 * sailed + 0.3 * time[:, None], y - 0.2 * time[:, None], turn
    )


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("targets", "speed", "search"),
    [
        pytest.param(strait, 9.0, 1.4, marks=pytest.mark.thorough),
        (burst, 14.0, 0.75),
        (mixed, 16.0, 2.4),
    ],
)
def test_no_legs_by_hand_find_more_than_the_bound(
    targets: Callable[[int], Tracks], speed: float, search: float
) -> None:
    """On the same particles, seen farther while under way: below the bound, and that below 1, or it
    would tell nothing.
    """
    some = targets(1200)
    width = np.array([[0.3], [0.5]]) * NMI
    one = replace(plans.unit(speed, search, width[0, 0], Law()), width_under_way=(width[1, 0],))
    reckoned = bound.bound(some, [one], plans.spec((some.time[-1] - some.time[0]) / HOUR), [None])
    assert reckoned.none == ""
    assert 0.15 < hunted(some, speed, search, width, 160) < reckoned.value < 0.9


@pytest.mark.thorough
def test_what_stands_still_is_bounded_as_what_drifts() -> None:
    """A circular normal, random search: 1 - (1 + u) e^-u.

    Chance makes the bound higher: boxes of 51 by less than a tenth.
    """
    u, std = 1.1, 5 * NMI
    still = plans.cloud(2**13, std, hours=1)
    one = plans.unit(plans.speed_for(u, std, 1, NMI), 1, NMI, Law("random"))
    value = bound.bound(
        replace(still, turn=np.full(still.m, np.inf)), [one], plans.spec(1), [None]
    ).value
    assert 1 < value / (1 - (1 + u) * np.exp(-u)) < 1.1


def test_bins_of_a_convoy_are_short_and_of_a_stream_long() -> None:
    """What goes by as one is less dense in boxes that stand still; a stream is as dense all the
    time.
    """
    rng = np.random.default_rng(5)
    time, m = np.arange(13) * 300.0, 2500
    convoy = plans.steered(
        time,
        900 * rng.standard_normal(m) + 8 * time[:, None],
        900 * rng.standard_normal((1, m)) + 0 * time[:, None],
    )
    stream = plans.steered(
        time,
        rng.uniform(-9e4, 9e4, m) + 8 * time[:, None],
        900 * rng.standard_normal((1, m)) + 0 * time[:, None],
    )
    long = {
        name: np.diff(bins.of_streams(some, record.plane(some)).first)
        for name, some in (("convoy", convoy), ("stream", stream))
    }
    assert long["convoy"].max() <= 2
    assert (long["stream"] == bins.LONGEST).all()
