"""Names and attributes that identify longitudes, latitudes and other variables of a grid.

CF attributes are compared directly. cf_xarray (0.11.3) relies on them alone: it finds the component
pair in 11 of the 21 model files that our cases use, and longitudes in 10. The other files need
usual names anyway.
"""

import re
from collections.abc import Mapping
from typing import Any

LON = re.compile(
    r"^(lon(gitude)?s?|lon_.*|nav_lon.*|lonc|x_?lon.*|glam[tuvf]|longitude_.*|.*_(node|face)_(x|lon(gitude)?))$",
    re.I,
)
LAT = re.compile(
    r"^(lat(itude)?s?|lat_.*|nav_lat.*|latc|x_?lat.*|gphi[tuvf]|latitude_.*|.*_(node|face)_(y|lat(itude)?))$",
    re.I,
)
EAST_UNITS = re.compile(r"^degrees?_?(e|east)$", re.I)
NORTH_UNITS = re.compile(r"^degrees?_?(n|north)$", re.I)
LENGTH_UNITS = re.compile(r"^(k?m|(kilo)?met(er|re)s?)$", re.I)
CONNECTIVITY = re.compile(
    r"^(nv|ele(ment)?s?|tri(angles)?|schism_hgrid_face_nodes|.*face_nodes?|face_node_connectivity|elem)$",
    re.I,
)
# other variables for which a grid file is read
GRID = re.compile(r"^(angle|mask_[a-z]+|[utv]mask|x|y|x_rho|y_rho|crs|projection.*)$", re.I)


def role(name: str, attributes: Mapping[str, Any]) -> str | None:
    """Return "longitude" or "latitude" by units, otherwise by standard name, otherwise by name.

    None for other variables.
    """
    by_units, standard = (
        _by_units(attributes),
        str(attributes.get("standard_name", "")).strip().lower(),
    )
    if by_units is not None:
        return by_units
    if standard in ("longitude", "latitude"):
        return standard
    if LENGTH_UNITS.match(str(attributes.get("units", "")).strip()) or standard.startswith(
        "projection_"
    ):
        return None
    return "longitude" if LON.match(name) else "latitude" if LAT.match(name) else None


def certainty(name: str, attributes: Mapping[str, Any], wanted: str) -> int:
    """Return a score of the evidence that a variable holds longitudes, or latitudes.

    Attributes count more than names.
    """
    pattern = LON if wanted == "longitude" else LAT
    standard = str(attributes.get("standard_name", "")).strip().lower()
    return (
        4 * (standard == wanted)
        + 4 * (_by_units(attributes) == wanted)
        + 2 * bool(pattern.match(name))
    )


def contradiction(name: str, attributes: Mapping[str, Any]) -> str:
    """Return a text on how units and standard name of coordinates contradict; "" if not."""
    by_units, standard = (
        _by_units(attributes),
        str(attributes.get("standard_name", "")).strip().lower(),
    )
    if by_units is None or standard not in ("longitude", "latitude") or standard == by_units:
        return ""
    return f'"{name}" has the units of a {by_units} ({attributes["units"]}) and the standard name {standard}'


def _by_units(attributes: Mapping[str, Any]) -> str | None:
    units = str(attributes.get("units", "")).strip()
    return (
        "longitude" if EAST_UNITS.match(units) else "latitude" if NORTH_UNITS.match(units) else None
    )


def of_grid(name: str, attributes: Mapping[str, Any] | None = None) -> bool:
    """Return True if a variable with this name or these attributes describes a grid.

    Variables of another file may then use it.
    """
    stated = attributes or {}
    if "cf_role" in stated or str(stated.get("standard_name", "")) in ("longitude", "latitude"):
        return True
    return any(p.match(name) for p in (LON, LAT, CONNECTIVITY, GRID))
