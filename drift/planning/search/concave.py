"""Upper bound of the detection probability of any legs at a coverage, for the bound of plans.

A set of legs gives a particle at x the hazard H(x), the sum over legs of -log(1 - chance). Its
detection probability is 1 - e^-H = integral over h of e^-h min(H, h), exactly. The function min(.,
h) of a sum is at most the sum of min(., h) of its parts. One leg of length L adds W L g(h) to the
integral of min(H, h) over the sea, where g(h) is the integral of min(-log(1 - p(r)), h) across the
leg, over W. If the legs' W L amount to the coverage C of an area, the mean of min(H, h) is
therefore at most C g(h), and at most h:

    b(C) = integral over h of e^-h min(h, C g(h))

bounds every set of legs, parallel or not, long or short, of one law or (with the greatest g) of
several. It is concave in C. Random search has g = 1, because its hazard is its coverage: b = 1 -
e^-C. Definite range: g = h, b = min(C, 1). Inverse cube: g = 2 sqrt(h / pi), b = 1 - exp(-4 C^2 /
pi) + C erfc(2 C / sqrt(pi)), which is 0.831 at C = 1, where parallel sweeps reach 0.790. M-beta
alone reaches at most the result of a whole number of looks, which is that of its parallel sweeps.

For an inverse cube leg that ends, the integral is at most 2 sqrt(h / pi) W L + W^2 / 4 (laws.ENDS);
the second term is the sea ahead and astern.

Unknown sweep widths are factors T of mean 1, one for each group. E b(sum T_g C_g) is highest, in
the convex order, if all groups are as certain as the most certain one and C is shared equally among
them: then the factor is gamma of the sum of their shapes. That bounds any share.
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
MOST = 20.0  # coverage beyond which the curve is flat
# half the window over which slopes are averaged: kinks would stall the search
SMOOTH = 0.06
ROOTS = np.linspace(0.0, 6.5, 3251)  # of h: e^-h is 4e-19 at the last
# p beyond which sums of Bessel functions lose precision; targets then move nearly straight
STRAIGHT = 6.0
SHORT = 1e-5  # share by which the integral over ROOTS may be too low


@dataclass(frozen=True)
class Curve:
    """The curve b at coverages 0, STEP, ..., MOST (concave, rising), its slopes and conjugate."""

    value: Array  # (n,) smoothed: the integral of the slopes, at most b
    slope: Array  # (n,) falling; any slopes give a bound, these are near the true ones
    conjugate: Array  # (n,) max over C of b(C) - y C, at y = slopes[k] = k / (n - 1) * slope[0]

    @property
    def steepest(self) -> float:
        """Slope at coverage 0."""
        return float(self.slope[0])


@lru_cache(maxsize=16)
def curve(used: tuple[Law, ...], shapes: tuple[float, ...] = (), wander: float = 0.0) -> Curve:
    """Return the concave curve that bounds any use of some laws together.

    Args:
        used: the laws.
        shapes: gamma shape of each independent unknown factor of sweep width (inf: known); (): all
            are known.
        wander: of Brownian bridges, as `wandering` takes it; 0: none.
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
    # The conjugate of a piecewise linear curve lies at the corner where the next piece is no
    # steeper than y.
    pieces = np.diff(b) / STEP
    at = np.searchsorted(-pieces, -y, side="left")
    # Within a piece b lies above the chord, but below the lines that continue the neighbouring
    # pieces: at most as high as their triangle.
    beside = np.concatenate([[2 * pieces[0] - pieces[1]], pieces, [pieces[-1]]])
    bend, other_bend = beside[:-2] - pieces, pieces - beside[2:]
    peak = STEP * bend * other_bend / np.maximum(bend + other_bend, 1e-30)
    above = np.concatenate([[0.0], np.maximum(peak, 0.0), [0.0]])
    smooth = np.concatenate([[0.0], np.cumsum((slope[1:] + slope[:-1]) / 2) * STEP])
    return Curve(smooth, slope, b[at] - y * c[at] + np.maximum(above[at], above[at + 1]))


def most(used: Sequence[Law], coverage: Array, wander: float = 0.0) -> Array:
    """Return the largest detection probability of any legs at some coverages, shape (n,).

    Args:
        used: the laws of the legs.
        coverage: shape (n,).
        wander: of Brownian bridges, as `wandering` takes it; 0: none.
    """
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
    """Return an upper bound of g(h) of inverse cube against wandering targets.

    The hazard of a straight pass falls on few targets; of wandering ones each gets a little.
    Consider a circle of radius a about the sensor. For targets that ever enter it, min(H, h) is at
    most h. Outside it, all targets together have W / 4a of coverage. A circle at speed v meets
    Brownian particles of diffusivity D = K^2 / 2 from the area 2 pi D sum of (-1)^n I_n(p) / K_n(p)
    a second, n over all integers, with p = v a / 2 D (steady diffusion past a moving circle).

    Args:
        h: hazards, shape (n,).
        wander: K^2 over the speed of the sensor times its sweep width W.
    """
    from scipy import special  # imported here, because it takes half a second

    a = np.geomspace(0.02, 20, 200)  # [W]
    p = np.minimum(a / wander, STRAIGHT)
    n = np.arange(1, 60)[:, None]
    alternate = (-1.0) ** n * special.ive(n, p) / special.kve(n, p)
    gathered = np.exp(2 * p) * (special.ive(0, p) / special.kve(0, p) + 2 * alternate.sum(axis=0))
    # beyond STRAIGHT the excess over 2 a is bounded by that at STRAIGHT
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
    """Return slopes averaged over a window; the curve is extended straight below 0."""
    first, last = (b[1] - b[0]) / STEP, b[-1]
    low, high = c - SMOOTH, c + SMOOTH
    below = np.where(low < 0, low * first, np.interp(low, c, b))
    above = np.interp(high, c, b, right=last)
    return np.asarray(np.maximum((above - below) / (2 * SMOOTH), 0.0))
