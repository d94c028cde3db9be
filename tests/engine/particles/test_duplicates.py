"""Where duplicates part from the posterior: every outcome of the draw, counted with its
probability, beside the ways that keep it.
"""

import itertools

import numpy as np
import pytest

from drift.engine.particles import resample

WEIGHT = np.array([0.3, 1e-6, 0.5, 0.0, 0.2, 2e-5])  # two too light, one impossible
LEFT = (0, 2, 4)
ROUNDS = 6000


def shares(method: str, number: int = 6, rounds: int = ROUNDS) -> np.ndarray:
    """Return the share of each first particle after a draw, (rounds, 6)."""
    room = np.append(WEIGHT, np.zeros(resample.METHODS[method].slots(number) - number))
    with np.errstate(divide="ignore"):
        log_weight = np.log(room).astype(np.float32)
    found = np.zeros((rounds, 6))
    for k in range(rounds):
        ancestors, new, spare = resample.offspring(
            log_weight, [(0, len(room))], [number], method, (21, k)
        )
        found[k] = np.bincount(ancestors[~spare], np.exp(new[~spare].astype(float)), minlength=6)[
            :6
        ]
    return found


def counted() -> tuple[np.ndarray, np.ndarray]:
    """Return the exact mean shares after three copies are drawn by weight, scaled and as they are
    before that.
    """
    own = WEIGHT[list(LEFT)]
    scaled, raw = np.zeros(6), np.zeros(6)
    for drawn in itertools.product(range(3), repeat=3):
        chance = np.prod(own[list(drawn)] / own.sum())
        weight = own * (1 + np.bincount(drawn, minlength=3))
        raw[list(LEFT)] += chance * weight
        scaled[list(LEFT)] += chance * weight / weight.sum() * WEIGHT.sum()
    return scaled, raw


@pytest.mark.parametrize("rounds", [600, pytest.param(ROUNDS, marks=pytest.mark.thorough)])
def test_duplicates_come_to_what_is_counted_and_not_to_the_posterior(rounds: int) -> None:
    found = shares("duplicates", rounds=rounds)
    scaled, raw = counted()
    own = WEIGHT[list(LEFT)]
    # w (1 + m w)
    np.testing.assert_allclose(raw[list(LEFT)], own * (1 + 3 * own / own.sum()), rtol=1e-12)
    # the scenario weighs what it did
    np.testing.assert_allclose(found.sum(axis=1), WEIGHT.sum(), rtol=1e-6)
    error = found.std(axis=0) / np.sqrt(rounds)
    assert (np.abs(found.mean(axis=0) - scaled) <= 3 * error + 1e-7).all()  # weights are 32 bits
    assert abs(found.mean(axis=0)[2] - WEIGHT[2]) > 20 * np.sqrt(rounds / ROUNDS) * error[2]
    assert scaled[2] == pytest.approx(0.57, abs=0.005)  # as the documentation says


@pytest.mark.parametrize("method", ["systematic", "kahn"])
def test_the_other_ways_keep_the_posterior(method: str) -> None:
    found = shares(method)
    error = found.std(axis=0) / np.sqrt(ROUNDS)
    assert (np.abs(found.mean(axis=0) - WEIGHT) <= 3.5 * error + 2e-5).all()


def test_survivors_stay_and_copies_take_the_slots_of_the_others() -> None:
    with np.errstate(divide="ignore"):
        log_weight = np.log(WEIGHT).astype(np.float32)
    ancestors, new, spare = resample.offspring(log_weight, [(0, 6)], [6], "duplicates", (3, 1))
    assert not spare.any()
    assert set(ancestors) == set(LEFT)
    weight = np.exp(new.astype(float))
    ratio = weight / WEIGHT[ancestors]
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-6)  # a copy weighs as its original


def test_scenarios_keep_their_slots_and_their_weight() -> None:
    rng = np.random.default_rng(2)
    weight = rng.gamma(0.3, size=90)
    weight[:30] *= 1e-5
    weight[::4] = 0.0
    with np.errstate(divide="ignore"):
        log_weight = np.log(weight).astype(np.float32)
    ranges = [(0, 30), (30, 55), (55, 90)]
    ancestors, new, _ = resample.offspring(log_weight, ranges, [30, 25, 35], "duplicates", (3, 1))
    for first, last in ranges:
        assert ((ancestors[first:last] >= first) & (ancestors[first:last] < last)).all()
        assert np.exp(new[first:last].astype(float)).sum() == pytest.approx(
            weight[first:last].sum(), rel=1e-6
        )
