"""The probability map of one snapshot: smoothed density, calibration on held-out particles,
containment areas and their outlines.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import contourpy
import numpy as np
import shapely

from drift.forecast import density
from drift.forecast.shares import SHARES
from geo import sphere
from geo.array import Array
from geo.cells import Cells

MANY = 20_000  # effective particles from which testing one half suffices to choose the bandwidth


@dataclass(frozen=True)
class Deposits:
    """Probability of one snapshot in the cells that hold any particle.

    cells: flat indices, (n,). mass, squares: summed weights and squared weights by group and medium
    (adrift; ashore if any particle is), shape (4, media, n). scenario: weights by displayed
    scenario (drift.forecast.likeliest) and medium, shape (scenarios, media, n). Cells vary slowest
    in memory, as the kernels lay them: the order of float sums depends on it.
    """

    cells: Array
    mass: Array
    squares: Array
    scenario: Array

    @classmethod
    def by_cell(cls, cells: Array, *amounts: Array) -> "Deposits":
        """Return the deposits of mass, squares and scenario, given cells first, (n, ..., media)."""
        return cls(cells, *(np.moveaxis(own, 0, -1) for own in amounts))

    def __reduce__(self) -> tuple[Any, ...]:
        """Keep the order in memory in another process, where NumPy would choose its own."""
        amounts = self.mass, self.squares, self.scenario
        return Deposits.by_cell, (self.cells, *(np.moveaxis(own, -1, 0) for own in amounts))


@dataclass(frozen=True)
class Area:
    """Map of one snapshot on its own cells.

    probability: by displayed scenario and medium (adrift; ashore if any particle is), shape
    (scenarios, media, nlat, nlon). containment: smallest share whose area contains the cell, shape
    (nlat, nlon); 1 where there is no probability. areas: sizes [m2] of the containment areas of the
    shares. held_out: share of held-out particles inside each. thresholds: logarithm of the lowest
    density [1/m2] in each. per_kernel: effective particles per kernel, the bandwidth chosen.
    coarse: calibration of the map summed into the cells common to all times. It differs along a
    shore, where half of the smoothed mass lies in cells beside those that hold all particles.
    """

    cells: Cells
    shares: tuple[float, ...]
    probability: Array
    containment: Array
    areas: Array
    held_out: Array
    per_kernel: float
    thresholds: Array
    calibration: density.Calibration
    coarse: density.Calibration


More = tuple[Array, ...] | None  # what density.wider returns


Guides = list[density.Histogram]  # of the kernels of each medium


def guides_of(cells: Array, mass: Array, squares: Array, media: Sequence[density.Medium]) -> Guides:
    """Return the guide histogram of each medium, from weights and squared weights (media, n) in
    cells.
    """
    return [
        density.histogram(cells[w > 0], w[w > 0], s[w > 0], where)
        for w, s, where in zip(mass, squares, media, strict=True)
    ]


def divided(guides: Guides, more: More) -> Guides:
    """Return guides whose kernels hold `more` times as many particles."""
    return [density.divided(guide, more) for guide in guides]


def spread(
    cells: Array,
    mass: Array,
    guides: Guides,
    m: float,
    media: Sequence[density.Medium],
    at: density.Reading | None = None,
) -> Array:
    """Return the smoothed map of all media together, (nlat, nlon), from weights (media, n) in
    cells.

    at: the cells to read; the result is then their values, (k,).
    """
    total = np.zeros(media[0].allowed.shape) if at is None else np.zeros(at.cells.size)
    for weights, guide, where in zip(mass, guides, media, strict=True):
        if weights.any():
            total += density.spread(cells[weights > 0], weights[weights > 0], guide, m, where, at)
    return total


def _choose_bandwidth(
    cells: Array,
    halves: list[tuple[Array, Array]],
    media: Sequence[density.Medium],
    start: float,
    more: More,
) -> tuple[float, More]:
    """Return the particles per kernel with which each half best predicts the other, and the
    widening.

    The search tries factors of 2 from `start`. A finer bandwidth than `start` must beat the next
    coarser one by two standard errors of the paired difference, so that sharp edges do not make the
    rest of the map noisy. Then kernels are widened by `more` where the map is dense, unless this
    lowers the predictive likelihood by more than two standard errors, as it may along a thin
    filament. In that case None is returned for the widening.
    """
    effective = sum(mass.sum() for mass, _ in halves) ** 2 / sum(
        squares.sum() for _, squares in halves
    )
    pairs = [(0, 1), (1, 0)] if effective < MANY else [(0, 1)]

    plain = [guides_of(cells, *half, media) for half in halves]
    weights, where = [], []
    for _, other in pairs:
        seen = halves[other][0].sum(axis=0)
        where.append(
            density.reading(
                cells[seen > 0], [(reach.shape[0], reach.shape[1]) for reach in media[0].reach]
            )
        )
        weights.append(seen[seen > 0])
    weight = np.concatenate(weights)

    def score(step: int, guides: list[Guides] = plain) -> Array:
        logs = []
        for (half, _), there in zip(pairs, where, strict=True):
            mass = halves[half][0]
            smooth = spread(cells, mass, guides[half], start * 2.0**step, media, there)
            # The small constant keeps a single particle off the map from dominating the likelihood.
            logs.append(np.log(smooth + 1e-6 * mass.sum() / media[0].allowed.size))
        return np.concatenate(logs)

    def gain(finer: Array, coarser: Array) -> float:
        """Return the mean gain of the finer bandwidth in standard errors."""
        difference = finer - coarser
        mean = np.average(difference, weights=weight)
        variance = np.average((difference - mean) ** 2, weights=weight)
        return float(mean / np.sqrt(variance / effective + 1e-300))

    best, score_best = 0, score(0)
    while best < 5 and gain(score_best, score_next := score(best + 1)) < 0:
        best, score_best = best + 1, score_next
    while -3 < best <= 0 and gain(score_next := score(best - 1), score_best) > 2:
        best, score_best = best - 1, score_next
    return start * 2.0**best, more if gain(
        score(best, [divided(guides, more) for guides in plain]), score_best
    ) > -2 else None


def _calibrate_both(mass: Array, cells: Cells, held: Array, unseen: Array, k: int) -> Array:
    """Return the calibrations of a map and of its sums over k by k cells, at density.KNOTS, (2,
    knots).

    unseen: weights (n,) of the held-out particles in the cells `held` (flat indices).
    """
    fine = density.calibrate(mass, cells.area(), held, unseen).share
    if k == 1:
        return np.stack([fine, fine])
    wide, (row, column) = coarser(cells, k), np.divmod(held, cells.nlon)
    there, which = np.unique((row // k) * wide.nlon + column // k, return_inverse=True)
    return np.stack(
        [
            fine,
            density.calibrate(
                summed(mass, k), wide.area(), there, np.bincount(which, unseen)
            ).share,
        ]
    )


def coarser(cells: Cells, k: int) -> Cells:
    """Return the cells that each cover k by k of the given cells."""
    return Cells(
        cells.lon0, cells.lat0, k * cells.width, k * cells.height, cells.nlon // k, cells.nlat // k
    )


def summed(values: Array, k: int) -> Array:
    """Return sums over k by k cells, shape (..., nlat / k, nlon / k)."""
    nlat, nlon = (length // k for length in values.shape[-2:])
    return np.asarray(values.reshape(*values.shape[:-2], nlat, k, nlon, k).sum(axis=(-3, -1)))


def build_area(
    cells: Cells,
    deposits: Deposits,
    media: Sequence[density.Medium],
    shares: tuple[float, ...] = SHARES,
    k: int = 1,
) -> Area:
    """Return the map of one snapshot with the containment areas of some shares.

    The bandwidth is chosen on halves (groups 0 and 1 against 2 and 3). Then each group in turn
    calibrates a map of the other three, smoothed with the same bandwidth. `held_out` checks each
    group with the calibration of the others.

    Args:
        cells: of the map.
        deposits: of the snapshot in these cells.
        media: where probability may be, adrift and ashore.
        shares: of the containment areas, ascending.
        k: number of these cells along the side of a cell common to all times.
    """
    area, held = cells.area(), deposits.cells

    groups = deposits.mass.sum(axis=(1, 2))
    mass, squares = deposits.mass.sum(axis=0), deposits.squares.sum(axis=0)
    effective = groups.sum() ** 2 / squares.sum()
    m = density.PER_KERNEL * effective ** (2 / 3)
    plain = guides_of(held, mass, squares, media)
    more: More = density.wider(spread(held, mass, plain, density.WIDER * m, media), area)
    calibration = coarse = density.Calibration(density.KNOTS)
    share_held = np.full(len(shares), np.nan)
    if groups.min() > 0:
        halves = [
            (deposits.mass[i : i + 2].sum(axis=0), deposits.squares[i : i + 2].sum(axis=0))
            for i in (0, 2)
        ]
        # At the same bandwidth a kernel holds twice as many of all particles as of half of them.
        m, more = _choose_bandwidth(held, halves, media, max(m / 2, 2.0), more)
        m *= 2
        calibrations = []
        for unseen, their_squares in zip(deposits.mass, deposits.squares, strict=True):
            seen, guides = (
                mass - unseen,
                guides_of(held, mass - unseen, squares - their_squares, media),
            )
            rest = spread(held, seen, divided(guides, more), 0.75 * m, media)
            calibrations.append(_calibrate_both(rest, cells, held, unseen.sum(axis=0), k))
        calibration, coarse = (
            density.Calibration(curve) for curve in np.average(calibrations, axis=0, weights=groups)
        )
        folds = [fold[0] for fold in calibrations]
        weights = groups * (1 - np.eye(4))
        others = [
            density.Calibration(np.average(folds, axis=0, weights=weight)) for weight in weights
        ]
        checks = [
            density.Calibration(fold).held(other.level(np.array(shares)))
            for fold, other in zip(folds, others, strict=True)
        ]
        share_held = np.average(checks, axis=0, weights=groups)
    guides = divided(plain, more)
    probability = np.stack(
        [
            np.stack(
                [
                    spread(held, scenario[[i]], guides[i : i + 1], m, media[i : i + 1])
                    for i in range(len(media))
                ]
            )
            for scenario in deposits.scenario
        ]
    )
    total = probability.sum(axis=(0, 1))
    contained, levels, sizes, heights = containment(total, area, calibration)
    thresholds = np.interp(shares, levels[1:], np.log(heights))
    sizes = np.interp(shares, levels, sizes)
    return Area(
        cells, shares, probability, contained, sizes, share_held, m, thresholds, calibration, coarse
    )


def containment(
    mass: Array, area: Array, calibration: density.Calibration
) -> tuple[Array, Array, Array, Array]:
    """Return the containment of each cell, (nlat, nlon), and curves of level, area [m2] and density
    [1/m2].

    Args:
        mass: probability, (nlat, nlon).
        area: of a cell in each row [m2], (nlat,).
        calibration: from held-out particles.
    """
    height = mass / area[:, None]
    order = density.ranked(height)
    inside = np.cumsum(mass.ravel()[order])
    level = calibration.held(inside / inside[-1])
    contained = np.ones(mass.size)
    contained[order] = level
    size = np.cumsum(area[order // mass.shape[1]])
    return (
        contained.reshape(mass.shape),
        np.concatenate([[0.0], level]),
        np.concatenate([[0.0], size]),
        height.ravel()[order],
    )


@dataclass(frozen=True)
class Lattice:
    """Cell centres x (nlon,) and y (nlat,), their spacing, and the conversion of points (n, 2) to
    degrees, unwrapped.
    """

    x: Array
    y: Array
    step: tuple[float, float]
    degrees: Callable[[Array], Array]


def _lattice(cells: Cells) -> Lattice:
    dlon, dlat = (cells.width, cells.height) * np.array(360.0 / sphere.TURN)
    return Lattice(cells.lon(), cells.lat(), (dlon, dlat), lambda points: points)


def outlined(
    cells: Cells, mass: Array, shares: Sequence[float]
) -> tuple[Array, Array, list[shapely.MultiPolygon]]:
    """Return the containment of a map's cells, and the sizes [m2] and outlines [deg] of its areas.

    The areas are not calibrated: they hold their shares of this map.

    Args:
        cells: of the map.
        mass: probability, (nlat, nlon), not all 0.
        shares: of the areas, ascending.
    """
    area = cells.area()
    contained, levels, sizes, heights = containment(mass, area, density.Calibration(density.KNOTS))
    wanted, least = np.interp(shares, levels, sizes), np.interp(shares, levels[1:], np.log(heights))
    each = zip(least.tolist(), wanted.tolist(), strict=True)
    return (
        contained,
        wanted,
        [_fit_outline(_lattice(cells), mass / area[:, None], *one) for one in each],
    )


def contours(area: Area) -> list[shapely.MultiPolygon]:
    """Return the outlines [deg, unwrapped] of the containment areas, with their holes."""
    height = area.probability.sum(axis=(0, 1)) / area.cells.area()[:, None]
    each = zip(area.thresholds.tolist(), area.areas.tolist(), strict=True)
    return [
        _fit_outline(_lattice(area.cells), height, threshold, wanted) for threshold, wanted in each
    ]


def contour(lattice: Lattice, field: Array, threshold: float) -> tuple[float, shapely.MultiPolygon]:
    """Return the size [m2] and the outline [deg] of the area where a field exceeds a threshold.

    The field (nlat, nlon) must be lowest along its edge. It is interpolated linearly in the four
    triangles between four centres and their mean in the middle.
    """
    lines = contourpy.contour_generator(
        lattice.x,
        lattice.y,
        field,
        name="serial",
        fill_type=contourpy.FillType.OuterOffset,
        quad_as_tri=True,
    )
    rings = _rings(lines, threshold, lattice.degrees)
    return sum(map(_area, itertools.chain.from_iterable(rings))), _polygons(rings)


def interpolated(lattice: Lattice, field: Array, x: Array, y: Array) -> Array:
    """Return the field of `contour`, interpolated in the same way, at points (n,) within its
    centres.
    """
    across, up = (x - lattice.x[0]) / lattice.step[0], (y - lattice.y[0]) / lattice.step[1]
    i, j = (
        np.clip(v.astype(int), 0, many - 2)
        for v, many in ((across, len(lattice.x)), (up, len(lattice.y)))
    )
    u, v = across - i - 0.5, up - j - 0.5
    west, south, both = field[j + 1, i], field[j, i + 1], field[j + 1, i + 1]
    corner = field[j, i]
    middle = (corner + west + south + both) / 4
    flat = np.abs(u) >= np.abs(v)
    one = np.where(flat, np.where(u > 0, south, corner), np.where(v > 0, west, corner))
    two = np.where(flat, np.where(u > 0, both, west), np.where(v > 0, both, south))
    off, along = np.where(flat, np.abs(u), np.abs(v)), np.where(flat, v, u)
    return np.asarray(middle + ((one + two) / 2 - middle) * 2 * off + (two - one) * along)


def _fit_outline(
    lattice: Lattice, height: Array, threshold: float, wanted: float
) -> shapely.MultiPolygon:
    """Return the outline [deg] of the cells whose density exceeds a threshold.

    threshold: the logarithm of a density [1/m2]; wanted: total size [m2] of these cells.

    The line runs where the logarithm of density, linear between cell centres, equals the threshold.
    Where cells are coarse the line is moved until it encloses the wanted size to 0.5 %. A border of
    empty cells closes it at the edge. Along a shore the outline, a cell or two wide, stays nearer
    to the shoreline than the cells and holds more probability than they do: with 20,000 particles
    stranded on a wavy shore the outlines of the 50, 75 and 95 % areas held 58, 76 and 98 %; with 60
    % of them stranded, 54, 75 and 95 %.
    """
    # the line stays within the neighbours of these cells
    near = height > np.exp(threshold - 3)
    rows, columns = (np.flatnonzero(near.any(axis=axis)) for axis in (1, 0))
    south, west = max(rows[0] - 1, 0), max(columns[0] - 1, 0)
    height = height[south : rows[-1] + 2, west : columns[-1] + 2]
    # Empty cells and those far below the threshold count as e^-4 of it: so the line stays near the
    # cells that matter.
    field = np.pad(
        np.log(np.maximum(height, np.exp(threshold - 4))), 1, constant_values=threshold - 4
    )
    x, y = lattice.x[west : columns[-1] + 2], lattice.y[south : rows[-1] + 2]
    x, y = (
        np.concatenate([[v[0] - d], v, [v[-1] + d]])
        for v, d in zip((x, y), lattice.step, strict=True)
    )
    generator: Callable[..., contourpy.ContourGenerator] = contourpy.contour_generator
    lines = generator(x, y, field, fill_type=contourpy.FillType.OuterOffset)
    low, high = threshold - 3.0, threshold + 3.0
    rings: list[list[Array]] = []
    for step in range(12):
        rings = _rings(lines, threshold, lattice.degrees)
        ratio = sum(map(_area, itertools.chain.from_iterable(rings))) / wanted
        if abs(ratio - 1) < 0.005:
            break
        low, high = (threshold, high) if ratio > 1 else (low, threshold)
        threshold = (
            (low + high) / 2
            if step
            else float(np.clip(threshold + np.log(max(ratio, 0.1)), low, high))
        )
    return _polygons(rings)


def _rings(
    lines: contourpy.ContourGenerator, threshold: float, degrees: Callable[[Array], Array]
) -> list[list[Array]]:
    """Return the rings [deg] of the polygons in which the field exceeds a threshold.

    Of each polygon the outer ring comes first (anticlockwise), then its holes (clockwise).
    """
    return [
        [degrees(points[a:b]) for a, b in itertools.pairwise(offsets)]
        for points, offsets in zip(*lines.filled(threshold, np.inf), strict=True)
    ]


def _area(ring: Array) -> float:
    """Return the signed area [m2] within a ring [deg]: by Lambert's cylindrical projection, which
    keeps areas.
    """
    x, y = np.radians(ring[:, 0] - ring[0, 0]), np.sin(np.radians(ring[:, 1]))
    y = y - y[0]
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) / 2 * sphere.RADIUS**2


def _polygon(outer: Array, holes: Sequence[Array]) -> shapely.Polygon:
    """Return the polygon of an outer ring and its holes, which may touch it along the seam of a
    pole.
    """
    whole = shapely.Polygon(outer, holes)
    if not holes or whole.is_valid:
        return whole
    rest = shapely.Polygon(outer).difference(
        shapely.union_all([shapely.make_valid(shapely.Polygon(h)) for h in holes])
    )
    return rest if isinstance(rest, shapely.Polygon) else whole


def _polygons(rings: list[list[Array]]) -> shapely.MultiPolygon:
    """Return the valid polygons that rings enclose."""
    whole = shapely.make_valid(
        shapely.MultiPolygon([_polygon(outer, holes) for outer, *holes in rings])
    )
    parts = [
        p
        for p in shapely.get_parts(whole)
        if p.geom_type in ("Polygon", "MultiPolygon") and p.area > 0
    ]
    union = shapely.union_all(parts) if parts else shapely.MultiPolygon()
    return union if isinstance(union, shapely.MultiPolygon) else shapely.MultiPolygon([union])
