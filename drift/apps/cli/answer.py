"""What a command found, and the three ways to tell it: as a page, as one JSON object, or not at
all.
"""

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drift.apps.cli import terminal

WARNED = ("warning", "lost", "missed")  # facts of these names are told even where nothing else is


@dataclass(frozen=True)
class Answer:
    """What a command found."""

    title: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    lines: tuple[str, ...] = ()  # after the facts
    # for programs; units stand in the names
    numbers: Mapping[str, Any] = field(default_factory=dict)
    results: Path | None = None  # folder that was written
    status: int = 0  # exit status; 1 where a forecast misses what its case expects
    show: Callable[[], None] | None = None  # prints what is no list of facts, in their place


def tell(answer: Answer, command: str, *, as_json: bool, quiet: bool) -> None:
    """Print an answer on standard output; quiet: only its warnings, on standard error."""
    if as_json:
        written = {} if answer.results is None else {"results": str(answer.results)}
        told = {"title": answer.title, "facts": dict(answer.facts)} if answer.title else {}
        from drift.products.files import formats

        _json(formats.plain({"command": command, **told, **answer.numbers, **written}))
        return
    if quiet:
        for name, fact in answer.facts.items():
            if name.split()[0] in WARNED:
                print(f"drift: {name}: {fact}", file=sys.stderr)
        return
    if answer.show is not None:
        answer.show()
    if answer.title:
        terminal.print_facts(answer.title, dict(answer.facts))
    for line in answer.lines:
        terminal.say(line)


def refuse(lines: list[str]) -> None:
    """Print on standard output, as JSON, why there is no answer."""
    _json({"error": lines})


def _json(value: Mapping[str, Any]) -> None:
    terminal.say(json.dumps(value, allow_nan=False, ensure_ascii=False))
