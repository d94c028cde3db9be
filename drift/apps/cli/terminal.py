"""What the command line prints: lines that appear at once, tables of `rich`, and safe streams."""

import contextlib
import io
import os
import sys
from typing import Any

from geo.errors import UserError


def printable_error_lines(error: UserError) -> list[str]:
    """Return the lines of an error, one per mistake, without unprintable letters and shortened."""
    return [_line(line) for line in error.lines]


def _line(text: str) -> str:
    line = "".join(letter if letter.isprintable() else " " for letter in text)
    return line if len(line) <= 1200 else f"{line[:600]} ... {line[-500:]}"


def open_streams() -> None:
    """Make the standard streams safe to print to.

    Closed streams (`>&-`) become the null device; letters that cannot be encoded become "?".
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            null_stream = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
            setattr(sys, name, null_stream)
            # Taichi mistakes a replaced stream for a notebook's
            setattr(sys, f"__{name}__", null_stream)
        elif isinstance(stream, io.TextIOWrapper) and stream.errors in {
            "strict",
            "surrogateescape",
        }:
            stream.reconfigure(errors="replace")


def print_line(text: str) -> None:
    """Print a line on standard output at once; raise UserError if the stream rejects it."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        # else the text that is left in the buffer would fail again at exit
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise UserError(
            f"cannot write to standard output: {error.strerror}; results already written are "
            "complete"
        ) from None


def print_facts(title: str, facts: dict[str, str]) -> None:
    """Print a title and facts by name, folded on a terminal, one line each in a pipe."""
    table = empty_table("", "")
    table.show_header = False
    for column in table.columns:
        column.overflow = "fold"  # a long path is folded, not cut
    if sys.stdout.isatty():
        from rich.console import Console

        console = Console(highlight=False, markup=False)
        table.columns[0].max_width = max(console.width // 3, 16)
        console.print(title, overflow="fold")
    else:
        print_line(title)
    for name, fact in facts.items():
        table.add_row(name, fact)
    print_table(table)


def print_table(table: Any) -> None:
    """Print a table of `rich`."""
    from rich.console import Console

    if sys.stdout.isatty():
        Console(highlight=False, markup=False).print(table)
        return
    # A pipe has no width: lines are not folded there, and trailing blanks are removed.
    page = io.StringIO()
    Console(file=page, highlight=False, markup=False, width=10_000, color_system=None).print(table)
    print_line("\n".join(line.rstrip() for line in page.getvalue().splitlines()).strip("\n"))


def empty_table(*headings: str) -> Any:
    """Return an empty table of `rich` with these headings."""
    from rich import box
    from rich.table import Table

    empty = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in headings:
        empty.add_column(heading)
    return empty
