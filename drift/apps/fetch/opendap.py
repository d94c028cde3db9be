"""Subsets by OPeNDAP (DAP 2.0), which ERDDAP's griddap speaks too; values are copied bit for bit.

The header and the axes are read first; they determine the indices of a box and a span. The header
is read in a separate process (`geo.files.address`), values by `geo.files.dap`.
"""

import hashlib
import json
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from drift.apps.fetch import window
from drift.apps.fetch.order import Order, Part, Shipment
from drift.apps.fetch.window import Window
from geo.errors import UserError
from geo.files import address, dap
from geo.files.web import TemporaryError
from geo.forcing.times import clock
from geo.grids import naming

PART = 8_000_000  # [bytes] of values in one part, at least one time
# attributes about the request, which say nothing about the data
STALE = ("history", "date_created", "date_modified")
OF_STORAGE = (
    "_ChunkSizes",
    "_NCProperties",
    "_Netcdf4Dimid",
    "_Netcdf4Coordinates",
    "CLASS",
    "NAME",
    "DIMENSION_LIST",
    "REFERENCE_LIST",
)


@dataclass(frozen=True)
class Header:
    """The variables and attributes at an address; values are not read.

    grids: names that must be requested as a member of their DAP Grid, as the server would send the
    axes too.
    """

    address: str
    variables: Mapping[str, xr.Variable]
    attributes: Mapping[str, Any]
    grids: frozenset[str]
    timeout: float

    def read(self, name: str, spans: Mapping[Hashable, tuple[int, int]]) -> NDArray[Any]:
        """Return a part of a variable as it is stored.

        spans: by dimension, the first index and the one after the last; others are read whole.
        """
        variable = self.variables[name]
        bounds = [
            spans.get(d, (0, size)) for d, size in zip(variable.dims, variable.shape, strict=True)
        ]
        asked = f"{name}.{name}" if name in self.grids else name
        return dap.read_variable(
            self.address, asked, [slice(*b) for b in bounds], variable.dtype, self.timeout
        )


@dataclass(frozen=True)
class Field:
    """One variable of a dataset, and the part of it that is needed.

    time: the dimension along which parts are cut. level: index by dimension, for all dimensions but
    time and position. points: longitudes and latitudes [deg] of the whole grid, as stored.
    """

    data: "Header"
    name: str
    time: str
    times: NDArray[np.datetime64]
    level: dict[Hashable, int]
    rows: Hashable
    columns: Hashable
    places: tuple[str, str]
    points: tuple[NDArray[np.float64], NDArray[np.float64]]
    window: Window


def ship(order: Order) -> Shipment:
    """Return the shipment of an order from headers and axes; raise UserError or Passing."""
    provider = order.provider
    griddap = [f"{a.rstrip('/')}/griddap/{provider.dataset}" for a in provider.address]
    addresses = griddap if provider.protocol == "erddap" else list(provider.address)
    if len(addresses) == 1:
        addresses *= 2
    # most providers have one address for both components
    headers = {one: _header(one, order.timeout) for one in dict.fromkeys(addresses)}
    first, second = fields = [
        _field(order, headers[one], name)
        for one, name in zip(addresses, provider.variables, strict=True)
    ]
    if not np.array_equal(first.times, second.times):
        raise UserError(f"{provider.name}: its two components have different times")
    if not all(
        np.array_equal(*pair, equal_nan=True)
        for pair in zip(first.points, second.points, strict=True)
    ):
        raise UserError(
            f"{provider.name}: its two components are on different points (a staggered grid), "
            "which fetch does not support"
        )
    begin, end = _span(first, order)
    itemsize = sum(field.data.variables[field.name].dtype.itemsize for field in fields)
    slice_size = itemsize * int(np.prod(first.window.shape))
    count = max(PART // slice_size, 1)
    fingerprints = [_fingerprint(field) for field in fields]
    parts = []
    for start in range(begin, end, count):
        stop = min(start + count, end)
        times = first.times[start:stop]
        identity = [
            provider.name,
            addresses,
            fingerprints,
            str(first.window),
            [str(t) for t in times],
        ]
        key = hashlib.sha256(json.dumps(identity, default=str).encode()).hexdigest()
        parts.append(
            Part(key, partial(_make, fields, start, stop), times, slice_size * (stop - start))
        )
    notes = () if first.window.whole else ("covers only a part of the box",)
    return Shipment(order, tuple(parts), notes)


def _header(one: str, timeout: float) -> Header:
    """Return the header at an address.

    The structure is requested first, as the server's answer to that explains most errors.
    """
    grids = dap.grids(one, timeout)
    line = address.Line(one)
    try:
        store = address.Store(line, timeout)
        variables, attributes = store.get_variables(), store.get_attrs()
    except UserError as error:
        raise TemporaryError(str(error)) from None
    finally:
        line.close()
    return Header(one, variables, attributes, grids, timeout)


def _field(order: Order, data: Header, name: str) -> Field:
    where = data.address
    if name not in data.variables:
        available = ", ".join(other for other, v in data.variables.items() if v.ndim >= 2)
        raise UserError(f'"{where}" has no variable {name}; it has {available}')
    variable = data.variables[name]
    if variable.dtype.kind not in "iuf":
        raise UserError(f'"{where}": {name} is not a number')
    time = next((str(d) for d in variable.dims if _is_time(data, d)), None)
    if time is None:
        raise UserError(f'"{where}": {name} has no time dimension')
    places = _coordinate_names(data, name)
    lon, lat = (data.read(place, {}).astype(float) for place in places)
    has_axes = lon.ndim == 1
    rows, columns = (
        (data.variables[places[1]].dims[0], data.variables[places[0]].dims[0])
        if has_axes
        else data.variables[places[0]].dims
    )
    found = (
        window.along_axes(lon, lat, order.box)
        if has_axes
        else window.on_surface(lon, lat, order.box)
    )
    if found is None:
        raise UserError(
            f"{order.provider.name} has nothing in this box: its grid goes from {np.nanmin(lon):.2f} to "
            f"{np.nanmax(lon):.2f} E, {np.nanmin(lat):.2f} to {np.nanmax(lat):.2f} N"
        )
    level = {d: _level(data, d, order) for d in variable.dims if d not in (time, rows, columns)}
    return Field(
        data, name, time, _times(data, time), level, rows, columns, places, (lon, lat), found
    )


def _is_time(data: Header, dim: Hashable) -> bool:
    return str(dim) in data.variables and " since " in str(
        data.variables[str(dim)].attrs.get("units", "")
    )


def _times(data: Header, name: str) -> NDArray[np.datetime64]:
    """Return the times of an axis [s] UTC, shape (n,), ascending."""
    axis = xr.Variable((name,), data.read(name, {}), data.variables[name].attrs)
    try:
        times, _ = clock.decode(xr.Dataset({name: axis}), name)
    except UserError as error:
        raise UserError(f'"{data.address}": its times cannot be read ({error})') from None
    if times.size == 0 or (np.diff(times) <= np.timedelta64(0, "s")).any() or np.isnat(times).any():
        raise UserError(f'"{data.address}": its times do not ascend')
    return times


def _coordinate_names(data: Header, name: str) -> tuple[str, str]:
    """Return the names of a variable's longitude and latitude: axes, or on its own grid."""
    found = []
    dims = set(data.variables[name].dims)
    for units, standard, usual in (
        (naming.EAST_UNITS, "longitude", naming.LON),
        (naming.NORTH_UNITS, "latitude", naming.LAT),
    ):
        known = []
        for other, variable in data.variables.items():
            if not variable.ndim or variable.ndim > 2 or not dims.issuperset(variable.dims):
                continue
            by_metadata = variable.attrs.get("standard_name") == standard or units.match(
                str(variable.attrs.get("units", ""))
            )
            by_name = "units" not in variable.attrs and usual.match(other)
            if by_metadata or by_name:
                known.append(other)
        if not known:
            raise UserError(f'"{data.address}": {name} has no {standard} that can be recognised')
        found.append(known[0])
    if data.variables[found[0]].ndim != data.variables[found[1]].ndim:
        raise UserError(f'"{data.address}": {found[0]} and {found[1]} are not on the same grid')
    return found[0], found[1]


def _level(data: Header, dim: Hashable, order: Order) -> int:
    """Return the index to use on a dimension that is neither time nor position."""
    size = next(v.sizes[dim] for v in data.variables.values() if dim in v.sizes)
    if size == 1 or dim in order.provider.first:
        return 0
    if str(dim) in data.variables and order.provider.level is not None:
        axis = np.abs(data.read(str(dim), {}).astype(float))  # some have negative depths
        return int(np.argmin(np.abs(axis - abs(order.provider.level))))
    raise UserError(
        f'"{data.address}" has {size} layers along {dim}: the catalogue must choose one, by '
        "level or first. "
        "See: docs/fetch.md"
    )


def _span(field: Field, order: Order) -> tuple[int, int]:
    """Return the first index, and the one after the last, of the times that an order needs."""
    times = field.times
    if order.begin < times[0] or order.end > times[-1]:
        raise UserError(
            f"{order.provider.name} has {times[0]}Z to {times[-1]}Z, not all of {order.begin}Z to {order.end}Z: "
            "ask for another span (--from, --to) or provider"
        )
    first, last = (
        int(np.searchsorted(times, order.begin, "right")) - 1,
        int(np.searchsorted(times, order.end, "left")) + 1,
    )
    # a mean's middle may lie on the other side of its stamp
    if order.provider.stamp in ("start", "middle", "end"):
        return max(first - 1, 0), min(last + 1, times.size)
    return first, last


def _fingerprint(field: Field) -> list[Any]:
    """Return what identifies the state of a dataset: shape, type and attributes of the data."""
    variable = field.data.variables[field.name]
    attributes = {
        k: str(v) for k, v in {**field.data.attributes, **variable.attrs}.items() if k not in STALE
    }
    return [
        variable.dims,
        [s for d, s in variable.sizes.items() if d != field.time],
        str(variable.dtype),
        attributes,
    ]


def _make(fields: list[Field], start: int, stop: int, path: Path) -> None:
    """Write the times from `start` up to `stop` of both components as a netCDF file."""
    variables: dict[str, xr.Variable] = {}
    for field in fields:
        _read(field, start, stop, variables)
    attributes_of_dataset = fields[0].data.attributes
    attributes = {
        k: v
        for k, v in attributes_of_dataset.items()
        if k not in OF_STORAGE and not k.startswith("DODS")
    }
    out = xr.Dataset(variables, attrs=attributes)
    encoding = {
        n: {"_FillValue": None} for n, v in out.variables.items() if "_FillValue" not in v.attrs
    }
    out.to_netcdf(path, engine="netcdf4", encoding=encoding)


def _read(field: Field, start: int, stop: int, found: dict[str, xr.Variable]) -> None:
    """Add a component at some times to `found`, with its axes, positions and grid mapping."""
    data = field.data
    spans: dict[Hashable, tuple[int, int]] = {
        field.time: (start, stop),
        field.rows: field.window.rows,
    }
    spans |= {d: (k, k + 1) for d, k in field.level.items()}
    bounds = str(data.variables[field.time].attrs.get("bounds", ""))
    for name in dict.fromkeys(
        (field.name, *field.places, *map(str, data.variables[field.name].dims), bounds)
    ):
        if name not in data.variables or name in found:
            continue
        variable = data.variables[name]
        kept = {k: v for k, v in variable.attrs.items() if k not in OF_STORAGE}
        if field.columns not in variable.dims:
            found[name] = xr.Variable(variable.dims, data.read(name, spans), kept)
            continue
        runs = []
        for run, turn in zip(field.window.runs, field.window.turns, strict=True):
            values = data.read(name, {**spans, field.columns: run})
            runs.append(
                values + values.dtype.type(turn) if turn and name == field.places[0] else values
            )
        joined = np.concatenate(runs, axis=variable.dims.index(field.columns))
        found[name] = xr.Variable(variable.dims, joined, kept)
    mapping = str(data.variables[field.name].attrs.get("grid_mapping", ""))
    if mapping in data.variables:  # only its attributes carry information
        found[mapping] = xr.Variable((), np.int32(0), data.variables[mapping].attrs)
