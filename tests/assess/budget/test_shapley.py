"""Shapley values against the mean over all orders, written out."""

import itertools

import numpy as np
import pytest

from drift.assess.budget import shapley


@pytest.mark.parametrize("many", [1, 2, 3, 5])
def test_values_are_the_mean_over_all_orders(many: int) -> None:
    values = np.random.default_rng(many).normal(size=(2**many, 2, 3))
    found = np.zeros((many, 2, 3))
    orders = list(itertools.permutations(range(many)))
    for order in orders:
        on = 0
        for source in order:
            found[source] += (values[on | 1 << source] - values[on]) / len(orders)
            on |= 1 << source
    np.testing.assert_allclose(shapley.shapley_values(values), found, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found.sum(axis=0), values[-1] - values[0], rtol=0, atol=1e-13)


def test_sources_that_only_add_have_what_they_add() -> None:
    parts = np.array([3.0, 0.0, 11.0, 2.5])
    values = np.array([sum(p for k, p in enumerate(parts) if c >> k & 1) for c in range(16)])
    np.testing.assert_allclose(shapley.shapley_values(values), parts, atol=1e-14)
    np.testing.assert_array_equal(shapley.each_alone(values), parts)
    np.testing.assert_allclose(shapley.without_each(values), parts.sum() - parts, atol=1e-14)
