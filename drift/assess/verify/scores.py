"""Scores of a forecast's particles against the drifter's real position: ranks, skill, and proper scores.

If forecasts are calibrated, the drifter is one more draw from the distribution of the particles.
Then its rank among them, by any score that treats all in the same way, is exactly uniform (Vovk,
Gammerman and Shafer 2005, "Algorithmic Learning in a Random World", proposition 2.8). The rank by
density is the share of the smallest area that holds the drifter, its containment. The ranks by
position along and across the drift show in which direction forecasts err (Talagrand, Vautard and
Strauss 1997; Gneiting et al. 2008, doi:10.1007/s11749-008-0114-x).

Calibration alone does not show that a forecast is sharp. The energy score and the log score are
proper: on average nothing scores better than the true distribution (Gneiting and Raftery 2007,
doi:10.1198/016214506000001437).
"""

import numpy as np
from scipy import ndimage, special

from geo import sphere
from geo.array import Array

CELLS = 160  # cells on each side of the grid on which densities are estimated
EDGE = 5.0  # [standard deviations] from the middle of that grid to its edges
LEAST = 1.0  # [m2] added to the variance, so that particles all at one place have a density
PAIRS = 16  # of each particle with others, for the mean distance between two particles


def containment(x: Array, y: Array, weight: Array) -> float:
    """Return the probability where the density is higher than at the drifter, 0 to 1.

    The density is estimated from particles and drifter together, so that all are scored in the same
    way, with Gaussian kernels of n^(-1/6) standard deviations (Silverman 1986, section 4.3) along
    the principal axes.

    Args:
        x: particles east of the drifter [m], (n,).
        y: particles north of the drifter [m], (n,).
        weight: probabilities of the particles, (n,).

    Returns:
        The share of the smallest area that holds the drifter.
    """
    points = np.stack([np.append(x, 0.0), np.append(y, 0.0)])
    mass = np.append(weight, weight.mean()) / (weight.sum() + weight.mean())
    points = points - (points @ mass)[:, None]
    value, axes = np.linalg.eigh((points * mass) @ points.T + LEAST * np.eye(2))
    scaled = (axes.T @ points) / np.sqrt(value)[:, None]
    cell = 2 * EDGE / (CELLS - 1)
    position = np.clip((scaled + EDGE) / cell, 0, CELLS - 1 - 1e-9)
    first = position.astype(int)
    fraction = position - first
    grid = np.zeros((CELLS, CELLS))
    corners = [
        (
            first[0] + i,
            first[1] + j,
            (fraction[0] if i else 1 - fraction[0]) * (fraction[1] if j else 1 - fraction[1]),
        )
        for i in (0, 1)
        for j in (0, 1)
    ]
    for a, b, share in corners:
        np.add.at(grid, (a, b), mass * share)
    smooth = ndimage.gaussian_filter(grid, x.size ** (-1 / 6) / cell, mode="constant")
    density = sum(share * smooth[a, b] for a, b, share in corners)
    own_density = density[-1]
    equal = np.isclose(density, own_density, rtol=1e-12, atol=0.0)
    return float(mass[(density > own_density) & ~equal].sum() + mass[equal].sum() / 2)


def rank(values: Array, weight: Array) -> float:
    """Return the share of the probability below zero, the drifter's own value; ties count half.

    Args:
        values: of the particles, relative to the drifter's, (n,).
        weight: probabilities of the particles, (n,).

    Returns:
        The rank, 0 to 1.
    """
    total = weight.sum() + weight.mean()
    return float(
        (weight[values < 0].sum() + (weight[values == 0].sum() + weight.mean()) / 2) / total
    )


def energy_score(x: Array, y: Array, weight: Array) -> float:
    """Return the energy score [m] of particles; smaller is better, 0 is perfect.

    It is the mean distance of a particle from the drifter, less half the mean distance between two
    particles (Gneiting and Raftery 2007, eq. 22, with exponent 1). A forecast of a single position
    scores its distance from the drifter. The second mean is over pairs of each particle with PAIRS
    others, chosen by a fixed seed. Its error is below that of the first mean if the
    weights are about equal, as those of a forecast are.

    Args:
        x: particles east of the drifter [m], (n,).
        y: particles north of the drifter [m], (n,).
        weight: probabilities of the particles, (n,).

    Returns:
        The energy score.
    """
    order = np.random.default_rng(0).permutation(x.size)
    x, y, weight = x[order], y[order], weight[order]
    apart = float(np.average(np.hypot(x, y), weights=weight))
    among, total = 0.0, 0.0
    for shift in range(1, min(PAIRS, x.size - 1) + 1):
        pair = weight * np.roll(weight, shift)
        among += float(pair @ np.hypot(x - np.roll(x, shift), y - np.roll(y, shift)))
        total += float(pair.sum())
    return apart - 0.5 * among / total if total > 0 else apart


def log_score(x: Array, y: Array, weight: Array) -> float:
    """Return the logarithm of the forecast's density [1/km2] at the drifter; larger is better.

    The density is that of the particles alone, smoothed with Gaussian kernels of n^(-1/6) standard
    deviations (Silverman 1986, section 4.3) along the principal axes: the rule of `containment`. It
    is fixed before the drifter is seen. Beyond the outermost particle it falls as the kernel does.

    Args:
        x: particles east of the drifter [m], (n,).
        y: particles north of the drifter [m], (n,).
        weight: probabilities of the particles, (n,).

    Returns:
        The log score.
    """
    mass = weight / weight.sum()
    points = np.stack([x, y])
    centred = points - (points @ mass)[:, None]
    kernel = ((centred * mass) @ centred.T + LEAST * np.eye(2)) * x.size ** (-1 / 3)
    square = (points * np.linalg.solve(kernel, points)).sum(axis=0)
    peak = 1e6 / (2 * np.pi * np.sqrt(np.linalg.det(kernel)))
    return float(special.logsumexp(-0.5 * square, b=mass) + np.log(peak))


def unclipped_skill(apart: Array, way: Array) -> float:
    """Return the skill SS* of a track: 1 minus the sum of separations over that of path lengths.

    Unlike `skill` it may be negative, so that its mean over tracks is not biased (Revelard et al.
    2021, doi:10.3389/fmars.2021.630388).

    Args:
        apart: separations of forecast and drifter [m] at evenly spaced times after the start, (m,).
        way: path lengths of the drifter since the start [m] at these times, (m,).

    Returns:
        The skill, at most 1; 0 if the drifter did not move.
    """
    total = float(way.sum())
    return 1 - float(apart.sum()) / total if total > 0 else 0.0


def skill(apart: Array, way: Array) -> float:
    """Return the skill of a track, `unclipped_skill` but never below 0.

    Liu and Weisberg 2011, doi:10.1029/2010JC006837, eq. 1 and 2 with n = 1.

    Args:
        apart: as of `unclipped_skill`.
        way: as of `unclipped_skill`.

    Returns:
        The skill, 0 to 1.
    """
    return max(0.0, unclipped_skill(apart, way))


def relative_to(lon: float, lat: float, lons: Array, lats: Array) -> tuple[Array, Array]:
    """Return how far particles [deg] are east and north of a point [deg], in [m]."""
    return sphere.offset(np.radians(lon), np.radians(lat), np.radians(lons), np.radians(lats))
