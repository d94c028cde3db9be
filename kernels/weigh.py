"""Sums of weights in a fixed order: blocks of slots on the device, finished on the host in float64.

A block is summed by one thread in slot order, so the sum does not depend on the number of threads.
"""

import numpy as np
import taichi as ti

from kernels import runtime
from kernels.coast import Ints, Reals

BLOCK = 1024
STATUSES = 6


@ti.kernel
def _largest(first: ti.i32, last: ti.i32, log_weight: Reals) -> ti.f32:
    largest = ti.f32(-ti.math.inf)
    for i in range(first, last):
        ti.atomic_max(largest, log_weight[i])
    return largest


@ti.kernel
def _sums(first: ti.i32, last: ti.i32, log_weight: Reals, status: Ints, largest: ti.f32, sums: Reals):
    for block in range((last - first + BLOCK - 1) // BLOCK):
        begin = first + block * BLOCK
        total = ti.Vector.zero(ti.f32, STATUSES + 1)
        for i in range(begin, ti.min(begin + BLOCK, last)):
            w = ti.exp(log_weight[i] - largest)
            for s in ti.static(range(STATUSES)):
                if status[i] == s:
                    total[s] += w
            total[STATUSES] += w * w
        for s in ti.static(range(STATUSES + 1)):
            sums[block * (STATUSES + 1) + s] = total[s]


def account(log_weight, status, first: int, last: int) -> tuple[np.ndarray, float, float]:
    """Return the weights of slots [first, last) by status, their sum of squares, and the log of their common factor.

    Weight i is exp(log_weight[i] - factor); shape (STATUSES,), float64. Factor is -inf when every weight is zero.
    """
    largest = float(_largest(first, last, log_weight))
    if last <= first or largest == -np.inf:
        return np.zeros(STATUSES), 0.0, -np.inf
    blocks = -(-(last - first) // BLOCK)
    sums = runtime.empty(blocks * (STATUSES + 1))
    _sums(first, last, log_weight, status, largest, sums)
    total = sums.to_numpy().reshape(-1, STATUSES + 1).astype(np.float64).sum(axis=0)
    return total[:STATUSES], float(total[STATUSES]), largest
