"""Mistakes in a case, gathered: all independent parts are looked at before any is complained of."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from geo.errors import UserError

MOST = 20  # lines of complaint that help; the rest is counted


@dataclass
class Mistakes:
    """The complaints so far, a line each, in the order in which they were found."""

    lines: list[str] = field(default_factory=list)

    @contextmanager
    def gathered(self, place: str = "") -> Iterator[None]:
        """Go on after a refusal inside, and keep it.

        place: what the refusal is about, where it does not say so itself.
        """
        try:
            yield
        except (UserError, ValueError) as error:
            lines = error.lines if isinstance(error, UserError) else (str(error),)
            self.lines += [f"{place}: {line}" if place else line for line in lines]

    def refuse(self) -> None:
        """Raise one UserError with all that was gathered; do nothing where that is nothing."""
        if self.lines:
            raise UserError(*self.lines)


def shortened(lines: tuple[str, ...]) -> tuple[str, ...]:
    """Return lines without repetitions, the first MOST of them and how many more there are."""
    once = tuple(dict.fromkeys(lines))
    if len(once) <= MOST:
        return once
    return (*once[:MOST], f"and {len(once) - MOST} more")
