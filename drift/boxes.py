"""Boxes of a plane that hold about as many particles each, and no more sea than these span."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

FIRM = 0.03  # by which boxes must be likelier than squares: less is chance, or the rim of the cloud
LINES = 0.08  # by which patches are likelier where a cloud lies along lines that boxes of its whole cannot follow
PATCHES = (12, 40)  # of a cloud, in each of which boxes lie as its particles do


@dataclass(frozen=True)
class Boxes:
    """The boxes (k) of one time."""

    of: Array  # int64 (m,): the box of each particle
    low: Array  # float64 [m] (k, 2): x and y of the south-western corner of the particles in it
    high: Array  # and of the north-eastern
    sides: Array  # float64 [m] (k, 2): of the box itself, which may be turned

    @property
    def count(self) -> int:
        """Number of boxes."""
        return len(self.low)

    @property
    def area(self) -> Array:
        """Area [m2] of each, (k,)."""
        return np.asarray(np.prod(self.sides, axis=1))


def fit(x: Array, y: Array, weight: Array, most: float, fewest: float, least: float) -> Boxes:
    """Return boxes of at most `most` effective particles, laid so that particles are as dense in them as they can be made out to be.

    Boxes lie north and south, as wide as long; or along the cloud, in its proportions and bent as it is; or so in each of some patches of it: a cloud
    along a track or a shore is so much narrower than its length that squares would count the sea beside it. The likeliest are taken: those with the
    greatest mean logarithm of density. Where patches are much likelier they are narrow too, and boxes hold `fewest`: chance then makes them
    too dense rather than that they are too wide. least: side [m] that a box is taken to have.
    """

    def likeliest(laid: list[Boxes], at: Array) -> Boxes:
        return max(laid, key=lambda one: likelihood(one, weight[at], least))

    whole = np.arange(len(x))
    effective = float(weight.sum() ** 2 / (weight @ weight))
    laid = [grow(x, y, weight, most), grow(x, y, weight, most, bent)]
    for patches in PATCHES:
        if effective / patches < 2 * most:
            break
        patch = grow(x, y, weight, effective / patches)
        places = [whole[patch.of == k] for k in range(patch.count)]
        parts = [
            likeliest([grow(x[at], y[at], weight[at], most, shape) for shape in (straight, bent)], at) for at in places
        ]
        of, begun = np.empty(len(x), np.int64), 0
        for at, one in zip(places, parts, strict=True):
            of[at] = one.of + begun
            begun += one.count
        laid.append(Boxes(of, *(np.concatenate([getattr(one, v) for one in parts]) for v in ("low", "high", "sides"))))
    squares, own, *others = (likelihood(one, weight, least) for one in laid)
    if max([own, *others]) <= squares + FIRM:
        return laid[0]
    if others and most > fewest and max(others) > max(squares, own) + LINES:
        return fit(x, y, weight, fewest, fewest, least)
    return likeliest(laid, whole)


def likelihood(made: Boxes, weight: Array, least: float) -> float:
    """Return the mean logarithm of density, but for a constant, where each box is taken to be evenly full; least: side [m] of a box."""
    held = np.bincount(made.of, weight, made.count)
    return float(held @ np.log(held / np.prod(np.maximum(made.sides, max(least, 1e-3)), axis=1))) / float(held.sum())


def straight(points: Array) -> tuple[Array, Array]:
    """Return points (n, 2) as they are, and the proportions of boxes, (2,)."""
    return points, np.ones(2)


def bent(points: Array) -> tuple[Array, Array]:
    """Return points (n, 2) along and across their principal axis, a parabola taken off what is across, and their standard deviations.

    A shear changes no area.
    """
    apart = points - points.mean(axis=0)
    axes = np.linalg.eigh(apart.T @ apart)[1]
    across, way = (apart @ axes).T
    scale = max(float(way.std()), 1e-3)
    powers = (way / scale)[:, None] ** np.arange(3)
    across = across - powers @ np.linalg.lstsq(powers, across, rcond=None)[0]
    return np.column_stack([way, across]), np.array([scale, max(float(across.std()), 1e-3)])


def grow(
    x: Array, y: Array, weight: Array, most: float, lie: Callable[[Array], tuple[Array, Array]] = straight
) -> Boxes:
    """Return boxes that hold at most `most` particles each, counted as effective ones, of x, y [m] and weight (m,).

    Each is halved across its longer side, in the proportions of `lie`, as in a k-d tree (Bentley 1975, doi:10.1145/361002.361007).
    """
    points = np.column_stack([x, y])
    laid, scale = lie(points)
    laid = laid / scale
    of = np.empty(len(x), np.int64)
    corners: list[tuple[Array, Array]] = []
    sides: list[Array] = []
    waiting = [np.arange(len(x))]
    while waiting:
        at = waiting.pop()
        own, w = laid[at], weight[at]
        span = own.max(axis=0) - own.min(axis=0)
        if len(at) > 1 and w.sum() ** 2 > most * (w @ w) and span.any():
            half = len(at) // 2
            at = at[np.argpartition(own[:, int(span[1] >= span[0])], half)]
            waiting += [at[half:], at[:half]]
        else:
            of[at] = len(corners)
            corners.append((points[at].min(axis=0), points[at].max(axis=0)))
            sides.append(span * scale)
    low, high = (np.array([corner[k] for corner in corners]) for k in (0, 1))
    return Boxes(of, low, high, np.array(sides))
