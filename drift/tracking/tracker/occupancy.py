"""Occupancy maps: the probability of a target by cells, which spreads while it is not seen.

Isla 2006, Probabilistic target tracking and search using occupancy maps; equations 0.9 to 0.13 of
Borovies 2007. Cells are of equal size and have four neighbours. The method is exact for a random
walk from cell to cell and needs no particles; it represents neither course nor speed.
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
    """Return the map after a look without a detection, and the probability removed by it.

    Isla uses that probability as a measure: of surprise if the target is found where little was
    left, of confusion if much was removed.

    Args:
        probability: of the target by cell.
        visible: cells that were looked at, bool.

    Raises:
        ValueError: no probability is left.
    """
    culled = float(probability[visible].sum())
    left = np.where(visible, 0.0, probability)
    if not left.sum() > 0:
        raise ValueError(
            "no probability is left: the target was not seen, and every other cell has probability 0"
        )
    return left / left.sum(), culled


def spread(probability: Array, rate: float) -> Array:
    """Return the map one step later; probability that would cross the edge stays.

    Args:
        probability: of the target by cell.
        rate: share of a cell that moves to its neighbours, 0 to 1.
    """
    if not 0 <= rate <= 1:
        raise ValueError(f"rate {rate:g} must be 0 to 1")
    neighbours = ndimage.convolve(np.ones_like(probability), NEIGHBOURS, mode="constant")
    stays = probability * (1 - rate * neighbours / 4)
    return np.asarray(stays + rate / 4 * ndimage.convolve(probability, NEIGHBOURS, mode="constant"))
