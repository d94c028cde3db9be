"""GRIB 1 and 2 as datasets: variables over time, level and a grid, decoded slice by slice.

Fields with the same name, type of level and grid become a variable. Levels with other times than
the rest become a variable of their own, so that no variable has gaps. Winds, currents and Stokes
drift get CF standard names: of eastward and northward components, or of x and y components if the
message says that they follow the grid. Nothing is written to disk.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import pyproj
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from geo import sphere
from geo.array import Real
from geo.errors import UserError
from geo.files import decoder, messages, reference_system
from geo.files.messages import Message

# Component of a field: (quantity, side), by short name; by number where eccodes has no name.
NAMED = {
    **{f"{height}{'uv'[k]}": ("wind", k) for k in (0, 1) for height in ("", "10", "100", "200")},
    "u10n": ("wind", 0),
    "v10n": ("wind", 1),
    **{
        n: ("current", k)
        for k in (0, 1)
        for n in (("ocu", "ocv")[k], ("uoe", "von")[k], ("ucurr", "vcurr")[k])
    },
    "ust": ("stokes", 0),
    "vst": ("stokes", 1),
}
# keys: (discipline, category, number) in GRIB 2, (1, number in WMO's tables) in GRIB 1
NUMBERED = {
    (0, 2, 2): ("wind", 0),
    (0, 2, 3): ("wind", 1),
    (10, 1, 2): ("current", 0),
    (10, 1, 3): ("current", 1),
    (10, 0, 21): ("stokes", 0),
    (10, 0, 22): ("stokes", 1),
    (1, 33): ("wind", 0),
    (1, 34): ("wind", 1),
    (1, 49): ("current", 0),
    (1, 50): ("current", 1),
}
CALLED = {"wind": ("u", "v"), "current": ("uogrd", "vogrd"), "stokes": ("ust", "vst")}
STANDARD = {  # CF standard names for east and north, and for x and y
    "wind": (("eastward_wind", "northward_wind"), ("x_wind", "y_wind")),
    "current": (
        ("eastward_sea_water_velocity", "northward_sea_water_velocity"),
        ("sea_water_x_velocity", "sea_water_y_velocity"),
    ),
    "stokes": (
        (
            "sea_surface_wave_stokes_drift_eastward_velocity",
            "sea_surface_wave_stokes_drift_northward_velocity",
        ),
        ("sea_surface_wave_stokes_drift_x_velocity", "sea_surface_wave_stokes_drift_y_velocity"),
    ),
}
# 10u is at 10 m, whatever the type of level in GRIB 1
HEIGHT_IN_NAME = {"10": 10.0, "100": 100.0, "200": 200.0}
UNVALUED = {"surface", "meanSea", "oceanSurface"}
UNITS = {
    "isobaricInhPa": "hPa",
    "isobaricInPa": "Pa",
    "heightAboveGround": "m",
    "heightAboveSea": "m",
    "depthBelowSea": "m",
    "pressureFromGroundLayer": "hPa",
    "depthBelowLand": "m",
}
# types of grid without rows and columns
UNROWED = ("sh", "unstructured_grid", "healpix", "triangular_grid")
# types of level whose value has no unit
COUNTED = ("sigma", "hybrid", "oceanModel", "oceanModelLayer")
# code table 4.4: unit of the step [s]
STEP_SECONDS = {0: 60, 1: 3600, 2: 86_400, 10: 10_800, 11: 21_600, 12: 43_200, 13: 1}
POSITIVE_UP = ("height", "altitude")


@dataclass(frozen=True)
class Field:
    """A message, and what distinguishes it from the others of its file.

    name: of its variable, as far as parameter and type of level determine it. role: (quantity, 0 |
    1), None if it is no forcing. kind, level: type of level, and value in the units of UNITS. time,
    run: valid time and start of the model run [s since 1970]. begin: start of an average's
    interval, which ends at `time`; otherwise equal to `time`. grid: type of grid.
    """

    message: Message
    name: str
    role: tuple[str, int] | None
    kind: str
    level: float
    time: int
    begin: int
    run: int
    member: int
    along_grid: bool
    grid: str
    long_name: str
    units: str


@dataclass(frozen=True)
class Points:
    """Positions of a grid's points, and how a message's values are ordered on them.

    dims: names without suffix. coordinates: {name: (dims, values, attributes)}. mapping: attributes
    of a projection, or None. shape: (ny, nx). rows: number of points in every row of a reduced
    grid, empty for others. flags: whether rows alternate in direction, columns come first, and rows
    run from right to left.
    """

    dims: tuple[str, str]
    coordinates: Mapping[str, tuple[tuple[str, ...], Real, dict[str, str]]]
    mapping: dict[str, Any] | None
    shape: tuple[int, int]
    rows: tuple[int, ...]
    flags: tuple[bool, bool, bool]


def open_file(path: str) -> xr.Dataset:
    """Return the fields of a GRIB file as a dataset; values are read on demand."""
    names: dict[bytes, dict[str, Any]] = {}
    fields = [_build_field(message, names) for message in messages.split_messages(path)]
    if not fields:
        raise UserError(f'"{path}" holds no GRIB message')
    drifting = [f for f in fields if f.role is not None]
    placed = [f for f in drifting if f.grid not in UNROWED]
    if drifting and not placed:
        raise UserError(
            f'"{path}" holds {drifting[0].name} on a grid of type "{drifting[0].grid}", which has no rows and columns: '
            f"convert it to a regular one (cdo remapbil, or grid = 0.25/0.25 where it was retrieved)"
        )
    orders: dict[bytes, Points] = {}  # points for each grid definition (bytes)
    grids: list[Points] = []
    # number of the grid for each definition; the two editions define equal grids differently
    grid_of: dict[bytes, int] = {}
    for field in placed:
        shape = field.message.shape
        if shape not in orders:
            orders[shape] = _build_points(field.message)
            equal = [k for k, grid in enumerate(grids) if _same_points(grid, orders[shape])]
            grid_of[shape] = equal[0] if equal else len(grids)
            grids += [] if equal else [orders[shape]]
    variables: dict[str, xr.Variable] = {}
    for k, grid in enumerate(grids):
        for name, (dims, values, attributes) in grid.coordinates.items():
            variables[name + _suffix(k)] = xr.Variable(
                [d + _suffix(k) for d in dims], values, attributes
            )
        if grid.mapping is not None:
            variables["projection" + _suffix(k)] = xr.Variable((), 0, grid.mapping)
    groups: dict[tuple[str, int | None], list[Field]] = {}
    for field in fields:
        groups.setdefault((field.name, grid_of.get(field.message.shape)), []).append(field)
    for (name, number), group in groups.items():
        # a grid without rows: only the name is needed, to report what the file holds
        if number is None:
            variables.setdefault(
                name, xr.Variable(("message",), np.zeros(1), {"long_name": group[0].long_name})
            )
            continue
        several = len([1 for other, k in groups if other == name and k is not None]) > 1
        # On latitudes and longitudes grid directions equal east and north. One name for both keeps
        # this grid from losing to another one.
        if grids[number].dims[0] == "latitude":
            along = any(f.along_grid for f in placed if f.name == name)
            group = [replace(f, along_grid=along) for f in group]
        if group[0].role is not None and len({f.along_grid for f in group}) > 1:
            raise UserError(
                f'"{path}" gives {name} along the grid in some messages and along east and north in others'
            )
        own_name = f"{name}_grid{number + 1}" if several else name
        fields_at = _fields_at(path, own_name, group)
        for full_name, block in _split_blocks(own_name, fields_at).items():
            variables[full_name] = _build_variable(
                variables, group[0], block, orders, grids[number], _suffix(number)
            )
    return xr.Dataset(variables)


def _suffix(grid: int) -> str:
    return f"_{grid + 1}" if grid else ""


def _same_points(one: Points, other: Points) -> bool:
    """Return True if two grids have the same points to a hundredth of a cell.

    Exact comparison fails, because edition 1 rounds to a thousandth of a degree.
    """
    if (
        one.dims != other.dims
        or one.shape != other.shape
        or (one.mapping is None) != (other.mapping is None)
    ):
        return False
    if one.mapping is not None and other.mapping is not None:
        kinds = [m["grid_mapping_name"] for m in (one.mapping, other.mapping)]
        numbers = [
            {k: v for k, v in m.items() if not isinstance(v, str)}
            for m in (one.mapping, other.mapping)
        ]
        if kinds[0] != kinds[1] or numbers[0].keys() != numbers[1].keys():
            return False
        if not all(
            np.allclose(numbers[0][k], numbers[1][k], rtol=1e-6, atol=1e-6) for k in numbers[0]
        ):
            return False
    for name, (_, values, _) in one.coordinates.items():
        difference = other.coordinates[name][1] - values
        if not np.abs(difference).max() <= 0.01 * np.abs(np.diff(values, axis=-1)).max(initial=0.0):
            return False
    return True


def _build_field(message: Message, names: dict[bytes, dict[str, Any]]) -> Field:
    """Return a message with the contents of its header.

    names: keys already looked up, by product; new ones are added.
    """
    try:
        keys = decoder.keys(message.header)
        if message.product not in names:
            names[message.product] = decoder.names(message.header)
    except decoder.DecodeError as error:
        raise _damaged_error(message, error) from error
    keys = keys | names[message.product]
    step = str(keys.get("stepType", "instant"))
    short = str(keys.get("shortName", "unknown"))
    short = short.removeprefix("avg_") if step == "avg" else short
    role = NAMED.get(short) or (
        NUMBERED.get(_parameter_number(message, keys)) if short in ("unknown", "~") else None
    )
    if role is not None and short not in NAMED:
        short = CALLED[role[0]][role[1]]
    kind, level = _level_of(message, keys)
    above_ground = role is not None and role[0] == "wind" and short not in ("u", "v")
    if above_ground:
        height = next((h for n, h in HEIGHT_IN_NAME.items() if short in (f"{n}u", f"{n}v")), 10.0)
        kind, level = "heightAboveGround", height
    name = short if kind in UNVALUED or above_ground else f"{short}_{kind}"
    derived = keys.get("derivedForecast")
    drift_role = role
    if step != "instant":
        name, drift_role = f"{name}_{step}", role if step == "avg" else None
    if derived is not None or str(keys.get("dataType", "")) in ("em", "es"):
        mean = derived in (0, 1) or keys.get("dataType") == "em"
        name, drift_role = f"{name}_{'mean' if mean else 'spread'}", drift_role if mean else None
    run = _to_seconds(keys.get("dataDate"), keys.get("dataTime"), message)
    time = _to_seconds(keys.get("validityDate"), keys.get("validityTime"), message)
    long_name = str(keys.get("name", short))
    return Field(
        message,
        name,
        drift_role,
        kind,
        level,
        time,
        time - _average_length(keys, step),
        run,
        int(keys.get("perturbationNumber", keys.get("number", 0)) or 0),
        _follows_grid(message, keys),
        str(keys.get("gridType", "unknown")),
        long_name if long_name != "unknown" or role is None else f"{'uv'[role[1]]} of {role[0]}",
        str(keys.get("units", "unknown")),
    )


def _average_length(keys: Mapping[str, Any], step: str) -> int:
    """Return the length of an average's interval [s]; 0 for other fields or if unknown."""
    begin, end, unit = (keys.get(key) for key in ("startStep", "endStep", "stepUnits"))
    if step != "avg" or not isinstance(begin, int) or not isinstance(end, int):
        return 0
    return max(end - begin, 0) * STEP_SECONDS.get(int(unit or 0), 0)


def _follows_grid(message: Message, keys: Mapping[str, Any]) -> bool:
    """Return True if vectors follow the grid, by bit 5 of the flags.

    eccodes' key uvRelativeToGrid is equivalent but does not exist for every grid.
    """
    if "resolutionAndComponentFlags" not in keys and str(keys.get("gridType")) not in (
        "sh",
        "unstructured_grid",
        "healpix",
    ):
        raise _damaged_error(
            message,
            f"a grid of type {keys.get('gridType')} does not say along what its vectors count",
        )
    return bool(int(keys.get("resolutionAndComponentFlags", 0)) & 0x08)


def _parameter_number(message: Message, keys: Mapping[str, Any]) -> tuple[int, ...]:
    """Return the parameter's key in NUMBERED; empty if a centre's own table defines it."""
    if message.edition == 2:
        return tuple(
            int(keys.get(k, -1)) for k in ("discipline", "parameterCategory", "parameterNumber")
        )
    # WMO's tables; higher numbers are a centre's own
    standard = int(keys.get("table2Version", 255)) < 128
    return (1, int(keys.get("indicatorOfParameter", -1))) if standard else ()


def _level_of(message: Message, keys: Mapping[str, Any]) -> tuple[str, float]:
    """Return the type of level and its value in the units of UNITS."""
    kind = str(keys.get("typeOfLevel", "unknown"))
    value = float(keys.get("level", 0.0))
    scaled, factor = (keys.get(f"scale{k}OfFirstFixedSurface") for k in ("dValue", "Factor"))
    if (
        message.edition == 2
        and isinstance(scaled, int)
        and isinstance(factor, int)
        and abs(factor) < 20
    ):
        if abs(scaled) < 2**31 - 1:
            value = scaled / 10.0**factor
            value /= 100.0 if UNITS.get(kind) == "hPa" else 1.0
    elif message.edition == 1 and kind == "sigma":
        value /= 10000.0
    return kind, value


def _to_seconds(date: Any, time: Any, message: Message) -> int:
    """Return a date (20261121) and a time (1830) of a message as seconds since 1970."""
    try:
        day = np.datetime64(
            f"{int(date) // 10000:04d}-{int(date) // 100 % 100:02d}-{int(date) % 100:02d}", "s"
        )
        return int(day.astype(np.int64)) + int(time) // 100 * 3600 + int(time) % 100 * 60
    except (TypeError, ValueError) as error:
        raise _damaged_error(message, f"its date is {date} {time}") from error


def _damaged_error(message: Message, why: object) -> UserError:
    if "eccodes" in str(why) and "pip install" in str(why):
        return UserError(f'"{message.path}": {why}')
    return UserError(
        f'"{message.path}": message {message.number} of this GRIB file is damaged or not understood ({why})'
    )


def _build_points(message: Message) -> Points:
    """Return the points of a message's grid.

    They are axes of latitude and longitude, axes of a projection, or 2-D coordinates.
    """
    try:
        keys, lat, lon = decoder.points(messages.whole(message))
    except decoder.DecodeError as error:
        raise _damaged_error(message, error) from error
    east, north = (
        {"standard_name": n, "units": f"degrees_{d}"}
        for n, d in (("longitude", "east"), ("latitude", "north"))
    )
    if "pl" in keys:
        return _extend_reduced(message, tuple(keys["pl"]), lon, lat, east, north)
    nx, ny = (int(keys.get(a, keys.get(b, 0)) or 0) for a, b in (("Ni", "Nx"), ("Nj", "Ny")))
    if nx < 1 or ny < 1 or nx * ny != lat.size:
        raise _damaged_error(message, f"{lat.size} points on a grid of {nx} x {ny}")
    flags = tuple(
        bool(keys.get(k, 0))
        for k in ("alternativeRowScanning", "jPointsAreConsecutive", "iScansNegatively")
    )
    ordered = Points(("y", "x"), {}, None, (ny, nx), (), (flags[0], flags[1], flags[2]))
    # eccodes returns points with all rows in one direction, even if rows of values alternate.
    placed = replace(ordered, flags=(False, flags[1], flags[2]))
    lon, lat = _arrange_rows(lon, placed), _arrange_rows(lat, placed)
    if not (np.isfinite(lon).all() and np.isfinite(lat).all()):
        raise _damaged_error(message, "points without a longitude and latitude")
    turn = sphere.wrap_degrees(lon - lon[:1])
    if np.abs(turn).max() < 1e-6 and np.ptp(lat, axis=1).max() < 1e-6:
        coordinates = {
            "latitude": (("latitude",), lat[:, 0], north),
            "longitude": (("longitude",), lon[0], east),
        }
        return Points(("latitude", "longitude"), coordinates, None, (ny, nx), (), ordered.flags)
    plane = _fit_projection(keys, lon, lat)
    if plane is None:
        points = {"latitude": (("y", "x"), lat, north), "longitude": (("y", "x"), lon, east)}
        return Points(("y", "x"), points, None, (ny, nx), (), ordered.flags)
    mapping, x, y = plane
    rotated = mapping["grid_mapping_name"] == "rotated_latitude_longitude"
    named = (
        ("grid_longitude", "grid_latitude")
        if rotated
        else ("projection_x_coordinate", "projection_y_coordinate")
    )
    units = "degrees" if rotated else "m"
    axes = {
        "y": (("y",), y, {"standard_name": named[1], "units": units}),
        "x": (("x",), x, {"standard_name": named[0], "units": units}),
    }
    return Points(("y", "x"), axes, mapping, (ny, nx), (), ordered.flags)


def _fit_projection(
    keys: Mapping[str, Any], lon: Real, lat: Real
) -> tuple[dict[str, Any], Real, Real] | None:
    """Return a projection's attributes and axes.

    None if they miss the points by more than a thousandth of a cell.
    """
    mapping = _projection_attributes(keys)
    if mapping is None or min(lon.shape) < 2:
        return None
    crs = reference_system.parse_reference_system(mapping)
    geographic = crs.source_crs if crs.is_derived and crs.is_geographic else crs.geodetic_crs
    x, y = (
        np.asarray(v)
        for v in pyproj.Transformer.from_crs(geographic, crs, always_xy=True).transform(lon, lat)
    )
    if mapping["grid_mapping_name"] == "rotated_latitude_longitude":
        middle = x[0, x.shape[1] // 2]
        x = sphere.near_degrees(x, middle)
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        return None
    axis_x, axis_y = x.mean(axis=0), y.mean(axis=1)
    cell = min(np.abs(np.diff(axis_x)).min(), np.abs(np.diff(axis_y)).min())
    worst = max(np.abs(x - axis_x).max(), np.abs(y - axis_y[:, None]).max())
    # GRIB rounds angles to 1e-6 or 1e-3 degrees
    if not worst < 1e-3 * cell + (2e-6 if crs.is_geographic else 0.2):
        return None
    return mapping, axis_x, axis_y


def _projection_attributes(keys: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the CF attributes of a grid's projection.

    None if the grid has none, or keys are missing.
    """
    kind, number = (
        str(keys.get("gridType", "")),
        {k: float(v) for k, v in keys.items() if isinstance(v, int | float)},
    )
    if number.get("earthIsOblate"):
        earth = {
            "semi_major_axis": number.get("earthMajorAxisInMetres"),
            "semi_minor_axis": number.get("earthMinorAxisInMetres"),
        }
    else:
        earth = {"earth_radius": number.get("radius")}
    if kind == "lambert":
        projection = {
            "grid_mapping_name": "lambert_conformal_conic",
            "longitude_of_central_meridian": number.get("LoVInDegrees"),
            "latitude_of_projection_origin": number.get(
                "LaDInDegrees", number.get("Latin1InDegrees")
            ),
            "standard_parallel": [number.get("Latin1InDegrees"), number.get("Latin2InDegrees")],
        }
    elif kind == "polar_stereographic":
        pole = -90.0 if int(number.get("projectionCentreFlag", 0)) & 0x80 else 90.0
        projection = {
            "grid_mapping_name": "polar_stereographic",
            "straight_vertical_longitude_from_pole": number.get("orientationOfTheGridInDegrees"),
            "latitude_of_projection_origin": pole,
            "standard_parallel": np.copysign(number.get("LaDInDegrees", 60.0), pole),
        }
    elif kind == "rotated_ll" and not number.get("angleOfRotationInDegrees"):
        projection = {
            "grid_mapping_name": "rotated_latitude_longitude",
            "grid_north_pole_latitude": -number.get("latitudeOfSouthernPoleInDegrees", -90.0),
            "grid_north_pole_longitude": (
                number.get("longitudeOfSouthernPoleInDegrees", 0.0) + 180.0
            )
            % 360.0,
        }
    else:
        return None
    flat = [
        v
        for value in (projection | earth).values()
        for v in (value if isinstance(value, list) else [value])
    ]
    return None if any(v is None for v in flat) else projection | earth


def _extend_reduced(
    message: Message,
    rows: tuple[int, ...],
    lon: Real,
    lat: Real,
    east: dict[str, str],
    north: dict[str, str],
) -> Points:
    """Return the points of a reduced grid, extended to a rectangle.

    Every row then starts at longitude 0 and has as many points as the longest.
    """
    starts = np.concatenate(([0], np.cumsum(rows)))
    complete = min(rows, default=0) > 1 and starts[-1] == lat.size
    for row in range(len(rows) if complete else 0):
        longitudes = lon[starts[row] : starts[row + 1]]
        complete &= bool(
            abs(longitudes[0]) < 1e-6 and abs(longitudes[-1] + longitudes[1] - 360.0) < 1e-3
        )
        complete &= bool(np.ptp(lat[starts[row] : starts[row + 1]]) < 1e-6)
    if not complete:
        raise UserError(
            f'"{message.path}" holds fields on part of a reduced grid: convert it to a regular one '
            f"(cdo setgridtype,regular, or grid = 0.25/0.25 where it was retrieved)"
        )
    columns = max(rows)
    axes = {
        "latitude": (("latitude",), lat[starts[:-1]], north),
        "longitude": (("longitude",), np.arange(columns) * 360.0 / columns, east),
    }
    return Points(
        ("latitude", "longitude"), axes, None, (len(rows), columns), rows, (False, False, False)
    )


def _arrange_rows(values: Real, grid: Points) -> Real:
    """Return values in a message's order as rows (ny, nx), with columns along the grid's i."""
    ny, nx = grid.shape
    if grid.rows:
        result, start = np.empty(grid.shape), 0
        for row, count in enumerate(grid.rows):
            position = np.arange(nx) * (count / nx)
            ordered, i = values[start : start + count], np.floor(position + 1e-9).astype(int)
            share = np.clip(position - i, 0.0, 1.0)
            # a missing neighbour with weight 0 must not make the value missing
            right = np.where(share > 0, ordered[(i + 1) % count], 0.0)
            result[row] = ordered[i % count] * (1 - share) + right * share
            start += count
        return result
    alternating, down_first, leftwards = grid.flags
    result = values.reshape((nx, ny) if down_first else (ny, nx)).copy()
    if alternating:
        result[1::2] = result[1::2, ::-1]
    result = result.T if down_first else result
    return np.ascontiguousarray(result[:, ::-1] if leftwards else result)


class Values(BackendArray):  # xarray accepts only subclasses of BackendArray
    """The values of a variable; a message is decoded when a part of it is read."""

    def __init__(
        self, fields: "NDArray[np.object_]", orders: Mapping[bytes, Points], points: tuple[int, int]
    ) -> None:
        """Set the messages and their points.

        fields: messages over the leading dimensions; orders: points by grid definition; points:
        shape (ny, nx) of the grid.
        """
        self.fields, self.orders, self.points = fields, orders, points
        self.shape = fields.shape + points
        self.dtype = np.dtype(np.float64)

    def __getitem__(self, key: Any) -> Any:
        """Return the part that an xarray indexer selects."""
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.BASIC, self._part
        )

    def _part(self, key: tuple[Any, ...]) -> Real:
        before, across = key[: self.fields.ndim], key[self.fields.ndim :]
        chosen = self.fields[before]
        if isinstance(chosen, Message):
            return np.asarray(_read(chosen, self.orders)[across])
        result = np.empty(chosen.shape + np.empty(self.points, bool)[across].shape)
        for index in np.ndindex(chosen.shape):
            result[index] = _read(chosen[index], self.orders)[across]
        return result


def _read(message: Message, orders: Mapping[bytes, Points]) -> Real:
    """Return the values of a message on its grid, shape (ny, nx)."""
    points = orders[message.shape]
    try:
        values = _decode(messages.whole(message))
    except decoder.DecodeError as error:
        raise _damaged_error(message, error) from error
    expected = sum(points.rows) if points.rows else points.shape[0] * points.shape[1]
    if values.size != expected:
        raise _damaged_error(message, f"{values.size} values for {expected} points")
    return _arrange_rows(values, points)


@lru_cache(maxsize=4)  # a window across the seam is read in two parts, for two components
def _decode(message: bytes) -> Real:
    return decoder.values(message)


@dataclass(frozen=True)
class Block:
    """Messages of one variable, shape (members, times, levels); times in [s since 1970].

    begins: starts of averages' intervals [s since 1970], which end at `times`; otherwise equal to
    `times`.
    """

    members: list[int]
    times: list[int]
    begins: list[int]
    levels: list[float]
    messages: "NDArray[np.object_]"


def _fields_at(path: str, name: str, group: list[Field]) -> dict[tuple[int, float, int], Field]:
    """Return the fields of one name by (member, level, time).

    Raises UserError if two different fields have the same key.
    """
    fields_at: dict[tuple[int, float, int], Field] = {}
    for field in group:
        key = field.member, field.level, field.time
        first = fields_at.setdefault(key, field)
        if (
            first is field
            or field.role is None
            or messages.whole(field.message) == messages.whole(first.message)
        ):
            continue
        raise UserError(
            f'"{path}" gives {name} at {field.level:g} {UNITS.get(field.kind, "")} ({field.kind}) twice for '
            f"{_format_time(field.time)} (messages {first.message.number} and {field.message.number}, of the runs of "
            f"{_format_time(first.run)} and {_format_time(field.run)}): take one out (grib_copy -w dataDate=...,dataTime=...)"
        )
    return fields_at


def _format_time(seconds: int) -> str:
    return str(np.datetime64(seconds, "s").astype("datetime64[m]")).replace("T", " ")


def _split_blocks(name: str, fields_at: Mapping[tuple[int, float, int], Field]) -> dict[str, Block]:
    """Return the blocks without gaps into which a variable's fields divide, by variable name."""
    places_of: dict[float, set[tuple[int, int]]] = {}  # (member, time) by level
    for member, level, time in fields_at:
        places_of.setdefault(level, set()).add((member, time))
    levels_at: dict[frozenset[tuple[int, int]], list[float]] = {}
    for level, places in places_of.items():
        levels_at.setdefault(frozenset(places), []).append(level)
    blocks: dict[str, Block] = {}
    for shared, levels in levels_at.items():
        members = sorted({m for m, _ in shared})
        full = len(shared) == len(members) * len({t for _, t in shared})
        base = name if len(levels_at) == 1 else f"{name}_{levels[0]:g}"
        for together in [members] if full else [[m] for m in members]:
            times = sorted({t for m, t in shared if m in together})
            alone = len(together) == 1 and together[0] > 0
            block = np.empty((len(together), len(times), len(levels)), object)
            for index in np.ndindex(block.shape):
                block[index] = fields_at[
                    together[index[0]], levels[index[2]], times[index[1]]
                ].message
            begins = [fields_at[together[0], levels[0], time].begin for time in times]
            blocks[f"{base}_member{together[0]}" if alone else base] = Block(
                together, times, begins, levels, block
            )
    return blocks


def _build_variable(
    variables: dict[str, xr.Variable],
    field: Field,
    block: Block,
    orders: Mapping[bytes, Points],
    grid: Points,
    suffix: str,
) -> xr.Variable:
    """Return a block of messages as a variable; missing coordinates are added to `variables`.

    field: any field of the block, for common properties; suffix: of the grid's names.
    """
    attributes: dict[str, Any] = {"long_name": field.long_name, "GRIB_typeOfLevel": field.kind}
    if field.units not in ("unknown", "~"):
        attributes["units"] = field.units
    if field.role is not None:
        quantity, side = field.role
        attributes |= {
            "standard_name": STANDARD[quantity][int(field.along_grid)][side],
            "units": "m s-1",
        }
    about_time = {"standard_name": "time", "units": "seconds since 1970-01-01"}
    if block.begins == block.times:
        dims = [_add_coordinate(variables, "time", np.array(block.times, np.int64), about_time)]
    else:
        dims = [_add_time_of_means(variables, block, about_time)]
        attributes["cell_methods"] = f"{dims[0]}: mean"
    scalars: list[str] = []
    single_level = len(block.levels) == 1
    if field.kind in UNITS or field.kind in COUNTED or not single_level:
        positive = "up" if field.kind.startswith(POSITIVE_UP) else "down"
        about_level = {"units": UNITS.get(field.kind, "1"), "positive": positive}
        about_level["long_name"] = f"GRIB level {field.kind}"
        if field.kind == "sigma":
            about_level["standard_name"] = "atmosphere_sigma_coordinate"
        level = _add_coordinate(
            variables, field.kind, np.array(block.levels), about_level, single_level
        )
        (scalars if single_level else dims).append(level)
        if single_level:
            attributes["GRIB_level"] = block.levels[0]
    if len(block.members) > 1:
        about_member = {"long_name": "member of an ensemble"}
        dims.insert(0, _add_coordinate(variables, "member", np.array(block.members), about_member))
    fields = block.messages[:, :, 0] if single_level else block.messages
    fields = fields if len(block.members) > 1 else fields[0]
    attributes["coordinates"] = " ".join(scalars)
    if grid.mapping is not None:
        attributes["grid_mapping"] = "projection" + suffix
    dims += [d + suffix for d in grid.dims]
    values = indexing.LazilyIndexedArray(Values(fields, orders, grid.shape))
    return xr.Variable(dims, values, attributes)


def _add_time_of_means(
    variables: dict[str, xr.Variable], block: Block, about: dict[str, str]
) -> str:
    """Return the name of a time axis with the block's bounds; add it if it is absent."""
    ends, bounds = (
        np.array(block.times, np.int64),
        np.array([block.begins, block.times], np.int64).T,
    )
    number = 1
    while True:
        name = f"time_of_means_{number}"
        if name not in variables:
            variables[name] = xr.Variable((name,), ends, {**about, "bounds": f"{name}_bounds"})
            variables[f"{name}_bounds"] = xr.Variable((name, "edge"), bounds)
            return name
        if np.array_equal(variables[f"{name}_bounds"].values, bounds):
            return name
        number += 1


def _add_coordinate(
    variables: dict[str, xr.Variable],
    name: str,
    values: NDArray[Any],
    attributes: dict[str, str],
    scalar: bool = False,
) -> str:
    """Return the name of a coordinate with these values; add it if it is absent."""
    number = 1
    while True:
        own_name = name if number == 1 else f"{name}_{number}"
        dims = () if scalar else (own_name,)
        present = variables.get(own_name)
        if present is None:
            variables[own_name] = xr.Variable(dims, values[0] if scalar else values, attributes)
            return own_name
        if present.dims == dims and np.array_equal(np.atleast_1d(present.values), values):
            return own_name
        number += 1
