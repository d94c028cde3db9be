"""File formats of results: CSV that spreadsheets cannot execute, JSON values, and the run_id."""

import csv
import hashlib
import io
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from geo import notation
from geo.errors import UserError
from geo.files import digest

EPOCH = "seconds since 1970-01-01 00:00:00"  # units of times in netCDF files
# first characters of a spreadsheet formula
FORMULAS = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20")

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def plain(value: Any) -> Any:
    """Return a value that JSON can hold: numbers as numbers, NaN as null, times as ISO text."""
    # outlines hold tens of thousands of floats: the most frequent types are checked first
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, (list, tuple)):
        if all(type(v) is float and math.isfinite(v) for v in value):
            return list(value)
        return [plain(v) for v in value]
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, (np.bool_, np.integer, np.floating)):
        return plain(value.item())
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return [plain(v) for v in value] if value.ndim else plain(value[()])
    if isinstance(value, np.datetime64):
        return None if np.isnat(value) else notation.iso(value)
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Iterable):
        return [plain(v) for v in value]
    return str(value)


def json_text(value: Any, **style: Any) -> str:
    """Return a value as JSON, as `plain` makes it; style: arguments of `json.dumps`."""
    try:  # most values are plain, and need no copy
        return json.dumps(value, default=plain, allow_nan=False, **style)
    except (TypeError, ValueError):  # a key that is no text, or a NaN
        return json.dumps(plain(value), allow_nan=False, **style)


def run_id(attributes: Mapping[str, Any]) -> str:
    """Return the identifier of a run: a digest of its inputs (case, forcing, versions) and seed.

    It is the same in all files of the run. No spreadsheet reads it as a number or a date.
    """
    names = ["case", "seed", "forcing", "coast", "versions", "backend"]
    names += [name for name in ("device", "inputs") if name in attributes]
    text = "\0".join(f"{name}={attributes.get(name, '')}" for name in names)
    return f"{hashlib.sha256(text.encode()).hexdigest()[:10]}-s{attributes.get('seed', '')}"


def inputs(files: Iterable[str]) -> dict[str, str]:
    """Return the attribute that lists the files that a case read, with digests; {} for none.

    Raises UserError if a file cannot be read any more.
    """
    try:
        listed = "; ".join(f"{Path(file).name}: {digest.digest_of(file)}" for file in files)
    except OSError as error:
        raise UserError(f"{error.filename}: cannot be read any more ({error.strerror})") from None
    return {"inputs": listed} if listed else {}


def csv_text(
    header: Sequence[str], rows: Iterable[Sequence[Any]], *, run: str = "", digits: str = ""
) -> str:
    """Return a table as CSV that a spreadsheet shows and does not execute.

    All CSV files of drift are made here. A text that a spreadsheet would read as a formula gets an
    apostrophe in front (OWASP, CSV injection). Numbers, also negative ones, stay so. Line breaks
    inside a cell become spaces, as many readers split there.

    Args:
        header: names of the columns.
        rows: values of each row. None is an empty cell, a time ISO 8601, a truth value yes or no.
        run: the run_id, for a last column; "": without that column.
        digits: format of floating-point numbers, such as ".6g", those that are not finite being
            empty cells; "": as they are.
    """
    text, last = io.StringIO(), ([run] if run else [])
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*map(_safe_cell, header), *(["run_id"] if run else [])])
    for row in rows:
        writer.writerow([*(_safe_cell(_written(value, digits)) for value in row), *last])
    return text.getvalue()


def csv_rows(rows: Sequence[Mapping[str, Any]], *, run: str = "", digits: str = "") -> str:
    """Return a table with at least one row as CSV, as `csv_text` does.

    Args:
        rows: values of each row by the names of its columns, the same names in every row.
        run: as of `csv_text`.
        digits: as of `csv_text`.
    """
    return csv_text(list(rows[0]), [list(row.values()) for row in rows], run=run, digits=digits)


def _written(value: Any, digits: str) -> Any:
    """Return a value as its cell shows it; digits: as of `csv_text`."""
    if isinstance(value, str):
        return value
    if isinstance(value, (float, np.floating)):
        return value if not digits else format(value, digits) if np.isfinite(value) else ""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, np.datetime64):
        return "" if np.isnat(value) else notation.iso(value)
    return value


def _safe_cell(value: Any) -> Any:
    """Return a value as it can be written to a cell."""
    # a plain text: neither a formula nor a line break
    if not isinstance(value, str) or (value[:1].isalnum() and value.isprintable()):
        return value
    # Full-width variants of formula characters count, as do blanks in front, which spreadsheets
    # skip
    is_formula = value.lstrip().startswith(FORMULAS) or value.startswith(("\t", "\r", "\n"))
    flat = " ".join(value.splitlines())
    return f"'{flat}" if is_formula and not NUMBER.fullmatch(value) else flat
