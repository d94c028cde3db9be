"""Where the probability of all particles is, and how many count, against NumPy in float64."""

import numpy as np
import pytest

from drift.engine.motion.models.drift import COLUMNS
from drift.engine.particles import ensemble as record
from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.snapshot import Snapshot
from drift.engine.particles.status import Status
from drift.forecast import survey
from drift.forecast.survey import Survey

RNG = np.random.default_rng(4)


def surveyed(ensemble: Ensemble) -> Survey:
    columns = {name: column.to_numpy() for name, column in ensemble.columns.items()}
    own = Snapshot(
        np.datetime64("2026-11-23"), columns["lon"], columns["lat"], record.probability(ensemble), columns["status"],
        columns["scenario"], cut=ensemble.blocks,
    )  # fmt: skip
    return survey.survey_output(own, len(ensemble.scenarios))


def test_the_account_adds_up_and_agrees_with_numpy() -> None:
    n = 50_003
    ensemble = record.empty(1, (0, 20_001, n), COLUMNS)
    # far below float32's smallest: only ratios matter
    log_weight = RNG.normal(-300, 3, n).astype(np.float32)
    log_weight[::7] = -np.inf
    status = RNG.integers(0, 9, n).astype(np.int32)
    ensemble.log_weight.from_numpy(log_weight)
    ensemble.status.from_numpy(status)
    weight = np.exp(log_weight.astype(float) - log_weight.max())
    weight /= weight.sum()
    account = surveyed(ensemble)
    assert account.status == pytest.approx(np.bincount(status, weight, 9), rel=1e-11)
    assert account.scenario == pytest.approx(
        [weight[:20_001].sum(), weight[20_001:].sum()], rel=1e-11
    )
    assert account.effective == pytest.approx(1 / (weight**2).sum(), rel=1e-11)
    assert record.probability(ensemble).sum() == pytest.approx(1, abs=1e-12)


def test_a_scenario_of_no_weight_is_accounted_as_none() -> None:
    ensemble = record.empty(1, (0, 10, 30), COLUMNS)
    log_weight = np.zeros(30, np.float32)
    log_weight[:10] = -np.inf
    ensemble.log_weight.from_numpy(log_weight)
    account = surveyed(ensemble)
    assert account.scenario[0] == 0
    assert account.scenario[1] == pytest.approx(1, abs=1e-14)
    assert account.status[Status.PENDING] == pytest.approx(1, abs=1e-14)
    assert account.effective == pytest.approx(20)


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
    account = surveyed(ensemble)
    assert account.status == pytest.approx(
        [p[status == s].sum() for s in range(9)], rel=1e-11, abs=1e-300
    )
    exact = [p[a:b].sum() for a, b in ensemble.scenarios]
    assert account.scenario == pytest.approx(exact, rel=1e-11, abs=1e-300)
    assert account.effective == pytest.approx(1 / (p * p).sum(), rel=1e-11)
