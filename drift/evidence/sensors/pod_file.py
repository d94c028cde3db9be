"""Probability of detection by place, or by bearing and range, from a netCDF file.

Over places, the file may have any grid that forcing may have: 0..360 or descending axes, uneven
axes, a projection, a curved grid or triangles. Values on an even grid of longitude and latitude are
used as they are; others are interpolated linearly on an even grid that is twice as fine, and are 0
outside their own domain. A table of bearings and ranges is read like a table of losses.
"""

import math
import os
import re
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import xarray as xr

from drift.evidence.sensors import circle, place_file, table_file, table_values
from drift.evidence.sensors.records import PodGrid
from drift.evidence.sensors.table_file import Asked, Found
from geo.array import Array
from geo.errors import UserError

MEANT = re.compile(r"\bp(o)?d\b|^(p|pod|pd|detection)$|probability|detection|blip.?scan", re.I)
SHARES = ("", "1", "unitless", "dimensionless", "probability", "fraction")
PERCENT = ("%", "percent", "per cent", "per_cent", "percentage")
ROUNDING = 1e-4  # values that far below 0 or above 1 are rounding errors
AGREE = 1e-3  # largest difference between the bearings 0 and 360 if a file has both
Gaps = Literal["refuse", "blind"]


def read_pod(
    path: str | os.PathLike[str],
    *,
    per: float,
    variable: str | None = None,
    select: Mapping[str, Any] | None = None,
    units: Mapping[str, str] | None = None,
    coordinates: Mapping[str, str] | None = None,
    gaps: Gaps = "refuse",
    name: str | None = None,
) -> PodGrid:
    """Return the POD of a netCDF file over (time, lat, lon) or (time, bearing, range).

    The dimension of time is optional.

    Args:
        path: of the file.
        per: duration of searching for which the POD holds [s]; NaN: the duration of the watch.
        variable: name of the POD, if the file has several candidates.
        select: value of each further dimension with several values.
        units: units by variable, if its attribute is absent or wrong.
        coordinates: names of lon, lat or the reference system (crs), if they are not recognized.
        gaps: "blind" replaces missing values by 0; "refuse" rejects them.
        name: start of error messages, by default the name of the file.

    Raises:
        UserError: the file has no valid POD, in one line.
    """
    asked = table_file.asked_for(path, name, variable, select, units)
    if not (math.isnan(per) or 0.0 < per < math.inf):
        raise UserError(
            f"{asked.name}: per = {per:g} s; it is a time above 0, or left out: set per"
        )
    if gaps not in ("refuse", "blind"):
        raise UserError(
            f'{asked.name}: gaps = "{gaps}"; allowed are "refuse" and "blind": set gaps'
        )
    with table_file.open_table(path) as data:
        polar = _polar(data, asked)
        if polar is not None:
            return _round_sensor(polar, per, gaps)
        return _over_places(data, asked, coordinates or {}, per, gaps)


def _polar(data: xr.Dataset, asked: Asked) -> Found | None:
    """Return the table of a file by bearing and range.

    Return None if there is none, or if the user names another variable.
    """
    kinds = ("time", "bearing", "range")
    if asked.variable is not None and asked.variable in data.variables:
        if "range" not in table_file.dimensions(data, asked.variable, kinds)[0]:
            return None
    elif asked.variable is None and not any(
        "range" in table_file.dimensions(data, str(n), kinds)[0]
        for n, v in data.variables.items()
        if v.dims != (n,)
    ):
        return None
    return table_file.find(data, asked, MEANT, "POD", kinds)


def _round_sensor(found: Found, per: float, gaps: Gaps) -> PodGrid:
    """Return the POD of a table by bearing and range."""
    when, name = table_values.times(found), found.name
    metres, order = table_values.ranges(found)
    bearing = table_values.axis(found, "bearing") if "bearing" in found.kinds else np.zeros(1)
    dims = [found.kinds[k] for k in ("time", "bearing", "range") if k in found.kinds]
    table = table_file.values(found, dims).reshape(-1, bearing.size, metres.size)[:, :, order]
    labels = (
        ("time", place_file.moments(when), ""),
        ("bearing", bearing, " deg"),
        ("range", metres, " m"),
    )
    table = _probabilities(table, table_values.unit_of(found, found.variable), labels, name, gaps)
    radians, table = circle.close_circle(bearing, table, 1, name, AGREE, "")
    pod = np.ascontiguousarray(table, np.float32)
    return PodGrid(pod, when, bearing=radians, range=metres, per=per, name=name)


def _over_places(
    data: xr.Dataset, asked: Asked, coordinates: Mapping[str, str], per: float, gaps: Gaps
) -> PodGrid:
    """Return the POD of a table by place, on an even grid."""
    what = "POD over longitude and latitude, or bearing and range"

    def checked(table: Array, found: Found, labels: Sequence[table_file.Label]) -> Array:
        unit = table_values.unit_of(found, found.variable)
        return _probabilities(table, unit, labels, asked.name, gaps)

    places = place_file.read_places(data, asked, coordinates, MEANT, what, checked)
    lat, lon = np.radians(places.grid.lat), np.radians(places.grid.lon)
    pod = np.clip(np.nan_to_num(places.values, nan=0.0), 0.0, 1.0)
    return PodGrid(pod, places.times, lat=lat, lon=lon, per=per, name=asked.name)


def _probabilities(
    table: Array, unit: str, labels: Sequence[table_file.Label], name: str, gaps: Gaps
) -> Array:
    """Return POD from 0 to 1; reject values that are not probabilities.

    Missing values become 0 if gaps is "blind", and are rejected otherwise.
    """
    if unit.lower() in PERCENT:
        table = table / 100.0
    elif unit.lower() not in SHARES:
        raise UserError(
            f'{name}: the POD is in "{unit}"; allowed are 1 and %: mend its attribute units, or set variable'
        )
    if gaps == "blind":
        table = np.where(np.isnan(table), 0.0, table)
    table_values.check_whole(
        table,
        labels,
        name,
        "" if gaps == "blind" else ', or set gaps = "blind": nothing is detected there',
    )
    wrong = (table < -ROUNDING) | (table > 1.0 + ROUNDING)
    if wrong.any():
        first = float(table[wrong][0])
        percent = table.min() >= 0.0 and table.max() <= 100.0 and unit.lower() not in PERCENT
        remedy = (
            ': is it in per cent? Set its attribute units to "%"' if percent else ": mend the file"
        )
        raise UserError(
            f"{name}: {int(wrong.sum()):,} of {table.size:,} values are no probability, first {first:.6g} at "
            f"{table_values.where(wrong, labels)}; allowed are 0 to 1{remedy}"
        )
    return np.clip(table, 0.0, 1.0)
