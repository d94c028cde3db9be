"""Missing values next to the coast, filled from their wet neighbours for sampling only.

Rings smooth the outermost few cells; farther in, bays and channels narrower than the grid take the nearest wet node's
value, up to a stated distance: one look-up however far, where each ring costs a pass over the grid.
"""

import functools

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from geo import sphere
from geo.grid import Grid

MASKS = 16  # kept plans: a source's mask is the same for all its slices, unless it dries and floods

Mask = NDArray[np.bool_]


def fill(
    values: NDArray[np.float32],
    cells: int,
    seamless: bool = False,
    *,
    reach: float = 0.0,
    spacing: tuple[float, float] = (1.0, 1.0),
    within: Mask | None = None,
) -> NDArray[np.float32]:
    """Return values (nlat, nlon, k) with missing nodes up to `cells` deep filled, ring by ring, then up to `reach`.

    A ring's node is the mean of those of its eight neighbours that are valid or were filled before; what was
    valid keeps every bit. seamless: the last column is the first one, so that rings go on across the seam.
    reach: a node no farther than this from a wet one, and in no ring, takes the nearest wet node's value; in the
    unit of spacing (from row to row, from column to column): cells, or [m] with that of `spacing`. within: (nlat, nlon)
    nodes that may be filled so, such as those inside a model's own domain: beyond it water is not land, but unknown.
    """
    result = np.array(values, np.float32, order="C")
    wet = np.asarray(np.isfinite(result).all(axis=2)) if reach > 0 else None
    _rings(result, cells, seamless)
    if wet is not None and wet.any() and not wet.all():
        allowed = None if within is None else np.packbits(within).tobytes()
        node, source = _nearest(np.packbits(wet).tobytes(), wet.shape, seamless, float(reach), spacing, allowed)
        flat = result.reshape(-1, result.shape[2])
        missing = ~np.isfinite(flat[node]).all(axis=1)
        flat[node[missing]] = flat[source[missing]]
    return result


def spacing(grid: Grid) -> tuple[float, float]:
    """Return the distances (from row to row, from column to column) [m] of a grid at its middle latitude.

    East to west this is wrong by the spread of cos(lat) over the grid: 13 % for 55 to 65 degrees.
    """
    metres = np.deg2rad(1.0) * sphere.RADIUS
    middle = np.deg2rad(grid.lat0 + grid.dlat * (grid.nlat - 1) / 2)
    return float(grid.dlat * metres), float(grid.dlon * metres * max(np.cos(middle), 0.01))


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
    bits: bytes,
    shape: tuple[int, int],
    seamless: bool,
    reach: float,
    spacing: tuple[float, float],
    allowed: bytes | None,
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return (node, source): the flat indices of missing nodes within reach, and of the wet node nearest to each."""
    wet = _mask(bits, shape)
    own = shape[1] - seamless
    turns = np.arange(shape[1])
    if seamless:  # on both sides as much of the other end as can be reached
        aside = int(min(own // 2, np.ceil(reach / spacing[1])))
        turns = np.arange(-aside, own + 1 + aside) % own
    away, (row, column) = ndimage.distance_transform_edt(~wet[:, turns], spacing, return_indices=True)
    middle = slice(aside, aside + own + 1) if seamless else slice(None)
    away, row, column = away[:, middle], row[:, middle], turns[column[:, middle]]
    chosen = (away > 0) & (away <= reach)
    if allowed is not None:
        chosen &= _mask(allowed, shape)
    node = np.flatnonzero(chosen).astype(np.int32)
    return node, (row * shape[1] + column)[chosen].astype(np.int32)


def _mask(bits: bytes, shape: tuple[int, int]) -> Mask:
    return np.unpackbits(np.frombuffer(bits, np.uint8), count=shape[0] * shape[1]).view(bool).reshape(shape)
