"""The exception for errors that a user can correct.

Messages name options as on a command line, `--threads 0`. In programs and notebooks, where no
command runs, `named` replaces them with the equivalent Python arguments, `threads = 0`.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager

SAME = (
    "allow",
    "allow-host",
    "at",
    "backend",
    "beams",
    "box",
    "columns",
    "ends-aground",
    "error",
    "every",
    "found",
    "heading",
    "hours",
    "host",
    "memory",
    "out",
    "overwrite",
    "particles",
    "port",
    "resume",
    "runs",
    "scenario",
    "shards",
    "speed",
    "threads",
    "time",
    "within",
)
# option -> equivalent argument, where the names differ
ARGUMENTS = {
    "time TIME": "times",  # of an export, which takes several
    **{name: name.replace("-", "_") for name in SAME},
    "drifters": "files",
    "figure": "figures",
    "from": "begin",
    "hold-out": "held_out",
    "max-gap": "gap",
    "provider": "providers",
    "to": "end",
    "with": "variants",
    "workers or --cluster": "client",
}
SWITCHES = ("overwrite", "resume")  # options that take no value
OPTION = re.compile(
    rf"--({'|'.join(ARGUMENTS)})(?![\w-])(?: (-?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?(?!\w)|(?:auto|cpu|cuda|metal|vulkan)\b))?"
)

# one entry per command running in this process; not per thread, because a command uses several
_commands: list[None] = []


class UserError(Exception):
    """A user error: what is wrong, the value given, what is allowed, where to change it.

    Each error is one line; several are reported together.
    """

    def __init__(self, *lines: str) -> None:
        """Take one line for each error; `lines` removes line breaks within one."""
        super().__init__(*lines)

    @property
    def lines(self) -> tuple[str, ...]:
        """The errors, one line each."""
        return tuple(" ".join(name_arguments(str(line)).split()) for line in self.args)

    def __str__(self) -> str:
        return "\n".join(name_arguments(str(line)) for line in self.args)


@contextmanager
def naming_options() -> Iterator[None]:
    """Keep command-line options in the messages of errors inside this context."""
    _commands.append(None)
    try:
        yield
    finally:
        _commands.pop()


def name_arguments(text: str) -> str:
    """Return a text with options replaced by Python arguments, unless a command runs."""
    return text if _commands else OPTION.sub(_as_argument, text)


def _as_argument(option: re.Match[str]) -> str:
    """Return `threads = 0` for `--threads 0`, `overwrite = True` for `--overwrite`."""
    name, value = ARGUMENTS[option[1]], option[2]
    if option[1] in SWITCHES:
        return f"{name} = True"
    if value is None:
        return name
    return f"{name} = {value}" if value[-1].isdigit() else f'{name} = "{value}"'
