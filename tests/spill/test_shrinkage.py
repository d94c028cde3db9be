"""The quadratic that worlds are drawn toward, against SciPy's optimiser and against what is known of its best fit.

Newton's method ends where a step would add less than 1e-7 of the log probability P to it: means over W worlds, of sum S, are then
right to sqrt(2e-7 P / S), here at most 5e-4.
"""

import numpy as np
import pytest
from scipy import optimize, special

from drift.spill import shrinkage

RIDGE = 1.0  # inverse variance of every coefficient but the constant


def drawn(worlds: int, seed: int) -> np.ndarray:
    """Return terms (worlds, 4): a constant, and three with slopes."""
    z = np.random.default_rng(seed).standard_normal((worlds, 3))
    return np.column_stack([np.ones(worlds), z[:, 0], z[:, 1], z[:, 0] * z[:, 2]])


def best(terms: np.ndarray, value: np.ndarray, size: float, poisson: bool) -> np.ndarray:
    """Return the means of the most probable coefficients, by SciPy's optimiser."""

    def loss(b: np.ndarray) -> tuple[float, np.ndarray]:
        eta = terms @ b
        mean, partition = (np.exp(eta), np.exp(eta)) if poisson else (special.expit(eta), np.logaddexp(0, eta))
        own = RIDGE * np.append(0.0, b[1:])
        return float(size * (partition - value * eta).sum() + 0.5 * own @ b), size * terms.T @ (mean - value) + own

    found = optimize.minimize(loss, np.zeros(terms.shape[1]), jac=True, method="BFGS", options={"gtol": 1e-9})
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
    value = special.expit(-1.9 + 0.8 * terms[:, 1] - 0.3 * terms[:, 3] + np.random.default_rng(6).normal(0, 0.7, 25))
    middle = float(special.logit(value.mean()))
    found = shrinkage._fit(terms, value, shrinkage.BINOMIAL, middle, size)
    assert found.sum() == pytest.approx(value.sum(), rel=5e-4)
    np.testing.assert_allclose(found, best(terms, value, size, poisson=False), rtol=1e-3)


@pytest.mark.parametrize("off", [-0.41, 0.37])
def test_a_constant_alone_is_the_mean_after_a_few_steps(off: float) -> None:
    """Of few, too, which say less than a coefficient's own law would: each step squares what it is off, 0.4, 0.08, 3e-3, 1e-5."""
    count = np.array([0.0, 0.4, 0.0, 0.0, 0.1, 0.0, 0.0])
    found = shrinkage._fit(np.ones((7, 1)), count, shrinkage.POISSON, float(np.log(count.mean())) + off)
    np.testing.assert_allclose(found, count.mean(), rtol=3e-5)


def test_a_constant_alone_is_the_mean_from_wherever_it_begins() -> None:
    """Far below it a whole step would go beyond what floats hold."""
    count = np.array([0.0, 7.0, 31.0, 2.0, 12.0])
    for begin in (-9.0, -2.5, 7.0):
        found = shrinkage._fit(np.ones((5, 1)), count, shrinkage.POISSON, begin)
        np.testing.assert_allclose(found, count.mean(), rtol=5e-4)
