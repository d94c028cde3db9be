"""Tables of sensors in netCDF files: the variable, its dimensions, and selected values.

A dimension is recognized by CF standard names, otherwise by its name, long name or units. Any other
dimension of a table (depth, frequency) must have one value, or one is selected. `table_values`
reads axes and checks values.
"""

import difflib
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from geo.array import Array
from geo.errors import UserError
from geo.files import dataset
from geo.forcing.times import clock
from geo.grids import naming

MEND = "name a netCDF file"
MOST_VALUES = 2**28  # values of a table, 2 GiB while it is read
CLOSE = 1e-6  # largest relative difference between a selected value and the file's

ANGLES = {  # [deg]
    "degree": 1.0,
    "degrees": 1.0,
    "deg": 1.0,
    "degs": 1.0,
    "°": 1.0,
    "degree_true": 1.0,
    "degrees_true": 1.0,
    "degree_t": 1.0,
    "degrees_t": 1.0,
    "degt": 1.0,
    "deg true": 1.0,
    "degrees true": 1.0,
    "rad": math.degrees(1.0),
    "radian": math.degrees(1.0),
    "radians": math.degrees(1.0),
}
# kind of dimension: (standard names, names, long names)
LIKE = {
    "bearing": (
        re.compile(r"azimuth|bearing|_from_direction|_to_direction", re.I),
        re.compile(
            r"^(true_?)?(bearings?|radials?|azimuths?|azim?|brg|directions?)(_?(deg|rad|true))?$",
            re.I,
        ),
        re.compile(r"^(the |true )*(azimuth|bearing|radial|direction)s?\b", re.I),
    ),
    "range": (
        re.compile(r"range_coordinate|(^|_)range(_|$)|(^|_)distance(_|$)", re.I),
        re.compile(r"^(ranges?|distances?|dist|rng|radius|r)(_?(m|km|nmi?))?$", re.I),
        re.compile(r"^(the |horizontal |slant |radial )*(range|distance)s?\b", re.I),
    ),
}
NEITHER = re.compile(r"depth|height|altitude|freq|elevation|pressure|time|level", re.I)
# name of a dimension, its values and their unit, for messages
Label = tuple[str, Array, str]


@dataclass(frozen=True)
class Asked:
    """A request for a table."""

    name: str  # start of error messages
    variable: str | None = None
    select: Mapping[str, Any] = field(default_factory=dict)  # value by dimension
    units: Mapping[str, str] = field(default_factory=dict)  # by variable, over those of the file


@dataclass(frozen=True)
class Found:
    """A variable in a file, and its dimensions."""

    data: xr.Dataset  # at the selected values
    variable: str
    kinds: Mapping[str, str]  # dimension of each kind that it has
    coordinates: Mapping[str, str]  # variable that holds the values of each kind
    asked: Asked

    @property
    def name(self) -> str:
        """The start of error messages."""
        return self.asked.name


def asked_for(
    path: str | os.PathLike[str],
    name: str | None,
    variable: str | None,
    select: Mapping[str, Any] | None,
    units: Mapping[str, str] | None,
) -> Asked:
    """Return the request for a table; error messages start with `name` or that of the file."""
    return Asked(name or dataset.title([path]), variable, select or {}, units or {})


@contextmanager
def open_table(path: str | os.PathLike[str]) -> Iterator[xr.Dataset]:
    """Open a file's dataset; any fault of the file becomes an error message of one line."""
    named = os.path.expanduser(os.fspath(path))
    if not dataset.is_remote(named) and not os.path.exists(named):
        raise UserError(f'no such file: "{named}"; {MEND}')
    with dataset.reporting_damage(named, "", MEND), dataset.open_one(named, "", mend=MEND) as data:
        yield data


def find(
    data: xr.Dataset, asked: Asked, meant: re.Pattern[str], what: str, kinds: Sequence[str]
) -> Found:
    """Return the variable of a table and its dimensions.

    Args:
        data: of the file.
        asked: the request.
        meant: matches names, standard names and long names of the variable.
        what: the variable in words.
        kinds: of dimensions; only the last is required.

    Raises:
        UserError: no such variable, or several.
    """
    wanted = " and ".join(k for k in kinds if k != "time")
    name = variable_of(
        data,
        asked,
        meant,
        f"{what} over {wanted}",
        lambda n: kinds[-1] in dimensions(data, n, kinds)[0],
    )
    data = selected(data, name, asked)
    found, coordinates = dimensions(data, name, kinds)
    if kinds[-1] not in found:
        raise UserError(
            f"{asked.name}: {spoken(data, name)} has no dimension of {kinds[-1]}; name it so, or give its coordinate a "
            "standard_name, or set variable to another"
        )
    return Found(data, name, found, coordinates, asked)


def variable_of(
    data: xr.Dataset, asked: Asked, meant: re.Pattern[str], what: str, fits: Callable[[str], bool]
) -> str:
    """Return the name of the variable that the user names, or else of the best match.

    Args:
        data: of the file.
        asked: the request.
        meant: matches names, standard names and long names of the variable.
        what: the variable in words.
        fits: whether a variable of this name has the dimensions that are needed.

    Raises:
        UserError: no such variable, or several.
    """
    name = asked.variable
    odd = [key for key in asked.units if key not in data.variables]
    if odd:
        raise UserError(
            f'{asked.name}: units "{odd[0]}": no such variable; it holds {_listed(data)}: mend units'
        )
    if name is None:
        return _meant(data, asked, meant, what, fits)
    if name not in data.variables:
        near = difflib.get_close_matches(name, [str(n) for n in data.variables], n=1, cutoff=0.0)
        hint = f' (the nearest name is "{near[0]}")' if near else ""
        raise UserError(
            f'{asked.name}: no variable "{name}"{hint}; it holds {_listed(data)}: set variable to one of them'
        )
    if not np.issubdtype(data[name].dtype, np.number):
        raise UserError(
            f'{asked.name}: "{name}" holds no numbers; set variable to that of the {what}'
        )
    return name


def _listed(data: xr.Dataset) -> str:
    """Return the names of a file's variables for messages."""
    return ", ".join(map(str, data.variables))[:300] or "no variables"


def spoken(data: xr.Dataset, name: str) -> str:
    """Return "name(dim = size, ...)" for messages."""
    return f'"{name}" ({", ".join(f"{d} = {data.sizes[d]}" for d in data[name].dims)})'


def _meant(
    data: xr.Dataset, asked: Asked, meant: re.Pattern[str], what: str, fits: Callable[[str], bool]
) -> str:
    """Return the name of the best matching variable, if the user names none."""
    scores: dict[str, int] = {}
    for name in map(str, data.variables):
        variable = data[name]
        if not variable.ndim or not np.issubdtype(variable.dtype, np.number) or "bounds" in name:
            continue
        if variable.dims == (name,) or naming.of_grid(name, variable.attrs) or not fits(name):
            continue
        texts = (
            name,
            *(str(variable.attrs.get(key, "")) for key in ("standard_name", "long_name")),
        )
        scores[name] = sum(bool(meant.search(text)) for text in texts) + (variable.ndim > 1)
    best = [name for name, score in scores.items() if score == max(scores.values())]
    if not best:
        raise UserError(
            f"{asked.name}: no {what}; it holds {_listed(data)}: set variable, if one of them is it"
        )
    if len(best) > 1:
        raise UserError(
            f"{asked.name}: {', '.join(best)} may each be the {what}; set variable to one of them"
        )
    return best[0]


def dimensions(
    data: xr.Dataset, name: str, kinds: Sequence[str]
) -> tuple[dict[str, str], dict[str, str]]:
    """Return the dimension and the coordinate of each kind that a variable has.

    Kinds are "time", "bearing" and "range".
    """
    found, coordinates = dict[str, str](), dict[str, str]()
    dims = [str(d) for d in data[name].dims]
    scores = []
    for dim in dims:
        along = [dim] if dim in data.variables else []
        along += [
            str(n) for n, v in data.variables.items() if v.dims == (dim,) and n not in (dim, name)
        ]
        along += [] if dim in data.variables else [""]
        for kind in kinds:
            if kind in LIKE:
                scores += [(_likeness(kind, dim, n, data), kind, dim, n) for n in along]
    for score, kind, dim, coordinate in sorted(scores, key=lambda s: -s[0]):
        if score > 0 and kind not in found and dim not in found.values():
            found[kind], coordinates[kind] = dim, coordinate
    if "time" in kinds:
        free = [d for d in dims if d not in found.values()]
        named = clock.variable_of(data, free, {})
        if named is not None and data[named].ndim == 1 and str(data[named].dims[0]) in free:
            found["time"], coordinates["time"] = str(data[named].dims[0]), named
    return found, coordinates


def _likeness(kind: str, dim: str, name: str, data: xr.Dataset) -> float:
    """Return how well a coordinate matches a kind of dimension; 0 for no match.

    Criteria are, in this order: standard name, name, long name, unit.

    name: of the coordinate; "" for a dimension without one, which only its own name can match.
    Other variables along a dimension (the depth of the sea along the range) do not match by the
    name of the dimension.
    """
    standards, names, longs = LIKE[kind]
    attributes = data[name].attrs if name else {}
    standard, long, units = (
        str(attributes.get(key, "")).strip() for key in ("standard_name", "long_name", "units")
    )
    if (
        naming.NORTH_UNITS.match(units)
        or naming.EAST_UNITS.match(units)
        or standard in ("latitude", "longitude")
    ):
        return 0.0
    if standards.search(standard):
        return 8.0
    if NEITHER.search(name or dim) or NEITHER.search(standard):
        return 0.0
    if not name:
        return 0.5 if names.match(dim) else 0.0
    if names.match(name):
        return 4.0
    if longs.search(long) and not NEITHER.search(long):
        return 2.0
    return 1.0 if kind == "bearing" and units.lower() in ANGLES else 0.0


def selected(data: xr.Dataset, name: str, asked: Asked) -> xr.Dataset:
    """Return a dataset at the selected values of its dimensions.

    Raises:
        UserError: a selected value or dimension is not in the file, or no values are left.
    """
    for key, value in asked.select.items():
        dims = [str(d) for d in data[name].dims]
        beside = {
            str(n): v
            for n, v in data.variables.items()
            if v.ndim == 0 or (v.ndim == 1 and str(v.dims[0]) in dims)
        }
        if key not in dims and key not in beside:
            free = [d for d in [*dims, *beside] if d != name]
            near = difflib.get_close_matches(key, free, n=1)
            hint = f' (the nearest name is "{near[0]}")' if near else ""
            raise UserError(
                f'{asked.name}: select "{key}": {spoken(data, name)} does not depend on it{hint}; allowed are '
                f"{', '.join(dict.fromkeys(free)) or 'none'}"
            )
        dim = key if key in dims else next((str(d) for d in beside[key].dims), None)
        there = _entries(data, key, dim)
        index = _index(there, value)
        if index is None:
            raise UserError(
                f'{asked.name}: select "{key}" = {value}: it is not there; there are {_some(there)}'
                f"{_unit(data, key)}: set select to one of them"
            )
        if dim is not None:
            data = data.isel({dim: index})
    if 0 in data[name].shape:
        raise UserError(
            f"{asked.name}: {spoken(data, name)} holds no values; give a table with some"
        )
    return data


def _entries(data: xr.Dataset, key: str, dim: str | None) -> Array:
    """Return the values along a dimension: coordinate or times, else numbers from 0."""
    if key not in data.variables:
        return np.arange(data.sizes[key])
    if " since " in str(data[key].attrs.get("units", "")):
        with suppress(UserError):  # times that cannot be decoded are selected by their number
            return clock.decode(data, key)[0]
    values = np.atleast_1d(np.asarray(data[key].values))
    if dim is not None and values.ndim != 1:
        return np.arange(data.sizes[dim])
    return values


def _index(there: Array, value: Any) -> int | None:
    """Return the index of a value, None if it is not there."""
    if np.issubdtype(there.dtype, np.datetime64):
        try:
            same = there == np.datetime64(str(value).removesuffix("Z"), "s")
        except ValueError:
            return None
    elif np.issubdtype(there.dtype, np.number):
        if isinstance(value, bool) or not isinstance(value, int | float | np.number):
            return None
        same = np.isclose(there.astype(np.float64), float(value), rtol=CLOSE, atol=1e-9)
    else:
        same = np.array(
            [str(t.decode() if isinstance(t, bytes) else t).strip() == str(value) for t in there],
            bool,
        )
    return int(np.argmax(same)) if np.any(same) else None


def _some(there: Array) -> str:
    """Return values for messages: all, or the first and the last."""
    words = [f"{t:g}" if np.issubdtype(there.dtype, np.number) else str(t) for t in there]
    return ", ".join(words if len(words) <= 12 else [*words[:6], "...", *words[-3:]])


def _unit(data: xr.Dataset, key: str) -> str:
    unit = str(data[key].attrs.get("units", "")).strip() if key in data.variables else ""
    return f" {unit}" if unit and unit != "1" and " since " not in unit else ""


def values(found: Found, dims: Sequence[str]) -> Array:
    """Return a table's values over dimensions in this order, float64; missing values are NaN.

    Args:
        found: the table.
        dims: the dimensions; all others must have one value.

    Raises:
        UserError: another dimension has several values, or the table is too large.
    """
    data, name = found.data, found.variable
    rest = [str(d) for d in data[name].dims if d not in dims]
    for dim in rest:
        if data.sizes[dim] != 1:
            there = _entries(data, dim, dim)
            raise UserError(
                f'{found.name}: {spoken(data, name)} has {data.sizes[dim]} values of "{dim}" ({_some(there)}'
                f"{_unit(data, dim)}); choose one with select = {{ {dim} = ... }}"
            )
    count = math.prod(int(data.sizes[d]) for d in dims)
    if count > MOST_VALUES:
        raise UserError(
            f"{found.name}: {spoken(data, name)} has {count:,} values; at most {MOST_VALUES:,} are read: cut it"
        )
    variable = data[name].isel(dict.fromkeys(rest, 0)).transpose(*dims)
    with np.errstate(all="ignore"):
        return np.array(variable.values, np.float64)
