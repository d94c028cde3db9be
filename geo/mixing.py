"""Bit mixing of 64-bit words: reproducible numbers that look random."""

import numpy as np

from geo.array import Array


def mixed(words: Array) -> Array:
    """Return words (uint64) with their bits mixed, same shape.

    It is the final step of SplitMix64: Steele et al. 2014, doi:10.1145/2660193.2660195.
    """
    with np.errstate(over="ignore"):
        words = (words ^ (words >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        words = (words ^ (words >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(words ^ (words >> np.uint64(31)))
