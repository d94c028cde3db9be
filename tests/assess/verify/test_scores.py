"""Proper scores of particles: closed forms of a bivariate normal, and brute force in float64."""

import math

import numpy as np
import pytest
from scipy import special, stats

from drift.assess.verify import scores
from drift.assess.verify import text as verification_text

COUNT = 6000


def cloud(seed: int, std: float, count: int = COUNT):
    """Return particles of a round normal law about (2,300 m, -900 m), with equal weights."""
    rng = np.random.default_rng(seed)
    return (
        rng.normal(2300.0, std, count),
        rng.normal(-900.0, std, count),
        np.full(count, 1 / count),
    )


def test_energy_score_of_a_normal_law():
    """The mean distance is Rice's, and two particles are s sqrt(pi) apart on average."""
    x, y, weight = cloud(3, 1700.0)
    r, s = math.hypot(2300.0, 900.0), 1700.0
    rice = s * math.sqrt(math.pi / 2) * special.hyp1f1(-0.5, 1, -(r**2) / (2 * s**2))
    expected = rice - s * math.sqrt(math.pi) / 2
    # standard deviations of both mean distances; of pairs, twice that of the first projection,
    # whose variance is less than a quarter of that of the distance of a pair
    single = math.sqrt(r**2 + 2 * s**2 - rice**2)
    pair = s * math.sqrt(4 - math.pi)
    assert scores.energy_score(x, y, weight) == pytest.approx(
        expected, abs=3 * (single + pair / 2) / math.sqrt(COUNT)
    )


def test_energy_score_of_few_particles_is_that_of_all_pairs():
    rng = np.random.default_rng(8)
    x, y, weight = rng.normal(0, 900, 13), rng.normal(300, 400, 13), rng.random(13)
    pairs = [(i, j) for i in range(13) for j in range(13) if i != j]
    among = np.array([math.hypot(x[i] - x[j], y[i] - y[j]) for i, j in pairs])
    both = np.array([weight[i] * weight[j] for i, j in pairs])
    alone = np.average(np.hypot(x, y), weights=weight)
    expected = alone - 0.5 * np.average(among, weights=both)
    assert scores.energy_score(x, y, weight) == pytest.approx(expected, rel=1e-12)


def test_energy_score_of_one_position_is_its_distance():
    at = np.full(40, 3000.0), np.full(40, -4000.0), np.full(40, 1 / 40)
    assert scores.energy_score(*at) == pytest.approx(5000.0)
    assert scores.energy_score(np.array([3.0]), np.array([4.0]), np.ones(1)) == 5.0


def test_log_score_is_that_of_the_stated_kernels():
    """Against a mixture by scipy, of an oblique, weighted cloud whose middle is elsewhere."""
    rng = np.random.default_rng(5)
    x = rng.normal(1500, 800, 300)
    y = 0.7 * x + rng.normal(-400, 250, 300)
    weight = rng.gamma(2.0, size=300)
    share = weight / weight.sum()
    covariance = np.cov(x, y, aweights=share, ddof=0) + scores.LEAST * np.eye(2)
    kernel = stats.multivariate_normal(cov=covariance * 300 ** (-1 / 3))
    density = float(share @ kernel.pdf(np.stack([x, y], axis=1)))
    assert scores.log_score(x, y, weight) == pytest.approx(math.log(density * 1e6), rel=1e-10)


def test_log_score_of_a_normal_law():
    """Smoothed by its kernels a normal law is a normal law, (1 + n^(-1/3)) times as wide in
    variance.
    """
    s = 1700.0
    x, y, weight = cloud(4, s)
    wide = s**2 * (1 + COUNT ** (-1 / 3))
    expected = math.exp(-(2300.0**2 + 900.0**2) / (2 * wide)) / (2 * math.pi * wide)
    kernel = stats.multivariate_normal(cov=s**2 * COUNT ** (-1 / 3) * np.eye(2))
    scatter = kernel.pdf(np.stack([x, y], axis=1)).std() / math.sqrt(COUNT)
    # the width of the kernels is estimated: relative standard error 1 / sqrt(2 n) a component
    relative = 3 * (scatter / expected + 1 / math.sqrt(COUNT))
    assert scores.log_score(x, y, weight) == pytest.approx(math.log(expected * 1e6), abs=relative)


def test_far_outside_the_log_score_is_finite():
    """Of the nearest particle alone: its kernel's exponent, and at most 500 like it."""
    x, y, weight = cloud(4, 10.0, 500)
    kernel = (np.cov(x, y, ddof=0) + scores.LEAST * np.eye(2)) * 500 ** (-1 / 3)
    points = np.stack([x + 1e5, y])
    nearest = -0.5 * (points * np.linalg.solve(kernel, points)).sum(axis=0).min()
    assert scores.log_score(x + 1e5, y, weight) == pytest.approx(nearest, abs=30.0)
    assert nearest < -1e6


@pytest.mark.parametrize(
    ("area", "words"),
    [
        (3.42990, "of a uniform area of 1 nmi2"),
        (1234 * 3.42990, "of a uniform area of 1,230 nmi2"),
        (0.5 * 3.42990, "of a uniform area of 0.5 nmi2"),
        (5.09e8, "of a uniform area of 148,000,000 nmi2"),  # the Earth has 5.1 x 10^8 km2
        (5.11e8, "uniform over the whole Earth"),
    ],
)
def test_a_log_score_is_that_of_a_uniform_area(area: float, words: str) -> None:
    """area: in km2."""
    assert verification_text.uniform_area(-math.log(area)).endswith(words)


def test_scores_are_proper():
    """Of laws two thirds, one and one and a half times as wide as the drifters' own, that one scores
    best.
    """
    rng = np.random.default_rng(12)
    drifters = rng.normal(0, 1000.0, (400, 2))
    energy, log = {}, {}
    for wide in (1 / 1.5, 1.0, 1.5):
        x, y = rng.normal(0, 1000.0 * wide, (2, 1500))
        weight = np.full(1500, 1 / 1500)
        energy[wide] = np.mean([scores.energy_score(x - a, y - b, weight) for a, b in drifters])
        log[wide] = np.mean([scores.log_score(x - a, y - b, weight) for a, b in drifters])
    assert min(energy, key=energy.get) == 1.0
    assert max(log, key=log.get) == 1.0
