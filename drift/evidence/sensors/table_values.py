"""Axes and values of sensor tables: units, order, times, and checks of values.

Nothing is guessed: a length without a unit is rejected.
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
    """Return the unit of a variable, as stated by the user or else by the file."""
    return str(found.asked.units.get(variable, found.data[variable].attrs.get("units", ""))).strip()


def axis(found: Found, kind: str) -> Array:
    """Return the values of a table's bearings [deg] or ranges [m], in the file's order.

    Args:
        found: the table.
        kind: "bearing" or "range".

    Raises:
        UserError: no coordinate, missing values, or an unknown unit.
    """
    coordinate = found.coordinates[kind]
    if kind == "bearing" and found.data.sizes[found.kinds[kind]] == 1:
        return np.zeros(1)  # a single bearing holds all round
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
    if unit.lower() not in allowed or unit == "M":  # on charts M is nautical miles, not metres
        had = f'in "{unit}"' if unit else "in no unit"
        raise UserError(
            f'{found.name}: the {kind}s "{coordinate}" are {had}; allowed are {SPOKEN[kind]}: mend their attribute units, or '
            f'set units = {{ {coordinate} = "..." }}'
        )
    return given.astype(np.float64) * allowed[unit.lower()]


def ranges(found: Found) -> tuple[Array, NDArray[np.intp]]:
    """Return the ranges [m], ascending, and their indices in the file."""
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
    """Return a table's times [UTC], ascending; empty with one time or without times."""
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
    """Reject a table with missing values.

    Args:
        table: the values.
        labels: (name, values, unit) of each dimension.
        name: start of the error message.
        hint: end of the error message.

    Raises:
        UserError: a value is missing.
    """
    missing = ~np.isfinite(table)
    if not missing.any():
        return
    raise UserError(
        f"{name}: {int(missing.sum()):,} of {table.size:,} values are missing, first at {where(missing, labels)}; "
        f"fill them in the file{hint}"
    )


def where(wrong: NDArray[np.bool_], labels: Sequence[Label]) -> str:
    """Return the position of the first true value in words."""
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
    """Reject a table whose unit is not dB, or with values above the allowed ones.

    Args:
        table: the values.
        unit: of the values, "" if unknown.
        most: largest allowed value [dB].
        least: smallest allowed value [dB], for the message.
        what: the quantity in words.
        name: start of error messages.
        remedy: what to change if the unit is wrong.

    Raises:
        UserError: the unit is not dB, or a value is too large.
    """
    if unit and not DECIBEL.match(unit):
        raise UserError(f'{name}: the {what} is in "{unit}"; allowed is dB: {remedy}')
    if table.max() > most:
        raise UserError(
            f"{name}: a {what} of {table.max():.6g} dB; allowed are {least:g} to {most:g}: is it a fill value that the file "
            f"does not declare? Mend the file"
        )
