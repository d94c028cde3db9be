"""Sums by blocks: right against exact sums, and the same bits for any cut of whole blocks."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from scipy import special

from drift.engine.particles import partials, weights
from drift.engine.particles.partials import BLOCK, Blocks

RNG = np.random.default_rng(11)
# of four scenarios, the last cut into blocks of 96
SIZES = (3 * BLOCK + 17, 2, 2 * BLOCK, 5 * 96 + 40)
BLOCK_OF = (BLOCK, BLOCK, BLOCK, 96)
BOUNDS = tuple(int(n) for n in np.cumsum([0, *SIZES]))
N = BOUNDS[-1]
WHOLE = partials.cut_blocks(BOUNDS, BOUNDS[:-1], BLOCK_OF)


def shards(seed: int, many: int) -> list[tuple[Blocks, np.ndarray]]:
    """Deal ranges of whole blocks of each scenario out at random; return each shard's blocks and
    its slots in the whole.
    """
    random = np.random.default_rng(seed)
    cuts = []
    for first, last, size in zip(BOUNDS[:-1], BOUNDS[1:], BLOCK_OF, strict=True):
        borders = np.append(np.arange(first, last, size), last)
        inner = np.sort(random.integers(0, borders.size, many - 1))
        cuts.append([first, *borders[inner].tolist(), last])
    result = []
    for k in range(many):
        part = [(cut[k], cut[k + 1]) for cut in cuts]
        bounds = np.cumsum([0, *(b - a for a, b in part)]).tolist()
        slots = np.concatenate([np.arange(a, b) for a, b in part])
        result.append((partials.cut_blocks(bounds, [a for a, _ in part], BLOCK_OF), slots))
    return [result[i] for i in random.permutation(many)]


def test_blocks_are_of_one_scenario_and_no_longer_than_asked() -> None:
    ends = np.append(WHOLE.first[1:], N)
    assert WHOLE.first.tolist() == [
        *(
            0,
            4096,
            8192,
            12_288,
            12_305,
            12_307,
            16_403,
            20_499,
            20_595,
            20_691,
            20_787,
            20_883,
            20_979,
        )
    ]
    assert (np.searchsorted(BOUNDS, WHOLE.first, "right") - 1 == WHOLE.scenario).all()
    assert (ends - WHOLE.first <= np.array(BLOCK_OF)[WHOLE.scenario]).all()


@pytest.mark.parametrize("many", [1, 2, 7])
def test_no_cut_changes_a_bit(many: int) -> None:
    """Values over 60 orders of magnitude, of both signs: any other order of adding would show."""
    values = RNG.normal(size=N) * 10 ** RNG.uniform(-30, 30, N)
    weight = RNG.random(N)
    log_weight = RNG.normal(-300, 40, N).astype(np.float32)
    log_weight[BOUNDS[2] : BOUNDS[3]] = -np.inf  # a scenario that is ruled out, of whole blocks
    code = RNG.integers(0, 5, N)
    for seed in range(3):
        parts = shards(seed, many)
        both = partials.merge_partials(
            [blocks.partial(values[slots], weight[slots]) for blocks, slots in parts]
        )
        coded = partials.merge_partials(
            [blocks.partial(values[slots], code=code[slots], many=5) for blocks, slots in parts]
        )
        sums = weights.merge_weight_sums(
            [weights.sum_weights(log_weight[slots], blocks) for blocks, slots in parts]
        )
        for one, other in (
            (both, WHOLE.partial(values, weight)),
            (coded, WHOLE.partial(values, code=code, many=5)),
        ):
            assert np.array_equal(one.by_scenario, other.by_scenario)
            assert np.array_equal(one.total, other.total)
        alone = weights.sum_weights(log_weight, WHOLE)
        assert np.array_equal(sums.log_sums, alone.log_sums)
        assert (sums.log_sum, sums.ess) == (alone.log_sum, alone.ess)


def test_sums_are_those_of_exact_arithmetic() -> None:
    """Within n rounding errors of the sum of sizes (Higham 2002, eq. 4.4), n the terms of a block
    and the blocks.
    """
    values = RNG.normal(size=N)
    bound = (BLOCK + 16) * 2.0**-53 * np.abs(values).sum()
    partial = WHOLE.partial(values)
    exact = [float(sum(map(Fraction, values[a:b].tolist()))) for a, b in itertools.pairwise(BOUNDS)]
    np.testing.assert_allclose(partial.by_scenario[:, 0, 0], exact, rtol=0, atol=bound)
    assert WHOLE.total(values) == pytest.approx(math.fsum(values), abs=bound)
    code, some = RNG.integers(0, 4, N), np.flatnonzero(RNG.random(N) < 0.3)
    exact = [math.fsum(values[code == k]) for k in range(4)]
    np.testing.assert_allclose(WHOLE.table(code, 4, values), exact, rtol=0, atol=bound)
    assert WHOLE.table(code, 4, values, values**2).shape == (2, 4)
    assert WHOLE.total(values[some], some) == pytest.approx(math.fsum(values[some]), abs=bound)
    family = np.sort(RNG.integers(0, 900, N))
    exact = [math.fsum(values[family == k]) for k in range(family.max() + 1)]
    np.testing.assert_allclose(WHOLE.sum_by_group(family, values), exact, rtol=0, atol=bound)
    shuffled = RNG.permutation(family)  # not in runs: still right
    exact = [math.fsum(values[shuffled == k]) for k in range(family.max() + 1)]
    np.testing.assert_allclose(WHOLE.sum_by_group(shuffled, values), exact, rtol=0, atol=bound)


def test_running_sums_never_fall_and_end_at_the_sum() -> None:
    values = RNG.random(N) * (RNG.random(N) < 0.5)
    running = WHOLE.running(values)
    assert (np.diff(running) >= 0).all()
    np.testing.assert_allclose(running, np.cumsum(values), rtol=1e-12)
    # and those of a shard are those of the whole, less what came before: it needs the sums of
    # blocks alone
    begun = np.concatenate([[0.0], np.cumsum(WHOLE.partial(values).sums[:, 0, 0])])
    for block, (a, b) in enumerate(zip(WHOLE.first, [*WHOLE.first[1:], N], strict=True)):
        own = np.minimum(np.cumsum(values[a:b]) + begun[block], begun[block + 1])
        assert np.array_equal(own, running[a:b])


def test_weights_of_any_size_are_summed_without_overflow() -> None:
    """Log weights from -4000 to 3000: exp of either is no float; logs of sums against
    scipy.special.logsumexp in float64.
    """
    log_weight = RNG.uniform(-50, 50, N).astype(np.float32)
    for shift, (a, b) in zip((3000, -4000, 0, 700), itertools.pairwise(BOUNDS), strict=True):
        log_weight[a:b] += shift
    log_weight[5:900] = -np.inf
    sums = weights.sum_weights(log_weight, WHOLE)
    exact = [
        special.logsumexp(log_weight[a:b].astype(float)) for a, b in itertools.pairwise(BOUNDS)
    ]
    np.testing.assert_allclose(sums.log_sums, exact, rtol=1e-12)
    assert sums.log_sum == pytest.approx(special.logsumexp(log_weight.astype(float)), rel=1e-12)
    share = np.exp(log_weight.astype(float) - log_weight.max())
    assert sums.ess == pytest.approx(share.sum() ** 2 / (share**2).sum(), rel=1e-11)
    assert sums.scenarios == pytest.approx([1, 0, 0, 0], abs=1e-300)
    assert weights.normalised(log_weight, WHOLE) == pytest.approx(share / share.sum(), rel=1e-10)


def test_no_weight_at_all_has_no_sum() -> None:
    sums = weights.sum_weights(np.full(N, -np.inf, np.float32), WHOLE)
    assert sums.log_sum == -np.inf
    assert (sums.log_sums == -np.inf).all()


def test_an_empty_scenario_counts_as_nothing() -> None:
    blocks = partials.cut_blocks((0, 3, 3, 5), (0, 3, 3), (BLOCK,) * 3)
    assert blocks.partial(np.arange(5.0)).by_scenario[:, 0, 0].tolist() == [3, 0, 7]
    sums = weights.sum_weights(np.log(np.arange(1.0, 6.0)).astype(np.float32), blocks)
    assert np.exp(sums.log_sums) == pytest.approx([6, 0, 9])
