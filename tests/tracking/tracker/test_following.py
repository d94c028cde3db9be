"""Clouds that follow a target: the thesis' exact points, its tables, and laws in closed form
(SciPy, pyproj).
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from chases import HOUR, KNOT, LAT, LON, MINUTE, NMI, leg, one_box, way
from pyproj import Geod
from scipy import spatial, stats

from drift.tracking.tracker import following, path, sweeps
from drift.tracking.tracker.following import Clouds, World
from drift.tracking.tracker.path import Path
from drift.tracking.tracker.records import METHODS, Behaviour, Filling, Plan, Sensor, Tracker
from geo import sphere
from kernels.tracking.clouds import DETECTED, SILENT
from kernels.tracking.follower import HIDING, SEEKING, Own

EARTH = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
EYES = Sensor("visual", 10 * NMI, 0.3, math.radians(1.5), 12.0)
RADAR = Sensor("radar", 30 * NMI, 0.05, math.radians(1.0), 1.2)
DETECTOR = Sensor("radar detector", 60 * NMI, 0.8, math.radians(5.0), 1.2, hears=True)
TWENTY = Plan(0.0, 20 * MINUTE, 5 * MINUTE)
FASTEST = 32 * KNOT

NAIVE = Tracker("naive", Behaviour(FASTEST), Filling("combined", 0.75, 0.25))
ACTS = (3 * MINUTE, 15 * MINUTE)
CONTEXT = Tracker("context", Behaviour(FASTEST, change=0.5, acts=ACTS), Filling())
SEEKER = Tracker("seeker", Behaviour(FASTEST, change=0.45, seek=0.1, acts=ACTS), Filling())
HIDER = Tracker("hider", Behaviour(FASTEST, change=0.45, hide=0.1, acts=ACTS), Filling())


def world(
    tracker: Path,
    target: Path,
    sensors: list[Sensor],
    end: float,
    every: float,
    detections: bool = False,
) -> World:
    emissions = sweeps.emitted(TWENTY, 1.2, end)
    parts = []
    for sensor in sensors:
        moments = sweeps.times(sensor, end, emissions)
        parts.append(sweeps.of_sensor(sensor, moments, tracker, target.at(moments)[0]))
    parts.append(sweeps.marks(np.arange(every, end + 1e-6, every), target))
    return World(tracker, sweeps.ordered(parts, detections))


def wrong(
    found: following.Estimates, scene: World, target: Path
) -> tuple[np.ndarray, following.Errors]:
    """Return (times [min], errors) of what is recorded."""
    time = scene.sweeps.time[scene.sweeps.row >= 0]
    times = np.tile(time, (found.place.shape[1], 1))
    return time / MINUTE, following.errors(found, times, *target.at(time))


CLOSING = world(
    path.standing(LON, LAT, 0.0, 4 * HOUR),
    way(85, 0, leg(270, 20, 240)),
    [EYES, DETECTOR],
    4 * HOUR,
    300.0,
)
RED = way(85, 0, leg(270, 20, 240))


def test_the_first_closing_detection_is_off_by_half_of_its_box() -> None:
    """|R - (0.2 R + min(1.8 R, 60)) / 2|, times the shortening of an arc's mean by sin(a) / a, with
    the error of a mean.
    """
    first = world(CLOSING.tracker, RED, [DETECTOR], 81 * MINUTE, HOUR * 9, detections=True)
    size = 20_000
    found = following.follow([first], [NAIVE], size, 3)
    time, errors = wrong(found, first, RED)
    there = (
        EARTH.inv(*np.degrees([LON, LAT]), *np.ravel(path.degrees(RED.at([time[0] * MINUTE])[0])))[
            2
        ]
        / NMI
    )
    low, high = 0.2 * there, min(1.8 * there, 60.0)
    mean = (low + high) / 2 * np.sin(np.radians(5)) / np.radians(5)
    spread = (high - low) / np.sqrt(12 * size)
    assert abs(errors.position[0, 0, 0] / NMI - abs(there - mean)) < 4 * spread
    # All headings and speeds from 0 to 32 are as likely.
    assert abs(found.speed[0, 0, 0] / KNOT - 16) < 4 * 32 / np.sqrt(12 * size)
    assert np.linalg.norm(found.velocity[0, 0, 0]) / KNOT < 4 * 32 / np.sqrt(3 * size)


@pytest.mark.thorough
def test_nothing_parts_naive_from_contextual_before_three_minutes_and_the_methods_in_closing() -> (
    None
):
    trackers = [replace(NAIVE, filling=Filling(method, 0.75, 0.25)) for method in METHODS]
    trackers += [replace(CONTEXT, filling=Filling(method)) for method in METHODS]
    two = [CLOSING, CLOSING]
    found = following.follow(two, trackers, 2500, 8)
    time = wrong(found, CLOSING, RED)[0]
    passive = (time >= 85) & (time <= 215)
    for first in (0, 3):
        for other in (first + 1, first + 2):
            np.testing.assert_array_equal(
                found.place[first][:, passive], found.place[other][:, passive]
            )
    # other runs, other numbers
    assert not np.array_equal(found.place[0][0, passive], found.place[0][1, passive])
    detected = CLOSING.sweeps.time[CLOSING.sweeps.outcome == DETECTED][0]
    early = world(
        CLOSING.tracker, RED, [EYES, DETECTOR], detected + 3 * MINUTE, HOUR * 9, detections=True
    )
    both = following.follow([early], [NAIVE, CONTEXT], 300, 8)
    assert both.place.shape[2] > 100
    np.testing.assert_array_equal(both.place[0], both.place[1])


@pytest.mark.parametrize("tracker", [NAIVE, CONTEXT])
def test_the_last_detection_is_carried_forward_apart_from_the_cloud(tracker: Tracker) -> None:
    """The estimate at the last detection, moved along its great circle by pyproj: to a millimetre.

    Of particles that keep their course the cloud's mean goes the same way; if they act it lags.
    """
    target = way(30, 20, leg(200, 18, 40), leg(275, 24, 80))
    own = path.standing(LON, LAT, 0.0, 2 * HOUR)
    scene = world(own, target, [DETECTOR], 2 * HOUR, 300.0, detections=True)
    found = following.follow([scene], [tracker], 400, 3)
    recorded = scene.sweeps.row >= 0
    time, seen = scene.sweeps.time[recorded], (scene.sweeps.outcome == DETECTED)[recorded]
    carried = following.carry_forward(found.fix[0, 0], time)
    errors = following.errors(found, time[None], *target.at(time))
    lags = []
    assert seen.sum() > 100
    for k in range(len(time)):
        before = np.flatnonzero(seen[: k + 1])
        if not before.size:
            assert np.isnan(carried[k]).all()
            continue
        last = before[-1]
        east, north = found.velocity[0, 0, last]
        lon, lat = path.degrees(found.place[0, 0, last])
        far = math.hypot(east, north) * (time[k] - time[last])
        to = EARTH.fwd(float(lon), float(lat), math.degrees(math.atan2(east, north)), far)
        x, y = path.degrees(carried[k])
        assert EARTH.inv(float(x), float(y), *to[:2])[2] < 1e-3
        if np.isfinite(found.place[0, 0, k, 0]):
            there = [float(v) for v in path.degrees(target.at([time[k]])[0][0])]
            away = EARTH.inv(float(x), float(y), *there)[2]
            assert errors.carried[0, 0, k] == pytest.approx(away, abs=1e-2)
            lags.append(path.arc(found.place[0, 0, k], carried[k]) * sphere.RADIUS)
    if tracker is NAIVE:
        # means of 400 places that move on great circles which differ by the spread of the cloud
        assert max(lags) < 0.02 * FASTEST * 15 * MINUTE
    else:
        assert max(lags) > 0.05 * FASTEST * 15 * MINUTE


@pytest.mark.parametrize("method", METHODS)
def test_a_new_draw_is_weighted_by_the_speed_it_needs_and_aimed_from_the_last_estimate(
    method: str,
) -> None:
    """The window about 10 kn is -12 to 32; 40 kn would weigh -8, and weighs 0.1. Ranges by pyproj."""
    here = path.vector(LON, LAT)
    parts = [one_box(100.0, 4.0, 4.4, 2.0, 0.0, here), one_box(60.0, 6.0, 48.0, 10.0, HOUR, here)]
    scene = World(path.standing(LON, LAT, 0.0, HOUR), sweeps.ordered(parts))
    size = 4000
    held = Clouds([scene], [Tracker("x", Behaviour(FASTEST), Filling(method, 0.75, 0.25))], size, 4)
    before = held.go(10.0).particles(0, 0, 0.0)
    estimate = path.degrees((before.weight @ before.place)[None])
    pace = np.linalg.norm(before.velocity, axis=1) @ before.weight * sphere.RADIUS / KNOT
    later = held.particles(0, 0, HOUR).place
    after = held.go().particles(0, 0, HOUR)
    survived = spatial.KDTree(later).query(after.place)[0] < 1e-12  # [rad] the chord is as long
    assert 10 < np.count_nonzero(survived) < size / 4
    lon, lat = path.degrees(after.place)
    _, back, far = EARTH.inv(np.full(size, estimate[0][0]), np.full(size, estimate[1][0]), lon, lat)
    need = far / NMI
    low, high = 2 * pace - 32, 32.0
    weight = np.maximum(np.where(need < pace, need - low, high - need), 0.1)
    assert (need > 40).any()
    weight = np.where(survived, high - pace, weight)
    if method == "course":
        weight[:] = 1.0
    np.testing.assert_allclose(after.weight, weight / weight.sum(), rtol=1e-6)
    speed = np.linalg.norm(after.velocity, axis=1) * sphere.RADIUS / KNOT
    course = np.degrees(path.course(after.place, after.velocity))
    onward = (np.abs((course - back) % 360 - 180) < 1e-3) & ~survived
    if method == "position":
        assert not onward.any()
    else:
        fresh = size - np.count_nonzero(survived)
        assert abs(np.count_nonzero(onward) - fresh / 2) < 4 * 0.5 * np.sqrt(fresh)
        np.testing.assert_allclose(speed[onward], np.minimum(need[onward], 32.0), rtol=1e-6)
    assert stats.kstest(speed[~onward & ~survived] / 32, "uniform").pvalue > 1e-3


def test_duplicates_are_drawn_by_weight_and_keep_it() -> None:
    """Of what is left in half of the sector; the mean weight of a draw by weight w is the sum of
    w^2 over that of w.
    """
    here = path.vector(LON, LAT)
    boxes = [
        (100.0, 4.0, 4.4, 2.0, 0.0),
        (60.0, 6.0, 48.0, 10.0, HOUR),
        (60.0, 6.0, 48.0, 5.0, HOUR + 1),
    ]
    scene = World(
        path.standing(LON, LAT, 0.0, 2 * HOUR),
        sweeps.ordered([one_box(*box, here) for box in boxes]),
    )
    size = 6000
    held = Clouds(
        [scene], [Tracker("x", Behaviour(FASTEST), Filling("position", 0.75, 0.25))], size, 4
    )
    after = held.go().particles(0, 0, HOUR + 1)
    _, first, which = np.unique(after.place[:, 0], return_index=True, return_inverse=True)
    kept = len(first)
    assert abs(kept - size / 2) < 4 * np.sqrt(size / 4)
    assert (first < kept).all()  # what is left stands first, duplicates behind it
    np.testing.assert_array_equal(after.weight, after.weight[first][which])
    weight, drawn = after.weight[:kept], after.weight[kept:]
    share = weight / weight.sum()
    mean, spread = share @ weight, np.sqrt(share @ weight**2 - (share @ weight) ** 2)
    assert abs(drawn.mean() - mean) < 4 * spread / np.sqrt(len(drawn))
    assert mean - weight.mean() > 10 * spread / np.sqrt(len(drawn))


def test_levels_of_what_a_cloud_was_drawn_from_are_uniform() -> None:
    """A target that is drawn from the box of its detection is one more particle: its rank by
    density is any, and a share of 1 - p is below p. One that lies outside of all is beyond every
    area."""
    here, random = path.standing(LON, LAT, 0.0, HOUR), np.random.default_rng(6)
    at, worlds = path.vector(LON, LAT), []
    for _ in range(600):
        far, azimuth = random.uniform(6.0, 21.0) * NMI, random.uniform(20.0, 90.0)
        lon, lat, _ = EARTH.fwd(*np.degrees([LON, LAT]), azimuth, far)
        truth = path.standing(*np.radians([lon, lat]), 0.0, HOUR)
        parts = [one_box(55.0, 6.0, 21.0, 35.0, 0.0, at), sweeps.marks(np.array([0.0]), truth)]
        worlds.append(World(here, sweeps.ordered(parts)))
    found = following.follow(worlds, [NAIVE], 600, 12, areas=True)
    level = found.level[0, :, 0]
    assert stats.kstest(level, "uniform").pvalue > 1e-3
    for share in (0.5, 0.9):
        assert abs((level < share).mean() - share) < 4 * np.sqrt(share * (1 - share) / 600)
    away = path.standing(LON + 0.1, LAT, 0.0, HOUR)
    lost = World(
        here,
        sweeps.ordered(
            [one_box(55.0, 6.0, 21.0, 35.0, 0.0, at), sweeps.marks(np.array([0.0]), away)]
        ),
    )
    assert following.follow([lost], [NAIVE], 600, 12, areas=True).level[0, 0, 0] == 1.0
    assert np.isnan(following.follow([lost], [NAIVE], 600, 12).level).all()


def acted(law: Behaviour, blue: Path, size: int) -> tuple[np.ndarray, following.Particles]:
    """Return speeds [1/s] of a cloud about the patch, 5 to 20 nmi off, and the cloud when each has
    acted once, after 100 s.
    """
    box = one_box(0.0, 5.0, 20.0, 180.0, 0.0, path.vector(LON, LAT))
    scene = World(blue, sweeps.ordered([box, sweeps.marks(np.array([1.0, 100.0]), blue)]))
    held = Clouds([scene], [Tracker("x", law, Filling())], size, 4)
    first = np.linalg.norm(held.go(10.0).particles(0, 0, 1.0).velocity, axis=1)
    return first, held.go().particles(0, 0, 100.0)


def test_a_seeker_meets_a_tracker_under_way() -> None:
    """On a great circle as its own it comes within 1 s of their relative speed, and what the sphere
    bends: d (d / R)^2.
    """
    there = EARTH.fwd(*np.degrees([LON, LAT]), 217.0, 11 * KNOT * 8 * HOUR)
    blue = path.through(
        [0.0, 8 * HOUR], *np.radians([[np.degrees(LON), there[0]], [np.degrees(LAT), there[1]]])
    )
    first, after = acted(Behaviour(FASTEST, seek=1.0, acts=(100.0, 100.0)), blue, 1500)
    assert (after.mode == SEEKING).all()
    speed = np.linalg.norm(after.velocity, axis=1)
    np.testing.assert_allclose(speed, first, rtol=1e-9)  # it keeps its speed
    fast = speed * sphere.RADIUS > 20 * KNOT
    p, v, pace = after.place[fast], after.velocity[fast] / speed[fast, None], speed[fast]
    nearest, when = np.full(fast.sum(), np.inf), np.zeros(fast.sum())
    for time in np.arange(100.0, 3.5 * HOUR, 2.0):  # 20 nmi at 20 - 11 kn
        angle = (pace * (time - 100.0))[:, None]
        apart = path.arc(p * np.cos(angle) + v * np.sin(angle), blue.at([time])[0]) * sphere.RADIUS
        when = np.where(apart < nearest, time - 100.0, when)
        nearest = np.minimum(nearest, apart)
    gone = pace * sphere.RADIUS * when
    assert (nearest < (32 + 11) * KNOT + gone * (gone / sphere.RADIUS) ** 2).all()


def test_a_hider_flees_within_its_sector() -> None:
    """Uniform about the reciprocal of the bearing to where the tracker is when it acts; it keeps
    its speed.
    """
    blue = way(0, 0, leg(217, 11, 600))
    first, after = acted(Behaviour(FASTEST, hide=1.0, acts=(100.0, 100.0)), blue, 3000)
    assert (after.mode == HIDING).all()
    np.testing.assert_allclose(np.linalg.norm(after.velocity, axis=1), first, rtol=1e-9)
    lon, lat = path.degrees(after.place)
    there = np.ravel(path.degrees(blue.at([100.0])[0]))
    reciprocal = (
        EARTH.inv(lon, lat, np.full(lon.size, there[0]), np.full(lon.size, there[1]))[0] + 180
    )
    off = (np.degrees(path.course(after.place, after.velocity)) - reciprocal + 180) % 360 - 180
    assert stats.kstest(off, stats.uniform(-30, 60).cdf).pvalue > 1e-3


def test_of_two_detections_at_one_time_the_first_tells_no_speed() -> None:
    """A second box in the first, a sixth of it: what is drawn again is as likely as what was left,
    on any course at any speed.
    """
    here = path.vector(LON, LAT)
    boxes = [(60.0, 6.0, 18.0, 12.0, 0.0), (60.0, 8.0, 12.0, 4.0, 0.0)]
    scene = World(
        path.standing(LON, LAT, 0.0, HOUR), sweeps.ordered([one_box(*box, here) for box in boxes])
    )
    for method in METHODS:
        law = Tracker("x", Behaviour(FASTEST), Filling(method, 0.75, 0.25))
        after = Clouds([scene], [law], 4000, 4).go().particles(0, 0, 0.0)
        np.testing.assert_allclose(after.weight * 4000, 1.0)
        speed = np.linalg.norm(after.velocity, axis=1) * sphere.RADIUS / FASTEST
        assert stats.kstest(speed, "uniform").pvalue > 1e-3
        course = path.course(after.place, after.velocity)
        assert stats.kstest(course, stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > 1e-3


def test_what_acts_freely_takes_any_course_and_speed_at_private_times() -> None:
    """After 2 h of acts every 3 to 15 min, half of them changes, all but 1 in 10^3 have changed:
    uniform in both.
    """
    here = path.standing(LON, LAT, 0.0, 3 * HOUR)
    parts = [
        one_box(70.0, 5.0, 20.0, 10.0, 0.0, path.vector(LON, LAT)),
        sweeps.marks(np.array([2.0 * HOUR]), here),
    ]
    scene = World(here, sweeps.ordered(parts))
    after = Clouds([scene], [CONTEXT], 6000, 4).go().particles(0, 0, 2 * HOUR)
    speed = np.linalg.norm(after.velocity, axis=1) * sphere.RADIUS / FASTEST
    assert stats.kstest(speed, "uniform").pvalue > 1e-3
    course = path.course(after.place, after.velocity)
    assert stats.kstest(course, stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > 1e-3


def test_silence_cuts_what_was_in_reach_and_a_track_of_which_too_little_is_left_is_lost() -> None:
    """A box of 2 to 12 nmi, uniform in range, has a fifth within 4 nmi and four fifths within 10."""
    here, at = path.standing(LON, LAT, 0.0, HOUR), path.vector(LON, LAT)
    slow = Tracker("x", Behaviour(1e-6), Filling("combined", 0.5, 0.25))
    size = 4000
    for reach, left in ((4.0, 0.8), (10.0, 0.0)):
        box, silent = (
            one_box(70.0, 2.0, 12.0, 10.0, 0.0, at),
            one_box(0.0, 0.0, reach, 180.0, 5.0, at, SILENT),
        )
        held = Clouds([World(here, sweeps.ordered([box, silent]))], [slow], size, 4).go()
        count = len(held.particles(0, 0, 5.0).weight)
        assert abs(count - left * size) <= 4 * np.sqrt(left * (1 - left) * size)


def test_sweeps_that_can_cut_nothing_are_passed_over_without_a_difference() -> None:
    """Where every sweep records its estimate none is passed over; what is left is the same but for
    the last bits.
    """
    blue, red = way(0, 0, leg(90, 18, 240)), way(40, 6, leg(262, 9, 240))
    scene = world(blue, red, [EYES, DETECTOR], 4 * HOUR, 300.0)
    told = scene.sweeps
    every = replace(told, row=np.arange(len(told), dtype=np.int32))
    assert (told.outcome == SILENT).sum() > 800
    some, full = (
        following.follow([World(blue, s)], [CONTEXT, SEEKER], 500, 6) for s in (told, every)
    )
    at = told.row >= 0
    np.testing.assert_array_equal(some.count, full.count[:, :, at])
    assert np.nanmin(some.count) < 500
    np.testing.assert_allclose(some.place, full.place[:, :, at], atol=1e-9)


@pytest.mark.thorough
def test_the_table_of_closing() -> None:
    """Tables 11 to 13 by the readings of an independent simulation: their tolerances and, beyond,
    those of 40 runs.
    """
    found = following.follow([CLOSING] * 40, [NAIVE, CONTEXT, SEEKER], 2500, 17)
    time, errors = wrong(found, CLOSING, RED)
    passive = (time >= 85) & (time <= 215)
    position = errors.position[..., passive].mean(axis=(1, 2)) / NMI
    course = np.degrees(errors.course[..., passive].mean(axis=(1, 2)))
    speed = errors.speed[..., passive].mean(axis=(1, 2)) / KNOT
    np.testing.assert_allclose(position, [7.67, 9.38, 6.79], atol=0.2)
    np.testing.assert_allclose(speed, [12.84, 6.25, 6.58], atol=0.2)
    assert abs(course[0] - 110) < 8
    assert abs(course[1] - 77) < 8
    assert abs(course[2] - 4.9) < 1.5
    # The negative control: the length of the mean velocity is no estimate of the speed.
    length = np.linalg.norm(found.velocity, axis=-1) / KNOT
    assert (np.abs(length - 20)[:2][..., passive].mean(axis=(1, 2)) > 17).all()


def test_duplicates_grow_by_the_square_of_what_they_weigh() -> None:
    """Where a cloud parts from the posterior: what weighs w of W comes to w (1 + m w / W) with m
    duplicates.

    Both clouds are drawn from a second box, weighted by the speed needed; a look that finds nothing
    takes a quarter away, which one of them fills. Of the heavier half: each duplicate adds w with
    probability w / W, so that the variance of the sum is m times that.
    """
    here = path.vector(LON, LAT)
    boxes = [one_box(60.0, 6.0, 18.0, 12.0, 0.0, here), one_box(60.0, 2.0, 10.0, 8.0, 700.0, here)]
    scene = World(
        path.standing(LON, LAT, 0.0, HOUR),
        sweeps.ordered([*boxes, one_box(0.0, 0.0, 4.0, 180.0, 700.5, here, SILENT)]),
    )
    n = 20_000
    laws = [
        Tracker("x", Behaviour(FASTEST), Filling("position", partial, 0.5))
        for partial in (0.5, 1.0)
    ]
    held = Clouds([scene], laws, n, 4).go()
    left, filled = (
        held._cloud["own_real"].to_numpy()[k * n :, Own.WEIGHT][
            : len(held.particles(k, 0, 700.5).weight)
        ]
        for k in (0, 1)
    )
    assert 0.6 * n < len(left) < 0.9 * n
    assert len(filled) == n
    m, whole, heavy = n - len(left), left.sum(), np.median(left)
    w = left[left > heavy]
    mean = w.sum() + m * (w**2).sum() / whole
    error = np.sqrt(m * ((w**3).sum() / whole - ((w**2).sum() / whole) ** 2))
    found = filled[filled > heavy].sum()
    assert abs(found - mean) < 3 * error
    posterior = w.sum() / whole
    assert found / filled.sum() - posterior > 10 * error / filled.sum()
