"""The result of a command, printed as a page, as one JSON object, or as warnings only."""

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drift.apps.cli import terminal

QUIET_FACTS = ("warning", "lost", "missed")  # first words of facts that --quiet prints as well


@dataclass(frozen=True)
class Answer:
    """The result of a command: facts for people, numbers for programs, and the exit status."""

    title: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    lines: tuple[str, ...] = ()  # printed after the facts
    # for programs; names end in the unit
    numbers: Mapping[str, Any] = field(default_factory=dict)
    results: Path | None = None  # folder that was written
    status: int = 0  # exit status; 1 if a forecast misses its case's [expect]
    show: Callable[[], None] | None = None  # prints tables and other output before the facts


def print_answer(answer: Answer, command: str, *, as_json: bool, quiet: bool) -> None:
    """Print an answer on standard output; quiet: print only warnings, on standard error."""
    if as_json:
        folder = {} if answer.results is None else {"results": str(answer.results)}
        heading = {"title": answer.title, "facts": dict(answer.facts)} if answer.title else {}
        from drift.products.files import formats

        _json(formats.plain({"command": command, **heading, **answer.numbers, **folder}))
        return
    if quiet:
        for name, fact in answer.facts.items():
            if name.split()[0] in QUIET_FACTS:
                print(f"drift: {name}: {fact}", file=sys.stderr)
        return
    if answer.show is not None:
        answer.show()
    if answer.title:
        terminal.print_facts(answer.title, dict(answer.facts))
    for line in answer.lines:
        terminal.print_line(line)


def print_json_errors(lines: list[str]) -> None:
    """Print error messages on standard output as JSON."""
    _json({"error": lines})


def _json(value: Mapping[str, Any]) -> None:
    terminal.print_line(json.dumps(value, allow_nan=False, ensure_ascii=False))
