"""The reference of commands: what the grammar of the command line says of each."""

import argparse
import textwrap

from drift.apps.cli import grammar

INTRODUCTION = """# Commands

Every command of `drift`, made from its grammar. `drift COMMAND --help` says the same in a terminal. Exit status: 0; 2 for mistakes that you can mend,
a line each; 1 for an internal error of drift, and for a forecast that misses
what its case states in `[expect]`; 130 when interrupted, 143 when asked to end. With `--json` a command prints one object, errors too."""


def subcommands(whole: argparse.ArgumentParser) -> dict[str, tuple[argparse.ArgumentParser, str]]:
    """Return each command's parser, and what the list of commands says of it."""
    (action,) = (one for one in whole._actions if isinstance(one, argparse._SubParsersAction))
    said = {choice.dest: choice.help or "" for choice in action._choices_actions}
    return {name: (command, said[name]) for name, command in action.choices.items()}


def _usage(command: argparse.ArgumentParser) -> str:
    return textwrap.dedent(" " * 7 + command.format_usage().removeprefix("usage: ")).strip()


def _sentence(text: str) -> str:
    text = text.replace("%%", "%").strip()
    return text[:1].upper() + text[1:]


def _names(action: argparse.Action) -> str:
    takes = action.metavar if action.nargs != 0 else None
    if action.choices and not takes:
        takes = "{" + ",".join(map(str, action.choices)) + "}"
    names = action.option_strings or [str(action.metavar or action.dest)]
    return ", ".join(
        f"`{name} {takes}`" if takes and action.option_strings else f"`{name}`" for name in names
    )


def section(name: str, command: argparse.ArgumentParser, said: str) -> str:
    """Return the section of a command."""
    actions = [action for action in command._actions if action.dest != "help"]
    entries = [f"{_names(action)}\n: {_sentence(action.help or '')}" for action in actions]
    usage = f"```text\n{_usage(command)}\n```"
    return "\n\n".join([f"## `drift {name}`", f"{_sentence(said)}.", usage, *entries])


def page() -> str:
    """Return the page of all commands."""
    whole = grammar.parser()
    for command, _ in subcommands(whole).values():
        command.formatter_class = lambda prog: argparse.HelpFormatter(prog, width=92)  # of the page
    parts = [section(name, *told) for name, told in subcommands(whole).items()]
    return "\n\n".join([INTRODUCTION, *parts]) + "\n"
