"""Containment areas on the coast: cells that hold stranded particles, drawn as lines along the
shore.

Stranded particles occupy a strip a cell or two wide, whose outline would disappear under the
shoreline of a chart. Areas are nested; each cell belongs to the smallest that contains it.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from scipy import ndimage

from geo import notation, sphere
from geo.array import Array
from geo.notation import NMI

ASHORE = 0.5  # share of a cell's probability that is ashore in a cell of the coast
LEAST = 0.01  # probability ashore below which its position is not reported
NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))  # rows and columns to half of the eight round a cell


def coast_lines_by_share(at: Any, shares: Sequence[float]) -> dict[float, shapely.MultiLineString]:
    """Return, by share, the coast inside its area and outside all smaller ones, as lines from cell
    to cell.

    The lines are in degrees, unwrapped. at: a forecast's data (drift.forecast.products.dataset) at
    one time. shares: ascending; those without coast are left out.
    """
    which = _smallest_areas(at, shares)
    lon, lat = at["lon"].values, at["lat"].values
    return {share: _lines(which, shares.index(share), lon, lat) for share in _found(which, shares)}


def shares_on_coast(at: Any, shares: Sequence[float]) -> list[float]:
    """Return the shares of `coast_lines_by_share`."""
    return _found(_smallest_areas(at, shares), shares)


def _smallest_areas(at: Any, shares: Sequence[float]) -> Array:
    """Return for each cell of the coast the index of the smallest area that contains it, and
    len(shares) for all others, (nlat, nlon).
    """
    held = np.nan_to_num(at["containment"].values, nan=np.inf)
    return np.where(_on_coast(at), np.searchsorted(shares, held), len(shares))


def _found(which: Array, shares: Sequence[float]) -> list[float]:
    return [shares[k] for k in np.unique(which[which < len(shares)])]


def coast_length(at: Any, share: float) -> float:
    """Return about how much coast [m] lies inside the area of a share.

    Steps of the lines from cell to cell are smoothed over a cell, so that a slanting coast is not
    longer than a straight one.
    """
    lines = coast_lines_by_share(at, [share]).get(share)
    if lines is None:
        return 0.0
    cell = max(float(np.abs(np.diff(at[name].values[:2])).item()) for name in ("lon", "lat"))
    smooth = shapely.simplify(shapely.line_merge(lines), cell)
    points, part = shapely.get_coordinates(shapely.get_parts(smooth), return_index=True)
    x, y = np.radians(points).T
    steps = sphere.distance(x[:-1], y[:-1], x[1:], y[1:])
    return math.fsum(steps[part[:-1] == part[1:]])


def mostly_on_coast(at: Any, share: float) -> bool:
    """Return whether most of the probability inside the area of a share is in cells of the coast."""
    inside = np.nan_to_num(at["containment"].values, nan=np.inf) <= share
    held = np.where(inside, at["probability"].values, 0.0)
    return bool(held[_on_coast(at)].sum() > 0.5 * held.sum())


def _on_coast(at: Any) -> Array:
    """Return which cells hold more probability ashore than adrift, bool (nlat, nlon)."""
    ashore = at["probability_ashore"].values
    return np.asarray((ashore > 0) & (ashore > ASHORE * at["probability"].values))


def _lines(which: Array, k: int, lon: Array, lat: Array) -> shapely.MultiLineString:
    """Return lines from each cell of number k to its neighbours of the same or a smaller number.

    Diagonals are used only round corners. A cell without neighbours becomes a line of half its
    width. which: (nlat, nlon); lon, lat: cell centres [deg].
    """
    there, own = np.pad(which <= k, 1), np.pad(which == k, 1)

    def beside(mask: Array, down: int, right: int) -> Array:
        return np.roll(mask, (-down, -right), axis=(0, 1))

    ends: list[Array] = []
    for down, right in NEIGHBOURS:
        joined = there & beside(there, down, right) & (own | beside(own, down, right))
        if down and right:
            joined &= ~(beside(there, down, 0) | beside(there, 0, right))
        begin = np.argwhere(joined)
        ends.append(np.stack([begin, begin + np.array([down, right])], axis=1))
    alone = np.argwhere(own & (ndimage.convolve(there.astype(int), np.ones((3, 3), int)) == 1))
    quarter = np.array([0.0, 0.25])
    ends.append(np.stack([alone - quarter, alone + quarter], axis=1))
    rows, columns = (np.concatenate(ends) - 1).transpose(2, 0, 1)
    # cells are even
    step = [float(axis[1] - axis[0]) if len(axis) > 1 else 0.01 for axis in (lon, lat)]
    x, y = lon[0] + step[0] * columns, lat[0] + step[1] * rows
    merged = shapely.line_merge(shapely.multilinestrings(np.stack([x, y], axis=-1)))
    parts = shapely.get_parts(shapely.simplify(merged, min(step) / 20))
    return shapely.multilinestrings(parts)


def coast_in_words(at: Any) -> str:
    """Return a short text on where the densest half of the probability ashore lies; "" if little is
    ashore.
    """
    ashore = at["probability_ashore"].values.astype(np.float64)
    if ashore.sum() < LEAST:
        return ""
    order = np.argsort(-(ashore / at["cell_area"].values).ravel(), kind="stable")
    inside = np.cumsum(ashore.ravel()[order])
    row, column = np.divmod(
        order[: int(np.searchsorted(inside, inside[-1] / 2)) + 1], ashore.shape[1]
    )
    places = np.column_stack([at["lon"].values[column], at["lat"].values[row]])
    places = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(places)))
    one, other = (np.radians(places[k]).T for k in np.indices((len(places), len(places))))
    apart = sphere.distance(*one, *other)
    ends = [places[k] for k in np.unravel_index(int(np.argmax(apart)), apart.shape)]
    named = [notation.position(*end) for end in sorted(ends, key=lambda end: (-end[1], end[0]))]
    reach = float(apart.max()) / NMI
    if reach < 1:
        return f"half of it at {named[0]}"
    return f"half of it within {reach:.0f} nmi, from {named[0]} to {named[1]}"
