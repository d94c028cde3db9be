"""Sums of weights and deposits against NumPy in float64 and int64."""

import numpy as np
import pytest

from drift.motion import ensemble as record
from drift.motion.drift import COLUMNS
from drift.motion.status import Status
from geo.cells import Cells
from kernels import deposit as kernel

RNG = np.random.default_rng(4)


def test_the_account_adds_up_and_agrees_with_numpy() -> None:
    n = 50_003
    ensemble = record.empty(1, (0, 20_001, n), COLUMNS)
    log_weight = RNG.normal(-300, 3, n).astype(np.float32)  # far below float32's smallest: only ratios matter
    log_weight[::7] = -np.inf
    status = RNG.integers(0, 6, n).astype(np.int32)
    ensemble.log_weight.from_numpy(log_weight)
    ensemble.status.from_numpy(status)
    weight = np.exp(log_weight.astype(float) - log_weight.max())
    weight /= weight.sum()
    scenario = (np.arange(n) >= 20_001).astype(int)
    expected = np.bincount(scenario * 6 + status, weight, 12).reshape(2, 6)
    account = record.account(ensemble)
    assert account.by_status == pytest.approx(expected, rel=1e-5)
    assert account.by_status.sum() == pytest.approx(1, abs=1e-12)
    assert account.ess == pytest.approx(1 / (weight**2).sum(), rel=1e-5)
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


def test_deposits_are_exact_and_blind_to_order_and_wrap() -> None:
    cells = Cells(2**31 - 40_000, -30_000, 2_000, 1_000, 37, 61)  # across the antimeridian
    n = 100_000
    lon = (2**31 + RNG.integers(-60_000, 60_000, n)).astype(np.uint32).view(np.int32)
    lat = RNG.integers(-50_000, 50_000, n).astype(np.int32)
    amount = RNG.integers(0, 2**40, n)
    ix, iy = (lon.astype(np.int64) - cells.lon0) % 2**32 // 2_000, (lat.astype(np.int64) + 30_000) // 1_000
    inside = (ix < 37) & (iy >= 0) & (iy < 61)
    expected = np.zeros(cells.shape, np.int64)
    np.add.at(expected, (iy[inside], ix[inside]), amount[inside])
    order = RNG.permutation(n)
    assert (kernel.deposit(lon, lat, amount, cells) == expected).all()
    assert (kernel.deposit(lon[order], lat[order], amount[order], cells) == expected).all()


def test_account_of_wild_weights() -> None:
    """float64 sums as the oracle; blocks of 1024 float32 terms: relative error below 1024 * 6e-8."""
    rng = np.random.default_rng(1)
    n = 50_001
    ensemble = record.empty(1, (0, 1000, 1000, 30_000, n), COLUMNS)
    weight = rng.normal(0, 30, n).astype(np.float32)
    weight[rng.random(n) < 0.3] = -np.inf
    weight[:1000] = -np.inf
    status = rng.integers(0, 6, n).astype(np.int32)
    ensemble.log_weight.from_numpy(weight)
    ensemble.status.from_numpy(status)
    p = np.exp(weight.astype(float) - weight.max())
    p /= p.sum()
    exact = [[p[a:b][status[a:b] == s].sum() for s in range(6)] for a, b in ensemble.scenarios]
    account = record.account(ensemble)
    assert account.by_status == pytest.approx(np.array(exact), rel=6e-5, abs=1e-12)
    assert account.ess == pytest.approx(1 / (p * p).sum(), rel=6e-5)
