"""Arguments of kernels in groups, and a kernel with its arguments set once, to be launched again
and again.

Taichi looks at all arguments again at every launch, which takes longer than a step of some thousand
particles.
"""

from collections.abc import Callable
from typing import Any

from kernels.runtime.taichi_way import way

Launch = Callable[..., None]


def pack(kind: Any, *values: Any) -> Any:
    """Return a group of arguments of a kind (`ti.types.argpack`), in the order of its members.

    It keeps its arrays alive.

    Numbers in it cost 12 us and some 30 bytes that Taichi never gives back: what is packed for each
    ensemble holds none. Taichi 1.7.4 knows the members by their names alone: two groups of one
    kernel must not share one, nor may the kernel give one to a variable of its own.
    """
    return way.pack(kind, dict(zip(kind.members, values, strict=True)))


def bind(kernel: Any, args: tuple, changing: tuple[str, ...]) -> Launch:
    """Return a function that launches a kernel with these arguments.

    The function takes the whole numbers named in `changing`; all other arguments stay as they are.
    Arrays are `ti.Ndarray`s, and stay alive as long as the function does, alone or in a `pack`; a
    structure comes as a dict.
    """
    return way.bind(kernel, args, changing)
