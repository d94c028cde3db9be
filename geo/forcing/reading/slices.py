"""Read one slice of a component: only the wanted part of the file, in m/s, NaN for missing."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from geo.array import Array
from geo.errors import UserError
from geo.files import dataset
from geo.forcing import quantities
from geo.forcing.quantity import QUANTITIES
from geo.forcing.reading.component import Component
from geo.grids.layout import Index, Layout, Triangles

SENTINELS = (*quantities.NINES, 32767.0, 32768.0)  # fill values that files forget to declare
ROUNDING = 1e-9  # [m/s] tolerance for a zero that was rounded


def window(layout: Layout) -> tuple[Index, ...]:
    """Return the file indices of a layout's points, one array for each horizontal dimension."""
    if isinstance(layout, Triangles):
        count = len(layout.lon) if layout.lonc is None else len(layout.lonc)
        return (np.arange(layout.first, layout.first + count),)
    return layout.rows, layout.columns


def read_component_slice(component: Component, layout: Layout, i: int) -> tuple[Array, int]:
    """Return slice i over a (cropped) layout, and its number of undeclared fill values.

    Args:
        component: to read.
        layout: the points wanted.
        i: index of the slice.

    Returns:
        Values [m/s], NaN for missing, in the shape of the layout; and the number.
    """
    index, kept = window(layout), component.kept
    part = None if kept is None else kept.part(index)
    if kept is None or part is None:
        return _read_slice(component, index, i)
    values, strange = kept.slice(i, lambda: _read_slice(component, kept.index, i))
    return values[np.ix_(*part)], strange


def _read_slice(component: Component, index: tuple[Index, ...], i: int) -> tuple[Array, int]:
    """Return slice i [m/s] at file indices along its horizontal dimensions."""
    with _opened_slice(component, i) as variable:
        values = _read_block(variable, component.dims, index)
    if component.mask is not None:
        values[~component.mask[np.ix_(*index)]] = np.nan
    return _convert(values, component)


def block(component: Component, i: int, index: tuple[slice, ...]) -> Array:
    """Return part of slice i in the file's own units; axes in the order of `component.dims`."""
    with _opened_slice(component, i) as variable:
        cut = variable.isel(dict(zip(component.dims, index, strict=True))).transpose(
            *component.dims
        )
        return np.array(cut.values, np.float64)


@contextmanager
def _opened_slice(component: Component, i: int) -> Iterator[xr.DataArray]:
    """Yield slice i, not yet read; an error while reading it becomes a UserError with the file."""
    data, path, time_dim, k = component.segments[i]
    fixed = {d: n for d, n in component.fixed.items() if d in data[component.name].dims}
    if time_dim is not None:
        fixed[time_dim] = k
    try:
        with np.errstate(all="ignore"):  # damaged values may overflow; they become missing
            yield data[component.name].isel(fixed)
    except UserError as error:  # from a library that runs in a separate process
        raise UserError(f"{error}; set {dataset.key(path, component.quantity)}") from error
    except Exception as error:  # HDF5 raises OSError and RuntimeError, zlib its own
        raise UserError(
            f"{path}: cannot read slice {k} of {component.name} ({' '.join(str(error).split())[:80]}): "
            f"truncated or damaged; check {dataset.key(path, component.quantity)}"
        ) from error


def _read_block(variable: xr.DataArray, dims: tuple[str, ...], index: tuple[Index, ...]) -> Array:
    """Read the smallest contiguous blocks that hold the wanted indices, and sort the values."""
    spans, orders = [], []
    for wanted in index:
        jump = np.nonzero(np.abs(np.diff(wanted)) != 1)[0] + 1
        # at the seam of a global grid the wanted indices split into two contiguous runs
        runs = np.split(wanted, jump) if len(jump) <= 2 else [wanted]
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


def still(values: Array, component: Component, i: int) -> NDArray[np.bool_]:
    """Return which values of slice i, in the file's units, are zero to the precision of the file.

    For numbers packed with an offset, the packed number nearest to zero counts as zero.
    """
    packing = component.segments[i][0][component.name].encoding
    exact = not float(packing.get("add_offset", 0.0))
    slack = 0.0 if exact else 0.501 * abs(float(packing.get("scale_factor", 1.0)))
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(values) <= max(slack, ROUNDING / component.factor))


def _convert(values: Array, component: Component) -> tuple[Array, int]:
    """Convert to m/s; set impossible speeds and undeclared fill values to NaN, and count them."""
    values = np.where(np.isin(values, component.fills), np.nan, values)
    with np.errstate(invalid="ignore", over="ignore"):
        size = np.abs(values)
        wrong = np.isinf(values)
        if not component.vouched:
            wrong |= size * component.factor > QUANTITIES[component.quantity].impossible
            fast = np.array(
                [
                    x
                    for x in SENTINELS
                    if x * component.factor > QUANTITIES[component.quantity].fastest
                ]
            )
            wrong |= np.isin(size, fast) | np.isin(size, fast.astype(np.float32))
    count = int(wrong.sum())
    values = np.where(wrong, np.nan, values) * component.factor
    return values, count
