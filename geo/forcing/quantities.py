"""Find the variables of a current, wind or Stokes drift: by CF standard name, then by usual name.

Attributes win over a name: a `u` whose standard_name or long_name is a wind's is not a current.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from geo.errors import UserError
from geo.forcing import level
from geo.forcing.quantity import QUANTITIES
from geo.grids import naming

Attributes = Mapping[str, Any]

# 9.9 to 99999: numbers of nines, which are often fill values
NINES = tuple(k * 10.0**p for k in (99, 999, 9999, 99999) for p in (-2, -1, 0) if k * 10**p > 1)

# suffixes of CF standard names of variables that describe another variable
MODIFIERS = (
    "_standard_error",
    "_number_of_observations",
    "_status_flag",
    "_quality_flag",
    "_detection_minimum",
)
GUST = re.compile(r"gust", re.IGNORECASE)  # in names
# such names without a descriptive attribute are accepted only for a quantity with `plain` = True
PLAIN = {"u", "v"}


@dataclass(frozen=True)
class Pair:
    """The two component variables of a quantity.

    axes: "true", "grid" or "?"; how: how they were found, for notes.
    """

    east: str
    north: str
    axes: str
    how: str


def _said(attributes: Attributes) -> str | None:
    """Return what the attributes say a variable is: a quantity, "other", or None if nothing."""
    standard = _standard_name(attributes, "standard_name")
    standard = "" if standard in ("unknown", "none") else standard  # GRIB converters write this
    text = standard or str(attributes.get("long_name", "")).lower()
    text = text.replace("_", " ")
    if standard.endswith(MODIFIERS):
        return "other"
    if not text:
        return None
    if re.search(
        r"\b(ice|stress|flux|transport|barotropic|bottom|gusts?|depth[- ]averaged?|vertical(ly)?|integrated|tidal|error"
        r"|uncertainty|variance|anomaly|anomalies|acceleration|std|rms|bias)\b",
        text,
    ):
        return "other"
    if "stokes" in text:
        return "stokes"
    wind = re.search(r"wind", text) is not None
    water = re.search(r"\b(sea ?water|water|current|currents|ocean)\b", text) is not None
    if wind != water:
        return "wind" if wind else "current"
    return "other" if standard else None


def _standard_name(attributes: Attributes, key: str) -> str:
    text = re.sub(r"\s*[(\[].*$", "", str(attributes.get(key, "")).strip().lower())
    # FVCOM: "eastward wind"; RTOFS: long_name = "eastward_sea_water_velocity (m/s) "
    return re.sub(r"\s+", "_", text)


def _prefer(
    names: list[str], attributes: Mapping[str, Attributes], quantity: str, east: bool
) -> list[str]:
    """Return the best of several variables with the same standard name.

    Variables at the surface are preferred, then winds at 10 m, then usual names.
    """
    if len(names) > 1:
        stated = {n: level.passes(n, attributes[n], quantity) for n in names}
        at_surface = [n for n in names if stated[n]]
        names = at_surface or [n for n in names if stated[n] is None] or names
    if len(names) > 1 and QUANTITIES[quantity].in_air:
        ten = [
            n
            for n in names
            if re.search(r"(?<!\d)10(?!\d)", f"{n} {attributes[n].get('long_name', '')}")
        ]
        names = ten or names
    if len(names) > 1:
        usual = [pair[0 if east else 1] for pair in QUANTITIES[quantity].usual_names]
        names = [n for n in usual if n in names][:1] or names
    return names


def _with_standard_name(variables: Mapping[str, Attributes], key: str, name: str) -> list[str]:
    """Return the variables with a standard name, except gusts, which some files label as winds."""
    return [
        n for n, a in variables.items() if _standard_name(a, key) == name and not GUST.search(n)
    ]


def _by_standard_name(quantity: str, variables: Mapping[str, Attributes], key: str) -> Pair | None:
    halves: list[str] = []
    for east_name, north_name, axes in QUANTITIES[quantity].standard_names:
        candidates = [
            _prefer(_with_standard_name(variables, key, name), variables, quantity, east)
            for name, east in ((east_name, True), (north_name, False))
        ]
        if not candidates[0] or not candidates[1]:
            halves += candidates[0] + candidates[1]
            continue
        for names in candidates:
            if len(names) > 1:
                raise UserError(
                    f"several variables are the {QUANTITIES[quantity].spoken}: {', '.join(sorted(names))}; "
                    f"choose with [[{quantity}]] variables = {{ east = ..., north = ... }}"
                )
        return Pair(candidates[0][0], candidates[1][0], axes, f"{key} {east_name}")
    return None


def _by_common_name(quantity: str, variables: Mapping[str, Attributes]) -> Pair | None:
    folded = {name.lower(): name for name in variables}
    for east, north, axes in QUANTITIES[quantity].usual_names:
        pair = [name if name in variables else folded.get(name.lower()) for name in (east, north)]
        if pair[0] is None or pair[1] is None:
            continue
        statements = {_said(variables[name]) for name in pair if name is not None}
        if QUANTITIES[quantity].scalar:
            statements = set()  # `_said` knows velocities
        if statements - {None, quantity} or (
            east in PLAIN and not QUANTITIES[quantity].plain and None in statements
        ):
            continue
        return Pair(pair[0], pair[1], axes, "name")
    return None


def search(quantity: str, variables: Mapping[str, Attributes]) -> Pair | None:
    """Return the variables of a quantity by standard name, then by usual name; None if absent."""
    return (
        _by_standard_name(quantity, variables, "standard_name")
        or _by_standard_name(quantity, variables, "long_name")
        or _by_common_name(quantity, variables)
    )


# keys of a source's `variables` in a case
KEYS = (
    "east",
    "north",
    "axes",
    "lon",
    "lat",
    "time",
    "angle",
    "mask",
    "crs",
    "x",
    "y",
    "stagger",
)


def find(
    quantity: str, variables: Mapping[str, Attributes], chosen: Mapping[str, Any], name: str
) -> Pair:
    """Return the two component variables of a quantity.

    Args:
        quantity: one of QUANTITIES.
        variables: name -> attributes of all variables.
        chosen: the case's choice, {"east": ..., "north": ..., "axes": "true" | "grid"}, which
            overrides everything.
        name: of the source, for messages.

    Raises:
        UserError: the quantity is absent or ambiguous; the message lists what the file holds.
    """
    axes = str(chosen.get("axes", ""))
    if axes not in ("", "true", "grid"):
        raise UserError(
            f'[[{quantity}]] variables.axes = "{axes}": allowed are "true" (east and north) and "grid"'
        )
    if "east" in chosen or "north" in chosen:
        for key in ("east", "north"):
            if key not in chosen:
                raise UserError(f"[[{quantity}]] variables names one component; set {key} as well")
            if chosen[key] not in variables:
                raise UserError(
                    f'{name}: no variable "{chosen[key]}"; it holds {_list_names(variables)}; set [[{quantity}]] variables'
                )
        east, north = str(chosen["east"]), str(chosen["north"])
        names = QUANTITIES[quantity]
        standard = {e: a for e, _, a in (*names.standard_names, *names.usual_names)}
        axes_named = (
            standard.get(_standard_name(variables[east], "standard_name"))
            or standard.get(east)
            or "?"
        )
        return Pair(east, north, axes or axes_named, "the case's own choice")
    pair = search(quantity, variables)
    if pair is None:
        raise UserError(_absence_message(quantity, variables, name))
    return Pair(pair.east, pair.north, axes or pair.axes, pair.how)


def _list_names(variables: Mapping[str, Attributes]) -> str:
    names = sorted(n for n in variables if not naming.of_grid(n))
    return ", ".join(names[:12]) + (", ..." if len(names) > 12 else "") if names else "no variable"


def _absence_message(quantity: str, variables: Mapping[str, Attributes], name: str) -> str:
    where = f"set [[{quantity}]] files to one that does, or [[{quantity}]] variables = {{ east = ..., north = ... }}"
    known = (*QUANTITIES[quantity].standard_names, *QUANTITIES[quantity].usual_names)
    components = (
        {name for name, _, _ in known},
        {north for _, north, _ in known},
    )
    for present, lacking, side in ((0, 1, "northward"), (1, 0, "eastward")):
        lone = [
            n
            for n, a in variables.items()
            if not GUST.search(n)
            and (
                _standard_name(a, "standard_name") in components[present]
                or (
                    n in components[present]
                    and _said(a) in (None, quantity)
                    and (n not in PLAIN or QUANTITIES[quantity].plain)
                )
            )
        ]
        if lone and not any(n in components[lacking] for n in variables):
            return (
                f"{name}: {lone[0]} is one component of the {QUANTITIES[quantity].spoken}, but the {side} one is "
                f"missing; name the files of both in [[{quantity}]] files, or set [[{quantity}]] variables"
            )
    held_instead = []
    for other in QUANTITIES:
        pair = search(other, variables) if other != quantity else None
        if pair is not None:
            held_instead.append(f"{QUANTITIES[other].spoken} ({pair.east}, {pair.north})")
    what = " and ".join(held_instead) if held_instead else _list_names(variables)
    return f"no {QUANTITIES[quantity].spoken} in the {QUANTITIES[quantity].spoken} file {name}: it holds {what}; {where}"
