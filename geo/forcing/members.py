"""Dimensions along which a file holds the members of an ensemble, and the members' labels."""

import re
from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr

NAMES = "realization, number, member, ensemble, ens, perturbationNumber"
MOST = 4  # largest number of members that a note names
_NAMED = re.compile(
    r"^(reali[sz]ations?|number|members?|ensembles?|ens|ens_?(member|number)s?|ensemble_?(member|number|index)s?"
    r"|perturbation(_?number)?s?|mem)$",
    re.IGNORECASE,
)


def is_member_dim(data: xr.Dataset, dim: str) -> bool:
    """Return True if a dimension's name or standard name says that it numbers members."""
    standard_name = data[dim].attrs.get("standard_name", "") if dim in data.variables else ""
    return str(standard_name) == "realization" or bool(_NAMED.match(dim))


def member_dim(data: xr.Dataset, dims: Iterable[str], wanted: bool | str) -> str | None:
    """Return the dimension along which members lie, among `dims`; None if there is none.

    wanted: name of the dimension, or True to search for it.
    """
    if isinstance(wanted, str):
        return wanted if wanted in dims else None
    return next(
        (dim for dim in dims if wanted and data.sizes[dim] > 1 and is_member_dim(data, dim)), None
    )


def lie_in(data: xr.Dataset) -> bool:
    """Return True if any variable that may be a field has a dimension of members."""
    fields = (
        v for v in data.data_vars.values() if v.ndim > 2 and np.issubdtype(v.dtype, np.number)
    )
    return any(member_dim(data, map(str, v.dims), True) is not None for v in fields)


def labels(data: xr.Dataset, dim: str) -> tuple[str, ...]:
    """Return the labels of the members: values of the coordinate, or else numbers from 0."""
    size = int(data.sizes[dim])
    values = (
        data[dim].values if dim in data.variables and data[dim].dims == (dim,) else np.arange(size)
    )
    names = tuple(
        f"{value:g}" if np.issubdtype(values.dtype, np.number) else str(value)
        for value in values.tolist()
    )
    return names if len(set(names)) == size else tuple(map(str, range(size)))


def some(names: Sequence[str]) -> str:
    """Return a list of labels for a note; of many labels only the first ones and the last."""
    return ", ".join(names if len(names) <= MOST else [*names[: MOST - 1], "...", names[-1]])
