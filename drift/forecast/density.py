"""Smoothed probability maps from particles in cells, and the calibration of containment areas.

The "95 %" area of a plain histogram of particles misses far more than 5 % of new particles. Here
each particle is smoothed by a Gaussian kernel wide enough to hold about `m` effective particles
(Abramson 1982, doi:10.1214/aos/1176345986: bandwidth as density to the power -1/2). The computation
uses a pyramid of grids, each half as fine as the one below. Mass moves up until its neighbourhood
holds enough particles, is smoothed there by one cell, and is brought down again by linear
interpolation. Dense cores stay sharp, thin tails are smoothed, and a map takes a few passes.

- Where the map is dense, kernels hold up to WIDER times as many particles: the density is nearly
  level there, so noise would decide the order of the cells, and a wider kernel adds little bias.
  The factor follows the cell's rank in a first, wide map.
- `m` is chosen by the log likelihood of held-out particles, both halves in turn; the search starts
  where bandwidth is proportional to n^(-1/6).
- No mass is placed in masked cells (land): each source's kernel is normalised over the allowed
  cells, so nothing is lost.
- Levels are calibrated: the "95 %" area is the one that held 95 % of the particles held out of the
  map.

Sums are over fixed-point deposits or in a fixed order in float64: a map does not depend on threads.
Kernels know water from land but not the distance by water: one may reach across a spit narrower
than itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage, spatial

from geo.array import Array

# of a calibration
KNOTS = np.unique(np.concatenate([np.linspace(0, 0.9, 91), np.linspace(0.9, 1, 101)]))
FEW = 8  # ratio of all cells to needed cells from which the sparse form is used
# shares of a cell's mass in four cells of the next level: see _coarser_cells
PARTS = np.array([9, 3, 3, 1]) / 16
REACH = 4  # radius of a kernel, in cells and standard deviations
BELL = np.exp(-0.5 * np.arange(-REACH, REACH + 1) ** 2)
BELL /= BELL.sum()
# ratio of particles per kernel between the densest cells and the thinnest
WIDER = 4.0
# m = PER_KERNEL n^(2/3) is about the optimum of a bivariate normal: where the search starts
PER_KERNEL = 0.07


def typical_spacing(x: Array, y: Array, effective: float) -> float:
    """Return the bandwidth [m] for the densest parts of a cloud with an effective number of
    particles.

    x, y: a weighted systematic sample of it [m], (n,). The estimate uses 16th nearest neighbours;
    it is rough and only sets the cell size.
    """
    points = np.column_stack([x, y])
    k = min(16, len(x) - 1)
    if k < 1:
        return 0.0
    radius = np.maximum(spatial.cKDTree(points).query(points, k + 1)[0][:, -1], 1e-3)
    density = np.median(np.sort(k / (len(x) * np.pi * radius**2))[-max(len(x) // 4, 1) :])
    return float(np.sqrt(PER_KERNEL * effective ** (2 / 3) / (effective * density)))


def _coarser(fine: Array) -> Array:
    """Return a grid summed to half as many cells per axis, with weights 1 3 3 1 / 4 along each
    axis.
    """
    if fine.shape[0] % 2:
        fine = np.concatenate([fine, np.zeros((1, fine.shape[1]))])
    if fine.shape[1] % 2:
        fine = np.concatenate([fine, np.zeros((len(fine), 1))], axis=1)
    even, odd = fine[0::2], fine[1::2]
    half = 0.75 * (even + odd)
    half[1:] += 0.25 * odd[:-1]
    half[:-1] += 0.25 * even[1:]
    half[0] += 0.25 * even[0]  # nothing is lost at the edge
    half[-1] += 0.25 * odd[-1]
    even, odd = half[:, 0::2], half[:, 1::2]
    coarse = 0.75 * (even + odd)
    coarse[:, 1:] += 0.25 * odd[:, :-1]
    coarse[:, :-1] += 0.25 * even[:, 1:]
    coarse[:, 0] += 0.25 * even[:, 0]
    coarse[:, -1] += 0.25 * odd[:, -1]
    return np.asarray(coarse)


def _finer(coarse: Array, shape: tuple[int, int]) -> Array:
    """Return a grid interpolated linearly to twice as many cells per axis: the transpose of
    `_coarser`.
    """
    near, far = 0.75 * coarse, 0.25 * coarse
    half = np.empty((len(coarse), 2 * coarse.shape[1]))
    half[:, 0] = near[:, 0] + far[:, 0]
    half[:, 2::2] = near[:, 1:] + far[:, :-1]
    half[:, 1:-1:2] = near[:, :-1] + far[:, 1:]
    half[:, -1] = near[:, -1] + far[:, -1]
    half = half[:, : shape[1]]
    near, far = 0.75 * half, 0.25 * half
    fine = np.empty((2 * len(coarse), shape[1]))
    np.add(near[0], far[0], out=fine[0])
    np.add(near[1:], far[:-1], out=fine[2::2])
    np.add(near[:-1], far[1:], out=fine[1:-1:2])
    np.add(near[-1], far[-1], out=fine[-1])
    return fine[: shape[0]]


def _coarser_cells(cells: Array, shape: tuple[int, int]) -> tuple[Array, tuple[int, int]]:
    """Return the four next-level cells that share the mass of each cell, (4, n), and that level's
    shape.

    The shares are PARTS. It is the sparse form of `_coarser` and `_finer`; cells are flat indices.
    """
    coarse = ((shape[0] + 1) // 2, (shape[1] + 1) // 2)
    row, column = np.divmod(cells, shape[1])
    rows = (
        row // 2 * coarse[1],
        np.clip(row // 2 + 2 * (row % 2) - 1, 0, coarse[0] - 1) * coarse[1],
    )
    columns = (column // 2, np.clip(column // 2 + 2 * (column % 2) - 1, 0, coarse[1] - 1))
    return np.stack([y + x for y in rows for x in columns]), coarse


def _raised(cells: Array, shape: tuple[int, int], *values: Array) -> list[Array]:
    """Return `_coarser`, flattened, of grids that are zero except in some cells (flat
    indices, n).
    """
    if FEW * cells.size < shape[0] * shape[1]:
        above, coarse = _coarser_cells(cells, shape)
        index, size = above.ravel(), coarse[0] * coarse[1]
        return [np.bincount(index, np.outer(PARTS, some).ravel(), size) for some in values]
    raised = []
    for some in values:
        fine = np.zeros(shape[0] * shape[1])
        fine[cells] = some
        raised.append(_coarser(fine.reshape(shape)).ravel())
    return raised


def _gauss(values: Array) -> Array:
    """Return values smoothed by a standard deviation of one cell; zero outside."""
    along = ndimage.correlate1d(values, BELL, 0, mode="constant")
    return np.asarray(ndimage.correlate1d(along, BELL, 1, mode="constant"))


@dataclass(frozen=True)
class Reading:
    """A few cells whose map values are wanted, and the cells needed for them at each pyramid level.

    cells: flat indices, (n,). at: the cells needed at each level; None for all. above: for each
    level but the last, the next-level cells that share the mass of each needed cell, (4, n), as
    indices into that level's needed cells.
    """

    cells: Array
    at: tuple[Array | None, ...]
    above: tuple[Array | None, ...]


@dataclass(frozen=True)
class Medium:
    """The cells where mass may be placed (nlat, nlon).

    reach: share of the kernel on allowed cells, by pyramid level. few: reading of the allowed cells
    if they are few; otherwise None.
    """

    allowed: Array
    reach: tuple[Array, ...]
    few: Reading | None


def medium(allowed: Array) -> Medium:
    """Return the pyramid of a mask (bool, nlat x nlon); its coarsest level has at least 8 cells
    across.
    """
    levels = [allowed.astype(np.float64)]
    while min(levels[-1].shape) >= 16:
        levels.append(_coarser(levels[-1]))
    cells = np.flatnonzero(allowed)
    few = (
        reading(cells, [(level.shape[0], level.shape[1]) for level in levels])
        if FEW * cells.size < allowed.size
        else None
    )
    return Medium(allowed, tuple(_gauss(level) for level in levels), few)


def reading(cells: Array, shapes: Sequence[tuple[int, int]]) -> Reading:
    """Return how to read the values of some cells (flat indices, n); shapes: of the pyramid's
    levels.
    """
    at: list[Array | None] = [cells]
    above: list[Array | None] = []
    for shape in shapes[:-1]:
        here = at[-1]
        if here is None:
            at.append(None)
            above.append(None)
            continue
        over, coarse = _coarser_cells(here, shape)
        wanted = np.zeros(coarse[0] * coarse[1], bool)
        wanted[over] = True
        few = np.flatnonzero(wanted)
        if FEW * few.size < wanted.size:
            number = np.zeros(wanted.size, np.intp)
            number[few] = np.arange(few.size)
            at.append(few)
            above.append(number[over])
        else:
            at.append(None)
            above.append(over)
    return Reading(cells, tuple(at), tuple(above))


@dataclass(frozen=True)
class Histogram:
    """Effective number of particles in a kernel around each cell of one medium, by pyramid
    level.
    """

    number: tuple[Array, ...]


def wider(first: Array, area: Array) -> tuple[Array, ...]:
    """Return the factor of particles per kernel for each cell, by pyramid level.

    It is WIDER to the power 1 - s, where s is the share of a first map (nlat, nlon) that is denser
    than the cell.
    """
    order = ranked(first / area[:, None])
    inside = np.cumsum(first.ravel()[order])
    denser = np.ones(first.size)
    denser[order] = inside / inside[-1]
    levels = [WIDER ** (1 - denser.reshape(first.shape))]
    while min(levels[-1].shape) >= 16:
        padded = np.pad(levels[-1], [(0, size % 2) for size in levels[-1].shape], mode="edge")
        levels.append(
            (padded[0::2, 0::2] + padded[1::2, 0::2] + padded[0::2, 1::2] + padded[1::2, 1::2]) / 4
        )
    return tuple(levels)


def divided(guide: Histogram, more: tuple[Array, ...] | None) -> Histogram:
    """Return a guide whose kernels hold `more` times as many particles; see `wider`."""
    if more is None:
        return guide
    return Histogram(
        tuple(number / factor for number, factor in zip(guide.number, more, strict=True))
    )


def histogram(cells: Array, mass: Array, squares: Array, where: Medium) -> Histogram:
    """Return the guide histogram from weights and squared weights in cells (flat indices), each
    (n,).
    """
    numbers = []
    for level, reach in enumerate(where.reach):
        # variance of the kernel in this level's cells: Gaussian plus both interpolations
        variance = 1.5 - 0.5 / 4**level
        number = np.divide(variance * mass**2, squares, out=np.zeros(cells.size), where=squares > 0)
        numbers.append(np.zeros(reach.shape))
        numbers[-1].ravel()[cells] = number
        if level + 1 < len(where.reach):
            first, second = _raised(cells, (reach.shape[0], reach.shape[1]), mass, squares)
            cells = np.flatnonzero(first > 0)
            mass, squares = first[cells], second[cells]
    return Histogram(tuple(numbers))


def spread(
    cells: Array, mass: Array, guide: Histogram, m: float, where: Medium, at: Reading | None = None
) -> Array:
    """Return mass in cells (flat indices, n) as a smoothed map (nlat, nlon); the total is kept to
    rounding.

    The map is linear in mass: maps of scenarios add up to the map of all.

    Args:
        cells: flat indices, (n,).
        mass: in these cells, (n,).
        guide: effective particles around each cell.
        m: effective particles per kernel.
        where: the medium.
        at: the cells to read; the result is then their values, (k,).
    """
    # for each level the cells whose mass is smoothed there, and how much
    staying: list[tuple[Array, Array]] = []
    for number in guide.number[:-1]:
        # The wanted variance is m / number times this level's, and the next level's is 4 times:
        # shares of both give it.
        share = np.clip((4 - m / np.maximum(number.ravel()[cells], m / 8)) / 3, 0, 1)
        stays = share > 0
        staying.append((cells[stays], (mass * share)[stays]))
        (rest,) = _raised(cells, (number.shape[0], number.shape[1]), mass * (1 - share))
        cells = np.flatnonzero(rest > 0)
        mass = rest[cells]
    staying.append((cells, mass))
    if at is not None:
        return np.asarray(_smoothed(staying, where, 0, at) * where.allowed.ravel()[at.cells])
    if where.few is None:
        return np.asarray(_smoothed(staying, where, 0, None) * where.allowed)
    smooth = np.zeros(where.allowed.shape)
    smooth.ravel()[where.few.cells] = _smoothed(staying, where, 0, where.few)
    return smooth


def _smoothed(
    staying: Sequence[tuple[Array, Array]], where: Medium, level: int, few: Reading | None
) -> Array:
    """Return the mass assigned to a level and those above, smoothed there and brought down to the
    level.

    few: the wanted cells; None for all.
    """
    reach, (cells, stay) = where.reach[level], staying[level]
    at = few.at[level] if few else None
    shape = (reach.shape[0], reach.shape[1])
    if not any(above[0].size for above in staying[level + 1 :]):
        smooth = np.zeros(shape if at is None else at.size)
    elif at is None:
        smooth = _finer(_smoothed(staying, where, level + 1, None), shape)
    else:
        assert few is not None
        smooth = np.asarray(
            PARTS @ _smoothed(staying, where, level + 1, few).ravel()[few.above[level]]
        )
    if cells.size:
        rows, columns = np.divmod(cells, shape[1])
        # all is zero beyond these
        south, west = max(rows.min() - REACH, 0), max(columns.min() - REACH, 0)
        own = np.zeros(
            (
                min(rows.max() + REACH + 1, shape[0]) - south,
                min(columns.max() + REACH + 1, shape[1]) - west,
            )
        )
        share = reach.ravel()[cells]
        own[rows - south, columns - west] = np.divide(
            stay, share, out=np.zeros(stay.size), where=share > 0
        )
        own = _gauss(own)
        if at is None:
            smooth[south : south + own.shape[0], west : west + own.shape[1]] += own
        else:
            rows, columns = np.divmod(at, shape[1])
            rows, columns = rows - south, columns - west
            within = (rows >= 0) & (rows < own.shape[0]) & (columns >= 0) & (columns < own.shape[1])
            smooth[within] += own[rows[within], columns[within]]
    return smooth


@dataclass(frozen=True)
class Calibration:
    """Share of held-out particles inside the area that holds each share of the map, at KNOTS."""

    share: Array

    def held(self, level: Array) -> Array:
        """Return the held-out share of the area that holds `level` of the map."""
        return np.asarray(np.interp(level, KNOTS, self.share))

    def level(self, share: Array) -> Array:
        """Return the share of the map whose area held `share` of the held-out particles."""
        return np.asarray(np.interp(share, self.share, KNOTS))


def ranked(density: Array, least: float = 0.0) -> Array:
    """Return flat indices of the cells with any probability, densest first; ties in order of the
    index.

    least: density below which cells are left out.
    """
    occupied = np.flatnonzero(density >= least if least > 0 else density > 0)
    sparse = -density.ravel()[occupied]
    # twice as fast as a stable sort; the few ties are put in order afterwards
    order = np.argsort(sparse)
    level = sparse[order]
    tied = level[1:] == level[:-1]
    if tied.any():
        run = np.flatnonzero(np.append(tied, False) | np.append(False, tied))
        order[run] = order[run][np.lexsort((order[run], level[run]))]
    return np.asarray(occupied[order])


def calibrate(mass: Array, area: Array, cells: Array, unseen: Array) -> Calibration:
    """Return the calibration of a map (nlat, nlon) from held-out particles.

    unseen: their deposit (n,) in cells (flat indices).
    """
    density, held = mass / area[:, None], np.zeros(mass.size)
    held[cells] = unseen
    # no held-out particle lies in a cell of lower density
    order = ranked(density, density.ravel()[cells[unseen > 0]].min())
    inside, seen = np.cumsum(mass.ravel()[order]), np.cumsum(held[order]) / unseen.sum()
    share = np.interp(
        KNOTS, np.concatenate([[0.0], inside / mass.sum()]), np.concatenate([[0.0], seen])
    )
    share[-1] = 1.0
    return Calibration(share)
