"""Paths through clouds: meeting by hand, detours, and Klaas' trigger."""

import math
from contextlib import nullcontext

import numpy as np
import pytest
from pyproj import Geod

from drift.tracking.tracker import path, pursuit
from drift.tracking.tracker.pursuit import Pursuit, Trigger
from geo import sphere
from geo.array import Array
from geo.notation import KNOT, NMI

EARTH = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
LON, LAT = np.radians([-76.3, 34.2])
Cell = tuple[int, int]


def test_mass_is_the_weight_within_reach() -> None:
    rng = np.random.default_rng(3)
    cells = pursuit.Grid(LON, LAT, 3000.0, 6)
    lon, lat = sphere.destination(LON, LAT, *rng.normal(0, 9000, (2, 400)))
    weight = rng.random(400)
    found = pursuit.mass(cells.place, path.vector(lon, lat), weight, 5000.0)
    for row, column in ((0, 0), (6, 6), (9, 3), (4, 11)):
        at = path.degrees(cells.place[row, column])
        away = EARTH.inv(np.full(400, at[0]), np.full(400, at[1]), *np.degrees([lon, lat]))[2]
        assert found[row, column] == pytest.approx(weight[away <= 5000.0].sum(), abs=1e-12)


def test_the_trigger_multiplies_what_is_left_and_begins_anew() -> None:
    """Klaas' steps 1 to 3 by hand: 0.9, 0.81 < 0.85: triggered; 0.95, 0.8075 < 0.85: triggered;
    then from 1 again.
    """
    trigger = Trigger(0.85)
    assert [trigger.observed(weight) for weight in (0.9, 0.9, 0.95, 0.85, 1.0, 0.86)] == [
        False,
        True,
        False,
        True,
        False,
        False,
    ]


def straight(lon: Array, lat: Array, course: Array, speed: Array, times: Array) -> Array:
    """Return unit vectors of what keeps great circles (times, n, 3), by pyproj; angles [rad],
    [m/s], [s] after the first.
    """
    n = len(lon)
    where = [
        EARTH.fwd(*np.degrees([lon, lat, course]), np.broadcast_to(speed, n) * (t - times[0]))
        for t in times
    ]
    return np.stack([path.vector(*np.radians(at[:2])) for at in where])


def asked(**changes: object) -> Pursuit:
    given = {
        "aim": "meet", "start": (float(LON), float(LAT)), "speed": 20 * KNOT, "reach": 2 * NMI, "begin": 900.0,
        "interval": 600.0, "steps": 9,
    }  # fmt: skip
    return Pursuit(**{**given, **changes})  # type: ignore[arg-type]


@pytest.mark.thorough
def test_a_boat_on_a_known_course_is_met_where_the_speeds_allow_it() -> None:
    """It passes abeam at 12 nmi on a course across, at 10 kn: they are within reach after 40 to 60
    min; 30 nmi off, never.
    """
    for away, can in ((12.0, True), (30.0, False)):
        lon, lat, _ = EARTH.fwd(*np.degrees([LON, LAT]), 70.0, away * NMI)
        question = asked(steps=7)
        ways = straight(*np.radians([[lon], [lat], [340.0]]), np.array([10 * KNOT]), question.times)
        found = pursuit.pursue(question, lambda _, ways=ways: (ways, np.ones(1)))
        assert (found.met[-1] == 1.0) == can
        if can:
            assert (np.flatnonzero(found.met)[0] - 0) * 10 <= 60
            place = path.degrees(found.path.place)
            made = EARTH.inv(place[0][:-1], place[1][:-1], place[0][1:], place[1][1:])[2]
            # Lengths on the plane about the start are at most (d / R)^2 / 6 too short: 60 nmi,
            # 5e-5.
            assert (made <= question.speed * question.interval * (1 + 1e-4)).all()


def cloud(n: int, seed: int, question: Pursuit, centre: tuple[float, float] = (9.0, 4.0)) -> Array:
    rng = np.random.default_rng(seed)
    east, north = rng.normal(0, 3 * NMI, (2, n)) + np.array(centre)[:, None] * NMI
    lon, lat = sphere.destination(LON, LAT, east, north)
    return straight(lon, lat, rng.normal(1.0, 0.4, n), rng.uniform(4, 12, n) * KNOT, question.times)


def test_planning_again_meets_more_and_another_cloud_as_much() -> None:
    """Each of its looks meets a share p of n others: standard error sqrt(p (1 - p) / n) of either
    cloud.
    """
    question = asked(threshold=0.9)
    n = 4000
    first, second = (cloud(n, seed, question) for seed in (1, 2))
    first[:, : n // 3] = cloud(n // 3, 3, question, (-8.0, 10.0))
    second[:, : n // 3] = cloud(n // 3, 4, question, (-8.0, 10.0))
    again = pursuit.pursue(question, lambda _: (first, np.ones(n)))
    once = pursuit.pursue(asked(threshold=0.0), lambda _: (first, np.ones(n)))
    assert once.plans == (0,)
    assert len(again.plans) > 2
    assert again.met[-1] > once.met[-1] + 0.05
    assert (np.diff(again.met) >= 0).all()
    others = pursuit.judged(question, again, lambda _: (second, np.ones(n)))
    p = again.met[-1]
    assert others[-1] == pytest.approx(p, abs=4 * np.sqrt(2 * p * (1 - p) / n))


def test_what_avoids_goes_round_where_that_is_worth_it_and_through_where_not() -> None:
    """A standing band across the way: through it meets 40 % or more, round its end is a detour of
    some minutes.
    """
    n = 3000
    rng = np.random.default_rng(5)
    east, north = rng.uniform(-2, 9, n) * NMI, rng.normal(10, 0.7, n) * NMI
    place = path.vector(*sphere.destination(LON, LAT, east, north))
    ways = np.broadcast_to(place, (13, n, 3))
    to = tuple(float(x) for x in sphere.destination(LON, LAT, 0.5 * NMI, 20 * NMI))
    met, lasting = {}, {}
    for worth in (60.0, 36_000.0):
        question = asked(aim="avoid", steps=12, to=to, worth=worth, reach=1 * NMI, speed=15 * KNOT)
        found = pursuit.pursue(question, lambda _: (ways, np.ones(n)))
        met[worth], lasting[worth] = found.met[-1], len(found.path.time)
        # where it has arrived there is nothing to plan
        assert max(found.plans) < len(found.met) - 1
        there = path.degrees(found.path.place[-1])
        away = EARTH.inv(there[0], there[1], *np.degrees(to))[2]
        # m: at the destination itself, and from its cell there at the vessel's speed
        assert away < 0.01
        assert found.path.rate[-1] * sphere.RADIUS == pytest.approx(question.speed)
    assert met[36_000.0] < 0.01 < met[60.0]
    assert lasting[60.0] <= lasting[36_000.0]


def test_land_is_not_crossed() -> None:
    """A wall to the north, 3 cells thick, with a gap far east."""
    question = asked(steps=12)
    lon, lat, _ = EARTH.fwd(*np.degrees([LON, LAT]), 0.0, 15 * NMI)
    ways = np.broadcast_to(path.vector(np.radians([lon]), np.radians([lat])), (13, 1, 3))

    def wall(lons: Array, lats: Array, half: float = 0.0) -> Array:
        north = (lats - np.degrees(LAT)) * 60
        east = (lons - np.degrees(LON)) * 60 * np.cos(LAT)
        half = half / NMI
        return (north > 5 - half) & (north < 8 + half) & (east < 9 + half)

    class Wall:
        def in_squares(self, lon: Array, lat: Array, half: float) -> Array:
            return wall(lon, lat, half)

        def on_legs(self, begin: Array, ends: Array) -> Array:
            raise AssertionError("neither begin nor destination is near")

    found = pursuit.pursue(question, lambda _: (ways, np.ones(1)), Wall())
    assert found.met[-1] == 1.0
    assert not wall(
        *path.degrees(found.path.at(np.linspace(*found.path.time[[0, -1]], 5000))[0])
    ).any()
    lons, _ = path.degrees(found.path.place)
    assert lons.max() > np.degrees(LON) + 8 / 60


@pytest.mark.parametrize("between", [True, False])
def test_a_destination_in_the_cell_of_the_begin_is_gone_to_straight_on_or_not_at_all(
    between: bool,
) -> None:
    """Cells are 0.83 nmi wide; it is 0.3 nmi off, 54 s at 20 knots."""

    class Islet:
        def in_squares(self, lon: Array, lat: Array, half: float) -> Array:
            return np.zeros(lon.shape, bool)

        def on_legs(self, begin: Array, ends: Array) -> Array:
            assert (path.arc(begin, ends) * sphere.RADIUS / NMI).tolist() == [pytest.approx(0.3)]
            return np.array([between])

    lon, lat, _ = EARTH.fwd(*np.degrees([LON, LAT]), 200.0, 0.3 * NMI)
    question = asked(aim="avoid", to=tuple(np.radians([lon, lat])))
    ways = np.broadcast_to(path.vector([LON], [LAT]), (10, 1, 3))
    with (
        pytest.raises(ValueError, match=r"no path on cells of 0\.83 nmi")
        if between
        else nullcontext()
    ):
        found = pursuit.pursue(question, lambda _: (ways, np.ones(1)), Islet())
        assert found.path.time.tolist() == [900.0, pytest.approx(954.0)]
        np.testing.assert_allclose(found.path.place[-1], path.vector(*np.radians([lon, lat])))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"speed": 0.0}, "speed 0 must be above 0"),
        ({"reach": -1.0}, "reach -1 must be above 0"),
        ({"steps": 0}, "lasts less than a step"),
        ({"threshold": 1.2}, "threshold 1.2 must be 0 to 1"),
        ({"aim": "avoid"}, "a path that avoids goes to a place"),
        ({"aim": "avoid", "to": (0.0, 0.0)}, "out of reach"),
        ({"steps": 200}, "200 steps make"),
    ],
)
def test_what_cannot_be_done_is_one_line(changes: dict[str, object], words: str) -> None:
    question = asked(**changes)
    ways = np.broadcast_to(path.vector([LON], [LAT]), (question.steps + 1, 1, 3))
    with pytest.raises(ValueError, match=words):
        pursuit.pursue(question, lambda _: (ways, np.ones(1)))


def test_an_empty_cloud_is_refused_and_another_that_is_empty_meets_nobody_knows_what() -> None:
    ways = np.broadcast_to(path.vector([LON], [LAT]), (10, 1, 3))
    with pytest.raises(ValueError, match="no track is held when it begins"):
        pursuit.pursue(asked(), lambda _: (ways[:, :0], np.ones(0)))
    found = pursuit.pursue(asked(), lambda _: (ways, np.ones(1)))
    assert found.met[0] == 1.0
    assert np.isnan(pursuit.judged(asked(), found, lambda _: (ways[:, :0], np.ones(0)))).all()


def test_of_what_is_never_near_nothing_is_met() -> None:
    """Weights whose sum is 1 but for rounding: none of 4.4e-14 percent, and none below 0."""
    weight = np.random.default_rng(3).random(999) / 7
    ways = np.broadcast_to(path.vector(np.full(999, LON), np.full(999, LAT + 0.05)), (5, 999, 3))
    question = asked(reach=1.0, speed=5 * KNOT, steps=4)
    found = pursuit.pursue(question, lambda _: (ways, weight))
    assert (found.met == 0).all()
    assert (pursuit.judged(question, found, lambda _: (ways, weight)) == 0).all()


def test_how_much_comes_where_it_could_be_met_at_all() -> None:
    """By distances of pyproj at each look; no path meets more."""
    question, n = asked(speed=6 * KNOT, steps=5), 2000
    ways, weight = cloud(n, 5, question, (3.0, 2.0)), np.random.default_rng(6).random(n)
    weight[::3] = 0.0
    lon, lat = path.degrees(ways)
    apart = EARTH.inv(*(np.full(lon.shape, v) for v in np.degrees([LON, LAT])), lon, lat)[2]
    could = (apart <= (6 * KNOT * 600 * np.arange(6) + 2 * NMI)[:, None]).any(axis=0)
    assert 0.1 < could.mean() < 0.9
    assert (could & (apart[-1] > 6 * KNOT * 3000 + 2 * NMI)).any()  # within it for a while
    found = pursuit.pursue(question, lambda _: (ways, weight))
    assert found.near == pytest.approx(weight[could].sum() / weight.sum(), rel=1e-9)
    assert 0 < found.met[-1] < found.near


def test_a_destination_is_out_of_reach_where_the_great_circle_to_it_is_longer_than_the_way_made() -> (
    None
):
    """Nine steps of 10 min at 20 kn make 30 nmi: by pyproj one of 29.99 nmi is within, one of 30.01
    is not.
    """
    words = r"30\.0 nmi from where it begins, which is 91 min at 20 kn, and its 9 steps last 90 min"
    for away, beyond in ((29.99, False), (30.01, True)):
        lon, lat, _ = EARTH.fwd(*np.degrees([LON, LAT]), 237.0, away * NMI)
        question = asked(aim="avoid", to=(math.radians(lon), math.radians(lat)))
        with pytest.raises(ValueError, match=words) if beyond else nullcontext():
            pursuit.check(question)


def lowest(cost: Array, start: Cell, goal: Cell | None) -> float:
    """Return the least sum of costs (steps, rows, columns) of cells entered on any way, by going
    back from the end over all cells.
    """
    steps, rows, columns = cost.shape
    onward = np.full((rows, columns), 0.0 if goal is None else np.inf)
    for k in range(steps - 1, -1, -1):
        if goal is not None:
            onward[goal] = 0.0
        entered = np.pad(cost[k] + onward, 4, constant_values=np.inf)
        moves = [(i, j) for i in range(-4, 5) for j in range(-4, 5) if i * i + j * j <= 16]
        onward = np.min(
            [entered[4 + i : 4 + i + rows, 4 + j : 4 + j + columns] for i, j in moves], axis=0
        )
    return float(onward[start])


@pytest.mark.parametrize("aim", ["avoid", "meet"])
@pytest.mark.parametrize("seed", range(4))
def test_no_way_is_worth_more_by_what_a_meeting_is_worth(seed: int, aim: str) -> None:
    """Clumps of which one look meets much: a meeting less is worth -log(1 - share) of a detour."""
    rng = np.random.default_rng(seed)
    question = asked(
        aim=aim, steps=5, reach=1.6 * NMI, speed=14 * KNOT, threshold=0.0, worth=(430.0, 540.0, 690.0, 1900.0)[seed],
        to=tuple(float(x) for x in sphere.destination(LON, LAT, 0.6 * 14 * KNOT * 600, 2.75 * 14 * KNOT * 600)) if aim == "avoid" else None,
    )  # fmt: skip
    clumps = np.array([[-3.0, 3.4], [0.7, 3.2], [4.9, 3.7], [-0.4, 5.9]]) * NMI + rng.normal(
        0, 0.3 * NMI, (4, 2)
    )
    which = rng.choice(4, 70, p=[0.12, 0.7, 0.1, 0.08])
    east, north = clumps[which].T + rng.normal(0, 0.35 * NMI, (2, 70))
    lon, lat = sphere.destination(LON, LAT, east, north)
    ways = straight(lon, lat, rng.uniform(0, 6, 70), rng.uniform(0, 2, 70) * KNOT, question.times)
    weight = rng.exponential(1.0, 70)
    found = pursuit.pursue(question, lambda _: (ways, weight))
    assert found.met[0] == 0
    cells = pursuit.grid(question)
    away = (
        np.arccos(np.clip(cells.place @ ways[1:6].transpose(0, 2, 1)[:, None], -1, 1))
        * sphere.RADIUS
    )
    share = (away <= question.reach) @ (weight / weight.sum())
    cost = (
        600.0 - question.worth * np.log(1 - np.minimum(share, 1 - 1e-12))
        if aim == "avoid"
        else 1.0 - share
    )
    way = [
        np.unravel_index(np.argmin(np.linalg.norm(cells.place - one, axis=2)), share.shape[1:])
        for one in found.path.place
    ]
    start, goal = (cells.half, cells.half), way[-1] if aim == "avoid" else None
    assert way[0] == start
    if aim == "avoid":
        here = path.degrees(found.path.place[-1])
        assert EARTH.inv(here[0], here[1], *np.degrees(question.to))[2] < 1.0
    own = sum(cost[k][cell] for k, cell in enumerate(way[1:]))
    assert own == pytest.approx(lowest(cost, start, goal), abs=1e-6)
