"""Reading one slice of a component: only the part of the file that is wanted, in m/s, NaN where
missing.
"""

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
ROUNDING = 1e-9  # [m/s] what rounding leaves of a zero


def window(layout: Layout) -> tuple[Index, ...]:
    """Return the file's indices that a layout's points have, one array for each horizontal
    dimension.
    """
    if isinstance(layout, Triangles):
        count = len(layout.lon) if layout.lonc is None else len(layout.lonc)
        return (np.arange(layout.first, layout.first + count),)
    return layout.rows, layout.columns


def read_component_slice(component: Component, layout: Layout, i: int) -> tuple[Array, int]:
    """Return slice i [m/s] over a (cropped) layout, NaN missing, and how many undeclared fill
    values it held.
    """
    index, kept = window(layout), component.kept
    part = None if kept is None else kept.part(index)
    if kept is None or part is None:
        return _read(component, index, i)
    values, strange = kept.slice(i, lambda: _read(component, kept.index, i))
    return values[np.ix_(*part)], strange


def _read(component: Component, index: tuple[Index, ...], i: int) -> tuple[Array, int]:
    """Return slice i [m/s] at the file's indices along its horizontal dimensions."""
    with _reading(component, i) as variable:
        values = _block(variable, component.dims, index)
    if component.mask is not None:
        values[~component.mask[np.ix_(*index)]] = np.nan
    return _clean(values, component)


def block(component: Component, i: int, index: tuple[slice, ...]) -> Array:
    """Return part of slice i as the file has it: in its own units, over its own indices along
    `component.dims`.
    """
    with _reading(component, i) as variable:
        cut = variable.isel(dict(zip(component.dims, index, strict=True))).transpose(
            *component.dims
        )
        return np.array(cut.values, np.float64)


@contextmanager
def _reading(component: Component, i: int) -> Iterator[xr.DataArray]:
    """Give slice i, unread; a failure to read it becomes a line that names the file."""
    data, path, time_dim, k = component.segments[i]
    fixed = {d: n for d, n in component.fixed.items() if d in data[component.name].dims}
    if time_dim is not None:
        fixed[time_dim] = k
    try:
        with np.errstate(all="ignore"):  # damaged values may overflow; they become missing
            yield data[component.name].isel(fixed)
    except UserError as error:  # raised by a library that runs in a process of its own
        raise UserError(f"{error}; set {dataset.key(path, component.quantity)}") from error
    except Exception as error:  # HDF5 raises OSError and RuntimeError, zlib its own
        raise UserError(
            f"{path}: cannot read slice {k} of {component.name} ({' '.join(str(error).split())[:80]}): "
            f"truncated or damaged; mend {dataset.key(path, component.quantity)}"
        ) from error


def _block(variable: xr.DataArray, dims: tuple[str, ...], index: tuple[Index, ...]) -> Array:
    """Read the smallest contiguous parts of a file that hold the wanted indices, and bring them
    into order.
    """
    spans, orders = [], []
    for wanted in index:
        jump = np.nonzero(np.abs(np.diff(wanted)) != 1)[0] + 1
        # the seam cuts an axis into two runs
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
    """Return which values of slice i, in its file's own units, are zero as far as that file can
    write zero.

    A number packed with an offset need not hit it: the nearest one does.
    """
    packing = component.segments[i][0][component.name].encoding
    exact = not float(packing.get("add_offset", 0.0))
    slack = 0.0 if exact else 0.501 * abs(float(packing.get("scale_factor", 1.0)))
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(values) <= max(slack, ROUNDING / component.factor))


def _clean(values: Array, component: Component) -> tuple[Array, int]:
    """Convert to m/s and drop what no speed can be: fill values that the file does not declare, in
    any slice.
    """
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
