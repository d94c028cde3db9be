"""The times of a file's slices as UTC datetime64[s].

Non-standard calendars are read date by date: 360_day's 30 February has no counterpart and is refused. What
has no meaning as a time (climatologies, "day as %Y%m%d", a lone time stamp) is refused with the key that lets
the user state it.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import cftime
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from geo.errors import UserError

Times = NDArray[np.datetime64]

NAMES = ("time", "ocean_time", "time_counter", "valid_time", "Time", "TIME", "MT", "t")
OWN = {"standard", "gregorian", "proleptic_gregorian"}
EARLIEST = np.datetime64("1800-01-01", "s")  # earlier dates are those of climatologies and ideal runs, not of forecasts
STEPS = (3600, 1800, 1200, 900, 600, 300, 60, 10)  # [s] what times in single precision are rounded to


def variable_of(data: xr.Dataset, dims: Sequence[str], chosen: Mapping[str, Any]) -> str | None:
    """Return the name of the time variable that goes with a variable of these dimensions, None without one."""
    if "time" in chosen:
        if chosen["time"] not in data.variables:
            raise UserError(f'no time variable "{chosen["time"]}"; it holds {", ".join(map(str, data.variables))}')
        return str(chosen["time"])

    def rank(name: str) -> int:
        attributes = data[name].attrs
        return (
            4 * (str(attributes.get("standard_name", "")) == "time")
            + 2 * (" since " in str(attributes.get("units", "")))
            + (name in NAMES)
            + 8 * (data[name].dims == (name,))
        )

    fitting = [str(n) for n, v in data.variables.items() if v.ndim <= 1 and set(map(str, v.dims)) <= set(dims)]
    fitting = [
        n
        for n in fitting
        if str(data[n].attrs.get("standard_name", "")) == "time"
        or str(data[n].attrs.get("axis", "")) == "T"
        or " since " in str(data[n].attrs.get("units", ""))
        or n in NAMES
    ]
    fitting = [n for n in fitting if "reference" not in str(data[n].attrs.get("standard_name", ""))]
    lasting = [n for n in fitting if data[n].ndim == 1] or fitting
    return max(lasting, key=rank) if lasting else None


def decode(data: xr.Dataset, name: str) -> tuple[Times, list[str]]:
    """Return the times [UTC] of a time variable and remarks on how they were understood."""
    variable = data[name]
    values = np.atleast_1d(np.asarray(variable.values))
    units, notes = str(variable.attrs.get("units", "")), list[str]()
    calendar = str(variable.attrs.get("calendar", "standard")).lower()
    if "climatology" in variable.attrs:
        raise UserError(f'"{name}" is a climatology\'s time')
    if {"Itime", "Itime2"} <= set(data.variables):  # FVCOM: whole days and milliseconds, exact
        start = np.datetime64("1858-11-17", "ms")
        days = np.atleast_1d(data["Itime"].values).astype("timedelta64[D]")
        return _seconds(start + days + np.atleast_1d(data["Itime2"].values).astype("timedelta64[ms]")), notes
    if np.issubdtype(values.dtype, np.datetime64):
        return _seconds(values), notes
    if " since " not in units:
        raise UserError(f'"{name}" has units "{units}", which give no date')
    if not np.issubdtype(values.dtype, np.number):
        raise UserError(f'"{name}" holds no numbers')
    numbers = values.astype(np.float64)
    if not np.isfinite(numbers).all():
        raise UserError(f'"{name}" has missing values')
    try:
        dates = cftime.num2date(numbers, units.strip(), calendar, only_use_cftime_datetimes=True)
    except (ValueError, OverflowError, TypeError) as error:
        raise UserError(f'"{name}" has units "{units}" in calendar "{calendar}", not understood') from error
    try:
        times = _seconds(np.array([np.datetime64(date.isoformat(), "us") for date in np.ravel(dates)]))
    except ValueError as error:
        raise UserError(f'"{name}" holds dates of the calendar "{calendar}" that do not exist: {error}') from error
    if calendar not in OWN:
        notes.append(f'calendar "{calendar}": its dates are taken as they are written')
    if (times < EARLIEST).any():
        raise UserError(f'"{name}" starts in the year {str(times.min())[:4]}, which is no real date')
    if values.dtype == np.float32:
        grain = float(np.spacing(np.abs(values).max())) * _unit_seconds(units)
        if grain > 0.5:
            times, step = _snapped(times, grain)
            notes.append(f"times stored in single precision (to {grain:.0f} s): rounded to {step} s")
    return times, notes


def _seconds(times: NDArray[np.datetime64]) -> Times:
    rounded = times.astype("datetime64[us]") + np.timedelta64(500_000, "us")
    return rounded.astype("datetime64[s]")


def _unit_seconds(units: str) -> float:
    first = units.strip().lower().split(" ")[0].rstrip("s")
    return {"day": 86400.0, "d": 86400.0, "hour": 3600.0, "hr": 3600.0, "h": 3600.0, "minute": 60.0}.get(first, 1.0)


def _snapped(times: Times, grain: float) -> tuple[Times, int]:
    """Round to the coarsest step that moves no time by more than the precision it was stored with."""
    seconds = times.astype(np.int64)
    for step in STEPS:
        rounded = (seconds + step // 2) // step * step
        if np.abs(rounded - seconds).max() <= grain:
            return rounded.astype("datetime64[s]"), step
    return times, 1


def stated(times: Any, count: int, quantity: str) -> Times:
    """Return the times a user states: {"start", "interval"}, or one time for each of `count` slices."""
    if isinstance(times, Mapping):
        start, interval = np.datetime64(times["start"], "s"), np.timedelta64(times["interval"]).astype("m8[s]")
        result = start + interval * np.arange(count)
    else:
        result = np.asarray(times).astype("datetime64[s]").reshape(-1)
    if len(result) != count:
        raise UserError(f"[[{quantity}]] times states {len(result)} times, but the files hold {count} slices")
    if (np.diff(result) <= np.timedelta64(0, "s")).any():
        raise UserError(f"[[{quantity}]] times must increase")
    return np.asarray(result)
