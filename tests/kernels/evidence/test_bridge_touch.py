"""Bridges and lines, strips and boxes in the plane, against SciPy and sums written out in float64."""

import numpy as np
import pytest
import taichi as ti
from scipy import stats

from kernels.evidence import bridge_touch as touch
from kernels.step.coast import Reals

RNG = np.random.default_rng(23)
f32x2 = ti.types.vector(2, ti.f32)


@ti.kernel
def _lines(before: Reals, after: Reals, variance: Reals, share: Reals, out: Reals):
    for i in range(before.shape[0]):
        out[3 * i] = touch.line(before[i], after[i], variance[i])
        out[3 * i + 1] = touch.by(before[i], after[i], variance[i], share[i])
        out[3 * i + 2] = touch.strip(before[i], after[i], 1700.0, variance[i])


def _asked(before, after, variance, share):
    out = np.zeros(3 * len(before), np.float32)
    _lines(*(np.asarray(x, np.float32) for x in (before, after, variance, share)), out)
    return out.reshape(-1, 3).T


def test_the_time_of_the_first_touch_is_inverse_gaussian() -> None:
    """In the clock u / (1 - u) a bridge is Brownian motion with drift:

    SciPy has its law, also for bridges that come back.
    """
    n = 3000
    before = RNG.uniform(20, 1500, n) * RNG.choice([-1, 1], n)
    after, variance, share = (
        RNG.normal(0, 900, n),
        RNG.uniform(150, 1600, n) ** 2,
        RNG.uniform(0.02, 0.98, n),
    )
    touched, gone, _ = _asked(before, after, variance, share)
    other_side = before * after < 0
    whole = np.where(other_side, 1.0, np.exp(-2 * before * after / variance))
    # Of scale b^2 / v and mean b / |a|: SciPy counts the mean in units of the scale.
    scale = before**2 / variance
    law = stats.invgauss(mu=np.abs(before / after) / scale, scale=scale)
    exact = whole * law.cdf(share / (1 - share))
    np.testing.assert_allclose(touched, whole, atol=2e-6)
    # float32 and an erfc right to 1.2e-7, in sums of two
    np.testing.assert_allclose(gone, exact, atol=4e-6)
    assert 0.2 < other_side.mean() < 0.8
    assert (gone > 0.05).mean() > 0.2


def test_a_straight_way_touches_a_line_where_it_crosses_it() -> None:
    before, after = np.array([310.0, -310.0, 310.0, 0.0]), np.array([-77.0, 77.0, 77.0, 90.0])
    touched, early, _ = _asked(before, after, np.zeros(4), np.full(4, 0.80 - 1e-3))
    _, late, _ = _asked(before, after, np.zeros(4), np.full(4, 0.80 + 1e-2))
    assert touched.tolist() == [1, 1, 0, 1]
    assert early.tolist() == [0, 0, 0, 1]  # 310 / 387 = 0.801
    assert late.tolist() == [1, 1, 0, 1]


def test_a_strip_is_stayed_in_by_all_its_images() -> None:
    """All images of a float64 sum; far beyond where the kernel changes to eigenfunctions, which see
    no images.
    """
    n, width = 6000, 1700.0
    before, after = RNG.uniform(0, width, (2, n))
    ratio = np.exp(RNG.uniform(np.log(1e-4), np.log(6), n))  # variance by the square of the width
    _, _, stays = _asked(before, after, ratio * width**2, np.ones(n))
    m, (a, b) = (
        np.arange(-60, 61)[:, None],
        (x.astype(np.float32) / np.float64(width) for x in (before, after)),
    )
    a, b = np.asarray(a), np.asarray(b)
    exact = (np.exp(-2 * m * (m + b - a) / ratio) - np.exp(-2 * (m + a) * (m + b) / ratio)).sum(
        axis=0
    )
    # float32: the exponent 2 a b / ratio is right to 1e-6 of itself, and counts while it is below
    # 10
    np.testing.assert_allclose(stays, exact, atol=1e-5)
    large = (exact > 1e-4) & (ratio > 0.5)
    assert large.sum() > 200
    np.testing.assert_allclose(stays[large], exact[large], rtol=1e-4)


@pytest.mark.parametrize(("before", "after"), [(-1.0, 500.0), (500.0, 1701.0), (0.0, 300.0)])
def test_a_strip_is_not_stayed_in_from_outside(before: float, after: float) -> None:
    for variance in (0.0, 300.0**2, 4000.0**2):
        assert _asked([before], [after], [variance], [1.0])[2] == 0
    assert _asked([500.0], [900.0], [0.0], [1.0])[2] == 1


@ti.kernel
def _known(a: Reals, b: Reals, variance: ti.f32, corners: Reals, radius: ti.f32, out: Reals):
    for i in range(a.shape[0] // 2):
        p, q = f32x2(a[2 * i], a[2 * i + 1]), f32x2(b[2 * i], b[2 * i + 1])
        bent, round_ = touch.polyline(p, q, variance, corners), touch.disc(p, q, radius, variance)
        for j in ti.static(range(2)):
            out[4 * i + j] = bent[j]
            out[4 * i + 2 + j] = round_[j]


def test_straight_ways_touch_what_shapely_says() -> None:
    """A bent line and a disc, by ways without noise from everywhere to everywhere."""
    import shapely

    n = 3000
    corners = np.array([[-900, -310], [-120, 270], [480, -50], [1010, 640]], np.float32)
    a, b = RNG.normal(0, 900, (2, n, 2)).astype(np.float32)
    out = np.zeros(4 * n, np.float32)
    _known(a.reshape(-1), b.reshape(-1), 0.0, corners.reshape(-1), 655.0, out)
    bent, round_ = shapely.LineString(corners), shapely.Point(0, 0)
    for p, q, (state, touched, state_disc, met) in zip(a, b, out.reshape(-1, 4), strict=True):
        way = shapely.LineString([p, q])
        assert state != touch.OPEN
        assert touched == way.intersects(bent)
        far = np.hypot(*p) > 655, np.hypot(*q) > 655
        if all(far):
            assert state_disc != touch.OPEN
            assert met == (way.distance(round_) < 655)
