"""What a sensor that stands still tells of the ways of targets under way: see kernels.observe.

The pieces of a target's way (kernels.pieces) are cut to the window in which the sensor looks on; where the window begins or ends inside a step, it is known where the target was then.
"""

from typing import Any

import taichi as ti

from kernels import batch, noise, observe
from kernels.batch import Batch
from kernels.coast import Ints, Reals
from kernels.itinerary import Chance
from kernels.observe import HostReals, Piece, Sensor, Shape, Window
from kernels.pieces import NONE, Pieces

CUTS = 64  # windows of a step that have random numbers of their own


@ti.kernel
def _steering(
    kind: ti.template(),
    besides: ti.template(),
    listed: ti.i32,
    first: ti.i32,
    last: ti.i32,
    slots: Ints,
    shift: Ints,
    scenario: Ints,
    pieces: Pieces,
    seed0: ti.u32,
    seed1: ti.u32,
    step: ti.i32,
    before_lon: Ints,
    before_lat: Ints,
    after_lon: Ints,
    after_lat: Ints,
    since: ti.i32,
    lasting: ti.i32,
    count: ti.i32,
    sensor: Sensor,
    corners: HostReals,
    stayed: Reals,
    told: Reals,
):
    for nth in range(first, last):
        i = batch.listed_slot(listed, slots, nth)
        log_stayed, stop = stayed[i], since + lasting
        if pieces.piece_count[i] != NONE and log_stayed > -ti.math.inf:
            here, stays = i, 1.0
            while here != NONE and stays > 0.0 and pieces.piece_begin[here] < stop:
                begin, end = pieces.piece_begin[here], pieces.piece_end[here]
                if ti.static(kind == observe.IN_BOX or kind == observe.IN_DISC):
                    if here == i and begin > since:  # it got under way later
                        stays = 0.0
                if end > since and stays > 0.0:
                    ax, ay = pieces.piece_lon[here], pieces.piece_lat[here]
                    if begin < since:
                        ax, ay, begin = before_lon[i], before_lat[i], since
                    bx, by = pieces.piece_to_lon[here], pieces.piece_to_lat[here]
                    if end > stop:
                        bx, by, end = after_lon[i], after_lat[i], stop
                    from_, to = ti.cast(begin - since, ti.f32), ti.cast(end - since, ti.f32)
                    own = Piece(ax, ay, bx, by, from_, to, pieces.piece_k[here])
                    slot = i + shift[scenario[i]]
                    look = Chance(seed0, seed1, slot, slot, step, pieces.piece_count[here] * CUTS + count)
                    found = observe.observe(kind, besides, own, sensor, corners, look)
                    if ti.static(besides != observe.WHETHER):
                        so_far = log_stayed + ti.log(stays)
                        told[i] = observe.told_by(besides, so_far, told[i], found, ti.cast(since, ti.f32))
                    stays *= found[0]
                here = pieces.piece_next[here]
            if stays < 1.0:
                stayed[i] = log_stayed + ti.log(stays)


def steering(
    made: Any,
    own: Batch,
    scenario: Any,
    seed: int,
    before: tuple[Any, Any],
    after: tuple[Any, Any],
    window: Window,
    shape: Shape,
    besides: int,
    report: tuple[float, float],
    stayed: Any,
    told: Any,
) -> None:
    """Add what a sensor tells of the ways of targets over a part of the step just made.

    made: their pieces in the step, see kernels.steer.made; own: slots of which pieces were made; scenario: of each slot,
    device. The rest is as in kernels.observe.drifting.
    """
    _steering(
        shape.kind, besides, *own.launched, scenario, made, *noise.key(seed), window.step, *before, *after, window.since,
        window.lasting, window.count, observe.sensor(shape, window, report), shape.corners, stayed, told,
    )  # fmt: skip
