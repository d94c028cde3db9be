"""Reading one slice of a component: only the part of the file that is wanted, in m/s, NaN where missing."""

import numpy as np
import xarray as xr

from geo.component import Component
from geo.errors import UserError
from geo.layout import Array, Index, Layout, Triangles

SENTINELS = (999.0, 9999.0, 99999.0, 999.9, 9999.9, 32767.0, 32768.0)  # fill values that files forget to declare
SENTINEL_SPEED = 5.0  # [m/s] above which one of these numbers is no speed, whatever its units
IMPOSSIBLE = {"current": 100.0, "wind": 200.0, "stokes": 100.0}  # [m/s]; the strongest gust on record is 113


def window(layout: Layout) -> tuple[Index, ...]:
    """Return the file's indices that a layout's points have, one array for each horizontal dimension."""
    if isinstance(layout, Triangles):
        count = len(layout.lon) if layout.lonc is None else len(layout.lonc)
        return (np.arange(layout.first, layout.first + count),)
    return layout.rows, layout.columns


def read(component: Component, layout: Layout, i: int) -> tuple[Array, int]:
    """Return slice i [m/s] over a (cropped) layout, NaN missing, and how many undeclared fill values it held."""
    data, path, time_dim, k = component.segments[i]
    fixed = {d: n for d, n in component.fixed.items() if d in data[component.name].dims}
    if time_dim is not None:
        fixed[time_dim] = k
    variable = data[component.name].isel(fixed)
    index = window(layout)
    try:
        values = _block(variable, component.dims, index)
    except UserError:
        raise
    except Exception as error:  # HDF5's OSError and RuntimeError, zlib's, an address's
        raise UserError(
            f"{path}: cannot read slice {k} of {component.name} ({' '.join(str(error).split())[:80]}): "
            f"truncated or damaged; mend [[{component.quantity}]] files"
        ) from error
    if component.mask is not None:
        values[~component.mask[np.ix_(*index)]] = np.nan
    return _clean(values, component)


def _block(variable: xr.DataArray, dims: tuple[str, ...], index: tuple[Index, ...]) -> Array:
    """Read the smallest contiguous parts of a file that hold the wanted indices, and bring them into order."""
    spans, orders = [], []
    for wanted in index:
        jump = np.nonzero(np.abs(np.diff(wanted)) != 1)[0] + 1
        runs = np.split(wanted, jump) if len(jump) <= 2 else [wanted]  # the seam cuts an axis into two runs
        spans.append([(int(r.min()), int(r.max()) + 1) for r in runs])
        orders.append([r - r.min() for r in runs])
    parts = []
    for (j0, j1), rows in zip(spans[0], orders[0], strict=True):
        if len(index) == 1:
            block = np.asarray(variable.isel({dims[0]: slice(j0, j1)}).values, np.float64)
            parts.append(block[rows])
            continue
        across = []
        for (i0, i1), columns in zip(spans[1], orders[1], strict=True):
            cut = variable.isel({dims[0]: slice(j0, j1), dims[1]: slice(i0, i1)}).transpose(*dims)
            across.append(np.asarray(cut.values, np.float64)[np.ix_(rows, columns)])
        parts.append(np.concatenate(across, axis=1))
    return np.concatenate(parts, axis=0)


def _clean(values: Array, component: Component) -> tuple[Array, int]:
    """Convert to m/s and drop what no speed can be: fill values that the file does not declare."""
    with np.errstate(invalid="ignore", over="ignore"):
        size = np.abs(values)
        wrong = size * component.factor > IMPOSSIBLE[component.quantity]
        if 999.0 * component.factor > SENTINEL_SPEED:
            wrong |= np.isin(size, SENTINELS)
        wrong |= np.isinf(values)
    count = int(wrong.sum())
    values = np.where(wrong, np.nan, values) * component.factor
    return values, count
