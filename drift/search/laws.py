"""Laws of detection: from coverage to probability of detection and back, and what is not known of a sweep width.

Coverage C is sweep width times track over area. Sources: Koopman 1980, Search and Screening, chapter 3 (inverse cube, random
search, definite range); Washburn 2014, Search and Detection, chapter 2; the M-beta law is SAROPS' way to put a sweep width
into a chance and a range.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import optimize, special
from scipy.linalg import eigh_tridiagonal

from drift.search.records import Law

Array = npt.NDArray[Any]

NODES = 16  # of the quadrature over an unknown sweep width
OFFSETS = 2000  # at which endless sweeps by a curve are averaged
MOST = 50.0  # coverage beyond which nothing is asked


def pod(law: Law, coverage: npt.ArrayLike) -> Array:
    """Return b(C), the probability of detection under endless parallel sweeps (random: anywhere); any shape."""
    c = np.asarray(coverage, np.float64)
    if law.kind == "random":
        return np.asarray(-np.expm1(-c))
    if law.kind == "inverse_cube":
        return np.asarray(special.erf(math.sqrt(math.pi) / 2 * c))
    if law.kind == "definite_range":
        return np.minimum(c, 1.0)
    if law.kind == "m_beta":
        looks = c / law.beta  # r = 2 M / S
        whole = np.floor(looks)
        return np.asarray(1 - (1 - law.beta) ** whole * (1 - law.beta * (looks - whole)))
    return np.interp(c, *_endless(law))


def coverage_of(law: Law, chance: float) -> float:
    """Return the coverage at which a law detects with a chance; raise ValueError where none does."""
    if not 0 <= chance < 1 and not (chance == 1 and law.kind == "definite_range"):
        raise ValueError(f"a POD of {chance:g} needs endless effort; it must be at least 0 and below 1")
    if chance == 0:
        return 0.0
    if law.kind == "random":
        return -math.log1p(-chance)
    if law.kind == "definite_range":
        return chance
    if pod(law, MOST) <= chance:
        raise ValueError(f"this law reaches a POD of {float(pod(law, MOST)):.3g} at most, not {chance:g}")
    return float(optimize.brentq(lambda c: float(pod(law, c)) - chance, 0.0, MOST, xtol=1e-12))


def table(law: Law) -> tuple[Array, Array]:
    """Return the lateral range curve of a law without a rate: ranges as shares of W, and the chance there.

    Straight in between, nothing beyond the last; two equal ranges are a jump. Twice its integral is 1.
    """
    if law.kind == "definite_range":
        return np.array([0.0, 0.5]), np.array([1.0, 1.0])
    if law.kind == "m_beta":
        return np.array([0.0, 0.5 / law.beta]), np.array([law.beta, law.beta])
    if law.kind != "curve":
        raise ValueError(f"{law.kind} has no lateral range curve of its own")
    ranges, chances = np.array(law.ranges), np.array(law.chances)
    return ranges / swept(law), chances


def swept(law: Law) -> float:
    """Return the sweep width [m] of a lateral range curve: twice its integral."""
    ranges, chances = np.array(law.ranges), np.array(law.chances)
    return float(np.sum((chances[1:] + chances[:-1]) * np.diff(ranges)))


@lru_cache(maxsize=16)
def _endless(law: Law) -> tuple[Array, Array]:
    """Return coverages and the POD of endless parallel sweeps by a lateral range curve at spacing W / C."""
    ranges, chances = table(law)
    coverages = np.concatenate([np.linspace(0, 4, 161), np.linspace(4.25, MOST, 184)])
    found = np.zeros(len(coverages))
    for k, c in enumerate(coverages[1:], 1):
        tracks = np.arange(-math.ceil(ranges[-1] * c) - 1, math.ceil(ranges[-1] * c) + 2) / c
        offset = (np.arange(OFFSETS) + 0.5) / OFFSETS / c
        miss = np.ones(OFFSETS)
        for track in tracks:
            miss *= 1 - np.interp(np.abs(offset - track), ranges, chances, right=0.0)
        found[k] = 1 - miss.mean()
    return coverages, found


def factors(shape: float) -> tuple[Array, Array]:
    """Return nodes and weights of the unknown factor of a sweep width: gamma of a shape, mean 1; one node where W is known.

    Gauss-Laguerre by the eigenvalues of its Jacobi matrix (Golub and Welsch 1969, doi:10.1090/S0025-5718-69-99647-1).
    """
    if math.isinf(shape):
        return np.ones(1), np.ones(1)
    k = np.arange(NODES)
    nodes, vectors = eigh_tridiagonal(2 * k + shape, np.sqrt(k[1:] * (k[1:] + shape - 1)))
    return nodes / shape, vectors[0] ** 2
