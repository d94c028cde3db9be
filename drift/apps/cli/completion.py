"""Shell completion for the command line: commands, options, shipped cases and files.

The script is generated from the grammar by shtab (Casper da Costa-Luis); it is only printed, not
installed.
"""

import argparse
from collections.abc import Iterator
from typing import Any

from drift.case import file as case_file
from drift.case import template
from geo.errors import UserError


def script(root: argparse.ArgumentParser, shell: str) -> str:
    """Return the completion script for a shell; raise UserError if shtab is not installed."""
    try:
        import shtab
    except ImportError:
        raise UserError(
            '--print-completion needs shtab: pip install -e ".[completion]" in the folder of '
            "drift's source"
        ) from None

    cases = _words("cases", [name for name, _ in case_file.shipped()], files="toml")
    completions = {
        "CASE": cases,
        "B": cases,
        "TEMPLATE": _words("stories", [*template.TEMPLATES, *template.TRACKED]),
        **dict.fromkeys(("FILE", "TRACKS", "PNG"), shtab.FILE),
        "DIR": shtab.DIRECTORY,
    }
    for action in _actions(root):
        if isinstance(action.metavar, str) and action.metavar in completions:
            action.complete = completions[action.metavar]  # type: ignore[attr-defined]
    completion: str = shtab.complete(root, shell)
    return completion


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield all arguments of a parser and of its commands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)


def _words(name: str, words: list[str], files: str = "") -> dict[str, Any]:
    """Return shtab's completion, by shell, for some words and for files with the ending `files`."""
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
        "tcsh": f"f:*.{files}" if files else f"({listed})",  # tcsh supports only one kind
        "preamble": {
            "bash": f"{function}() {{\n  {'; '.join(bash)}\n}}\n",
            "zsh": f"{function}() {{\n  _alternative {' '.join(zsh)}\n}}\n",
            "fish": f"function {function}\n  {'; '.join(fish)}\nend\n",
        },
    }
