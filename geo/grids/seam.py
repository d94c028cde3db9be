"""Curved grids that go round the Earth: repeated columns and rows, the seam, the fold of a tripolar
grid.

Models store halos: the first columns again after the last ones, and beyond the fold of a tripolar
grid (a line between its two northern poles, on land) rows that lie on others in reverse. Both are
left out, and the grid is joined with itself by `Curved.joined` and `Curved.mirror`, so that it does
not matter whether a file's halos hold values.
"""

from dataclasses import replace

import numpy as np

from geo.array import Array
from geo.grids.layout import Curved, Index

HALO = 6  # most columns or rows that a file stores twice
SAME = 0.02  # share of the step between points: points at most so far apart are the same point
NEXT = 1.5  # steps: the last column is a neighbour of the first up to this distance
FEWEST = 16  # fewest columns of a grid that goes round the Earth


def close(curved: Curved, notes: list[str]) -> Curved:
    """Return a grid without repeated columns and rows, joined with itself at its seam and its fold."""
    ny, nx = curved.lon.shape
    repeated = follower(curved)
    if repeated is None:
        return curved
    first = repeated // 2  # the inner ones are the model's own
    columns = np.arange(first, nx - (repeated - first))
    curved = _part(curved, np.arange(ny), columns)
    curved = replace(curved, joined=np.ones(len(columns), bool))
    notes.append(
        "the grid goes round the Earth"
        + (f": {repeated} repeated columns left out" if repeated else "")
    )
    return _folded(curved, notes)


def follower(curved: Curved) -> int | None:
    """Return which column follows the last one of a grid that goes round the Earth;

    None for other grids.
    """
    if min(curved.lon.shape) < 2 or curved.lon.shape[1] < FEWEST:
        return None
    repeated = next((k for k in range(HALO, 0, -1) if _repeats(curved, k)), 0)
    return repeated if repeated or _touches(curved) else None


def _part(curved: Curved, rows: Index, columns: Index) -> Curved:
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


def _apart(lon1: Array, lat1: Array, lon2: Array, lat2: Array) -> Array:
    """Return the length of the chord between points [deg] in radii of the Earth."""
    phi1, phi2 = np.radians(lat1), np.radians(lat2)
    across = np.sin(np.radians(lon2 - lon1) / 2) ** 2 * np.cos(phi1) * np.cos(phi2)
    return np.asarray(2 * np.sqrt(np.sin((phi2 - phi1) / 2) ** 2 + across))


def _mostly(near: Array, limit: Array) -> bool:
    """Whether at least nine tenths of the distances that are present are within their limits."""
    present = np.isfinite(near) & np.isfinite(limit)
    return bool(present.sum() >= 2 and np.mean(near[present] <= limit[present]) >= 0.9)


def _repeats(curved: Curved, k: int) -> bool:
    """Whether the last k columns lie on the first k ones."""
    lon, lat = curved.lon, curved.lat
    step = _apart(lon[:, :k], lat[:, :k], lon[:, 1 : k + 1], lat[:, 1 : k + 1])
    return _mostly(_apart(lon[:, :k], lat[:, :k], lon[:, -k:], lat[:, -k:]), SAME * step)


def _touches(curved: Curved) -> bool:
    """Whether the last column lies one step before the first."""
    lon, lat = curved.lon, curved.lat
    steps = [_apart(lon[:, k], lat[:, k], lon[:, k + 1], lat[:, k + 1]) for k in (0, -2)]
    return _mostly(_apart(lon[:, -1], lat[:, -1], lon[:, 0], lat[:, 0]), NEXT * np.maximum(*steps))


def _folded(curved: Curved, notes: list[str]) -> Curved:
    """Return a grid round the Earth, joined with itself across its fold where it has one.

    Its last row ends there.
    """
    ny, nx = curved.lon.shape
    if np.nanmean(np.abs(curved.lat[0])) > np.nanmean(
        np.abs(curved.lat[-1])
    ):  # so that the fold, near a pole, is at the last row
        curved = _part(curved, np.arange(ny)[::-1], np.arange(nx))
    facing, dropped = _facing(curved), 0
    if facing is None:
        return curved
    while curved.lon.shape[0] > HALO and any(
        _lies_on(curved, back, facing) for back in range(2, HALO + 1)
    ):
        curved, dropped = (
            _part(curved, np.arange(curved.lon.shape[0] - 1), np.arange(nx)),
            dropped + 1,
        )
    lon, lat = curved.lon, curved.lat
    row = _apart(lon[-1], lat[-1], lon[-2], lat[-2])
    if not _mostly(_apart(lon[-1], lat[-1], lon[-1, facing], lat[-1, facing]), 2 * row):
        return curved
    rows = f": {dropped} repeated rows left out" if dropped else ""
    notes.append(f"tripolar: the last row faces itself across the fold{rows}")
    return replace(curved, mirror=facing)


def _facing(curved: Curved) -> Index | None:
    """Return the columns that the last row's points face across a fold, (nx,); None where there is
    none.

    They run backwards, so that column i faces column s - i for one s. Each point's nearest one of
    the same row that is no neighbour along the row gives an s; the most frequent counts.
    """
    lon, lat = curved.lon[-1], curved.lat[-1]
    n, column = len(lon), np.arange(len(lon))
    sums = []
    for i in np.linspace(0, n, 32, endpoint=False).astype(int):
        distance = _apart(lon[i], lat[i], lon, lat)
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


def _lies_on(curved: Curved, back: int, facing: Index) -> bool:
    """Whether the last row lies on the row `back` rows from the end (1 is the last itself), in
    reverse.
    """
    lon, lat = curved.lon, curved.lat
    step = _apart(lon[-1], lat[-1], np.roll(lon[-1], 1), np.roll(lat[-1], 1))
    return _mostly(_apart(lon[-1], lat[-1], lon[-back, facing], lat[-back, facing]), SAME * step)
