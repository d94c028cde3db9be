"""Shapley values: a total divided among its sources, whatever the order in which they are added.

A coalition is a set of sources that are on, as the bits of a number: source i is 2^i. The Shapley
value of a source is the mean, over all orders of the sources, of what it adds to those before it
(Shapley 1953, doi:10.1515/9781400881970-018; of variances Owen 2014, doi:10.1137/130936233). The
values add up to the total less that of no source.
"""

import math

import numpy as np

from geo.array import Array


def shapley_values(values: Array) -> Array:
    """Return the Shapley value of each source, (sources, ...).

    Args:
        values: of each coalition, (2^sources, ...).
    """
    many = values.shape[0].bit_length() - 1
    coalitions = np.arange(values.shape[0])
    sizes = np.array([int(one).bit_count() for one in coalitions])
    weight = np.array(
        [
            math.factorial(size) * math.factorial(max(many - size - 1, 0)) / math.factorial(many)
            for size in sizes
        ]
    )
    found = []
    for source in range(many):
        without = coalitions[coalitions >> source & 1 == 0]
        added = values[without | 1 << source] - values[without]
        found.append(np.tensordot(weight[without], added, axes=1))
    return np.array(found).reshape(many, *values.shape[1:])


def without_each(values: Array) -> Array:
    """Return the value of all sources but one, for each one, (sources, ...)."""
    whole = values.shape[0] - 1
    return values[[whole & ~(1 << source) for source in range(whole.bit_length())]]


def each_alone(values: Array) -> Array:
    """Return the value of each source alone, (sources, ...)."""
    return values[[1 << source for source in range((values.shape[0] - 1).bit_length())]]
