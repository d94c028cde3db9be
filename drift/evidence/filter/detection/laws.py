"""Detection functions: from coverage to probability of detection and back.

Coverage C is sweep width times track length over area. Sources: Koopman 1980, Search and Screening,
chapter 3 (inverse cube, random search, definite range); Washburn 2014, Search and Detection,
chapter 2. M-beta is SAROPS' conversion of a sweep width into a probability and a range.

A new detection function is one entry of LAWS. If it has parameters, add them to
drift.evidence.filter.records.Law and their keys to drift.case.search.sensor.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from drift.evidence.filter.records import Law
from geo.array import Array

NODES = 16  # nodes of the quadrature over an unknown sweep width
OFFSETS = 2000  # lateral offsets over which endless sweeps by a curve are averaged
MOST = 50.0  # highest coverage
ACROSS = 4000  # ranges at which a lateral range curve is evaluated
ENDS = 0.25  # sweep widths that the two ends of a path add to its length (see concave)


def _plain(law: Law) -> str:
    return f'"{law.kind}"'


@dataclass(frozen=True)
class Formulas:
    """The formulas of a detection function. Each takes the law, for its parameters."""

    # How it detects: by a rate anywhere in its area, by a rate along its legs, or once, abeam of
    # each leg.
    detects: Literal["anywhere", "along", "abeam"]
    pod: Callable[[Law, Array], Array]  # b(C)
    # g(h) is the integral across a leg of its hazard, cut off at h, over its sweep width.
    cap: Callable[[Law, Array], Array]
    coverage: Callable[[Law, float], float] | None = None  # C of a POD; None: by a root finder
    # The lateral range curve, for `range_curve`; each law that detects abeam has one.
    lateral: Callable[[Law], tuple[Array, Array]] | None = None
    # sweep width [m] that the law implies; None: it must be given
    width: Callable[[Law], float] | None = None
    # largest POD of any legs at C, if the bound from `cap` is higher
    any_legs: Callable[[Law, Array], Array] | None = None
    sure: bool = False  # whether some coverage has a POD of 1
    ends: float = 0.0  # sweep widths that the two ends of a path add to its length, at most
    written: Callable[[Law], str] = _plain  # the law in TOML, as in a case file


def formulas_of(law: Law) -> Formulas:
    """Return the formulas of a detection function."""
    return LAWS[law.kind]


def pod(law: Law, coverage: npt.ArrayLike) -> Array:
    """Return b(C), the POD of endless parallel sweeps at coverages of any shape.

    For random search, the legs are anywhere.
    """
    return formulas_of(law).pod(law, np.asarray(coverage, np.float64))


def coverage_of(law: Law, chance: float) -> float:
    """Return the coverage at which a detection function has a POD.

    Raises:
        ValueError: no coverage has this POD.
    """
    if not 0 <= chance < 1 and not (chance == 1 and formulas_of(law).sure):
        raise ValueError(
            f"a POD of {chance:g} needs endless effort; it must be at least 0 and below 1"
        )
    if chance == 0:
        return 0.0
    if (inverse := formulas_of(law).coverage) is not None:
        return inverse(law, chance)
    if pod(law, MOST) <= chance:
        raise ValueError(
            f"this detection function reaches a POD of {float(pod(law, MOST)):.3g} at most, not {chance:g}"
        )
    # imported here, since most cases search nothing and it takes a third of a second
    from scipy import optimize

    return float(optimize.brentq(lambda c: float(pod(law, c)) - chance, 0.0, MOST, xtol=1e-12))


def range_curve(law: Law) -> tuple[Array, Array]:
    """Return the lateral range curve of a law that detects abeam.

    The curve is linear between its points and 0 beyond the last; two equal ranges are a jump. Twice
    its integral is 1.

    Returns:
        Ranges as shares of W, and the POD there, both (k,).
    """
    if (lateral := formulas_of(law).lateral) is None:
        raise ValueError(f"{law.kind} has no lateral range curve of its own")
    return lateral(law)


def curve_sweep_width(law: Law) -> float:
    """Return the sweep width [m] of a lateral range curve: twice its integral."""
    ranges, chances = np.array(law.ranges), np.array(law.chances)
    return float(np.sum((chances[1:] + chances[:-1]) * np.diff(ranges)))


def _inverse_cube(_law: Law, c: Array) -> Array:
    from scipy import special  # imported here, as above

    return np.asarray(special.erf(math.sqrt(math.pi) / 2 * c))


def _m_beta(law: Law, c: Array) -> Array:
    looks = c / law.beta  # r = 2 M / S
    whole = np.floor(looks)
    return np.asarray(1 - (1 - law.beta) ** whole * (1 - law.beta * (looks - whole)))


def _m_beta_cap(law: Law, h: Array) -> Array:
    return np.asarray(np.minimum(h, -np.log1p(-law.beta) if law.beta < 1 else np.inf) / law.beta)


def _curve(law: Law) -> tuple[Array, Array]:
    ranges, chances = np.array(law.ranges), np.array(law.chances)
    return ranges / curve_sweep_width(law), chances


def _curve_cap(law: Law, h: Array) -> Array:
    ranges, chances = _curve(law)
    at = (np.arange(ACROSS) + 0.5) / ACROSS * ranges[-1]
    with np.errstate(divide="ignore"):
        hazard = np.sort(-np.log1p(-np.interp(at, ranges, chances)))
    finite = np.where(np.isfinite(hazard), hazard, 0.0)
    below = np.searchsorted(hazard, h)
    whole = np.concatenate([[0.0], np.cumsum(finite)])[below] + h * (ACROSS - below)
    return np.asarray(2 * ranges[-1] / ACROSS * whole)


def _curve_written(law: Law) -> str:
    rows = (f'["{r:.9g} m", {p!r}]' for r, p in zip(law.ranges, law.chances, strict=True))
    return f"{{ curve = [{', '.join(rows)}] }}"


@lru_cache(maxsize=16)
def _endless(law: Law) -> tuple[Array, Array]:
    """Return coverages, and the POD of endless parallel sweeps at spacing W / C.

    The sweeps have the lateral range curve of the law.
    """
    ranges, chances = range_curve(law)
    coverages = np.concatenate([np.linspace(0, 4, 161), np.linspace(4.25, MOST, 184)])
    pods = np.zeros(len(coverages))
    for k, c in enumerate(coverages[1:], 1):
        tracks = np.arange(-math.ceil(ranges[-1] * c) - 1, math.ceil(ranges[-1] * c) + 2) / c
        offset = (np.arange(OFFSETS) + 0.5) / OFFSETS / c
        miss = np.ones(OFFSETS)
        for track in tracks:
            miss *= 1 - np.interp(np.abs(offset - track), ranges, chances, right=0.0)
        pods[k] = 1 - miss.mean()
    return coverages, pods


LAWS = {
    "random": Formulas(
        detects="anywhere",
        pod=lambda _, c: np.asarray(-np.expm1(-c)),
        cap=lambda _, h: np.ones(len(h)),
        coverage=lambda _, chance: -math.log1p(-chance),
    ),
    "inverse_cube": Formulas(
        detects="along",
        pod=_inverse_cube,
        cap=lambda _, h: np.asarray(2 * np.sqrt(h / np.pi)),
        ends=ENDS,
    ),
    "definite_range": Formulas(
        detects="abeam",
        pod=lambda _, c: np.minimum(c, 1.0),
        cap=lambda _, h: h,
        coverage=lambda _, chance: chance,
        lateral=lambda _: (np.array([0.0, 0.5]), np.array([1.0, 1.0])),
        sure=True,
    ),
    "m_beta": Formulas(
        detects="abeam",
        pod=_m_beta,
        cap=_m_beta_cap,
        lateral=lambda law: (np.array([0.0, 0.5 / law.beta]), np.array([law.beta, law.beta])),
        any_legs=_m_beta,
        written=lambda law: f"{{ m_beta = {law.beta!r} }}",
    ),
    "curve": Formulas(
        detects="abeam",
        pod=lambda law, c: np.interp(c, *_endless(law)),
        cap=_curve_cap,
        lateral=_curve,
        width=curve_sweep_width,
        written=_curve_written,
    ),
}


def factors(shape: float, count: int = NODES) -> tuple[Array, Array]:
    """Return nodes and weights of the unknown factor of a sweep width, both (count,).

    The factor has a gamma distribution of this shape and of mean 1; an infinite shape is a known
    width, with one node. Gauss-Laguerre quadrature by the eigenvalues of the Jacobi matrix (Golub
    and Welsch 1969, doi:10.1090/S0025-5718-69-99647-1). SciPy's roots_genlaguerre gives NaN weights
    for shapes above 171, a sweep width known to 7.6 % or better.
    """
    if math.isinf(shape):
        return np.ones(1), np.ones(1)
    from scipy.linalg import eigh_tridiagonal  # imported here, as above

    k = np.arange(count)
    nodes, vectors = eigh_tridiagonal(2 * k + shape, np.sqrt(k[1:] * (k[1:] + shape - 1)))
    return nodes / shape, vectors[0] ** 2
