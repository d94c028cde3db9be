"""Means over worlds and their standard errors against sums over all worlds in full."""

import numpy as np
import pytest

from drift.engine.particles import weights
from drift.spills.worlds import estimate

WORLDS = 400


def groups(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return values of all worlds (3 groups, WORLDS), 0 in most, and the rows that estimate.mean is
    given: value, world, start.
    """
    full = np.where(
        rng.random((3, WORLDS)) < np.array([[0.04], [0.3], [1.0]]),
        rng.gamma(1.7, 3.0, (3, WORLDS)),
        0.0,
    )
    group, world = np.nonzero(full)
    return full, full[group, world][:, None], world, np.searchsorted(group, np.arange(3))


def test_with_equal_weights_the_error_is_that_of_a_mean() -> None:
    full, value, world, start = groups(np.random.default_rng(3))
    weight = np.full(WORLDS, 1 / WORLDS)
    found, error = estimate.mean(value, weight[world], start, float(weight @ weight))
    np.testing.assert_allclose(found[:, 0], full.mean(axis=1), rtol=1e-12)
    np.testing.assert_allclose(error[:, 0], full.std(axis=1, ddof=1) / np.sqrt(WORLDS), rtol=1e-12)


def test_with_uneven_weights_the_error_is_that_of_a_ratio() -> None:
    """Owen 2013, eq. 9.8, over every world, those that bring nothing among them; times m / (m - 1)
    at m effective worlds.
    """
    rng = np.random.default_rng(4)
    full, value, world, start = groups(rng)
    weight = rng.gamma(0.2, 1.0, WORLDS)
    weight /= weight.sum()
    many = weights.effective(weight)
    assert 20 < many < 200
    found, error = estimate.mean(value, weight[world], start, float(weight @ weight))
    mean = full @ weight
    np.testing.assert_allclose(found[:, 0], mean, rtol=1e-12)
    square = (weight**2) @ ((full - mean[:, None]) ** 2).T * many / (many - 1)
    np.testing.assert_allclose(error[:, 0], np.sqrt(square), rtol=1e-12)


def test_one_world_says_nothing_of_its_error() -> None:
    found, error = estimate.mean(np.array([[3.0]]), np.ones(1), np.zeros(1, int), 1.0)
    assert found[0, 0] == pytest.approx(3.0)
    assert np.isnan(error[0, 0])
