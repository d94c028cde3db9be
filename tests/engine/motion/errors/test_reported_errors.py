"""Errors of wind and current given reports on scene: against dense conditioning of all at once."""

from typing import Any

import numpy as np
import pytest
from buoys import conditioned

from drift.engine.motion.errors import buoy_errors
from drift.engine.motion.errors.buoy_errors import Fixes, Law, Sight

LAW = Law(0.31, 11 * 3600.0, 12_500.0, 0.08, 2.0, 7 * 3600.0, 1e5, 0.5)
EDGES = np.arange(0.0, 6 * 3600 + 1, 1800.0)
CURRENT = np.array([[1, 0.7, 0.3], [0.7, 1, 0.55], [0.3, 0.55, 1]])
WIND = np.array([[1, 0.95, 0.8], [0.95, 1, 0.9], [0.8, 0.9, 1]])
ERROR, WINDAGE = np.array([25.0]), np.array([0.013])
RANDOM = np.random.default_rng(8)
# before the run, at its start, at a step, between steps, at a fix, at its end, after it
SIGHTS = [
    Sight(place, time, of_wind, RANDOM.normal(size=(2, 2)) * (3 if of_wind else 0.4), error)
    for place, time, of_wind, error in (
        (1, -5000.0, False, 0.11), (2, 0.0, True, 1.3), (1, 3600.0, False, 0.2), (2, 4001.0, True, 0.7),
        (2, 9000.0, False, 0.05), (1, EDGES[-1], True, 1.1), (2, EDGES[-1] + 700, False, 0.3),
    )
]  # fmt: skip


def buoy() -> Fixes:
    """Return a buoy that is seen from the start, with two stretches and windage."""
    time = np.array([0, 3000, 9000, 15_000, 21_000.0])
    fresh = np.array([True, False, False, True, False])
    excess = np.where(fresh[None, :, None], 0.0, RANDOM.normal(size=(2, 5, 2)) * 900)
    return Fixes(time, fresh, excess, ERROR[0], WINDAGE[0])


def factors(windy: bool = True, places: int = 3) -> Any:
    """Return Cholesky factors of constant correlations."""
    steps, own = len(EDGES) - 1, slice(3 - places, 3)
    found = [
        np.tile(np.linalg.cholesky(matrix[own, own]), (steps, 1, 1)) for matrix in (CURRENT, WIND)
    ]
    return found[0], found[1] if windy else None


def compare(found: buoy_errors.Conditioned, dense: Any, states: list[int]) -> None:
    """Hold the given states of a conditioning to the mean, covariance and likelihood of another."""
    mean, covariance, log_likelihood = dense
    np.testing.assert_allclose(found.log_likelihood, log_likelihood, rtol=1e-9)
    size = mean.shape[0] // len(EDGES)
    own = np.moveaxis(found.means, 2, 1)  # (times, states, hypotheses, 2)
    np.testing.assert_allclose(own[:, states].reshape(-1, 2, 2), mean, atol=1e-7)
    covariance = covariance.reshape(len(EDGES), size, len(EDGES), size)
    present = found.first @ found.first.T
    for k in range(len(EDGES)):
        np.testing.assert_allclose(
            present[np.ix_(states, states)], covariance[k, :, k], atol=1e-7, err_msg=str(k)
        )
        if k + 1 < len(EDGES):
            move, kick = found.moves[k], found.kicks[k]
            present = move @ present @ move.T + kick @ kick.T


def test_reports_beside_a_buoy() -> None:
    """Of wind and current at two places, before the run, within it and after it."""
    fixes = [buoy()]
    found = buoy_errors.condition(LAW, EDGES, factors(), fixes, SIGHTS)
    assert found.first.shape == (10, 10)
    dense = conditioned(LAW, (CURRENT, WIND), WINDAGE, ERROR, fixes, EDGES, SIGHTS)
    compare(found, dense, list(range(9)))


def test_reports_without_a_buoy() -> None:
    """There are no displacements then."""
    sights = [Sight(own.place - 1, own.time, own.of_wind, own.excess, own.error) for own in SIGHTS]
    found = buoy_errors.condition(LAW, EDGES, factors(places=2), [], sights)
    assert found.first.shape == (6, 6)
    pair = CURRENT[1:, 1:], WIND[1:, 1:]
    dense = conditioned(LAW, pair, np.zeros(0), np.zeros(0), [], EDGES, sights)
    compare(found, dense, list(range(6)))


@pytest.mark.parametrize("time", [-20_000.0, 4001.0, 60_000.0])
def test_one_report_by_hand(time: float) -> None:
    """Its weight is variance / (variance + error^2), which fades with the time from it."""
    excess = np.array([[0.3, -0.5]])
    law = Law(0.31, 11 * 3600.0, 12_500.0, 0.0, 0.0, 1.0, 1e5, 0.0)
    one = np.ones((len(EDGES) - 1, 1, 1))
    found = buoy_errors.condition(
        law, EDGES, (one, None), [], [Sight(0, time, False, excess, 0.17)]
    )
    variance = 0.31**2
    fade = np.exp(-np.abs(EDGES - time) / law.current_time)
    weight = fade * variance / (variance + 0.17**2)
    np.testing.assert_allclose(
        law.current_std * found.means[:, 0, 0], weight[:, None] * excess, atol=1e-12
    )
    np.testing.assert_allclose(found.first[0, 0] ** 2, 1 - weight[0] * fade[0], atol=1e-12)
