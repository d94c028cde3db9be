"""The most likely place afloat and the most likely stretch of coast, from the cells of a forecast.

What strands gathers in a few cells of the coast. Over all media together the densest cell is
therefore often one of these, even if nearly all of the probability is afloat. So the two are named
apart, and the medium that holds more comes first.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import KDTree

from geo import sphere
from geo.array import Array
from geo.notation import NMI

REACH = 2.5 * NMI  # [m] a stretch of coast reaches so far on both sides of its middle
LEAST = 0.01  # probability ashore below which no stretch of coast is named
# relative: sums of float32 probabilities that differ by less are equal
ROUNDING = 1e-6


class LikelyPlace(NamedTuple):
    """Centre of a cell, and the probability of the stretch of coast about it."""

    lon: float  # [deg], -180 to 180
    lat: float  # [deg]
    ashore: bool
    share: float  # ashore within REACH of the centre; of a place afloat: all that is afloat


def likeliest_places(at: Any) -> list[LikelyPlace]:
    """Return the most likely place afloat and the most likely stretch of coast.

    Afloat it is the densest cell. On the coast it is the cell with the most probability ashore
    within REACH, the densest one of several that hold the same: cells differ in size between
    runs, a stretch does not.

    Args:
        at: one output of a forecast, with `probability`, `probability_ashore` and `cell_area`,
            shape (nlat, nlon), and `lon` and `lat` [deg].

    Returns:
        Neither, one or both, the one whose medium holds more of the map first. A stretch is left
        out if less than LEAST is ashore and anything is afloat.
    """
    ashore = at["probability_ashore"].values.astype(np.float64)
    # a difference of two float32 sums
    afloat = np.maximum(at["probability"].values.astype(np.float64) - ashore, 0.0)
    area = at["cell_area"].values
    lon, lat = at["lon"].values, at["lat"].values
    found = []
    held, stranded = float(afloat.sum()), float(ashore.sum())
    if held > 0:
        densest = np.unravel_index(int((afloat / area).argmax()), afloat.shape)
        found.append(_place(lon[densest[1]], lat[densest[0]], False, held))
    if stranded >= LEAST or stranded > held:
        row, column, share = _densest_stretch(ashore, area, lon, lat)
        found.append(_place(lon[column], lat[row], True, share))
    return found[::-1] if stranded > held else found


def likeliest_place(at: Any) -> LikelyPlace | None:
    """Return the first of `likeliest_places`; None if nothing is on the map.

    Args:
        at: as that of `likeliest_places`.
    """
    found = likeliest_places(at)
    return found[0] if found else None


def _place(lon: float, lat: float, ashore: bool, share: float) -> LikelyPlace:
    return LikelyPlace(float(sphere.wrap_degrees(float(lon))), float(lat), ashore, share)


def _densest_stretch(ashore: Array, area: Array, lon: Array, lat: Array) -> tuple[int, int, float]:
    """Return row and column of the cell with the most probability within REACH, and how much."""
    rows, columns = np.nonzero(ashore)
    mass = ashore[rows, columns]
    points = np.stack(sphere.vector(np.radians(lon[columns]), np.radians(lat[rows])), axis=-1)
    chord = 2 * np.sin(0.5 * REACH / sphere.RADIUS)
    tree = KDTree(points)
    near = tree.query_ball_point(points, chord)
    sums = np.array([mass[beside].sum() for beside in near])
    density = mass / area[rows, columns]
    equal = sums >= sums.max() * (1 - ROUNDING)
    k = int(np.argmax(np.where(equal, density, -1.0)))
    return int(rows[k]), int(columns[k]), float(sums[k])
