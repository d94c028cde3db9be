"""Weights after sorties that share an unknown factor, against NumPy in float64."""

import numpy as np
import pytest
from scipy import special

from kernels.evidence import sweep
from kernels.runtime import runtime

RNG = np.random.default_rng(41)
N = 3000
CHANCES = np.array([0.2, 0.5, 0.3], np.float32)
COEFFICIENT = np.array([[0.4, 1.1, 2.3], [0.0, 0.0, 0.0]], np.float32)  # one is not searched
SCENARIO = RNG.integers(0, 2, N).astype(np.int32)
WEIGHT = RNG.normal(-3.0, 2.0, N).astype(np.float32)
# A weight changes by the difference of two logs of up to 12; each is right to some ulps of the sum
# that it is taken of and of itself.
TOLERANCE = 2**-24 * 12 * 8


def _exposed(meaning: int) -> tuple[np.ndarray, np.ndarray]:
    """Return exposures as the kernel takes them, and the logs of the misses, (factors, N)."""
    if meaning == sweep.HAZARD:
        hazard = RNG.exponential(1.0, N).astype(np.float32)
        return hazard, -COEFFICIENT[SCENARIO].T.astype(float) * hazard
    if meaning == sweep.SHARE:
        share = RNG.uniform(0, 0.4, N).astype(np.float32)
        return share, np.log(1 - COEFFICIENT[SCENARIO].T.astype(float) * share)
    logs = -RNG.exponential(1.0, (3, N)).astype(np.float32)
    return logs.reshape(-1), logs.astype(float)


def _failed(meaning: int, exposure: np.ndarray, shared: object, keep: bool) -> np.ndarray:
    weight = runtime.upload(WEIGHT)
    sweep.fail(
        runtime.upload(SCENARIO),
        meaning,
        runtime.upload(exposure),
        COEFFICIENT,
        CHANCES,
        shared,
        weight,
        keep=keep,
    )
    return np.array(weight.to_numpy())


@pytest.mark.parametrize("meaning", [sweep.HAZARD, sweep.SHARE, sweep.MISS])
def test_the_mean_over_the_factor_is_taken_of_the_product_of_all_misses(meaning: int) -> None:
    exposure, logs = _exposed(meaning)
    earlier = -RNG.exponential(0.8, (3, N)).astype(np.float32)
    searched = SCENARIO == 0

    def mean(misses: np.ndarray) -> np.ndarray:
        return special.logsumexp(misses, axis=0, b=CHANCES[:, None].astype(float))

    wanted = np.where(searched, mean(earlier + logs) - mean(earlier.astype(float)), 0)
    shared = runtime.upload(earlier.reshape(-1))
    kept = _failed(meaning, exposure, shared, keep=True)
    np.testing.assert_allclose(kept - WEIGHT.astype(float), wanted, atol=TOLERANCE)
    after = np.array(shared.to_numpy()).reshape(3, N)
    np.testing.assert_allclose(
        after, np.where(searched, earlier + logs, earlier), atol=TOLERANCE, rtol=2**-22
    )
    # the product, not the mean of each: these differ by far more than the tolerance
    assert np.abs(mean(logs) - wanted)[searched].max() > 1000 * TOLERANCE


def test_hazards_that_grow_alike_are_held_as_their_sum() -> None:
    """Three sorties in a row, each with its own coefficients; the second is not kept."""
    growth = np.array([0.3, 1.1, 2.7], np.float32)
    shared, weight = runtime.upload(np.zeros(N, np.float32)), runtime.upload(WEIGHT)
    sums, wanted = np.zeros(N), WEIGHT.astype(float)

    def mean(hazard: np.ndarray) -> np.ndarray:
        logs = -growth[:, None].astype(float) * hazard
        return special.logsumexp(logs, axis=0, b=CHANCES[:, None].astype(float))

    for keep, coefficient in ((True, [0.7, 0.0]), (False, [0.2, 0.9]), (True, [1.3, 0.4])):
        exposure = RNG.exponential(0.8, N).astype(np.float32)
        under_way = RNG.exponential(0.2, N).astype(np.float32)
        hazard = np.array(coefficient)[SCENARIO] * (exposure + 0.5 * under_way.astype(float))
        table = np.outer(coefficient, growth)
        sweep.fail(
            runtime.upload(SCENARIO),
            sweep.HAZARD,
            runtime.upload(exposure),
            table,
            CHANCES,
            shared,
            weight,
            (runtime.upload(under_way), 0.5 * table),
            keep,
            growth,
        )
        wanted += mean(sums + hazard) - mean(sums)
        sums += hazard if keep else 0
    np.testing.assert_allclose(weight.to_numpy(), wanted, atol=3 * TOLERANCE)
    np.testing.assert_allclose(shared.to_numpy(), sums, rtol=6 * 2**-23)


@pytest.mark.parametrize("meaning", [sweep.HAZARD, sweep.SHARE, sweep.MISS])
def test_what_no_later_report_shares_is_not_held_and_changes_no_bit(meaning: int) -> None:
    exposure, _ = _exposed(meaning)
    earlier = -RNG.exponential(0.8, 3 * N).astype(np.float32)
    for before in (earlier, np.zeros(3 * N, np.float32)):
        shared = runtime.upload(before)
        unkept = _failed(meaning, exposure, shared, keep=False)
        np.testing.assert_array_equal(shared.to_numpy(), before)
        np.testing.assert_array_equal(unkept, _failed(meaning, exposure, shared, keep=True))
        assert (np.array(shared.to_numpy()) != before).any()
    np.testing.assert_array_equal(unkept, _failed(meaning, exposure, None, keep=False))
