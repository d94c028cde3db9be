"""The account of an ensemble against NumPy in float64."""

import numpy as np
import pytest

from drift.motion.drift import COLUMNS
from drift.particles import ensemble as record
from drift.particles.status import Status

RNG = np.random.default_rng(4)


def test_the_account_adds_up_and_agrees_with_numpy() -> None:
    n = 50_003
    ensemble = record.empty(1, (0, 20_001, n), COLUMNS)
    log_weight = RNG.normal(-300, 3, n).astype(np.float32)  # far below float32's smallest: only ratios matter
    log_weight[::7] = -np.inf
    status = RNG.integers(0, 9, n).astype(np.int32)
    ensemble.log_weight.from_numpy(log_weight)
    ensemble.status.from_numpy(status)
    weight = np.exp(log_weight.astype(float) - log_weight.max())
    weight /= weight.sum()
    scenario = (np.arange(n) >= 20_001).astype(int)
    expected = np.bincount(scenario * 9 + status, weight, 18).reshape(2, 9)
    account = record.account(ensemble)
    assert account.by_status == pytest.approx(expected, rel=1e-11)
    assert account.by_status.sum() == pytest.approx(1, abs=1e-12)
    assert account.ess == pytest.approx(1 / (weight**2).sum(), rel=1e-11)
    assert record.probability(ensemble).sum() == pytest.approx(1, abs=1e-12)


def test_a_scenario_of_no_weight_is_accounted_as_none() -> None:
    ensemble = record.empty(1, (0, 10, 30), COLUMNS)
    log_weight = np.zeros(30, np.float32)
    log_weight[:10] = -np.inf
    ensemble.log_weight.from_numpy(log_weight)
    account = record.account(ensemble)
    assert account.by_status.sum(axis=1).tolist() == [0, 1]
    assert account.by_status[1, Status.PENDING] == 1
    assert account.ess == pytest.approx(20)


def test_account_of_wild_weights() -> None:
    """Sums of at most 5,000 positive float64 numbers: relative error below n rounding errors."""
    rng = np.random.default_rng(1)
    n = 50_001
    ensemble = record.empty(1, (0, 1000, 1000, 30_000, n), COLUMNS)
    weight = rng.normal(0, 30, n).astype(np.float32)
    weight[rng.random(n) < 0.3] = -np.inf
    weight[:1000] = -np.inf
    status = rng.integers(0, 9, n).astype(np.int32)
    ensemble.log_weight.from_numpy(weight)
    ensemble.status.from_numpy(status)
    p = np.exp(weight.astype(float) - weight.max())
    p /= p.sum()
    exact = [[p[a:b][status[a:b] == s].sum() for s in range(9)] for a, b in ensemble.scenarios]
    account = record.account(ensemble)
    assert account.by_status == pytest.approx(np.array(exact), rel=1e-11, abs=1e-300)
    assert account.ess == pytest.approx(1 / (p * p).sum(), rel=1e-11)
