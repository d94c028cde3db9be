"""A concave curve above every way of spending coverage, by any mix of laws: what the upper bound of a plan is made from.

Let m(C) = 1 - b(C) be a law's chance of a miss at coverage C, h = -log m. Sorties miss independently, so a particle that
gets C1 .. Cn from laws 1 .. n is missed with exp(-(h1(C1) + ... + hn(Cn))). That product is not convex in (C1 .. Cn): the best law
may be one at little coverage and another at much. But with H(C) the most that any split of C over the laws, each used any
number of times, can add up to (their superadditive hull), it is at least exp(-H(C1 + ... + Cn)), and the least concave curve
above 1 - exp(-H) bounds every mix from above. For the laws of SEARCH.md h is superadditive already (inverse cube and
definite range: convex; random search: linear; M-beta: convex between whole looks, linear over them), so that a single law is its
own bound.

Unknown sweep widths: factors T of mean 1, one a group. E b(sum T_g C_g) is highest, in the convex order, when all groups are as
sure as the surest and C is shared evenly among them: then the factor is gamma of the sum of their shapes. That bounds any share.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from drift import detection
from drift.sortie import Law

Array = npt.NDArray[Any]

STEP = 0.02  # of coverage: a straight line in between is 7e-5 low where b'' is -1.4
MOST = 20.0  # coverage beyond which nothing is gained
SMOOTH = 0.06  # half the window of coverage over which slopes are averaged, so that a kink does not stall the search
SURE = 40.0  # -log of a miss that counts as none


@dataclass(frozen=True)
class Curve:
    """b at coverages 0, STEP, ..., MOST, concave and rising; slopes to search with; and its conjugate at slopes."""

    value: Array  # (n,) smoothed: the integral of the slopes, at most b
    slope: Array  # (n,) falling: any slopes will do for a bound, these are near the true ones
    conjugate: Array  # (n,) max over C of b(C) - y C, at y = slopes[k] = k / (n - 1) * slope[0]

    @property
    def steepest(self) -> float:
        """Slope at no coverage."""
        return float(self.slope[0])


def curve(laws: Sequence[Law], shapes: Sequence[float] = ()) -> Curve:
    """Return the concave curve that bounds every use of some laws together.

    shapes: of the gamma distribution of each independent unknown factor of sweep width (inf: known); none: known.
    """
    c = np.arange(round(MOST / STEP) + 1) * STEP
    each = {law: hazard(law, c) for law in laws}
    total = _hull(list(each.values()))
    b = _envelope(c, -np.expm1(-total))
    shape = len(shapes) * max(shapes) if shapes else math.inf
    nodes, weights = detection.factors(shape)
    if len(nodes) > 1:
        b = sum(w * np.interp(node * c, c, b) for node, w in zip(nodes, weights, strict=True))
        b = _envelope(c, b)
    slope = _slopes(c, b)
    y = np.linspace(0, slope[0], len(c))
    # The conjugate of straight pieces is taken at a corner: where the piece to the right is no steeper than y.
    pieces = np.diff(b) / STEP
    at = np.searchsorted(-pieces, -y, side="left")
    smooth = np.concatenate([[0.0], np.cumsum((slope[1:] + slope[:-1]) / 2) * STEP])
    return Curve(smooth, slope, b[at] - y * c[at])


def hazard(law: Law, coverage: Array) -> Array:
    """Return -log of the chance of a miss, rising, at most SURE."""
    with np.errstate(divide="ignore"):
        h = -np.log(np.maximum(1 - detection.pod(law, coverage), 0))
    if law.kind == "inverse_cube":  # its tail by erfc: 1 - erf has lost its digits there
        from scipy import special

        h = -np.log(np.maximum(special.erfc(math.sqrt(math.pi) / 2 * coverage), 1e-300))
    if law.kind == "random":
        h = coverage
    return np.minimum(np.maximum.accumulate(h), SURE)


def _hull(each: list[Array]) -> Array:
    """Return the least superadditive curve above all: the most that a sum over splits of the coverage can reach."""
    total = np.max(each, axis=0)
    n = len(total)
    for _ in range(6):  # doubling the parts each time: up to 64
        best = total.copy()
        for k in range(1, n):
            np.maximum(best[k:], total[: n - k] + total[k], out=best[k:])
        best = np.minimum(best, SURE)
        if np.max(best - total) < 1e-6:
            break
        total = best
    return np.asarray(total)


def _envelope(c: Array, b: Array) -> Array:
    """Return the least concave curve above b, at c."""
    hull = [0]
    for k in range(1, len(c)):
        while len(hull) > 1:
            i, j = hull[-2], hull[-1]
            if (b[j] - b[i]) * (c[k] - c[i]) <= (b[k] - b[i]) * (c[j] - c[i]):
                hull.pop()
            else:
                break
        hull.append(k)
    return np.asarray(np.interp(c, c[hull], b[hull]))


def _slopes(c: Array, b: Array) -> Array:
    """Return slopes averaged over a window, straight on below no coverage."""
    first, last = (b[1] - b[0]) / STEP, b[-1]
    low, high = c - SMOOTH, c + SMOOTH
    below = np.where(low < 0, low * first, np.interp(low, c, b))
    above = np.interp(high, c, b, right=last)
    return np.asarray(np.maximum((above - below) / (2 * SMOOTH), 0.0))
