"""What a sensor that stands still tells of the ways of targets under way: see kernels.observe.

The pieces of a target's way are made again from what was kept of the step's begin, and cut to the window in which the
sensor looks on; where the window begins or ends inside a step, it is known where the target was then.
"""

from typing import Any

import taichi as ti

from kernels import batch, life, observe, steer
from kernels.batch import Batch
from kernels.coast import Coast, DeviceCoast, Ints, Reals, open_sea
from kernels.itinerary import Chance, Plan
from kernels.observe import HostReals, Piece, Sensor, Shape, Window

CUTS = 64  # windows of a step that have random numbers of their own


@ti.kernel
def _steering(
    kind: ti.template(),
    besides: ti.template(),
    coastal: ti.template(),
    listed: ti.template(),
    first: ti.i32,
    last: ti.i32,
    slots: Ints,
    shift: Ints,
    columns: steer.Columns,
    plan: Plan,
    coast: Coast,
    terms: steer.Terms,
    elapsed: ti.i32,
    duration: ti.i32,
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
        i = batch.slot(listed, slots, nth)
        which = columns.scenario[i]
        end, stop = elapsed + duration, since + lasting
        resting = columns.status[i] == life.ARRIVED or columns.status[i] == life.AGROUND
        until = ti.min(stop, columns.release[i])
        mine = resting or (steer.under_way(columns, i, end) and columns.release[i] > since)
        log_stayed = stayed[i]
        if mine and log_stayed > -ti.math.inf:
            stays = 1.0
            if ti.static(kind == observe.IN_BOX or kind == observe.IN_DISC):
                if columns.departure[i] > since:
                    stays = 0.0
            t = steer.loaded(columns, i, elapsed)
            key = Chance(terms.seed0, terms.seed1, columns.birth[i], i + shift[which], step, 0)
            state, over = life.UNDER_WAY, ti.min(end, columns.release[i])
            if resting:
                state, t.time, until, over = columns.status[i], elapsed, stop, end
            while t.time < until and stays > 0.0:
                x, y, time, state_then = t.lon, t.lat, over, state
                k = ti.f32(0.0)
                if state == life.UNDER_WAY:
                    key.count += 1
                    k = steer.wanders(plan, key, t)
                    x, y, time, state_then, _number = steer.stretch(coastal, plan, key, which, t, k, over, coast)
                if time > since:
                    off_x, off_y = steer.set_at(t, t.time)
                    ax, ay, begin = t.lon + off_x, t.lat + off_y, t.time
                    off_x, off_y = steer.set_at(t, time if state == life.UNDER_WAY else t.time)
                    bx, by, close = x + off_x, y + off_y, time
                    if begin < since:
                        ax, ay, begin = before_lon[i], before_lat[i], since
                    if close > stop:
                        bx, by, close = after_lon[i], after_lat[i], stop
                    own = Piece(ax, ay, bx, by, ti.cast(begin - since, ti.f32), ti.cast(close - since, ti.f32), k)
                    look = Chance(key.seed0, key.seed1, key.birth, key.slot, step, key.count * CUTS + count)
                    found = observe.observe(kind, besides, own, sensor, corners, look)
                    if ti.static(besides != observe.WHETHER):
                        so_far = log_stayed + ti.log(stays)
                        told[i] = observe.told_by(besides, so_far, told[i], found, ti.cast(since, ti.f32))
                    stays *= found[0]
                if state == life.UNDER_WAY:
                    state = state_then
                    if state == life.UNDER_WAY:
                        t = steer.reached(coastal, plan, key, which, t, x, y, time, coast)
                        if t.over == 1:
                            state, until, over = life.ARRIVED, stop, end
                    else:
                        t.lon, t.lat, t.time, until, over = x, y, time, stop, end
                else:
                    t.time = time
            if stays < 1.0:
                stayed[i] = log_stayed + ti.log(stays)


def steering(
    columns: Any,
    own: Batch,
    plan: Any,
    seed: int,
    coast: DeviceCoast | None,
    step: Any,
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

    columns: by name, those of kernels.steer.COLUMNS as they were at the begin of the step (a kernels.advance.Step); own,
    plan, seed, coast: see kernels.steer. The rest is as in kernels.observe.drifting.
    """
    _steering(
        shape.kind, besides, coast is not None, *steer.slots_of(own), steer.packed(columns), plan,
        (coast or open_sea()).pack, steer.Terms(**steer.terms(seed)), step.elapsed, step.duration, step.number,
        *before, *after, window.since, window.lasting, window.count, observe.sensor(shape, window, report),
        shape.corners, stayed, told,
    )  # fmt: skip
