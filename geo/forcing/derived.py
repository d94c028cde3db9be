"""Lazy variables: their values are computed from other variables when a part of them is read."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from geo.array import Array

Part = Mapping[str, Any]  # dimension -> index, slice or indices to read


class Derived(BackendArray):
    """A lazy array whose `read` function computes the requested part.

    xarray accepts only subclasses of `BackendArray` as lazy arrays.
    """

    def __init__(
        self, dims: tuple[str, ...], shape: tuple[int, ...], read: Callable[[Part], Array]
    ) -> None:
        self.shape = shape
        self.dtype = np.dtype(np.float64)
        self._dims, self._read = dims, read

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Array:
        return np.asarray(
            indexing.explicit_indexing_adapter(
                key, self.shape, indexing.IndexingSupport.OUTER, self._part
            )
        )

    def _part(self, key: tuple[Any, ...]) -> Array:
        return self._read(dict(zip(self._dims, key, strict=True)))


def derive(
    variable: xr.Variable, read: Callable[[Part], Array], without: str | None = None
) -> xr.Variable:
    """Return a lazy variable with the attributes and the packing of another variable.

    Args:
        variable: gives attributes, encoding and dimensions.
        read: returns the float64 values of a part, with axes in the order of the dimensions.
        without: a dimension of `variable` that the new variable does not have.
    """
    sizes = {str(dim): size for dim, size in variable.sizes.items() if dim != without}
    lazy = indexing.LazilyIndexedArray(Derived(tuple(sizes), tuple(sizes.values()), read))
    encoding = {**variable.encoding, "dtype": variable.encoding.get("dtype", variable.dtype)}
    return xr.Variable(tuple(sizes), lazy, variable.attrs, encoding)


def values_of(variable: xr.Variable, part: Part) -> Array:
    """Return part of a variable as float64, ignoring dimensions that the variable does not have."""
    own = {dim: index for dim, index in part.items() if dim in variable.dims}
    return np.array(variable.isel(own).values, np.float64)
