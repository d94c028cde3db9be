"""Particles in cells -> a smooth probability map, and the areas that hold a stated share of it.

A histogram of particles holds too little outside itself: its "95 %" area misses far more than 5 % of new particles.
Here each particle is smoothed by a Gaussian kernel wide enough to hold about `m` effective particles (Abramson 1982,
doi:10.1214/aos/1176345986: bandwidth as density to the power -1/2), on a pyramid of grids, each half as fine as the one
below: mass climbs until its neighbourhood is populous enough, is smoothed there by one cell and comes down again
by linear interpolation. So dense cores stay sharp while thin tails are smoothed, and a map costs a few passes.

- Where the map is dense, kernels hold up to WIDER times as many: there the density is nearly level, so that noise is what
  orders the cells, and a wider kernel costs little. How many follows the cell's rank in a first, wide map.
- `m` is chosen by the log likelihood of held-out particles, both halves in turn; the search starts where bandwidth
  goes as n^(-1/6).
- Mass stays off masked cells (land): each source's kernel is normalised over the cells allowed, so nothing is lost.
- Levels are calibrated: the area called "95 %" is the one that held 95 % of the particles held out of the map.

Sums are over fixed-point deposits or in one fixed order in float64: a map does not depend on threads. A kernel
may reach across a spit narrower than itself: it knows water from land, not a way round.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage, spatial

Array = npt.NDArray[Any]

KNOTS = np.unique(np.concatenate([np.linspace(0, 0.9, 91), np.linspace(0.9, 1, 101)]))  # of a calibration
REACH = 4  # cells, and standard deviations, as far as a kernel reaches
WIDER = 4.0  # times as many particles are in the kernels of the densest cells as in those of the thinnest
PER_KERNEL = 0.07  # m = PER_KERNEL n^(2/3) is about the optimum of a bivariate normal: where the search starts


def typical_spacing(x: Array, y: Array, probability: Array) -> float:
    """Return the bandwidth [m] that suits the densest parts of a weighted cloud of points [m], shapes (n,).

    From the 16th nearest neighbours in a weighted systematic sample of 4096: rough, it only sets the cells' size.
    """
    total = np.cumsum(probability)
    effective = total[-1] ** 2 / np.sum(probability**2)
    picks = np.unique(np.searchsorted(total, (np.arange(4096) + 0.5) / 4096 * total[-1]).clip(max=len(x) - 1))
    points = np.column_stack([x[picks], y[picks]])
    k = min(16, len(picks) - 1)
    if k < 1:
        return 0.0
    radius = np.maximum(spatial.cKDTree(points).query(points, k + 1)[0][:, -1], 1e-3)
    density = np.median(np.sort(k / (len(picks) * np.pi * radius**2))[-max(len(picks) // 4, 1) :])
    return float(np.sqrt(PER_KERNEL * effective ** (2 / 3) / (effective * density)))


def _coarser(fine: Array) -> Array:
    """Return the sums of a grid on one of half as many cells, by weights 1 3 3 1 / 4 along each axis."""
    for axis in (0, 1):
        fine = np.moveaxis(fine, axis, 0)
        if len(fine) % 2:
            fine = np.concatenate([fine, np.zeros_like(fine[:1])])
        even, odd = fine[0::2], fine[1::2]
        coarse = 0.75 * (even + odd)
        coarse[1:] += 0.25 * odd[:-1]
        coarse[:-1] += 0.25 * even[1:]
        coarse[0] += 0.25 * even[0]  # nothing is lost at the edge
        coarse[-1] += 0.25 * odd[-1]
        fine = np.moveaxis(coarse, 0, axis)
    return fine


def _finer(coarse: Array, shape: tuple[int, int]) -> Array:
    """Return linear interpolation onto twice as many cells: the transpose of `_coarser`."""
    for axis, size in ((1, shape[1]), (0, shape[0])):
        coarse = np.moveaxis(coarse, axis, 0)
        fine = np.empty((2 * len(coarse), *coarse.shape[1:]))
        fine[0::2] = 0.75 * coarse
        fine[1::2] = fine[0::2]
        fine[2::2] += 0.25 * coarse[:-1]
        fine[0] += 0.25 * coarse[0]
        fine[1:-1:2] += 0.25 * coarse[1:]
        fine[-1] += 0.25 * coarse[-1]
        coarse = np.moveaxis(fine[:size], 0, axis)
    return coarse


def _gauss(values: Array) -> Array:
    """Return values smoothed by a standard deviation of one cell; zero outside."""
    return np.asarray(ndimage.gaussian_filter(values, 1.0, mode="constant", truncate=float(REACH)))


def _window(values: Array) -> tuple[slice, slice]:
    """Return the rows and columns that smoothed values can reach: beyond, all is zero."""
    rows, columns = (np.flatnonzero(values.any(axis=axis)) for axis in (1, 0))
    return (
        slice(max(rows[0] - REACH, 0), rows[-1] + REACH + 1),
        slice(max(columns[0] - REACH, 0), columns[-1] + REACH + 1),
    )


@dataclass(frozen=True)
class Medium:
    """Where mass may lie: allowed cells (nlat, nlon) and, for each level of the pyramid, the kernel's share on them."""

    allowed: Array
    reach: tuple[Array, ...]


def medium(allowed: Array) -> Medium:
    """Return the pyramid of a mask (bool, nlat x nlon), as deep as leaves 8 cells across."""
    levels = [allowed.astype(np.float64)]
    while min(levels[-1].shape) >= 16:
        levels.append(_coarser(levels[-1]))
    return Medium(allowed, tuple(_gauss(level) for level in levels))


@dataclass(frozen=True)
class Histogram:
    """Deposits of one medium: mass, and mass times weight (their ratio gives the effective number), as pyramids."""

    mass: tuple[Array, ...]
    number: tuple[Array, ...]  # kernel's effective number of particles at each level


def wider(first: Array, area: Array) -> tuple[Array, ...]:
    """Return how many times as many particles kernels hold in each cell, at each level of the pyramid, by a first map.

    WIDER to the power 1 - s, where s is the share of the first map (nlat, nlon) that is denser than the cell.
    """
    order = ranked(first / area[:, None])
    inside = np.cumsum(first.ravel()[order])
    denser = np.ones(first.size)
    denser[order] = inside / inside[-1]
    levels = [WIDER ** (1 - denser.reshape(first.shape))]
    while min(levels[-1].shape) >= 16:
        padded = np.pad(levels[-1], [(0, size % 2) for size in levels[-1].shape], mode="edge")
        levels.append((padded[0::2, 0::2] + padded[1::2, 0::2] + padded[0::2, 1::2] + padded[1::2, 1::2]) / 4)
    return tuple(levels)


def histogram(mass: Array, squares: Array, where: Medium, more: tuple[Array, ...] | None = None) -> Histogram:
    """Return the pyramids of deposited weights w and of w^2, each (nlat, nlon); more: see `wider`, as they are without it.

    The effective number is that over `more`: so many times as many are then in a kernel.
    """
    masses, second = [mass], squares
    numbers = []
    for level in range(len(where.reach)):
        variance = 1.5 - 0.5 / 4**level  # of the kernel, in this level's cells: Gauss plus down and up
        there = second > 0
        number = variance * np.where(there, masses[-1] ** 2 / np.where(there, second, 1), 0.0)
        numbers.append(number if more is None else number / more[level])
        if level + 1 < len(where.reach):
            masses.append(_coarser(masses[-1]))
            second = _coarser(second)
    return Histogram(tuple(masses), tuple(numbers))


def spread(mass: Array, guide: Histogram, m: float, where: Medium) -> Array:
    """Return mass (nlat, nlon) smoothed by kernels that hold `m` effective particles of the guide.

    Linear in mass: the maps of scenarios add up to that of all. The total is kept to rounding.
    """
    staying, rest = [], mass
    for level, number in enumerate(guide.number):
        if level + 1 == len(guide.number):
            staying.append(rest)
            break
        # wanted variance / this level's = m / number, between 1 and 4: shares of this and the next level make it
        share = np.clip((4 - m / np.maximum(number, m / 8)) / 3, 0, 1)
        staying.append(rest * share)
        rest = _coarser(rest - staying[-1])
    smooth: Array | None = None
    for stay, reach in zip(staying[::-1], where.reach[::-1], strict=True):
        smooth = None if smooth is None else _finer(smooth, (stay.shape[0], stay.shape[1]))
        if stay.any():
            part = _window(stay)
            own = np.divide(stay[part], reach[part], out=np.zeros_like(stay[part]), where=reach[part] > 0)
            smooth = np.zeros_like(stay) if smooth is None else smooth
            smooth[part] += _gauss(own)
    assert smooth is not None or not mass.any()
    return np.zeros_like(mass) if smooth is None else np.asarray(smooth * where.allowed)


@dataclass(frozen=True)
class Calibration:
    """Share of held-out particles inside the area that holds a share of the map, at KNOTS."""

    share: Array

    def held(self, level: Array) -> Array:
        """Return the held-out share of the area that holds `level` of the map."""
        return np.asarray(np.interp(level, KNOTS, self.share))

    def level(self, share: Array) -> Array:
        """Return the share of the map whose area held `share` of the held-out particles."""
        return np.asarray(np.interp(share, self.share, KNOTS))


def ranked(density: Array) -> Array:
    """Return flat indices of the cells with any probability, densest first; ties in order of the index."""
    occupied = np.flatnonzero(density)
    return np.asarray(occupied[np.argsort(-density.ravel()[occupied], kind="stable")])


def calibrate(mass: Array, area: Array, unseen: Array) -> Calibration:
    """Return the calibration of a map (nlat, nlon) by the deposit of particles that it has not seen."""
    order = ranked(mass / area[:, None])
    inside, seen = np.cumsum(mass.ravel()[order]), np.cumsum(unseen.ravel()[order]) / unseen.sum()
    share = np.interp(KNOTS, np.concatenate([[0.0], inside / inside[-1]]), np.concatenate([[0.0], seen]))
    share[-1] = 1.0
    return Calibration(share)
