"""Tables in device arrays of two dimensions: a row for each thing, a column for each of its
numbers.

Where one thread reads many numbers of one thing they lie side by side so; where neighbouring
threads read the same number of many things, kernels.runtime.rows is the layout.
"""

from typing import Any

import numpy as np
import taichi as ti

from kernels.runtime.dtypes import DTYPES


def empty(many: int, columns: int, dtype: type) -> Any:
    """Return a table of zeros on the device; it has one row at least, as no array may be empty."""
    return ti.ndarray(DTYPES[np.dtype(dtype)], (max(many, 1), columns))


def upload(values: np.ndarray) -> Any:
    """Return a device copy of a table, shape (rows, columns)."""
    device = empty(*values.shape, values.dtype)
    if len(values):
        device.from_numpy(np.ascontiguousarray(values))
    return device
