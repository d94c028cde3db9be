"""What a sensor's track has done to each target under way: its exposure, as kernels.sweep has it of what drifts.

A piece of a target's way (kernels.pieces) without noise is straight. On a Brownian bridge the target has no finite length of track, so that a hazard per unit of relative track
would grow without bound as steps shrink; the hazard is one per time instead, of the speed of the sensor against the
mean velocity of the target's leg, at the place where the bridge has the target. Where that place matters, near the
sensor or an edge, the piece is halved again and again at Levy's midpoints, until the bridge strays by less than a
quarter of the range (kernels.noise: the same midpoints for every sensor that asks).
"""

from typing import Any

import numpy as np
import taichi as ti

from kernels import batch, life, noise, ways
from kernels.batch import Batch
from kernels.coast import Ints, Reals
from kernels.pieces import NONE, Pieces
from kernels.sweep import ABEAM, CUBE, INSIDE, ZONES, HostInts, HostReals, Track, apart, chance, piece

DEPTH = 14  # a step is halved so many times at most: an hour to 0.2 s
STRAY = 0.25  # most that a bridge may stray within a part, in ranges
FINE = 0.1  # the same in units of the sensor's own scale, however near it is

f32x2 = ti.types.vector(2, ti.f32)
Levels = ti.types.vector(DEPTH + 2, ti.i32)


@ti.func
def _range(
    kind: ti.template(), a: f32x2, b: f32x2, first: ti.i32, last: ti.i32, course: ti.template(), table: ti.template()
) -> ti.f32:
    """Return how far [m] the way from a to b stays from where it matters to a sensor.

    That is the sensor itself; of a watch the edges of its zones; of an area its outline; of a sensor that counts passes
    abeam the line abeam of it, if it is within range.
    """
    d = b - a
    dd = ti.max(d[0] * d[0] + d[1] * d[1], 1e-12)
    share = ti.min(ti.max(-(a[0] * d[0] + a[1] * d[1]) / dd, 0.0), 1.0)
    at = a + share * d
    near = ti.sqrt(at[0] * at[0] + at[1] * at[1])
    if ti.static(kind == ZONES):
        low, high = near, ti.max(a.norm(), b.norm())
        found = ti.f32(1e30)
        for z in range(table.shape[0]):
            gap = ti.max(low - table[z], table[z] - high)
            if table[z] > 0.0:
                found = ti.min(found, ti.max(gap, 0.0))
        near = found
    elif ti.static(kind == INSIDE):
        corners = table.shape[0] // 2
        found = ti.f32(1e30)
        middle = 0.5 * (a + b)
        p = f32x2(table[2 * corners - 2], table[2 * corners - 1])
        for k in range(corners):
            q = f32x2(table[2 * k], table[2 * k + 1])
            e = q - p
            along = ti.min(ti.max((middle - p).dot(e) / ti.max(e.dot(e), 1e-12), 0.0), 1.0)
            found = ti.min(found, (middle - p - along * e).norm())
            p = q
        near = ti.max(found - 0.5 * d.norm(), 0.0)
    elif ti.static(kind == ABEAM):
        along_a = -(a[0] * course[first] + a[1] * course[first + 1])
        along_b = -(b[0] * course[last] + b[1] * course[last + 1])
        beyond = near - table[table.shape[0] - 2]
        near = ti.min(ti.abs(along_a), ti.abs(along_b))  # a pass out of range counts too: none after it does
        if (along_a < 0.0) != (along_b < 0.0):
            near = ti.max(beyond, 0.0)
    return near


@ti.func
def _pass(
    a: f32x2,
    b: f32x2,
    first: ti.i32,
    last: ti.i32,
    number: ti.f32,
    heading: ti.template(),
    table: ti.template(),
    scale: ti.template(),
    own: ti.i32,
    scales: ti.i32,
    exposure: ti.template(),
    passed: ti.template(),
    size: ti.i32,
    i: ti.i32,
):
    """Write the log of a miss where a part of a bridge from a to b comes abeam of a leg for the first time.

    A bridge comes abeam without number; of each leg its first pass counts, at the range that it has then. number: of the
    leg; the rest is as in kernels.sweep.piece.
    """
    along_a = a[0] * heading[first] + a[1] * heading[first + 1]
    along_b = b[0] * heading[last] + b[1] * heading[last + 1]
    if (along_a > 0.0) != (along_b > 0.0) and passed[i] != number:
        passed[i] = number
        at = a + along_a / (along_a - along_b) * (b - a)
        for f in range(scales):
            exposure[f * size + i] += ti.log(1.0 - chance(table, at.norm() * scale[own + f]))


@ti.kernel
def _expose(
    kind: ti.template(),
    listed: ti.i32,
    first: ti.i32,
    last: ti.i32,
    slots: Ints,
    shift: Ints,
    scenario: Ints,
    pieces: Pieces,
    seed0: ti.u32,
    seed1: ti.u32,
    elapsed: ti.i32,
    step: ti.i32,
    time: HostReals,
    place: HostInts,
    trig: HostReals,
    heading: HostReals,
    searching: HostInts,
    leg_of: HostInts,
    table: HostReals,
    scale: HostReals,
    unit: HostReals,
    stride: ti.i32,
    scales: ti.i32,
    exposure: Reals,
    passed: Reals,
    size: ti.i32,
    status: Ints,
    status_since: Ints,
    shore: ti.i32,
):
    for nth in range(first, last):
        i = batch.listed_slot(listed, slots, nth)
        which = scenario[i]
        own = which * stride
        here = NONE
        if pieces.piece_count[i] != NONE:
            here = i
            if ti.static(kind in (CUBE, ABEAM)):
                if scale[own] <= 0.0:
                    here = NONE
        total = 0.0
        while here != NONE:
            begin = ti.cast(pieces.piece_begin[here] - elapsed, ti.f32)
            whole = ti.cast(pieces.piece_end[here] - pieces.piece_begin[here], ti.f32)
            aground = status[i] == life.AGROUND and pieces.piece_begin[here] >= status_since[i]
            if begin < time[time.shape[0] - 1] and begin + whole > time[0] and (shore == 1 or not aground):
                k = pieces.piece_k[here]
                # Parts of the piece, halved where it matters: their ends on a stack, the nearest one on top.
                ends_x, ends_y, levels = Levels(0), Levels(0), Levels(0)
                top, at, ax, ay = 0, 0, pieces.piece_lon[here], pieces.piece_lat[here]
                ends_x[0], ends_y[0] = pieces.piece_to_lon[here], pieces.piece_to_lat[here]
                while top >= 0:
                    # at: begin of the part, in 2^-DEPTH of the piece
                    bx, by, level = ends_x[top], ends_y[top], levels[top]
                    part = whole * ti.cast(1 << (DEPTH - level), ti.f32) * (1.0 / (1 << DEPTH))
                    from_, to = begin + whole * ti.cast(at, ti.f32) * (1.0 / (1 << DEPTH)), ti.f32(0.0)
                    to = from_ + part
                    stray = k * ti.sqrt(part)
                    halve = 0
                    found = 0.0
                    for pass_ in range(2):  # first how near it comes, then what that adds up to
                        if pass_ == 1 or (k > 0.0 and level < DEPTH):
                            for p in range(time.shape[0] - 1):
                                low, high = ti.max(time[p], from_), ti.min(time[p + 1], to)
                                if searching[p] == 1 and low < high and halve == 0:
                                    pace = 1.0 / ti.max(part, 1e-6)
                                    a = apart(False, ax, ay, bx, by, from_, pace, low, p, time, place, trig)
                                    b = apart(False, ax, ay, bx, by, from_, pace, high, p, time, place, trig)
                                    to_node = 4 * p + 2 * ti.cast(high == time[p + 1], ti.i32)
                                    if pass_ == 0:
                                        near = _range(kind, a, b, 4 * p, to_node, heading, table)
                                        if stray > ti.max(STRAY * near, FINE * unit[which]):
                                            halve = 1
                                    else:
                                        if k > 0.0 and ti.static(kind == CUBE):
                                            # Past the middle of the part, at the speed of the leg.
                                            s0 = apart(False, ax, ay, ax, ay, from_, 0.0, low, p, time, place, trig)
                                            s1 = apart(False, ax, ay, ax, ay, from_, 0.0, high, p, time, place, trig)
                                            v = f32x2(pieces.piece_east[here], pieces.piece_north[here])
                                            half = 0.5 * (s1 - s0 + v * (high - low))
                                            middle = 0.5 * (a + b)
                                            a, b = middle - half, middle + half
                                        if k > 0.0 and ti.static(kind == ABEAM):
                                            _pass(
                                                a, b, 4 * p, to_node, ti.cast(leg_of[p], ti.f32), heading, table,
                                                scale, own, scales, exposure, passed, size, i,
                                            )  # fmt: skip
                                        else:
                                            found += piece(
                                                kind, a, b, a.norm(), b.norm(), high - low, 4 * p, to_node,
                                                heading, table, scale, own, scales, exposure, size, i,
                                            )  # fmt: skip
                    if halve == 1:
                        w = noise.further(
                            seed0, seed1, noise.STREAM_LEVY, i + shift[which], step,
                            (pieces.piece_count[here] << (DEPTH + 1)) + at + (1 << (DEPTH - level - 1)),
                        )  # fmt: skip
                        normal = noise.normals(w[0], w[1])
                        mx, my = ways.toward(ax, ay, bx, by, 0.5 * part, 0.5 * part, k, normal)
                        levels[top] = level + 1
                        top += 1
                        ends_x[top], ends_y[top], levels[top] = mx, my, level + 1
                    else:
                        total += found
                        at += 1 << (DEPTH - level)
                        ax, ay = bx, by
                        top -= 1
            here = pieces.piece_next[here]
        if ti.static(kind != ABEAM):
            exposure[i] += total


def expose(
    made: Any,
    own: Batch,
    scenario: Any,
    seed: int,
    step: Any,
    kind: int,
    track: Track,
    table: Any,
    scale: Any,
    unit: Any,
    exposure: Any,
    passed: Any,
    ended: tuple[Any, Any],
    shore: bool,
) -> None:
    """Add to the exposure of targets under way what a sensor does on a stretch of the step just made.

    made: their pieces in the step (a kernels.advance.Step), see kernels.steer.made; own: slots of which pieces were
    made; scenario: of each slot, device. kind, track, table, scale, exposure: see kernels.sweep.expose. unit [m]: by
    scenario, the range below which nothing finer matters to the sensor. passed: device, float32 (n,): for ABEAM, number
    of the leg on which each target has last been passed. ended: device, int32 (n,), status and since when [s after the
    run's start]; shore: whether what has run aground is seen.
    """
    scale = np.asarray(scale, np.float32)
    size = exposure.shape[0] if kind != ABEAM else passed.shape[0]
    _expose(
        kind, *own.launched, scenario, made, *noise.key(seed), step.elapsed, step.number, *track,
        np.asarray(table, np.float32), scale.reshape(-1), np.asarray(unit, np.float32),
        scale.shape[1] if scale.ndim == 2 else 0, scale.shape[-1], exposure, passed, size, *ended, int(shore),
    )  # fmt: skip
