"""No kernel holds what Taichi 1.7.4 cannot do on a graphics card; each finder finds what it should.

This reads the source and starts no card. CONTRIBUTING.md lists the constructs and what to write
instead. Lists of what is left must shrink: a test fails when something in them is mended.
"""

import ast
from typing import Any, NamedTuple

import constructs
import pytest
import taichi as ti
from constructs import Names

# A kernel on Metal has 31 buffers, on Vulkan with Mesa 22.3 it has 32.
MOST_BUFFERS = 31
TOO_MANY: dict[str, int] = {}  # kernels over that limit, with their buffers

# Kernels that may leave out elements of arrays: their callers pass device arrays.
ON_DEVICE = {
    "prior.draw_area",
    "prior.draw_lost",
    "prior.draw_objects",
    "prior.draw_position",
    "prior.draw_trackline",
    "tally._mark",
}
WHOLE = {"beams._missed"}  # it writes every element: one of each beam, over all turns of a loop


class Rule(NamedTuple):
    """A construct: how it is found, what to write instead, and where it is still left."""

    find: Any
    instead: str
    left: set[str]


RULES = {
    "bounds": Rule(
        constructs.bounds,
        "write >> for a power of two, or take the bound from an argument; begin at 0 and add",
        set(),
    ),
    "angles": Rule(
        constructs.angles,
        "call kernels.maths.angles (float32) or kernels.maths.doubles (float64)",
        set(),
    ),
    "half written": Rule(
        constructs.half_written,
        "write every element, or pass device arrays and name the kernel in ON_DEVICE",
        ON_DEVICE | WHOLE,
    ),
    "in while": Rule(
        constructs.in_while,
        "count in a local variable, and add it to the array after the loop",
        {"clouds.apply_sweep", "follower.keep_off", "steer._born", "steer._moved"},
    ),
}


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
def test_kernels_do_without(rule: Rule) -> None:
    each = [(module, *one) for module in constructs.MODULES for one in constructs.functions(module)]
    if rule.find is constructs.angles:
        each = [own for own in each if own[0] not in constructs.OWN_FUNCTIONS]
    found = look(rule, each)
    fresh = {name: lines for name, lines in found.items() if name not in rule.left}
    assert not fresh, f"{rule.find.__doc__.splitlines()[0]} Instead: {rule.instead}."
    mended = rule.left - found.keys()
    assert not mended, "mended, or renamed: take them off the list in this file"


def look(rule: Rule, each: list[tuple[str, ast.FunctionDef, Names]]) -> dict[str, list[str]]:
    """Return what a rule finds in functions, given with their modules, by module and function."""
    more = ()
    if rule.find is constructs.in_while:
        more = (constructs.counting_functions([own[1:] for own in each]),)
    found = {f"{module}.{f.name}": rule.find(f, names, *more) for module, f, names in each}
    return {name: lines for name, lines in found.items() if lines}


def test_kernels_have_as_many_buffers_as_a_card() -> None:
    each = [pair for module in constructs.MODULES for pair in constructs.kernels(module).items()]
    found = {name: constructs.buffers(kernel) for name, kernel in each}
    many = {name: count for name, count in found.items() if count > MOST_BUFFERS}
    assert len(found) > 40  # it did look
    more = {name: count for name, count in many.items() if count > TOO_MANY.get(name, 0)}
    assert not more, "put columns of one type into one array, with offsets"
    assert many == TOO_MANY, "fewer than listed: correct the list in this file"


Ints = ti.types.ndarray(dtype=ti.i32, ndim=1)
Reals = ti.types.ndarray(dtype=ti.f32, ndim=1)
Group = ti.types.argpack(**{f"own_{k}": Ints for k in range(MOST_BUFFERS - 3)})
Counts = ti.types.argpack(hits=Ints, share=Reals)
NAMES = {"ti": ti, "Ints": Ints, "Counts": Counts, "Reals": Reals, "HALF": 2}

# By rule: a kernel's body that the rule finds, and the permitted one beside it.
LOOP = "for i in range(x.shape[0]):\n  "
HALVES = "for i in range(x.shape[0] // "
PLANTED = [
    ("bounds", f"{HALVES}2): x[i] = 1", "for i in range(x.shape[0] >> 1): x[i] = 1"),
    ("bounds", f"{HALVES}HALF): x[i] = 1", f"{HALVES}n): x[i] = 1"),
    ("bounds", "m = x.shape[0] // 2\nfor i in range(m): x[i] = 1", f"{LOOP}x[i // 2] = 1"),
    ("bounds", "for i in range(x.shape[0], 9): x[i] = 1", "for i in range(n, 9): x[i] = 1"),
    ("angles", f"{LOOP}y[i] = ti.sin(y[i])", f"{LOOP}y[i] = angles.sin(y[i])"),
    ("angles", f"{LOOP}y[i] = y[i] ** 0.5", f"{LOOP}y[i] = y[i] ** 2 + ti.static(2.0 ** 0.5)"),
    ("half written", f"{LOOP}if n > i: y[i] = 1.0", f"{LOOP}y[i] = 1.0 if n > i else 0.0"),
    ("half written", f"{LOOP}if n > i: y[i] = 1.0", f"{LOOP}if n > i: y[i] += 1.0"),
    (
        "half written",
        f"{LOOP}if n > i: continue\n  y[i], x[i] = 1.0, 1",
        f"{LOOP}if n > i: y[i], x[i] = 1.0, 1\n  else: y[i], x[i] = 2.0, 2",
    ),
    ("in while", f"{LOOP}while n > i: x[0] += 1", f"{LOOP}while n > i: y[0] += 1.0\n  x[0] += 1"),
    ("in while", f"{LOOP}while n > i: c.hits[0] += 1", f"{LOOP}while n > i: c.share[0] += 1.0"),
    ("in while", f"{LOOP}while n > i: ti.atomic_add(x[0], 1)", f"{LOOP}ti.atomic_add(x[0], 1)"),
    ("in while", f"{LOOP}while n > i: count(x)", f"{LOOP}while n > i: j = read(x)\n  count(x)"),
]
HELPERS = """
@ti.func
def count(x: ti.template()): add(x)
@ti.func
def add(x: ti.template()): ti.atomic_add(x[0], 1)
@ti.func
def read(x: ti.template()): return x[0]
"""


@pytest.mark.parametrize(("rule", "wrong", "right"), PLANTED)
def test_a_rule_finds_its_construct_and_passes_the_other(rule: str, wrong: str, right: str) -> None:
    def lines(body: str) -> list[str]:
        indented = body.replace("\n", "\n  ")
        head = "@ti.kernel\ndef planted(x: Ints, y: Reals, n: ti.i32, c: Counts):\n  "
        tree = ast.parse(HELPERS + head + indented)
        each = [("here", f, NAMES) for f in tree.body if isinstance(f, ast.FunctionDef)]
        return look(RULES[rule], each).get("here.planted", [])

    assert lines(wrong)
    assert not lines(right)


def test_buffers_are_arrays_and_what_taichi_adds() -> None:
    @ti.kernel
    def fits(x: Ints, n: ti.i32, group: Group):
        for i in range(n):
            x[i] = group.own_0[i]

    @ti.kernel
    def is_over(x: Ints, y: Ints, n: ti.i32, group: Group):
        for i in range(n):
            x[i] = y[i] + group.own_0[i]

    assert constructs.buffers(fits) == MOST_BUFFERS
    assert constructs.buffers(is_over) > MOST_BUFFERS


def test_every_module_is_read() -> None:
    """A kernel that is written in another way than the finders look for would go unseen."""
    for module in constructs.MODULES:
        read = {f.name for f, _ in constructs.functions(module)}
        assert {kernel.__name__ for kernel in constructs.kernels(module).values()} <= read
