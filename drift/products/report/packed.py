"""Arrays as text that a browser unpacks: zlib, in base64.

Densities are logarithms in a byte, down to 1e-5 of the densest cell: 254 levels, 4.6 % apart, so
that a value is accurate to 2.3 %. Shares are a byte too, accurate to 0.2 %. Each map is cropped to
its cells with a value, and each cell is stored as the difference from the previous one in its
column, which is near 0 where maps are smooth.
"""

import base64
import math
import zlib
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt

from geo.array import Array

DECADES, LEVELS = 5.0, 254
MOST = 40_000_000  # values of all maps together; beyond that cells are merged
LEVEL = 4  # compression level of zlib: 6 takes three times as long, and saves a twentieth
AT_ONCE = 2  # maps that are packed in parallel


def packed_text(data: bytes) -> str:
    """Return bytes, compressed, as base64 text."""
    return base64.b64encode(zlib.compress(data, LEVEL)).decode("ascii")


def packed_numbers(values: Array, kind: npt.DTypeLike) -> str:
    """Return numbers of any shape as packed text, little-endian and in C order."""
    return packed_text(np.ascontiguousarray(values, np.dtype(kind).newbyteorder("<")).tobytes())


def merge_factor(maps: int, rows: int, columns: int) -> int:
    """Return how many cells to merge in each direction, so that all maps have at most MOST values.

    Args:
        maps: number of maps.
        rows, columns: cells of each map.

    Returns:
        The factor, at least 1.
    """
    return max(1, math.ceil(math.sqrt(maps * rows * columns / MOST)))


def axis(middles: Array, fold: int) -> dict[str, float]:
    """Return an axis of evenly spaced cell centres [deg] as its first centre, step and size."""
    step = float(middles[1] - middles[0]) if len(middles) > 1 else 1.0
    return {
        "first": float(middles[0]) + (fold - 1) * step / 2,
        "step": fold * step,
        "size": -(-len(middles) // fold),
    }


def merge_by_sum(values: Array, fold: int) -> Array:
    """Return sums over fold x fold cells, (..., nlat, nlon); cells beyond the edge count as 0."""
    if fold == 1:
        return values
    if values.ndim > 2:  # one map at a time, as all at once need twice their memory
        return np.stack([merge_by_sum(one, fold) for one in values])
    return np.asarray(_folded(values, fold, 0.0).sum(axis=(-3, -1)))


def merge_by_minimum(values: Array, fold: int) -> Array:
    """Return the minimum over fold x fold cells, (..., nlat, nlon), ignoring NaN."""
    if fold == 1:
        return values
    if values.ndim > 2:
        return np.stack([merge_by_minimum(one, fold) for one in values])
    return np.asarray(
        np.fmin.reduce(np.fmin.reduce(_folded(values, fold, np.nan), axis=-1), axis=-2)
    )


def _folded(values: Array, fold: int, fill: float) -> Array:
    rows, columns = (-(-size // fold) for size in values.shape[-2:])
    padded = np.full((*values.shape[:-2], rows * fold, columns * fold), fill, values.dtype)
    padded[..., : values.shape[-2], : values.shape[-1]] = values
    return padded.reshape(*values.shape[:-2], rows, fold, columns, fold)


def logarithms(values: Array, per: Array) -> dict[str, Any]:
    """Return maps of non-negative numbers divided by a map, packed as logarithms.

    A byte q > 0 stands for most * 10^(decades * ((q - 1) / (levels - 1) - 1)), and 0 for nothing.

    Args:
        values: maps, (t, nlat, nlon).
        per: divisor, (nlat, nlon).

    Returns:
        The scale and the packed maps.
    """
    extents = [_extent(values_then > 0) for values_then in values]
    parts = [
        values_then[extent] / per[extent]
        for values_then, extent in zip(values, extents, strict=True)
    ]
    most = max((float(part.max(initial=0.0)) for part in parts), default=0.0)

    def pack_frame(part: Array, extent: tuple[slice, slice]) -> list[Any]:
        with np.errstate(divide="ignore"):
            level = np.log10(part.astype(np.float32) / np.float32(most or 1.0))
        level = np.rint(1 + (LEVELS - 1) * (1 + level / np.float32(DECADES)))
        return _frame(np.where(level >= 1, level, 0).astype(np.uint8), *extent)

    with ThreadPoolExecutor(AT_ONCE) as pool:
        frames = list(pool.map(pack_frame, parts, extents))
    return {"most": most, "decades": DECADES, "levels": LEVELS, "frames": frames}


def shares(values: Array) -> dict[str, Any]:
    """Return maps (t, nlat, nlon) of shares, packed.

    A byte q > 0 stands for 1 - (q - 1) / (levels - 1), and 0 for none.
    """

    def pack_frame(values_then: Array) -> list[Any]:
        rows, columns = _extent(np.isfinite(values_then) & (values_then < 1))
        part = values_then[rows, columns]
        level = np.rint(1 + (LEVELS - 1) * (1 - part))
        return _frame(np.where(np.isfinite(part), level, 0).astype(np.uint8), rows, columns)

    with ThreadPoolExecutor(AT_ONCE) as pool:
        frames = list(pool.map(pack_frame, values))
    return {"levels": LEVELS, "frames": frames}


def _extent(there: Array) -> tuple[slice, slice]:
    """Return the rows and columns of a map that contain a value."""
    rows, columns = np.flatnonzero(there.any(axis=1)), np.flatnonzero(there.any(axis=0))
    if not rows.size:
        return slice(0, 0), slice(0, 0)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _frame(part: npt.NDArray[np.uint8], rows: slice, columns: slice) -> list[Any]:
    """Return a map's first row and column, its size, and its packed bytes."""
    down = np.diff(part, axis=0, prepend=np.uint8(0))  # modulo 256
    return [rows.start, columns.start, *part.shape, packed_text(down.tobytes())]
