"""Choice of the vertical level of a variable, and checks that it represents the surface.

A level is given by a dimension, by a scalar coordinate (the dimension was dropped), only by
attributes, or only by the variable's name. In every case it is checked. drift accepts winds 2 to
20 m above the sea, currents and Stokes drift at most 5 m deep, and sigma levels close to the
surface. Any other level has to be chosen in the case.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from geo.array import Real
from geo.errors import UserError
from geo.forcing.quantity import QUANTITIES

NAMES = re.compile(
    r"^(depth.*|deptht|depthu|depthv|lev|level|levels|z|z_.*|zc|s_rho|s_w|siglay|siglev|sigma|layer|layers|height.*"
    r"|nschism_vgrid_layers|altitude|elevation|vertical|k|isobaric.*|plev|pressure|pressure_level|pres|model_level"
    r"|hybrid|oceanmodel.*|bottom_top)$",
    re.IGNORECASE,
)
DEPTHS = re.compile(r"^depth", re.IGNORECASE)
HEIGHTS = re.compile(r"^(height|altitude)", re.IGNORECASE)
PRESSURES = re.compile(r"^(isobaric|plev|pres)", re.IGNORECASE)
SIGMAS = re.compile(r"^(siglay|siglev|sigma.*|s_rho|s_w)$", re.IGNORECASE)
# ROMS and SCHISM number levels upwards
FROM_BOTTOM = re.compile(r"^(s_rho|s_w|nschism_vgrid_layers)$", re.IGNORECASE)
FROM_TOP = re.compile(r"^(depth.*|siglay|siglev)$", re.IGNORECASE)

METRES = {
    "m": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "metre": 1.0,
    "metres": 1.0,
    "km": 1e3,
    "cm": 0.01,
    "dm": 0.1,
    "mm": 1e-3,
    "ft": 0.3048,
    "foot": 0.3048,
    "feet": 0.3048,
    "fathom": 1.8288,
    "fathoms": 1.8288,
}
PASCALS = {
    "pa": 1.0,
    "hpa": 100.0,
    "mb": 100.0,
    "mbar": 100.0,
    "millibar": 100.0,
    "millibars": 100.0,
    "kpa": 1e3,
    "bar": 1e5,
    "dbar": 1e4,
    "decibar": 1e4,
    "decibars": 1e4,
    "pascal": 1.0,
    "pascals": 1.0,
}
DECIBAR = 1e4  # [Pa]; 1 dbar of sea water is 1 m of depth to within 1 %

WIND_HEIGHT = 10.0  # [m] reference height of leeway
# [m] winds between these heights are accepted as 10 m winds: the log profile differs by 15 %
HEIGHTS_OF_WIND = (2.0, 20.0)
DEEPEST = 5.0  # [m] currents and Stokes drift down to this depth are accepted as surface values
# Levels in names: UGRD_850mb, u10m, UGRD_0D995sigma with a unit; u850, 100u without one; u_ml
# without a number
MEASURED = re.compile(
    r"(?<![\d.])(\d+(?:[.D]\d+)?)_?(hpa|mbar|mb|sigma|m)(?=$|[\W_\d]|above|agl|below)",
    re.IGNORECASE,
)
COUNTED = re.compile(
    r"^(?:(?:[uv]|[uv]a|[uv]_?wi?nd|wi?nd_?[uv]|[uv]grd|[xy]_?wind|[uv][-_]component_of_wind)_?([1-9]\d{1,3})n?"
    r"|([1-9]\d{1,3})_?[uv]n?|[uv][ao]?_(?:depth|height|lev(?:el)?|z|d|h)_?([1-9]\d{1,3}))$",
    re.IGNORECASE,
)
IN_AIR = re.compile(
    r"(?:^|_)(ml|pl|hl|pbl|hub)(?:$|_)|(model_?level|pressure_?level|hybrid|sigma|isobaric|tropopause|max(?:imum)?_?wind"
    r"|planetary_?boundary|potential_?vorticity|pvu|isotherm|isentropic)",
    re.IGNORECASE,
)
IN_WATER = re.compile(
    r"(?:^|_)(bot|bed|bottom|barotropic|mid|(?:depth|lev(?:el)?|z|d)_?[1-9]\d{1,3})(?:$|_)|^[uv]o_([1-9]\d{1,3})$"
    r"|(bottom|barotropic|sea_?floor|^[uv]bar$)",
    re.IGNORECASE,
)
LEAST_PRESSURE = (
    # Numbers without a unit from this on are hPa, smaller ones metres: files hold winds up to
    # 200 m above ground, and at 250 hPa.
    250.0
)
# types of level without a value
SURFACES = {"surface", "meansea", "oceansurface", "sea", "sea surface", "mean sea level"}


@dataclass(frozen=True)
class Levels:
    """The levels of a variable, with the name by which a case chooses among them.

    values (n,), units: as in the file, for messages. away (n,): height above the sea for kind
    "height" [m], depth for "depth" [m], distance from the surface for "sigma" [1]; NaN for kinds
    without a known position: "pressure", "number", "unknown". upwards: whether values grow upwards,
    None if unknown. lone: the level is no dimension of the variable.
    """

    name: str
    kind: str
    values: Real
    units: str
    away: Real
    upwards: bool | None = None
    lone: bool = False


def is_vertical(data: xr.Dataset, dim: str) -> bool:
    """Return True if attributes or name mark a dimension or coordinate as vertical."""
    if NAMES.match(dim):
        return True
    if dim not in data.variables:
        return False
    attributes = data[dim].attrs
    standard = str(attributes.get("standard_name", ""))
    return (
        str(attributes.get("axis", "")).upper() == "Z"
        or "positive" in attributes
        or standard in ("depth", "height", "altitude", "air_pressure", "model_level_number")
        or standard.startswith(
            ("ocean_", "atmosphere_sigma", "atmosphere_hybrid", "height_above_", "depth_below_")
        )
    )


def choose(
    data: xr.Dataset, name: str, dim: str, quantity: str, depth: float | None, where: str
) -> tuple[int, str]:
    """Return the index to read along a vertical dimension, and a note on the level ("" for none).

    Args:
        data: the file's dataset.
        name: of the variable.
        dim: the vertical dimension.
        quantity: one of QUANTITIES.
        depth: that the case asks for [m]; None for the surface.
        where: the file, for messages.

    Raises:
        UserError: no level there represents the surface, or lies near `depth`.
    """
    count = int(data.sizes[dim])
    if not count:
        raise UserError(f'{where}: "{dim}" has no level; set [[{quantity}]] files')
    levels = _levels_along(data, dim, quantity)
    if levels is None:
        return _choose_by_name(dim, count, quantity, depth, where) if count > 1 else (0, "")
    if not np.isfinite(levels.values).all():
        raise UserError(
            f'{where}: "{dim}" has missing values, so the level at the surface is unknown; if you '
            f"know it, give its index in [[{quantity}]] variables.{dim}"
        )
    return _choose_level(levels, name, quantity, depth, where)


def beside(data: xr.Dataset, name: str, quantity: str) -> list[Levels]:
    """Return the levels of a variable that are scalar coordinates or stated by its attributes."""
    variable = data[name]
    own = set(map(str, variable.dims))
    listed = _listed_coordinates(variable) | set(map(str, variable.coords))
    others = set().union(
        *(_listed_coordinates(data[n]) for n in map(str, data.variables) if n != name)
    )
    levels = []
    for other in map(str, data.variables):
        candidate = data[other]
        dims = set(map(str, candidate.dims))
        if other == name or candidate.size != 1 or dims & own or not is_vertical(data, other):
            continue
        if not np.issubdtype(candidate.dtype, np.number) or not np.isfinite(candidate.values).all():
            continue
        lent = any(dims & set(map(str, v.dims)) for n, v in data.variables.items() if n != other)
        if other in listed or (other not in others and not lent):
            levels.append(
                _build_levels(
                    other,
                    candidate.attrs,
                    np.ravel(candidate.values).astype(np.float64),
                    quantity,
                    True,
                )
            )
    if levels or any(is_vertical(data, d) for d in own):
        return levels
    stated = _stated_level(name, variable.attrs, quantity)
    return [stated] if stated is not None else []


def accept(levels: Levels, name: str, quantity: str, depth: float | None, where: str) -> str:
    """Return a note on a scalar level; raise UserError if it does not represent the surface."""
    return _choose_level(levels, name, quantity, depth, where)[1]


def passes(name: str, attributes: Mapping[str, Any], quantity: str) -> bool | None:
    """Return whether a variable's attributes or name state a level at the surface.

    None if they state no level.
    """
    if _at_surface(attributes):
        return True
    levels = _stated_level(name, attributes, quantity)
    return None if levels is None else _surface_index(levels, quantity) is not None


def _at_surface(attributes: Mapping[str, Any]) -> bool:
    return str(attributes.get("GRIB_typeOfLevel", "")).lower() in SURFACES


def _stated_level(name: str, attributes: Mapping[str, Any], quantity: str) -> Levels | None:
    """Return the level that a variable's attributes or name state.

    None if they state none or the surface.
    """
    if _at_surface(attributes):
        return None
    return _of_attributes(attributes, quantity) or _of_name(name, quantity)


def same(data: xr.Dataset, other: xr.Dataset, dim: str, index: int) -> bool:
    """Return True if an index along a vertical dimension is the same level in both files."""
    if dim not in data.variables or dim not in other.variables:
        return True
    pair = [np.asarray(d[dim].values) for d in (data, other)]
    if pair[0].ndim != 1 or pair[1].ndim != 1 or not np.issubdtype(pair[0].dtype, np.number):
        return True
    return index < len(pair[1]) and bool(
        np.isclose(pair[0][index], pair[1][index], rtol=1e-4, equal_nan=True)
    )


def _listed_coordinates(variable: xr.DataArray) -> set[str]:
    return set(str(variable.attrs.get("coordinates", "")).split())


def _levels_along(data: xr.Dataset, dim: str, quantity: str) -> Levels | None:
    """Return the levels along a dimension.

    They come from its own coordinate or from the only vertical variable along the dimension. None
    if neither gives numbers.
    """
    named = dim
    if dim not in data.variables:
        fitting = [
            n for n, v in data.variables.items() if v.dims == (dim,) and is_vertical(data, str(n))
        ]
        if len(fitting) != 1:
            return None
        named = str(fitting[0])
    coordinate = data[named]
    if not np.issubdtype(coordinate.dtype, np.number) or dim not in coordinate.dims:
        return None
    values = np.asarray(coordinate.transpose(dim, ...).values, np.float64)
    if values.ndim > 1:  # FVCOM: siglay(siglay, node)
        values = np.nanmean(values.reshape(len(values), -1), axis=1)
    return _build_levels(dim, coordinate.attrs, values, quantity, False)


def _build_levels(
    name: str, attributes: Mapping[str, Any], values: Real, quantity: str, lone: bool
) -> Levels:
    """Return levels with their kind and position, as far as name, units and attributes say."""
    units = str(attributes.get("units", "")).strip()
    standard = str(attributes.get("standard_name", "")).strip().lower()
    positive = str(attributes.get("positive", "")).strip().lower()
    text = f"{standard} {attributes.get('long_name', '')}".lower().replace("_", " ")
    nowhere = np.full(values.shape, np.nan)
    kind, away, upwards = "unknown", nowhere, {"up": True, "down": False}.get(positive)
    down = upwards is False or (
        upwards is None and bool(DEPTHS.match(name) or standard.startswith("depth"))
    )
    length, pressure = METRES.get(units.lower()), PASCALS.get(units.lower())
    none = units.lower() in (
        "",
        "1",
        "level",
        "levels",
        "layer",
        "layers",
        "count",
        "none",
        "unknown",
        "-",
        "sigma_level",
    )
    share = _is_sigma(name, standard, units) and np.abs(values).max(initial=0.0) <= 1.0 + 1e-6
    if none and values.size and _are_level_numbers(values) and not share:
        kind = "number"
        if upwards is None:
            upwards = True if FROM_BOTTOM.match(name) else False if FROM_TOP.match(name) else None
    elif re.search(r"(sea ?floor|bottom|above (the )?bed|mixed layer)", text):
        kind = "unknown"
    elif pressure is not None and not QUANTITIES[quantity].in_air:
        kind, away = "depth", np.abs(values) * pressure / DECIBAR
    elif pressure is not None or (none and PRESSURES.match(name)):
        kind = "pressure"
    elif length is not None and QUANTITIES[quantity].in_air:
        kind, away = "height", values * length * (-1.0 if down else 1.0)
    elif length is not None:
        kind, away = "depth", np.abs(values) * length
    elif share:
        kind, away = "sigma", _sigma_from_surface(values, quantity, upwards)
    elif (
        none
        and (DEPTHS.match(name) or standard == "depth")
        and not (upwards and (values > 0).all())
    ):
        kind, away = (
            ("height", -values) if QUANTITIES[quantity].in_air else ("depth", np.abs(values))
        )
    elif none and (
        HEIGHTS.match(name)
        or standard in ("height", "altitude")
        or (values == 0).all()
        or (not QUANTITIES[quantity].in_air and np.abs(values).max(initial=0.0) > 1.0)
    ):
        kind, away = (
            ("height", values) if QUANTITIES[quantity].in_air else ("depth", np.abs(values))
        )
    elif none and (values <= 0).all() and values.size > 1 and not QUANTITIES[quantity].in_air:
        kind, away = "sigma", np.abs(values)
    return Levels(name, kind, values, units, away, upwards, lone)


def _are_level_numbers(values: Real) -> bool:
    """Return True if values number levels (3, 4, 5, ... or one nonzero whole number)."""
    integral = bool((values == np.round(values)).all()) if np.isfinite(values).all() else False
    return integral and (
        bool(values[0]) if len(values) == 1 else bool((np.abs(np.diff(values)) == 1).all())
    )


def _is_sigma(name: str, standard: str, units: str) -> bool:
    return bool(
        SIGMAS.match(name)
        or units.lower() == "sigma_level"
        or standard.startswith(("ocean_s", "ocean_double", "atmosphere_sigma", "atmosphere_hybrid"))
    )


def _sigma_from_surface(values: Real, quantity: str, upwards: bool | None) -> Real:
    """Return the distance of sigma levels from the surface [1]; NaN if it cannot be known.

    At the surface sigma is 1 in the atmosphere and 0 in the ocean, where it is -1 at the bottom.
    """
    if QUANTITIES[quantity].in_air or (upwards and (values >= 0).all() and values.max() > 0):
        return 1.0 - values
    if upwards is None and (values > 0).any():
        # sigma runs from 0 to 1, and nothing says at which end the surface is
        return np.full(values.shape, np.nan)
    return np.abs(values)


def _of_attributes(attributes: Mapping[str, Any], quantity: str) -> Levels | None:
    """Return the level that a variable's attributes state explicitly.

    None if they state none or the surface.
    """
    kind = str(attributes.get("GRIB_typeOfLevel", "")).strip()
    if kind and kind != "undef":
        if kind.lower() in SURFACES:
            return None
        value = attributes.get("GRIB_level")
        units = {"isobaricInhPa": "hPa", "isobaricInPa": "Pa"}.get(
            kind, "m" if re.match("height|depthBelowSea", kind) else ""
        )
        if value is not None and not kind.endswith("Layer"):
            read = _build_levels(kind, {"units": units}, np.array([float(value)]), quantity, True)
            return Levels(
                "level", read.kind, read.values, read.units or kind, read.away, None, True
            )
        # "10 metre U wind component"
        numbered = re.search(r"\d", str(attributes.get("long_name", "")))
        if not numbered:
            return Levels("level", "unknown", np.empty(0), kind, np.empty(0), None, True)
    for key in ("level", "long_name"):
        text = str(attributes.get(key, "")).lower().replace("_", " ")
        at = r"(?:\bat|@|\bon)\s+(?:the\s+)?" if key == "long_name" else r"^\s*"
        number, metre = (
            r"(\d+(?:\.\d+)?)",
            r"[\s-]*m(?:et(?:er|re)s?)?\b(?!\s*(?:/|s\b|s-|s\*|s\^|per))",
        )
        if QUANTITIES[quantity].in_air:
            hit = re.search(number + r"[\s-]*(hpa|mb|mbar|millibars?)\b", text)
            if hit:
                return _build_levels(
                    "level", {"units": hit[2]}, np.array([float(hit[1])]), quantity, True
                )
            of = r"\s*(?:above|height|wind|[uv]\b|[uv][- ]|eastward|northward|zonal|meridional)"
            hit = re.search(f"{at}{number}{metre}", text) or re.search(
                rf"\b{number}{metre}(?={of})", text
            )
        else:
            hit = re.search(f"{at}{number}{metre}", text) or re.search(
                rf"\b{number}{metre}\s*(?:depth|below|deep)", text
            )
        if hit:
            return _build_levels("level", {"units": "m"}, np.array([float(hit[1])]), quantity, True)
    return None


def _of_name(name: str, quantity: str) -> Levels | None:
    """Return the level that the name of a variable states; None if it states none."""
    in_air = QUANTITIES[quantity].in_air
    for hit in MEASURED.finditer(name):
        value, unit = float(hit[1].upper().replace("D", ".")), hit[2]
        if in_air or unit.lower() == "m":
            sigma = unit.lower() == "sigma"
            level_name, units = ("sigma", "") if sigma else ("level", unit)
            read = _build_levels(level_name, {"units": units}, np.array([value]), quantity, True)
            return replace(read, name="level")
    counted = COUNTED.match(name) if in_air else None
    if counted:
        value = float(counted[1] or counted[2] or counted[3])
        unit = "hPa" if value >= LEAST_PRESSURE else "m"
        return _build_levels("level", {"units": unit}, np.array([value]), quantity, True)
    word = (IN_AIR if in_air else IN_WATER).search(name)
    if word:
        return Levels(
            "level", "unknown", np.empty(0), word[word.lastindex or 0], np.empty(0), None, True
        )
    return None


def _surface_index(levels: Levels, quantity: str) -> int | None:
    """Return the index of the level that represents the surface; None if no level does.

    For winds it is the accepted level nearest to 10 m.
    """
    values, away = levels.values, levels.away
    if levels.kind == "number" and not QUANTITIES[quantity].in_air and levels.upwards is not None:
        if levels.upwards:  # the greatest number is at the surface, unless there is only one
            return int(np.argmax(values)) if len(values) > 1 else None
        return int(np.argmin(values)) if values.min() <= 1 else None
    if not np.isfinite(away).all() or not len(away):
        return None
    if levels.kind == "height":
        low, high = HEIGHTS_OF_WIND
        # some files give the height 0 for "surface"
        fits = ((away >= low - 1e-3) & (away <= high + 1e-3)) | (away == 0)
        distance = np.where(fits, np.abs(away - WIND_HEIGHT), np.inf)
    elif levels.kind in ("depth", "sigma"):
        most = DEEPEST + 1e-3 if levels.kind == "depth" else QUANTITIES[quantity].sigma + 1e-6
        distance = np.where((away <= most) & (away >= -1e-6), away, np.inf)
    else:
        return None
    best = int(np.argmin(distance))
    return best if np.isfinite(distance[best]) else None


def _choose_level(
    levels: Levels, name: str, quantity: str, depth: float | None, where: str
) -> tuple[int, str]:
    count = len(levels.values)
    if depth is not None and not QUANTITIES[quantity].in_air:
        if levels.kind != "depth":
            raise UserError(
                f'{where}: [[{quantity}]] depth = {depth:g} m, but "{levels.name}" of {name} has levels that are not '
                f"in metres: {_format_levels(levels)}; {_advice(levels, quantity, False)}"
            )
        chosen = int(np.argmin(np.abs(levels.away - abs(depth))))
        apart = abs(float(levels.away[chosen]) - abs(depth))
        inside = levels.away.min() <= abs(depth) <= levels.away.max()
        if not inside and apart > max(DEEPEST, abs(depth) / 4):
            raise UserError(
                f"{where}: {name} has no level near [[{quantity}]] depth = {depth:g} m: it is given at "
                f"{_format_levels(levels)}"
            )
    else:
        surface = _surface_index(levels, quantity)
        if surface is None:
            raise UserError(_rejection(levels, name, quantity, where))
        chosen = surface
    if (
        count == 1
        and depth is None
        and (levels.away[0] == 0 or (levels.kind == "height" and not levels.lone))
    ):
        return 0, ""
    value = _format_number(levels.values[chosen])
    if QUANTITIES[quantity].in_air and levels.kind == "height":
        return chosen, f"height {value} {levels.units or 'm'}" + (
            f" of {count} levels" if count > 1 else ""
        )
    unit = (
        f" {levels.units}"
        if levels.units.lower() in METRES or levels.units.lower() in PASCALS
        else ""
    )
    guess = ", taken as metres" if levels.kind == "depth" and not unit else ""
    return chosen, f'level {value}{unit} of {count} along "{levels.name}"{guess}'


def _rejection(levels: Levels, name: str, quantity: str, where: str) -> str:
    only = "the only level" if len(levels.values) == 1 else "all levels"
    if not len(levels.values):
        description = f'is given at a level of type "{levels.units}"'
    elif np.isfinite(levels.away).all() or levels.kind == "pressure":
        description = f'is given at {_format_levels(levels)} ("{levels.name}", {only} of it)'
    else:
        description = f'has "{levels.name}" = {_format_levels(levels)}, and nothing says how far from the surface that is'
    key = _advice(levels, quantity, levels.kind == "depth")
    return f"{where}: {name} {description}; needed is {QUANTITIES[quantity].wanted}: {key}"


def _advice(levels: Levels, quantity: str, by_depth: bool) -> str:
    """Return how to choose a level. No value is proposed: the user must know what to choose."""
    place = f"its index there, counted from 0, in [[{quantity}]] variables.{levels.name}"
    if by_depth:
        place = f"[[{quantity}]] depth, or {place}"
    return f"name a file that has it in [[{quantity}]] files, or, if you know which level here is right, give {place}"


def _format_levels(levels: Levels) -> str:
    values = [_format_number(v) for v in levels.values]
    if len(values) > 12:
        values = [*values[:6], "...", *values[-3:]]
    text = ", ".join(values)
    unit = levels.units or ("sigma" if levels.kind == "sigma" else "")
    if levels.kind == "sigma":
        return f"sigma {text}"
    if not unit or unit == "1":
        return f"{text} (no units)"
    return f"{text} {unit}"


def _format_number(value: float) -> str:
    return f"{value:.6g}"


def _choose_by_name(
    dim: str, count: int, quantity: str, depth: float | None, where: str
) -> tuple[int, str]:
    """Return the index and a note for the surface along a vertical dimension without coordinate.

    Only the name of the dimension says at which end the surface is. Raise UserError if it does not.
    """
    if depth is not None and not QUANTITIES[quantity].in_air:
        raise UserError(
            f'{where}: [[{quantity}]] depth = {depth:g} m, but the {count} levels of "{dim}" have no depths; if '
            f"you know them, give an index, counted from 0, in [[{quantity}]] variables.{dim}"
        )
    upwards = bool(FROM_BOTTOM.match(dim))
    if not QUANTITIES[quantity].in_air and (upwards or FROM_TOP.match(dim)):
        chosen = count - 1 if upwards else 0
        return (
            chosen,
            f'{"last" if upwards else "first"} of {count} levels along "{dim}", taken as the surface',
        )
    raise UserError(
        f'{where}: "{dim}" has {count} levels of unknown position; needed is '
        f"{QUANTITIES[quantity].wanted}: if you know "
        f"which that is, give its index, counted from 0, in [[{quantity}]] variables.{dim}"
    )
