"""The slots of one launch: those of one scenario or of hundreds, and how a kernel finds them.

Slots of a scenario are contiguous. A batch is a range of slots if its scenarios are contiguous too;
otherwise it lists them. A kernel takes `listed`, `first`, `last`, `slots` and `shift` of a batch,
and loops

    for k in range(first, last):
        i = batch.slot(listed, slots, k)

Parameters that differ between scenarios come from tables, indexed by the slot's scenario, a column
of the ensemble: see `table`.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from kernels.runtime import runtime


class Batch(NamedTuple):
    """Slots on the device, and the scenarios to which they belong."""

    scenarios: tuple[int, ...]  # numbers of the scenarios, ascending
    listed: bool  # whether the slots are listed
    first: int  # the first slot, or its index in `slots`
    last: int  # the one after the last
    slots: Any  # int32 (last,) on the device, ascending; unused where they are a range
    # int32 (scenarios of the run,) on the device: from a slot to its number in the whole run
    shift: Any

    @property
    def launched(self) -> tuple[bool, int, int, Any, Any]:
        """The batch as kernels take it: `listed`, `first`, `last`, `slots` and `shift`."""
        return self.listed, self.first, self.last, self.slots, self.shift

    def table(self, rows: Sequence[Any]) -> Any:
        """Return a table by scenario on the device, float32, flat.

        Its shape is (scenarios of the run * row length,). rows: one for each scenario of the batch,
        in order; all other scenarios have zeros.
        """
        own = np.asarray(rows, np.float32).reshape(len(self.scenarios), -1)
        table = np.zeros((self.shift.shape[0], own.shape[1]), np.float32)
        table[list(self.scenarios)] = own
        return runtime.upload(table)


@ti.func
def slot(listed: ti.template(), slots: ti.template(), k: ti.i32) -> ti.i32:
    """Return the slot at index k of a batch."""
    i = k
    if ti.static(listed):
        i = slots[k]
    return i


@ti.func
def listed_slot(listed: ti.i32, slots: ti.template(), k: ti.i32) -> ti.i32:
    """Return the slot at index k of a batch, with `listed` known only at run time.

    Kernels that take long to compile use it: one compilation serves both kinds of batch.
    """
    i = k
    if listed == 1:
        i = slots[k]
    return i


def batch_of(bounds: Sequence[int], numbers: Sequence[int], scenarios: Sequence[int]) -> Batch:
    """Return the slots of some scenarios (ascending).

    bounds: the first slot of each scenario of the run and, last, n; numbers: of each one's first
    slot in the whole run.
    """
    edges = np.asarray(bounds, np.int64)
    shift = runtime.upload((np.asarray(numbers, np.int64) - edges[:-1]).astype(np.int32))
    chosen = np.asarray([s for s in scenarios if edges[s] < edges[s + 1]], np.int64)
    first, last = edges[chosen], edges[chosen + 1]
    # contiguous, except for scenarios without slots between them
    if (first[1:] == last[:-1]).all():
        whole = (int(first[0]), int(last[-1])) if chosen.size else (0, 0)
        return Batch(tuple(scenarios), False, *whole, runtime.empty(1, ti.i32), shift)
    slots = np.concatenate(
        [np.arange(a, b, dtype=np.int32) for a, b in zip(first, last, strict=True)]
    )
    return Batch(tuple(scenarios), True, 0, slots.size, runtime.upload(slots), shift)


def among(own: Batch, chosen: np.ndarray) -> Batch:
    """Return the slots of a batch that are chosen, bool (n,) over all slots."""
    slots = (
        own.slots.to_numpy()[own.first : own.last]
        if own.listed
        else np.arange(own.first, own.last, dtype=np.int32)
    )
    slots = slots[chosen[slots]]
    return own._replace(listed=True, first=0, last=slots.size, slots=runtime.upload(slots))
