"""Bundles of particles that a kernel moves side by side.

A step of one particle is a chain of dependent operations, so that a processor that handles particle
after particle is idle most of the time. A kernel on a CPU therefore handles WIDTH particles
together: their data are held in short arrays, and each part of the step is a loop over the entries.
The compiler turns a loop without branches and library calls into vector instructions, which round
like scalar ones: the bits are the same. Branches and calls have loops of their own. A graphics card
does the same in hardware: there a bundle is one particle.
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
    """Return whether a bundle is a single particle, as on a graphics card."""
    return width() == 1


def threads(wanted: int) -> int:
    """Return the number of threads of a block that limits the registers of a thread.

    0: the backend has no such limit. Taichi asks CUDA for room for two blocks, so blocks of 512
    threads leave each thread 64 of a multiprocessor's 65536 registers, and half of its 2048 threads
    run side by side; blocks of 448 leave 72, and 44 % run.
    """
    return wanted if runtime.backend() == "cuda" else 0


def held(**rows: Mapping[str, int]) -> Any:
    """Return the structure of a bundle's registers: matrices of (rows, particles), initially zero.

    reals, ints, words: numbers of rows by name, of float32, int32 and uint32; 0: no rows.
    """
    kinds = {"reals": ti.f32, "ints": ti.i32, "words": ti.u32}
    listed = (
        (name, int(count), kinds[of])
        for of, names in rows.items()
        for name, count in names.items()
        if count
    )
    return _structure(width(), tuple(listed))


@cache  # cached, as a kernel is compiled again for each new structure object
def _structure(width: int, rows: tuple[tuple[str, int, Any], ...]) -> Any:
    return ti.types.struct(
        **{name: ti.types.matrix(count, width, kind) for name, count, kind in rows}
    )
