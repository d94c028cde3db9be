"""Crossings of a line: the paper's figures, the formulas as printed, and simulated paths."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, optimize, stats

from drift.tracking.bridges import bridge as bridges
from drift.tracking.bridges import crossing, line
from geo import sphere

NMI = 1852.0
HOUR = 3600.0
DEGREE = math.radians(1) * 6_371_008.8 / NMI  # [nmi]


def rate(nmi_per_root_hour: float) -> float:
    """K [m/sqrt(s)]."""
    return nmi_per_root_hour * NMI / 60


@pytest.mark.parametrize(("k", "expected"), [(12, 5.576e-4), (24, 0.1537)])
def test_equation_10_with_the_papers_distances(k: float, expected: float) -> None:
    """323 and 167 nmi off the line, 100 h (Figure 4a); the figures are exp(-2 * 323 * 167 / (100
    K^2)), evaluated by hand.
    """
    assert line.crossed(323 * NMI, 167 * NMI, rate(k), 100 * HOUR) == pytest.approx(
        expected, rel=3e-4
    )
    assert line.crossed(-323 * NMI, -167 * NMI, rate(k), 100 * HOUR) == pytest.approx(
        math.exp(-2 * 323 * 167 / (100 * k**2)), rel=1e-12
    )


@pytest.mark.parametrize(
    ("k", "expected"), [(12, (54.41, 70.58, 83.02)), (24, (36.15, 65.53, 87.83))]
)
def test_equation_11_with_the_papers_distances(k: float, expected: tuple[float, ...]) -> None:
    """435 and 165 nmi on either side, 100 h (Figure 6): 5, 50 and 95 % of the hitting time."""
    for share, hours in zip((0.05, 0.5, 0.95), expected, strict=True):
        found = optimize.brentq(
            lambda t, share=share: (
                line.touched(435 * NMI, -165 * NMI, rate(k), 100 * HOUR, t) - share
            ),
            0,
            100 * HOUR,
        )
        assert found / HOUR == pytest.approx(hours, abs=0.005)


def printed(a: float, b: float, k: float, whole: float, t: float) -> float:
    """Equation 11 as printed, a and b being absolute distances on either side."""
    root = math.sqrt(k**2 * whole * (whole - t) * t)
    first = math.exp(2 * a * b / (k**2 * whole)) * stats.norm.cdf(-(a * (whole - t) + t * b) / root)
    return first + 1 - stats.norm.cdf((a * (whole - t) - t * b) / root)


@given(st.floats(1, 900), st.floats(1, 900), st.floats(0.01, 0.99), st.floats(0.3, 3.0))
def test_equation_11_as_printed(a: float, b: float, share: float, relative: float) -> None:
    """Where its exponential does not overflow:

    K such that the spread is of the order of the distances.
    """
    whole = 77.0
    k = relative * math.sqrt(a * b / whole)
    expected = printed(a, b, k, whole, share * whole)
    assert float(line.touched(a, -b, k, whole, share * whole)) == pytest.approx(
        expected, rel=1e-9, abs=1e-12
    )
    assert float(line.touched(-a, b, k, whole, share * whole)) == pytest.approx(
        expected, rel=1e-9, abs=1e-12
    )


@pytest.mark.parametrize("k", [1.0, 1e-2, 1e-5, 1e-9, 1e-160, 0.0])
def test_a_small_spread_neither_overflows_nor_misses(k: float) -> None:
    """At K = 1 the exponential of equation 11 is exp(1,435).

    As K goes to 0 it crosses at 435 / 600 of the time.
    """
    root = (
        rate(k) * math.sqrt(100 * HOUR * 0.725 * 0.275) / (600 * NMI / (100 * HOUR))
    )  # of the time, from the mean's speed
    for deviations in (-3.0, -1.0, 2.0):
        t = 72.5 * HOUR + deviations * root
        if not 1e-3 < root < HOUR:  # below it the time itself is no finer
            continue
        found = float(line.touched(435 * NMI, -165 * NMI, rate(k), 100 * HOUR, t))
        assert found == pytest.approx(stats.norm.cdf(deviations), abs=1.5 * root / HOUR + 1e-6)
    times = np.array([0.0, 20.0, 72.4, 72.6, 99.0, 100.0]) * HOUR
    found = line.touched(435 * NMI, -165 * NMI, rate(k), 100 * HOUR, times)
    assert np.diff(found).min() >= 0
    if k < 0.1:
        assert found == pytest.approx([0, 0, 0, 1, 1, 1])
    assert float(line.crossed(323 * NMI, 167 * NMI, rate(k), 100 * HOUR)) == 0


@given(st.floats(1, 500), st.floats(1, 500), st.floats(0.05, 0.95))
def test_touch_by_a_time_of_ends_on_one_side_is_an_integral(
    a: float, b: float, share: float
) -> None:
    """Over where the bridge is then, below the line or above it with a touch before (equation 10)."""
    whole, k = 31.0, 0.9 * math.sqrt(a * b / 31.0)
    t = share * whole
    mean, std = a * (1 - share) + b * share, k * math.sqrt(t * (whole - t) / whole)
    expected = stats.norm.cdf(-mean / std) + integrate.quad(
        lambda y: math.exp(-2 * a * y / (k**2 * t)) * stats.norm.pdf(y, mean, std), 0, mean + 9 * std, epsabs=1e-10, limit=200
    )[0]  # fmt: skip
    assert float(line.touched(a, b, k, whole, t)) == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("arrival", [-165.0, 167.0])
def test_against_simulated_paths(arrival: float) -> None:
    """Whether 2,000 paths of 800 steps touch the line: at lattice points, and within a step with
    Levy's probability.
    """
    rng = np.random.default_rng(23)
    count, steps, whole, k, a = 2000, 800, 100.0, 24.0, 323.0
    dt = whole / steps
    walk = np.cumsum(rng.normal(0, k * math.sqrt(dt), (count, steps)), axis=1)
    t = dt * np.arange(1, steps + 1)
    place = np.column_stack(
        [np.full(count, a), a + walk + (arrival - a - walk[:, -1:]) * t / whole]
    )
    before, after = place[:, :-1], place[:, 1:]
    same = (before > 0) & (after > 0)
    within = np.exp(-2 * np.where(same, before * after, 0.0) / (k**2 * dt))
    survives = np.cumprod(np.where(same, 1 - within, 0.0), axis=1)
    for step in (steps // 3, 2 * steps // 3, steps):
        touched = 1 - survives[:, step - 1]
        expected = float(line.touched(a, arrival, k, whole, step * dt))
        assert touched.mean() == pytest.approx(
            expected, abs=3 * max(touched.std(), 0.01) / math.sqrt(count)
        )


def test_on_the_line_at_once() -> None:
    assert float(line.touched(0.0, 55.0, 3.0, 10.0, 0.0)) == 1
    assert float(line.touched(40.0, 0.0, 3.0, 10.0, 10.0)) == pytest.approx(1)
    assert float(line.touched(40.0, 55.0, 3.0, 10.0, 0.0)) == 0


def test_distance_from_a_great_circle() -> None:
    """By the triangle of its pole; the equator's is the latitude, a meridian's is asin(cos(lat)
    sin(dlon)). Left is positive.
    """
    equator = crossing.through("equator", [10.0, 40.0], [0.0, 0.0])
    assert crossing.distance(
        equator, np.radians([170.0, -70.0]), np.radians([12.0, -3.5])
    ) / NMI == pytest.approx([12.0 * DEGREE, -3.5 * DEGREE])
    # northward: west of it is left
    meridian = crossing.through("meridian", [-20.0, -20.0], [5.0, 50.0])
    expected = (
        math.degrees(math.asin(math.cos(math.radians(33.0)) * math.sin(math.radians(4.2)))) * DEGREE
    )
    assert crossing.distance(
        meridian, math.radians(-24.2), math.radians(33.0)
    ) / NMI == pytest.approx(expected)


def test_known_ends_near_each_other_have_the_closed_form() -> None:
    """Equation 10 with the sphere's distances, no integration error; with way points, legs
    multiply.
    """
    parallel = crossing.through("equator", [0.0, 30.0], [0.0, 0.0])
    one = bridges.between([1.0, 3.5, 5.0], [1.1, 0.8, 1.3], [0.0, 30 * HOUR, 50 * HOUR], rate(9))
    found = crossing.at_all(crossing.crossing(one, parallel))
    d = [1.1 * DEGREE, 0.8 * DEGREE, 1.3 * DEGREE]
    first, second = math.exp(-2 * d[0] * d[1] / (81 * 30)), math.exp(-2 * d[1] * d[2] / (81 * 20))
    assert found.error == 0
    assert found.value == pytest.approx(1 - (1 - first) * (1 - second), rel=1e-9)


def test_the_papers_example_on_the_earth() -> None:
    """Ends 600 nmi apart along a meridian, either side of the equator: the plane's percentiles
    within 0.1 h.

    The mean way crosses the line square, so that only the spread along counts, which is as in the
    plane. The way is cut into parts, whose places are drawn: three standard errors of integration,
    turned into time by the slope of F.
    """
    equator = crossing.through("equator", [-3.0, 8.0], [0.0, 0.0])
    one = bridges.between([2.0, 2.0], [-435 / DEGREE, 165 / DEGREE], [0.0, 100 * HOUR], rate(24))
    seen = crossing.crossing(one, equator)
    for share, hours in zip((0.05, 0.5, 0.95), (36.15, 65.53, 87.83), strict=True):
        error = crossing.by(seen, hours * HOUR).error
        slope = float(
            np.diff(line.touched(435, -165, 24, 100, np.array([hours - 0.5, hours + 0.5])))[0]
        )
        assert 0 < error < 5e-4
        assert crossing.percentile(seen, share) / HOUR == pytest.approx(
            hours, abs=3 * error / slope + 0.005
        )


def test_uncertain_ends_are_integrated_over() -> None:
    """Against dblquad over both distances, correlated, on a small bridge beside the equator."""
    mean, k, span = np.array([30.0, 22.0]) * NMI, rate(3.1), 26 * HOUR
    sd, r = np.array([14.0, 9.0]) * NMI, 0.45
    cross = np.zeros((4, 4))
    cross[1, 1], cross[3, 3], cross[1, 3] = sd[0] ** 2, sd[1] ** 2, r * sd[0] * sd[1]
    cross[3, 1] = cross[1, 3]
    equator = crossing.through("equator", [-3.0, 8.0], [0.0, 0.0])
    one = bridges.between([0.0, 0.4], np.degrees(mean / 6_371_008.8), [0.0, span], k, cross)
    seen = crossing.crossing(one, equator)
    normal = stats.multivariate_normal(mean / NMI, cross[1::2, 1::2] / NMI**2)
    for elapsed in (0.6 * span, span):
        u, v = (
            np.linspace(m - 6 * s, m + 6 * s, 801)
            for m, s in zip(mean / NMI, sd / NMI, strict=True)
        )
        a, b = np.meshgrid(u, v, indexing="ij")
        values = line.touched(a * NMI, b * NMI, k, span, elapsed) * normal.pdf(np.stack([a, b], -1))
        expected = integrate.trapezoid(integrate.trapezoid(values, v), u)
        found = crossing.by(seen, elapsed)
        assert 0 < found.error < 1e-3
        # 801 points over a jump of the integrand at a = 0 err by half a cell, 0.1 nmi of 14: 0.003
        # of its density there
        assert found.value == pytest.approx(expected, abs=4 * found.error + 2e-4)


def test_a_long_way_beside_a_line_bends_with_the_earth() -> None:
    """3,000 nmi along 20 N, a great circle that bulges to 22.5 N: the plane's formula says half as
    much again.

    Simulated by parts of the joint law that are twenty times finer, touches in between by Levy;
    three standard errors of both.
    """
    rng = np.random.default_rng(77)
    far = 3000 / DEGREE / math.cos(math.radians(20))
    one = bridges.between([0.0, far], [20.0, 20.0], [0.0, 300 * HOUR], rate(16))
    north = crossing.through("north", [0.0, far], [25.5, 25.5])
    seen = crossing.at_all(crossing.crossing(one, north))
    time = np.linspace(0, 300 * HOUR, 201)
    place, covariance = bridges.joint(one, time)
    value, vector = np.linalg.eigh(covariance)
    strays = rng.normal(size=(3000, value.size)) @ (vector * np.sqrt(np.maximum(value, 0))).T
    lon, lat = sphere.destination(
        place.lon, place.lat, *np.moveaxis(strays.reshape(3000, 201, 2), -1, 0)
    )
    distance = crossing.distance(north, lon, lat)
    before, after = distance[:, :-1], distance[:, 1:]
    same = before * after > 0
    within = np.exp(-2 * np.where(same, before * after, 0.0) / (rate(16) ** 2 * np.diff(time)))
    touched = 1 - np.prod(np.where(same, 1 - within, 0.0), axis=1)
    error = math.hypot(touched.std() / math.sqrt(3000), seen.error)
    assert seen.value == pytest.approx(touched.mean(), abs=3 * error)
    plane = float(line.crossed(*crossing.distance(north, one.lon, one.lat), rate(16), 300 * HOUR))
    assert plane - seen.value > 5 * error


def test_percentiles_of_what_is_hardly_ever_touched() -> None:
    """They are of the touch, given that there is one; NaN where there is none."""
    one = bridges.between([0.0, 2.0], [2.2, 1.7], [0.0, 20 * HOUR], rate(8))
    equator = crossing.through("equator", [0.0, 9.0], [0.0, 0.0])
    seen = crossing.crossing(one, equator)
    whole = crossing.at_all(seen).value
    assert 0 < whole < 0.05
    for share in (0.2, 0.9):
        assert crossing.by(seen, crossing.percentile(seen, share)).value == pytest.approx(
            share * whole, rel=1e-4
        )
    assert crossing.by(seen, -1.0).value == 0
    still = crossing.crossing(bridges.between([0.0, 2.0], [2.2, 1.7], [0.0, 72e3], 0.0), equator)
    assert crossing.at_all(still) == crossing.Chance(0.0, 0.0)
    assert math.isnan(crossing.percentile(still, 0.5))
    with pytest.raises(ValueError, match="between 0 and 100"):
        crossing.percentile(seen, 1.0)


def test_the_same_question_has_the_same_answer() -> None:
    one = bridges.between([0.0, 12.0], [3.0, 4.0], [0.0, 90 * HOUR], rate(8))
    equator = crossing.through("equator", [0.0, 9.0], [0.0, 0.0])
    assert crossing.at_all(crossing.crossing(one, equator)) == crossing.at_all(
        crossing.crossing(one, equator)
    )


@pytest.mark.parametrize(
    ("lon", "lat", "words"),
    [
        ([3.0, 3.0], [50.0, 50.0], "are one place"),
        ([3.0, -177.0], [50.0, -50.0], "are opposite each other"),
        ([3.0], [50.0], "two positions; given 1"),
        ([3.0, 4.0], [50.0, 97.0], "outside -90 to 90"),
    ],
)
def test_what_is_no_line_is_refused(lon: list[float], lat: list[float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        crossing.through("x", lon, lat)
