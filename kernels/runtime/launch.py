"""Packs of kernel arguments, and kernels bound to their arguments for repeated launches.

Taichi inspects all arguments at every launch, which takes longer than a step of some thousand
particles.
"""

from collections.abc import Callable
from typing import Any

from kernels.runtime.taichi_way import way

Launch = Callable[..., None]


def pack(kind: Any, *values: Any) -> Any:
    """Return a pack of arguments (`ti.types.argpack`), in the order of its members.

    It keeps its arrays alive.

    Numbers in it cost 12 us and some 30 bytes that Taichi never frees: packs made per ensemble hold
    none. Taichi 1.7.4 identifies members by name alone: two packs of one kernel must not share a
    name, nor may a variable of the kernel have one of these names.
    """
    return way.pack(kind, dict(zip(kind.members, values, strict=True)))


def bind(kernel: Any, args: tuple, changing: tuple[str, ...]) -> Launch:
    """Return a function that launches a kernel with these arguments.

    The function takes the whole numbers named in `changing`; all other arguments are fixed. Arrays
    are `ti.Ndarray`s and stay alive as long as the function does, alone or in a `pack`; a structure
    is given as a dict.
    """
    return way.bind(kernel, args, changing)
