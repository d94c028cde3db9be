"""What a Python file says of a drift model of the user's own, read without running it.

The file has a function `velocity` of `current`, `wind`, `waves` and `parameters`, and may name its parameters in a
tuple PARAMETERS; docs/howto/model.md shows one. drift.engine.motion.own_model makes a model of it.
"""

import ast
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from geo.errors import UserError

FUNCTION = "velocity"
TAKES = ("current", "wind", "waves", "parameters")  # what the function is given, in this order
LATITUDE = "latitude"  # and after them, where it takes one more
NAMES = "PARAMETERS"
MOST = 4  # parameters


@dataclass(frozen=True)
class Parameter:
    """A parameter of a model: normal between particles, each of which keeps its own."""

    name: str
    mean: float
    std: float = 0.0


@dataclass(frozen=True)
class OwnMotion:
    """A drift model of the user's own: its file, and what a case gives it."""

    path: Path
    digest: str  # of the file's bytes, SHA-256
    parameters: tuple[Parameter, ...]  # in the file's order
    uses: tuple[str, ...]  # those of TAKES that its function reads
    by_latitude: bool


def read(path: Path, given: Mapping[str, tuple[float, float]]) -> OwnMotion:
    """Return what a file and a case say of a model; nothing of the file is run.

    Args:
        path: of the file.
        given: mean and standard deviation of each parameter, by name.

    Raises:
        UserError: where the file is no Python, lacks the function, or the parameters are others than it names.
    """
    data = path.read_bytes()
    try:
        tree = ast.parse(data, str(path))
    except (SyntaxError, ValueError) as error:
        where = f" in line {error.lineno}" if isinstance(error, SyntaxError) else ""
        raise UserError(f"{path.name} is no Python{where}: {getattr(error, 'msg', error)}") from None
    function = next((x for x in tree.body if isinstance(x, ast.FunctionDef) and x.name == FUNCTION), None)
    if function is None:
        raise UserError(f"{path.name} has no function {FUNCTION}({', '.join(TAKES)}); see docs/howto/model.md")
    takes = tuple(argument.arg for argument in function.args.args)
    if takes not in (TAKES, (*TAKES, LATITUDE)):
        raise UserError(
            f"{path.name}: {FUNCTION}({', '.join(takes)}) must take ({', '.join(TAKES)}), and {LATITUDE} after them "
            "if it needs it"
        )
    names = _names(tree, path)
    _check(names, given, path)
    read_names = {x.id for x in ast.walk(function) if isinstance(x, ast.Name)}
    return OwnMotion(
        path,
        hashlib.sha256(data).hexdigest(),
        tuple(Parameter(name, *given[name]) for name in names),
        tuple(name for name in TAKES if name in read_names),
        takes[-1] == LATITUDE,
    )


def _names(tree: ast.Module, path: Path) -> tuple[str, ...]:
    """Return the names of the parameters, as the file lists them."""
    for line in tree.body:
        targets = line.targets if isinstance(line, ast.Assign) else []
        if any(isinstance(target, ast.Name) and target.id == NAMES for target in targets):
            break
    else:
        return ()
    assert isinstance(line, ast.Assign)
    try:
        names = ast.literal_eval(line.value)
    except ValueError:
        names = None
    if not isinstance(names, tuple | list) or not all(isinstance(name, str) for name in names):
        raise UserError(f'{path.name}: {NAMES} must be a tuple of names, such as ("length", "keel")')
    if len(names) > MOST or len(set(names)) < len(names):
        raise UserError(f"{path.name}: {NAMES} has {', '.join(names)}; at most {MOST} are allowed, each once")
    return tuple(names)


def _check(names: tuple[str, ...], given: Mapping[str, tuple[float, float]], path: Path) -> None:
    """Raise UserError where a case gives other parameters than a file names."""
    wants = f"{path.name} takes {', '.join(names) or 'none'}"
    lines = [f'parameters: "{name}" is missing; {wants}' for name in names if name not in given]
    lines += [f'parameters: "{name}" is unknown; {wants}' for name in given if name not in names]
    if lines:
        raise UserError(*lines)
