"""What chance decides for targets that steer: each number by words of its own, so that none tells
of another.
"""

from itertools import combinations

import numpy as np
import pyproj
import pytest
import taichi as ti
from scipy import stats
from targets import HOUR, NMI, PERIOD, Fleet, triangle

from drift.engine.motion.steering import itinerary_tables
from drift.engine.motion.steering.itinerary import (
    NONE,
    Abeam,
    Acts,
    Course,
    InBox,
    InDisc,
    Itinerary,
    Moment,
    Near,
    Spread,
    WayPoint,
    Ways,
)
from drift.engine.particles.status import Status
from geo import sphere
from kernels.maths import noise
from kernels.steering import itinerary
from kernels.steering.itinerary import Chance, Plan

Table = ti.types.ndarray(dtype=ti.f32, ndim=2)
N = 40_000
STARTS = Spread(0.0, 9 * HOUR, 2 * HOUR, 3.0)
SPEEDS = Spread(2.0, 9.0, 4.0, 2.5)


def apart(columns: dict[str, np.ndarray]) -> None:
    """Hold every two columns against independence, by Pearson's test of their joint ranks in eight
    parts each.

    A sound pair fails once in a million.
    """
    parts = {
        name: np.argsort(np.argsort(x, kind="stable")) * 8 // x.size for name, x in columns.items()
    }
    for one, other in combinations(parts, 2):
        table = np.histogram2d(parts[one], parts[other], 8)[0]
        assert stats.chi2_contingency(table).pvalue > 1e-6, (one, other)


@ti.kernel
def _settled(plan: Plan, seed0: ti.u32, seed1: ti.u32, found: Table):
    for i in range(found.shape[0]):
        key = Chance(seed0, seed1, i, i, 0, 0)
        for phase in ti.static(range(2)):
            found[i, 4 * phase] = itinerary.own_speed(plan, key, phase)
            found[i, 4 * phase + 1] = ti.cast(itinerary.own_start(plan, key, phase), ti.f32)
            found[i, 4 * phase + 2] = itinerary.own_k(plan, key, phase)
            found[i, 4 * phase + 3] = ti.cast(itinerary.own_destination(plan, key, phase), ti.f32)
        course, speed, _word = itinerary.course_of(plan, itinerary.first(key, 2), 2)
        found[i, 8], found[i, 9] = course, speed


def test_what_is_settled_at_birth_tells_nothing_of_each_other() -> None:
    """Speed, start, K and destination of two phases, and the first course and speed of a third;
    each by its own law.
    """
    ends = tuple(
        (WayPoint(Near(0.01 * k, 0.7)), share) for k, share in enumerate((0.2, 0.45, 0.35))
    )
    ways = Ways(
        (WayPoint(Near(0.0, 0.5)),), PERIOD.start, STARTS, ends, SPEEDS, k=41.0, k_spread=0.6
    )
    away = Course(Spread(1.0, 4.0, 1.7, 2.0), SPEEDS, lasting=10 * HOUR)
    plan = itinerary_tables.plan([Itinerary((ways, ways, away), land="ignore")], PERIOD)
    found = np.zeros((N, 10), np.float32)
    _settled(plan, *noise.key(20_261_127), found)
    names = ("speed", "start", "K", "destination")
    columns = {
        f"{name} of {phase}": found[:, 4 * phase + k]
        for phase in range(2)
        for k, name in enumerate(names)
    }
    columns |= {"course of 2": found[:, 8], "speed of 2": found[:, 9]}
    rng = np.random.default_rng(6)
    for k in (0, 4):
        assert stats.ks_2samp(found[:, k], triangle(rng, 2.0, 4.0, 9.0, 2.5, 200_000)).pvalue > 1e-4
        assert (
            stats.ks_2samp(
                found[:, k + 1], triangle(rng, 0, 2 * HOUR, 9 * HOUR, 3.0, 200_000)
            ).pvalue
            > 1e-4
        )
        assert stats.kstest(np.log(found[:, k + 2] / 41.0) / 0.6, "norm").pvalue > 1e-4
        share = np.bincount(found[:, k + 3].astype(int), minlength=3) / N
        np.testing.assert_allclose(share, [0.2, 0.45, 0.35], atol=4 * np.sqrt(0.25 / N))
        # ranks of equal numbers in no order
        columns[f"destination of {k // 4}"] = found[:, k + 3] + rng.random(N)
    apart(columns)


@pytest.mark.parametrize(
    "place",
    [Near(0.4, 0.7, 40e3, 25e3, 0.3), InBox(0.4, 0.7, 80e3, 30e3, 0.5), InDisc(0.4, 0.7, 50e3)],
)
@pytest.mark.parametrize(
    "time", [Spread(30 * HOUR, 60 * HOUR, 35 * HOUR, 2.0), Moment(45 * HOUR, 3 * HOUR)]
)
def test_places_and_times_on_the_way_tell_nothing_of_each_other(
    place: object, time: Spread | Moment
) -> None:
    """Where and when it begins and where it is next and when."""
    points = WayPoint(Near(0.38, 0.69, 9e3, 4e3, 1.0), NONE), WayPoint(place, time)  # type: ignore[arg-type]
    fleet = Fleet(Itinerary((Ways(points, PERIOD.start, STARTS),), land="ignore"), N)
    columns = {
        name: fleet[name].astype(float) for name in ("lon", "lat", "to_lon", "to_lat", "departure")
    }
    east, north = (np.radians(columns.pop(name)) for name in ("to_lon", "to_lat"))
    east, north = sphere.offset(0.4, 0.7, east, north)
    turn = getattr(place, "orientation", 0.0)
    columns["along"] = east * np.sin(turn) + north * np.cos(turn)
    columns["across"] = east * np.cos(turn) - north * np.sin(turn)
    columns["lasting"] = (
        fleet["to_time"] - columns["departure"] + np.random.default_rng(2).random(N)
    )
    east, north = sphere.offset(
        0.38, 0.69, np.radians(columns.pop("lon")), np.radians(columns.pop("lat"))
    )
    columns["first, along"] = east * np.sin(1.0) + north * np.cos(1.0)
    columns["first, across"] = east * np.cos(1.0) - north * np.sin(1.0)
    if isinstance(place, InDisc):
        del columns["across"]  # in a disc the one bounds the other
    apart(columns)


def test_a_side_of_the_way_tells_nothing_of_speed_or_start() -> None:
    points = tuple(
        WayPoint(Abeam(x, 0.0, 5 * NMI, np.pi), distance=far)
        for x, far in ((0.3, 0.0), (0.32, 0.02 * sphere.RADIUS))
    )
    fleet = Fleet(Itinerary((Ways(points, PERIOD.start, STARTS, speed=SPEEDS),), land="ignore"), N)
    columns = {name: fleet[name].astype(float) for name in ("lat", "departure", "speed")}
    columns["departure"] += np.random.default_rng(2).random(N)
    apart(columns)


def test_a_first_act_tells_nothing_of_course_or_speed() -> None:
    acts = Acts(Spread(1.0, 4.0, 1.7, 2.0), SPEEDS, 9.0, (300.0, 9000.0))
    fleet = Fleet(Itinerary((acts,), land="ignore"), N, at=(12.3, 40.0))
    columns = {name: fleet[name].astype(float) for name in ("course", "speed", "to_time")}
    columns["to_time"] += np.random.default_rng(2).random(N)
    apart(columns)


def test_a_change_of_course_tells_nothing_of_course_or_speed() -> None:
    away = Course(Spread(1.0, 4.0, 1.7, 2.0), SPEEDS, change=5 * HOUR)
    fleet = Fleet(Itinerary((away,), land="ignore"), N, at=(12.3, 40.0))
    columns = {name: fleet[name].astype(float) for name in ("course", "speed", "to_time")}
    columns["to_time"] += np.random.default_rng(2).random(N)
    apart(columns)


def test_what_comes_from_elsewhere_goes_to_its_first_way_point_at_its_speed() -> None:
    """From where a course has left it: the table of lengths has none of that.

    By pyproj, to the second that times are rounded to.
    """
    first = WayPoint(Near(np.radians(-12.9), np.radians(46.2), 20e3, 8e3, 0.4), distance=0.0)
    second = WayPoint(Near(np.radians(-11.0), np.radians(47.0)), distance=170e3)
    away = Course(Spread(0.5, 2.0, 1.0), Spread(3.0, 5.0, 4.0), lasting=3.5 * HOUR)
    fleet = Fleet(
        Itinerary((away, Ways((first, second), PERIOD.start, speed=SPEEDS)), land="ignore"),
        3000,
        at=(-14.7, 45.6),
    )
    fleet.go(4 * HOUR, HOUR // 2)
    assert (fleet["phase"] == 1).all()
    assert (fleet["leg"] == 1).all()
    geod = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS)
    left = geod.inv(fleet["lon"], fleet["lat"], fleet["to_lon"], fleet["to_lat"])[2]
    since = fleet["to_time"] - 4 * HOUR
    np.testing.assert_allclose(left, since * fleet["speed"], rtol=2e-3, atol=10)
    assert left.min() > 30e3
    speed = fleet["speed"]
    fleet.go(60 * HOUR, HOUR, 4 * HOUR)
    np.testing.assert_array_equal(fleet["speed"], speed)
    assert (fleet["status"] == Status.ARRIVED).all()
    # of the second leg, as long as the table has it
    lasting = fleet["status_since"] - 4 * HOUR - since
    np.testing.assert_allclose(lasting * fleet["speed"], 170e3, rtol=1e-3)
