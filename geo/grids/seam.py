"""Curvilinear grids that span the globe: repeated columns and rows, the seam, the tripolar fold.

Models store halos: the first columns again after the last ones, and beyond the fold of a tripolar
grid (a line between its two northern poles, on land) rows that repeat others in reverse. Both are
removed, and the grid is connected to itself by `Curved.joined` and `Curved.mirror`, so it does not
matter whether a file's halos hold values.
"""

from dataclasses import replace

import numpy as np

from geo.array import Array
from geo.grids.layout import Curved, Index

HALO = 6  # largest number of columns or rows that a file repeats
SAME = 0.02  # share of the step between points: closer points count as the same point
NEXT = 1.5  # [steps] largest distance at which the last column is a neighbour of the first
FEWEST = 16  # least number of columns of a grid that spans the globe


def close_seam(curved: Curved, notes: list[str]) -> Curved:
    """Return a grid without repeated columns and rows, connected at its seam and its fold."""
    ny, nx = curved.lon.shape
    repeated = follower(curved)
    if repeated is None:
        return curved
    first = repeated // 2  # halo columns on both sides; the inner columns are the model's own
    columns = np.arange(first, nx - (repeated - first))
    curved = _subset(curved, np.arange(ny), columns)
    curved = replace(curved, joined=np.ones(len(columns), bool))
    notes.append(
        "the grid goes round the Earth"
        + (f": {repeated} repeated columns left out" if repeated else "")
    )
    return _close_fold(curved, notes)


def follower(curved: Curved) -> int | None:
    """Return the column after the last one of a grid that spans the globe; None for others."""
    if min(curved.lon.shape) < 2 or curved.lon.shape[1] < FEWEST:
        return None
    repeated = next((k for k in range(HALO, 0, -1) if _columns_repeat(curved, k)), 0)
    return repeated if repeated or _ends_touch(curved) else None


def _subset(curved: Curved, rows: Index, columns: Index) -> Curved:
    lon, lat = curved.lon[np.ix_(rows, columns)], curved.lat[np.ix_(rows, columns)]
    angle = None if curved.angle is None else curved.angle[np.ix_(rows, columns)]
    return replace(
        curved,
        lon=lon,
        lat=lat,
        angle=angle,
        columns=curved.columns[columns],
        rows=curved.rows[rows],
    )


def _chord(lon1: Array, lat1: Array, lon2: Array, lat2: Array) -> Array:
    """Return the chord between points [deg] in units of the Earth's radius."""
    phi1, phi2 = np.radians(lat1), np.radians(lat2)
    across = np.sin(np.radians(lon2 - lon1) / 2) ** 2 * np.cos(phi1) * np.cos(phi2)
    return np.asarray(2 * np.sqrt(np.sin((phi2 - phi1) / 2) ** 2 + across))


def _mostly(near: Array, limit: Array) -> bool:
    """Return True if at least nine tenths of the present distances are within their limits."""
    present = np.isfinite(near) & np.isfinite(limit)
    return bool(present.sum() >= 2 and np.mean(near[present] <= limit[present]) >= 0.9)


def _columns_repeat(curved: Curved, k: int) -> bool:
    """Return True if the last k columns coincide with the first k ones."""
    lon, lat = curved.lon, curved.lat
    step = _chord(lon[:, :k], lat[:, :k], lon[:, 1 : k + 1], lat[:, 1 : k + 1])
    return _mostly(_chord(lon[:, :k], lat[:, :k], lon[:, -k:], lat[:, -k:]), SAME * step)


def _ends_touch(curved: Curved) -> bool:
    """Return True if the last column lies one step before the first."""
    lon, lat = curved.lon, curved.lat
    steps = [_chord(lon[:, k], lat[:, k], lon[:, k + 1], lat[:, k + 1]) for k in (0, -2)]
    return _mostly(_chord(lon[:, -1], lat[:, -1], lon[:, 0], lat[:, 0]), NEXT * np.maximum(*steps))


def _close_fold(curved: Curved, notes: list[str]) -> Curved:
    """Return a grid around the globe, connected across its fold if it has one.

    Its last row then lies at the fold.
    """
    ny, nx = curved.lon.shape
    if np.nanmean(np.abs(curved.lat[0])) > np.nanmean(
        np.abs(curved.lat[-1])
    ):  # reverse the rows, so that a fold, near a pole, is at the last row
        curved = _subset(curved, np.arange(ny)[::-1], np.arange(nx))
    facing, dropped = _facing_columns(curved), 0
    if facing is None:
        return curved
    while curved.lon.shape[0] > HALO and any(
        _row_repeats(curved, back, facing) for back in range(2, HALO + 1)
    ):
        curved, dropped = (
            _subset(curved, np.arange(curved.lon.shape[0] - 1), np.arange(nx)),
            dropped + 1,
        )
    lon, lat = curved.lon, curved.lat
    row = _chord(lon[-1], lat[-1], lon[-2], lat[-2])
    if not _mostly(_chord(lon[-1], lat[-1], lon[-1, facing], lat[-1, facing]), 2 * row):
        return curved
    rows = f": {dropped} repeated rows left out" if dropped else ""
    notes.append(f"tripolar: the last row faces itself across the fold{rows}")
    return replace(curved, mirror=facing)


def _facing_columns(curved: Curved) -> Index | None:
    """Return the columns that the last row's points face across a fold, (nx,); None for no fold.

    They run backward: column i faces column s - i for one s. For sample points, the nearest point
    of the row that is no neighbour along the row gives s; the most frequent value is taken.
    """
    lon, lat = curved.lon[-1], curved.lat[-1]
    n, column = len(lon), np.arange(len(lon))
    sums = []
    for i in np.linspace(0, n, 32, endpoint=False).astype(int):
        distance = _chord(lon[i], lat[i], lon, lat)
        distance[np.minimum((column - i) % n, (i - column) % n) < n // 16] = np.nan
        if np.isfinite(distance).any():
            sums.append((i + int(np.nanargmin(distance))) % n)
    if not sums:
        return None
    values, counts = np.unique(sums, return_counts=True)
    return (
        np.asarray((values[np.argmax(counts)] - column) % n, np.int64)
        if counts.max() > len(sums) / 2
        else None
    )


def _row_repeats(curved: Curved, back: int, facing: Index) -> bool:
    """Return True if the last row coincides with a row in reverse.

    back: number of that row from the end, 1 is the last row itself.
    """
    lon, lat = curved.lon, curved.lat
    step = _chord(lon[-1], lat[-1], np.roll(lon[-1], 1), np.roll(lat[-1], 1))
    return _mostly(_chord(lon[-1], lat[-1], lon[-back, facing], lat[-back, facing]), SAME * step)
