"""Ambient noise: one level, a table by true bearing, or a netCDF file by time and bearing."""

import os
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drift.evidence.sensors import circle, table_file, table_values
from drift.evidence.sensors.records import Noise
from drift.evidence.sensors.table_file import Label
from geo.array import Array
from geo.errors import UserError

MEANT = re.compile(r"noise|ambient|^(nl|level)$", re.I)
LEAST, MOST = 0.0, 200.0  # [dB re 1 uPa^2/Hz, or in a band]
AGREE = 0.1  # [dB] largest difference between the bearings 0 and 360 if a table has both
NONE = np.empty(0, "datetime64[s]")
QUARTER = 90.0  # [deg] widest gap between bearings: noise is often known by quarters of the horizon
REMEDY = "mend its attribute units, or set variable to that of the noise"


def constant(level: float, *, name: str = "noise") -> Noise:
    """Return noise of one level [dB] for all bearings and times."""
    table = np.full((1, 1), level, np.float64)
    _check_levels(table, (), name)
    return Noise(np.zeros(1), table.astype(np.float32), NONE)


def of_table(rows: Sequence[Sequence[float]], *, name: str = "noise") -> Noise:
    """Return noise from a table; a single row holds all round.

    Args:
        rows: [true bearing in degrees, level in dB].
        name: start of error messages.

    Raises:
        UserError: values missing or out of range, or bearings that do not close the circle.
    """
    pairs = np.array([list(row) for row in rows if len(row) == 2], np.float64).reshape(-1, 2)
    if len(pairs) != len(rows) or not len(rows):
        raise UserError(
            f"{name}: a table of noise has rows of [true bearing in degrees, level in dB], and at least one"
        )
    bearing, level = pairs.T
    _check_levels(level, (("bearing", bearing, " deg"),), name)
    radians, table = circle.close_circle(bearing, level[None], 1, name, AGREE, "dB", QUARTER)
    return Noise(radians, table.astype(np.float32), NONE)


def read_noise(
    path: str | os.PathLike[str],
    *,
    variable: str | None = None,
    select: Mapping[str, Any] | None = None,
    units: Mapping[str, str] | None = None,
    name: str | None = None,
) -> Noise:
    """Return the noise of a netCDF file over bearing, and optionally time.

    The arguments are those of `losses.read_losses`.
    """
    asked = table_file.asked_for(path, name, variable, select, units)
    with table_file.open_table(path) as data:
        found = table_file.find(data, asked, MEANT, "noise", ("time", "bearing"))
        when = table_values.times(found)
        bearing = table_values.axis(found, "bearing")
        dims = [found.kinds[k] for k in ("time", "bearing") if k in found.kinds]
        table = table_file.values(found, dims).reshape(-1, bearing.size)
    labels = (("time", when if when.size else np.arange(1, 2), ""), ("bearing", bearing, " deg"))
    unit = table_values.unit_of(found, found.variable)
    table_values.check_whole(table, labels, asked.name)
    table_values.check_decibels(table, unit, MOST, LEAST, "noise level", asked.name, REMEDY)
    _check_levels(table, labels, asked.name)
    radians, table = circle.close_circle(bearing, table, 1, asked.name, AGREE, "dB", QUARTER)
    return Noise(radians, np.ascontiguousarray(table, np.float32), when)


def _check_levels(table: Array, labels: Sequence[Label], name: str) -> None:
    """Reject levels out of range."""
    wrong = ~((table >= LEAST) & (table <= MOST))
    if wrong.any():
        place = f" at {table_values.where(wrong, labels)}" if labels else ""
        raise UserError(
            f"{name}: a noise level of {table[wrong][0]:.6g} dB{place}; allowed are {LEAST:g} to {MOST:g} dB re 1 uPa^2/Hz: "
            "mend it"
        )
