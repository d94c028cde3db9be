"""Boxes on a plane that hold about equally many particles each, and no more sea than these span."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geo.array import Array

# Differences of mean logarithms of density:
# other boxes must be so much likelier than squares; less may be chance, or the rim of the cloud
FIRM = 0.03
# patches are so much likelier where a cloud lies along lines that boxes of the whole cannot follow
LINES = 0.08
# by which two halves of a box must be likelier than it: twice that is Akaike's criterion of two
# numbers
CLEARLY = 2.0
# by which an effective number must exceed a limit: 16 particles of one weight are 16, however
# summed
EQUAL = 1 + 1e-9
# numbers of patches into which a cloud is divided for boxes of their own directions
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

    Boxes are squares north and south; or they follow the whole cloud in direction, proportions and
    curvature; or each of some patches of it. A cloud along a track or a shore is so narrow that
    squares would include the sea beside it. The likeliest boxes have the greatest mean logarithm of
    density. Where patches are much likelier than the whole, the cloud is narrow there too, and
    boxes hold `fewest` particles: it is better that chance makes them too dense than that they are
    too wide. Boxes of more than `fewest` are cut where they are clearly uneven, because a few
    particles close together would otherwise count as spread over the whole box. least: smallest
    side [m] that counts.
    """
    points, mass = np.stack([x, y]), float(weight.sum())
    effective = mass**2 / float(weight @ weight)
    plain, curved = _plain(points), _bent(points, [np.arange(len(x))])
    candidates = [(laid, _whole(laid.place)) for laid in (plain, curved)]
    squares, along = (_grown(laid, weight, whole, most) for laid, whole in candidates)
    terms = _terms(plain, weight, squares, least)
    likelihoods = [
        float(terms.sum()) / mass,
        float(_terms(curved, weight, along, least).sum()) / mass,
    ]
    patch = candidates[0][1]
    for patches in PATCHES:
        if effective / patches < 2 * most:
            break
        patch = _grown(plain, weight, patch, effective / patches)
        curved = _bent(
            points, [np.sort(members) for members in np.split(patch.order[0], patch.start[1:-1])]
        )
        along = _grown(curved, weight, _relaid(curved.place, patch), most)
        # The patches are parts of which the squares are parts.
        own = np.add.reduceat(terms, np.searchsorted(squares.start, patch.start[:-1]))
        other = np.add.reduceat(
            _terms(curved, weight, along, least), np.searchsorted(along.start, patch.start[:-1])
        )
        follows = (other > own)[_number(patch)]
        mixed = _Laid(*(np.where(follows, v, u) for u, v in zip(plain, curved, strict=True)))
        candidates.append((mixed, patch))
        likelihoods.append(float(np.maximum(own, other).sum()) / mass)
    best = int(np.argmax(likelihoods))
    if likelihoods[best] <= likelihoods[0] + FIRM:
        best = 0
    elif best > 1 and most > fewest and likelihoods[best] > max(likelihoods[:2]) + LINES:
        return fit(x, y, weight, fewest, fewest, least)
    laid, parts = candidates[best]
    return _boxes(
        points, laid, _grown(laid, weight, _relaid(laid.place, parts), most, fewest, least)
    )


def grow(x: Array, y: Array, weight: Array, most: float) -> Boxes:
    """Return boxes north and south of at most `most` effective particles each, of particles at x, y
    [m], (m,).
    """
    points = np.stack([x, y])
    return _boxes(points, _plain(points), _grown(_plain(points), weight, _whole(points), most))


def likelihood(boxes: Boxes, weight: Array, least: float) -> float:
    """Return the mean logarithm of density, up to a constant, if density is even in each box.

    least: smallest side [m] that counts.
    """
    mass = np.bincount(boxes.of, weight, boxes.count)
    return float(
        mass @ np.log(mass / np.prod(np.maximum(boxes.sides, max(least, 1e-3)), axis=1))
    ) / float(mass.sum())


class _Laid(NamedTuple):
    """Points (n) in the axes of the boxes that are to hold them."""

    place: Array  # float64 (2, n) in the boxes' proportions
    scale: Array  # float64 [m] (2, n) or (2, 1): these proportions


class Parts(NamedTuple):
    """Points (n) in parts (k)."""

    order: Array  # int64 (2, n): numbers of the points along each axis, part by part
    start: Array  # int64 (k + 1,): where each part begins there


def _plain(points: Array) -> _Laid:
    """Return points (2, n) [m] in squares north and south."""
    return _Laid(points, np.ones((2, 1)))


def _bent(points: Array, parts: Sequence[Array]) -> _Laid:
    """Return points (2, n) [m] along and across the curved principal axis of their own part, in
    standard deviations.

    The axis is curved by a parabola, which is subtracted across: such a shear changes no area.
    parts: numbers of the points of each.
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
    return _Laid(place, scale)


def _whole(place: Array) -> Parts:
    """Return points at a place, (2, n), in one part."""
    # several times as fast as one that keeps the order of equals, which are rare
    order = np.argsort(place, axis=1)
    if np.any(np.diff(np.take_along_axis(place, order, axis=1)) == 0):
        order = np.argsort(place, axis=1, kind="stable")
    return Parts(order, np.array([0, place.shape[1]]))


def _relaid(place: Array, parts: Parts) -> Parts:
    """Return the same parts of points that are at another place, (2, n)."""
    return Parts(_by_part(_whole(place).order, _number(parts)), parts.start)


def _number(parts: Parts) -> Array:
    """Return the part of each point, (n,)."""
    number = np.empty(parts.order.shape[1], np.int64)
    number[parts.order[0]] = np.repeat(np.arange(len(parts.start) - 1), np.diff(parts.start))
    return number


def _by_part(order: Array, number: Array) -> Array:
    """Return points (2, n) by their part, and in their order in each; number: of each point's part,
    (n,).
    """
    # integers of up to 16 bits are sorted by radix
    small = number.astype(np.min_scalar_type(number.max()))
    return np.stack([along[np.argsort(small[along], kind="stable")] for along in order])


def _ends(place: Array, parts: Parts) -> tuple[Array, Array]:
    """Return the least and the greatest place in each part, (2, k)."""
    low, high = (
        np.take_along_axis(place, parts.order[:, at], axis=1)
        for at in (parts.start[:-1], parts.start[1:] - 1)
    )
    return low, high


def _sides(laid: _Laid, parts: Parts) -> Array:
    """Return the sides [m] of parts, (2, k)."""
    low, high = _ends(laid.place, parts)
    scale = np.broadcast_to(laid.scale, laid.place.shape)[:, parts.order[0][parts.start[:-1]]]
    return np.asarray((high - low) * scale)


def _boxes(points: Array, laid: _Laid, parts: Parts) -> Boxes:
    """Return the boxes that parts of points (2, n) [m] are."""
    ordered, first = points.take(parts.order[0], axis=1), parts.start[:-1]
    low, high = (extreme.reduceat(ordered, first, axis=1).T for extreme in (np.minimum, np.maximum))
    return Boxes(_number(parts), low, high, _sides(laid, parts).T)


def _terms(laid: _Laid, weight: Array, parts: Parts, least: float) -> Array:
    """Return what each part adds to the logarithm of likelihood, (k,); least: smallest side [m]
    that counts.
    """
    mass = np.add.reduceat(weight[parts.order[0]], parts.start[:-1])
    return np.asarray(
        mass * np.log(mass / np.prod(np.maximum(_sides(laid, parts), max(least, 1e-3)), axis=0))
    )


def _grown(
    laid: _Laid,
    weight: Array,
    parts: Parts,
    most: float,
    fewest: float = np.inf,
    least: float = 1.0,
) -> Parts:
    """Return parts of at most `most` effective points each.

    Each is halved across its longer side, in its proportions, as in a k-d tree (Bentley 1975,
    doi:10.1145/361002.361007), all of them in one go. A part of more than `fewest` is cut again
    where its points are clearly denser on one side (`cut`). least: smallest side [m] that counts.
    """
    # even: points of parts that are not to be cut
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
        parts = _divided(parts, axis, below, swapped=~halve)


def _divided(parts: Parts, axis: Array, below: Array, swapped: Array | bool = False) -> Parts:
    """Return parts in two each, first what is below along an axis, unless swapped; those with all
    below stay whole.

    below: how many points of each part are, (k,).
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
    """Return boxes of points x, y [m], (n,), that are the same particles at several times, of equal
    weight.

    All boxes are halved across their longer sides, level by level, in one go, until they hold no
    more than `most` particles at a time, and on to `fewest` where that makes the points clearly
    likelier (as a tree of regression is pruned, Breiman and others 1984). copies: how many times
    each particle counts; least: smallest side [m] that counts.
    """
    points = np.stack([x, y])
    depth = max(math.ceil(math.log2(len(x) / (most * copies))), 0)
    deepest = max(math.floor(math.log2(len(x) / (fewest * copies))), depth)
    parts = _whole(points)
    starts, ends = [parts.start], [_ends(points, parts)]
    for _ in range(deepest):
        low, high = ends[-1]
        parts = _divided(parts, np.argmax(high - low, axis=0), np.diff(parts.start) // 2)
        starts.append(parts.start)
        ends.append(_ends(points, parts))
    best, split = np.zeros(0), []  # logarithms of likelihood; which boxes of each level are halved
    for level in range(deepest, depth - 1, -1):
        low, high = ends[level]
        count = np.maximum(np.diff(starts[level]) / copies, 1.5)
        # On average, n even points span (n - 1) / (n + 1) of each side of their box.
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
    """Return the axis of the best cut of some parts, and how many points lie below it: all where
    they may be even.

    points: [m] (2, n); some: numbers of parts, (k,). A cut counts if it makes n effective points
    more than n^3 times likelier. Even boxes are then cut by chance in 1 % of cases with 20 points
    and in 0.4 % with 80; with n^2 it would be one in twelve and one in seventeen.
    """
    axis, below = np.zeros(len(some), np.int64), np.diff(parts.start)[some]
    long = np.ceil(np.log2(below))
    # parts of nearly equal length side by side, the shorter padded by their last point
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
    """Return the logarithm of the likelihood of the first 1, 2, ... points, if they are even in
    their own box.

    On average, n even points span (n - 1) / (n + 1) of each side of their box. points: (2, k, n);
    share: (k, n).
    """
    count = np.maximum(np.cumsum(share, axis=1), 2.0)
    sides = np.maximum.accumulate(points, axis=2) - np.minimum.accumulate(points, axis=2)
    extent = np.maximum(sides * ((count + 1) / (count - 1)), least)
    return np.asarray(count * (np.log(count) - np.log(extent).sum(axis=0)))
