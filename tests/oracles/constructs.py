"""Finds, in the source of kernels, constructs that Taichi 1.7.4 cannot do on some backend.

Each finder takes a function's syntax tree and the names that the function sees, and returns what it
found, a line each. What happens on which backend was seen with Mesa 25 (Vulkan without a card).
"""

import ast
import functools
import importlib
import inspect
from collections.abc import Callable, Iterator
from typing import Any

import taichi as ti
from places import ROOT
from taichi.lang.argpack import ArgPackType
from taichi.types import ndarray_type

FILES = {path.stem: path for path in (ROOT / "kernels").rglob("*.py") if path.stem != "__init__"}
MODULES = sorted(FILES)

# Modules that may call Taichi's own functions of angles and its powers: `angles` (float32) and
# `doubles` (float64) choose what a backend can do, `probe` measures how it does it.
OWN_FUNCTIONS = {"angles", "doubles", "probe"}
ANGLES = {"sin", "cos", "tan", "asin", "acos", "atan2", "pow"}
INTEGERS = {ti.u8, ti.i32, ti.i64}

Names = dict[str, Any]


def _imported(module: str) -> Any:
    """Return a module of kernels by its name alone."""
    return importlib.import_module(".".join(FILES[module].relative_to(ROOT).with_suffix("").parts))


@functools.cache
def functions(module: str) -> tuple[tuple[ast.FunctionDef, Names], ...]:
    """Return each kernel and device function of a module, with the names that it sees.

    Those of a function that makes kernels see its arguments too, of which nothing is known here.
    """
    tree = ast.parse(FILES[module].read_text(encoding="utf-8"))
    names = vars(_imported(module))
    found: list[tuple[ast.FunctionDef, Names]] = []
    for node in tree.body:
        given = (
            {one.arg: None for one in node.args.args} if isinstance(node, ast.FunctionDef) else {}
        )
        for inner in ast.walk(node):
            if decorated(inner, "kernel", "func"):
                found.append((inner, names if inner is node else names | given))
    return tuple(found)


def kernels(module: str) -> dict[str, Any]:
    """Return the kernels of a module, by its name and theirs."""
    own = _imported(module)
    mine = {
        name: each for name, each in vars(own).items() if getattr(each, "_primal", None) is not None
    }
    return {
        f"{module}.{name}": each for name, each in mine.items() if each.__module__ == own.__name__
    }


def decorated(node: ast.AST, *names: str) -> bool:
    """Return whether a node defines a function with one of these decorators of Taichi."""
    own = node.decorator_list if isinstance(node, ast.FunctionDef) else []
    return bool({ast.unparse(each) for each in own} & {f"ti.{name}" for name in names})


def bounds(function: ast.FunctionDef, names: Names) -> list[str]:
    """Find outermost loops that end at a `//` of shapes and constants, or begin at a shape.

    Taichi computes such an end on the device, where no pass has taken `//` apart ("Not supported"),
    and knows no begin of that kind ("Begin fails"). With a term that is neither shape nor constant
    it computes the bound beforehand, and all is well.
    """
    found = []
    locals_ = {one.arg for one in function.args.args}
    values: dict[str, ast.expr] = {}

    def fixed(node: ast.AST) -> bool:
        """Return whether an expression holds shapes and constants only."""
        if isinstance(node, ast.Attribute) and node.attr == "shape":
            return True
        if isinstance(node, ast.Name):
            return node.id not in locals_
        return all(fixed(child) for child in ast.iter_child_nodes(node))

    def look(body: list[ast.stmt]) -> None:
        for line in body:
            if isinstance(line, ast.Assign):
                for target in ast.walk(line.targets[0]):
                    if isinstance(target, ast.Name):
                        locals_.add(target.id)
                        values[target.id] = line.value
            elif isinstance(line, ast.If) and is_static(line.test):
                look(line.body + line.orelse)
            elif isinstance(line, ast.For) and isinstance(line.iter, ast.Call):
                ends = line.iter.args if ast.unparse(line.iter.func) == "range" else []
                ends = [values.get(e.id, e) if isinstance(e, ast.Name) else e for e in ends]
                divides = ends and isinstance(ends[-1], ast.BinOp)
                divides = divides and isinstance(ends[-1].op, ast.FloorDiv) and fixed(ends[-1])
                begins = len(ends) > 1 and fixed(ends[0]) and ".shape" in ast.unparse(ends[0])
                if divides or begins:
                    found.append(f"line {line.lineno}: {ast.unparse(line.iter)}")

    if decorated(function, "kernel"):
        look(function.body)
    return found


def angles(function: ast.FunctionDef, _: Names) -> list[str]:
    """Find Taichi's functions of angles, and powers whose exponent is no whole number.

    In SPIR-V they do not compile for float64; for float32 Vulkan promises 2^-11 of a sine only.
    """
    found = []
    for node in at_run_time(function):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            of_taichi = ast.unparse(node.func.value) in ("ti", "ti.math")
            if of_taichi and node.func.attr in ANGLES:
                found.append(f"line {node.lineno}: {ast.unparse(node)}")
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            exponent = getattr(node.right, "value", None)
            if not isinstance(exponent, int):
                found.append(f"line {node.lineno}: {ast.unparse(node)}")
    return found


def half_written(function: ast.FunctionDef, names: Names) -> list[str]:
    """Find arrays that a kernel only writes, and not whichever way it goes.

    Where such an array is NumPy's, Taichi does not copy it to a graphics card, but copies it back
    whole: what was not written is what that memory held before. It does no harm to device arrays.
    """
    if not decorated(function, "kernel"):
        return []
    uses: dict[str, int] = {}
    stores = [name for node in ast.walk(function) for name in stored(node)]
    for node in ast.walk(function):
        if isinstance(node, ast.Name):
            uses[node.id] = uses.get(node.id, 0) + 1
        elif isinstance(node, ast.Attribute) and node.attr == "shape":
            uses[ast.unparse(node.value)] = uses.get(ast.unparse(node.value), 0) - 1
    only = {name for name in arrays(function, names) if stores.count(name) == uses.get(name)}
    return sorted(only & set(stores) - surely(function.body))


def surely(body: list[ast.stmt]) -> set[str]:
    """Return the arrays that statements write whichever way they go, if loops are gone through."""
    found: set[str] = set()
    for line in body:
        found.update(stored(line))
        if isinstance(line, ast.For):
            found |= surely(line.body)
        elif isinstance(line, ast.If):
            first, second = surely(line.body), surely(line.orelse)
            found |= first | second if is_static(line.test) else first & second
        if any(isinstance(node, ast.Continue | ast.Break) for node in ast.walk(line)):
            break
    return found


def stored(line: ast.AST) -> Iterator[str]:
    """Yield the names of arrays to an element of which a statement itself assigns."""
    for target in line.targets if isinstance(line, ast.Assign) else []:
        for one in target.elts if isinstance(target, ast.Tuple) else [target]:
            if isinstance(one, ast.Subscript):
                yield ast.unparse(one.value)


def in_while(function: ast.FunctionDef, names: Names, counting: set[str]) -> list[str]:
    """Find integer atomics in a `while` loop, in the function or in what the loop calls.

    Mesa 22.3 counts wrongly where particles leave such a loop at different times.

    counting: names of functions that hold atomics.
    """
    found = []
    for loop in at_run_time(function):
        for node in ast.walk(loop) if isinstance(loop, ast.While) else []:
            called = isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1]
            if is_atomic(node, function, names) or called in counting:
                found.append(f"line {node.lineno}: {ast.unparse(node)}")
    return sorted(set(found))


def counting_functions(each: list[tuple[ast.FunctionDef, Names]]) -> set[str]:
    """Return the names of functions that hold integer atomics, or call one that does."""
    found = {f.name for f, names in each for node in ast.walk(f) if is_atomic(node, f, names)}
    while True:
        more = {f.name for f, _ in each for called in calls(f) if called in found}
        if more <= found:
            return found
        found |= more


def calls(function: ast.FunctionDef) -> Iterator[str]:
    """Yield the names of the functions that a function calls, without their modules."""
    for node in ast.walk(function):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func).split(".")[-1]


def is_atomic(node: ast.AST, function: ast.FunctionDef, names: Names) -> bool:
    """Return whether a node is an atomic operation on an array of integers."""
    if isinstance(node, ast.Call):
        return ast.unparse(node.func).startswith("ti.atomic_")
    if not (isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Subscript)):
        return False
    array = node.target.value
    if isinstance(array, ast.Attribute):  # of a group of arguments
        groups = [one.members for one in names.values() if isinstance(one, ArgPackType)]
        kind = next((members[array.attr] for members in groups if array.attr in members), None)
    else:
        kind = arrays(function, names).get(ast.unparse(array))
    return getattr(kind, "dtype", None) in INTEGERS


def at_run_time(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a node and all below it, without what is computed when the kernel is compiled."""
    yield node
    if not is_static(node):
        for child in ast.iter_child_nodes(node):
            yield from at_run_time(child)


def is_static(node: ast.AST) -> bool:
    """Return whether an expression is computed when the kernel is compiled."""
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "ti.static"


def arrays(function: ast.FunctionDef, names: Names) -> dict[str, Any]:
    """Return the kinds of a function's parameters that are arrays."""
    given = [one for one in function.args.args if one.annotation is not None]
    kinds = {one.arg: eval(ast.unparse(one.annotation), names) for one in given}
    return {name: kind for name, kind in kinds.items() if is_array(kind)}


def is_array(kind: Any) -> bool:
    """Return whether an annotation is that of an array."""
    return isinstance(kind, ndarray_type.NdarrayType)


def buffers(kernel: Callable[..., Any]) -> int:
    """Return how many buffers a kernel has: its arrays, one of its arguments, one of loops' bounds.

    A group of arguments that holds numbers has one more. Taichi leaves out arrays that a variant
    does not use, so this is an upper bound.
    """
    kinds = [one.annotation for one in inspect.signature(kernel).parameters.values()]
    groups = [list(kind.members.values()) for kind in kinds if isinstance(kind, ArgPackType)]
    members = [kind for group in groups for kind in group]
    return 2 + sum(map(is_array, kinds + members)) + sum(not all(map(is_array, g)) for g in groups)
