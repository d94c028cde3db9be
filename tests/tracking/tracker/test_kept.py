"""What clouds keep between detections: the stored estimate, what particles are about, great circles
over days; batches.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from chases import HOUR, KNOT, LAT, LON, NMI, leg, one_box, way
from pyproj import Geod
from scipy import stats

from drift.tracking.tracker import following, path, sweeps
from drift.tracking.tracker.following import Clouds, World
from drift.tracking.tracker.records import Behaviour, Filling, Plan, Sensor, Tracker
from geo import sphere
from kernels.tracking.clouds import DETECTED, SILENT
from kernels.tracking.follower import ACTING, HIDING

EARTH = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
FASTEST = 32 * KNOT
HERE = path.vector(LON, LAT)
STILL = path.standing(LON, LAT, 0.0, 3 * HOUR)


@pytest.mark.parametrize("reach", [7.0, 60.0], ids=["thinned", "lost"])
def test_the_estimate_is_that_of_the_last_detection_whatever_silence_did(reach: float) -> None:
    """What comes straight from it needs the way from there since then: not from where silence left
    the cloud, and after a lost track.
    """
    boxes = [
        one_box(100.0, 4.0, 9.0, 20.0, 60.0, HERE),
        one_box(0.0, 0.0, reach, 180.0, 600.0, HERE, SILENT),
    ]
    scene = World(STILL, sweeps.ordered([*boxes, one_box(280.0, 6.0, 9.0, 10.0, 1500.0, HERE)]))
    held = Clouds(
        [scene], [Tracker("x", Behaviour(FASTEST), Filling("course", 0.05, 0.05))], 4000, 4
    )
    first = held.go(60.0).particles(0, 0, 60.0)
    lon, lat = path.degrees((first.weight @ first.place)[None])
    left = len(held.go(600.0).particles(0, 0, 600.0).weight)
    assert 500 < left < 3500 if reach < 60 else left == 0
    after = held.go().particles(0, 0, 1500.0)
    to = path.degrees(after.place)
    _, back, far = EARTH.inv(np.full(4000, lon[0]), np.full(4000, lat[0]), *to)
    speed = np.linalg.norm(after.velocity, axis=1) * sphere.RADIUS
    course = np.degrees(path.course(after.place, after.velocity))
    onward = np.abs((course - back) % 360 - 180) < 1e-3
    # of up to a twentieth that survived
    assert abs(np.count_nonzero(onward) - 2000) < 4 * np.sqrt(1000) + 200
    np.testing.assert_allclose(speed[onward], np.minimum(far[onward] / 1440.0, FASTEST), rtol=1e-6)


def test_who_comes_straight_acts_no_sooner_than_the_others() -> None:
    """Of either kind half have acted midway between the least and the longest time, and changed
    their speed.
    """
    boxes = [
        one_box(100.0, 4.0, 9.0, 20.0, 60.0, HERE),
        one_box(280.0, 6.0, 9.0, 10.0, 1500.0, HERE),
    ]
    marks = sweeps.marks(np.array([1500.5, 1500.0 + 540.0]), STILL)
    scene = World(STILL, sweeps.ordered([*boxes, marks]))
    law = Tracker(
        "x", Behaviour(FASTEST, change=1.0, acts=(180.0, 900.0)), Filling("course", 0.5, 0.2)
    )
    held = Clouds([scene], [law], 6000, 4)
    before, after = held.go(1500.5).particles(0, 0, 1500.5), held.go(2040.0).particles(0, 0, 2040.0)
    estimate = Clouds([scene], [law], 6000, 4).go(60.0).particles(0, 0, 60.0)
    lon, lat = path.degrees((estimate.weight @ estimate.place)[None])
    _, back, _ = EARTH.inv(
        np.full(6000, lon[0]), np.full(6000, lat[0]), *path.degrees(before.place)
    )
    course = np.degrees(path.course(before.place, before.velocity))
    straight = np.abs((course - back) % 360 - 180) < 0.2  # half a second has gone by
    acted = (
        np.abs(np.linalg.norm(after.velocity, axis=1) / np.linalg.norm(before.velocity, axis=1) - 1)
        > 1e-6
    )
    assert 2500 < straight.sum() < 3500
    for some in (straight, ~straight):
        assert stats.binomtest(int(acted[some].sum()), int(some.sum()), 0.5).pvalue > 1e-3


def test_what_leaves_keeps_its_course_until_it_acts_again() -> None:
    """At acts of 100 to 104 s half begin to hide, which leave at the next; the others take another
    course.
    """
    times = np.array([1.0, 110.0, 195.0, 215.0, 295.0, 320.0])
    scene = World(
        STILL,
        sweeps.ordered([one_box(70.0, 5.0, 20.0, 30.0, 0.0, HERE), sweeps.marks(times, STILL)]),
    )
    law = Tracker(
        "x", Behaviour(FASTEST, hide=0.5, change=0.5, leave=1.0, acts=(100.0, 104.0)), Filling()
    )
    held = Clouds([scene], [law], 400, 4)
    seen = [held.go(time).particles(0, 0, time) for time in times]
    circle = [
        np.cross(one.place, one.velocity) / np.linalg.norm(one.velocity, axis=1, keepdims=True)
        for one in seen
    ]
    hid = seen[1].mode == HIDING
    assert 150 < hid.sum() < 250
    assert (seen[0].mode == ACTING).all()
    assert (seen[3].mode[hid] == ACTING).all()
    assert 50 < (seen[5].mode[hid] == HIDING).sum() < 150
    for a, b in ((1, 2), (2, 3), (3, 4)):
        np.testing.assert_allclose(circle[a][hid], circle[b][hid], atol=1e-9)
    for a, b in ((0, 1), (4, 5)):
        assert (np.abs(circle[a] - circle[b]).max(axis=1)[hid] > 1e-6).mean() > 0.95


def test_a_tracker_that_is_faster_than_all_passes_over_no_sweep_that_cuts() -> None:
    """It comes at 40 knots to particles of at most 5; where every sweep records its estimate none
    is passed over.
    """
    blue = way(-30, 0, leg(90, 40, 60))
    eyes = Sensor("eyes", 4 * NMI, 0.3, math.radians(1.5), 6.0, Plan())
    silent = sweeps.of_sensor(
        eyes, sweeps.times(eyes, 3600.0, np.empty(0)), blue, np.tile(-HERE, (600, 1))
    )
    told = sweeps.ordered(
        [one_box(60.0, 2.0, 9.0, 50.0, 0.0, HERE), silent, sweeps.marks(np.array([3600.0]), blue)]
    )
    every = replace(told, row=np.arange(len(told), dtype=np.int32))
    law = Tracker("x", Behaviour(5 * KNOT), Filling("combined", 0.0, 0.0))
    clouds = [
        Clouds([World(blue, one)], [law], 500, 6).go().particles(0, 0, 3600.0)
        for one in (told, every)
    ]
    assert 20 < len(clouds[0].weight) < 480
    np.testing.assert_allclose(clouds[0].place, clouds[1].place, atol=1e-9)


@pytest.mark.parametrize("days", [1, 12])
def test_ways_over_days_without_a_look_are_great_circles(days: int) -> None:
    """By pyproj's geodesics from an hour on: half a turn of the Earth at 32 kn and 12 days, in one
    go.
    """
    end = days * 24 * HOUR
    marks = sweeps.marks(np.array([HOUR, end]), STILL)
    scene = World(
        path.standing(LON, LAT, 0.0, end),
        sweeps.ordered([one_box(70.0, 5.0, 20.0, 30.0, 0.0, HERE), marks]),
    )
    held = Clouds([scene], [Tracker("x", Behaviour(FASTEST), Filling())], 200, 4)
    first = held.go(HOUR).particles(0, 0, HOUR)
    after = held.go().particles(0, 0, end)
    course = np.degrees(path.course(first.place, first.velocity))
    speed = np.linalg.norm(first.velocity, axis=1) * sphere.RADIUS
    to = EARTH.fwd(*path.degrees(first.place), course, speed * (end - HOUR))
    assert path.arc(after.place, path.vector(*np.radians(to[:2]))).max() * sphere.RADIUS < 0.01
    np.testing.assert_allclose(
        np.linalg.norm(after.velocity, axis=1) * sphere.RADIUS, speed, rtol=1e-9
    )


def test_a_run_is_the_same_in_any_batch_and_among_any_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    law = Tracker("x", Behaviour(FASTEST, change=0.5, acts=(180.0, 900.0)), Filling())
    boxes = [
        one_box(70.0, 5.0, 20.0, 30.0, 0.0, HERE),
        sweeps.marks(np.array([600.0, 3000.0]), STILL),
    ]
    worlds = [World(STILL, sweeps.ordered(boxes)) for _ in range(7)]
    whole = following.follow(worlds, [law], 50, 9)
    fewer = following.follow(worlds[:3], [law], 50, 9)
    monkeypatch.setattr(following, "TOGETHER", 100)
    batches = following.follow(worlds, [law], 50, 9)
    np.testing.assert_array_equal(whole.place, batches.place)
    np.testing.assert_array_equal(whole.place[:, :3], fewer.place)
    assert len(np.unique(whole.place[0, :, 1, 0])) == 7


@pytest.mark.parametrize(
    ("left", "silent", "after"),
    [
        (16, True, 16),
        (15, True, 32),
        (2, True, 32),
        (1, True, 0),
        (16, False, 16),
        (15, False, 32),
        (2, False, 32),
    ],
)
def test_clouds_are_filled_below_their_thresholds_and_at_them_are_not(
    left: int, silent: bool, after: int
) -> None:
    """Of 32 particles that stay where they are, with thresholds of 16 and of 2: by a circle about
    the place of one that holds so many.
    """
    box = one_box(60.0, 2.0, 9.0, 50.0, 0.0, HERE)
    law = Tracker("x", Behaviour(1e-6), Filling("course", 0.5, 0.0625))
    scene = World(STILL, box)
    place = Clouds([scene], [law], 32, 7).go().particles(0, 0, 0.0).place
    apart = np.sort(path.arc(place, place[:1])) * sphere.RADIUS / NMI
    inside = 32 - left if silent else left
    reach = (apart[inside - 1] + apart[inside]) / 2
    look = one_box(0.0, 0.0, reach, 180.0, 5.0, place[0], SILENT if silent else DETECTED)
    scene = World(STILL, sweeps.ordered([box, look, sweeps.marks(np.array([10.0]), STILL)]))
    found = Clouds([scene], [law], 32, 7).go()
    assert len(found.particles(0, 0, 10.0).weight) == after
    if after == 32:  # copies of those that were left, none drawn again
        assert len(np.unique(found.particles(0, 0, 10.0).place.round(9), axis=0)) <= left


def test_whether_areas_are_asked_for_changes_no_bit() -> None:
    """With particles that act and are cut by a radar after each of the times at which areas are
    asked for.
    """
    law = Tracker("x", Behaviour(FASTEST, change=0.5, acts=(180.0, 900.0)), Filling())
    silences = [
        one_box(0.0, 0.0, 7.0, 180.0, time, HERE, SILENT)
        for time in np.arange(900.0, 7200.0, 400.0)
    ]
    boxes = [
        one_box(70.0, 5.0, 10.0, 30.0, 0.0, HERE),
        *silences,
        sweeps.marks(np.arange(300.0, 7200.0, 250.0), STILL),
    ]
    scene = World(path.standing(LON, LAT, 0.0, 7200.0), sweeps.ordered(boxes))
    one, two = (Clouds([scene], [law], 300, 9, areas=areas).go() for areas in (False, True))
    assert np.isfinite(two.fields[0, 0, :, 8]).sum() > 20
    np.testing.assert_array_equal(
        np.delete(one.fields, 8, axis=-1), np.delete(two.fields, 8, axis=-1)
    )
    for name in ("place", "velocity", "weight"):
        np.testing.assert_array_equal(
            *(getattr(batch.particles(0, 0, 7200.0), name) for batch in (one, two)), strict=True
        )


def test_copies_that_have_not_parted_make_no_level_surer() -> None:
    """Forty particles, and as many with ten to fifteen duplicates each that stay where they are:
    windows by forty, not by five hundred.

    By Epanechnikov's windows written out; which of the particles rank the target is by their order,
    of which the kernel takes 101.
    """
    x, y, _ = EARTH.fwd(*np.degrees([LON, LAT]), 58.0, 8.6 * NMI)
    target = path.standing(math.radians(x), math.radians(y), 0.0, HOUR)
    parts = [
        one_box(60.0, 2.0, 9.0, 50.0, 0.0, HERE),
        one_box(60.0, 2.0, 9.0, 50.0, 5.0, HERE),
        one_box(0.0, 0.0, 8.45, 180.0, 5.0, HERE, SILENT),
    ]
    scene = World(STILL, sweeps.ordered([*parts, sweeps.marks(np.array([10.0]), target)]))
    law = Tracker("x", Behaviour(1e-6), Filling("course", 1.0, 0.0))
    found = following.follow([scene], [law], 500, 7, areas=True).level[0, 0, -1]
    cloud = Clouds([scene], [law], 500, 7).go().particles(0, 0, 10.0)
    place, count = np.unique(cloud.place.round(10), axis=0, return_counts=True)
    assert 20 < len(place) < 60
    mean = cloud.place.mean(axis=0)
    mean /= np.linalg.norm(mean)
    picks = np.arange(101) * 500 // 101
    together = np.array(
        [count[np.abs(place - cloud.place[k].round(10)).max(axis=1) < 2e-10].sum() for k in picks]
    )
    effective = 500 / together.mean()
    reach = 2.4**2 * ((cloud.place - mean) ** 2).sum(axis=1).mean() / 2 * effective ** (-1 / 3)

    def density(at: np.ndarray, without: int | None = None) -> float:
        each = np.maximum(1 - ((cloud.place - at) ** 2).sum(axis=1) / reach, 0)
        return float(each.sum() - (0 if without is None else each[without]))

    there = density(target.at([10.0])[0][0])
    expected = np.mean([density(cloud.place[k], int(k)) > there for k in picks])
    assert 0.05 < expected < 0.95
    assert found == pytest.approx(expected, abs=1e-9)


def test_who_cannot_meet_a_tracker_goes_straight_at_it() -> None:
    """A tracker on bearing 070 that goes 115 at 20 knots opens from all who keep its bearing at
    less than 20 knots: by pyproj.
    """
    there = EARTH.fwd(*np.degrees([LON, LAT]), 70.0, 30 * NMI)
    blue = path.of_legs(*np.radians(there[:2]), [path.Leg(math.radians(115), 20 * KNOT, 2 * HOUR)])
    box = one_box(0.0, 0.05, 0.06, 180.0, 0.0, HERE)
    scene = World(blue, sweeps.ordered([box, sweeps.marks(np.array([100.0]), blue)]))
    after = Clouds(
        [scene],
        [Tracker("x", Behaviour(FASTEST, seek=1.0, acts=(100.0, 100.0)), Filling())],
        1500,
        4,
    ).go()
    cloud = after.particles(0, 0, 100.0)
    speed = np.linalg.norm(cloud.velocity, axis=1) * sphere.RADIUS
    lon, lat = path.degrees(cloud.place)
    at, onward = blue.at([100.0])
    x, y = (np.full(1500, v) for v in np.ravel(path.degrees(at)))
    ahead, back, _ = EARTH.inv(lon, lat, x, y)
    toward = np.degrees(path.course(at, onward))[0] - (back + 180)
    across, away = 20 * KNOT * np.sin(np.radians(toward)), 20 * KNOT * np.cos(np.radians(toward))
    meets = (np.abs(across) < speed) & (np.sqrt(np.maximum(speed**2 - across**2, 0)) > away)
    assert 300 < meets.sum() < 1200
    lead = np.where(meets, np.degrees(np.arcsin(np.clip(across / speed, -1, 1))), 0.0)
    off = (np.degrees(path.course(cloud.place, cloud.velocity)) - ahead - lead + 180) % 360 - 180
    assert np.abs(off[np.abs(np.abs(across) - speed) > 0.01]).max() < 0.01
    assert (np.abs(across) < speed)[~meets].sum() > 50


def test_a_tracker_stays_where_its_way_ends() -> None:
    """Hiders 40 nmi north of one that went north for ten minutes flee north, hours after too; it
    has not overtaken them.
    """
    blue = path.of_legs(LON, LAT, [path.Leg(0.0, 24 * KNOT, 600.0)])
    box = one_box(0.0, 40.0, 42.0, 5.0, 0.0, HERE)
    scene = World(blue, sweeps.ordered([box, sweeps.marks(np.array([4 * HOUR]), blue)]))
    law = Tracker("x", Behaviour(3 * KNOT, hide=1.0, acts=(180.0, 900.0)), Filling())
    after = Clouds([scene], [law], 500, 4).go().particles(0, 0, 4 * HOUR)
    assert (np.cos(path.course(after.place, after.velocity)) > np.cos(np.radians(60))).all()
