"""Hazards of distress by place, or depths that are hazardous, from a netCDF file."""

import os
import re
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from drift.engine.motion.scenario import Hazard
from drift.evidence.sensors import place_file, table_file, table_values
from drift.evidence.sensors.table_file import Found, Label
from geo.array import Array
from geo.errors import UserError

MEANT = re.compile(r"hazard|risk|rate|likelihood", re.I)
DEPTHS = re.compile(r"depth|bathym|elevation|altitude|height|topo", re.I)
METRES = ("m", "metre", "metres", "meter", "meters")
UP = re.compile(r"elevation|altitude|height|topography", re.I)
DOWN = re.compile(r"depth|bathymetry|deptho", re.I)
Positive = Literal["up", "down"]


def read_hazard(
    path: str | os.PathLike[str],
    *,
    variable: str | None = None,
    units: Mapping[str, str] | None = None,
    depth: float | None = None,
    deeper: float = 0.0,
    positive: Positive | None = None,
    outside: float | None = None,
) -> Hazard:
    """Return the hazard of a netCDF file by place, and by time if it changes.

    Args:
        path: of the file.
        variable: its name, if the file has several candidates.
        units: units by variable, if its attribute is absent or wrong.
        depth: the file has depths [m], and the hazard is 1 where they are less; None: it has
            hazards.
        deeper: hazard elsewhere.
        positive: whether depths count up (elevations) or down; None: as the file says.
        outside: hazard where and when the file has no value; None: missing values are rejected.

    Raises:
        UserError: the file has no valid hazard, in one line.
    """
    asked = table_file.asked_for(path, None, variable, None, units)

    def checked(table: Array, found: Found, labels: Sequence[Label]) -> Array:
        hint = ", or set outside to the hazard that holds there"
        if outside is None:
            table_values.check_whole(table, labels, asked.name, hint)
        if depth is None:
            return _hazards(table, found, labels)
        return _depths(table, found, positive)

    meant, what = (MEANT, "hazard") if depth is None else (DEPTHS, "depth")
    what = f"{what} over longitude and latitude"
    with table_file.open_table(path) as data:
        places = place_file.read_places(data, asked, {}, meant, what, checked)
    name = asked.name
    return Hazard(None, name, places.grid, places.values, places.times, depth, deeper, outside)


def _hazards(table: Array, found: Found, labels: Sequence[Label]) -> Array:
    """Return hazards of any unit; reject negative ones, and levels."""
    unit = table_values.unit_of(found, found.variable)
    if table_values.DECIBEL.match(unit):
        raise UserError(
            f'{found.name}: the hazard "{found.variable}" is in "{unit}"; give it as a number or a rate, '
            "in proportion to how likely distress is"
        )
    wrong = (table < 0) | np.isinf(table)
    if wrong.any():
        raise UserError(
            f'{found.name}: {int(wrong.sum()):,} of {table.size:,} values of "{found.variable}" are no hazard, first '
            f"{float(table[wrong][0]):.6g} at {table_values.where(wrong, labels)}; allowed are 0 and above: mend the file"
        )
    return table


def _depths(table: Array, found: Found, positive: Positive | None) -> Array:
    """Return depths [m], positive down."""
    unit, name = table_values.unit_of(found, found.variable), found.variable
    if unit.lower() not in METRES:
        raise UserError(
            f'{found.name}: "{name}" is in "{unit}"; depths are in m: mend its attribute units, or set '
            f'units = {{ {name} = "m" }}'
        )
    attributes = found.data[name].attrs
    stated = positive or str(attributes.get("positive", "")).lower()
    if stated not in ("up", "down"):
        words = f"{name} {attributes.get('standard_name', '')} {attributes.get('long_name', '')}"
        up, down = bool(UP.search(words)), bool(DOWN.search(words))
        if up == down:
            raise UserError(
                f'{found.name}: "{name}" does not say whether it is positive up (elevation) or down (depth); set '
                'positive = "up" or "down"'
            )
        stated = "up" if up else "down"
    return -table if stated == "up" else table
