"""One snapshot's map: density chosen and calibrated on held-out particles, containment levels, areas and contours."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import contourpy
import numpy as np
import shapely

from drift import density
from drift.cells import Array, Cells
from geo import sphere

SHARES = (0.5, 0.75, 0.95)  # the containment areas that are reported


@dataclass(frozen=True)
class Deposits:
    """What the particles of one snapshot leave in the cells, in units of probability.

    mass, squares: weights and squared weights by group and medium (adrift; ashore if any is), shape (4, media, nlat, nlon).
    scenario: weights by scenario and medium, shape (scenarios, media, nlat, nlon).
    """

    mass: Array
    squares: Array
    scenario: Array


@dataclass(frozen=True)
class Area:
    """Map of one snapshot on its own cells.

    probability: by scenario and medium (adrift; ashore if any is), shape (scenarios, media, nlat, nlon).
    containment: smallest share whose area contains the cell, shape (nlat, nlon); 1 where there is nothing.
    areas: [m2] of the SHARES; held_out: share of unseen particles inside them; thresholds: logarithms of their least
    densities [1/m2]; per_kernel: effective particles in a kernel, the bandwidth chosen.
    """

    cells: Cells
    probability: Array
    containment: Array
    areas: Array
    held_out: Array
    per_kernel: float
    thresholds: Array
    calibration: density.Calibration


def _map(mass: Array, squares: Array, m: float, media: Sequence[density.Medium]) -> Array:
    """Return the smooth map of all media together, shape (nlat, nlon), from (media, nlat, nlon)."""
    parts = [
        density.spread(mass[i], density.histogram(mass[i], squares[i], media[i]), m, media[i])
        for i in range(len(media))
        if mass[i].any()
    ]
    return np.asarray(sum(parts[1:], parts[0]))


def _choose(halves: list[tuple[Array, Array]], media: Sequence[density.Medium], start: float) -> float:
    """Return the number of particles per kernel under which each half best foretells the other.

    Climbs a ladder of factors 2 from `start`. A rung finer than that must beat the coarser one by two standard errors of the
    paired difference: sharp edges alone are no reason to speckle all the rest.
    """
    guides = [
        [density.histogram(mass[i], squares[i], media[i]) if mass[i].any() else None for i in range(len(media))]
        for mass, squares in halves
    ]
    weights, where = [], []
    for mass, _ in halves[::-1]:
        seen = mass.sum(axis=0).ravel()
        where.append(np.flatnonzero(seen))
        weights.append(seen[where[-1]])
    weight = np.concatenate(weights)
    effective = sum(mass.sum() for mass, _ in halves) ** 2 / sum(squares.sum() for _, squares in halves)

    def score(step: int) -> Array:
        logs = []
        for (mass, _), guide, there in zip(halves, guides, where, strict=True):
            smooth = np.zeros(mass.shape[1:])
            for i, one in enumerate(guide):
                if one is not None:
                    smooth += density.spread(mass[i], one, start * 2.0**step, media[i])
            floor = 1e-6 * smooth.sum() / smooth.size  # a particle off the map costs much, but not everything
            logs.append(np.log(smooth.ravel()[there] + floor))
        return np.concatenate(logs)

    def gain(finer: Array, coarser: Array) -> float:
        """Mean gain of the finer in standard errors."""
        difference = finer - coarser
        mean = np.average(difference, weights=weight)
        variance = np.average((difference - mean) ** 2, weights=weight)
        return float(mean / np.sqrt(variance / effective + 1e-300))

    best, score_best = 0, score(0)
    while best < 5 and gain(score_best, score_next := score(best + 1)) < 0:
        best, score_best = best + 1, score_next
    while -3 < best <= 0 and gain(score_next := score(best - 1), score_best) > 2:
        best, score_best = best - 1, score_next
    return start * 2.0**best


def build(cells: Cells, deposits: Deposits, media: Sequence[density.Medium]) -> Area:
    """Return the map of one snapshot.

    The bandwidth is chosen on halves (groups 0 and 1 against 2 and 3) and each half's map is calibrated by the other;
    `held_out` uses a quarter to calibrate and another quarter, seen by neither map nor calibration, to check.
    """
    area = cells.area()
    groups = deposits.mass.sum(axis=(1, 2, 3))
    mass, squares = deposits.mass.sum(axis=0), deposits.squares.sum(axis=0)
    effective = groups.sum() ** 2 / squares.sum()
    m = density.PER_KERNEL * effective ** (2 / 3)
    identity = density.Calibration(density.KNOTS)
    calibration, held = identity, np.full(len(SHARES), np.nan)
    if groups.min() > 0:
        halves = [(deposits.mass[i : i + 2].sum(axis=0), deposits.squares[i : i + 2].sum(axis=0)) for i in (0, 2)]
        half = _choose(halves, media, max(m / 2, 2.0))
        m = 2 * half  # the same bandwidth as the halves had: so the calibration, which undoes its bias, is right
        both, checks = [], []
        for fold, others in ((0, (2, 3)), (1, (0, 1))):
            smooth = _map(*halves[fold], half, media)
            quarters = density.calibrations(smooth, area, [deposits.mass[i].sum(axis=0) for i in others])
            weight = groups[list(others)] / groups[list(others)].sum()
            both.append(weight[0] * quarters[0].share + weight[1] * quarters[1].share)
            checks += [b.held(a.level(np.array(SHARES))) for a, b in (quarters, quarters[::-1])]
        calibration, held = density.Calibration(np.mean(both, axis=0)), np.mean(checks, axis=0)
    guides = [density.histogram(mass[i], squares[i], media[i]) for i in range(len(media))]
    probability = np.stack(
        [
            np.stack([density.spread(one[i], guides[i], m, media[i]) for i in range(len(media))])
            for one in deposits.scenario
        ]
    )
    total = probability.sum(axis=(0, 1))
    contained, levels, sizes, heights = containment(total, area, calibration)
    thresholds = np.interp(SHARES, levels[1:], np.log(heights))
    return Area(cells, probability, contained, np.interp(SHARES, levels, sizes), held, m, thresholds, calibration)


def containment(mass: Array, area: Array, calibration: density.Calibration) -> tuple[Array, Array, Array, Array]:
    """Return the containment of each cell (nlat, nlon), and its curve: levels and areas [m2] from 0 up, densities."""
    height = mass / area[:, None]
    order = density.ranked(height)
    inside = np.cumsum(mass.ravel()[order])
    level = calibration.held(inside / inside[-1])
    contained = np.ones(mass.size)
    contained[order] = level
    size = np.cumsum(area[order // mass.shape[1]])
    contained = contained.reshape(mass.shape)
    return contained, np.concatenate([[0.0], level]), np.concatenate([[0.0], size]), height.ravel()[order]


def contour(one: Area, share: float) -> shapely.MultiPolygon:
    """Return the outline [deg, unwrapped] of the area that holds `share`, with its holes.

    The line runs where the logarithm of density, linear between cell centres, is that of the area's last cells. A pad
    of empty cells closes it at the edge.
    """
    height = one.probability.sum(axis=(0, 1)) / one.cells.area()[:, None]
    threshold = float(one.thresholds[SHARES.index(share)])
    # what lies far below the threshold, and empty cells, count as e^-4 of it: the line stays near the cells that matter
    field = np.log(np.maximum(height, np.exp(threshold - 4)))
    lon, lat = one.cells.lon(), one.cells.lat()
    dlon, dlat = (one.cells.width, one.cells.height) * np.array(360.0 / sphere.TURN)
    lon = np.concatenate([[lon[0] - dlon], lon, [lon[-1] + dlon]])
    lat = np.concatenate([[lat[0] - dlat], lat, [lat[-1] + dlat]])
    return outline(lon, lat, np.pad(field, 1, constant_values=threshold - 4), threshold)


def outline(lon: Array, lat: Array, field: Array, threshold: float) -> shapely.MultiPolygon:
    """Return the valid polygons where a field (nlat, nlon) exceeds a threshold."""
    generator: Callable[..., contourpy.ContourGenerator] = contourpy.contour_generator
    lines = generator(lon, lat, field, fill_type=contourpy.FillType.OuterOffset)
    polygons = []
    for points, offsets in zip(*lines.filled(threshold, np.inf), strict=True):
        rings = [points[a:b] for a, b in itertools.pairwise(offsets)]
        polygons.append(shapely.Polygon(rings[0], rings[1:]))
    whole = shapely.make_valid(shapely.MultiPolygon(polygons))
    parts = [p for p in shapely.get_parts(whole) if p.geom_type in ("Polygon", "MultiPolygon") and p.area > 0]
    union = shapely.union_all(parts) if parts else shapely.MultiPolygon()
    return union if isinstance(union, shapely.MultiPolygon) else shapely.MultiPolygon([union])
