"""Forecasts along two dimensions, start of the run and lead time, converted to one time axis.

Each run becomes a file with valid times. Where runs overlap, the later one is used.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from geo import notation
from geo.errors import UserError
from geo.forcing.times import clock, epoch

File = tuple[str, xr.Dataset]

VALID = "valid time of a run"  # name of the new time variable; no file has a name with blanks
SECONDS = "seconds since 1970-01-01"
LEADS = re.compile(
    r"^(step|leads?|lead_?times?|forecast_?(hour|time|period)s?|fhour|fcst_?hour|prediction_timedelta|tau|leadhour)$",
    re.IGNORECASE,
)
REFERENCES = re.compile(
    r"^((forecast_)?(reference|ref|init|initial|initiali[sz]ation|analysis|base|cycle|run)(_?time|_?date)?|init"
    r"|forecast_reference_time|time)$",
    re.IGNORECASE,
)


def unrolled(
    files: Sequence[File], name: str, quantity: str, chosen: Mapping[str, Any], times: Any
) -> tuple[Sequence[File], Mapping[str, Any], list[str]]:
    """Return files in which a variable has a single time axis, the remaining keys, and notes.

    Files without runs are returned unchanged.

    Args:
        files: paths and datasets.
        name: of the variable.
        quantity: for messages.
        chosen: `variables` of the case, which may choose a run by its index.
        times: `times` of the case.
    """
    result: list[File] = []
    notes: list[str] = []
    left = dict(chosen)
    for path, data in files:
        found = _run_dims(data, name, chosen) if name in data.variables else None
        if found is None:
            result.append((path, data))
            continue
        reference, lead = found
        if reference is not None and reference in chosen:
            data = data.isel(
                {reference: [_run_index(data, reference, chosen[reference], quantity)]}
            )
            left.pop(reference, None)
        own, remarks = _split_runs(path, data, reference, lead, quantity=quantity, times=times)
        result += own
        notes += [r for r in remarks if r not in notes]
    return result, left, notes


def _run_index(data: xr.Dataset, dim: str, value: Any, quantity: str) -> int:
    text, size = str(value).strip(), int(data.sizes[dim])
    if not text.isdigit() or int(text) >= size:
        raise UserError(f"[[{quantity}]] variables.{dim} = {text}: it is an index, 0 to {size - 1}")
    return int(text)


def _run_dims(
    data: xr.Dataset, name: str, chosen: Mapping[str, Any]
) -> tuple[str | None, str] | None:
    """Return the dimension of runs (None for a single run) and that of lead times.

    None if the variable has no lead times.
    """
    dims = [str(d) for d in data[name].dims]
    leads = [d for d in dims if d not in chosen and _is_lead(data, d)]
    if "time" in chosen or len(leads) != 1:
        return None
    lead = leads[0]
    references = [d for d in dims if d != lead and _is_reference(data, d)]
    if len(references) == 1:
        return references[0], lead
    if references or any(
        data[n].dims == (lead,) and _is_valid(data, str(n)) for n in data.variables
    ):
        return None  # valid times lie along the lead already
    return (None, lead) if _single_run_start(data) is not None else None


def _is_lead(data: xr.Dataset, dim: str) -> bool:
    attributes = data[dim].attrs if dim in data.variables else {}
    if epoch.is_shifted(str(attributes.get("units", ""))):
        return False
    return str(attributes.get("standard_name", "")) == "forecast_period" or bool(LEADS.match(dim))


def _is_reference(data: xr.Dataset, dim: str) -> bool:
    attributes = data[dim].attrs if dim in data.variables else {}
    return str(attributes.get("standard_name", "")) == "forecast_reference_time" or bool(
        REFERENCES.match(dim)
    )


def _is_valid(data: xr.Dataset, name: str) -> bool:
    attributes = data[name].attrs
    timely = str(attributes.get("standard_name", "")) == "time" or name in (
        "valid_time",
        "validtime",
        "time",
    )
    return timely and epoch.is_shifted(str(attributes.get("units", "")))


def _single_run_start(data: xr.Dataset) -> str | None:
    """Return the variable with the start of a file's only run; None if there is none."""
    found = [
        str(n)
        for n, v in data.variables.items()
        if v.size == 1 and v.ndim <= 1 and _is_reference(data, str(n))
    ]
    found = [n for n in found if epoch.is_shifted(str(data[n].attrs.get("units", "")))]
    return found[0] if len(found) == 1 else None


def _split_runs(
    path: str, data: xr.Dataset, reference: str | None, lead: str, *, quantity: str, times: Any
) -> tuple[list[File], list[str]]:
    """Return one file for each run, without the slices that a later run has."""
    count = int(data.sizes[reference]) if reference else 1
    if clock.states_times(times):  # the case states the times
        if count > 1:
            raise UserError(
                f"{path}: times are stated for one run, and it holds {count} along {reference}; choose one by its index, "
                f"[[{quantity}]] variables.{reference}"
            )
        part = data.isel({reference: 0}) if reference else data
        known = lead in data.variables and np.issubdtype(data[lead].dtype, np.number)
        since = data[lead].values if known else np.arange(data.sizes[lead])
        stamps = xr.Variable(
            (lead,), np.asarray(since, np.float64), {"units": SECONDS, "standard_name": "time"}
        )
        return [(path, part.drop_vars(_time_variables(part)).assign({VALID: stamps}))], []
    try:
        valid = _valid_times(data, reference, lead, clock.zone(times))
    except UserError as error:
        raise UserError(
            f"{path}: {error}; choose a run by its index, [[{quantity}]] variables.{reference or lead}, and state "
            f"[[{quantity}]] times = {{ start = ..., every = ... }}"
        ) from error
    starts = np.argsort(valid[:, 0], kind="stable")[::-1]
    taken: set[int] = set()
    files: list[File] = []
    for run in starts:
        own = valid[run].astype(np.int64)
        steps = [k for k in range(len(own)) if int(own[k]) not in taken]
        taken |= {int(t) for t in own}
        if not steps:
            continue
        part = data.isel({lead: steps} | ({reference: int(run)} if reference else {}))
        stamps = xr.Variable(
            (lead,), own[steps].astype(np.float64), {"units": SECONDS, "standard_name": "time"}
        )
        files.append((path, part.drop_vars(_time_variables(part)).assign({VALID: stamps})))
    note = f"valid times from {reference or _single_run_start(data)} and {lead}"
    if count > 1:
        note += f", {count} runs from {notation.format_dtg(valid[starts[-1], 0])} to {notation.format_dtg(valid[starts[0], 0])}: "
        note += "where they overlap the later run is taken"
    return files[::-1], [note]


def _time_variables(data: xr.Dataset) -> list[str]:
    """Return the variables that could be mistaken for the valid times."""
    return [
        str(n)
        for n, v in data.variables.items()
        if v.ndim <= 1 and epoch.is_shifted(str(v.attrs.get("units", "")))
    ]


def _valid_times(
    data: xr.Dataset, reference: str | None, lead: str, zone: int | None
) -> clock.Times:
    """Return the valid times of all runs [UTC], shape (runs, steps).

    They come from the file, otherwise from the start of the run and the lead time.
    """
    if reference:
        for name in map(str, data.variables):
            if set(data[name].dims) == {reference, lead} and _is_valid(data, name):
                held = data[name].transpose(reference, lead)
                numbers = np.asarray(held.values, np.float64)
                if np.isfinite(numbers).all():
                    calendar = str(held.attrs.get("calendar", "standard")).lower()
                    return clock.dates(numbers, str(held.attrs["units"]), calendar, name, zone)
    start = reference if reference in data.variables else _single_run_start(data)
    if start is None or lead not in data.variables:
        raise UserError(f"nothing says when along {reference or lead} its runs begin")
    starts, _ = clock.decode(data, start, zone)
    since = data[lead]
    text = str(since.attrs.get("units", "")).strip()
    seconds = epoch.seconds_of(text)
    if seconds is None:
        raise UserError(f'"{lead}" has units "{text}", which are no unit of time')
    steps = np.round(np.asarray(since.values, np.float64) * seconds).astype("timedelta64[s]")
    return np.asarray(starts[:, None] + steps[None, :])
