"""One particle that follows, by itself: ways of any length, where its tracker is at any time, what
an act leaves and changes.
"""

import numpy as np
import pytest
import taichi as ti

from drift.tracking.tracker import following, path
from drift.tracking.tracker.path import Path
from kernels.maths import noise
from kernels.runtime import launch, tables
from kernels.tracking import follower
from kernels.tracking.follower import ACTING, HIDING, SEEKING, Cloud, Legs, Own, Rule, Rules

Table = ti.types.ndarray(dtype=ti.f64, ndim=2)
Ints = ti.types.ndarray(dtype=ti.i32, ndim=2)
SEED = 0x5EED_1234_0BAD_CAFE


def unit(lon: float, lat: float) -> np.ndarray:
    return path.vector(np.radians(lon), np.radians(lat))


def heading(place: np.ndarray, course: float) -> np.ndarray:
    """Return the unit tangent of a course [deg] at a place."""
    east = np.cross([0.0, 0.0, 1.0], place)
    east /= np.linalg.norm(east)
    return np.sin(np.radians(course)) * east + np.cos(np.radians(course)) * np.cross(place, east)


@ti.kernel
def _along(place: Table, way: Table, angle: Table, found: Table):
    for i in range(angle.shape[0]):
        q, v = follower.along(follower.vector(place, i, 0), follower.vector(way, i, 0), angle[i, 0])
        for d in ti.static(range(3)):
            found[i, d], found[i, 3 + d] = q[d], v[d]


def test_a_way_of_any_length_is_a_great_circle() -> None:
    """By complex numbers in its plane; of the series up to a tenth of a radian 1e-12 is promised,
    beyond that the sine's own error.
    """
    random = np.random.default_rng(3)
    angle = np.concatenate(
        [np.linspace(0, 0.3, 61), random.uniform(0.0999, 0.1001, 40), random.uniform(0.3, 40, 99)]
    )
    place = random.normal(0, 1, (angle.size, 3))
    place /= np.linalg.norm(place, axis=1, keepdims=True)
    way = np.cross(place, random.normal(0, 1, place.shape))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    found = np.zeros((angle.size, 6))
    _along(place, way, angle[:, None], found)
    turn = np.exp(1j * angle)[:, None]
    np.testing.assert_allclose(
        found[:, :3], turn.real * place + turn.imag * way, rtol=0, atol=5e-12
    )
    np.testing.assert_allclose(
        found[:, 3:], turn.real * way - turn.imag * place, rtol=0, atol=5e-12
    )


@ti.kernel
def _tracker(legs: Legs, first: ti.i32, last: ti.i32, time: Table, found: Table):
    for i in range(time.shape[0]):
        p, u, rate = follower.tracker_at(legs, first, last, time[i, 0])
        for d in ti.static(range(3)):
            found[i, d], found[i, 3 + d] = p[d], rate * u[d]


def ways() -> list[Path]:
    """Return two ways: the second stays for a while in the middle, and begins at 1000 s."""
    places = np.stack([unit(12.3, 55.1), unit(12.9, 54.8), unit(12.9, 54.8), unit(11.7, 54.2)])
    return [
        Path(np.array([0.0, 700.0]), np.stack([unit(10, 50), unit(11, 51)])),
        Path(np.array([1000.0, 4100.0, 5000.0, 9700.0]), places),
    ]


def test_a_tracker_stays_before_its_way_and_after_it() -> None:
    """Places by slerp between what it passes; velocities by differences."""
    table = tables.upload(following.legs(ways()))
    time = np.array(
        [
            -5000.0,
            0.0,
            900.0,
            1000.0,
            1700.0,
            4099.0,
            4100.0,
            4600.0,
            5000.0,
            5123.0,
            7311.0,
            9700.0,
            20_000.0,
        ]
    )
    found = np.zeros((time.size, 6))
    _tracker(launch.pack(Legs, table), 2, 6, time[:, None], found)

    def at(when: np.ndarray) -> np.ndarray:
        own = ways()[1]
        when = np.clip(when, own.time[0], own.time[-1])
        k = np.clip(np.searchsorted(own.time, when, side="right") - 1, 0, 2)
        share = ((when - own.time[k]) / (own.time[k + 1] - own.time[k]))[:, None]
        a, b = own.place[k], own.place[k + 1]
        whole = np.maximum(
            np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1)), 1e-9
        )[:, None]
        mixed = (np.sin((1 - share) * whole) * a + np.sin(share * whole) * b) / np.sin(whole)
        return np.where(k[:, None] == 1, a, mixed)

    np.testing.assert_allclose(found[:, :3], at(time), rtol=0, atol=1e-12)
    inside = ~np.isin(time, [1000.0, 4100.0, 5000.0, 9700.0])
    slope = (at(time + 0.5) - at(time - 0.5)) / 1.0
    np.testing.assert_allclose(found[inside, 3:], slope[inside], rtol=0, atol=1e-12)


@ti.kernel
def _act(cloud: Cloud, rules: Rules, legs: Legs, seed0: ti.u32, seed1: ti.u32):
    for i in range(cloud.own_real.shape[0]):
        follower.act(cloud, rules, legs, i, 0, 0, 2, 5, seed0, seed1)


LAW = {
    Rule.CHANGE: 0.35, Rule.SEEK: 0.2, Rule.HIDE: 0.15, Rule.LEAVE: 0.45, Rule.SOONEST: 300.0, Rule.LATEST: 1300.0,
    Rule.SPREAD: 0.4, Rule.FASTEST: 2e-6,
}  # fmt: skip


def acted(mode: int, n: int = 20_000) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return particles before they act and after, real numbers and whole ones; all alike, but for
    their serial numbers.
    """
    real, whole = np.zeros((n, Own.REAL)), np.zeros((n, Own.WHOLE), np.int32)
    place = unit(10.4, 50.9)
    real[:, Own.PLACE : Own.PLACE + 3], real[:, Own.WAY : Own.WAY + 3] = (
        place,
        heading(place, 213.0),
    )
    real[:, Own.RATE], real[:, Own.SINCE], real[:, Own.DUE] = 1.3e-6, 100.0, 2500.0
    whole[:, Own.MODE], whole[:, Own.SERIAL], whole[:, Own.ACTS] = mode, np.arange(n), 4
    rule = np.zeros((1, Rule.REAL))
    for column, value in LAW.items():
        rule[0, column] = value
    cloud = {"own_real": tables.upload(real), "own_whole": tables.upload(whole)}
    legs = tables.upload(following.legs(ways()))
    _act(
        launch.pack(Cloud, *cloud.values()),
        launch.pack(Rules, tables.upload(rule)),
        launch.pack(Legs, legs),
        *noise.key(SEED),
    )
    return real, whole, cloud["own_real"].to_numpy(), cloud["own_whole"].to_numpy()


@pytest.mark.parametrize("mode", [SEEKING, HIDING])
def test_one_that_leaves_what_it_was_about_keeps_course_and_speed(mode: int) -> None:
    """It takes another at an act of its own: to leave is one act. The others stay about it."""
    before, _, after, whole = acted(mode)
    left = whole[:, Own.MODE] == ACTING
    n = left.size
    assert abs(left.mean() - LAW[Rule.LEAVE]) < 4 * np.sqrt(0.25 / n)
    assert (whole[~left, Own.MODE] == mode).all()
    np.testing.assert_array_equal(after[:, Own.RATE], before[:, Own.RATE])
    gone = np.exp(1j * 1.3e-6 * 2400.0)
    p, u = (before[0, k : k + 3] for k in (Own.PLACE, Own.WAY))
    np.testing.assert_allclose(
        after[:, Own.PLACE : Own.PLACE + 3],
        np.tile(gone.real * p + gone.imag * u, (n, 1)),
        atol=1e-12,
    )
    np.testing.assert_allclose(
        after[left, Own.WAY : Own.WAY + 3],
        np.tile(gone.real * u - gone.imag * p, (left.sum(), 1)),
        atol=1e-12,
    )
    assert (after[:, Own.SINCE] == 2500.0).all()


def test_one_that_is_free_does_one_thing_of_four() -> None:
    """Shares by the law; only who takes another course has another speed; when each acts next is
    uniform and says nothing of it.
    """
    before, _, after, whole = acted(ACTING)
    n = len(after)
    gone = np.exp(1j * 1.3e-6 * 2400.0)
    p, u = (before[0, k : k + 3] for k in (Own.PLACE, Own.WAY))
    same = (
        np.abs(after[:, Own.WAY : Own.WAY + 3] - (gone.real * u - gone.imag * p)).max(axis=1) < 1e-9
    )
    free = whole[:, Own.MODE] == ACTING
    shares = {
        "changes": (free & ~same, 0.35), "keeps": (free & same, 0.3), "seeks": (whole[:, Own.MODE] == SEEKING, 0.2),
        "hides": (whole[:, Own.MODE] == HIDING, 0.15),
    }  # fmt: skip
    for name, (those, share) in shares.items():
        assert abs(those.mean() - share) < 4 * np.sqrt(share * (1 - share) / n), name
        wait = after[those, Own.DUE] - 2500.0
        assert 300 < wait.min() < 310
        assert 1290 < wait.max() < 1300
        assert abs(wait.mean() - 800) < 4 * 1000 / np.sqrt(12 * those.sum()), name
    changed = shares["changes"][0]
    assert ((after[:, Own.RATE] != 1.3e-6) == changed).all()
    assert abs(after[changed, Own.RATE].mean() - 1e-6) < 4 * 2e-6 / np.sqrt(12 * changed.sum())
    assert (whole[:, Own.ACTS] == 5).all()


@ti.kernel
def _places(angle: Ints, course: Table, found: Table, back: Ints):
    for i in range(course.shape[0]):
        p = follower.on_sphere(angle[i, 0], angle[i, 1])
        east, north = follower.frame(p)
        u = follower.headed(north, east, course[i, 0])
        for d in ti.static(range(3)):
            found[i, d], found[i, 3 + d] = p[d], u[d]
        back[i, 0], back[i, 1] = follower.binary(p)


def test_places_and_courses_are_those_of_the_sphere() -> None:
    """And back to the binary angle, but for one where it is rounded; at a pole north is along the
    meridian of 0.
    """
    random = np.random.default_rng(4)
    angle = random.integers([-(2**31), -(2**30)], [2**31, 2**30], (2000, 2)).astype(np.int32)
    angle[:3] = [[0, 2**30], [-(2**31), 5], [7, -(2**30) + 9]]
    course = random.uniform(0, 7, 2000)
    found, back = np.zeros((2000, 6)), np.zeros((2000, 2), np.int32)
    _places(angle, course[:, None], found, back)
    lon, lat = (angle * (2 * np.pi / 2**32)).T
    place = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
    east = np.stack([-np.sin(lon), np.cos(lon), np.zeros(2000)], axis=1)
    north = np.cross(place, east)
    way = np.sin(course)[:, None] * east + np.cos(course)[:, None] * north
    np.testing.assert_allclose(found, np.hstack([place, way]), rtol=0, atol=1e-11)
    off = (back.astype(np.int64) - angle + 2**31) % 2**32 - 2**31
    assert np.abs(off[3:]).max() <= 1
