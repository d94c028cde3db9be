"""What every option takes: numbers below zero too, as west and south are."""

import argparse
from collections.abc import Iterator

import pytest

from drift.apps.cli import given, grammar
from drift.apps.fetch import fetching

TEXTS = ("-98,18,-80,31", "-5", "-0.5", "-.5", "-1e3", "-3h", "-30 00.0,60")


def commands() -> dict[str, argparse.ArgumentParser]:
    """Return the parser of each command."""
    whole = grammar.parser()
    chosen = next(
        action for action in whole._actions if isinstance(action, argparse._SubParsersAction)
    )
    return dict(chosen.choices)


def taking() -> Iterator[tuple[str, argparse.Action]]:
    """Give every option of every command that takes a value of the user's own."""
    for name, parser in commands().items():
        for action in parser._actions:
            if (
                action.option_strings
                and action.nargs is None
                and action.choices is None
                and action.metavar != "DIR"
            ):
                yield name, action


OPTIONS = {f"{name} {action.option_strings[-1]}": (name, action) for name, action in taking()}


@pytest.mark.parametrize("option", OPTIONS)
def test_every_option_takes_numbers_below_zero(option: str) -> None:
    """As a word of its own, as written after a name; the grammar hands it on as it stands."""
    name, action = OPTIONS[option]
    parser = commands()[name]
    needed = [word for other in parser._actions for word in _needed(other, action)]
    for text in TEXTS:
        if action.type in (int, float):
            text = "-5" if action.type is int else "-1e3"
        found = getattr(parser.parse_args([*needed, action.option_strings[-1], text]), action.dest)
        assert (found if not isinstance(found, list) else found[-1]) == (action.type or str)(text)


def _needed(other: argparse.Action, action: argparse.Action) -> list[str]:
    """Return the words of what a command does not do without."""
    if other is action or not other.required:
        return []
    word = str(next(iter(other.choices))) if other.choices else "x"
    return [other.option_strings[-1], word] if other.option_strings else [word]


def test_the_list_of_options_is_whole() -> None:
    """Those that the western hemisphere needs are in it, with one of each kind of number."""
    assert len(OPTIONS) > 60
    assert {
        "fetch --box",
        "fit-bridge --without",
        "sensor --at",
        "sensor --heading",
        "run --set",
        "verify --hours",
    } <= {*OPTIONS}


def test_options_are_still_told_from_values() -> None:
    """A word that begins with a minus and a letter is no value; places of a command take numbers
    below zero too.
    """
    parser = grammar.parser()
    assert parser.parse_args(["objects", "-5"]).words == ["-5"]
    with pytest.raises(grammar.UserError, match="expected one argument"):
        parser.parse_args(["fetch", "--box", "--dry-run"])
    with pytest.raises(grammar.UserError, match="unrecognized arguments: -x"):
        parser.parse_args(["check", "case.toml", "-x"])


def test_boxes_of_the_western_hemisphere() -> None:
    words = ["--box", "-98,18,-80,31", "--from", "2026-11-21T00:00Z", "--to", "2026-11-23T00:00Z"]
    asked = grammar.parser().parse_args(["fetch", *words])
    box, _, _ = fetching.ordered_span(asked.case, asked.box, asked.begin, asked.end)
    assert (box.west, box.south, box.east, box.north) == (-98, 18, -80, 31)
    left = given.parse_box(
        grammar.parser().parse_args(["fit-bridge", "x.csv", "--without", "-98,18,-80,31"]).without
    )
    assert (left.west, left.south, left.east, left.north) == (-98, 18, -80, 31)
