"""The one kind of error that a user can mend.

Its texts name options as a command has them, `--threads 0`. Where no command runs, a program or a
notebook reads of the arguments of Python that are the same, `threads = 0`: `named` says it so.
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
)
# by option: the argument that is the same
ARGUMENTS = {name: name.replace("-", "_") for name in SAME} | {
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

# that run in this process; not of a thread: a command's errors may be written in its others
_commands: list[None] = []


class UserError(Exception):
    """A mistake of a user's: what is wrong, what was given, what is allowed, where to change it.

    Each mistake is one line; several are reported together.
    """

    def __init__(self, *lines: str) -> None:
        """Take one line for each mistake;

        `lines` removes line breaks that stand inside one of them.
        """
        super().__init__(*lines)

    @property
    def lines(self) -> tuple[str, ...]:
        """The mistakes, one line each."""
        return tuple(" ".join(named(str(line)).split()) for line in self.args)

    def __str__(self) -> str:
        return "\n".join(named(str(line)) for line in self.args)


@contextmanager
def of_a_command() -> Iterator[None]:
    """Have errors name options inside, as a command does."""
    _commands.append(None)
    try:
        yield
    finally:
        _commands.pop()


def named(text: str) -> str:
    """Return a text whose options are arguments of Python, unless a command runs."""
    return text if _commands else OPTION.sub(_argument, text)


def _argument(option: re.Match[str]) -> str:
    """Return `threads = 0` for `--threads 0`, `out` for `--out`, `overwrite = True` for
    `--overwrite`.
    """
    name, value = ARGUMENTS[option[1]], option[2]
    if option[1] in SWITCHES:
        return f"{name} = True"
    if value is None:
        return name
    return f"{name} = {value}" if value[-1].isdigit() else f'{name} = "{value}"'
