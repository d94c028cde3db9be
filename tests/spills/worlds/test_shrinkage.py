"""The quadratic that worlds are drawn toward, against SciPy's optimiser and against what is known
of its best fit.

Newton's method ends where a step would add less than 1e-7 of the log probability P to it: means
over W worlds, of sum S, are then right to sqrt(2e-7 P / S), here at most 5e-4.
"""

import numpy as np
import pytest
from scipy import optimize, special

from drift.spills.worlds import shrinkage

RIDGE = 1.0  # inverse variance of every coefficient but the constant


def drawn(worlds: int, seed: int) -> np.ndarray:
    """Return terms (worlds, 4): a constant, and three with slopes."""
    z = np.random.default_rng(seed).standard_normal((worlds, 3))
    return np.column_stack([np.ones(worlds), z[:, 0], z[:, 1], z[:, 0] * z[:, 2]])


def best(terms: np.ndarray, value: np.ndarray, size: float, poisson: bool) -> np.ndarray:
    """Return the means of the most probable coefficients, by SciPy's optimiser."""

    def loss(b: np.ndarray) -> tuple[float, np.ndarray]:
        eta = terms @ b
        mean, partition = (
            (np.exp(eta), np.exp(eta)) if poisson else (special.expit(eta), np.logaddexp(0, eta))
        )
        own = RIDGE * np.append(0.0, b[1:])
        return float(size * (partition - value * eta).sum() + 0.5 * own @ b), size * terms.T @ (
            mean - value
        ) + own

    found = optimize.minimize(
        loss, np.zeros(terms.shape[1]), jac=True, method="BFGS", options={"gtol": 1e-9}
    )
    return np.exp(terms @ found.x) if poisson else special.expit(terms @ found.x)


@pytest.mark.parametrize("mean", [0.07, 0.6, 40.0])
def test_counts(mean: float) -> None:
    """Nothing holds the constant, so that as many are meant in all as were counted."""
    terms = drawn(60, seed=3)
    count = np.random.default_rng(4).poisson(mean * np.exp(0.5 * terms[:, 1])).astype(float)
    assert count.sum() > 0
    found = shrinkage._fit(terms, count, shrinkage.POISSON, float(np.log(count.mean())))
    assert found.sum() == pytest.approx(count.sum(), rel=5e-4)
    np.testing.assert_allclose(found, best(terms, count, 1.0, poisson=True), rtol=1e-3)


@pytest.mark.parametrize("size", [1.0, 3.7, 400.0])
def test_shares(size: float) -> None:
    terms = drawn(25, seed=5)
    value = special.expit(
        -1.9 + 0.8 * terms[:, 1] - 0.3 * terms[:, 3] + np.random.default_rng(6).normal(0, 0.7, 25)
    )
    middle = float(special.logit(value.mean()))
    found = shrinkage._fit(terms, value, shrinkage.BINOMIAL, middle, size)
    assert found.sum() == pytest.approx(value.sum(), rel=5e-4)
    np.testing.assert_allclose(found, best(terms, value, size, poisson=False), rtol=1e-3)


@pytest.mark.parametrize("off", [-0.41, 0.37])
def test_a_constant_alone_is_the_mean_after_a_few_steps(off: float) -> None:
    """Of few, too, which say less than a coefficient's own law would: each step squares what it is
    off, 0.4, 0.08, 3e-3, 1e-5.
    """
    count = np.array([0.0, 0.4, 0.0, 0.0, 0.1, 0.0, 0.0])
    found = shrinkage._fit(
        np.ones((7, 1)), count, shrinkage.POISSON, float(np.log(count.mean())) + off
    )
    np.testing.assert_allclose(found, count.mean(), rtol=3e-5)


def test_a_constant_alone_is_the_mean_from_wherever_it_begins() -> None:
    """Far below it a whole step would go beyond what floats hold."""
    count = np.array([0.0, 7.0, 31.0, 2.0, 12.0])
    for begin in (-9.0, -2.5, 7.0):
        found = shrinkage._fit(np.ones((5, 1)), count, shrinkage.POISSON, begin)
        np.testing.assert_allclose(found, count.mean(), rtol=5e-4)


def standardised(latent: np.ndarray) -> np.ndarray:
    return (latent - latent.mean(axis=0)) / latent.std(axis=0)


@pytest.mark.parametrize("worlds", [60, 150, 700])
def test_worlds_are_like_those_whose_latents_are_nearest(worlds: int) -> None:
    """By all distances of standardised latents; a latent that is the same in all worlds tells
    nothing.
    """
    random = np.random.default_rng(worlds)
    latent = random.normal(0, 1, (worlds, 3)) * np.array([3.0, 0.01, 40.0]) + 7
    made = shrinkage.world_similarity(
        np.column_stack([latent[:, :2], np.full(worlds, 5.0), latent[:, 2]])
    )
    z = standardised(latent)
    apart = np.linalg.norm(z[:, None] - z[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    near = np.argsort(apart, axis=1)[:, : min(24, worlds // 20)]
    np.testing.assert_array_equal(np.sort(made.near, axis=1), np.sort(near, axis=1))
    products = [z[:, i] * z[:, j] for i in range(3) for j in range(i, 3)]
    # five worlds or more for each of 20 terms
    wanted = products if worlds >= 100 else [z[:, k] ** 2 for k in range(3)]
    np.testing.assert_allclose(
        made.terms, np.column_stack([np.ones(worlds), z, *wanted]), atol=1e-12
    )
    values = random.normal(0, 1, worlds)
    np.testing.assert_allclose(made.nearby(values), [values[own].sum() for own in near], atol=1e-12)


@pytest.mark.parametrize(
    "shares", [(0.2, 0.2, 0.3, 0.3), (0.02, 0.5, 0.48)], ids=["enough of each", "few of one"]
)
def test_only_worlds_of_one_member_correct_each_other(shares: tuple[float, ...]) -> None:
    """As many as there are: a member of six worlds has five others of each."""
    random = np.random.default_rng(8)
    counts = np.round(300 * np.array(shares)).astype(int)
    z, member = (
        random.normal(0, 1, (300, 2)),
        random.permutation(np.repeat(np.arange(counts.size), counts)).astype(np.int32),
    )
    made, values = shrinkage.world_similarity(z, member), random.normal(0, 1, 300)
    apart = np.linalg.norm(standardised(z)[:, None] - standardised(z)[None], axis=2)
    apart[member[:, None] != member] = np.inf
    np.fill_diagonal(apart, np.inf)
    assert made.near.shape == (300, 15)
    expected = [
        sum(values[k] for k in np.argsort(row)[:15] if np.isfinite(row[k])) for row in apart
    ]
    np.testing.assert_allclose(made.nearby(values), expected, atol=1e-12)


def test_worlds_are_drawn_toward_their_neighbours_where_no_quadratic_fits() -> None:
    """Means that swing: by 24 neighbours of three counts each they are known to some 0.15, a
    quadratic misses them by 0.6.

    Neighbours reach over 24 / 900 of the worlds, a tenth of a swing.
    """
    random = np.random.default_rng(10)
    z = random.uniform(-1, 1, (900, 1))
    truth = 3 * np.exp(0.9 * np.sin(10 * z[:, 0]))
    count = random.poisson(truth).astype(float)
    found = shrinkage.shrink_means(count, count, 40, shrinkage.world_similarity(z)) * 40
    assert np.std(np.log(truth)) > 0.6
    assert np.sqrt(np.mean(np.log(found / truth) ** 2)) < 0.2


def test_means_are_in_the_unit_of_what_is_summed() -> None:
    """Particles that each count 37.2 times as much have means 37.2 times as large."""
    random = np.random.default_rng(5)
    z = random.normal(0, 1, (400, 2))
    parts = random.gamma(2.0, 0.5, (400, 30)) * (
        random.random((400, 30)) < 0.1 * np.exp(0.4 * z[:, :1])
    )
    alike = shrinkage.world_similarity(z)
    once, more = (
        shrinkage.shrink_means(k * parts.sum(1), k**2 * (parts**2).sum(1), 30, alike)
        for k in (1.0, 37.2)
    )
    np.testing.assert_allclose(more, 37.2 * once, rtol=1e-9)
    assert once.mean() == pytest.approx(parts.mean(), rel=0.02)
    assert np.corrcoef(once, parts.mean(1))[0, 1] > 0.3


def test_of_nothing_seen_half_a_particle_in_all_worlds_is_meant_at_most() -> None:
    alike = shrinkage.world_similarity(np.random.default_rng(5).normal(0, 1, (400, 2)))
    once, more = (
        shrinkage.shrink_means(np.zeros(400), np.zeros(400), 30, alike, full) for full in (1.0, 6.3)
    )
    assert once.min() > 0
    assert once.sum() * 30 <= 0.5 * (1 + 1e-9)
    np.testing.assert_allclose(more, 6.3 * once, rtol=1e-9)


def test_shares_without_noise_are_what_they_are() -> None:
    """Where the particles of each world have one chance nothing is drawn together."""
    random = np.random.default_rng(2)
    z = random.normal(0, 1, (300, 2))
    mean = special.expit(z[:, 0] + random.normal(0, 1, 300))
    np.testing.assert_allclose(
        shrinkage.shrink_shares(mean, np.zeros(300), 50, shrinkage.world_similarity(z)),
        mean,
        rtol=1e-6,
    )
    np.testing.assert_array_equal(
        shrinkage.shrink_shares(np.zeros(300), np.zeros(300), 50, shrinkage.world_similarity(z)),
        np.zeros(300),
    )
