"""Fill missing values near the coast from wet neighbours, only for sampling.

The few cells next to wet ones are filled ring by ring, which smooths them. Farther in, bays and
channels narrower than the grid take the value of the nearest wet node, up to a given distance. This
costs one look-up whatever the distance, while each ring costs a pass over the grid.
"""

import functools

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from geo import sphere
from geo.grids.grid import Grid

# [deg of latitude] height of bands in which a degree of longitude has one length, 4 % off at their
# edges at 60 deg
BAND = 5.0
# [m] bays and channels that the source does not resolve get the value of a wet node up to this far
REACH = 30_000.0
# number of masks whose fillings are kept; a source has one mask, unless it dries and floods
MASKS = 16

Mask = NDArray[np.bool_]
# (first row, row after the last, spacing of rows and columns)
Bands = tuple[tuple[int, int, tuple[float, float]], ...]


def fill(
    values: NDArray[np.float32],
    cells: int,
    seamless: bool = False,
    *,
    reach: float = 0.0,
    bands: Bands | None = None,
    within: Mask | None = None,
) -> NDArray[np.float32]:
    """Return values with missing nodes filled: `cells` rings, then everything up to `reach`.

    A node in a ring is the mean of those of its eight neighbours that are valid or already filled.
    Valid values are not changed.

    Args:
        values: shape (nlat, nlon, k), NaN for missing.
        cells: number of rings.
        seamless: the last column repeats the first, so rings cross the seam.
        reach: a node in no ring takes the value of the nearest wet node up to this distance: [m]
            with `bands`, otherwise [cells].
        bands: spacing of rows and columns, from `bands`.
        within: (nlat, nlon) nodes that `reach` may fill, for instance those inside a model's own
            domain. Outside it a missing value means unknown water, not land.
    """
    result = np.array(values, np.float32, order="C")
    if not seamless and np.isfinite(result).all():
        return result
    wet = _present(result) if reach > 0 else None
    _fill_rings(result, cells, seamless)
    if wet is not None and wet.any() and not wet.all():
        allowed = None if within is None else np.packbits(within).tobytes()
        all_bands = bands or ((0, wet.shape[0], (1.0, 1.0)),)
        node, source = _nearest_wet(
            np.packbits(wet).tobytes(), wet.shape, seamless, float(reach), all_bands, allowed
        )
        flat = result.reshape(-1, result.shape[2])
        missing = ~np.isfinite(flat[node]).all(axis=1)
        flat[node[missing]] = flat[source[missing]]
    return result


def bands(grid: Grid) -> Bands:
    """Return a grid's rows in bands of latitude, with the spacing [m] of rows and columns there.

    Bands do not depend on where the grid begins, so a node's filled value does not depend on which
    part of the source a case needs.
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


def _fill_rings(result: NDArray[np.float32], cells: int, seamless: bool) -> None:
    """Fill `cells` rings in place."""
    body = result[:, :-1] if seamless else result
    ny, nx = body.shape[:2]
    for _ in range(cells):
        wet = _present(body)
        if wet.all() or not wet.any():
            break
        # one cell of padding on all sides: land, or the values across the seam
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


def _present(values: NDArray[np.float32]) -> Mask:
    """Return the nodes (nlat, nlon) where none of the k values is missing.

    `all(axis=2)` of few values takes five times as long.
    """
    return functools.reduce(
        np.logical_and, (np.isfinite(values[..., k]) for k in range(values.shape[2]))
    )


@functools.lru_cache(MASKS)
def _nearest_wet(
    bits: bytes,
    shape: tuple[int, int],
    seamless: bool,
    reach: float,
    bands: Bands,
    allowed: bytes | None,
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return flat indices (node, source): missing nodes within reach, and nearest wet nodes."""
    wet = _unpack_mask(bits, shape)
    fillable = np.ones(shape, bool) if allowed is None else _unpack_mask(allowed, shape)
    nodes, sources = [], []
    for first, last, spacing in bands:
        # rows of neighbouring bands may hold the nearest node
        margin = int(min(shape[0], np.ceil(reach / spacing[0])))
        low, high = max(first - margin, 0), min(last + margin, shape[0])
        distance, row, column = _distances_to_wet(wet[low:high], seamless, reach, spacing)
        own = slice(first - low, last - low)
        chosen = (distance[own] > 0) & (distance[own] <= reach) & fillable[first:last]
        nodes.append(np.flatnonzero(chosen) + first * shape[1])
        sources.append(((row[own] + low) * shape[1] + column[own])[chosen])
    return np.concatenate(nodes).astype(np.int32), np.concatenate(sources).astype(np.int32)


def _distances_to_wet(
    wet: Mask, seamless: bool, reach: float, spacing: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int64]]:
    """Return each node's distance from the nearest wet node, and that node's row and column.

    The distance is inf if there is no wet node.
    """
    if not wet.any():
        return (
            np.full(wet.shape, np.inf),
            np.zeros(wet.shape, np.int32),
            np.zeros(wet.shape, np.int64),
        )
    own = wet.shape[1] - seamless
    turns = np.arange(wet.shape[1])
    margin = 0
    if seamless:  # pad each side with the columns of the other end that are within reach
        margin = int(min(own // 2, np.ceil(reach / spacing[1])))
        turns = np.arange(-margin, own + 1 + margin) % own
    distance, (row, column) = ndimage.distance_transform_edt(
        ~wet[:, turns], spacing, return_indices=True
    )
    middle = slice(margin, margin + own + 1) if seamless else slice(None)
    return distance[:, middle], row[:, middle], turns[column[:, middle]]


def _unpack_mask(bits: bytes, shape: tuple[int, int]) -> Mask:
    """Return a mask from its packed bits, which are bytes to serve as a key of a cache."""
    return (
        np.unpackbits(np.frombuffer(bits, np.uint8), count=shape[0] * shape[1])
        .view(bool)
        .reshape(shape)
    )
