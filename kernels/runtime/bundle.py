"""Bundles of particles that a kernel moves side by side.

A step of one particle is a chain of operations that wait for each other, and a processor that takes
particle after particle idles for most of it. So a kernel on a CPU takes WIDTH of them together:
what it holds of them stands in short arrays with an entry for each, and each part of the step is a
loop over the entries. Where such a loop holds no branch and no call of a library, the compiler
makes vector instructions of it, which round as others do: the bits are the same. What must branch
or call stands in loops of its own. A graphics card does as much by itself: there a bundle is one
particle.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any

import taichi as ti

from kernels.runtime import runtime

WIDTH = 8  # float32 in a vector instruction of AVX2


def width() -> int:
    """Return the number of particles in a bundle on the running backend."""
    return WIDTH if runtime.backend() == "cpu" else 1


def alone() -> bool:
    """Return whether a bundle is one particle, as on a card."""
    return width() == 1


def threads(wanted: int) -> int:
    """Return the threads of a block where their number bounds the registers of a thread; 0: the
    backend has no such bound.

    Taichi asks CUDA for room for two blocks, so blocks of 512 threads leave each thread 64 of a
    multiprocessor's 65536 registers, and half of its 2048 threads run side by side; blocks of 448
    leave 72, and 44 % run.
    """
    return wanted if runtime.backend() == "cuda" else 0


def held(**rows: Mapping[str, int]) -> Any:
    """Return the structure that a kernel holds of a bundle: matrices of (rows, particles), zero at
    first.

    reals, ints, words: numbers of rows by name, of float32, int32 and uint32; 0: there is none.
    """
    kinds = {"reals": ti.f32, "ints": ti.i32, "words": ti.u32}
    listed = (
        (name, int(count), kinds[of])
        for of, names in rows.items()
        for name, count in names.items()
        if count
    )
    return _structure(width(), tuple(listed))


@cache  # a kernel is compiled for each structure that is another object
def _structure(width: int, rows: tuple[tuple[str, int, Any], ...]) -> Any:
    return ti.types.struct(
        **{name: ti.types.matrix(count, width, kind) for name, count, kind in rows}
    )
