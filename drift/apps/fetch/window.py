"""The part of a grid that a box needs: rows and columns, also across the seam of longitudes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geo.box import Box

Real = NDArray[np.float64]
MARGIN = 1.5  # cells around a box, so that its edge is between nodes


@dataclass(frozen=True)
class Window:
    """Rows and runs of columns of a grid, in the order in which they are joined.

    turns: by run, whole turns [deg] to add to its longitudes, so that they continue without a jump.
    whole: whether the grid covers the whole box.
    """

    rows: tuple[int, int]
    runs: tuple[tuple[int, int], ...]
    turns: tuple[float, ...]
    whole: bool

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.rows[1] - self.rows[0], sum(stop - start for start, stop in self.runs)


def along_axes(lon: Real, lat: Real, box: Box) -> Window | None:
    """Return the window of a box on axes [deg], shapes (nlon,) and (nlat,).

    Axes may ascend or descend. The result is None if the box is outside the grid.
    """
    dlon, dlat = _spacing(lon), _spacing(lat)
    grown = box.grown(MARGIN * dlon, MARGIN * dlat)
    rows = np.flatnonzero((lat >= grown.south) & (lat <= grown.north))
    width = grown.east - grown.west
    if not rows.size:
        return None
    covers_latitudes = lat[rows].min() <= max(box.south, -90 + dlat) and lat[rows].max() >= min(
        box.north, 90 - dlat
    )
    span = int(rows[0]), int(rows[-1]) + 1
    if width >= 360:
        return Window(
            span,
            ((0, lon.size),),
            (0.0,),
            bool(covers_latitudes and np.ptp(lon) + 1.5 * dlon >= 360),
        )
    x = grown.west + (lon - grown.west) % 360  # in [west, west + 360)
    columns = np.flatnonzero(x <= grown.east)
    if not columns.size:
        return None
    columns = columns[np.argsort(x[columns], kind="stable")]
    # a closed axis has one meridian twice
    columns = columns[np.diff(x[columns], prepend=-np.inf) > 1e-3 * dlon]
    if lon[-1] < lon[0]:
        columns = columns[::-1]
    pieces = np.split(columns, np.flatnonzero(np.diff(columns) != 1) + 1)
    turns = [360 * float(np.round((x[piece[0]] - lon[piece[0]]) / 360)) for piece in pieces]
    west = grown.west + (box.west - grown.west) % 360
    covers_longitudes = x[columns].min() <= west and x[columns].max() >= west + box.east - box.west
    return Window(
        span,
        tuple((int(piece[0]), int(piece[-1]) + 1) for piece in pieces),
        # the first run keeps its longitudes, the others continue from there
        tuple(turn - turns[0] for turn in turns),
        bool(covers_latitudes and covers_longitudes),
    )


def _spacing(axis: Real) -> float:
    return float(np.median(np.abs(np.diff(axis)))) if axis.size > 1 else 0.0


def on_surface(lon: Real, lat: Real, box: Box) -> Window | None:
    """Return the window of a box on a curvilinear grid [deg], shapes (nrow, ncolumn).

    None if no node is in the box.
    """
    inside = (
        ((lon - box.west) % 360 <= box.east - box.west) & (lat >= box.south) & (lat <= box.north)
    )
    rows, columns = (np.flatnonzero(inside.any(axis=axis)) for axis in (1, 0))
    if not rows.size:
        return None
    spans = [
        (max(int(k[0]) - 2, 0), min(int(k[-1]) + 3, n))
        for k, n in zip((rows, columns), lon.shape, strict=True)
    ]
    edge = any(k[0] == 0 or k[-1] == n - 1 for k, n in zip((rows, columns), lon.shape, strict=True))
    return Window(spans[0], (spans[1],), (0.0,), not edge)
