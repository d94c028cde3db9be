"""Bytes that a step of a particle moves, counted from the source of kernels.step.advance.

It follows the kernel and the functions that take its columns, through `ti.static` conditions and
loops as Taichi does, for one particle that is adrift before the step and after it. So it counts the
columns that are read and written with a set of features, each once, whether a column is an array of
its own or a row of one.

    python benchmarks/traffic.py [FEATURES ...]

prints a row for each set of features, a number (kernels/step/features.py); without any, for none
and for each alone.
"""

import argparse
import ast
import copy
import inspect
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import smallest

from kernels.step import advance, features, integrate, sample

# Conditions at run time that hold for a particle that is adrift all along. All others are false.
HOLD = frozenset(
    {
        "moves",
        "held.moving[0, j] == 1",
        "held.moving[0, j] == 1 and held.sets_off[0, j] > 0.5",
        "known",
    }
)
WIDE = 4  # [bytes] of every column: int32 or float32
PACKS = {"core": "core", "own": "own"}  # parameters of the kernel that hold columns


@dataclass
class Columns:
    """Columns that a step reads and writes, as (pack, array, row)."""

    read: set[tuple[str, str, int]] = field(default_factory=set)
    written: set[tuple[str, str, int]] = field(default_factory=set)
    held: set[str] = field(default_factory=set)  # conditions of HOLD that were met

    @property
    def bytes(self) -> int:
        """Bytes read and written."""
        return WIDE * (len(self.read) + len(self.written))


class _Zero(ast.NodeTransformer):
    """Put numbers for the names that only a launch knows: rows have one slot, and it is slot 0."""

    def __init__(self, known: dict[str, Any]) -> None:
        self._known = known

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return node if node.id in self._known else ast.Constant(1 if node.id == "n" else 0)

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:  # a slot that a bundle holds
        return ast.Constant(0)


class _Walk(ast.NodeVisitor):
    """A walk through one function.

    packs: names of its parameters that hold columns; given: parameters whose values are known.
    """

    def __init__(
        self,
        found: Columns,
        module: ModuleType,
        packs: dict[str, str],
        chosen: int,
        given: dict[str, Any],
    ) -> None:
        self._found, self._module, self._packs = found, module, packs
        self._known = vars(module) | {"features": chosen, "range": range, "bool": bool} | given
        self._chosen = chosen

    def _value(self, node: ast.expr) -> Any:
        return eval(
            compile(ast.Expression(ast.fix_missing_locations(node)), "", "eval"), self._known
        )

    def visit_If(self, node: ast.If) -> None:
        """Take the branch that the features choose, or that a particle adrift takes."""
        if _static(node.test):
            holds = self._value(node.test.args[0])
        else:
            self.visit(node.test)
            condition = ast.unparse(node.test)
            holds = condition in HOLD
            self._found.held |= {condition} & HOLD
        for each in node.body if holds else node.orelse:
            self.visit(each)

    def visit_For(self, node: ast.For) -> None:
        """Unroll what Taichi unrolls; go once through any other loop."""
        static = _static(node.iter)
        for value in self._value(node.iter.args[0]) if static else (None,):
            if static:
                self._known[node.target.id] = value
            for each in node.body:
                self.visit(each)

    def visit_ListComp(self, node: ast.ListComp) -> None:
        """Unroll a row of numbers that Taichi unrolls."""
        (of,) = node.generators
        for value in self._value(of.iter.args[0]) if _static(of.iter) else (None,):
            if value is not None:
                self._known[of.target.id] = value
            self.visit(node.elt)

    def visit_Assign(self, node: ast.Assign) -> None:
        """Remember what is known when the kernel is compiled."""
        if _static(node.value) and isinstance(node.targets[0], ast.Name):
            self._known[node.targets[0].id] = self._value(node.value.args[0])
        else:
            self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        """Count what is added to as read and as written."""
        self.generic_visit(node)
        if isinstance(node.target, ast.Subscript):
            self._note(node.target, self._found.read)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        """Count an element of a column."""
        stored = isinstance(node.ctx, ast.Store)
        self._note(node, self._found.written if stored else self._found.read)
        self.generic_visit(node)

    def _note(self, node: ast.Subscript, among: set[tuple[str, str, int]]) -> None:
        array = node.value
        if not (isinstance(array, ast.Attribute) and isinstance(array.value, ast.Name)):
            return
        pack = self._packs.get(array.value.id)
        if pack:
            row = self._value(_Zero(self._known).visit(copy.deepcopy(node.slice)))
            among.add((pack, array.attr, int(row)))

    def visit_Call(self, node: ast.Call) -> None:
        """Follow a function that is given columns."""
        self.generic_visit(node)
        given = [
            self._packs.get(each.id) if isinstance(each, ast.Name) else None for each in node.args
        ]
        if any(given):
            module = self._module
            if isinstance(node.func, ast.Attribute):
                module = getattr(module, node.func.value.id)
            called = _function(module, ast.unparse(node.func).rsplit(".", 1)[-1])
            names = [parameter.arg for parameter in called.args.args]
            packs = {name: pack for name, pack in zip(names, given, strict=False) if pack}
            literals = {
                name: argument.value
                for name, argument in zip(names, node.args, strict=False)
                if isinstance(argument, ast.Constant)
            }
            _walk(self._found, module, called, packs, self._chosen, literals)


def _static(node: ast.expr) -> bool:
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "ti.static"


def _function(module: ModuleType, name: str) -> ast.FunctionDef:
    """Return the source of a function of a module."""
    body = ast.parse(inspect.getsource(module)).body
    return next(each for each in body if isinstance(each, ast.FunctionDef) and each.name == name)


def _walk(
    found: Columns,
    module: ModuleType,
    function: ast.FunctionDef,
    packs: dict[str, str],
    chosen: int,
    given: dict[str, Any],
) -> None:
    walk = _Walk(found, module, packs, chosen, given)
    for each in function.body:
        walk.visit(each)


def columns(chosen: int) -> Columns:
    """Return the columns that a step reads and writes with these features (kernels.step.features).

    Raises:
        LookupError: the kernel has other conditions than HOLD names.
    """
    found = Columns()
    _walk(found, advance, _function(advance, "_advance"), PACKS, chosen, {})
    if found.held != HOLD:
        raise LookupError(
            f"kernels.step.advance has no condition {sorted(HOLD - found.held)}: see HOLD of {__file__}"
        )
    return found


def stages(chosen: int) -> int:
    """Return the number of stages of the scheme."""
    return len(integrate.CLASSICAL[0] if chosen & features.RK4 else integrate.MIDPOINT[0])


def looked_up() -> int:
    """Return the bytes of the nodes that one look-up of a tile reads."""
    nodes = {
        ast.unparse(each)
        for each in ast.walk(_function(sample, "of_tile"))
        if isinstance(each, ast.Subscript) and ast.unparse(each.value) == "nodes"
    }
    return len(nodes) * sample.f32x4.n * WIDE


def gathered(chosen: int) -> int:
    """Return the bytes of forcing that a step gathers, where each quantity has one tile."""
    quantities = sum(bool(chosen & bit) for bit in features.FORCING.values())
    return stages(chosen) * quantities * looked_up()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    alone = [
        value for name, value in vars(features).items() if name.isupper() and isinstance(value, int)
    ]
    parser.add_argument("features", nargs="*", type=int, default=[0, *alone])
    given = smallest.parse(parser)
    print(
        f"{'features':>8}{'bytes of columns':>18}{'of forcing':>12}  columns that are read, and written"
    )
    for number in given.features:
        found = columns(number)
        names = (
            sorted(f"{array}[{row}]" for _, array, row in part)
            for part in (found.read, found.written)
        )
        print(
            f"{number:>8}{found.bytes:>18}{gathered(number):>12}  {'; '.join(map(' '.join, names))}"
        )


if __name__ == "__main__":
    main()
