"""Times of a file's slices as UTC datetime64[s].

Dates of non-standard calendars are kept as they are written; a date that does not exist, like 30
February of 360_day, is rejected. Times without a definite meaning (climatologies, "day as %Y%m%d",
zones like MDT) are rejected, and the message names the key by which the user can state the times.
Slices at the end of a file without a time are left out.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import cftime
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from geo.errors import UserError
from geo.forcing.times import epoch

Times = NDArray[np.datetime64]

NAMES = ("time", "ocean_time", "time_counter", "valid_time", "Time", "TIME", "MT", "t")
OWN = {"standard", "gregorian", "proleptic_gregorian"}
# earlier dates belong to climatologies and idealized runs, not to forecasts
EARLIEST = np.datetime64("1800-01-01", "s")
# time variables that the attribute `coordinates` may name besides the axis
CENTRED = ("time_centered", "time_instant", "valid_time")
# netCDF's default fill values
FILLS = (9.969209968386869e36, -2147483647.0, -9223372036854775806.0)
# [s] times in single precision are rounded to the coarsest of these that fits
STEPS = (3600, 1800, 1200, 900, 600, 300, 60, 10)


def variable_of(
    data: xr.Dataset, dims: Sequence[str], chosen: Mapping[str, Any], coordinates: str = ""
) -> str | None:
    """Return the name of the time variable for a variable with these dimensions.

    Args:
        data: the file's dataset.
        dims: of the variable.
        chosen: `variables` of the case.
        coordinates: attribute of the variable. A time that it names is preferred: NEMO's axis may
            hold the ends of intervals whose middles are `time_centered`.

    Returns:
        The name, or None if there is no time.
    """
    listed = set(coordinates.split())
    if "time" in chosen:
        if chosen["time"] not in data.variables:
            raise UserError(
                f'no time variable "{chosen["time"]}"; it holds {", ".join(map(str, data.variables))}'
            )
        return str(chosen["time"])

    def rank(name: str) -> int:
        attributes = data[name].attrs
        timely = str(attributes.get("standard_name", "")) == "time"
        return (
            16 * (name in listed and (timely or name in CENTRED))
            + 4 * timely
            + 2 * epoch.is_shifted(str(attributes.get("units", "")))
            + (name in NAMES)
            + 8 * (data[name].dims == (name,))
        )

    fitting = [
        str(n)
        for n, v in data.variables.items()
        if v.ndim <= 1 and set(map(str, v.dims)) <= set(dims)
    ]
    fitting = [
        n
        for n in fitting
        if str(data[n].attrs.get("standard_name", "")) == "time"
        or str(data[n].attrs.get("axis", "")) == "T"
        or epoch.is_shifted(str(data[n].attrs.get("units", "")))
        or n in NAMES
    ]
    fitting = [n for n in fitting if "reference" not in str(data[n].attrs.get("standard_name", ""))]
    lasting = [n for n in fitting if data[n].ndim == 1] or fitting
    return max(lasting, key=rank) if lasting else None


def decode(
    data: xr.Dataset, name: str, zone: int | None = None, trim: bool = False
) -> tuple[Times, list[str]]:
    """Return the times [UTC] of a time variable, and notes on how they were interpreted.

    Args:
        data: the file's dataset.
        name: of the time variable.
        zone: [s] ahead of UTC that the case states; None for none.
        trim: leave out missing times at the end instead of rejecting them.

    Raises:
        UserError: the times cannot be interpreted.
    """
    variable = data[name]
    values = np.atleast_1d(np.asarray(variable.values))
    units, notes = str(variable.attrs.get("units", "")), list[str]()
    if "climatology" in variable.attrs:
        raise UserError(f'"{name}" is a climatology\'s time')
    if {"Itime", "Itime2"} <= set(data.variables):  # FVCOM: exact, in days and milliseconds
        start = np.datetime64("1858-11-17", "ms") - np.timedelta64(zone or 0, "s")
        days = np.atleast_1d(data["Itime"].values).astype("timedelta64[D]")
        return _round_to_seconds(
            start + days + np.atleast_1d(data["Itime2"].values).astype("timedelta64[ms]")
        ), notes
    if np.issubdtype(values.dtype, np.datetime64):
        return _round_to_seconds(values), notes
    if not epoch.is_shifted(units):
        raise UserError(f'"{name}" has units "{units}", which give no date')
    if not np.issubdtype(values.dtype, np.number):
        raise UserError(f'"{name}" holds no numbers')
    numbers = np.where(np.isin(values, FILLS), np.nan, values.astype(np.float64))
    finite = np.flatnonzero(np.isfinite(numbers))
    kept = numbers[: finite[-1] + 1] if trim and finite.size else numbers
    if not np.isfinite(kept).all():
        raise UserError(f'"{name}" has missing values')
    if len(kept) < len(numbers):
        notes.append(f"{len(numbers) - len(kept)} slices at the end have no time: left out")
    calendar = str(variable.attrs.get("calendar", "standard")).lower()
    times = dates(kept, units, calendar, name, zone)
    if calendar not in OWN:
        notes.append(f'calendar "{calendar}": its dates are taken as they are written')
    if (times < EARLIEST).any():
        raise UserError(
            f'"{name}" starts in the year {str(times.min())[:4]}, which is no real date'
        )
    if values.dtype == np.float32:
        grain = (
            float(np.spacing(np.abs(values[: len(kept)]).max())) * epoch.parse(units, zone).seconds
        )
        if grain > 0.5:
            times, step = _snap_times(times, grain)
            notes.append(
                f"times stored in single precision (to {grain:.0f} s): rounded to {step} s"
            )
    return times, notes


def dates(
    numbers: NDArray[np.float64], units: str, calendar: str, name: str, zone: int | None = None
) -> Times:
    """Return the times [UTC] of numbers in units of time; name: of the variable, for messages."""
    try:
        since = epoch.parse(units, zone)
    except UserError as error:
        raise type(error)(f'"{name}" has {error}') from error
    try:
        found = cftime.num2date(
            numbers * since.scale, since.units, calendar, only_use_cftime_datetimes=True
        )
    except (ValueError, OverflowError, TypeError) as error:
        raise UserError(
            f'"{name}" has units "{units}" in calendar "{calendar}", not understood'
        ) from error
    try:
        times = _round_to_seconds(
            np.array([np.datetime64(date.isoformat(), "us") for date in np.ravel(found)])
        )
    except ValueError as error:
        raise UserError(
            f'"{name}" holds dates of the calendar "{calendar}" that do not exist: {error}'
        ) from error
    return np.asarray(times - np.timedelta64(since.zone, "s")).reshape(np.shape(numbers))


def counts(data: xr.Dataset, name: str | None) -> tuple[Any, str] | None:
    """Return numbers that give the order of a file's slices, and their units; None if unusable."""
    if name is None:
        return None
    values = np.atleast_1d(np.asarray(data[name].values))
    if (
        values.ndim != 1
        or not np.issubdtype(values.dtype, np.number)
        or not np.isfinite(values).all()
    ):
        return None
    return values.astype(np.float64), str(data[name].attrs.get("units", ""))


def order(
    counted: Sequence[tuple[Any, str] | None], sizes: Sequence[int]
) -> NDArray[np.int64] | None:
    """Return the order in time of the slices of all files; None to keep their order.

    It is used if a case states the times. If all files count from the same date, their numbers are
    compared; otherwise each file is only sorted by itself.

    Args:
        counted: from `counts`, for each file.
        sizes: number of slices of each file.
    """
    usable = [own for own in counted if own is not None and len(np.unique(own[0])) == len(own[0])]
    if len(usable) < len(counted) or any(
        len(own[0]) != size for own, size in zip(usable, sizes, strict=True)
    ):
        return None
    if len({units for _, units in usable}) == 1 and epoch.is_shifted(usable[0][1]):
        all_numbers = np.concatenate([numbers for numbers, _ in usable])
        if len(np.unique(all_numbers)) == len(all_numbers):
            return np.argsort(all_numbers, kind="stable")
    begins = np.cumsum([0, *sizes[:-1]])
    falling = [bool((np.diff(numbers) < 0).all()) for numbers, _ in usable]
    parts = [
        begin + (np.arange(size)[::-1] if turned else np.arange(size))
        for begin, size, turned in zip(begins, sizes, falling, strict=True)
    ]
    return np.concatenate(parts)


def _round_to_seconds(times: NDArray[np.datetime64]) -> Times:
    rounded = times.astype("datetime64[us]") + np.timedelta64(500_000, "us")
    return rounded.astype("datetime64[s]")


def _snap_times(times: Times, grain: float) -> tuple[Times, int]:
    """Round to the coarsest step that moves no time by more than its stored precision."""
    seconds = times.astype(np.int64)
    for step in STEPS:
        rounded = (seconds + step // 2) // step * step
        if np.abs(rounded - seconds).max() <= grain:
            return rounded.astype("datetime64[s]"), step
    return times, 1


def states_times(times: Any) -> bool:
    """Return True if the times in a case replace the file's own."""
    return times is not None and not (isinstance(times, Mapping) and "start" not in times)


def zone(times: Any) -> int | None:
    """Return the zone that a case states for a file's times [s ahead of UTC]; None if none."""
    stated_zone = times.get("zone") if isinstance(times, Mapping) else None
    return None if stated_zone is None else epoch.zone_of(str(stated_zone))


def stamp(times: Any) -> str:
    """Return where the case says that times lie in their intervals; "" if it does not."""
    return str(times.get("stamp") or "") if isinstance(times, Mapping) else ""


def stated(times: Any, count: int, quantity: str) -> Times:
    """Return the times that a user states for `count` slices.

    times: {"start", "interval", ...} or one time per slice.
    """
    if isinstance(times, Mapping):
        start, interval = (
            np.datetime64(times["start"], "s"),
            np.timedelta64(times["interval"]).astype("m8[s]"),
        )
        result = start + interval * np.arange(count)
    else:
        result = np.asarray(times).astype("datetime64[s]").reshape(-1)
    if len(result) != count:
        raise UserError(
            f"[[{quantity}]] times states {len(result)} times, but the files hold {count} slices"
        )
    if (np.diff(result) <= np.timedelta64(0, "s")).any():
        raise UserError(f"[[{quantity}]] times must increase")
    return np.asarray(result)
