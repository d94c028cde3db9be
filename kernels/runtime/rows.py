"""Columns of one type as rows of one device array, accessible by name.

A graphics card binds few arrays to a kernel (Metal 31 in all), so related columns share one array:
slot i of the column in row r of an array with n slots per row is element r * n + i. Kernels take
the array. On the host each column is a `Row`, which is read and written like an array of its own.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import taichi as ti

from kernels.runtime import runtime
from kernels.runtime.dtypes import NUMPY
from kernels.runtime.taichi_way import way

Numbers = ti.types.ndarray(ndim=1)
Array = ti.Ndarray
Columns = Mapping[str, Any]  # by name: arrays, or rows of arrays


class Row:
    """A column in one row of an array."""

    def __init__(self, array: Array, row: int, rows: int) -> None:
        """Wrap a row of an array.

        Args:
            array: the array, shape (rows * n,).
            row: number of the row, from 0.
            rows: number of rows in the array.
        """
        self.array, self.row, self.rows = array, row, rows
        self.shape = (array.shape[0] // rows,)
        self.dtype = array.dtype

    @property
    def first(self) -> int:
        """Index of the row's first element in its array."""
        return self.row * int(self.shape[0])

    def to_numpy(self) -> np.ndarray:
        """Return a copy on the host."""
        lying = way.lying(self.array)
        if lying is not None:
            return lying[self._span].copy()
        values = way.column(self.dtype, self.shape[0], zeroed=False)
        _copy(self.array, self.first, values, 0, self.shape[0])
        return values.to_numpy()

    def from_numpy(self, values: np.ndarray) -> None:
        """Write the values of a host array of the same shape."""
        if values.shape != self.shape:
            raise ValueError(f"a column of shape {self.shape} cannot take values of {values.shape}")
        lying = way.lying(self.array)
        if lying is not None:
            lying[self._span] = values
        else:
            fresh = runtime.upload(values.astype(NUMPY[self.dtype]))
            _copy(fresh, 0, self.array, self.first, self.shape[0])

    def fill(self, value: float) -> None:
        """Write one value into every slot."""
        self.from_numpy(np.full(self.shape, value, NUMPY[self.dtype]))

    @property
    def _span(self) -> slice:
        return slice(self.first, self.first + self.shape[0])


@ti.kernel
def _copy(source: Numbers, begin: ti.i32, target: Numbers, to: ti.i32, n: ti.i32):
    """Copy n numbers from an array to another of the same type."""
    for i in range(n):
        target[to + i] = source[begin + i]


def stack(names: Sequence[str], values: np.ndarray) -> dict[str, Row]:
    """Return columns in a new array.

    Args:
        names: names of the columns, in the order of their rows.
        values: what they hold, shape (rows, n).
    """
    array = runtime.upload(values)
    return {name: Row(array, row, len(names)) for row, name in enumerate(names)}


def located(column: Any) -> tuple[Array, int]:
    """Return the array that holds a column, and the column's first element in it."""
    return (column.array, column.first) if isinstance(column, Row) else (column, 0)


def whole(columns: Columns, names: Sequence[str]) -> Array:
    """Return the array whose rows are the columns of these names, in this order.

    Raises:
        ValueError: the columns stand in other arrays, or in another order.
    """
    array, _ = located(columns[names[0]])
    for row, name in enumerate(names):
        own = columns[name]
        if not isinstance(own, Row) or own.array is not array or own.row != row:
            raise ValueError(f"the column {name} is not row {row} of the array of {names[0]}")
    return array


def arrays(columns: Iterable[Any]) -> list[Array]:
    """Return the arrays that hold some columns, each once."""
    return list({id(array): array for array, _ in map(located, columns)}.values())


def rebuilt(columns: Columns, make: Callable[[str, Array], Array]) -> dict[str, Any]:
    """Return columns of the same names in new arrays; each array is made once.

    Args:
        columns: columns by name.
        make: takes the name of a column and its array; returns the new array, with as many rows.
    """
    made: dict[int, Array] = {}
    found = {}
    for name, column in columns.items():
        array, _ = located(column)
        if id(array) not in made:
            made[id(array)] = make(name, array)
        new = made[id(array)]
        found[name] = Row(new, column.row, column.rows) if isinstance(column, Row) else new
    return found
