"""Reads a Python file with a drift model, a user's or the package's, without running it.

The file defines a function `velocity` of `current`, `wind`, `waves` and `parameters`, and may name
its parameters in a tuple PARAMETERS; docs/howto/model.md has an example.
drift.engine.motion.models.own_model turns it into a model.
"""

import ast
import hashlib
import importlib.util
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from geo.errors import UserError

FUNCTION = "velocity"
TAKES = ("current", "wind", "waves", "parameters")  # arguments of the function, in this order
LATITUDE = "latitude"  # optional last argument
NAMES = "PARAMETERS"
MOST = 4  # parameters
SUFFIX = ".py"
SHIPPED = "kernels.drift_models"  # package with the files of the package's own models


@dataclass(frozen=True)
class Parameter:
    """A parameter of a model, normally distributed between particles and constant for each."""

    name: str
    mean: float
    std: float = 0.0


@dataclass(frozen=True)
class OwnMotion:
    """A drift model that a file defines: the file and the case's parameters."""

    path: Path
    digest: str  # of the file's bytes, SHA-256
    parameters: tuple[Parameter, ...]  # in the file's order
    uses: tuple[str, ...]  # those of TAKES that its function reads
    by_latitude: bool


@lru_cache(maxsize=1)
def shipped() -> dict[str, Path]:
    """Return the files of the package's own drift models, by name."""
    # the package is not imported, because that would load the Taichi compiler
    found = importlib.util.find_spec(SHIPPED)
    folders = found.submodule_search_locations if found else None
    files = sorted(path for folder in folders or () for path in Path(folder).glob(f"*{SUFFIX}"))
    return {path.stem: path for path in files if path.stem != "__init__"}


def is_own(motion: str) -> bool:
    """Return whether a case's `motion` is a file with a drift model, a user's or the package's."""
    return motion.endswith(SUFFIX) or motion in shipped()


def read(path: Path, given: Mapping[str, tuple[float, float]]) -> OwnMotion:
    """Return a model from its file and the case's parameters; the file is not run.

    Args:
        path: of the file.
        given: mean and standard deviation of each parameter, by name.

    Raises:
        UserError: if the file is not valid Python, the function has the wrong form, or the
            parameters differ from those the file names.
    """
    data = path.read_bytes()
    try:
        tree = ast.parse(data, str(path))
    except (SyntaxError, ValueError) as error:
        where = f" in line {error.lineno}" if isinstance(error, SyntaxError) else ""
        raise UserError(
            f"{path.name} is not valid Python{where}: {getattr(error, 'msg', error)}"
        ) from None
    function = _function(tree, path)
    names = _parameter_names(tree, path)
    _check_body(function, tree, names, path)
    _check_parameters(names, given, path)
    takes = [argument.arg for argument in function.args.args]
    return OwnMotion(
        path,
        hashlib.sha256(data).hexdigest(),
        tuple(Parameter(name, *given[name]) for name in names),
        tuple(name for name in TAKES if name in _names_read(function)),
        takes[-1] == LATITUDE,
    )


def _function(tree: ast.Module, path: Path) -> ast.FunctionDef:
    """Return the definition of a file's function; raise UserError unless there is exactly one."""
    made = [line for line in tree.body if FUNCTION in _bound_names(line)]
    if len(made) > 1:
        raise UserError(
            f"{path.name}: {FUNCTION} is defined in lines {_join_numbers(line.lineno for line in made)}; keep one"
        )
    if not made or not isinstance(made[0], ast.FunctionDef):
        raise UserError(
            f"{path.name} has no function {FUNCTION}({', '.join(TAKES)}) outside classes, branches and other functions; "
            "see docs/howto/model.md"
        )
    given = made[0].args
    takes = tuple(argument.arg for argument in given.args)
    plain = not (
        given.posonlyargs or given.kwonlyargs or given.vararg or given.kwarg or given.defaults
    )
    if not plain or takes not in (TAKES, (*TAKES, LATITUDE)):
        raise UserError(
            f"{path.name}: {FUNCTION}({ast.unparse(given)}) must take ({', '.join(TAKES)}), and {LATITUDE} after them "
            "if it needs it"
        )
    return made[0]


def _bound_names(line: ast.stmt) -> set[str]:
    """Return the names that a statement at module level binds."""
    if isinstance(line, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return {line.name}
    targets = (
        line.targets
        if isinstance(line, ast.Assign)
        else [line.target]
        if isinstance(line, ast.AnnAssign)
        else []
    )
    return {target.id for target in targets if isinstance(target, ast.Name)}


def _check_body(
    function: ast.FunctionDef, tree: ast.Module, names: tuple[str, ...], path: Path
) -> None:
    """Raise UserError for code that would abort the process, be misread, or give an unclear
    message.
    """
    lines = []
    last = function.body[-1]
    early = [
        node for node in ast.walk(function) if isinstance(node, ast.Return) and node is not last
    ]
    if early or not isinstance(last, ast.Return) or last.value is None:
        where = f", not in line {_join_numbers(node.lineno for node in early)}" if early else ""
        lines.append(
            f"{FUNCTION} must return its velocity in its last line, and nowhere else{where}; "
            "assign it to a variable in branches"
        )
    for node in ast.walk(function):
        if (
            isinstance(node, ast.Subscript)
            and isinstance(node.value, ast.Name)
            and node.value.id == "parameters"
        ):
            try:
                index = ast.literal_eval(node.slice)
            except ValueError:
                continue
            if index not in range(len(names)):
                has = f"names {len(names)}: {', '.join(names)}" if names else "names none"
                lines.append(f"line {node.lineno} reads parameters[{index}], and {NAMES} {has}")
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id in ("ti", "taichi")
        ):
            if node.attr in ("init", "reset"):
                lines.append(
                    f"line {node.lineno} calls {ast.unparse(node)}, which drift does itself; leave it out"
                )
            elif node.attr in ("random", "randn"):
                lines.append(
                    f"line {node.lineno} draws with {ast.unparse(node)}; state uncertainty in [uncertainty]"
                )
    if lines:
        raise UserError(*(f"{path.name}: {line}" for line in lines))


def _join_numbers(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(numbers)))


def _names_read(function: ast.FunctionDef) -> set[str]:
    """Return the names that a function may read before it assigns them.

    An assignment in a branch does not count, because the branch may not be taken.
    """
    reads: set[str] = set()
    own: set[str] = set()
    for line in function.body:
        names = [node for node in ast.walk(line) if isinstance(node, ast.Name)]
        read = {node.id for node in names if isinstance(node.ctx, ast.Load)}
        for node in ast.walk(line):
            if isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name):
                read.add(node.target.id)
        reads |= read - own
        if isinstance(line, ast.Assign | ast.AnnAssign):
            own |= {node.id for node in names if isinstance(node.ctx, ast.Store)}
    return reads


def _parameter_names(tree: ast.Module, path: Path) -> tuple[str, ...]:
    """Return the names of the parameters in the file's order."""
    line = next((line for line in tree.body if NAMES in _bound_names(line)), None)
    if line is None:
        return ()
    try:
        names = ast.literal_eval(getattr(line, "value", None) or ast.Name("nothing"))
    except ValueError:
        names = None
    if not isinstance(names, tuple | list) or not all(isinstance(name, str) for name in names):
        raise UserError(
            f'{path.name}: {NAMES} must be a tuple of names, such as ("length", "keel")'
        )
    if len(names) > MOST or len(set(names)) < len(names):
        raise UserError(
            f"{path.name}: {NAMES} has {', '.join(names)}; at most {MOST} are allowed, each once"
        )
    return tuple(names)


def _check_parameters(
    names: tuple[str, ...], given: Mapping[str, tuple[float, float]], path: Path
) -> None:
    """Raise UserError if the case's parameters differ from those that the file names."""
    wants = f"{path.name} takes {', '.join(names) or 'none'}"
    lines = [f'parameters: "{name}" is missing; {wants}' for name in names if name not in given]
    lines += [f'parameters: "{name}" is unknown; {wants}' for name in given if name not in names]
    if lines:
        raise UserError(*lines)
