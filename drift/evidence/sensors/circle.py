"""Bearings all round: their order on the circle, bearings that stand twice, and gaps that no table
may have.
"""

import numpy as np
from numpy.typing import ArrayLike

from geo.array import Array
from geo.errors import UserError

WIDEST = 60.0  # [deg] widest gap between neighbours, unless a table says otherwise
UNEVEN = 2.0  # times the median gap: a wider one is a bearing that was forgotten
SAME = 1e-3  # [deg] bearings so close are the same: 0 and 360 in single precision


def around(
    bearing: ArrayLike,
    values: Array,
    axis: int,
    name: str,
    agree: float,
    unit: str,
    widest: float = WIDEST,
) -> tuple[Array, Array]:
    """Return bearings [rad], ascending in [0, 2 pi), and values in their order along an axis.

    bearing: [deg] in any order, negative or beyond 360. A bearing that stands twice, as 0 and 360
    do, must have values that are the same to within `agree` (in `unit`), and is kept once. One
    bearing alone means the same all round. widest: gap [deg] between neighbours that is allowed.
    Raises UserError where the bearings leave a gap, starting with `name`.
    """
    degrees = np.asarray(bearing, np.float64)
    if not np.isfinite(degrees).all():
        raise UserError(
            f"{name}: {np.sum(~np.isfinite(degrees))} of {degrees.size} bearings are missing; mend the table"
        )
    if np.abs(degrees).max(initial=0.0) > 720.0:
        largest = degrees[np.argmax(np.abs(degrees))]
        raise UserError(
            f"{name}: bearing {largest:g} degrees; allowed are -720 to 720: mend the table, or its units"
        )
    turned = np.mod(degrees, 360.0)
    turned = np.where(turned > 360.0 - SAME, 0.0, turned)
    order = np.argsort(turned, kind="stable")
    turned, values = turned[order], np.take(values, order, axis)
    first = np.concatenate(([True], np.diff(turned) > SAME))
    group = np.maximum.accumulate(np.where(first, np.arange(turned.size), 0))
    apart = np.abs(values - np.take(values, group, axis))
    worst = apart.max(
        axis=tuple(k for k in range(values.ndim) if k != axis % values.ndim), initial=0.0
    )
    if worst.max(initial=0.0) > agree:
        k = int(np.argmax(worst))
        raise UserError(
            f"{name}: bearing {turned[k]:g} degrees stands twice (as {degrees[order[group[k]]]:g} and "
            f"{degrees[order[k]]:g}), with values {worst[k]:.3g} {unit} apart; they must agree: mend the table"
        )
    turned, values = turned[first], np.compress(first, values, axis)
    check_gaps(turned, name, widest)
    return np.radians(turned), values


def check_gaps(bearing: Array, name: str, widest: float = WIDEST) -> None:
    """Refuse bearings [deg], ascending in [0, 360), that do not close the circle; one alone means
    all round.
    """
    if bearing.size == 1:
        return
    gaps = np.diff(np.concatenate((bearing, bearing[:1] + 360.0)))
    k, median = int(np.argmax(gaps)), float(np.median(gaps))
    if gaps[k] > min(widest, UNEVEN * median) + SAME:
        raise UserError(
            f"{name}: nothing between the bearings {bearing[k]:g} and {bearing[(k + 1) % bearing.size]:g} degrees: a gap of "
            f"{gaps[k]:g}; allowed are {widest:g} degrees and twice the median gap ({median:g}), all round: add the bearings "
            "between, or give one alone that holds all round"
        )
