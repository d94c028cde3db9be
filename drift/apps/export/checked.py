"""Read and check the files of a finished result, which may be damaged or come from another program.

A file that drift cannot have written raises UserError with the file, the place in it, and the
fault.
"""

import csv
import json
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import xarray as xr

from geo.errors import UserError

LARGEST = 2**29  # [bytes] most of a text file, far more than drift writes
# depth of nested coordinate lists, for the geometry types that drift writes
DEPTH = {"Point": 0, "MultiLineString": 2, "MultiPolygon": 3}
SINGLE = ("LineString", "Polygon")  # read as a Multi geometry with one part
LEAST = {"MultiLineString": 2, "MultiPolygon": 4}  # fewest points of each line or ring

Check = Callable[[Any], bool]


def is_text(value: Any) -> bool:
    """Return True for a text."""
    return isinstance(value, str)


def is_finite_number(value: Any) -> bool:
    """Return True for a finite number, or a text of one."""
    if isinstance(value, str):
        try:
            value = float(value)
        except ValueError:
            return False
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def allow_missing(check: Check) -> Check:
    """Return a check that also accepts missing values (None or "")."""
    return lambda value: value is None or value == "" or check(value)


def is_position(lon: Any, lat: Any) -> bool:
    """Return True for a longitude and a latitude [deg], as numbers or texts."""
    return (
        is_finite_number(lon)
        and is_finite_number(lat)
        and abs(float(lon)) <= 180
        and abs(float(lat)) <= 90
    )


def is_fraction(value: Any) -> bool:
    """Return True for a number above 0 and below 1."""
    return not isinstance(value, str) and is_finite_number(value) and 0 < value < 1


def is_time(value: Any) -> bool:
    """Return True for a time as drift writes it, like 2026-06-01T20:00:00Z."""
    if not (isinstance(value, str) and value.endswith("Z") and 17 <= len(value) <= 28):
        return False
    try:
        return not np.isnat(np.datetime64(value.removesuffix("Z"), "s"))
    except ValueError:
        return False


def features(
    path: Path, needed: Mapping[str, Check], kinds: Collection[str] = tuple(DEPTH)
) -> list[dict[str, Any]]:
    """Return the checked features of a GeoJSON file.

    Args:
        path: the file.
        needed: checks of properties, by name.
        kinds: geometry types that are allowed.

    Returns:
        The features; a single line or polygon becomes a Multi geometry.

    Raises:
        UserError: the file is damaged.
    """
    document = _json(path)
    listed = document.get("features") if isinstance(document, dict) else None
    if not isinstance(listed, list):
        raise damaged_file_error(path, "holds no list of features")
    for row, feature in enumerate(listed, 1):
        place = f"feature {row}"
        if not isinstance(feature, dict) or not isinstance(feature.get("properties"), dict):
            raise damaged_file_error(path, f"{place} is not a feature with properties")
        properties = feature["properties"]
        for key, check in needed.items():
            if not check(properties.get(key)):
                raise damaged_file_error(
                    path, f"{place} has {key} {_shortened(properties.get(key))}"
                )
        shape = feature.get("geometry")
        if isinstance(shape, dict) and shape.get("type") in SINGLE:
            shape = feature["geometry"] = {
                "type": f"Multi{shape['type']}",
                "coordinates": [shape.get("coordinates")],
            }
        kind = shape.get("type") if isinstance(shape, dict) else None
        if not isinstance(kind, str) or kind not in kinds:
            raise damaged_file_error(
                path,
                f"{place} has the geometry {_shortened(kind)}; it must be a {' or '.join(kinds)}",
            )
        assert isinstance(shape, dict)
        fault = _fault(shape.get("coordinates"), DEPTH[kind], LEAST.get(kind, 1))
        if fault:
            raise damaged_file_error(path, f"{place}: {fault}")
    return listed


def _fault(coordinates: Any, depth: int, least: int) -> str:
    """Return what is wrong with coordinates nested to a depth; "" if they are right."""
    if not isinstance(coordinates, list):
        return f"its coordinates are {_shortened(coordinates)}"
    if depth:
        if depth == 1 and len(coordinates) < least:
            return f"a line of {len(coordinates)} points"
        return next(
            (fault for part in coordinates if (fault := _fault(part, depth - 1, least))), ""
        )
    good = len(coordinates) in (2, 3) and all(
        is_finite_number(x) and not isinstance(x, str) for x in coordinates
    )
    if not (good and abs(coordinates[0]) <= 180 and abs(coordinates[1]) <= 90):
        return f"{_shortened(coordinates)} is not a longitude and a latitude"
    return ""


def rows(path: Path, needed: Mapping[str, Check]) -> list[dict[str, str]]:
    """Return the checked rows of a CSV file; needed: checks of columns, by name."""
    try:
        table = list(csv.DictReader(_text(path).splitlines()))
    except csv.Error as error:
        raise damaged_file_error(path, str(error)) from None
    for line, row in enumerate(table, 2):
        for key, check in needed.items():
            if not check(row.get(key)):
                raise damaged_file_error(path, f"line {line} has {key} {_shortened(row.get(key))}")
    return table


def xml(path: Path) -> ET.Element:
    """Return the root of an XML file; a file that defines entities is rejected."""
    text = _text(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise damaged_file_error(path, "defines entities")
    try:
        return ET.fromstring(text.encode())
    except (ET.ParseError, ValueError) as error:
        raise damaged_file_error(path, str(error)) from None


def dataset(
    path: Path, left_out: list[str], variables: Mapping[str, tuple[str, ...]]
) -> xr.Dataset:
    """Return a checked netCDF file in memory.

    Args:
        path: the file.
        left_out: variables that are not read.
        variables: variables that are needed, with their dimensions.

    Returns:
        The dataset: real numbers, finite coordinates, times of type datetime, and texts in the
        attributes title and run_id.

    Raises:
        UserError: the file is damaged.
    """
    try:
        data = xr.load_dataset(path, engine="netcdf4", drop_variables=left_out)
    except Exception as error:  # the libraries raise many types for a file that they cannot read
        raise damaged_file_error(
            path, f"cannot be read as netCDF ({' '.join(str(error).split())[:150]})"
        ) from None
    for name in ("title", "run_id"):
        if not isinstance(data.attrs.get(name), str):
            raise damaged_file_error(path, f"has no attribute {name}")
    for name, dims in variables.items():
        if name not in data.variables:
            raise damaged_file_error(path, f"has no variable {name}")
        value = data[name]
        if value.dims != dims:
            raise damaged_file_error(
                path,
                f"{name} has the dimensions {', '.join(map(str, value.dims)) or 'none'}; {', '.join(dims)} are needed",
            )
        dtype_kind = value.dtype.kind
        if (dtype_kind != "M") if name == "time" else (dtype_kind not in "fiu"):
            raise damaged_file_error(
                path, f"{name} holds no {'times' if name == 'time' else 'numbers'}"
            )
        if value.size == 0:
            raise damaged_file_error(path, f"{name} is empty")
        if dims == (name,) and not np.isfinite(value.values).all():
            raise damaged_file_error(path, f"{name} has unknown values")
        if dtype_kind == "f" and np.isinf(value.values).any():
            raise damaged_file_error(path, f"{name} has infinite values")
    return data


def reject_beyond_limits(path: Path, data: xr.Dataset, names: Mapping[str, float]) -> None:
    """Reject variables with absolute values above a limit; NaN is allowed."""
    for name, limit in names.items():
        values = data[name].values
        wrong = np.abs(values) > limit
        if wrong.any():
            raise damaged_file_error(
                path, f"{name} has {values[wrong].flat[0]:g}, beyond {limit:g}"
            )


def _json(path: Path) -> Any:
    try:
        return json.loads(_text(path), parse_constant=_reject_constant)
    except (ValueError, RecursionError) as error:
        raise damaged_file_error(path, f"is no JSON ({str(error).splitlines()[0][:150]})") from None


def _reject_constant(word: str) -> Any:
    raise ValueError(f"{word} is no number of JSON")


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > LARGEST:
            raise damaged_file_error(path, f"is larger than {LARGEST / 2**20:.0f} MiB")
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise damaged_file_error(path, f"cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise damaged_file_error(path, "is no UTF-8 text") from None


def _shortened(value: Any) -> str:
    text = "missing" if value is None else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def damaged_file_error(path: Path, what: str) -> UserError:
    """Return the error for a file that is damaged or was not written by drift."""
    line = " ".join(
        f"results {path.parent}: {path.name} is damaged, or was not written by drift: {what}".split()
    )
    return UserError(f"{line}; run the case again")
