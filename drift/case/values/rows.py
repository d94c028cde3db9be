"""Read CSV tables named by a case: separated by commas, semicolons or tabs, in any locale."""

import csv
import difflib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from geo.errors import UserError
from geo.files import small

LARGEST = 10_000_000  # [bytes]
MOST_COLUMNS = 1000


class Rows:
    """The lines of a CSV table: line numbers, and stripped values by column.

    Empty lines, lines that begin with # and empty columns at the end are skipped. Column names are
    in lower case. If columns are not separated by commas, a comma between digits is a decimal
    comma.
    """

    def __init__(
        self, path: str, needed: Sequence[str], allowed: Sequence[str], words: Sequence[str] = ()
    ) -> None:
        """Read the header.

        Args:
            path: the file.
            needed: columns that must be present.
            allowed: all columns that may be present.
            words: columns that hold text, in which commas are kept.

        Raises:
            UserError: the file is not a table, or has missing or unknown columns.
        """
        self.name = Path(path).name
        lines = _text(path).splitlines()
        header = next(
            (line for line in lines if line.strip() and not line.lower().startswith(("#", "sep="))),
            "",
        )
        delimiter = max(",;\t", key=header.count)
        self._reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
        if header.count(delimiter) >= MOST_COLUMNS:
            raise UserError(
                f"{self.name}: the header has {header.count(delimiter) + 1:,} columns; a table has "
                f"at most {MOST_COLUMNS:,}: is it one line of another kind of file?"
            )
        names = next((row for row in self._rows() if not row[0].lower().startswith("sep=")), [])
        while names and not names[-1]:
            names.pop()
        self.columns = [name.lower() for name in names]
        self._words = None if delimiter == "," else {*words}
        missing = [name for name in needed if name not in self.columns]
        strange = [name for name in self.columns if name not in allowed]
        twice = [name for name in allowed if self.columns.count(name) > 1]
        if missing or strange or twice:
            wrong = (
                f"no column {', '.join(missing)}"
                if missing
                else f"unknown column {', '.join(_strange(name, allowed) for name in strange)}"
                if strange
                else f"there are two columns {twice[0]}"
            )
            first = (
                "the first two are needed"
                if len(needed) == 2
                else f"{', '.join(needed)} are needed"
            )
            if len(needed) == len(allowed):
                first = "all are needed"
            raise UserError(f"{self.name}: {wrong}; allowed are {', '.join(allowed)}, {first}")

    def __iter__(self) -> Iterator[tuple[int, dict[str, str] | None]]:
        """Yield the number and the values of each line; None if their number does not fit."""
        for values in self._rows():
            if len(values) < len(self.columns) or any(values[len(self.columns) :]):
                yield self._reader.line_num, None
                continue
            given = dict(zip(self.columns, values, strict=False))
            if self._words is not None:
                given = {
                    key: value if key in self._words else re.sub(r"(?<=\d),(?=\d)", ".", value)
                    for key, value in given.items()
                }
            yield self._reader.line_num, given

    def _rows(self) -> Iterator[list[str]]:
        """Yield the values of each line that is neither empty nor a comment."""
        try:
            for row in self._reader:
                values = [value.strip() for value in row]
                if any(values) and not values[0].startswith("#"):
                    yield values
        except csv.Error as error:
            raise UserError(
                f"{self.name}, line {self._reader.line_num}: {error}; is a quotation mark open above?"
            ) from None

    @property
    def wanted(self) -> str:
        """The end of the message about a line with a wrong number of values."""
        return f"as many values as names are needed, {len(self.columns)}: {', '.join(self.columns)}; write decimals with points, or separate columns by semicolons"


def _strange(name: str, allowed: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, allowed, n=1, cutoff=0.6)
    return f"{name or 'without a name'}{f' (did you mean {near[0]}?)' if near else ''}"


def _text(path: str) -> str:
    data = small.read_small_file(Path(path), LARGEST)
    for mark in (b"\xff\xfe", b"\xfe\xff"):  # spreadsheets save "Unicode text" as UTF-16
        if data.startswith(mark):
            return data.decode("utf-16", errors="replace")
    if data.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise UserError(f"{Path(path).name}: is a spreadsheet; save it as CSV")
    return data.decode("utf-8-sig", errors="replace")
