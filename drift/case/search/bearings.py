"""A series of bearings from a CSV file; each line becomes a contact."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import model_validator

from drift.case.forcing import sources
from drift.case.search import heard
from drift.case.values import fields, rows
from geo.errors import UserError

MOST = 1000  # lines
NEEDED, ALLOWED = (
    ("time", "bearing"),
    ("time", "bearing", "std", "heading", "lon", "lat", "received_level", "frequency"),
)


class SeriesTable(heard.BySensorTable):
    """A series of bearings from a position or a sensor of the case."""

    file: str
    """A CSV file:

    columns `time`, `bearing`, and optionally `std`, `heading`, `lon` and `lat`, `received_level`,
    `frequency`, if these change.
    """
    std: heard.BearingError = None
    """As in a contact's `bearing` table."""
    wedge: heard.Wedge | None = None
    """As in a contact's `bearing` table."""
    near: fields.Length = 0.0
    """As in a contact's `bearing` table."""
    far: fields.Length | None = None
    """As in a contact's `bearing` table."""

    @model_validator(mode="after")
    def lone(self) -> "SeriesTable":
        """Reject a file without the suffix .csv or .txt."""
        if not self.file.lower().endswith((".csv", ".txt")):
            raise ValueError(
                f"file {self.file!r} must be a CSV file (.csv, .txt), with a header: time, bearing"
            )
        return self

    def bearings(self, folder: Path) -> Iterator[tuple[int, str, dict[str, Any], dict[str, str]]]:
        """Yield line number, time, `bearing` table and other measurements of each line of the
        file."""
        path = sources.one_file(self.file, folder, "bearings.file")
        given = self.model_dump(by_alias=True, exclude_unset=True, exclude={"file"})
        if isinstance(self.std, tuple):
            given["std"] = [list(row) for row in self.std]
        for line, row in _lines(path):
            bearing_table = given | {
                key: row[key] for key in ("bearing", "std", "heading") if row.get(key)
            }
            if row.get("lon") or row.get("lat"):
                bearing_table["from"] = [row.get("lon", ""), row.get("lat", "")]
            yield (
                line,
                row["time"],
                bearing_table,
                {key: row[key] for key in ("received_level", "frequency") if row.get(key)},
            )


def _lines(path: str) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield number and values of each line of a CSV file; raise UserError for its mistakes."""
    try:
        table = rows.Rows(path, NEEDED, ALLOWED)
    except UserError as error:
        raise UserError(f"bearings.file: {error}") from None
    many = 0
    for line, values in table:
        many += 1
        if values is None:
            raise UserError(f"bearings.file: {table.name}, line {line}: {table.wanted}")
        yield line, values
    if not 0 < many <= MOST:
        raise UserError(
            f"bearings.file: {table.name} has {many:,} bearings; 1 to {MOST:,} are allowed"
        )
