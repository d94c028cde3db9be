"""The level nearest the surface (or nearest a wanted depth) along a variable's vertical dimension."""

import re

import numpy as np
import xarray as xr

from geo.errors import UserError

NAMES = re.compile(
    r"^(depth.*|deptht|depthu|depthv|lev|level|levels|z|z_.*|zc|s_rho|s_w|siglay|siglev|sigma|layer|layers|height.*"
    r"|nschism_vgrid_layers|altitude|elevation|vertical|k|isobaric.*|plev|pressure)$",
    re.IGNORECASE,
)
WIND_HEIGHT = 10.0  # [m]


def is_vertical(data: xr.Dataset, dim: str) -> bool:
    """Whether a dimension is a vertical one, by its coordinate's attributes or its name."""
    if NAMES.match(dim):
        return True
    if dim not in data.variables:
        return False
    attributes = data[dim].attrs
    standard = str(attributes.get("standard_name", ""))
    return (
        str(attributes.get("axis", "")).upper() == "Z"
        or "positive" in attributes
        or standard in ("depth", "height", "altitude")
        or standard.startswith("ocean_")
    )


def choose(data: xr.Dataset, dim: str, quantity: str, depth: float | None) -> tuple[int, str]:
    """Return the index to read along a vertical dimension, and a remark that says which level that is."""
    count = int(data.sizes[dim])
    if not count:
        raise UserError(f'"{dim}" has no level; set [[{quantity}]] files')
    coordinate = data[dim] if dim in data.variables else None
    if coordinate is None or not np.issubdtype(coordinate.dtype, np.number):
        if count == 1:
            return 0, ""
        return _without_coordinate(dim, count, quantity, depth)
    values = np.asarray(coordinate.values, np.float64)
    if values.ndim > 1:  # FVCOM: siglay(siglay, node)
        values = np.nanmean(values.reshape(count, -1), axis=1)
    if not np.isfinite(values).all():
        raise UserError(f'"{dim}" has missing values; set [[{quantity}]] variables.{dim} to the index of a level')
    units = str(coordinate.attrs.get("units", "")).strip().lower()
    metres = units in ("m", "meter", "meters", "metre", "metres") or (
        not units and str(coordinate.attrs.get("standard_name", "")) == "depth"
    )
    if quantity == "wind":
        if count > 1 and not metres:
            raise UserError(f'wind on {count} levels of "{dim}" [{units}]; set [[wind]] variables.{dim} to an index')
        chosen = int(np.argmin(np.abs(values - WIND_HEIGHT)))
        return chosen, f"height {values[chosen]:g} m of {count} levels" if count > 1 else ""
    if depth is not None:
        if not metres and count > 1:
            raise UserError(
                f'[[{quantity}]] depth = {depth:g} m, but "{dim}" counts levels that are not in metres; '
                f"set [[{quantity}]] variables.{dim} to an index instead"
            )
        chosen = int(np.argmin(np.abs(np.abs(values) - abs(depth))))
    elif not metres and (values > 0).all() and str(coordinate.attrs.get("positive", "")).lower() == "up":
        chosen = int(np.argmax(values))  # numbers of layers, counted upwards
    else:
        chosen = int(np.argmin(np.abs(values)))  # metres or sigma, up or down: the surface is where they are 0
    unit = " m" if metres else ""
    if count == 1 and depth is None and abs(values[0]) < 1e-6:
        return 0, ""
    return chosen, f'level {values[chosen]:g}{unit} of {count} along "{dim}"'


def _without_coordinate(dim: str, count: int, quantity: str, depth: float | None) -> tuple[int, str]:
    if depth is not None:
        raise UserError(
            f'[[{quantity}]] depth = {depth:g} m, but "{dim}" has no depths; '
            f"set [[{quantity}]] variables.{dim} to an index instead"
        )
    upwards = dim.lower() in ("s_rho", "nschism_vgrid_layers")  # ROMS and SCHISM count from the bottom
    if upwards or re.match(r"^(depth.*|siglay)$", dim.lower()):
        chosen = count - 1 if upwards else 0
        return chosen, f'{"last" if upwards else "first"} of {count} levels along "{dim}", taken as the surface'
    raise UserError(
        f'"{dim}" has {count} levels and nothing says which is the surface; '
        f"set [[{quantity}]] variables.{dim} to its index"
    )
