"""The errors at buoys given their tracks: against dense conditioning of all errors at once."""

import numpy as np
import pytest
from buoys import conditioned

from drift.engine.motion.errors import buoy_errors
from drift.engine.motion.errors.buoy_errors import Fixes, Law

LAW = Law(0.31, 11 * 3600.0, 12_500.0, 0.08, 2.0, 7 * 3600.0, 1e5, 0.5)
EDGES = np.arange(0.0, 12 * 3600 + 1, 1800.0)
CURRENT, WIND = np.array([[1, 0.7], [0.7, 1]]), np.array([[1, 0.95], [0.95, 1]])
WINDAGE, ERROR = np.array([0.0, 0.02]), np.array([15.0, 40.0])


def fixes() -> list[Fixes]:
    """Return two buoys: late, with two stretches; and from the start, with long gaps."""
    random = np.random.default_rng(7)
    found = []
    for time, begins, error, windage in (
        ([1750, 3000, 4001, 9000, 20_000, 21_600], [0, 3], ERROR[0], WINDAGE[0]),
        ([0, 7200, 10_800, 30_000], [0], ERROR[1], WINDAGE[1]),
    ):
        fresh = np.isin(np.arange(len(time)), begins)
        excess = np.where(fresh[None, :, None], 0.0, random.normal(size=(3, len(time), 2)) * 900)
        found.append(Fixes(np.array(time, float), fresh, excess, error, windage))
    return found


def given(law: Law = LAW, windy: bool = True) -> buoy_errors.Conditioned:
    """Return the conditioned errors with constant correlations."""
    steps = len(EDGES) - 1
    factors = [np.tile(np.linalg.cholesky(matrix), (steps, 1, 1)) for matrix in (CURRENT, WIND)]
    return buoy_errors.condition(law, EDGES, (factors[0], factors[1] if windy else None), fixes())


def at_buoys(states: np.ndarray) -> np.ndarray:
    """Return the errors at the buoys, along the first axis (8, ...): the states without X."""
    return states[:6]


def test_the_mean_is_that_of_dense_conditioning() -> None:
    found = given()
    mean, _, log_likelihood = conditioned(LAW, (CURRENT, WIND), WINDAGE, ERROR, fixes(), EDGES)
    own = np.stack([at_buoys(np.moveaxis(states, 1, 0)) for states in found.means])
    np.testing.assert_allclose(own.reshape(-1, 3, 2), mean, atol=1e-7)
    np.testing.assert_allclose(found.log_likelihood, log_likelihood, rtol=1e-9)


def test_deviations_have_the_covariance_of_dense_conditioning_over_all_times() -> None:
    """Between any two times, too: the transitions are those of the conditioned process."""
    found = given()
    _, covariance, _ = conditioned(LAW, (CURRENT, WIND), WINDAGE, ERROR, fixes(), EDGES)
    covariance = covariance.reshape(len(EDGES), 6, len(EDGES), 6)
    own = [found.first @ found.first.T]
    for move, kick in zip(found.moves, found.kicks, strict=True):
        own.append(move @ own[-1] @ move.T + kick @ kick.T)
    for k in range(len(EDGES)):
        across = own[k]  # of time j with time k
        for j in range(k, len(EDGES)):
            values = at_buoys(at_buoys(across.T).T)
            np.testing.assert_allclose(values, covariance[j, :, k], atol=1e-7)
            if j < len(EDGES) - 1:
                across = found.moves[j] @ across


def test_without_wind_or_bias_there_are_fewer_states() -> None:
    law = Law(0.31, 11 * 3600.0, 12_500.0, 0.0, 0.0, 7 * 3600.0, 1e5, 0.0)
    found = given(law, windy=False)
    assert found.first.shape == (4, 4)
    mean, *_ = conditioned(law, (CURRENT, WIND), WINDAGE, ERROR, fixes(), EDGES)
    own = np.moveaxis(found.means[:, :, :2], 2, 1)
    np.testing.assert_allclose(own, mean.reshape(len(EDGES), 6, 3, 2)[:, :2], atol=1e-7)


def test_a_buoy_without_displacements_tells_nothing() -> None:
    silent = [Fixes(np.array([900.0]), np.array([True]), np.zeros((1, 1, 2)), 20.0, 0.0)]
    law = Law(0.31, 11 * 3600.0, 12_500.0, 0.08, 0.0, 1.0, 1e5, 0.5)
    found = buoy_errors.condition(law, EDGES, (np.ones((24, 1, 1)), None), silent)
    assert (found.means == 0).all()
    assert found.log_likelihood == 0
    np.testing.assert_allclose(found.first[:2, :2], np.eye(2))
    keep = np.exp(-1800 / law.current_time)
    np.testing.assert_allclose(found.moves[5][:2, :2], [[keep, 0], [0, 1]], atol=1e-12)


def test_the_root_of_a_singular_covariance() -> None:
    random = np.random.default_rng(2)
    half = random.normal(size=(5, 3))
    half[2] = 0.0
    root = buoy_errors.root(half @ half.T)
    np.testing.assert_allclose(root @ root.T, half @ half.T, atol=1e-9)
    assert (root[2] == 0).all()
    assert (np.triu(root, 1) == 0).all()


def test_correlations_fall_with_the_distance() -> None:
    distance = np.array([0.0, 6250.0, 12_500.0])
    expected = [1.0, np.exp(-(0.5**1.5)), np.exp(-1.0)]
    np.testing.assert_allclose(buoy_errors.correlation(distance, 12_500.0), expected)


@pytest.mark.parametrize("shift", [1.0, -3.0])
def test_a_hypothesis_whose_forcing_is_off_is_less_likely(shift: float) -> None:
    """By the constant velocity [m/s] that its buoys exceed it, beside a perfect forcing."""
    time = np.arange(0, 6 * 3600 + 1, 1800.0)
    fresh = time == 0
    excess = np.stack([np.zeros((time.size, 2)), np.outer(time, [shift, 0.5 * shift])])
    own = [Fixes(time, fresh, excess, 20.0, 0.0)]
    law = Law(0.31, 11 * 3600.0, 12_500.0, 0.0, 0.0, 1.0, 1e5, 0.0)
    found = buoy_errors.condition(law, EDGES, (np.ones((24, 1, 1)), None), own)
    assert found.log_likelihood[1] < found.log_likelihood[0]
    assert abs(found.means[6, 1, 0] * law.current_std - [shift, shift / 2]).max() < 0.05 * abs(
        shift
    )
