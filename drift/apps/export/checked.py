"""Read the files of a finished result, and check each, as it may be damaged or made by another
program.

A file that differs from those that drift writes is rejected in a line with the file, the place in
it, and the error.
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

LARGEST = 2**29  # [bytes] of a text file: far more than ours have
# of the lists of coordinates; our files have no others
DEPTH = {"Point": 0, "MultiLineString": 2, "MultiPolygon": 3}
SINGLE = ("LineString", "Polygon")  # taken for one of many
LEAST = {"MultiLineString": 2, "MultiPolygon": 4}  # points of each line or ring

Check = Callable[[Any], bool]


def words(value: Any) -> bool:
    """Whether a value is a text."""
    return isinstance(value, str)


def number(value: Any) -> bool:
    """Whether a value is a finite number, or the text of one."""
    if isinstance(value, str):
        try:
            value = float(value)
        except ValueError:
            return False
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def maybe(check: Check) -> Check:
    """Return a check that lets unknown values pass."""
    return lambda value: value is None or value == "" or check(value)


def position(lon: Any, lat: Any) -> bool:
    """Whether two values are a longitude and a latitude, or their texts."""
    return number(lon) and number(lat) and abs(float(lon)) <= 180 and abs(float(lat)) <= 90


def fraction(value: Any) -> bool:
    """Whether a value is a number above 0 and below 1."""
    return not isinstance(value, str) and number(value) and 0 < value < 1


def moment(value: Any) -> bool:
    """Whether a value is a time as our files write it, 2026-06-01T20:00:00Z."""
    if not (isinstance(value, str) and value.endswith("Z") and 17 <= len(value) <= 28):
        return False
    try:
        return not np.isnat(np.datetime64(value.removesuffix("Z"), "s"))
    except ValueError:
        return False


def features(
    path: Path, needed: Mapping[str, Check], kinds: Collection[str] = tuple(DEPTH)
) -> list[dict[str, Any]]:
    """Return the features of a GeoJSON file; needed: checks of properties by name; kinds: of
    geometries that are allowed.
    """
    whole = _json(path)
    held = whole.get("features") if isinstance(whole, dict) else None
    if not isinstance(held, list):
        raise damaged(path, "holds no list of features")
    for row, feature in enumerate(held, 1):
        place = f"feature {row}"
        if not isinstance(feature, dict) or not isinstance(feature.get("properties"), dict):
            raise damaged(path, f"{place} is not a feature with properties")
        told = feature["properties"]
        for key, check in needed.items():
            if not check(told.get(key)):
                raise damaged(path, f"{place} has {key} {_shown(told.get(key))}")
        shape = feature.get("geometry")
        if isinstance(shape, dict) and shape.get("type") in SINGLE:
            shape = feature["geometry"] = {
                "type": f"Multi{shape['type']}",
                "coordinates": [shape.get("coordinates")],
            }
        kind = shape.get("type") if isinstance(shape, dict) else None
        if not isinstance(kind, str) or kind not in kinds:
            raise damaged(
                path, f"{place} has the geometry {_shown(kind)}; it must be a {' or '.join(kinds)}"
            )
        assert isinstance(shape, dict)
        fault = _fault(shape.get("coordinates"), DEPTH[kind], LEAST.get(kind, 1))
        if fault:
            raise damaged(path, f"{place}: {fault}")
    return held


def _fault(coordinates: Any, depth: int, least: int) -> str:
    """Return what is wrong with coordinates, lists in lists to a depth; "" where nothing is."""
    if not isinstance(coordinates, list):
        return f"its coordinates are {_shown(coordinates)}"
    if depth:
        if depth == 1 and len(coordinates) < least:
            return f"a line of {len(coordinates)} points"
        return next(
            (fault for part in coordinates if (fault := _fault(part, depth - 1, least))), ""
        )
    good = len(coordinates) in (2, 3) and all(
        number(x) and not isinstance(x, str) for x in coordinates
    )
    if not (good and abs(coordinates[0]) <= 180 and abs(coordinates[1]) <= 90):
        return f"{_shown(coordinates)} is not a longitude and a latitude"
    return ""


def rows(path: Path, needed: Mapping[str, Check]) -> list[dict[str, str]]:
    """Return the rows of a CSV file; needed: checks of columns by name."""
    try:
        held = list(csv.DictReader(_text(path).splitlines()))
    except csv.Error as error:
        raise damaged(path, str(error)) from None
    for line, row in enumerate(held, 2):
        for key, check in needed.items():
            if not check(row.get(key)):
                raise damaged(path, f"line {line} has {key} {_shown(row.get(key))}")
    return held


def xml(path: Path) -> ET.Element:
    """Return the root of an XML file, which defines no entities."""
    text = _text(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise damaged(path, "defines entities")
    try:
        return ET.fromstring(text.encode())
    except (ET.ParseError, ValueError) as error:
        raise damaged(path, str(error)) from None


def dataset(
    path: Path, left_out: list[str], variables: Mapping[str, tuple[str, ...]]
) -> xr.Dataset:
    """Return a netCDF file in memory, without some variables; variables: those that are needed,
    with their dimensions.

    Their numbers are real; coordinates of one dimension are finite, and times are times. Attributes
    title and run_id are texts.
    """
    try:
        data = xr.load_dataset(path, engine="netcdf4", drop_variables=left_out)
    except Exception as error:  # whatever the libraries raise about a file that they cannot read
        raise damaged(
            path, f"cannot be read as netCDF ({' '.join(str(error).split())[:150]})"
        ) from None
    for name in ("title", "run_id"):
        if not isinstance(data.attrs.get(name), str):
            raise damaged(path, f"has no attribute {name}")
    for name, dims in variables.items():
        if name not in data.variables:
            raise damaged(path, f"has no variable {name}")
        value = data[name]
        if value.dims != dims:
            raise damaged(
                path,
                f"{name} has the dimensions {', '.join(map(str, value.dims)) or 'none'}; {', '.join(dims)} are needed",
            )
        kind = value.dtype.kind
        if (kind != "M") if name == "time" else (kind not in "fiu"):
            raise damaged(path, f"{name} holds no {'times' if name == 'time' else 'numbers'}")
        if value.size == 0:
            raise damaged(path, f"{name} is empty")
        if dims == (name,) and not np.isfinite(value.values).all():
            raise damaged(path, f"{name} has unknown values")
        if kind == "f" and np.isinf(value.values).any():
            raise damaged(path, f"{name} has infinite values")
    return data


def within(path: Path, data: xr.Dataset, names: Mapping[str, float]) -> None:
    """Reject values of variables whose size exceeds a limit; NaN is none."""
    for name, most in names.items():
        values = data[name].values
        wrong = np.abs(values) > most
        if wrong.any():
            raise damaged(path, f"{name} has {values[wrong].flat[0]:g}, beyond {most:g}")


def _json(path: Path) -> Any:
    try:
        return json.loads(_text(path), parse_constant=_refused)
    except (ValueError, RecursionError) as error:
        raise damaged(path, f"is no JSON ({str(error).splitlines()[0][:150]})") from None


def _refused(word: str) -> Any:
    raise ValueError(f"{word} is no number of JSON")


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > LARGEST:
            raise damaged(path, f"is larger than {LARGEST / 2**20:.0f} MiB")
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise damaged(path, f"cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise damaged(path, "is no UTF-8 text") from None


def _shown(value: Any) -> str:
    text = "missing" if value is None else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def damaged(path: Path, what: str) -> UserError:
    """Return the error for a file that drift cannot have written."""
    line = " ".join(
        f"results {path.parent}: {path.name} is damaged, or was not written by drift: {what}".split()
    )
    return UserError(f"{line}; run the case again")
