"""Tables that a case names, as CSV: with commas, semicolons or tabs, as spreadsheets write them in
any country.
"""

import csv
import difflib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from geo.errors import UserError
from geo.files import small

LARGEST = 10_000_000  # [bytes]


class Rows:
    """The lines of a table: their numbers, and their values by column, stripped.

    Lines without any value and those that begin with # are left out, and columns without name and
    values at the end. Columns are in lower case. Where no comma parts them one between digits is a
    decimal one.
    """

    def __init__(
        self, path: str, needed: Sequence[str], allowed: Sequence[str], words: Sequence[str] = ()
    ) -> None:
        """Read the names of the columns; raise UserError for a file that is no table, or not of
        these.

        words: columns that hold no numbers.
        """
        self.name = Path(path).name
        lines = _text(path).splitlines()
        header = next(
            (line for line in lines if line.strip() and not line.lower().startswith(("#", "sep="))),
            "",
        )
        delimiter = max(",;\t", key=header.count)
        self._reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
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
            raise UserError(f"{self.name}: {wrong}; allowed are {', '.join(allowed)}, {first}")

    def __iter__(self) -> Iterator[tuple[int, dict[str, str] | None]]:
        """Give the number and the values of each line;

        None in place of values that are not as many as the columns.
        """
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
        """Give the values of each line that has any and is no comment."""
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
        """What a line must have, for who reads that it has not."""
        return f"as many values as names are needed, {len(self.columns)}: {', '.join(self.columns)}; write decimals with points, or part columns by semicolons"


def _strange(name: str, allowed: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, allowed, n=1, cutoff=0.6)
    return f"{name or 'without a name'}{f' (did you mean {near[0]}?)' if near else ''}"


def _text(path: str) -> str:
    data = small.contents(Path(path), LARGEST)
    for mark in (b"\xff\xfe", b"\xfe\xff"):  # as spreadsheets save "Unicode text"
        if data.startswith(mark):
            return data.decode("utf-16", errors="replace")
    if data.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise UserError(f"{Path(path).name}: is a spreadsheet; save it as CSV")
    return data.decode("utf-8-sig", errors="replace")
