"""Boxes on a plane that hold about equally many particles each and fit them tightly."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geo.array import Array

# Differences of the mean log density:
# lead that other boxes need over squares; less may be chance, or the rim of the cloud
FIRM = 0.03
# lead of patches that shows a cloud along lines that boxes of the whole cannot follow
LINES = 0.08
# lead that two halves of a box need over the box: Akaike's criterion for two parameters is twice
# that
CLEARLY = 2.0
# factor by which an effective number must exceed a limit: sums of equal weights round
EQUAL = 1 + 1e-9
# numbers of patches tried for boxes that follow each patch
PATCHES = (12, 40)


@dataclass(frozen=True)
class Boxes:
    """The boxes (k) at one time."""

    of: Array  # int64 (m,): the box of each particle
    low: Array  # float64 [m] (k, 2): smallest x and y of the particles in each box
    high: Array  # float64 [m] (k, 2): largest x and y
    sides: Array  # float64 [m] (k, 2): sides of the box itself, which may be turned

    @property
    def count(self) -> int:
        """Number of boxes."""
        return len(self.low)

    @property
    def area(self) -> Array:
        """Area [m2] of each box, (k,)."""
        return np.asarray(np.prod(self.sides, axis=1))


def fit(x: Array, y: Array, weight: Array, most: float, fewest: float, least: float) -> Boxes:
    """Return boxes of at most `most` effective particles, of the likeliest of several kinds.

    The kinds are squares north and south, boxes that follow the whole cloud in direction,
    proportions and curvature, and boxes that follow each of some patches of it. A cloud along a
    track or a shore is so narrow that squares would include the sea beside it. The likeliest boxes
    have the greatest mean log density. If patches are much likelier than the whole, the cloud is
    narrow there too, and boxes hold only `fewest` particles: boxes that are too dense by chance are
    better than boxes that are too wide. Clearly uneven boxes of more than `fewest` are cut, because
    otherwise a few close particles would count as spread over the whole box.

    Args:
        x: east of the particles [m], shape (m,).
        y: north of them [m], shape (m,).
        weight: of the particles, shape (m,).
        most: largest effective number in a box.
        fewest: smallest effective number in a box that may be cut.
        least: smallest side that counts [m].
    """
    points, mass = np.stack([x, y]), float(weight.sum())
    effective = mass**2 / float(weight @ weight)
    plain, curved = _in_north_axes(points), _in_curved_axes(points, [np.arange(len(x))])
    candidates = [(laid, _one_part(laid.place)) for laid in (plain, curved)]
    squares, along = (_split_parts(laid, weight, whole, most) for laid, whole in candidates)
    terms = _terms(plain, weight, squares, least)
    likelihoods = [
        float(terms.sum()) / mass,
        float(_terms(curved, weight, along, least).sum()) / mass,
    ]
    patch = candidates[0][1]
    for patches in PATCHES:
        if effective / patches < 2 * most:
            break
        patch = _split_parts(plain, weight, patch, effective / patches)
        curved = _in_curved_axes(
            points, [np.sort(members) for members in np.split(patch.order[0], patch.start[1:-1])]
        )
        along = _split_parts(curved, weight, _with_coordinates(curved.place, patch), most)
        # each square belongs to one patch
        own = np.add.reduceat(terms, np.searchsorted(squares.start, patch.start[:-1]))
        other = np.add.reduceat(
            _terms(curved, weight, along, least), np.searchsorted(along.start, patch.start[:-1])
        )
        follows = (other > own)[_number(patch)]
        mixed = _BoxAxes(*(np.where(follows, v, u) for u, v in zip(plain, curved, strict=True)))
        candidates.append((mixed, patch))
        likelihoods.append(float(np.maximum(own, other).sum()) / mass)
    best = int(np.argmax(likelihoods))
    if likelihoods[best] <= likelihoods[0] + FIRM:
        best = 0
    elif best > 1 and most > fewest and likelihoods[best] > max(likelihoods[:2]) + LINES:
        return fit(x, y, weight, fewest, fewest, least)
    laid, parts = candidates[best]
    return _boxes(
        points,
        laid,
        _split_parts(laid, weight, _with_coordinates(laid.place, parts), most, fewest, least),
    )


def grow(x: Array, y: Array, weight: Array, most: float) -> Boxes:
    """Return boxes north and south of at most `most` effective particles each.

    Args:
        x: east of the particles [m], shape (m,).
        y: north of them [m], shape (m,).
        weight: of the particles, shape (m,).
        most: largest effective number in a box.
    """
    points = np.stack([x, y])
    return _boxes(
        points,
        _in_north_axes(points),
        _split_parts(_in_north_axes(points), weight, _one_part(points), most),
    )


def likelihood(boxes: Boxes, weight: Array, least: float) -> float:
    """Return the mean log density, up to a constant, for uniform density in each box.

    Args:
        boxes: of the particles.
        weight: of the particles, shape (m,).
        least: smallest side that counts [m].
    """
    mass = np.bincount(boxes.of, weight, boxes.count)
    return float(
        mass @ np.log(mass / np.prod(np.maximum(boxes.sides, max(least, 1e-3)), axis=1))
    ) / float(mass.sum())


class _BoxAxes(NamedTuple):
    """Points (n) in the axes of their boxes."""

    place: Array  # float64 (2, n) in the boxes' proportions
    scale: Array  # float64 [m] (2, n) or (2, 1): these proportions


class Parts(NamedTuple):
    """Points (n) divided into parts (k)."""

    order: Array  # int64 (2, n): numbers of the points along each axis, part by part
    start: Array  # int64 (k + 1,): where each part begins there


def _in_north_axes(points: Array) -> _BoxAxes:
    """Return points (2, n) [m] in squares north and south."""
    return _BoxAxes(points, np.ones((2, 1)))


def _in_curved_axes(points: Array, parts: Sequence[Array]) -> _BoxAxes:
    """Return points (2, n) [m] along and across the curved principal axis of their own part.

    Coordinates are in standard deviations. The axis is curved by a parabola, which is subtracted
    across; such a shear preserves areas. parts: indices of the points of each part.
    """
    rows, (place, scale) = np.ascontiguousarray(points.T), np.empty((2, *points.shape))
    for members in parts:
        centred = rows[members] - rows[members].mean(axis=0)
        across, along = (centred @ np.linalg.eigh(centred.T @ centred)[1]).T
        long = max(float(along.std()), 1e-3)
        powers = (along / long)[:, None] ** np.arange(3)
        across = across - powers @ np.linalg.lstsq(powers, across, rcond=None)[0]
        scale[:, members] = np.array([[long], [max(float(across.std()), 1e-3)]])
        place[:, members] = np.stack([along, across]) / scale[:, members]
    return _BoxAxes(place, scale)


def _one_part(place: Array) -> Parts:
    """Return points (2, n) as one part."""
    # an unstable sort is several times faster; ties are rare
    order = np.argsort(place, axis=1)
    if np.any(np.diff(np.take_along_axis(place, order, axis=1)) == 0):
        order = np.argsort(place, axis=1, kind="stable")
    return Parts(order, np.array([0, place.shape[1]]))


def _with_coordinates(place: Array, parts: Parts) -> Parts:
    """Return the same parts of points with other coordinates, (2, n)."""
    return Parts(_by_part(_one_part(place).order, _number(parts)), parts.start)


def _number(parts: Parts) -> Array:
    """Return the part of each point, shape (n,)."""
    number = np.empty(parts.order.shape[1], np.int64)
    number[parts.order[0]] = np.repeat(np.arange(len(parts.start) - 1), np.diff(parts.start))
    return number


def _by_part(order: Array, number: Array) -> Array:
    """Return points (2, n) sorted by part, keeping their order within each part."""
    # NumPy sorts integers of up to 16 bits by radix
    small = number.astype(np.min_scalar_type(number.max()))
    return np.stack([along[np.argsort(small[along], kind="stable")] for along in order])


def _ends(place: Array, parts: Parts) -> tuple[Array, Array]:
    """Return the least and greatest coordinates of each part, (2, k)."""
    low, high = (
        np.take_along_axis(place, parts.order[:, at], axis=1)
        for at in (parts.start[:-1], parts.start[1:] - 1)
    )
    return low, high


def _sides(laid: _BoxAxes, parts: Parts) -> Array:
    """Return the sides of parts [m], (2, k)."""
    low, high = _ends(laid.place, parts)
    scale = np.broadcast_to(laid.scale, laid.place.shape)[:, parts.order[0][parts.start[:-1]]]
    return np.asarray((high - low) * scale)


def _boxes(points: Array, laid: _BoxAxes, parts: Parts) -> Boxes:
    """Return the boxes of parts of points (2, n) [m]."""
    ordered, first = points.take(parts.order[0], axis=1), parts.start[:-1]
    low, high = (extreme.reduceat(ordered, first, axis=1).T for extreme in (np.minimum, np.maximum))
    return Boxes(_number(parts), low, high, _sides(laid, parts).T)


def _terms(laid: _BoxAxes, weight: Array, parts: Parts, least: float) -> Array:
    """Return each part's term of the log likelihood, (k,); least: smallest side that counts [m]."""
    mass = np.add.reduceat(weight[parts.order[0]], parts.start[:-1])
    return np.asarray(
        mass * np.log(mass / np.prod(np.maximum(_sides(laid, parts), max(least, 1e-3)), axis=0))
    )


def _split_parts(
    laid: _BoxAxes,
    weight: Array,
    parts: Parts,
    most: float,
    fewest: float = np.inf,
    least: float = 1.0,
) -> Parts:
    """Return parts of at most `most` effective points each.

    Each part is halved across its longer side, in its proportions, as in a k-d tree (Bentley 1975,
    doi:10.1145/361002.361007), all in one go. A part of more than `fewest` is cut again if its
    points are clearly denser on one side (`best_cut`). least: smallest side that counts [m].
    """
    # even: points of parts that were found uniform and are not cut
    square, even = weight * weight, np.zeros(len(weight), bool)
    while True:
        size, first = np.diff(parts.start), parts.start[:-1]
        low, high = _ends(laid.place, parts)
        mass, squares = (np.add.reduceat(v[parts.order[0]], first) for v in (weight, square))
        effective = np.where((size > 1) & np.any(high > low, axis=0), mass**2 / squares, 0.0)
        halve = effective > most * EQUAL
        axis, below = (
            (high[1] - low[1] >= high[0] - low[0]).astype(np.int64),
            np.where(halve, size // 2, size),
        )
        tried = np.flatnonzero(~halve & (effective > fewest * EQUAL) & ~even[parts.order[0][first]])
        if len(tried):
            axis[tried], below[tried] = best_cut(
                laid.place * laid.scale, weight, parts, tried, fewest / 2, least
            )
            even[parts.order[0]] |= np.repeat(~halve & (below == size), size)
        if np.all(below == size):
            return parts
        parts = _divide(parts, axis, below, swapped=~halve)


def _divide(parts: Parts, axis: Array, below: Array, swapped: Array | bool = False) -> Parts:
    """Return parts divided in two, first the points that are below along an axis, unless swapped.

    below: number of such points in each part, (k,); parts with all points below stay whole.
    """
    size = np.diff(parts.start)
    rank = np.arange(parts.start[-1]) - np.repeat(parts.start[:-1], size)
    second = (rank >= np.repeat(below, size)) ^ np.repeat(
        np.broadcast_to(swapped, size.shape), size
    )
    number = np.empty(len(rank), np.int64)
    number[parts.order[np.repeat(axis, size), np.arange(len(rank))]] = (
        2 * np.repeat(np.arange(len(size)), size) + second
    )
    sizes = np.bincount(number)
    return Parts(_by_part(parts.order, number), np.concatenate([[0], np.cumsum(sizes[sizes > 0])]))


def halved(x: Array, y: Array, most: float, fewest: float, copies: int, least: float) -> Boxes:
    """Return boxes of points that are the same particles at several times, of equal weight.

    All boxes are halved across their longer sides, level by level, until they hold no more than
    `most` particles at a time, and on to `fewest` where that makes the points clearly likelier (as
    a regression tree is pruned, Breiman and others 1984).

    Args:
        x: east of the points [m], shape (n,).
        y: north of them [m], shape (n,).
        most: largest number of particles in a box at a time.
        fewest: smallest number at a time.
        copies: number of times at which each particle occurs.
        least: smallest side that counts [m].
    """
    points = np.stack([x, y])
    depth = max(math.ceil(math.log2(len(x) / (most * copies))), 0)
    deepest = max(math.floor(math.log2(len(x) / (fewest * copies))), depth)
    parts = _one_part(points)
    starts, ends = [parts.start], [_ends(points, parts)]
    for _ in range(deepest):
        low, high = ends[-1]
        parts = _divide(parts, np.argmax(high - low, axis=0), np.diff(parts.start) // 2)
        starts.append(parts.start)
        ends.append(_ends(points, parts))
    best, split = np.zeros(0), []  # logarithms of likelihood; which boxes of each level are halved
    for level in range(deepest, depth - 1, -1):
        low, high = ends[level]
        count = np.maximum(np.diff(starts[level]) / copies, 1.5)
        # On average, n uniform points span (n - 1) / (n + 1) of each side of their box.
        extent = np.maximum((high - low) * ((count + 1) / (count - 1)), least)
        own = count * (np.log(count) - np.log(extent).sum(axis=0))
        halves = (
            best.reshape(-1, 2).sum(axis=1) - CLEARLY if len(best) else np.full(len(own), -np.inf)
        )
        split.append(halves > own)
        best = np.maximum(own, halves)
    leaves: list[tuple[int, Array]] = []
    alive = np.ones(len(best), bool)
    for level, halve in enumerate(reversed(split), depth):
        leaves.append((level, np.flatnonzero(alive & ~halve)))
        alive = np.repeat(alive & halve, 2)
    low, high = (
        np.concatenate([ends[level][k][:, at] for level, at in leaves], axis=1).T for k in (0, 1)
    )
    begin = np.concatenate([starts[level][at] for level, at in leaves])
    size = np.concatenate([np.diff(starts[level])[at] for level, at in leaves])
    box_of, laid = np.empty(len(x), np.int64), np.argsort(begin)
    box_of[parts.order[0]] = np.repeat(laid, size[laid])
    return Boxes(box_of, low, high, high - low)


def best_cut(
    points: Array, weight: Array, parts: Parts, some: Array, fewest: float, least: float
) -> tuple[Array, Array]:
    """Return the best cut of some parts: its axis, and how many points lie below it.

    A cut counts if it makes n effective points more than n^3 times likelier; otherwise the part
    counts as uniform, with all points below. Uniform boxes are then cut by chance in 1 % of cases
    with 20 points and in 0.4 % with 80; with n^2 it would be one in twelve and one in seventeen.

    Args:
        points: [m], shape (2, n).
        weight: of the points, shape (n,).
        parts: of the points.
        some: indices of the parts, shape (k,).
        fewest: smallest effective number on either side of a cut.
        least: smallest side that counts [m].
    """
    axis, below = np.zeros(len(some), np.int64), np.diff(parts.start)[some]
    long = np.ceil(np.log2(below))
    # handle parts of similar size together, padding the shorter ones with their last point
    for length in np.unique(long):
        rows = np.flatnonzero(long == length)
        size = below[rows]
        rank = np.arange(size.max())
        at = parts.start[some[rows], None] + np.minimum(rank, size[:, None] - 1)
        best = np.full(len(rows), -np.inf)
        for k in (0, 1):
            members = parts.order[k][at]
            own = np.where(rank < size[:, None], weight[members], 0.0)
            mass = own.sum(axis=1)
            count = (mass**2 / np.sum(own * own, axis=1))[:, None]
            share = own * (count / mass[:, None])
            laid = points[:, members]
            low, high = (
                _logs(laid, share, least),
                _logs(laid[..., ::-1], share[:, ::-1], least)[:, ::-1],
            )
            before = np.cumsum(share, axis=1)[:, :-1]
            gain = np.where(
                (before >= fewest) & (count - before >= fewest),
                low[:, :-1] + high[:, 1:] - low[:, -1:],
                -np.inf,
            )
            top = gain.max(axis=1)
            better = top > np.maximum(best, 3 * np.log(count[:, 0]))
            best = np.where(better, top, best)
            axis[rows[better]], below[rows[better]] = k, gain.argmax(axis=1)[better] + 1
    return axis, below


def _logs(points: Array, share: Array, least: float) -> Array:
    """Return the log likelihood of the first 1, 2, ... points, if uniform in their own box.

    On average, n uniform points span (n - 1) / (n + 1) of each side of their box. points: (2, k,
    n); share: (k, n).
    """
    count = np.maximum(np.cumsum(share, axis=1), 2.0)
    sides = np.maximum.accumulate(points, axis=2) - np.minimum.accumulate(points, axis=2)
    extent = np.maximum(sides * ((count + 1) / (count - 1)), least)
    return np.asarray(count * (np.log(count) - np.log(extent).sum(axis=0)))
