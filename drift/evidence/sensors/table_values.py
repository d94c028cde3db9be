"""Axes and values of sensors' tables: units, order, times, and the values that no table may have.

Nothing is guessed where a guess could be wrong: a length without a unit is refused.
"""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drift.evidence.sensors.table_file import ANGLES, Found, Label
from geo.array import Array
from geo.errors import UserError
from geo.forcing.times import clock

LENGTHS = {  # [m]
    "m": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "metre": 1.0,
    "metres": 1.0,
    "km": 1000.0,
    "kilometer": 1000.0,
    "kilometers": 1000.0,
    "kilometre": 1000.0,
    "kilometres": 1000.0,
    "nmi": 1852.0,
    "nm": 1852.0,
    "nautical_mile": 1852.0,
    "nautical_miles": 1852.0,
    "nautical mile": 1852.0,
    "nautical miles": 1852.0,
    "international_nautical_mile": 1852.0,
    "international_nautical_miles": 1852.0,
    "kyd": 914.4,
    "yd": 0.9144,
    "yard": 0.9144,
    "yards": 0.9144,
}
UNITS = {"bearing": ANGLES, "range": LENGTHS}
SPOKEN = {"bearing": "degree or rad", "range": "m, km or nmi"}
DECIBEL = re.compile(r"^(db|decibels?)(\s*(re\b|rel\b|\(|//|@).*)?$", re.I)  # not dB/km


def unit_of(found: Found, variable: str) -> str:
    """Return the unit of a variable: that which the user states, else the file's."""
    return str(found.asked.units.get(variable, found.data[variable].attrs.get("units", ""))).strip()


def axis(found: Found, kind: str) -> Array:
    """Return the values of a table's bearings [deg] or ranges [m], in the file's order."""
    coordinate = found.coordinates[kind]
    if kind == "bearing" and found.data.sizes[found.kinds[kind]] == 1:
        return np.zeros(1)  # it holds all round, whatever it is
    if not coordinate:
        raise UserError(
            f'{found.name}: the dimension "{found.kinds[kind]}" has no coordinate; give the file a variable '
            f"{found.kinds[kind]}({found.kinds[kind]}) with the {kind}s"
        )
    given = np.asarray(found.data[coordinate].values)
    if not np.issubdtype(given.dtype, np.number):
        raise UserError(
            f'{found.name}: "{coordinate}" holds no numbers; {kind}s are numbers in {SPOKEN[kind]}'
        )
    if not np.isfinite(given).all():
        raise UserError(
            f'{found.name}: {np.sum(~np.isfinite(given))} of the {kind}s "{coordinate}" are missing; mend the file'
        )
    unit = unit_of(found, coordinate)
    allowed = UNITS[kind]
    if unit.lower() not in allowed or unit == "M":  # nautical miles on charts, and no metres
        had = f'in "{unit}"' if unit else "in no unit"
        raise UserError(
            f'{found.name}: the {kind}s "{coordinate}" are {had}; allowed are {SPOKEN[kind]}: mend their attribute units, or '
            f'set units = {{ {coordinate} = "..." }}'
        )
    return given.astype(np.float64) * allowed[unit.lower()]


def ranges(found: Found) -> tuple[Array, NDArray[np.intp]]:
    """Return the ranges [m], ascending, and their places in the file."""
    metres, name = axis(found, "range"), found.name
    coordinate = found.coordinates["range"]
    order = np.argsort(metres, kind="stable")
    metres = metres[order]
    if metres[0] < 0:
        raise UserError(
            f'{name}: the range {metres[0]:g} m is below 0 (in "{coordinate}"); ranges start at 0: mend the file'
        )
    if metres.size < 2:
        raise UserError(f'{name}: "{coordinate}" has one range only; at least two are needed')
    twice = np.flatnonzero(np.diff(metres) <= 0)
    if twice.size:
        raise UserError(
            f'{name}: the range {metres[twice[0]]:g} m stands twice (in "{coordinate}"); mend the file'
        )
    return metres, order


def times(found: Found) -> NDArray[np.datetime64]:
    """Return a table's times [UTC], ascending; none where it has one time or no dimension of time."""
    if "time" not in found.kinds or found.data.sizes[found.kinds["time"]] == 1:
        return np.empty(0, "datetime64[s]")
    variable = found.coordinates["time"]
    try:
        when = clock.decode(found.data, variable)[0]
    except UserError as error:
        raise UserError(
            f"{found.name}: {error}; mend its units, which are like hours since 2026-01-01 00:00"
        ) from error
    late = np.flatnonzero(np.diff(when) <= np.timedelta64(0, "s"))
    if late.size:
        k = int(late[0])
        raise UserError(
            f'{found.name}: times do not increase: {when[k]}Z is followed by {when[k + 1]}Z (in "{variable}"); mend the file'
        )
    return when


def check_whole(table: Array, labels: Sequence[Label], name: str, hint: str = "") -> None:
    """Refuse a table with missing values; labels: (word, values, unit) of each dimension."""
    missing = ~np.isfinite(table)
    if not missing.any():
        return
    raise UserError(
        f"{name}: {int(missing.sum()):,} of {table.size:,} values are missing, first at {where(missing, labels)}; "
        f"fill them in the file{hint}"
    )


def where(wrong: NDArray[np.bool_], labels: Sequence[Label]) -> str:
    """Return in words where the first of some values stands."""
    index = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
    words = list[str]()
    for k, (word, along, unit) in zip(index, labels, strict=True):
        if wrong.shape[len(words)] == 1 and word in ("place", "time"):
            words.append("")
            continue
        value = along[k]
        text = f"{value}Z" if isinstance(value, np.datetime64) else f"{value:.6g}"
        words.append(f"{word} {text}{unit}")
    return ", ".join(filter(None, words))


def check_decibels(
    table: Array, unit: str, most: float, least: float, what: str, name: str, remedy: str
) -> None:
    """Refuse a table that is not in dB, or whose values no such quantity has; least, most: allowed
    [dB].
    """
    if unit and not DECIBEL.match(unit):
        raise UserError(f'{name}: the {what} is in "{unit}"; allowed is dB: {remedy}')
    if table.max() > most:
        raise UserError(
            f"{name}: a {what} of {table.max():.6g} dB; allowed are {least:g} to {most:g}: is it a fill value that the file "
            f"does not declare? Mend the file"
        )
