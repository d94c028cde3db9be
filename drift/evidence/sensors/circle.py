"""Bearings of a table: their order on the circle, duplicates, and gaps."""

import numpy as np
from numpy.typing import ArrayLike

from geo.array import Array
from geo.errors import UserError

WIDEST = 60.0  # [deg] widest gap between neighbours, unless a table says otherwise
UNEVEN = 2.0  # times the median gap: in a wider one a bearing is missing
SAME = 1e-3  # [deg] largest difference of equal bearings: 0 and 360 in single precision


def close_circle(
    bearing: ArrayLike,
    values: Array,
    axis: int,
    name: str,
    agree: float,
    unit: str,
    widest: float = WIDEST,
) -> tuple[Array, Array]:
    """Return bearings [rad], ascending in [0, 2 pi), and values in their order along an axis.

    A single bearing holds all round.

    Args:
        bearing: in any order, negative or beyond 360 [deg]. A duplicate, such as 0 and 360, is kept
            once; its values must agree.
        values: of the table.
        axis: of `values` along which the bearings lie.
        name: start of error messages.
        agree: largest difference between the values of a duplicate.
        unit: of the values, for messages.
        widest: largest gap between neighbours [deg].

    Raises:
        UserError: missing bearings, a gap, or a duplicate with different values.
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
    _check_gaps(turned, name, widest)
    return np.radians(turned), values


def _check_gaps(bearing: Array, name: str, widest: float = WIDEST) -> None:
    """Reject bearings that do not close the circle; a single one holds all round.

    Args:
        bearing: ascending in [0, 360) [deg].
        name: start of error messages.
        widest: largest gap between neighbours [deg].

    Raises:
        UserError: a wider gap, or one above twice the median gap.
    """
    if bearing.size == 1:
        return
    gaps = np.diff(np.concatenate((bearing, bearing[:1] + 360.0)))
    k, median = int(np.argmax(gaps)), float(np.median(gaps))
    if gaps[k] > min(widest, UNEVEN * median) + SAME:
        raise UserError(
            f"{name}: nothing between the bearings {bearing[k]:g} and {bearing[(k + 1) % bearing.size]:g} degrees: a gap of "
            f"{gaps[k]:g}; allowed are {widest:g} degrees and twice the median gap ({median:g}), all round: add the bearings "
            "between, or give a single bearing, which then applies all round"
        )
