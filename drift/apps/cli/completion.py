"""What makes a shell complete words of the command line: commands, options, shipped cases, files.

The script is shtab's (Casper da Costa-Luis), made from the grammar; it is printed, and nothing is
installed.
"""

import argparse
from collections.abc import Iterator
from typing import Any

from drift.case import file as case_file
from drift.case import template
from geo.errors import UserError


def script(whole: argparse.ArgumentParser, shell: str) -> str:
    """Return the script that a shell is to source; raise UserError where shtab is not installed."""
    try:
        import shtab
    except ImportError:
        raise UserError(
            '--print-completion needs shtab: pip install -e ".[completion]" where drift lies'
        ) from None

    cases = _words("cases", [name for name, _ in case_file.shipped()], files="toml")
    known = {
        "CASE": cases,
        "B": cases,
        "TEMPLATE": _words("stories", [*template.TEMPLATES, *template.TRACKED]),
        **dict.fromkeys(("FILE", "TRACKS", "PNG"), shtab.FILE),
        "DIR": shtab.DIRECTORY,
    }
    for action in _actions(whole):
        if isinstance(action.metavar, str) and action.metavar in known:
            action.complete = known[action.metavar]  # type: ignore[attr-defined]
    made: str = shtab.complete(whole, shell)
    return made


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Give all arguments of a parser and of its commands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)


def _words(name: str, words: list[str], files: str = "") -> dict[str, Any]:
    """Return what completes some words and, where `files` says, files of that ending and folders;
    by shell.
    """
    listed = " ".join(words)
    bash = [f'compgen -W "{listed}" -- "$1"']
    zsh, fish = [f"'{name}:{name}:({listed})'"], [f"printf '%s\\n' {listed}"]
    if files:
        bash += [f"compgen -f -X '!*.{files}' -- \"$1\"", 'compgen -d -- "$1"']
        zsh += [f"'files:file:_files -g \"*.{files}\"'"]
        fish += [f"__fish_complete_suffix .{files}"]
    function = f"_drift_{name}"
    return {
        "bash": function,
        "zsh": function,
        "fish": f"({function})",
        "tcsh": f"f:*.{files}" if files else f"({listed})",  # it takes one kind
        "preamble": {
            "bash": f"{function}() {{\n  {'; '.join(bash)}\n}}\n",
            "zsh": f"{function}() {{\n  _alternative {' '.join(zsh)}\n}}\n",
            "fish": f"function {function}\n  {'; '.join(fish)}\nend\n",
        },
    }
