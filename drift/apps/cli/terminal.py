"""What the command line prints: lines at once, tables of `rich`, streams that always have a place
to go.
"""

import contextlib
import io
import os
import sys
from typing import Any

from geo.errors import UserError


def lines(error: UserError) -> list[str]:
    """Return a refusal as lines that a terminal can show, one a mistake, whatever the user had
    written.
    """
    return [_line(line) for line in error.lines]


def _line(text: str) -> str:
    line = "".join(letter if letter.isprintable() else " " for letter in text)
    return line if len(line) <= 1200 else f"{line[:600]} ... {line[-500:]}"


def open_streams() -> None:
    """Give closed streams (`>&-`) a place to go, and letters that a stream cannot show a
    substitute.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            nowhere = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
            setattr(sys, name, nowhere)
            # Taichi takes a stream that was exchanged for a notebook's
            setattr(sys, f"__{name}__", nowhere)
        elif isinstance(stream, io.TextIOWrapper) and stream.errors in {
            "strict",
            "surrogateescape",
        }:
            stream.reconfigure(errors="replace")


def say(text: str) -> None:
    """Print on standard output, at once: a failure can still be told."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        # what is left in the buffer would fail once more at the end
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise UserError(
            f"cannot write to standard output: {error.strerror}; results that were asked for stand"
        ) from None


def print_facts(title: str, named: dict[str, str]) -> None:
    """Print a title, and facts by name.

    On a terminal they are folded to its width; in a pipe each is one line.
    """
    page = empty_table("", "")
    page.show_header = False
    for column in page.columns:
        column.overflow = "fold"  # a long path is folded, not cut
    if sys.stdout.isatty():
        from rich.console import Console

        console = Console(highlight=False, markup=False)
        page.columns[0].max_width = max(console.width // 3, 16)
        console.print(title, overflow="fold")
    else:
        say(title)
    for name, fact in named.items():
        page.add_row(name, fact)
    show(page)


def show(table: Any) -> None:
    """Print a table."""
    from rich.console import Console

    if sys.stdout.isatty():
        Console(highlight=False, markup=False).print(table)
        return
    # A pipe has no width of its own: lines stay whole there, and end where their text does.
    page = io.StringIO()
    Console(file=page, highlight=False, markup=False, width=10_000, color_system=None).print(table)
    say("\n".join(line.rstrip() for line in page.getvalue().splitlines()).strip("\n"))


def empty_table(*headings: str) -> Any:
    """Return an empty table of `rich`."""
    from rich import box
    from rich.table import Table

    empty = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in headings:
        empty.add_column(heading)
    return empty
