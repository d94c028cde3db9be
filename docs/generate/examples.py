"""Examples of the documentation: the fenced blocks of its pages, and how they are run.

A comment of HTML before a block, which no reader sees, says what is to be done with it:

<!-- file: NAME -->       the block is written to the file NAME
<!-- append: NAME -->     the block is appended to it
<!-- hidden: COMMAND -->  a command that is run there, and not shown
<!-- not run: WHY -->     the block is not run

Blocks of `console` hold commands after "$ " and what they print, blocks of `sh` commands alone,
blocks of `python` go on from each other, blocks of `toml` without a file are tables that are read,
and no more. In what is printed "..." stands for anything.
"""

import argparse
import contextlib
import doctest
import io
import os
import re
import shlex
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drift.apps.cli import commands

FENCE = re.compile(
    r"^ *(?P<ticks>`{3,})(?P<kind>[\w-]*)[^\n]*\n(?P<text>.*?)^ *(?P=ticks)[ \t]*$"
    r"|^ *<!-- (?P<word>file|append|hidden|not run): (?P<said>.*?) -->",
    re.MULTILINE | re.DOTALL,
)
CHECKER = doctest.OutputChecker()
LOOSE = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text, its line, and what the comment before it says."""

    kind: str
    text: str
    line: int
    file: str = ""
    appended: bool = False
    skipped: str = ""


@dataclass(frozen=True)
class Command:
    """A command and what it is shown to print, None where nothing is shown."""

    text: str
    shown: str | None

    @property
    def words(self) -> list[str]:
        """Its words, as a shell takes them apart; what follows # is a comment."""
        return shlex.split(self.text, comments=True)


def blocks(page: Path) -> Iterator[Block]:
    """Give the blocks of a page in order; hidden commands are blocks of `sh`."""
    text = page.read_text(encoding="utf-8")
    file, appended, skipped = "", False, ""
    for match in FENCE.finditer(text):
        line = text.count("\n", 0, match.start()) + 1
        if match["word"] in ("file", "append"):
            file, appended = match["said"], match["word"] == "append"
        elif match["word"] == "not run":
            skipped = match["said"]
        elif match["word"] == "hidden":
            yield Block("sh", match["said"], line)
        else:
            yield Block(
                match["kind"], textwrap.dedent(match["text"]), line, file, appended, skipped
            )
            file, appended, skipped = "", False, ""


def listed(block: Block) -> list[Command]:
    """Return the commands of a block; a line that ends in a backslash goes on."""
    text = block.text.replace("\\\n", " ")
    if block.kind == "console":
        parts = re.split(r"^\$ ", text, flags=re.M)[1:]
        return [
            Command(first, shown) for first, _, shown in (part.partition("\n") for part in parts)
        ]
    return [Command(line, None) for line in text.splitlines() if line.strip()]


def ours(command: Command) -> bool:
    """Return whether a command is one of drift's."""
    return command.words[:1] == ["drift"]


def call(words: list[str]) -> tuple[int, str]:
    """Run drift in this process; return its exit status and what it printed."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        status = commands.main(words)
    return status, printed.getvalue()


def compared(expected: str, printed: str) -> str:
    """Return what differs between what is shown and what was printed, "" where nothing does."""
    if CHECKER.check_output(expected, printed, LOOSE):
        return ""
    return f"expected:\n{expected}\nprinted:\n{printed}"


def perform(page: Path, names: dict[str, Any]) -> int:
    """Run the examples of a page in the current folder; return how many; raise AssertionError for
    one that fails.
    """
    count = 0
    for block in blocks(page):
        place = f"{page.name}, line {block.line}"
        if block.skipped:
            continue
        if block.file:
            with open(block.file, "a" if block.appended else "w", encoding="utf-8") as to:
                to.write("\n" * block.appended + block.text)
        if block.kind == "python":
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                exec(compile(block.text, place, "exec"), names)
            names["_printed"] = printed.getvalue()
            count += 1
        elif block.kind == "output":  # of the block of Python before it
            assert not (wrong := compared(block.text, names["_printed"])), f"{place}: {wrong}"
        elif block.kind in ("console", "sh"):
            for command in listed(block):
                if not ours(command):
                    continue  # pip, cat and others
                status, printed_text = call(command.words[1:])
                shows_failure = command.shown is not None and "drift: " in command.shown
                assert status == 0 or shows_failure, f"{place}: {command.text}: {printed_text}"
                if command.shown is not None:
                    assert not (wrong := compared(command.shown, printed_text)), (
                        f"{place}: {command.text}: {wrong}"
                    )
                count += 1
        elif block.kind == "toml":
            count += 1
    return count


def main() -> None:
    """Run the examples of a page in a folder: python -m generate.examples PAGE FOLDER."""
    reader = argparse.ArgumentParser()
    reader.add_argument("page", type=Path)
    reader.add_argument("folder", type=Path)
    given = reader.parse_args()
    page = given.page.resolve()
    os.chdir(given.folder)
    count = perform(page, {"__name__": "__main__"})
    Path("examples.txt").write_text(f"{count}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
