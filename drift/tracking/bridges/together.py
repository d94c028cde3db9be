"""Likelihood of a spread rate by whole stretches: all steps jointly, with errors of the fixes.

Pozdnyakov, Meyer, Wang and Yan 2014, doi:10.1890/13-0532.1: Brownian motion observed with
independent errors. Neighbouring steps share the error of the fix between them, so their covariance
has three diagonals: K^2 dt + 2 e^2 on the main one and -e^2 beside it, for each component. The
banded Cholesky factor gives the exact likelihood in a number of operations proportional to the
steps. In `wandering` the motion has no mean velocity. A ship between ports does have one, unknown
in each stretch: `steady` regresses it (restricted likelihood), which leaves the deviation of a
bridge from the stretch's first fix to its last.

Each stretch is projected to the tangent plane of its middle fix. Distances from there are exact;
those across are too long by the share r^2/6 at r Earth radii (0.13 % at 300 nmi).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from drift.tracking.bridges.stretches import Stretch
from geo import sphere
from geo.array import Array


@dataclass(frozen=True)
class Steps:
    """Steps of one stretch.

    name: index of its track. moved: east and north [m], (n, 2). time: of each step [s], (n,).
    """

    name: int
    moved: Array
    time: Array


def steps(stretches: Sequence[Stretch]) -> tuple[Steps, ...]:
    """Return the steps of stretches."""
    names = {
        name: number
        for number, name in enumerate(dict.fromkeys(stretch.name for stretch in stretches))
    }
    found = []
    for stretch in stretches:
        middle = stretch.time.size // 2
        place = np.stack(
            sphere.offset(stretch.lon[middle], stretch.lat[middle], stretch.lon, stretch.lat), -1
        )
        found.append(Steps(names[stretch.name], np.diff(place, axis=0), np.diff(stretch.time)))
    return tuple(found)


def wandering(of: Sequence[Steps], spread_rate: float, error: float) -> Array:
    """Return the log likelihood by track of motion without a mean velocity, shape (tracks,).

    Args:
        of: steps of each stretch.
        spread_rate: K [m/sqrt(s)].
        error: standard deviation of a fix in each component [m]. One of the two must be above 0.
    """
    return _by_track(of, spread_rate, error, steady=False)


def steady(of: Sequence[Steps], spread_rate: float, error: float) -> Array:
    """Return the restricted log likelihood by track, with a mean velocity in each stretch.

    Arguments and shape are as in `wandering`.
    """
    return _by_track(of, spread_rate, error, steady=True)


def _by_track(of: Sequence[Steps], spread_rate: float, error: float, *, steady: bool) -> Array:
    """Return the log likelihood by track, shape (tracks,)."""
    total = np.zeros(max((one.name for one in of), default=-1) + 1)
    for one in of:
        total[one.name] += _of_one(one, spread_rate, error, steady=steady)
    return total


def _of_one(one: Steps, spread_rate: float, error: float, *, steady: bool) -> float:
    """Return the log likelihood of one stretch, both components."""
    size = one.time.size
    band = np.zeros((2, size))  # lower form: the main diagonal, and that below it
    band[0] = spread_rate**2 * one.time + 2 * error**2
    band[1, :-1] = -(error**2)
    factor = linalg.cholesky_banded(band, lower=True, check_finite=False)
    solved = linalg.cho_solve_banded(
        (factor, True), np.column_stack([one.moved, one.time]), check_finite=False
    )
    square = (one.moved * solved[:, :2]).sum()
    log_determinant = 2 * np.log(factor[0]).sum()
    total = -0.5 * square - log_determinant - size * np.log(2 * np.pi)
    if steady:
        information = one.time @ solved[:, 2]
        total += (
            0.5 * ((one.time @ solved[:, :2]) ** 2).sum() / information
            - np.log(information)
            + np.log(2 * np.pi)
        )
    return float(total)
