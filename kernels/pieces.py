"""The pieces of way that targets which steer make in a step, written once for every sensor that asks.

A target's pieces follow one another in a list: the first one stands at the target's own slot, all others behind the
slots, wherever there was room; each says where the next one stands. What has arrived or lies aground has one piece
more, on which it does not move.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti

from kernels import launch, runtime, sphere
from kernels.coast import Ints, Reals
from kernels.itinerary import Target

NONE = -1  # there is no further piece

Pieces = ti.types.argpack(
    piece_lon=Ints,  # [binary angle] where it begins
    piece_lat=Ints,
    piece_to_lon=Ints,
    piece_to_lat=Ints,
    piece_begin=Ints,  # [s]
    piece_end=Ints,
    piece_count=Ints,  # its number in the step, the key of its noise; NONE: the target has no piece
    piece_next=Ints,  # where the next piece stands, or NONE
    piece_k=Reals,  # K of the bridge [m/sqrt(s)]; 0: it goes straight
    piece_east=Reals,  # [m/s] of a bridge, the mean velocity of the leg of which it is a part
    piece_north=Reals,
    piece_used=Ints,  # (1,) how many pieces there are, slots and all
)


@ti.func
def note(
    pieces: ti.template(), slot: ti.i32, last: ti.i32, target: Target, x: ti.i32, y: ti.i32, end: ti.i32, k: ti.f32,
    count: ti.i32,
):  # fmt: skip
    """Write a piece of way of the target in a slot, from where it is to (x, y) at `end` [s]; return where it stands.

    last: where the piece before it stands, or NONE. Where there is no more room, a piece is only counted.
    """
    here, room = slot, pieces.piece_lon.shape[0]
    if last != NONE:
        here = ti.atomic_add(pieces.piece_used[0], 1)
        if here < room:
            pieces.piece_next[last] = here
    if here < room:
        pieces.piece_lon[here], pieces.piece_lat[here] = target.lon, target.lat
        pieces.piece_to_lon[here], pieces.piece_to_lat[here] = x, y
        pieces.piece_begin[here], pieces.piece_end[here] = target.time, end
        pieces.piece_count[here], pieces.piece_next[here], pieces.piece_k[here] = count, NONE, k
        if k > 0.0:
            far = sphere.offset(target.lon, target.lat, target.to_lon, target.to_lat)
            pace = 1.0 / ti.max(ti.cast(target.to_time - target.time, ti.f32), 1.0)
            pieces.piece_east[here], pieces.piece_north[here] = far[0] * pace, far[1] * pace
    return here if here < room else last


class Room:
    """The pieces of one step on the device; their columns are kept from step to step, and grow as need be."""

    def __init__(self, slots: int) -> None:
        self._slots, self._used = slots, runtime.empty(1, ti.i32)
        self._of(slots)

    def _of(self, size: int) -> None:
        self.size, self.pack, self.columns = size, None, {}  # what was there goes before as much again comes
        self.columns = {name: runtime.empty(size, member.dtype) for name, member in Pieces.members.items()}
        self.columns["piece_used"] = self._used
        self.pack = launch.pack(Pieces, *self.columns.values())

    def fill(self, write: Callable[[Any], None]) -> None:
        """Have pieces written by what takes the pack, and again with more room until there is enough."""
        while not self.enough(write):
            pass

    def enough(self, write: Callable[[Any], None]) -> bool:
        """Have pieces written by what takes the pack; return whether there was room for all, else make it."""
        self._used.from_numpy(np.array([self._slots], np.int32))
        write(self.pack)
        used = int(self._used.to_numpy()[0])
        if used > self.size:
            self._of(used + used // 8)
            return False
        return True
