"""Convert the files of one source to common variable names, units and order of grid points.

Longitudes may run 0 to 360 in one file and -180 to 180 in another, latitudes may decrease, and a
file may hold more columns and rows than another. Other differences are left as they are; the files
are rejected later, when they are joined.
"""

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from geo.array import Array
from geo.errors import UserError
from geo.forcing import derived, level, members, quantities, speed
from geo.forcing.quantities import Pair
from geo.forcing.reading import component
from geo.forcing.times import clock
from geo.grids import naming

NEAR = 0.01  # tolerance for columns and rows of two files, as a share of the grid step
# [deg] tolerance for points of curvilinear grids: about single precision at 360 degrees
SAME = 5e-5
FEW_NAMES = 8  # largest number of different component names among the files of a source

File = tuple[str, xr.Dataset]


def rename_components(
    quantity: str, files: Sequence[File], chosen: Mapping[str, Any], notes: list[str]
) -> list[File]:
    """Return the files with their components renamed as in the first files.

    Args:
        quantity: of the source.
        files: paths and datasets.
        chosen: `variables` of the case; if it names the components, nothing is renamed.
        notes: list to which a note on each renaming is appended.
    """
    result = list(files)
    first = (
        None
        if {"east", "north"} & set(chosen)
        else _find_components(quantity, [data for _, data in files])
    )
    for _ in range(FEW_NAMES if first is not None else 0):
        assert first is not None
        own = {first.east, first.north}
        lacking = [
            k for k, (_, data) in enumerate(result) if not own & set(map(str, data.variables))
        ]
        other = _find_components(quantity, [result[k][1] for k in lacking])
        if other is None or (
            other.axes != first.axes and not _has_lonlat_axes(result[lacking[0]][1], other)
        ):
            break
        new = {other.east: first.east, other.north: first.north}
        for k in lacking:
            path, data = result[k]
            result[k] = (
                path,
                data.rename_vars({old: name for old, name in new.items() if old in data.variables}),
            )
        path = os.path.basename(
            next(p for p, d in (files[k] for k in lacking) if other.east in d.variables)
        )
        notes.append(
            f"{path}: {other.east}, {other.north} are called {first.east}, {first.north} in other files"
        )
    return result


def _find_components(quantity: str, datasets: Sequence[xr.Dataset]) -> Pair | None:
    """Return the components in the first dataset that has both, otherwise those in all together.

    None if there are none.
    """
    fields = [
        {
            str(n): v.attrs
            for n, v in data.variables.items()
            if v.ndim > 1 and np.issubdtype(v.dtype, np.number)
        }
        for data in datasets
    ]
    for attributes_by_name in (
        *fields,
        {name: attributes for own in reversed(fields) for name, attributes in own.items()},
    ):
        try:
            pair = quantities.search(quantity, attributes_by_name)
        except UserError:
            continue
        if pair is not None:
            return pair
    return None


def _has_lonlat_axes(data: xr.Dataset, pair: Pair) -> bool:
    """Return True if the grid's axes are longitude and latitude, so that "grid" axes are true."""
    name = pair.east if pair.east in data.variables else pair.north
    roles = {
        naming.role(str(n), v.attrs)
        for n, v in data.variables.items()
        if v.ndim == 1 and set(v.dims) <= set(data[name].dims)
    }
    return {"longitude", "latitude"} <= roles


def align_grids(
    files: Sequence[File], names: Sequence[str], units: str | None, notes: list[str]
) -> list[File]:
    """Return the files with the dimensions, the units and the order of points of the first file.

    Args:
        files: paths and datasets.
        names: of both components.
        units: units that the case states for all files; None to convert between the files' units.
        notes: list to which a note on each change is appended.
    """
    result = list(files)
    for name in dict.fromkeys(names):
        holding = [k for k, (_, data) in enumerate(result) if name in data.variables]
        if len(holding) < 2:
            continue
        first = result[holding[0]][1]
        for k in holding[1:]:
            path, data = result[k]
            data = _rename_dims(first, data, name)
            result[k] = (
                path,
                data if units is not None else _convert_units(first, data, name, path, notes),
            )
        fewest = min((result[k][1] for k in holding), key=lambda data: _count_points(data, name))
        for k in holding:
            path, data = result[k]
            result[k] = (path, _match_axes(fewest, data, name, path, notes))
    return result


def _count_points(data: xr.Dataset, name: str) -> int:
    sizes = {
        str(d): n
        for d, n in data[name].sizes.items()
        if component.axis_of(data, str(d)) is not None
    }
    return int(np.prod(list(sizes.values()) or [0]))


def _rename_dims(first: xr.Dataset, data: xr.Dataset, name: str) -> xr.Dataset:
    """Return a dataset with the dimension names that the first dataset has for the same kinds."""
    wanted, own = (
        {str(d): _kind_of_dim(dataset, str(d)) for d in dataset[name].dims}
        for dataset in (first, data)
    )
    new = {}
    for dim, kind in own.items():
        fitting = [other for other, its in wanted.items() if its == kind]
        alone = kind is not None and list(own.values()).count(kind) == 1
        if alone and len(fitting) == 1 and fitting[0] != dim:
            new[dim] = fitting[0]
    free = all(other not in data.variables or other in new for other in new.values())
    return data.rename(new) if new and free else data


def _kind_of_dim(data: xr.Dataset, dim: str) -> str | None:
    """Return the kind of a dimension: "time", "level", "member", "x" or "y".

    None for anything else.
    """
    attributes = data[dim].attrs if dim in data.variables else {}
    if (
        " since " in str(attributes.get("units", ""))
        or str(attributes.get("standard_name", "")) == "time"
        or dim in clock.NAMES
    ):
        return "time"
    if members.is_member_dim(data, dim):
        return "member"
    return "level" if level.is_vertical(data, dim) else component.axis_of(data, dim)


def _convert_units(
    first: xr.Dataset, data: xr.Dataset, name: str, path: str, notes: list[str]
) -> xr.Dataset:
    """Return a dataset with a variable converted to its units in the first, if both are known."""
    pair = [str(dataset[name].attrs.get("units", "")).strip() for dataset in (first, data)]
    if pair[0].lower() == pair[1].lower():
        return data
    try:
        factors = [speed.factor_to("m/s", units) for units in pair]
    except UserError:
        return data
    ratio, variable = factors[1] / factors[0], data.variables[name]
    if not np.isclose(ratio, 1.0, rtol=1e-9):
        variable = _scale_lazily(variable, ratio)
        notes.append(
            f'{os.path.basename(path)}: "{name}" converted from "{pair[1]}" to "{pair[0]}"'
        )
    variable = variable.copy(deep=False)
    variable.attrs = {**variable.attrs, "units": pair[0]}
    return data.assign({name: variable})


def _scale_lazily(variable: xr.Variable, ratio: float) -> xr.Variable:
    """Return a variable times a number, computed lazily; its packing is scaled as well."""

    def read(part: derived.Part) -> Array:
        return derived.values_of(variable, part) * ratio

    result = derived.derive(variable, read)
    packing = {
        key: float(variable.encoding[key]) * ratio
        for key in ("scale_factor", "add_offset")
        if key in variable.encoding
    }
    result.encoding = {**result.encoding, **packing}
    return result


def _match_axes(
    first: xr.Dataset, data: xr.Dataset, name: str, path: str, notes: list[str]
) -> xr.Dataset:
    """Return a dataset restricted to the columns and rows of the first dataset, in its order.

    Dimensions along which it lacks some of them are left unchanged.
    """
    if data is first:
        return data
    for dim in (str(d) for d in first[name].dims if d in data[name].dims):
        pair = _coordinate_along(first, dim), _coordinate_along(data, dim)
        if pair[0] is None or pair[1] is None:
            continue
        (own, kind), (other, _) = pair[0], pair[1]
        wanted, values = np.asarray(first[own].values, float), np.asarray(data[other].values, float)
        index = _index_of_each(wanted, values, kind)
        if index is None:
            continue
        if len(index) != len(values) or np.abs(values - wanted).max() > NEAR:
            label = {"longitude": "longitudes", "latitude": "latitudes"}.get(
                kind, f'values of "{other}"'
            )
            notes.append(
                f"{os.path.basename(path)}: its {label} reordered to match the other files"
            )
            data = data.isel({dim: index})
        data = data.assign({other: (data[other].dims, first[own].values, data[other].attrs)})
    return _match_curved_grid(first, data, name)


def _coordinate_along(data: xr.Dataset, dim: str) -> tuple[str, str] | None:
    """Return the coordinate along a dimension of a grid and its role.

    The role is "longitude", "latitude" or "plane". None if there is no such coordinate.
    """
    along = [
        str(n)
        for n, v in data.variables.items()
        if v.dims == (dim,) and np.issubdtype(v.dtype, np.number)
    ]
    for name in sorted(along, key=lambda n: n != dim):
        role = naming.role(name, data[name].attrs)
        if role is not None:
            return name, role
    planar = dim in along and component.axis_of(data, dim) is not None
    return (dim, "plane") if planar else None


def _index_of_each(wanted: Array, present: Array, kind: str) -> NDArray[np.int64] | None:
    """Return the index in `present` of each of the wanted coordinates.

    None if some are absent, or if `present` is a finer grid that only shares points with `wanted`.
    """
    if min(wanted.size, present.size) < 2 or not (
        np.isfinite(wanted).all() and np.isfinite(present).all()
    ):
        return None
    step = float(np.median(np.abs(np.diff(wanted))))
    if kind == "longitude":
        wanted, present = wanted % 360.0, present % 360.0
    order = np.argsort(present, kind="stable")
    after = np.searchsorted(present[order], wanted)
    beside = np.stack([order[(after + k) % len(present)] for k in (-1, 0)])
    apart = _difference(present[beside], wanted, kind)
    index = beside[apart.argmin(axis=0), np.arange(len(wanted))]
    if (apart.min(axis=0) > NEAR * step).any():
        return None
    jumps = np.diff(index) % len(present)  # grids with different steps may share points
    return (
        np.asarray(index, np.int64)
        if np.median(np.minimum(jumps, len(present) - jumps)) <= 1
        else None
    )


def _difference(one: Array, other: Array, kind: str) -> Array:
    apart = np.abs(one - other) % 360.0 if kind == "longitude" else np.abs(one - other)
    return np.asarray(np.minimum(apart, 360.0 - apart)) if kind == "longitude" else apart


def _match_curved_grid(first: xr.Dataset, data: xr.Dataset, name: str) -> xr.Dataset:
    """Return a dataset with the rows and columns of its curvilinear grid ordered as in the first.

    The coordinates of the first dataset replace its own.
    """
    dims = [str(d) for d in first[name].dims if d in data[name].dims]
    pairs = []
    for role in ("longitude", "latitude"):
        own, other = (_curved_coordinate(dataset, dims, role) for dataset in (first, data))
        if (
            own is None
            or other is None
            or first[own].shape != data[other].transpose(*first[own].dims).shape
        ):
            return data
        pairs.append((own, other, role))
    along = first[pairs[0][0]].dims
    for flips in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        turned = data.isel(
            {d: slice(None, None, flip) for d, flip in zip(along, flips, strict=True)}
        )
        if all(
            _same_coordinates(first[own], turned[other].transpose(*first[own].dims), role)
            for own, other, role in pairs
        ):
            return turned.assign(
                {
                    other: (first[own].dims, first[own].values, data[other].attrs)
                    for own, other, _ in pairs
                }
            )
    return data


def _curved_coordinate(data: xr.Dataset, dims: Sequence[str], role: str) -> str | None:
    """Return the 2-D coordinate with a role over the dimensions of a grid.

    None if there is none or more than one.
    """
    found = [
        str(n)
        for n, v in data.variables.items()
        if v.ndim == 2
        and set(map(str, v.dims)) <= set(dims)
        and naming.role(str(n), v.attrs) == role
    ]
    return found[0] if len(found) == 1 else None


def _same_coordinates(own: xr.DataArray, other: xr.DataArray, role: str) -> bool:
    wanted, values = np.asarray(own.values, float), np.asarray(other.values, float)
    finite = np.isfinite(wanted) & np.isfinite(values)
    same = np.array_equal(np.isfinite(wanted), np.isfinite(values))
    return same and bool((_difference(wanted, values, role)[finite] <= SAME).all())
