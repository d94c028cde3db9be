"""Positions of u and v on a staggered (Arakawa C) grid, from those of the points between them.

u lies midway between two neighbouring rho (or T) points of a row, v between two of a column, on
the great circle through them. Which two they are follows from the sizes if these differ (ROMS,
WRF), otherwise from the model's convention: u lies after its T point in NEMO and before it in
MITgcm. If nothing shows it, the case must state it.
"""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from geo.array import Array
from geo.errors import UserError

# [cells] offset from rho points to u and v, by the case's `stagger`
STATED = {"after": 0.5, "before": -0.5, "none": 0.0}
PLACE = re.compile(
    r"(?:^(?:glam|gphi)|_)(rho|psi|[tuvfw])(?:_?grid)?$|^(?:ulon|ulat)()$|_grid_([tuvfw])(?:_|$)",
    re.I,
)
AT_U = re.compile(r"_at_([uv])_location$")
NEMO = ({"vozocrtx", "sozocrtx"}, {"vomecrty", "somecrty"})


def place_of(name: str) -> str | None:
    """Return the points to which a name refers: "t" (rho), "u", "v", "f" (psi) or None."""
    if name in ("XC", "YC"):
        return "t"
    match = PLACE.search(name)
    letter = next((g for g in match.groups() if g), "").lower() if match else ""
    return {"rho": "t", "psi": "f"}.get(letter, letter) or None


def _at_own_points(data: xr.Dataset, name: str, dims: tuple[str, ...], side: int) -> bool:
    """Return True if the file says that a component is at u or v points."""
    letter = "uv"[side]
    listed = str(data[name].attrs.get("coordinates", "")).split()
    return (
        AT_U.search(str(data[name].attrs.get("standard_name", ""))) is not None
        or name in NEMO[side]
        or any(place_of(other) == letter for other in (*dims, *listed))
        or _has_nemo_mask(data, dims, side)
    )


def _has_nemo_mask(data: xr.Dataset, dims: tuple[str, ...], side: int) -> bool:
    """Return True if a file holds NEMO's mask of a component over the same dimensions."""
    mask = ("umask", "vmask")[side]
    return mask in data.variables and tuple(map(str, data[mask].dims[-2:])) == dims


def offsets(
    data: xr.Dataset,
    name: str,
    dims: tuple[str, ...],
    side: int,
    lon_name: str,
    chosen: Mapping[str, Any],
    shape: tuple[int, ...],
) -> tuple[float | None, float | None]:
    """Return the offset [cells] along (rows, columns) of a component from given points.

    None means midway between all neighbours along that axis, and also beyond both ends if the
    component has one point more.

    Args:
        data: the file's dataset.
        name: of the component.
        dims: its horizontal dimensions.
        side: 0 for u, 1 for v.
        lon_name: longitudes of the given points.
        chosen: the case's choice of coordinates, by key.
        shape: of the given points.

    Raises:
        UserError: the offset is unknown and the case does not state it.
    """
    wanted = tuple(int(data.sizes[d]) for d in dims)
    if shape != wanted:
        steps = [None if have != want else 0.0 for have, want in zip(shape, wanted, strict=True)]
        return steps[0], steps[1]
    own = tuple(map(str, data[lon_name].dims))[-2:]
    along = [0.0, 0.0]
    if "stagger" in chosen:  # it takes precedence over names
        along[1 - side] = _stated(name, lon_name, chosen)
        return along[0], along[1]
    if own != dims and set(own) != set(dims):
        shifts = [_axis_shift(data, d, o) for d, o in zip(dims, own, strict=True)]
        if all(shift is not None for shift in shifts):
            return shifts[0], shifts[1]
    elif place_of(lon_name) != "t" or not _at_own_points(data, name, dims, side):
        return 0.0, 0.0  # the coordinates are the component's own
    elif name in NEMO[side] or _has_nemo_mask(data, dims, side):
        along[1 - side] = STATED["after"]
        return along[0], along[1]
    along[1 - side] = _stated(name, lon_name, chosen)
    return along[0], along[1]


def _stated(name: str, lon_name: str, chosen: Mapping[str, Any]) -> float:
    """Return the offset [cells] that the case states; raise UserError if it states none."""
    if "stagger" not in chosen:
        raise UserError(
            f'"{name}" lies half a cell beside the points of "{lon_name}", and the file does not say on which side; set '
            f'variables.stagger = "after" (u east, v north of its point along the grid, as in NEMO), "before" (as in '
            f'MITgcm) or "none" (at the points)'
        )
    if chosen["stagger"] not in STATED:
        raise UserError(
            f'variables.stagger = "{chosen["stagger"]}": allowed are {", ".join(STATED)}'
        )
    return STATED[str(chosen["stagger"])]


def _axis_shift(data: xr.Dataset, dim: str, other: str) -> float | None:
    """Return the offset [cells] of a dimension's points from another's by c_grid_axis_shift.

    None if the file does not state it.
    """
    if dim == other:
        return 0.0
    shifts = [
        data[d].attrs.get("c_grid_axis_shift") if d in data.variables else None
        for d in (dim, other)
    ]
    if shifts[0] is None and shifts[1] is None:
        return None
    return float(shifts[0] or 0.0) - float(shifts[1] or 0.0)


def midpoints(
    lon: Array,
    lat: Array,
    wanted: tuple[int, ...],
    along: tuple[float | None, float | None],
    follower: int | None,
) -> tuple[Array, Array]:
    """Return (lon, lat) [deg] midway on great circles between points.

    Ends of rows that do not continue are extrapolated linearly by half a cell.

    Args:
        lon: of the points [deg], shape (ny, nx).
        lat: of the points [deg], shape (ny, nx).
        wanted: shape of the result.
        along: from `offsets`.
        follower: the column that follows the last one on a grid that spans the globe, else None.
    """
    phi, lam = np.radians(lat), np.radians(lon)
    place = np.stack((np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)))
    for axis in (0, 1):
        offset, line = along[axis], np.moveaxis(place, axis + 1, 0)
        if offset == 0.0:
            continue
        middle = line[:-1] + line[1:]
        middle = middle / np.sqrt((middle**2).sum(axis=1, keepdims=True))
        if offset is not None or len(line) < wanted[axis]:
            first, last = 1.5 * line[:1] - 0.5 * line[1:2], 1.5 * line[-1:] - 0.5 * line[-2:-1]
            if axis == 1 and follower is not None and offset is not None:
                last = line[-1:] + line[follower : follower + 1]
                first = line[:1] + line[len(line) - 1 - follower : len(line) - follower]
            if offset is None or offset < 0:
                middle = np.concatenate((first, middle))
            if offset is None or offset > 0:
                middle = np.concatenate((middle, last))
        place = np.moveaxis(middle, 0, axis + 1)
    return np.degrees(np.arctan2(place[1], place[0])), np.degrees(
        np.arctan2(place[2], np.hypot(place[0], place[1]))
    )


def moved_line(values: Array, wanted: int, offset: float | None) -> Array:
    """Return coordinates midway along one axis of a rectilinear grid [deg, unwrapped].

    Args:
        values: coordinates of the given points [deg].
        wanted: number of points in the result.
        offset: along this axis, from `offsets`.
    """
    if offset == 0.0:
        return values
    middle = (values[:-1] + values[1:]) / 2
    if offset is None and len(values) > wanted:
        return middle
    first, last = 1.5 * values[:1] - 0.5 * values[1:2], 1.5 * values[-1:] - 0.5 * values[-2:-1]
    before, after = offset is None or offset < 0, offset is None or offset > 0
    return np.concatenate([first] * before + [middle] + [last] * after)
