"""Tables in two-dimensional device arrays: a row for each object, a column for each of its numbers.

This layout suits threads that each read many numbers of one object, which are adjacent. If
neighbouring threads read the same number of many objects, use kernels.runtime.rows.
"""

from typing import Any

import numpy as np
import taichi as ti

from kernels.runtime.dtypes import DTYPES


def empty(many: int, columns: int, dtype: type) -> Any:
    """Return a table of zeros on the device, with at least one row, as no array may be empty."""
    return ti.ndarray(DTYPES[np.dtype(dtype)], (max(many, 1), columns))


def upload(values: np.ndarray) -> Any:
    """Return a device copy of a table, shape (rows, columns)."""
    device = empty(*values.shape, values.dtype)
    if len(values):
        device.from_numpy(np.ascontiguousarray(values))
    return device
