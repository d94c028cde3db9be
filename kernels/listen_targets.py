"""What a passive sonar has heard, or a sensor with a table of POD has seen, of each target under way.

See kernels.listen and kernels.glimpse.

A piece of a target's way (kernels.pieces) without noise is straight. A Brownian bridge is halved at Levy's midpoints where
the sensor may tell of it (a sonar: where it may be heard), until it strays by no more than the table of losses resolves, or half a cell of POD (kernels.noise: the same midpoints for
every sensor that asks); its speed, which the level may depend on, is that of its leg.
"""

from typing import Any

import numpy as np
import taichi as ti

from kernels import batch, glimpse, jumps, life, listen, noise, sphere, ways
from kernels.batch import Batch
from kernels.coast import Ints, Reals
from kernels.glimpse import HEARD, Pods
from kernels.listen import Ear, HostReals, Laid, Stretch, f32x2
from kernels.pieces import NONE, Pieces
from kernels.sweep_targets import DEPTH, Levels


@ti.kernel
def _steering(
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
    ear: Ear,
    losses: HostReals,
    around: HostReals,
    levels: HostReals,
    paces: HostReals,
    offsets: HostReals,
    limits: HostReals,
    log_missed: Reals,
    edges: Reals,
    held: Reals,
    status: Ints,
    status_since: Ints,
    shore: ti.i32,
):
    many = offsets.shape[0]
    size = log_missed.shape[0] // many
    for nth in range(first * many, last * many):
        i, f = batch.listed_slot(listed, slots, nth // many), nth % many
        which = scenario[i]
        here = NONE
        if pieces.piece_count[i] != NONE:
            here = i
        if here != NONE:
            silence, total, quiet = jumps.at_first(), 0.0, 0.0
            if ti.static(kind == HEARD):
                silence = listen.taken(f * size + i, size * many, edges, held)
            now = ear.begin
            while here != NONE:
                begin = ti.cast(pieces.piece_begin[here] - elapsed, ti.f32)
                whole = ti.cast(pieces.piece_end[here] - pieces.piece_begin[here], ti.f32)
                aground = status[i] == life.AGROUND and pieces.piece_begin[here] >= status_since[i]
                told = begin < ear.end and begin + whole > ear.begin and (shore == 1 or not aground)
                k = pieces.piece_k[here]
                if ti.static(kind == HEARD):
                    if told:
                        x, y = pieces.piece_lon[here], pieces.piece_lat[here]
                        to_x, to_y = pieces.piece_to_lon[here], pieces.piece_to_lat[here]
                        stray = glimpse.FAR * k * ti.sqrt(whole)
                        told = listen.out_of_reach(ear, x, y, to_x, to_y, stray) == 0
                if told:
                    mean = f32x2(pieces.piece_east[here], pieces.piece_north[here]).norm()
                    # Parts of the piece, halved where it matters: their ends on a stack, the nearest one on top.
                    ends_x, ends_y, depths = Levels(0), Levels(0), Levels(0)
                    top, at, ax, ay = 0, 0, pieces.piece_lon[here], pieces.piece_lat[here]
                    ends_x[0], ends_y[0] = pieces.piece_to_lon[here], pieces.piece_to_lat[here]
                    while top >= 0:
                        # at: begin of the part, in 2^-DEPTH of the piece
                        bx, by, depth = ends_x[top], ends_y[top], depths[top]
                        part = whole * ti.cast(1 << (DEPTH - depth), ti.f32) * (1.0 / (1 << DEPTH))
                        from_ = begin + whole * ti.cast(at, ti.f32) * (1.0 / (1 << DEPTH))
                        low, high = ti.max(ear.begin, from_), ti.min(ear.end, from_ + part)
                        stray = k * ti.sqrt(part)
                        halve = 0
                        if low < high:
                            dx, dy = ti.cast(bx - ax, ti.f32), ti.cast(by - ay, ti.f32)
                            a, b = f32x2(0.0), f32x2(0.0)
                            for side in range(2):
                                when = low if side == 0 else high
                                share = (when - from_) / ti.max(part, 1e-6)
                                x = ax + ti.cast(ti.round(share * dx), ti.i32)
                                y = ay + ti.cast(ti.round(share * dy), ti.i32)
                                found = glimpse.where(kind, ear, when, x, y)
                                if side == 0:
                                    a = found
                                else:
                                    b = found
                            b = glimpse.onward(kind, ear, a, b)
                            fine = 0.5 * ear.between
                            if ti.static(kind == HEARD):
                                fine = ti.max(ear.between, listen.FINE)
                            if depth < DEPTH and stray > fine:
                                halve = glimpse.near(kind, ear, a, b, stray)
                                if ti.static(kind == HEARD):
                                    if halve == 1:
                                        d = b - a
                                        share = ti.min(ti.max(-a.dot(d) / ti.max(d.dot(d), 1e-12), 0.0), 1.0)
                                        far = ti.max((a + share * d).norm() - glimpse.FAR * stray, 0.0)
                                        loud = listen.level(levels, paces, which, mean) + offsets[f]
                                        halve = listen.audible(ear, limits, far, loud)
                            if halve == 1:
                                pass
                            elif ti.static(kind == HEARD):
                                quiet += low - now
                                speed = mean
                                if k <= 0.0 and paces.shape[0] > 1:
                                    to_x, to_y = pieces.piece_to_lon[here], pieces.piece_to_lat[here]
                                    far = sphere.offset_near(pieces.piece_lon[here], pieces.piece_lat[here], to_x, to_y)
                                    speed = far.norm() / ti.max(whole, 1.0)
                                source = listen.level(levels, paces, which, speed) + offsets[f]
                                listen.hear(silence, quiet, ear, losses, around, limits, a, b, high - low, source)
                                now = high
                            else:
                                total += glimpse.hazard(kind, ear, losses, a, b, high - low)
                        if halve == 1:
                            w = noise.further(
                                seed0, seed1, noise.STREAM_LEVY, i + shift[which], step,
                                (pieces.piece_count[here] << (DEPTH + 1)) + at + (1 << (DEPTH - depth - 1)),
                            )  # fmt: skip
                            normal = noise.normals(w[0], w[1])
                            mx, my = ways.toward(ax, ay, bx, by, 0.5 * part, 0.5 * part, k, normal)
                            depths[top] = depth + 1
                            top += 1
                            ends_x[top], ends_y[top], depths[top] = mx, my, depth + 1
                        else:
                            at += 1 << (DEPTH - depth)
                            ax, ay = bx, by
                            top -= 1
                here = pieces.piece_next[here]
            if ti.static(kind == HEARD):
                if status[i] >= life.PENDING:  # else it has gone adrift, and kernels.listen goes on from there
                    quiet += ear.end - now
                jumps.settle(silence, ear.rate, quiet)
                listen.put(silence, f * size + i, size * many, log_missed, edges, held)
            else:
                log_missed[i] -= total


def steering(
    made: Any,
    own: Batch,
    scenario: Any,
    seed: int,
    step: Any,
    sonar: Laid,
    kept: tuple[Any, Any, Any],
    ended: tuple[Any, Any],
) -> None:
    """Have a sonar listen for targets under way on a stretch of the step just made.

    made: their pieces in the step (a kernels.advance.Step), see kernels.steer.made; own: slots of which pieces were
    made; scenario: of each slot, device. kept: see kernels.listen.drifting. ended: device, int32 (n,), status
    and since when [s after the run's start]. What has run aground is not heard.
    """
    _steering(
        HEARD, *own.launched, scenario, made, *noise.key(seed), step.elapsed, step.number, sonar.ear, *sonar.tables,
        *kept, *ended, 0,
    )  # fmt: skip


def glimpsed(
    made: Any,
    own: Batch,
    scenario: Any,
    seed: int,
    step: Any,
    stretch: Stretch,
    pods: Pods,
    shore: bool,
    log_missed: Any,
    ended: tuple[Any, Any],
) -> None:
    """Add to the logs of misses what a sensor with a table of POD does to targets under way on a stretch of the step just made.

    pods, log_missed: see kernels.glimpse.drifting; shore: whether what has run aground is seen. The rest: see `steering`.
    """
    none = np.zeros(1, np.float32)
    _steering(
        pods.kind, *own.launched, scenario, made, *noise.key(seed), step.elapsed, step.number,
        glimpse.ear(stretch, pods), np.ascontiguousarray(pods.table, np.float32).reshape(-1), none, none, none, none, none,
        log_missed, log_missed, log_missed, *ended, int(shore),
    )  # fmt: skip
