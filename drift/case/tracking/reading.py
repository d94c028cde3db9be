"""Read tracks of drifters from CSV, or from netCDF with CF trajectories.

CSV: one fix in each row, in any order; id, time and position in columns with common names; a second
header row may hold units, as in files of the Global Drifter Program. netCDF (CF 1.11, appendix
H.4): (trajectory, obs) padded with missing values (as trajan writes it too); (trajectory, time); or
one track after another, with the length of each (contiguous ragged) or with the track number of
each fix (indexed ragged). drift.tracking.tracks.records decides which fixes are used.
"""

import csv
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import xarray as xr

from drift.case.values import units
from drift.tracking.tracks.records import Track, selected
from geo import notation
from geo.array import Array
from geo.errors import UserError
from geo.files import dataset, small
from geo.forcing.quantity import velocities

LARGEST = 1024 * 2**20  # [bytes] largest CSV file
MOST_UNPACKED = 200  # a netCDF file in memory, as a multiple of the file
NAMES = {  # common names of columns, in lower case without spaces, underscores and hyphens
    "id": (
        "id",
        "platformcode",
        "drifterid",
        "drifter",
        "buoyid",
        "buoy",
        "platform",
        "platformid",
        "wmo",
        "deviceid",
        "device",
        "name",
        "trajectory",
        "trajectoryid",
        "drifternames",
        "drifterid",
        "imei",
        "ship",
        "mmsi",
        "ids",
    ),
    "time": (
        "time",
        "datetime",
        "timestamp",
        "timeutc",
        "datetimeutc",
        "utc",
        "obstime",
        "date",
        "datautc",
    ),
    "lon": ("lon", "longitude", "long", "lng", "londeg", "longitudedeg", "x", "lons"),
    "lat": ("lat", "latitude", "latdeg", "latitudedeg", "y", "lats"),
}
ZONE = re.compile(r"\s*(?:(Z|UTC|GMT)|([+-])(\d{2})(?::?(\d{2}))?)$", re.IGNORECASE)
ISO = re.compile(r"\d{4}-\d{2}-\d{2}([T ]\d{2}(:\d{2}(:\d{2}(\.\d+)?)?)?)?")
OTHER_FORMS = (
    "%Y/%m/%d %H:%M:%S",
    "%Y/%m/%d %H:%M",
    "%Y%m%d %H:%M:%S",
    "%Y%m%dT%H%M%S",
    "%d-%b-%Y %H:%M:%S",
    "%d-%b-%Y %H:%M",
    "%d %b %Y %H:%M:%S",
    "%d %b %Y %H:%M",
)
AMBIGUOUS = re.compile(r"\d{1,2}[/.]\d{1,2}[/.]\d{4}\b")
DATASETS = (".nc", ".nc4", ".netcdf", ".cdf")


def read_drifters(
    path: str | os.PathLike[str], columns: Sequence[str] = (), given_as: str = "--drifters"
) -> tuple[Track, ...]:
    """Return the tracks of a file.

    Args:
        path: CSV or netCDF file, or a Zarr folder.
        columns: names of further columns to read.
        given_as: name of the option by which the command line takes the file, for messages.

    Returns:
        The tracks.

    Raises:
        UserError: the file holds no tracks.
    """
    path = Path(path)
    try:
        if path.suffix.lower() in DATASETS or path.is_dir():
            return _netcdf(path, columns)
        return _csv(path, columns)
    except OSError as error:
        raise UserError(f'{given_as} "{path}": cannot be read: {error.strerror or error}') from None
    except (ValueError, csv.Error) as error:
        raise UserError(f'{given_as} "{path}": {" ".join(str(error).split())[:300]}') from None


def _plain_name(name: str) -> str:
    """Return a column's name as in NAMES: lower case, without a unit in brackets (ERDDAP)."""
    return re.sub(r"[\s_\-]|\(.*\)|\[.*\]", "", name).lower()


def _column(header: Sequence[str], role: str) -> int | None:
    """Return the index of the column with a common name of id, time, lon or lat; None if absent."""
    plain = [_plain_name(name) for name in header]
    return next((plain.index(name) for name in NAMES[role] if name in plain), None)


def _csv(path: Path, wanted: Sequence[str]) -> tuple[Track, ...]:
    """Return the tracks of a CSV file; raise ValueError if it has none."""
    try:
        text = small.read_small_file(path, LARGEST).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("is neither netCDF (.nc) nor a table as text in UTF-8 (.csv)") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if len(lines) < 2:
        raise ValueError("holds no table: a header and at least one row are needed")
    delimiter = max(",;\t", key=lines[0].count)
    header, *rows = list(csv.reader(lines, delimiter=delimiter, skipinitialspace=True))
    id_column = _column(header, "id")
    positions = {role: _column(header, role) for role in ("time", "lon", "lat")}
    columns = {role: index for role, index in positions.items() if index is not None}
    if missing_key := next((role for role in positions if role not in columns), None):
        raise ValueError(
            f"no column of {missing_key}; its columns are {', '.join(header)[:200]}; one must be "
            f"called {', '.join(NAMES[missing_key][:4])}"
        )
    names = [name.strip() for name in header]
    if missing := [name for name in wanted if name not in names]:
        raise ValueError(
            f'--columns: no column "{missing[0]}"; its columns are {", ".join(names)[:300]}'
        )
    used = [
        *columns.values(),
        *(names.index(name) for name in wanted),
        *([] if id_column is None else [id_column]),
    ]
    width = max(used) + 1
    # cells that a short row lacks are missing values
    rows = [[*row, *[""] * (width - len(row))] for row in rows]
    comma = delimiter != ","  # then a comma may be a decimal comma, as in half of Europe
    lat = _numbers((row[columns["lat"]] for row in rows), comma)
    if (
        rows and not np.isfinite(lat[0]) and not _is_time(rows[0][columns["time"]])
    ):  # this is a second header row, with units
        rows, lat = rows[1:], lat[1:]
    if not rows:
        raise ValueError("holds no fix")
    clock = next(
        (
            i
            for i, name in enumerate(header)
            if _plain_name(name) in ("time", "timeutc", "hour", "hms")
        ),
        None,
    )
    stamps = [row[columns["time"]].strip() for row in rows]
    if _plain_name(header[columns["time"]]) == "date" and clock is not None:
        stamps = [f"{stamp} {row[clock].strip()}" for stamp, row in zip(stamps, rows, strict=True)]
    elif (
        clock is not None
        and (day := next((i for i, n in enumerate(header) if _plain_name(n) == "date"), None))
        is not None
    ):
        stamps = [f"{row[day].strip()} {row[clock].strip()}" for row in rows]
    time = _times(stamps)
    lon = _numbers((row[columns["lon"]] for row in rows), comma)
    for role, values in (("lon", lon), ("lat", lat)):
        if not np.isfinite(values).any():
            title, first = header[columns[role]], rows[0][columns[role]]
            raise ValueError(
                f'no row has a number in its column of {role}, "{title}": the first has '
                f'"{first[:40]}"; write degrees like -5.5'
            )
    others = {name: _numbers((row[names.index(name)] for row in rows), comma) for name in wanted}
    track = Track(path.stem, time, lon, lat, others)
    if id_column is None:
        return (track,)
    return _split(track, np.array([row[id_column].strip() for row in rows]))


def _split(all_fixes: Track, name: Array) -> tuple[Track, ...]:
    """Return the tracks of several drifters, in the order of their first fixes.

    name: the drifter of each fix, (n,).
    """
    names, first_fix, number = np.unique(name, return_index=True, return_inverse=True)
    fixes_of = np.split(np.argsort(number, kind="stable"), np.cumsum(np.bincount(number))[:-1])
    return tuple(
        replace(selected(all_fixes, fixes_of[k]), name=str(names[k])) for k in np.argsort(first_fix)
    )


def _numbers(texts: Iterable[str], comma: bool) -> Array:
    """Return texts as numbers, NaN for other text; comma: whether a comma may be decimal."""

    def number(text: str) -> float:
        try:
            return float(text.replace(",", ".") if comma else text)
        except ValueError:
            return np.nan

    return np.array([number(text) for text in texts], np.float64)


def _is_time(text: str) -> bool:
    try:
        return bool(np.isfinite(_moment(text)))
    except ValueError:
        return False


def _times(stamps: Sequence[str]) -> Array:
    """Return times [s since 1970], NaN for text that is no time; times without a zone are UTC."""
    if not any(_is_time(stamp) for stamp in stamps[:100]):
        # raises an error that names the mistake
        _moment(next((stamp for stamp in stamps if stamp), ""))
        raise ValueError(f'"{stamps[0]}" is not a time; write it like 2021-03-03T18:00:00Z')
    # Drifters often report at the same times: parse each text only once.
    time_of = {stamp: _moment(stamp) if _is_time(stamp) else np.nan for stamp in set(stamps)}
    return np.array([time_of[stamp] for stamp in stamps])


def _moment(text: str) -> float:
    """Return a time [s since 1970]; raise ValueError if the text is no time.

    It may be ISO 8601, a date-time group, seconds or milliseconds since 1970, or one of
    OTHER_FORMS.
    """
    text = text.strip()
    try:
        number = float(text)
    except ValueError:
        number = np.nan
    if 1e8 <= number < 1e10 and not re.fullmatch(r"\d{8}", text):
        return number
    if 1e11 <= number < 1e13:
        return number / 1000
    zone = ZONE.search(text)
    bare, shift = text, 0.0
    if zone and ":" in text[: zone.start()]:
        bare = text[: zone.start()]
        if zone[2]:
            shift = (-1 if zone[2] == "+" else 1) * (
                3600.0 * int(zone[3]) + 60.0 * int(zone[4] or 0)
            )
    if ISO.fullmatch(bare.strip()):
        moment = np.datetime64(bare.strip().replace(" ", "T", 1), "us")
        return float(moment.astype(np.int64)) / 1e6 + shift
    if AMBIGUOUS.match(bare):
        raise ValueError(
            f'time "{text}" can be read in two ways (day or month first); write it like '
            "2021-03-03T18:00:00Z"
        )
    for form in OTHER_FORMS:
        try:
            parsed = datetime.strptime(bare, form)
        except ValueError:
            continue
        return notation.epoch(np.datetime64(parsed, "s")) + shift
    moment_or_interval = units.time(text)
    if not isinstance(moment_or_interval, np.datetime64):
        raise ValueError(f'"{text}" is not a time; write it like 2021-03-03T18:00:00Z')
    return float(notation.epoch(moment_or_interval))


def _netcdf(path: Path, wanted: Sequence[str]) -> tuple[Track, ...]:
    """Return the tracks of a netCDF file; raise ValueError if it has none."""
    try:
        # without indexes, for which xarray would read all times
        with dataset.open_local(path, decode_cf=False, create_default_indexes=False) as data:
            _check_unpacked(data, path)
        with dataset.open_local(path, decode_timedelta=False) as data:
            return _tracks(data.load(), path, wanted)
    except OSError as error:
        if "Unknown file format" in str(error):
            raise ValueError(
                "is no netCDF file, although its name says so; a table as text must be called .csv"
            ) from None
        raise
    except (UserError, ValueError):
        raise
    except Exception as error:  # libraries raise errors of all kinds over damaged files
        raise ValueError(f"cannot be read ({type(error).__name__}: {error})") from error


def _check_unpacked(data: xr.Dataset, path: Path) -> None:
    """Reject a file that is far larger in memory than on disk: cells that were never written."""
    files = path.rglob("*") if path.is_dir() else [path]
    packed = sum(one.stat().st_size for one in files)
    if data.nbytes > max(LARGEST, MOST_UNPACKED * packed):
        raise ValueError(
            f"has {packed:,} bytes, and {data.nbytes:,} in memory: most of it was never written; "
            f"drift reads at most {LARGEST:,} bytes, or {MOST_UNPACKED} times the size of the file"
        )


def _tracks(data: xr.Dataset, path: Path, wanted: Sequence[str]) -> tuple[Track, ...]:
    """Return the tracks of a dataset with CF trajectories; raise ValueError if it has none."""
    variables = {role: _variable(data, role) for role in ("time", "lon", "lat")}
    if missing := [name for name in wanted if name not in data.variables]:
        raise ValueError(
            f'--columns: no variable "{missing[0]}"; there are '
            f"{', '.join(map(str, data.variables))[:300]}"
        )
    lon = data[variables["lon"]]
    names = _names(data)
    sizes = next((v for v in data.variables.values() if "sample_dimension" in v.attrs), None)
    if sizes is None and lon.ndim == 1:  # the Global Drifter Program's name, without the attribute
        sizes = next(
            (data.variables[n] for n in ("rowsize", "row_size", "rowSize") if n in data.variables),
            None,
        )
    index = next((v for v in data.variables.values() if "instance_dimension" in v.attrs), None)
    columns = {role: data[name] for role, name in (*variables.items(), *((n, n) for n in wanted))}
    if lon.ndim == 1:
        flat = {
            role: _seconds(column) if role == "time" else _floats(column)
            for role, column in columns.items()
        }
        if any(column.shape != lon.shape for column in flat.values()):
            raise ValueError("time, lon, lat and the columns wanted don't have the same length")
        all_fixes = Track(
            path.stem, flat["time"], flat["lon"], flat["lat"], {n: flat[n] for n in wanted}
        )
        if sizes is not None:
            rows = np.repeat(np.arange(sizes.size), sizes.values.astype(int))
            if rows.size != lon.size:
                raise ValueError(
                    f"its tracks have {rows.size:,} fixes by their lengths, and {lon.size:,} by "
                    "their positions"
                )
        elif index is not None:
            rows = index.values.astype(int)
        elif names is not None and names.size == lon.size:
            return _split(all_fixes, names)
        elif names is not None and names.size == 1:
            return (replace(all_fixes, name=str(names.ravel()[0])),)
        else:
            return (all_fixes,)
    elif lon.ndim == 2:
        many_first = names is not None and names.size == lon.shape[1] != lon.shape[0]
        if many_first or lon.dims[0] in ("obs", variables["time"]):  # each column is a track
            columns = {role: c.transpose(*c.dims[::-1]) for role, c in columns.items()}
        shape = columns["lon"].shape
        flat = {}
        for role, column in columns.items():
            if column.shape not in (shape, shape[1:]):
                raise ValueError(
                    f"{role} has the shape {column.shape}, positions have {shape}: these do not "
                    "match"
                )
            values = _seconds(column) if role == "time" else _floats(column)
            flat[role] = np.broadcast_to(values, shape).ravel()
        padded = ~(np.isfinite(flat["lon"]) & np.isfinite(flat["lat"]) & np.isfinite(flat["time"]))
        rows = np.repeat(np.arange(shape[0]), shape[1])[~padded]
        flat = {role: column[~padded] for role, column in flat.items()}
        all_fixes = Track(
            path.stem, flat["time"], flat["lon"], flat["lat"], {n: flat[n] for n in wanted}
        )
    else:
        raise ValueError(
            f"positions have {lon.ndim} dimensions; tracks have one (one after another) or two "
            "(trajectory, obs)"
        )
    if names is None or names.size <= rows.max(initial=-1):
        track_names = np.array(
            [f"{path.stem} {k + 1}" for k in range(int(rows.max(initial=0)) + 1)]
        )
    else:
        track_names = names.ravel()
    if len(set(track_names.tolist())) < track_names.size:  # keep tracks of the same name apart
        track_names = np.array([f"{name} ({k + 1})" for k, name in enumerate(track_names)])
    return _split(all_fixes, track_names[rows])


def _variable(data: xr.Dataset, role: str) -> str:
    """Return the name of the variable of time, lon or lat, by standard or common name."""
    standard = {"time": "time", "lon": "longitude", "lat": "latitude"}[role]
    listed = [str(name) for name in data.variables]
    for name in listed:
        if (
            data.variables[name].attrs.get("standard_name") == standard
            and data.variables[name].ndim
        ):
            return name
    plain = {_plain_name(name): name for name in reversed(listed)}
    for name in NAMES[role]:
        if name in plain and data.variables[plain[name]].ndim:
            return plain[name]
    raise ValueError(
        f"no variable of {role} (standard_name {standard}); there are {', '.join(listed)[:300]}"
    )


def _names(data: xr.Dataset) -> Array | None:
    """Return the drifters' names as text; None if the dataset has none."""
    by_role = [
        str(n) for n, v in data.variables.items() if v.attrs.get("cf_role") == "trajectory_id"
    ]
    plain = {_plain_name(str(name)): str(name) for name in data.variables}
    for name in (*by_role, *(plain[candidate] for candidate in NAMES["id"] if candidate in plain)):
        values = data.variables[name].values
        if values.ndim <= 1:
            texts = [
                v.decode("utf-8", "replace") if isinstance(v, bytes) else str(v)
                for v in np.atleast_1d(values)
            ]
            return np.array([text.strip() for text in texts])
    return None


def _floats(column: xr.DataArray) -> Array:
    return np.asarray(column.values, np.float64)


def _seconds(column: xr.DataArray) -> Array:
    """Return times [s since 1970], NaN where one is missing."""
    if column.dtype.kind != "M":
        raise ValueError(f'time "{column.name}" has no units such as "seconds since 1970-01-01"')
    moments = column.values.astype("datetime64[us]")
    return np.where(np.isnat(moments), np.nan, moments.astype(np.int64) / 1e6)


def parse_columns(text: str) -> Mapping[str, str]:
    """Return {"current_east": "u", ..} from "current_east=u, ..".

    Raises:
        UserError: the text has another form, or lacks a component.
    """
    allowed = [f"{quantity}_{side}" for quantity in velocities() for side in ("east", "north")]
    columns: dict[str, str] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        key, equals, column = (piece.strip() for piece in part.partition("="))
        if not equals or not column or key not in allowed:
            raise UserError(
                f'--columns "{part}": must be one of {", ".join(allowed)}, each followed by =COLUMN'
            )
        columns[key] = column
    for quantity in velocities():
        sides = [side for side in ("east", "north") if f"{quantity}_{side}" in columns]
        if len(sides) == 1:
            raise UserError(
                f"--columns: {quantity}_{sides[0]} is given without its other component"
            )
    return columns
