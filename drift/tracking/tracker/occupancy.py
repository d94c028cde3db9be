"""Occupancy maps: the probability of a target by cells, which spreads while nobody sees it.

Isla 2006, Probabilistic target tracking and search using occupancy maps; equations 0.9 to 0.13 of
Borovies 2007. Cells are as large as each other and have four neighbours. It is exact for a target
that walks from cell to cell at random, and needs no particles; it knows neither course nor speed.
"""

import numpy as np
from scipy import ndimage

from geo.array import Array

NEIGHBOURS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], float)


def seen(shape: tuple[int, int], cell: tuple[int, int]) -> Array:
    """Return the map of a target that is seen in a cell."""
    found = np.zeros(shape)
    found[cell] = 1.0
    return found


def unseen(probability: Array, visible: Array) -> tuple[Array, float]:
    """Return the map after a look that found nothing in cells (bool), and the probability that was
    there.

    Isla's measures: that is what surprises when the target is found where little is left, and what
    confuses when it was much. Raises ValueError where the target could be nowhere else.
    """
    culled = float(probability[visible].sum())
    left = np.where(visible, 0.0, probability)
    if not left.sum() > 0:
        raise ValueError("nothing is left: the target was seen nowhere, and could be nowhere else")
    return left / left.sum(), culled


def spread(probability: Array, rate: float) -> Array:
    """Return the map a step later; rate: share of a cell that goes over to its neighbours, 0 to 1.

    What would go over the edge stays.
    """
    if not 0 <= rate <= 1:
        raise ValueError(f"rate {rate:g} must be 0 to 1")
    neighbours = ndimage.convolve(np.ones_like(probability), NEIGHBOURS, mode="constant")
    stays = probability * (1 - rate * neighbours / 4)
    return np.asarray(stays + rate / 4 * ndimage.convolve(probability, NEIGHBOURS, mode="constant"))
