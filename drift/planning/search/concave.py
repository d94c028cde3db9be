"""How much any legs find at a coverage: the curve that the upper bound of a plan is made from.

A set of legs gives a particle at x the hazard H(x), the sum over legs of -log(1 - chance); it is
found with the chance 1 - e^-H = integral over h of e^-h min(H, h), exactly. min(., h) of a sum is
at most the sum of min(., h) of its parts, and one leg of length L adds W L g(h) to the integral of
min(H, h) over the sea, with g(h) the integral of min(-log(1 - p(r)), h) across the leg, over W.
Where the legs' W L come to the coverage C of an area the mean of min(H, h) is therefore at most C
g(h), and at most h:

    b(C) = integral over h of e^-h min(h, C g(h))

bounds every set of legs, parallel or not, long or short, of one law or (with the greatest g) of
several. It is concave in C. Random search has g = 1, for its hazard is its coverage: b = 1 - e^-C.
Definite range: g = h, b = min(C, 1). Inverse cube: g = 2 sqrt(h / pi), b = 1 - exp(-4 C^2 / pi) + C
erfc(2 C / sqrt(pi)): 0.831 at C = 1, where parallel sweeps find 0.790. M-beta by itself finds at
most what whole numbers of looks can, which is what its parallel sweeps find.

Of a leg of inverse cube that ends, the integral is 2 sqrt(h / pi) W L + W^2 / 4 at the most
(laws.ENDS): what lies ahead and astern.

Unknown sweep widths: factors T of mean 1, one a group. E b(sum T_g C_g) is highest, in the convex
order, when all groups are as sure as the surest and C is shared evenly among them: then the factor
is gamma of the sum of their shapes. That bounds any share.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from drift.evidence.filter.detection import laws
from drift.evidence.filter.records import Law
from geo.array import Array

STEP = 0.01  # of coverage
MOST = 20.0  # coverage beyond which nothing is gained
# half the window of coverage over which slopes are averaged, so that a kink does not stall the
# search
SMOOTH = 0.06
ROOTS = np.linspace(0.0, 6.5, 3251)  # of h: e^-h is 4e-19 at the last
# p beyond which sums of Bessel functions lose their digits, and what wanders goes nearly straight
STRAIGHT = 6.0
SHORT = 1e-5  # share by which the integral over ROOTS may be too low


@dataclass(frozen=True)
class Curve:
    """The curve b at coverages 0, STEP, ..., MOST: concave and rising; with its slopes and its
    conjugate.
    """

    value: Array  # (n,) smoothed: the integral of the slopes, at most b
    slope: Array  # (n,) falling: any slopes will do for a bound, these are near the true ones
    conjugate: Array  # (n,) max over C of b(C) - y C, at y = slopes[k] = k / (n - 1) * slope[0]

    @property
    def steepest(self) -> float:
        """Slope at no coverage."""
        return float(self.slope[0])


@lru_cache(maxsize=16)
def curve(used: tuple[Law, ...], shapes: tuple[float, ...] = (), wander: float = 0.0) -> Curve:
    """Return the concave curve that bounds every use of some laws together.

    shapes: of the gamma distribution of each independent unknown factor of sweep width (inf:
    known); none: known. wander: of Brownian bridges, as `wandering` takes it; 0: none.
    """
    c = np.arange(round(MOST / STEP) + 1) * STEP
    b = most(used, c, wander)
    shape = len(shapes) * max(shapes) if shapes else math.inf
    nodes, weights = laws.factors(shape)
    if len(nodes) > 1:
        b = sum(w * np.interp(node * c, c, b) for node, w in zip(nodes, weights, strict=True))
        b = _envelope(c, b)
    slope = _slopes(c, b)
    y = np.linspace(0, slope[0], len(c))
    # The conjugate of straight pieces is taken at a corner: where the piece to the right is no
    # steeper than y.
    pieces = np.diff(b) / STEP
    at = np.searchsorted(-pieces, -y, side="left")
    # Within a piece b is above the straight line, but below those that go on from the pieces beside
    # it: as high as their triangle.
    beside = np.concatenate([[2 * pieces[0] - pieces[1]], pieces, [pieces[-1]]])
    bend, more = beside[:-2] - pieces, pieces - beside[2:]
    peak = STEP * bend * more / np.maximum(bend + more, 1e-30)
    above = np.concatenate([[0.0], np.maximum(peak, 0.0), [0.0]])
    smooth = np.concatenate([[0.0], np.cumsum((slope[1:] + slope[:-1]) / 2) * STEP])
    return Curve(smooth, slope, b[at] - y * c[at] + np.maximum(above[at], above[at + 1]))


def most(used: Sequence[Law], coverage: Array, wander: float = 0.0) -> Array:
    """Return what any legs of some laws find at the most where they come to a coverage, (n,)."""
    if wander == 0 and len(used) == 1 and (known := laws.formulas_of(used[0]).any_legs) is not None:
        return known(used[0], coverage)
    h = ROOTS**2
    g = np.max([laws.formulas_of(law).cap(law, h) for law in used], axis=0)
    if wander > 0 and any(laws.formulas_of(law).detects == "along" for law in used):
        g = np.maximum(g, wandering(h, wander))
    share = np.exp(-h) * 2 * ROOTS
    detected = np.array([np.trapezoid(share * np.minimum(h, c * g), ROOTS) for c in coverage])
    return np.minimum((1 + SHORT) * detected, 1.0)


def wandering(h: Array, wander: float) -> Array:
    """Return g(h) of inverse cube against what wanders about its way, from above.

    wander: K^2 over the speed of the sensor times its sweep width W. Past what goes straight hazard
    falls on few; what wanders by has a little of it each. Of a circle of radius a about the sensor,
    min(H, h) is at most h for all that ever come into it, and what they and others have outside of
    it, W / 4a of coverage. The area from which a circle at speed v gathers Brownian particles of
    diffusivity D = K^2 / 2 is 2 pi D sum of (-1)^n I_n(p) / K_n(p) a second, n over all integers,
    with p = v a / 2 D, from the steady equation of diffusion past it.
    """
    from scipy import special  # imported here, because it takes half a second

    a = np.geomspace(0.02, 20, 200)  # [W]
    p = np.minimum(a / wander, STRAIGHT)
    n = np.arange(1, 60)[:, None]
    alternate = (-1.0) ** n * special.ive(n, p) / special.kve(n, p)
    gathered = np.exp(2 * p) * (special.ive(0, p) / special.kve(0, p) + 2 * alternate.sum(axis=0))
    # beyond STRAIGHT by no smaller a share more than 2 a
    gathered *= np.pi * wander * (a / wander) / p
    return np.asarray(np.min(1 / (4 * a) + h[:, None] * gathered, axis=1))


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
