"""Bearings of a sensor in a row, from a CSV file: each line is a contact of its own."""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import model_validator

from drift.case import fields, heard, sources
from geo.errors import UserError
from geo.files import small

LARGEST = 10_000_000  # [bytes]
MOST = 1000  # lines
NEEDED, ALLOWED = (
    ("time", "bearing"),
    ("time", "bearing", "std", "heading", "lon", "lat", "received_level", "frequency"),
)


class SeriesTable(heard.BySensorTable):
    """A series of bearings from a place or a sensor of the case."""

    file: str
    """A CSV file: `time`, `bearing`, and where they change also `std`, `heading`, `lon` and `lat`, `received_level`, `frequency`."""
    std: heard.BearingError = None
    """As of a bearing."""
    wedge: heard.Wedge | None = None
    """As of a bearing."""
    near: fields.Length = 0.0
    """As of a bearing."""
    far: fields.Length | None = None
    """As of a bearing."""

    @model_validator(mode="after")
    def lone(self) -> "SeriesTable":
        """Refuse a file that is none."""
        if not self.file.lower().endswith((".csv", ".txt")):
            raise ValueError(f"file {self.file!r} must be a CSV file, with a line of names: time, bearing")
        return self

    def bearings(self, folder: Path) -> Iterator[tuple[int, str, dict[str, Any], dict[str, str]]]:
        """Give line, time, bearing as of a [[contact]], and what else was measured, of each line of its file."""
        path = sources.one_file(self.file, folder, "bearings.file")
        given = self.model_dump(by_alias=True, exclude_unset=True, exclude={"file"})
        if isinstance(self.std, tuple):
            given["std"] = [list(row) for row in self.std]
        for line, row in _lines(path):
            own = given | {key: row[key] for key in ("bearing", "std", "heading") if row.get(key)}
            if row.get("lon") or row.get("lat"):
                own["from"] = [row.get("lon", ""), row.get("lat", "")]
            yield line, row["time"], own, {key: row[key] for key in ("received_level", "frequency") if row.get(key)}


def _lines(path: str) -> Iterator[tuple[int, dict[str, str]]]:
    """Give number and values of each line of a CSV file; raise UserError for what is wrong with it."""
    name = Path(path).name
    text = small.contents(Path(path), LARGEST).decode("utf-8-sig", errors="replace")
    reader = csv.DictReader(text.splitlines(), skipinitialspace=True)
    columns = [str(column).strip() for column in reader.fieldnames or ()]
    missing, strange = [c for c in NEEDED if c not in columns], [c for c in columns if c not in ALLOWED]
    if missing or strange:
        wrong = f"no column {', '.join(missing)}" if missing else f"unknown column {', '.join(strange)}"
        raise UserError(f"bearings.file: {name}: {wrong}; allowed are {', '.join(ALLOWED)}, the first two are needed")
    reader.fieldnames = columns
    many = 0
    for row in reader:
        many += 1
        if None in row or None in row.values():
            raise UserError(f"bearings.file: {name}, line {reader.line_num}: as many values as names are needed")
        yield reader.line_num, {key: value.strip() for key, value in row.items()}
    if not 0 < many <= MOST:
        raise UserError(f"bearings.file: {name} has {many:,} bearings; 1 to {MOST:,} can be read")
