"""Datasets in memory as forcing, converted to what a file would give.

They come as xarray opens them (times as dates, packing and fill values resolved, coordinates
separated) or raw (decode_cf = False). Lazy variables stay lazy. The caller's dataset is never
changed, and nothing keeps a reference to it after the run.
"""

import datetime
import hashlib
import math
import warnings
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import cftime
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from geo.errors import UserError
from geo.forcing import validity
from geo.forcing.times import epoch
from geo.grids import naming

# [bytes] variables up to this size are hashed whole, larger ones by SLICES thinned slices
WHOLE = 2**28
SLICES = 16
PIECE = 2**24  # [bytes] hashed at once, so that a lazy variable is never in memory as a whole
THINNED = 2**16  # largest number of values hashed per slice
EPOCH = "seconds since 1970-01-01"
# attributes that xarray moves to the encoding when it decodes
REFERENCES = ("coordinates", "grid_mapping")


@dataclass(frozen=True)
class NamedDataset:
    """A dataset in memory and its name in the case."""

    name: str
    data: xr.Dataset

    @property
    def title(self) -> str:
        """The dataset's name in messages."""
        return f'dataset "{self.name}"'


def wrap_datasets(datasets: Any) -> dict[str, NamedDataset]:
    """Return datasets by name as forcing; None gives an empty result.

    Raises UserError for a value that is not a dataset.
    """
    if isinstance(datasets, xr.Dataset) or not isinstance(datasets, Mapping | None):
        raise UserError(
            f'datasets: a {type(datasets).__name__} is given; must be {{"name": an xarray.Dataset}}'
        )
    for name, data in (datasets or {}).items():
        if not isinstance(data, xr.Dataset):
            hint = (
                "; files are named in the case"
                if isinstance(data, str) or hasattr(data, "__fspath__")
                else ""
            )
            hint = "; its to_dataset() makes one" if isinstance(data, xr.DataArray) else hint
            raise UserError(
                f'datasets: "{name}" is a {type(data).__name__}; must be an xarray.Dataset{hint}'
            )
    return {str(name): NamedDataset(str(name), data) for name, data in (datasets or {}).items()}


def as_stored(held: NamedDataset) -> xr.Dataset:
    """Return a dataset as `dataset.open_one` would return it from a file.

    Packing is resolved, and times are numbers since a date.
    """
    try:
        with warnings.catch_warnings():
            # warnings of several fill values, which all count as missing
            warnings.simplefilter("ignore")
            return xr.decode_cf(
                _encode(held.data),
                concat_characters=False,
                decode_times=False,
                decode_coords=False,
                decode_timedelta=False,
            )
    except Exception as error:  # xarray and cftime raise many kinds
        raise UserError(
            f"{held.title} cannot be decoded ({' '.join(str(error).split())[:120]}); correct its attributes, or decode "
            "it first"
        ) from error


def _encode(data: xr.Dataset) -> xr.Dataset:
    """Return a dataset with dates as numbers, and attributes back where a file has them."""
    data = data.rename(
        {name: str(name) for name in {*data.variables, *data.dims} if not isinstance(name, str)}
    )
    stored = {}
    for name in map(str, data.variables):
        variable = data[name].variable.copy(deep=False)
        references = {
            k: variable.encoding[k] for k in REFERENCES if isinstance(variable.encoding.get(k), str)
        }
        aside = sorted(str(c) for c in data[name].coords if c not in data.dims and c != name)
        attributes = {"coordinates": " ".join(aside)} if aside and name in data.data_vars else {}
        attributes |= references | validity.unpacked(variable.attrs, variable.encoding)
        # time bounds and valid times of several runs have two dimensions
        if variable.ndim <= 2 and variable.dtype.kind in "MO":
            variable, attributes = _dates_as_numbers(variable, attributes)
        elif variable.ndim <= 1 and variable.dtype.kind == "m":
            variable = xr.Variable(variable.dims, variable.values / np.timedelta64(1, "s"))
            attributes = {**attributes, "units": "seconds"}
        variable.attrs, variable.encoding = attributes, {}
        stored[name] = variable
    return xr.Dataset(stored)


def _dates_as_numbers(
    variable: xr.Variable, attributes: Mapping[Any, Any]
) -> tuple[xr.Variable, dict[Any, Any]]:
    """Return dates as numbers with their attributes, as a file has them; other values unchanged."""
    values, encoding = variable.values, variable.encoding
    if variable.dtype.kind == "M":
        dates = values.astype("datetime64[us]").astype(object)  # Python's, None where missing
        calendar = "proleptic_gregorian"
    else:
        dates = np.array([_to_utc(date) for date in values.flat] + [None], object)[:-1]
        calendar = next(
            (getattr(d, "calendar", "standard") for d in dates if d is not None), "standard"
        )
    valid = np.array(
        [isinstance(d, datetime.datetime | cftime.datetime) and d == d for d in dates.flat], bool
    )
    if not valid.any():
        return variable, dict(attributes)
    stored = _stored_units(encoding)
    single = stored is not None and encoding.get("dtype") == np.float32
    if stored is None or not (single or stored.misread):
        units, origin, seconds = EPOCH, EPOCH, 1.0
    else:
        # also in single precision the reader needs the file's own numbers, to find out how
        # they were rounded
        units, origin, seconds = stored.units, stored.origin, stored.seconds
        calendar = encoding.get("calendar", calendar)
    numbers: NDArray[Any] = np.full(dates.size, np.nan, "f4" if single else "f8")
    numbers[valid] = cftime.date2num(dates.reshape(-1)[valid], origin, calendar) / seconds
    new_attributes = {**attributes, "units": units, "calendar": calendar}
    return xr.Variable(variable.dims, numbers.reshape(values.shape)), new_attributes


@dataclass(frozen=True)
class _StoredUnits:
    """The units in which a file has the dates that xarray decoded.

    origin: xarray's interpretation of their origin; seconds: length of the unit; misread: xarray
    ignored or misinterpreted a time zone.
    """

    units: str
    origin: str
    seconds: float
    misread: bool


def _stored_units(encoding: Mapping[Any, Any]) -> _StoredUnits | None:
    """Return the units from which dates were decoded; None if unknown."""
    units = str(encoding.get("units", ""))
    if not epoch.is_shifted(units):
        return None
    about = {"units": units, "calendar": encoding.get("calendar", "standard")}
    try:
        taken = xr.decode_cf(xr.Dataset({"time": ("time", [0.0], about)}))["time"].values[0]
        seconds = epoch.parse(units, 0).seconds
    except (ValueError, OverflowError, TypeError, UserError):
        return None
    begin: Any = (
        taken if isinstance(taken, np.datetime64) else np.datetime64(taken.isoformat(), "s")
    )
    begin = begin.astype("datetime64[s]")
    right: Any = np.datetime64("NaT", "s")
    try:
        own = epoch.parse(units)
        right = np.datetime64(own.moment.replace(" ", "T"), "s") - np.timedelta64(own.zone, "s")
    except (ValueError, UserError):
        pass
    return _StoredUnits(units, f"seconds since {begin}", seconds, bool(right != begin))


def _to_utc(date: Any) -> Any:
    """Return a date in UTC without time zone: cftime would take the zone's local time for UTC."""
    aware = isinstance(date, datetime.datetime) and date.tzinfo is not None
    return date.astimezone(datetime.UTC).replace(tzinfo=None) if aware else date


def fingerprint(data: xr.Dataset, fields: Collection[str], time: str | None, extra: str) -> str:
    """Return a short hash of two fields of a dataset and of all their coordinates.

    Args:
        data: from `as_stored`.
        fields: names of the fields.
        time: the time dimension; other variables along it are other quantities and do not count.
        extra: text to be hashed as well.

    Returns:
        16 hexadecimal digits. Fields of more than 256 MiB are sampled.
    """
    total = hashlib.sha256(extra.encode())
    for name in sorted(map(str, data.variables)):
        variable = data[name].variable
        if (
            name in fields
            or variable.ndim <= 1
            or time not in variable.dims
            or naming.of_grid(name)
        ):
            total.update(f"{name} {variable.dims} {variable.shape} {variable.dtype}".encode())
            for key, value in sorted((str(k), v) for k, v in variable.attrs.items()):
                total.update(f"{key} {np.asarray(value).tolist()!r}".encode())
            _hash_values(total, variable)
    return total.hexdigest()[:16]


def _hash_values(total: "hashlib._Hash", variable: xr.Variable) -> None:
    if variable.ndim == 0 or not variable.size:
        total.update(_value_bytes(variable))
        return
    first, rows = variable.dims[0], variable.shape[0]
    if variable.nbytes <= WHOLE:
        step = max(1, PIECE * rows // variable.nbytes)
        for k in range(0, rows, step):
            total.update(_value_bytes(variable.isel({first: slice(k, k + step)})))
        return
    others = max(variable.ndim - 1, 1)
    every = math.ceil((variable.size / rows / THINNED) ** (1 / others))
    for k in np.unique(np.linspace(0, rows - 1, SLICES).astype(int)):
        total.update(
            _value_bytes(
                variable.isel(
                    {first: k, **{d: slice(None, None, every) for d in variable.dims[1:]}}
                )
            )
        )


def _value_bytes(variable: xr.Variable) -> bytes:
    values = np.asarray(variable.values)
    return (
        repr(values.tolist()).encode()
        if values.dtype.hasobject
        else np.ascontiguousarray(values).tobytes()
    )
