"""How a forecast's particles did where the drifter really went: distance, spread, skill, and the drifter's rank among them.

If forecasts are true to what they say, the drifter is one more draw from the law of the particles. Then its rank among
them, by any score that treats all alike, is uniform (Vovk, Gammerman and Shafer 2005, "Algorithmic Learning in a Random
World", proposition 2.8): without approximation, whatever the score. Scored by density, the rank is the share of the
smallest area that holds the drifter, its containment; by place along and across the drift it tells which way forecasts
err (Talagrand, Vautard and Strauss 1997; Gneiting et al. 2008, doi:10.1007/s11749-008-0114-x).
"""

import numpy as np
from scipy import ndimage

from drift.drifters.records import Array
from geo import sphere

CELLS = 160  # of a side of the grid on which densities are estimated
EDGE = 5.0  # [standard deviations] of that grid
LEAST = 1.0  # [m2] of variance: particles all at one place have no density


def containment(x: Array, y: Array, weight: Array) -> float:
    """Return the share of the probability where it is denser than at the drifter, 0 to 1.

    x, y: particles east and north of the drifter [m], shape (n,); weight: their probabilities. The density is estimated
    from particles and drifter together, so that all are scored alike: Gaussian kernels of n^(-1/6) standard deviations
    (Silverman 1986, section 4.3) along the principal axes.
    """
    points = np.stack([np.append(x, 0.0), np.append(y, 0.0)])
    mass = np.append(weight, weight.mean()) / (weight.sum() + weight.mean())
    points = points - (points @ mass)[:, None]
    value, axes = np.linalg.eigh((points * mass) @ points.T + LEAST * np.eye(2))
    scaled = (axes.T @ points) / np.sqrt(value)[:, None]
    cell = 2 * EDGE / (CELLS - 1)
    place = np.clip((scaled + EDGE) / cell, 0, CELLS - 1 - 1e-9)
    first = place.astype(int)
    part = place - first
    grid = np.zeros((CELLS, CELLS))
    corners = [
        (first[0] + i, first[1] + j, (part[0] if i else 1 - part[0]) * (part[1] if j else 1 - part[1]))
        for i in (0, 1)
        for j in (0, 1)
    ]
    for a, b, share in corners:
        np.add.at(grid, (a, b), mass * share)
    smooth = ndimage.gaussian_filter(grid, x.size ** (-1 / 6) / cell, mode="constant")
    density = sum(share * smooth[a, b] for a, b, share in corners)
    own = density[-1]
    equal = np.isclose(density, own, rtol=1e-12, atol=0.0)
    return float(mass[(density > own) & ~equal].sum() + mass[equal].sum() / 2)


def rank(values: Array, weight: Array) -> float:
    """Return the share of the probability below zero, the drifter's own value; of equal values half counts."""
    total = weight.sum() + weight.mean()
    return float((weight[values < 0].sum() + (weight[values == 0].sum() + weight.mean()) / 2) / total)


def skill(apart: Array, way: Array) -> float:
    """Return the skill of a track: 1 minus separations over the drifter's own ways so far, never below 0.

    apart, way: [m] at times evenly spread after the start, shape (m,). Liu and Weisberg 2011, doi:10.1029/2010JC006837,
    eq. 1 and 2 with n = 1.
    """
    total = float(way.sum())
    return max(0.0, 1 - float(apart.sum()) / total) if total > 0 else 0.0


def about(lon: float, lat: float, lons: Array, lats: Array) -> tuple[Array, Array]:
    """Return particles [deg] east and north [m] of a point [deg]."""
    return sphere.offset(np.radians(lon), np.radians(lat), np.radians(lons), np.radians(lats))
