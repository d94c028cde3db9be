"""Scores of a forecast's particles against the drifter's real position: ranks and skill.

If forecasts are calibrated, the drifter is one more draw from the distribution of the particles.
Then its rank among them, by any score that treats all in the same way, is exactly uniform (Vovk,
Gammerman and Shafer 2005, "Algorithmic Learning in a Random World", proposition 2.8). The rank by
density is the share of the smallest area that holds the drifter, its containment. The ranks by
position along and across the drift show in which direction forecasts err (Talagrand, Vautard and
Strauss 1997; Gneiting et al. 2008, doi:10.1007/s11749-008-0114-x).
"""

import numpy as np
from scipy import ndimage

from geo import sphere
from geo.array import Array

CELLS = 160  # cells on each side of the grid on which densities are estimated
EDGE = 5.0  # [standard deviations] from the middle of that grid to its edges
LEAST = 1.0  # [m2] added to the variance, so that particles all at one place have a density


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


def skill(apart: Array, way: Array) -> float:
    """Return the skill of a track: 1 minus the sum of separations over that of path lengths.

    Liu and Weisberg 2011, doi:10.1029/2010JC006837, eq. 1 and 2 with n = 1.

    Args:
        apart: separations of forecast and drifter [m] at evenly spaced times after the start, (m,).
        way: path lengths of the drifter since the start [m] at these times, (m,).

    Returns:
        The skill, 0 to 1.
    """
    total = float(way.sum())
    return max(0.0, 1 - float(apart.sum()) / total) if total > 0 else 0.0


def relative_to(lon: float, lat: float, lons: Array, lats: Array) -> tuple[Array, Array]:
    """Return how far particles [deg] are east and north of a point [deg], in [m]."""
    return sphere.offset(np.radians(lon), np.radians(lat), np.radians(lons), np.radians(lats))
