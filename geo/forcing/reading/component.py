"""One component of a vector quantity in one or several files: slices, levels, grid and units."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from geo import notation
from geo.errors import UserError
from geo.forcing import level, members, quantities, speed
from geo.forcing.quantity import QUANTITIES
from geo.forcing.reading.kept import Kept
from geo.forcing.times import averages, clock, epoch, overlap, runs
from geo.grids import locate, naming, places, planar, ugrid
from geo.grids.layout import Layout
from geo.grids.places import Places

# dimensions that hold both components (SCHISM's hvel)
HORIZONTAL = ("two", "component", "components", "uv")


File = tuple[str, xr.Dataset]
# dataset, path, time dimension or None, index along it
Slice = tuple[xr.Dataset, str, str | None, int]


@dataclass(frozen=True)
class Wanted:
    """A component to be read: a variable, and what the case says about how to read it."""

    name: str
    # 0 for the first component, 1 for the second; used if one variable holds both
    side: int
    quantity: str
    chosen: Mapping[str, Any]  # `variables` of the case
    units: str | None  # stated by the case
    depth: float | None  # [m]
    needs_times: bool  # the file's times are used
    # members may lie along a dimension; a string names it
    members: bool | str = False
    times: Any = None  # `times` of the case
    steady: bool = False  # the first slice is used at all times


@dataclass(frozen=True)
class Component:
    """A variable over its files.

    dims: its horizontal dimensions. fixed: indices along all other dimensions except time.
    segments: every slice, in the order of time. factor: from the file's units to m/s. mask: False
    where the file's own mask says land, over all of `dims`; None if there is no mask.
    """

    name: str
    dims: tuple[str, ...]
    fixed: dict[str, int]
    segments: tuple[Slice, ...]
    times: clock.Times | None
    factor: float
    quantity: str
    layout: Layout
    mask: NDArray[np.bool_] | None
    unmasked: bool = False  # the case says that zeros are still water, not land
    # values in the file's own units that mean missing, though the file does not declare them
    fills: tuple[float, ...] = ()
    # the user vouches for the values: none is taken as missing because it is large
    vouched: bool = False
    kept: Kept | None = None  # slices kept in memory
    # dimension along which members of an ensemble lie; `fixed` has the index of this member
    member: str | None = None
    # positions of a moving grid at each slice; `layout` is the first of them
    places: Places | None = None
    notes: tuple[str, ...] = field(default=())
    # intervals (n, 2) of slices that are means; None for instants
    cells: NDArray[np.datetime64] | None = None


def describe_dims(data: xr.Dataset, name: str) -> str:
    """Return "name(dim = size, ...)" for messages."""
    return f"{name}({', '.join(f'{d} = {data.sizes[d]}' for d in map(str, data[name].dims))})"


def gather(wanted: Wanted, files: Sequence[File]) -> Component:
    """Return a component from the files that hold it.

    Args:
        wanted: the variable and how to read it.
        files: paths and datasets.

    Raises:
        UserError: the files do not fit together, or the variable cannot be interpreted.
    """
    name, quantity, depth = wanted.name, wanted.quantity, wanted.depth
    files, chosen, notes = runs.unrolled(files, name, quantity, wanted.chosen, wanted.times)
    wanted = replace(wanted, chosen=chosen)
    path, data = files[0]
    lone = [levels.name for levels in level.beside(data, name, quantity)]
    _check_keys(wanted, data, lone)
    time_name = clock.variable_of(
        data, list(map(str, data[name].dims)), chosen, str(data[name].attrs.get("coordinates", ""))
    )
    time_dim = str(data[time_name].dims[0]) if time_name and data[time_name].ndim == 1 else None
    if time_dim is None:
        time_dim = next(
            (str(d) for d in data[name].dims if str(d).lower() in {n.lower() for n in clock.NAMES}),
            None,
        )
    dims, fixed, member = _sort_dims(wanted, files[0], time_dim, notes)
    layout, remarks = locate.locate(data, name, dims, chosen, wanted.side)
    notes += remarks
    for file in files:
        notes += [n for n in _scalar_level_notes(wanted, file) if n not in notes]
    if depth is not None and not lone and not any(level.is_vertical(data, d) for d in fixed):
        notes.append(f"depth = {depth:g} m is not used: {name} has no levels")
    method = averages.method_of(data, name, time_name, path)
    _check_method(wanted, method, path)
    moving = places.moving_places(files, name, dims, chosen, wanted.side, time_dim)
    if moving is not None:
        notes.append(
            f"moving grid: {moving.count} positions; each slice is read at its own position"
        )
    slices: list[Slice] = []
    stamped: list[_FileTimes] = []
    for other_path, other in files:
        _check_same_grid(wanted, files[0], (other_path, other), dims, moving is not None)
        _check_same_units(wanted, files[0], (other_path, other))
        _check_same_levels(wanted, files[0], (other_path, other), fixed)
        count = int(other.sizes[time_dim]) if time_dim and time_dim in other[name].dims else 1
        own = [
            (other, other_path, time_dim if time_dim in other[name].dims else None, k)
            for k in range(count)
        ]
        if wanted.needs_times:
            one = _read_times(wanted, (other_path, other), time_name, own, method)
            notes += [r for r in one.notes if r not in notes]
            stamped.append(one)
            own = [own[k] for k in one.chosen]
        slices += own
    if not slices:
        raise UserError(
            f"{path}: {describe_dims(data, name)} holds no slice; set [[{quantity}]] files"
        )
    times, cells = None, None
    if wanted.needs_times:
        times, slices, cells = _order_by_time(wanted, fixed, stamped, slices, method, notes)
    elif not wanted.steady:
        slices = _order_by_file_times(files, time_name, slices, notes)
    return Component(
        name,
        dims,
        fixed,
        tuple(slices),
        times,
        _factor(wanted, files[0], notes),
        quantity,
        layout,
        _read_mask(data, dims, chosen, notes),
        chosen.get("mask") in ("none", False),
        member=member,
        places=moving,
        notes=tuple(notes),
        cells=cells,
    )


def _check_keys(wanted: Wanted, data: xr.Dataset, lone: Sequence[str]) -> None:
    """Raise UserError for a key of `variables` that does not apply to this variable.

    lone: names of its scalar levels.
    """
    allowed = {*quantities.KEYS, *data[wanted.name].dims, *lone}
    odd = [key for key in wanted.chosen if key not in allowed]
    if odd:
        raise UserError(
            f"[[{wanted.quantity}]] variables.{odd[0]}: allowed are {', '.join(quantities.KEYS)}, the dimensions of "
            f"{describe_dims(data, wanted.name)}"
            + (f" and its level, {', '.join(lone)}" if lone else "")
        )


def _check_same_levels(wanted: Wanted, first: File, file: File, fixed: Mapping[str, int]) -> None:
    """Raise UserError if an index is another level in this file than in the first."""
    (path, data), (other_path, other) = first, file
    for dim, index in fixed.items():
        if level.is_vertical(data, dim) and not level.same(data, other, dim, index):
            raise UserError(
                f'{other_path} has other levels along "{dim}" than {path}: index {index} is not the same level in '
                f"both; give it as a [[{wanted.quantity}]] source of its own"
            )


@dataclass(frozen=True)
class _FileTimes:
    """The slices of one file in order of time.

    times: of the slices. cells: their bounds (n, 2), NaT for none. chosen: their indices in the
    file.
    """

    times: NDArray[np.datetime64]
    cells: NDArray[np.datetime64]
    chosen: list[int]
    notes: list[str]


def _check_method(wanted: Wanted, method: averages.Method, path: str) -> None:
    """Raise UserError for values that are no velocity at a time: maxima, sums, climatologies."""
    if (
        method.kind in ("", "mean", "point")
        or clock.stamp(wanted.times) == "instant"
        or wanted.steady
    ):
        return
    if (
        wanted.name in (wanted.chosen.get("east"), wanted.chosen.get("north"))
        and method.kind != "climatology"
    ):
        return
    what = (
        "a climatology"
        if method.kind == "climatology"
        else f"the {method.kind.replace('_', ' ')} over a time"
    )
    raise UserError(
        f'{path}: "{wanted.name}" is {what} ({method.why}), no velocity at a time; name others in [[{wanted.quantity}]] '
        f'variables = {{ east = ..., north = ... }}, or state [[{wanted.quantity}]] times = {{ stamp = "instant" }} to take '
        "it as one, or steady = true to hold the first slice constant"
    )


def _read_times(
    wanted: Wanted, file: File, time_name: str | None, own: list[Slice], method: averages.Method
) -> _FileTimes:
    """Return the times of a file's slices, sorted; identical slices at one time are left out."""
    quantity, (path, data) = wanted.quantity, file
    if time_name is None:
        raise UserError(_no_time_message(path, quantity, len(own), "has no time"))
    zone, stamp = clock.zone(wanted.times), clock.stamp(wanted.times)
    try:
        when, remarks = clock.decode(data, time_name, zone, trim=True)
    except epoch.ZoneError as error:
        raise UserError(
            f'{path}: {error}; state its zone, hours ahead of UTC, with [[{quantity}]] times = {{ zone = "-06:00" }}'
        ) from error
    except UserError as error:
        raise UserError(_no_time_message(path, quantity, len(own), str(error))) from error
    bounds, more = None, list[str]()
    if not stamp and method.kind != "point":
        try:
            bounds, more = averages.bounds_of(data, time_name, when, zone)
        except UserError as error:
            raise UserError(
                f'{path}: {error}; state [[{quantity}]] times = {{ stamp = "instant" }} to take times as they stand, or '
                '"start", "middle" or "end" for means'
            ) from error
    cells = averages.join_intervals([bounds], [len(when)])
    remarks += more
    chosen = np.argsort(when, kind="stable")
    if (chosen != np.arange(len(when))).any():
        falling = (np.diff(when) < np.timedelta64(0, "s")).all()
        remarks.append(
            f"times {'decrease' if falling else 'are not in order'}: slices are sorted by time"
        )
    repeated = np.flatnonzero(np.diff(when[chosen]) == np.timedelta64(0, "s")).tolist()
    for k in repeated:
        if not _same_values(wanted.name, own[chosen[k]], own[chosen[k + 1]]):
            raise UserError(
                f"{path}: slices {chosen[k] + 1} and {chosen[k + 1] + 1} have the same time, "
                f"{notation.format_dtg(when[chosen[k]])}, but different values; if the slices are "
                f"evenly spaced, state [[{quantity}]] times = {{ start = ..., every = ... }}"
            )
    if repeated:
        remarks.append(f"{len(repeated)} slices repeat the time and values of another: left out")
        chosen = np.delete(chosen, [k + 1 for k in repeated])
    return _FileTimes(when[chosen], cells[chosen], chosen.tolist(), remarks)


def _same_values(name: str, one: Slice, other: Slice) -> bool:
    a, b = (
        np.asarray(data[name].isel({dim: k} if dim else {}).values)
        for data, _, dim, k in (one, other)
    )
    return np.array_equal(a, b, equal_nan=True)


def _order_by_time(
    wanted: Wanted,
    fixed: Mapping[str, int],
    stamped: Sequence[_FileTimes],
    slices: list[Slice],
    method: averages.Method,
    notes: list[str],
) -> tuple[NDArray[np.datetime64], list[Slice], NDArray[np.datetime64] | None]:
    """Return the times of the slices of all files, the sorted slices, and the intervals of means.

    Notes are appended to `notes`.
    """
    quantity, zone = wanted.quantity, clock.zone(wanted.times)
    all_bounds = np.concatenate([one.cells for one in stamped])
    bounds = {(id(s[0]), s[3]): cell for s, cell in zip(slices, all_bounds, strict=True)}
    times, slices = _resolve_overlaps(
        np.concatenate([one.times for one in stamped]), slices, wanted, fixed, notes
    )
    if zone is not None:
        notes.append(f"times are {zone / 3600:+g} h from UTC, as the case says")
    key = f"[[{quantity}]] times.stamp"
    cells = np.array([bounds[id(s[0]), s[3]] for s in slices])
    times, placed, remarks = averages.slice_times(
        times, cells, method, clock.stamp(wanted.times), key
    )
    notes += remarks
    return times, slices, placed


def _order_by_file_times(
    files: Sequence[File], time_name: str | None, slices: list[Slice], notes: list[str]
) -> list[Slice]:
    """Return slices in the order of the files' own times, for a case that states other times."""
    sizes = [sum(s[0] is data for s in slices) for _, data in files]
    counted = [
        clock.counts(data, time_name if time_name in data.variables else None) for _, data in files
    ]
    order = clock.order(counted, sizes)
    if order is None or (order == np.arange(len(slices))).all():
        return slices
    notes.append("slices are taken in the order of the file's own times, not in the file's order")
    return [slices[k] for k in order]


def _resolve_overlaps(
    times: NDArray[np.datetime64],
    slices: list[Slice],
    wanted: Wanted,
    fixed: Mapping[str, int],
    notes: list[str],
) -> tuple[NDArray[np.datetime64], list[Slice]]:
    """Return times and slices of all files in order of time; notes on shared times are appended."""
    order = overlap.resolve_overlaps(times, slices, wanted.name, fixed, notes)
    return times[order], [slices[k] for k in order]


def _no_time_message(path: str, quantity: str, count: int, why: str) -> str:
    keys = f"[[{quantity}]] times = {{ start = ..., every = ... }}"
    if count == 1:
        return f"{path}: {why}; state steady = true to hold it constant, or for several such files {keys}"
    return f"{path}: {why}; state {keys}, or steady = true to hold the first slice constant"


def _sort_dims(
    wanted: Wanted, file: File, time_dim: str | None, notes: list[str]
) -> tuple[tuple[str, ...], dict[str, int], str | None]:
    """Return a variable's horizontal dimensions, fixed indices of others, and that of members.

    Every dimension other than time, members and the horizontal ones gets an index. Notes are
    appended to `notes`.
    """
    name, quantity, chosen, (path, data) = wanted.name, wanted.quantity, wanted.chosen, file
    rest = [str(d) for d in data[name].dims if str(d) != time_dim]
    fixed: dict[str, int] = {}
    for dim in list(rest):
        size = int(data.sizes[dim])
        if dim in chosen and dim not in quantities.KEYS:
            index = str(chosen[dim]).strip()
            if not index.isdigit() or int(index) >= size:
                raise UserError(
                    f"[[{quantity}]] variables.{dim} = {index}: it is an index, 0 to {size - 1}"
                )
            fixed[dim] = int(index)
            notes.append(f"index {fixed[dim]} of {size} along {dim}, as the case says")
        elif dim.lower() in HORIZONTAL and size == 2:
            fixed[dim] = wanted.side
        elif level.is_vertical(data, dim):
            fixed[dim], remark = level.choose(data, name, dim, quantity, wanted.depth, path)
            notes += [remark] if remark else []
    rest = [d for d in rest if d not in fixed]
    single = _unstructured_dim(data, name, rest, chosen)
    horizontal = 1 if single else 2
    for dim in rest:
        if (
            len(rest) > horizontal
            and data.sizes[dim] == 1
            and not _has_axis(data, dim)
            and dim != single
        ):
            fixed[dim] = 0
    rest = [d for d in rest if d not in fixed]
    member = members.member_dim(data, rest, wanted.members) if len(rest) > horizontal else None
    if member is not None:
        fixed[member] = 0
        rest.remove(member)
    if len(rest) > horizontal:
        extra = [d for d in rest if d != single] if single else rest[:-horizontal]
        raise UserError(
            f"{path}: {describe_dims(data, name)} has more than one {' and '.join(extra)}; "
            f"set [[{quantity}]] variables.{extra[0]} to an index"
            + (
                ", or members = true to drift in each"
                if members.is_member_dim(data, extra[0])
                else ""
            )
        )
    if len(rest) < horizontal:
        raise UserError(
            f"{path}: {describe_dims(data, name)} is no field over longitude and latitude; "
            f"set variables = {{ lon = ..., lat = ... }} to those of its points"
        )
    if horizontal == 2 and lat_last(data, rest, chosen):
        rest = rest[::-1]
    return tuple(rest), fixed, member


def _scalar_level_notes(wanted: Wanted, file: File) -> list[str]:
    """Return notes on a variable's scalar levels; raise UserError for levels below the surface."""
    name, quantity, chosen, (path, data) = wanted.name, wanted.quantity, wanted.chosen, file
    remarks = []
    for levels in level.beside(data, name, quantity):
        if levels.name not in chosen:
            remarks.append(level.accept(levels, name, quantity, wanted.depth, path))
        elif str(chosen[levels.name]).strip() != "0":
            raise UserError(
                f"[[{quantity}]] variables.{levels.name} = {chosen[levels.name]}: it has a single level, whose index "
                "is 0"
            )
        else:
            remarks.append(f'the level of "{levels.name}", as the case says')
    return [r for r in remarks if r]


def _has_axis(data: xr.Dataset, dim: str) -> bool:
    return bool(naming.LON.match(dim) or naming.LAT.match(dim) or dim.lower() in ("x", "y"))


def lat_last(
    data: xr.Dataset, dims: Sequence[str], chosen: Mapping[str, Any] | None = None
) -> bool:
    """Return True if a variable is stored as (lon, lat) instead of (lat, lon).

    chosen: the case's names of both coordinates.
    """
    own = chosen or {}
    return axis_of(data, dims[0], own) == "x" and axis_of(data, dims[1], own) == "y"


def axis_of(
    data: xr.Dataset, dim: str, chosen: Mapping[str, Any] = MappingProxyType({})
) -> str | None:
    """Return the axis, "x" or "y", that a dimension is; None if unknown.

    The case's coordinates decide first, then the file's longitudes and latitudes, then projection
    coordinates and names.
    """
    along = {str(n): v.attrs for n, v in data.variables.items() if v.dims == (dim,)}
    for key, axis in (("lon", "x"), ("lat", "y"), ("x", "x"), ("y", "y")):
        if chosen.get(key) in along:
            return axis
    own = [dim] if dim in along and naming.role(dim, along[dim]) else sorted(along)
    roles = {naming.role(name, along[name]) for name in own} - {None}
    if len(roles) == 1:
        return "x" if roles == {"longitude"} else "y"
    attributes = along.get(dim, {})
    standard, axis = (str(attributes.get(key, "")).lower() for key in ("standard_name", "axis"))
    for letter, pattern, rotated in (
        ("x", naming.LON, "grid_longitude"),
        ("y", naming.LAT, "grid_latitude"),
    ):
        if (
            standard in (f"projection_{letter}_coordinate", rotated)
            or axis == letter
            or dim.lower() == letter
        ):
            return letter
        if pattern.match(dim):
            return letter
    return None


def _unstructured_dim(
    data: xr.Dataset, name: str, dims: Sequence[str], chosen: Mapping[str, Any]
) -> str | None:
    """Return the dimension of an unstructured grid; None for other grids.

    It is the dimension of the variable's UGRID mesh, that of the coordinates which the case names,
    or the last dimension if longitudes and latitudes both lie along it.
    """
    for dim in dims:
        if ugrid.mesh_of(data, name, dim) is not None:
            return dim
    named = [chosen.get(key) for key in ("lon", "lat")]
    if all(other in data.variables for other in named):
        own = [tuple(map(str, data[other].dims)) for other in named]
        return own[0][0] if own[0] == own[1] and len(own[0]) == 1 and own[0][0] in dims else None
    if not dims:
        return None
    found: list[bool] = []
    for standard in ("longitude", "latitude"):
        along = [(str(n), v) for n, v in data.variables.items() if v.dims == (dims[-1],)]
        found.append(any(naming.role(n, v.attrs) == standard for n, v in along))
    if not all(found) and any(data[x].dims == (dims[-1],) for x, _ in planar.pairs(data, chosen)):
        return dims[-1]
    return dims[-1] if all(found) else None


def _check_same_grid(
    wanted: Wanted, first: File, file: File, dims: tuple[str, ...], moves: bool
) -> None:
    """Raise UserError if a file's grid points differ from those of the first; a grid may move."""
    (path, data), (other_path, other) = first, file
    if other is data:
        return
    trouble = ""
    for dim in map(str, data[wanted.name].dims):
        if dim in dims and other.sizes.get(dim) != data.sizes[dim]:
            trouble = f"{other.sizes.get(dim)} points along {dim} instead of {data.sizes[dim]}"
    if not trouble and not moves:
        flat = {name for pair in planar.pairs(data) for name in pair}
        placing = [
            str(n)
            for n, v in data.variables.items()
            if (n in dims or n in flat or naming.LON.match(str(n)) or naming.LAT.match(str(n)))
            and n in other.variables
            and v.dims
            and set(map(str, v.dims)) <= set(dims)
            and np.issubdtype(v.dtype, np.number)
        ]
        for name in placing:
            a, b = np.asarray(data[name].values, float), np.asarray(other[name].values, float)
            if a.shape != b.shape or not np.allclose(a, b, rtol=1e-6, atol=1e-5, equal_nan=True):
                trouble = f'other values of "{name}"'
    if trouble:
        raise UserError(
            f"{other_path} has another grid than {path}: {trouble}; give it as a [[{wanted.quantity}]] source of its "
            "own"
        )


def _check_same_units(wanted: Wanted, first: File, file: File) -> None:
    """Raise UserError for files in different units, unless the case states the units."""
    name, quantity = wanted.name, wanted.quantity
    (path, units), (other_path, others) = (
        (p, str(d[name].attrs.get("units", "")).strip()) for p, d in (first, file)
    )
    if wanted.units is None and units.lower() != others.lower():
        raise UserError(
            f'{other_path}: "{name}" is in "{others}", and in {path} in "{units}"; give it as a [[{quantity}]] source '
            f"of its own, or state [[{quantity}]] units if all are in the same"
        )


def _factor(wanted: Wanted, file: File, notes: list[str]) -> float:
    """Return the factor from a variable's units to the quantity's; notes are appended to `notes`."""
    name, units, quantity, (path, data) = wanted.name, wanted.units, wanted.quantity, file
    attributes, unit = data[name].attrs, QUANTITIES[quantity].unit
    file_units = str(attributes.get("units", "")).strip()
    if units is not None:
        if file_units and file_units.lower() != units.lower():
            notes.append(f'units {units} as the case says (the file says "{file_units}")')
        return speed.factor_to(unit, units)
    if file_units in ("", "1", "unknown", "none") and file_units != unit:
        inside = speed.inside_text(str(attributes.get("long_name", "")))
        if inside is None:
            raise UserError(
                f'{path}: "{name}" has no units; state them with [[{quantity}]] units = "{unit}"'
            )
        notes.append(f'units "{inside}" read from the long name')
        return speed.factor_to(unit, inside)
    try:
        factor = speed.factor_to(unit, file_units)
    except UserError as error:
        raise UserError(
            f'{path}: "{name}": {error}; or state them with [[{quantity}]] units'
        ) from error
    if factor != 1.0:
        notes.append(f'converted from "{file_units}" to {unit}')
    return factor


def _read_mask(
    data: xr.Dataset, dims: tuple[str, ...], chosen: Mapping[str, Any], notes: list[str]
) -> NDArray[np.bool_] | None:
    """Return True where a file's mask (1 water, 0 land) says water; None without a mask."""
    named = chosen.get("mask")
    if named in ("none", False):
        return None
    for name in (
        [str(named)] if named else ["mask_u", "mask_v", "mask_rho", "umask", "vmask", "tmask"]
    ):
        if name not in data.variables:
            if named:
                raise UserError(f'no variable "{name}" (variables.mask)')
            continue
        variable = data[name].squeeze()
        if (
            variable.dims == dims
            and np.isin(np.unique(np.nan_to_num(variable.values)), (0, 1)).all()
        ):
            water = _water_value(variable.attrs)
            wet = np.asarray(variable.values == water)
            if wet.all() and not named:
                continue  # a mask without land does not tell whether land is stored as zero
            notes.append(f'land where "{name}" is {1 - water}')
            return wet
    return None


def _water_value(attributes: Mapping[str, Any]) -> int:
    """Return the value of a mask, 0 or 1, that means water: 1 unless its flags say otherwise."""
    meanings = str(attributes.get("flag_meanings", "")).lower().split()
    values = np.ravel(attributes.get("flag_values", range(len(meanings))))
    for meaning, value in zip(meanings, values, strict=False):
        if "land" in meaning or meaning in ("dry", "masked"):
            return 1 - int(value)
    return 1
