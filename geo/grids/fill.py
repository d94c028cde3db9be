"""Missing values next to the coast, filled from their wet neighbours for sampling only.

Rings smooth the outermost few cells; farther in, bays and channels narrower than the grid take the nearest wet node's
value, up to a stated distance: one look-up however far, where each ring costs a pass over the grid.
"""

import functools

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from geo import sphere
from geo.grids.grid import Grid

# [deg] Of latitude, within which a degree of longitude counts as one length: 4 % off at its edges at 60 degrees.
BAND = 5.0
# [m] From its nearest wet node, as far as a bay or channel that the source does not resolve still gets a value.
REACH = 30_000.0
MASKS = 16  # kept plans: a source's mask is the same for all its slices, unless it dries and floods

Mask = NDArray[np.bool_]
Bands = tuple[tuple[int, int, tuple[float, float]], ...]  # (first row, row after the last, spacing of rows and columns)


def fill(
    values: NDArray[np.float32],
    cells: int,
    seamless: bool = False,
    *,
    reach: float = 0.0,
    bands: Bands | None = None,
    within: Mask | None = None,
) -> NDArray[np.float32]:
    """Return values (nlat, nlon, k) with missing nodes up to `cells` deep filled, ring by ring, then up to `reach`.

    A ring's node is the mean of those of its eight neighbours that are valid or were filled before; what was
    valid keeps every bit. seamless: the last column is the first one, so that rings go on across the seam.
    reach: a node no farther than this from a wet one, and in no ring, takes the nearest wet node's value; in the
    unit of the bands' spacing: [m] with those of `bands`, else cells. within: (nlat, nlon)
    nodes that may be filled so, such as those inside a model's own domain: beyond it water is not land, but unknown.
    """
    result = np.array(values, np.float32, order="C")
    wet = np.asarray(np.isfinite(result).all(axis=2)) if reach > 0 else None
    _rings(result, cells, seamless)
    if wet is not None and wet.any() and not wet.all():
        allowed = None if within is None else np.packbits(within).tobytes()
        whole = bands or ((0, wet.shape[0], (1.0, 1.0)),)
        node, source = _nearest(np.packbits(wet).tobytes(), wet.shape, seamless, float(reach), whole, allowed)
        flat = result.reshape(-1, result.shape[2])
        missing = ~np.isfinite(flat[node]).all(axis=1)
        flat[node[missing]] = flat[source[missing]]
    return result


def bands(grid: Grid) -> Bands:
    """Return a grid's rows in bands of latitude, with the distances [m] from row to row and from column to column there.

    Bands are the same wherever a grid begins: what a node is filled with does not depend on the part that a case needs.
    """
    metres = np.deg2rad(1.0) * sphere.RADIUS
    number = np.floor(grid.lat / BAND).astype(int)
    result = []
    for band in np.unique(number):
        rows = np.flatnonzero(number == band)
        middle = np.deg2rad((band + 0.5) * BAND)
        column = float(grid.dlon * metres * max(np.cos(middle), 0.01))
        result.append((int(rows[0]), int(rows[-1]) + 1, (float(grid.dlat * metres), column)))
    return tuple(result)


def _rings(result: NDArray[np.float32], cells: int, seamless: bool) -> None:
    """Fill `cells` rings in place."""
    body = result[:, :-1] if seamless else result
    ny, nx = body.shape[:2]
    for _ in range(cells):
        wet = np.asarray(np.isfinite(body).all(axis=2))
        if wet.all() or not wet.any():
            break
        # one frame of land round everything, or the far side of the seam
        padded = np.zeros((ny + 2, nx + 2, body.shape[2]), np.float32)
        count = np.zeros((ny + 2, nx + 2), np.float32)
        padded[1:-1, 1:-1], count[1:-1, 1:-1] = np.where(wet[..., None], body, 0), wet
        if seamless:
            for frame in (padded, count):
                frame[:, 0], frame[:, -1] = frame[:, -2], frame[:, 1]
        total, neighbours = np.zeros_like(body), np.zeros((ny, nx), np.float32)
        for j in range(3):
            for i in range(3):
                total += padded[j : j + ny, i : i + nx]
                neighbours += count[j : j + ny, i : i + nx]
        ring = ~wet & (neighbours > 0)
        body[ring] = total[ring] / neighbours[ring][:, None]
    if seamless:
        result[:, -1] = result[:, 0]


@functools.lru_cache(MASKS)
def _nearest(
    bits: bytes, shape: tuple[int, int], seamless: bool, reach: float, bands: Bands, allowed: bytes | None
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return (node, source): the flat indices of missing nodes within reach, and of the wet node nearest to each."""
    wet = _mask(bits, shape)
    may = np.ones(shape, bool) if allowed is None else _mask(allowed, shape)
    nodes, sources = [], []
    for first, last, spacing in bands:
        aside = int(min(shape[0], np.ceil(reach / spacing[0])))  # rows of other bands that can be nearest
        low, high = max(first - aside, 0), min(last + aside, shape[0])
        away, row, column = _distances(wet[low:high], seamless, reach, spacing)
        own = slice(first - low, last - low)
        chosen = (away[own] > 0) & (away[own] <= reach) & may[first:last]
        nodes.append(np.flatnonzero(chosen) + first * shape[1])
        sources.append(((row[own] + low) * shape[1] + column[own])[chosen])
    return np.concatenate(nodes).astype(np.int32), np.concatenate(sources).astype(np.int32)


def _distances(
    wet: Mask, seamless: bool, reach: float, spacing: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int64]]:
    """Return how far each node is from the nearest wet one, and that one's row and column; inf where there is none."""
    if not wet.any():
        return np.full(wet.shape, np.inf), np.zeros(wet.shape, np.int32), np.zeros(wet.shape, np.int64)
    own = wet.shape[1] - seamless
    turns = np.arange(wet.shape[1])
    aside = 0
    if seamless:  # on both sides as much of the other end as can be reached
        aside = int(min(own // 2, np.ceil(reach / spacing[1])))
        turns = np.arange(-aside, own + 1 + aside) % own
    away, (row, column) = ndimage.distance_transform_edt(~wet[:, turns], spacing, return_indices=True)
    middle = slice(aside, aside + own + 1) if seamless else slice(None)
    return away[:, middle], row[:, middle], turns[column[:, middle]]


def _mask(bits: bytes, shape: tuple[int, int]) -> Mask:
    return np.unpackbits(np.frombuffer(bits, np.uint8), count=shape[0] * shape[1]).view(bool).reshape(shape)
