"""Random numbers for the distress of targets by a hazard along their own tracks."""

import numpy as np
import taichi as ti

from kernels.maths import noise
from kernels.runtime import runtime
from kernels.step.coast import Reals


@ti.kernel
def _draw_uniforms(
    first: ti.i32,
    last: ti.i32,
    number: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
    cell: ti.i32,
    found: Reals,
):
    """Write two uniform numbers for each slot, (2 * (last - first),)."""
    for i in range(first, last):
        w = noise.further(seed0, seed1, noise.STREAM_DISTRESS, number + i - first, cell, 0)
        found[2 * (i - first)] = noise.uniform(w[0])
        found[2 * (i - first) + 1] = noise.uniform(w[1])


def draw_uniforms(slots: tuple[int, int, int], seed: int, cell: int) -> np.ndarray:
    """Return two uniform numbers in (0, 1) for each slot and cell of time, shape (n, 2).

    Args:
        slots: the first, the one after the last, and the number of the first in the whole run.
        seed: of the run.
        cell: number of the cell.
    """
    n = slots[1] - slots[0]
    found = runtime.empty(2 * n)
    _draw_uniforms(*slots, *noise.key(seed), cell, found)
    return found.to_numpy()[: 2 * n].astype(np.float64).reshape(n, 2)
