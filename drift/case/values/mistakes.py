"""Collect mistakes, so that a case reports the errors of all its independent parts at once."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from geo.errors import UserError

MOST = 20  # most lines of an error message; the rest is counted


@dataclass
class Mistakes:
    """The mistakes found so far, one line each, in order."""

    lines: list[str] = field(default_factory=list)

    @contextmanager
    def gathered(self, place: str = "") -> Iterator[None]:
        """Catch a UserError or ValueError raised inside, and add its lines.

        Args:
            place: prefix of each line, if the error does not name its place; "": none.
        """
        try:
            yield
        except (UserError, ValueError) as error:
            lines = error.lines if isinstance(error, UserError) else (str(error),)
            self.lines += [f"{place}: {line}" if place else line for line in lines]

    def refuse(self) -> None:
        """Raise one UserError with all lines, if there are any."""
        if self.lines:
            raise UserError(*self.lines)


def shorten_lines(lines: tuple[str, ...]) -> tuple[str, ...]:
    """Return the first MOST distinct lines, then the number of the others."""
    once = tuple(dict.fromkeys(lines))
    if len(once) <= MOST:
        return once
    return (*once[:MOST], f"and {len(once) - MOST} more")
