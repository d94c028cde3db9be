"""Sums of marginal distributions over particles: mean, share and quantiles as sorting all of them
gives them.
"""

from typing import NamedTuple

import numpy as np
import pytest
from scipy import stats
from voyages import moments

from drift.engine.particles import columns, partials
from drift.engine.particles.columns import Columns
from drift.engine.particles.partials import Blocks
from drift.evidence.posterior import marginal
from geo.array import Array


def sorted_quantiles(values: Array, weight: Array) -> Array:
    """Return the least values up to and with which weights add up to the levels, by sorting all of
    them.
    """
    order = np.argsort(values, kind="stable")
    up_to = np.cumsum(weight[order])
    return values[order][np.searchsorted(up_to, np.array(marginal.LEVELS) * up_to[-1])]


def particles(weight: Array, blocks: Blocks, **more: Array) -> marginal.Weighted:
    """Return particles (n,) of some weights, of which the largest is 1, and more columns."""
    with np.errstate(divide="ignore"):
        return marginal.weighted(Columns.held(blocks, {"log_weight": np.log(weight), **more}))


def quantity(values: Array, holds: Array, blocks: Blocks) -> Columns:
    """Return a quantity as beliefs read it."""
    return Columns.held(blocks, {"values": values, "holds": holds})


class Some(NamedTuple):
    """Weights of 23,456 particles in four scenarios, the third of which has none left; where
    something holds.
    """

    blocks: Blocks
    weight: Array
    scenario: Array
    holds: Array
    rng: np.random.Generator


@pytest.fixture
def some() -> Some:
    """Draw them."""
    rng = np.random.default_rng(7)
    bounds = (0, 9001, 9342, 14_000, 23_456)
    weight = rng.exponential(size=bounds[-1]) ** 3
    weight[bounds[2] : bounds[3]] = 0
    weight /= weight.max()
    scenario = np.repeat(np.arange(4), np.diff(bounds))
    blocks = partials.cut_blocks(bounds, bounds[:-1], (partials.BLOCK,) * 4)
    return Some(blocks, weight, scenario, rng.random(bounds[-1]) < 0.7, rng)


LAWS = {
    "normal": lambda rng, n: rng.normal(41.3, 2.2, n),
    "long tail": lambda rng, n: 3e5 + rng.lognormal(1.0, 2.5, n),
    "whole numbers": lambda rng, n: rng.integers(-3, 9, n).astype(float) ** 3,
    "nearly one value": lambda rng, n: np.where(rng.random(n) < 0.97, 5.5, rng.normal(0, 900, n)),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("outside", [False, True])
@pytest.mark.parametrize("few", [False, True])
def test_numbers_are_summed_and_ranked_exactly(
    law: str, outside: bool, few: bool, some: Some, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mean, std, share, effective number and quantiles of each scenario and of all: sorting
    everything says the same.

    Also where values lie outside of the histogram: quantiles do not rest on its bins. few: where
    particles are gone through in parts, and only a few of a bin may be sorted at once.
    """
    if few:
        monkeypatch.setattr(columns, "PART", 5000)
        monkeypatch.setattr(marginal, "SORTED", 37)
    blocks, own_weight, scenario, holds, rng = some
    values = LAWS[law](rng, scenario.size)
    low, high = np.quantile(values, [0.1, 0.6]) if outside else (values.min(), values.max())
    found = marginal.of_number(
        particles(own_weight, blocks), quantity(values, holds, blocks), float(low), float(high)
    )
    assert found.quantiles is not None
    assert found.mean is not None
    assert found.std is not None
    for row in range(5):
        mine = np.ones(scenario.size, bool) if row == 4 else scenario == row
        weight = np.where(holds & mine, own_weight, 0.0)
        if row == 2:
            assert np.isnan(
                [found.share[row], found.mean[row], found.std[row], *found.quantiles[row]]
            ).all()
            continue
        mean, std, ess = moments(values, weight)
        np.testing.assert_allclose(
            [found.mean[row], found.std[row], found.ess[row], found.share[row]],
            [mean, std, ess, weight.sum() / own_weight[mine].sum()],
            rtol=1e-9,
        )
        np.testing.assert_array_equal(
            found.quantiles[row], sorted_quantiles(values[weight > 0], weight[weight > 0])
        )
    np.testing.assert_allclose(found.table.sum(), found.share[-1], rtol=1e-12)


def test_one_value_has_no_spread(some: Some) -> None:
    """Rounding of the sums is not told as a standard deviation."""
    blocks, weight, _, holds, _ = some
    values = quantity(np.full(weight.size, 7233.1), holds, blocks)
    found = marginal.of_number(particles(weight, blocks), values, 3600.0, 86_400.0)
    assert found.std is not None
    assert found.quantiles is not None
    np.testing.assert_array_equal(found.std, [0, 0, np.nan, 0, 0])
    np.testing.assert_array_equal(found.quantiles[[0, 1, 3, 4]], 7233.1)


@pytest.mark.parametrize("few", [False, True])
def test_angles_through_north(few: bool, some: Some, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mean and std as scipy has them of as many copies as weights say; quantiles as of angles from
    -180 to 180.
    """
    if few:
        monkeypatch.setattr(columns, "PART", 5000)
        monkeypatch.setattr(marginal, "SORTED", 37)
    blocks, _, scenario, holds, rng = some
    copies = rng.integers(0, 9, scenario.size).astype(float)
    degrees = rng.triangular(-48, 9, 77, scenario.size)
    turned = np.radians(degrees) + 2 * np.pi * rng.integers(0, 2, scenario.size)
    found = marginal.of_angle(particles(copies / 8, blocks), quantity(turned, holds, blocks))
    assert found.quantiles is not None
    assert found.mean is not None
    assert found.std is not None
    for row in (0, 1, 3, 4):
        mine = holds if row == 4 else holds & (scenario == row)
        repeated = np.radians(np.repeat(degrees[mine], copies[mine].astype(int)))
        assert found.mean[row] == pytest.approx(stats.circmean(repeated), rel=1e-10)
        assert found.std[row] == pytest.approx(stats.circstd(repeated), rel=1e-10)
        expected = sorted_quantiles(degrees[mine], copies[mine]) % 360
        np.testing.assert_allclose(np.degrees(found.quantiles[row]), expected, atol=1e-9)
    assert np.degrees(found.quantiles[-1, 0]) > 300 > np.degrees(found.quantiles[-1, -1])
    inside = (degrees % 360 >= 350) & holds
    bins = found.table[0, round(350 / 360 * 256) + 1 :].sum()  # the bins from 351.6 on
    assert bins == pytest.approx(
        copies[holds & (degrees % 360 >= 250 / 256 * 360)].sum() / copies.sum()
    )
    assert bins < copies[inside].sum() / copies.sum()


def test_categories_are_summed_exactly(some: Some) -> None:
    """Shares of each scenario's own weight; what a category means nothing for is missing from their
    sum.
    """
    blocks, weight, scenario, holds, rng = some
    number = rng.integers(0, 3, scenario.size)
    found = marginal.of_category(
        particles(weight, blocks), quantity(np.where(holds, number, -1), holds, blocks), 3
    )
    for row in (0, 1, 3):
        mine = scenario == row
        expected = [
            weight[mine & holds & (number == k)].sum() / weight[mine].sum() for k in range(3)
        ]
        np.testing.assert_allclose(found.table[row], expected, rtol=1e-12)
    np.testing.assert_allclose(found.share[-1], weight[holds].sum() / weight.sum(), rtol=1e-12)


def test_copies_count_as_one(some: Some, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each particle parted into copies of its weight counts as the one that it was, wherever they
    lie in its scenario.
    """
    monkeypatch.setattr(columns, "PART", 5000)
    blocks, weight, scenario, holds, rng = some
    own = particles(weight, blocks)
    copies = rng.integers(1, 5, scenario.size)
    family = np.repeat(np.arange(scenario.size), copies)
    family = family[np.lexsort((rng.random(family.size), scenario[family]))]
    bounds = (0, *np.cumsum(np.bincount(scenario, copies, 4)).astype(int))
    parted_blocks = partials.cut_blocks(bounds, bounds[:-1], (partials.BLOCK,) * 4)
    parted = (weight / copies)[family]
    many = particles(parted, parted_blocks, lineage=family)
    np.testing.assert_allclose(many.ess, own.ess, rtol=1e-10)
    number = rng.integers(0, 3, scenario.size)
    found = marginal.of_category(many, quantity(number[family], holds[family], parted_blocks), 3)
    np.testing.assert_allclose(
        found.ess, marginal.of_category(own, quantity(number, holds, blocks), 3).ess, rtol=1e-10
    )
    assert particles(parted, parted_blocks).ess[-1] > 2 * own.ess[-1]  # what would be told without
