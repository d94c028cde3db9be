"""What sensors tell of pieces of way, against paths in steps so fine that straight lines will do,
in NumPy.

The places of coarse steps are some of the fine ones, so that every step sees the same paths.
"""

import functools
import itertools
import math

import numpy as np
import pytest
import taichi as ti
from scipy import stats

from geo import sphere
from kernels.evidence import observe
from kernels.maths import noise
from kernels.steering import pieces
from kernels.steering.itinerary import Chance

NMI = 1852.0
K = 12 * NMI / 60  # 12 nmi a square root of an hour [m/sqrt(s)]
LON, LAT = 179.93, -38.4  # pieces cross the antimeridian
HOURS = 6.0
TURN = math.radians(25)
HALF = (15.3 * NMI, 9.1 * NMI)
RADIUS = 11.2 * NMI
WIDE = 47.7 * NMI
BENT = np.array([[-17.0, -6.0], [2.0, 5.0], [9.0, -14.0]]) * NMI

Places = ti.types.ndarray(dtype=ti.i32, ndim=2)
Told = ti.types.ndarray(dtype=ti.f32, ndim=2)


@ti.kernel
def _pieces(
    kind: ti.template(), besides: ti.template(), lon: Places, lat: Places, dt: ti.f32, k: ti.f32,
    sensor: observe.Sensor, corners: observe.HostReals, seed: ti.u32, out: Told,
):  # fmt: skip
    for i in range(lon.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = 1.0, 0.0, -1.0
        for j in range(lon.shape[1] - 1):
            piece = pieces.Piece(
                lon[i, j], lat[i, j], lon[i, j + 1], lat[i, j + 1], j * dt, (j + 1) * dt, k
            )
            r = observe.observe(
                kind, besides, piece, sensor, corners, Chance(seed, ti.u32(7), i, i, j, 0)
            )
            out[i, 1] += out[i, 0] * r[1]
            if r[2] >= 0.0 and out[i, 2] < 0.0:
                out[i, 2] = r[2]
            out[i, 0] *= r[0]


def rectangle(half):
    """Return the closed outline of a box about the origin, (5, 2)."""
    return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half


def sensor(reach, half=(1.0, 1.0), turn=0.0, tau=0.0, error=1.0, at=(LON, LAT)):
    """Return a sensor whose shape lies within a reach [m] of its middle."""
    tall = math.ceil(reach / observe.METRES)
    wide = math.ceil(
        tall / math.cos(math.radians(at[1]) + math.copysign(reach / sphere.RADIUS, at[1]))
    )
    x, y = (int(sphere.to_binary(degrees)) for degrees in at)
    west = (x - wide + 2**31) % 2**32 - 2**31
    return observe.Sensor(
        lon=x, lat=y, turn_cos=math.cos(turn), turn_sin=math.sin(turn), half_width=half[0], half_height=half[1],
        west=west, south=y - tall, width=2 * wide, height=2 * tall, tau=tau, error=error,
    )  # fmt: skip


def told(
    kind, path, hours, where, corners=None, k=K, besides=observe.WHETHER, seed=5, at=(LON, LAT)
):
    """Return (stayed, fits, when) of each path (n, m + 1, 2) [m] east and north of a place, (n, 3)."""
    x, y = sphere.destination(*np.radians(at), path[..., 0], path[..., 1])
    lon, lat = (
        np.ascontiguousarray(sphere.to_binary(np.degrees(angle)).astype(np.int32))
        for angle in (x, y)
    )
    out = np.zeros((len(path), 3), np.float32)
    corners = np.zeros((2, 2)) if corners is None else corners
    dt = 3600 * hours / (path.shape[1] - 1)
    _pieces(
        kind, besides, lon, lat, dt, k, where, corners.astype(np.float32).reshape(-1), seed, out
    )
    return out


def turned(path):
    """Return places in axes turned by TURN clockwise from north."""
    c, s = math.cos(TURN), math.sin(TURN)
    return np.stack(
        [path[..., 0] * c - path[..., 1] * s, path[..., 0] * s + path[..., 1] * c], axis=-1
    )


def side(u, v, w):
    """Return on which side of the line from u to v a place w lies: its sign."""
    return (v[..., 0] - u[..., 0]) * (w[..., 1] - u[..., 1]) - (v[..., 1] - u[..., 1]) * (
        w[..., 0] - u[..., 0]
    )


def crossings(path, corners):
    """Return which steps of paths (n, m + 1, 2), straight from place to place, cross a line of
    straight parts, (n, m).
    """
    found = np.zeros((path.shape[0], path.shape[1] - 1), bool)
    for p, q in itertools.pairwise(corners):
        left = side(p, q, path) > 0
        # they cross the whole line through both corners
        which = np.nonzero(left[:, 1:] != left[:, :-1])
        a, b = path[:, :-1][which], path[:, 1:][which]
        found[which] |= (side(a, b, p) > 0) != (side(a, b, q) > 0)
    return found


def crossed(path, corners):
    """Return which paths (n, m + 1, 2) cross a line of straight parts, (n,)."""
    return crossings(path, corners).any(axis=1)


def walks(n, steps, spread, seed, k=K):
    """Return Brownian paths over HOURS from a normal cloud [m], (n, steps + 1, 2)."""
    random = np.random.default_rng(seed)
    path = random.normal(size=(n, steps + 1, 2)) * k * math.sqrt(3600 * HOURS / steps)
    path[:, 0] = random.normal(size=(n, 2)) * spread + [3.1 * NMI, -1.7 * NMI]
    return np.cumsum(path, axis=1)


# By kind: the sensor, its corners, the spread of the cloud at the begin [m], and which fine paths
# keep things as they are.
KINDS = {
    observe.LINE: (sensor(30 * NMI), BENT, 18 * NMI, lambda path: ~crossed(path, BENT)),
    observe.BOX: (
        sensor(20 * NMI, HALF, TURN), rectangle(HALF), 25 * NMI,
        lambda path: ~(np.abs(turned(path)) < HALF).all(axis=2).any(axis=1),
    ),
    observe.IN_BOX: (
        sensor(65 * NMI, (WIDE, 0.8 * WIDE), TURN), rectangle((WIDE, 0.8 * WIDE)), 8 * NMI,
        lambda path: (np.abs(turned(path)) < (WIDE, 0.8 * WIDE)).all(axis=2).all(axis=1),
    ),
    observe.DISC: (
        sensor(RADIUS, (RADIUS, 0.0)), None, 20 * NMI, lambda path: (np.hypot(*path.T) >= RADIUS).all(axis=0),
    ),
    observe.IN_DISC: (
        sensor(WIDE, (WIDE, 0.0)), None, 8 * NMI, lambda path: (np.hypot(*path.T) < WIDE).all(axis=0),
    ),
}  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
def test_the_step_does_not_matter(kind: int) -> None:
    """The mean over 40,000 paths seen in 3, 6 and 12 steps changes by less than 1 % of what
    happens.
    """
    where, corners, spread, _ = KINDS[kind]
    path = walks(40_000, 12, spread, seed=kind + 31)
    seen = [
        told(kind, path[:, ::every], HOURS, where, corners)[:, 0].astype(float)
        for every in (4, 2, 1)
    ]
    if kind in (observe.LINE, observe.BOX, observe.DISC):
        seen = [1 - stayed for stayed in seen]
    last = seen[-1].mean()
    assert 0.1 < last < 0.9
    for coarse, fine in itertools.pairwise(seen):
        change = coarse - fine
        error = change.std() / math.sqrt(len(change))
        assert error < 0.0045 * last  # so that a change of 1 % would be seen
        assert abs(change.mean()) < 0.003 * last + 1.5 * error < 0.01 * last


@functools.cache
def _fine(kind):
    """Return what happens to fine paths, and the same paths in 4 steps."""
    n, fine = 4_000, 4 * 512
    _, _, spread, stays = KINDS[kind]
    kept, straight, coarse = [], [], []
    for part in range(6):
        path = walks(n // 6, fine, spread, seed=100 * kind + part)
        kept.append(path[:, :: fine // 4])
        straight.append(stays(path))
        coarse.append(stays(path[:, ::4]))
    return np.concatenate(kept), np.concatenate(straight), np.concatenate(coarse)


@pytest.mark.parametrize("kind", KINDS)
def test_paths_in_fine_steps_do_the_same(kind: int) -> None:
    """What paths of 2,048 steps miss falls as the root of the step: by twice that of 2,048 less
    that of 512 it is gone.
    """
    where, corners, _, _ = KINDS[kind]
    path, fine, coarse = _fine(kind)
    stayed = told(kind, path, HOURS, where, corners)[:, 0].astype(float)
    limit = 2.0 * fine - coarse
    error = (stayed - limit).std() / math.sqrt(len(limit))
    assert error < 0.012
    assert abs((stayed - limit).mean()) < 3 * error


@pytest.mark.parametrize("steps", [1, 5])
def test_five_hours_in_a_box_on_the_way(steps: int) -> None:
    """A bridge of 100 h, 12 nmi a root hour, in a box of 60 nmi over hours 35 to 40: quadrature
    says 0.01640.
    """
    n, half = 60_000, 30 * NMI
    random = np.random.default_rng(8)
    times = np.linspace(35, 40, steps + 1)
    path, here, before = [], np.zeros((n, 2)), 0.0
    for time in times:  # a bridge from 0 at hour 0 to 0 at hour 100
        share = (time - before) / (100 - before)
        here = here * (1 - share) + random.normal(size=(n, 2)) * K * math.sqrt(
            3600 * (time - before) * (1 - share)
        )
        before = time
        path.append(here)
    stayed = told(
        observe.IN_BOX,
        np.stack(path, axis=1),
        5.0,
        sensor(1.5 * half, (half, half)),
        rectangle((half, half)),
    )
    stayed = stayed[:, 0].astype(float)
    exact = _in_strip(2 * half) ** 2
    assert exact == pytest.approx(0.0164, abs=1e-4)
    error = stayed.std() / math.sqrt(n)
    assert error < 0.031 * exact
    assert abs(stayed.mean() - exact) < 3 * error


@functools.cache
def _in_strip(width):
    """Return the probability that one component of that bridge is in a strip over hours 35 to 40,
    by quadrature.
    """
    n, m = 500, np.arange(-4, 5)[:, None, None]
    a = (np.arange(n) + 0.5) / n * width
    walk = K * math.sqrt(3600 * 5)
    there = (stats.norm.pdf(a - a[:, None] + 2 * m * width, 0, walk)).sum(axis=0)
    there -= (stats.norm.pdf(a + a[:, None] + 2 * m * width, 0, walk)).sum(axis=0)
    begin = stats.norm.pdf(a - width / 2, 0, K * math.sqrt(3600 * 35 * 65 / 100))
    home, from_begin = (stats.norm.pdf(a - width / 2, 0, K * math.sqrt(3600 * h)) for h in (60, 65))
    return (begin[:, None] * there * home / from_begin[:, None]).sum() * (width / n) ** 2


@pytest.mark.parametrize(("k", "exact"), [(12, 5.576e-4), (24, 0.1537)])
@pytest.mark.parametrize("steps", [25, pytest.param(100, marks=pytest.mark.thorough)])
def test_a_bridge_crosses_a_line_with_the_probability_of_equation_10(
    k: int, exact: float, steps: int
) -> None:
    """323 nmi off the equator at the begin, 167 nmi at the end, 100 h apart; the time of the touch
    as equation 11 has it.
    """
    n, wanders, end = 30_000, k * NMI / 60, 100 * 3600.0
    random = np.random.default_rng(k + steps)
    time = np.linspace(0, end, steps + 1)
    path = np.zeros((n, steps + 1, 2))
    path[:, 1:] = random.normal(size=(n, steps, 2)) * wanders * math.sqrt(end / steps)
    path = np.cumsum(path, axis=1)
    path -= time[:, None] / end * path[:, -1:]
    path[..., 1] += 323 * NMI + time / end * (167 - 323) * NMI
    far = np.array([[-1500.0, 0.0], [1500.0, 0.0]]) * NMI
    at = (LON, 0.0)
    found = told(
        observe.LINE, path, 100.0, sensor(1500 * NMI, at=at), far, wanders, observe.WHEN, at=at
    )
    touched = 1 - found[:, 0].astype(float)
    error = touched.std() / math.sqrt(n)
    assert np.exp(-2 * 323 * 167 / (k**2 * 100)) == pytest.approx(exact, rel=5e-4)
    # 300 nmi from the middle of its plane the bridge's places are 0.13 % off, and K by as much: 0.5
    # % of the probability
    assert abs(touched.mean() - exact) < 3 * error + 0.005 * exact
    when = found[found[:, 2] >= 0, 2]
    assert abs(len(when) / n - exact) < 3 * math.sqrt(exact / n) + 0.005 * exact
    if k == 24:
        # equation 11 in the clock u / (1 - u), given the touch
        scale = (323 * NMI / wanders) ** 2 / end
        law = stats.invgauss(mu=323 / 167 / scale, scale=scale)
        share = when / end
        assert stats.kstest(law.cdf(share / (1 - share)), "uniform").statistic < 1.63 / math.sqrt(
            len(when)
        )


@pytest.mark.thorough
def test_a_report_finds_the_first_touch_in_time() -> None:
    """Fits are the mean density of the report over the time of the first touch, drawn from fine
    paths; any step tells the same.
    """
    where, corners, spread, _ = KINDS[observe.LINE]
    tau, error = 2.4 * 3600, 900.0
    where = sensor(30 * NMI, tau=tau, error=error)
    path = walks(12_000, 12, spread, seed=77)
    fits = [
        told(observe.LINE, path[:, ::every], HOURS, where, corners, besides=observe.REPORT)[
            :, 1
        ].astype(float)
        for every in (4, 2, 1)
    ]
    when = told(observe.LINE, path, HOURS, where, corners, besides=observe.WHEN)[:, 2].astype(float)
    drawn = np.where(when >= 0, stats.norm.pdf(when, tau, error), 0.0)
    for seen in fits:
        apart = seen - drawn
        assert abs(apart.mean()) < 3 * apart.std() / math.sqrt(len(apart)) + 0.003 * drawn.mean()
    # the times themselves, from paths in steps of 7 s
    fine = walks(1_500, 3072, spread, seed=78)
    at = crossings(fine, BENT)
    first = np.where(at.any(axis=1), (at.argmax(axis=1) + 0.5) * HOURS * 3600 / 3072, -1.0)
    own = told(observe.LINE, fine[:, ::768], HOURS, where, corners, besides=observe.WHEN)[
        :, 2
    ].astype(float)
    for low, high in ((0, 3600), (3600, 7200), (7200, 21600)):
        p, q = (((t >= low) & (t < high)).mean() for t in (first, own))
        # 3 standard errors of both, and what steps of 7 s see late and miss: 1 in 50
        assert abs(p - q) < 3 * math.sqrt((p + q) / len(fine)) + 0.02 * p


def test_a_straight_way_touches_at_its_own_time() -> None:
    """Ships at 17 kn across a great circle, off it and past its end; the same with the piece cut."""
    at, line = (LON, 61.3), np.array([[-40.0, -22.0], [35.0, 30.0]]) * NMI
    where = sensor(60 * NMI, at=at, tau=1800.0, error=300.0)
    begin = np.array([[-20.0, 10.0], [20.0, 25.0], [-20.0, 60.0], [45.0, 30.0]]) * NMI
    end = np.array([[1.0, -13.0], [12.0, 40.0], [-20.0, 20.0], [40.0, -10.0]]) * NMI
    # the share of the way after which it meets the line, by hand
    d = line[1] - line[0]
    side = [(d[0] * (p - line[0])[:, 1] - d[1] * (p - line[0])[:, 0]) for p in (begin, end)]
    share = side[0] / (side[0] - side[1])
    meets = [True, False, False, False]
    for cuts in (1, 7):
        path = begin[:, None] + (end - begin)[:, None] * np.linspace(0, 1, cuts + 1)[:, None]
        seen = told(observe.LINE, path, 1.5, where, line, 0.0, observe.WHEN, at=at)
        assert (seen[:, 0] == 0).tolist() == meets
        assert seen[0, 2] == pytest.approx(share[0] * 5400, abs=2.0)
        fits = told(observe.LINE, path, 1.5, where, line, 0.0, observe.REPORT, at=at)[:, 1]
        assert fits[0] == pytest.approx(stats.norm.pdf(share[0] * 5400, 1800, 300), rel=0.02)
        assert (fits[1:] == 0).all()


@pytest.mark.thorough
def test_noise_is_that_of_its_key() -> None:
    """The same seed gives the same bits; another one others, and the same mean."""
    where, corners, spread, _ = KINDS[observe.LINE]
    path = walks(40_000, 2, spread, seed=3)
    one, same, other = (
        told(observe.LINE, path, HOURS, where, corners, seed=seed)[:, 0] for seed in (1, 1, 2)
    )
    assert (one == same).all()
    assert (one != other).mean() > 0.1
    apart = one.astype(float) - other
    assert abs(apart.mean()) < 3 * apart.std() / math.sqrt(len(apart))
    assert noise.STREAM_TOUCH < 16


def test_what_is_passed_over_as_far_away_touches_nothing() -> None:
    """At any latitude and across the antimeridian: the same bits as where nothing is passed over."""
    random = np.random.default_rng(12)
    for at in ((179.8, 84.0), (-31.0, -71.5), (12.0, 0.4), (-179.7, -33.0)):
        n = 4_000
        begin = random.normal(size=(n, 1, 2)) * 50 * NMI
        path = np.concatenate([begin, begin + random.normal(size=(n, 1, 2)) * 40 * NMI], axis=1)
        near = sensor(30 * NMI, at=at)
        everywhere = sensor(30 * NMI, at=at)
        everywhere.west, everywhere.width, everywhere.south, everywhere.height = (
            -(2**31),
            2**32 - 1,
            -(2**30),
            2**31,
        )
        for k in (0.0, K / 4, K):
            one, other = (
                told(observe.LINE, path, 1.0, where, BENT, k, at=at)[:, 0]
                for where in (near, everywhere)
            )
            assert 0.01 < (one < 1).mean() < 0.6
            # what is passed over would have touched with at most exp(-18) = 2e-8 a part
            np.testing.assert_allclose(one, other, atol=1e-6)
