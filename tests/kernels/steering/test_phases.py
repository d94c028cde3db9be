"""Phases, distress and copies of targets that steer: times in order, against closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from scipy import stats
from targets import HOUR, KNOT, NMI, PERIOD, Fleet, triangle

from drift.engine.motion.steering.itinerary import (
    NONE,
    Between,
    Course,
    InRing,
    Itinerary,
    Loiter,
    Moment,
    Near,
    Part,
    Rate,
    Spread,
    WayPoint,
    Ways,
)
from drift.engine.particles.status import Status
from geo import sphere
from kernels.steering import steer
from kernels.steering.pieces import Room
from kernels.step.advance import Step

K12 = 12 * NMI / 60  # [m/sqrt(s)] 12 nmi/sqrt(h)


def at(lon: float, lat: float) -> Near:
    return Near(np.radians(lon), np.radians(lat))


def reached(place: object, hours: float) -> WayPoint:
    return WayPoint(place, Spread(hours * HOUR, hours * HOUR, hours * HOUR))  # type: ignore[arg-type]


def test_times_in_order() -> None:
    """Independent normals of 3 h at 0, 6 and 14 h would be out of order in 11 % of draws; the speed
    limits hold too.
    """
    places = [at(0.0, 45.0), at(0.9, 45.2), at(2.1, 45.1)]
    points = tuple(
        WayPoint(p, Moment(h * HOUR, 3 * HOUR)) for p, h in zip(places, (0, 6, 14), strict=True)
    )
    fast = 12 * KNOT
    fleet = Fleet(Itinerary((Ways(points, PERIOD.start, fastest=fast),), land="ignore"), 20_000)
    times = [fleet["departure"].astype(float), fleet["to_time"].astype(float)]
    fleet.go(30 * HOUR, HOUR, -12 * HOUR)
    assert (fleet["status"] == Status.ARRIVED).all()
    times.append(fleet["status_since"].astype(float))
    far = [sphere.distance(a.lon, a.lat, b.lon, b.lat) for a, b in pairwise(places)]
    for k in (0, 1):
        assert (times[k + 1] - times[k] >= far[k] / fast - 1).all()
    # Given the time before it, a time is its normal law cut there: probabilities of the normal law
    # are uniform.
    for k, mean in ((0, 6), (1, 14)):
        u = stats.norm.cdf(times[k + 1], mean * HOUR, 3 * HOUR)
        low = stats.norm.cdf(times[k] + far[k] / fast, mean * HOUR, 3 * HOUR)
        ordinary = low < 0.9
        assert stats.kstest(((u - low) / (1 - low))[ordinary], "uniform").pvalue > 1e-4


def test_phases_follow_one_another() -> None:
    """A voyage by speed to a corner of a polygon's surroundings, loitering in it, then away on a
    course.
    """
    ring = InRing(
        *(tuple(np.radians(x)) for x in np.array([(10.0, 35.0), (11.0, 35.2), (10.6, 35.9)]).T)
    )
    begin, end = at(8.0, 34.0), at(9.6, 34.9)
    far = float(sphere.distance(begin.lon, begin.lat, end.lon, end.lat))
    voyage = Ways(
        (WayPoint(begin), WayPoint(end, distance=far)),
        PERIOD.start,
        Spread(0.0, 3600.0, 0.0),
        speed=Spread(4.0, 6.0, 5.0),
    )
    until = PERIOD.start + np.timedelta64(60, "h")
    away = Course(Spread(2.0, 2.0, 2.0), Spread(5.0, 5.0, 5.0), lasting=10 * HOUR)
    fleet = Fleet(
        Itinerary(
            (voyage, Loiter(ring, Spread(3.0, 3.0, 3.0), 15e3, until=until), away), land="ignore"
        ),
        2000,
    )
    assert (fleet["phase"] == 0).all()
    arrival = fleet["departure"] + far / fleet["speed"]
    fleet.go(40 * HOUR, HOUR)
    assert arrival.max() < 20 * HOUR
    assert (fleet["phase"] == 1).all()
    lon, lat = np.radians(fleet["lon"]), np.radians(fleet["lat"])
    fleet.go(65 * HOUR, HOUR, 40 * HOUR)
    assert (fleet["phase"] == 2).all()
    assert (fleet["course"] == 2.0).all()
    fleet.go(71 * HOUR, HOUR, 65 * HOUR)
    assert (fleet["status"] == Status.ARRIVED).all()
    assert (fleet["status_since"] == 70 * HOUR).all()
    assert sphere.distance(lon, lat, np.radians(10.5), np.radians(35.4)).max() < 80e3


@pytest.mark.parametrize("kind", ["between", "rate", "part"])
def test_distress(kind: str) -> None:
    """When it goes adrift: between two times but after departure, at a rate from there on, after a
    part of the way.
    """
    begin, end = at(8.0, 34.0), at(9.6, 34.9)
    far = float(sphere.distance(begin.lon, begin.lat, end.lon, end.lat))
    n, after = 20_000, Spread(0.0, 6 * HOUR, 2 * HOUR, 3.0)
    laws = {
        "between": Between(
            PERIOD.start + np.timedelta64(2, "h"), Spread(0.0, 10 * HOUR, 8 * HOUR, 4.0)
        ),
        "rate": Rate(1 / (9 * HOUR)),
        "part": Part(Spread(0.2, 0.9, 0.8, 5.0)),
    }
    points = WayPoint(begin), WayPoint(end, distance=far)
    ways = Ways(points, PERIOD.start, after, speed=Spread(4.0, 6.0, 5.0))
    fleet = Fleet(Itinerary((ways,), laws[kind], land="ignore"), n)
    departure, release, speed = (fleet[x].astype(float) for x in ("departure", "release", "speed"))
    rng = np.random.default_rng(4)
    if kind == "between":
        d = triangle(rng, 0, 2, 6, 3.0, 200_000) * HOUR
        t = 2 * HOUR + triangle(rng, 0, 8, 10, 4.0, 200_000) * HOUR
        # Given its departure the distress comes after it: weigh departures alike, draw the distress
        # again until it does.
        while (early := t < d).any():
            t[early] = 2 * HOUR + triangle(rng, 0, 8, 10, 4.0, int(early.sum())) * HOUR
        assert stats.ks_2samp(release, t).pvalue > 1e-4
    elif kind == "rate":
        assert stats.kstest((release - departure) / (9 * HOUR), "expon").pvalue > 1e-4
        assert abs(np.corrcoef(release - departure, departure)[0, 1]) < 4 / np.sqrt(n)
    else:
        part = (release - departure) * speed / far
        assert stats.ks_2samp(part, triangle(rng, 0.2, 0.8, 0.9, 5.0, 200_000)).pvalue > 1e-4
    fleet.go(3 * HOUR, HOUR)
    stopped = release <= 3 * HOUR
    made = sphere.distance(begin.lon, begin.lat, *np.radians((fleet["lon"], fleet["lat"])))
    expected = np.maximum(np.minimum(release, 3 * HOUR) - departure, 0) * speed
    np.testing.assert_allclose(made, expected, atol=2e-6 * far + 0.6 * speed.max())
    assert stopped.any() or kind == "part"


def test_copies_keep_what_is_settled_and_part_in_the_noise() -> None:
    """Resampled copies go to their ancestor's destination, at its speed; their bridges are their
    own.
    """
    last = ((reached(at(3.0, 44.0), 30.0), 0.5), (reached(at(-3.0, 44.0), 30.0), 0.5))
    points = (WayPoint(at(0.0, 45.0), NONE), reached(at(0.0, 45.5), 5.0))
    fleet = Fleet(
        Itinerary((Ways(points, PERIOD.start, destinations=last, k=K12),), land="ignore"), 64
    )
    fleet.go(3 * HOUR, HOUR)
    for column in fleet.columns.values():
        column.from_numpy(np.repeat(column.to_numpy()[7:8], 64))
    fleet.go(20 * HOUR, HOUR, 3 * HOUR)
    assert len(set(zip(fleet["lon"], fleet["lat"], strict=True))) == 64
    assert len(set(fleet["to_lon"])) == 1


def test_a_distress_that_would_be_before_the_departure_is_at_it() -> None:
    ways = Ways(
        (WayPoint(at(8.0, 34.0)), WayPoint(at(9.6, 34.9), distance=1.7e5)), PERIOD.start,
        Spread(2 * HOUR, 6 * HOUR, 3 * HOUR), speed=Spread(4.0, 6.0, 5.0),
    )  # fmt: skip
    fleet = Fleet(
        Itinerary((ways,), Between(PERIOD.start, Spread(0.0, HOUR, 1800.0)), land="ignore"), 200
    )
    np.testing.assert_array_equal(fleet["release"], fleet["departure"])


def test_pieces_beyond_the_room_are_asked_for_again() -> None:
    """Where a step makes half as many pieces more than there are slots, each target's still follow
    one another to its end.

    The number of courses taken in a step is Poisson, so that 0.5 a target come on top, less than
    the room again.
    """
    n, step = 2000, Step(0, 0, 2 * HOUR, 1)
    law = Course(Spread(0.0, 2 * np.pi, 1.0), Spread(4.0, 4.0, 4.0), change=4 * HOUR)
    fleet = Fleet(Itinerary((law,)), n, at=(20.0, 3.0))
    room = Room(n)
    steer.write_pieces(fleet.columns, fleet.slots, fleet.plan, fleet.seed, None, step, room)
    pack = {
        name: room.columns[f"piece_{name}"].to_numpy() for name in ("begin", "end", "next", "used")
    }
    more = pack["used"][0] - n
    assert abs(more - 0.5 * n) < 4 * np.sqrt(0.5 * n)
    slot = at = np.arange(n)
    made, pieces = np.zeros(n), 0
    while at.size:
        pieces += at.size
        made[slot] += pack["end"][at] - pack["begin"][at]
        on = pack["next"][at] >= 0
        at, slot = pack["next"][at][on], slot[on]
    assert pieces == n + more
    np.testing.assert_array_equal(made, step.duration)
