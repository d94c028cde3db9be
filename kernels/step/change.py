"""Changes of state on the way: an object capsizes, is swamped or sinks, a person leaves a raft.

State 0 is the object as it went adrift, state k + 1 what change k of its scenario leads to. A change
comes at a time that was drawn, or at a rate: its hazard is the rate, or at wind speed W

    rate / (1 + exp((at - W) / width)),

and the change comes where the integral of the hazard over the time adrift in a state that it can
leave reaches an exponential number of the particle (Cox 1955, doi:10.1111/j.2517-6161.1955.tb00188.x).
So its distribution does not depend on the steps. Along a step the wind that the particle feels is
taken as linear between both ends.

Columns are rows of the array of the leeway lines, after these: the state, then for each change when
it came and its wait: a time [s]; at a rate, how long it still has to be adrift [s]; by the wind, what
is left of the integral. A particle changes only while adrift.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti

from kernels.maths import noise, sphere, spreads
from kernels.runtime import rows, runtime
from kernels.step.coast import Reals
from kernels.step.features import DIFFUSION, LINES
from kernels.step.prior import LINES as LEEWAY_LINES
from kernels.step.prior import REDRAWS
from kernels.step.velocity import WIND_FROM, forcing_at

f32x2 = ti.types.vector(2, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)
f32x6 = ti.types.vector(6, ti.f32)

# Row of the state among those of the leeway lines, and then two rows for each change: when it came,
# and its wait.
STATE = 6
CAME, WAIT = STATE + 1, STATE + 2
# Numbers of a change in the table: the states that it leaves (a bit each), how it comes (below), its
# rate [1/s], the wind [m/s] at half of it, the width [m/s], whether the object sinks, the share of
# the former leeway that is left, and of each leeway line slope, offset, their standard deviations,
# and the least slope.
LEAVES, COMES, RATE, BLOWS, WIDTH, SINKS, KEEPS = range(7)
LINE = 7
PER_LINE = 5
NUMBERS = LINE + PER_LINE * LEEWAY_LINES
# How a change comes: at a time after its state began, at a time of the run, by the wind, at a rate.
AFTER, AT, BY_WIND, AT_RATE = range(4)
LATEST = 1e9  # [s] latest time of a change
MOST = 16  # changes of one scenario: that of drift.case.scenario.change
MOST_LINES = MOST * LEEWAY_LINES
PANELS = 4  # of the midpoint rule for a step's integral of the hazard


@ti.func
def _hazard(wind: f32x2, rate: ti.f32, blows: ti.f32, width: ti.f32) -> ti.f32:
    """Return the hazard [1/s] of a change by a wind [m/s]."""
    return rate / (1.0 + ti.exp((blows - wind.norm()) / width))


@ti.func
def _spend(
    table: ti.template(),
    at: ti.i32,
    winds: ti.template(),
    first: ti.f32,
    last: ti.f32,
    wait: ti.f32,
) -> f32x2:
    """Return (spent, due): the integral of a hazard over a part of a step, and where it is `wait`.

    at: the change in the table; winds: at both ends of the step, see `winds_felt`; first, last:
    shares of the step; due: a share of the step, above 1 if the integral stays below `wait`. The
    integral is over shares of the step [1/s].
    """
    spent, due = ti.f32(0.0), ti.f32(2.0)
    part = (last - first) / PANELS
    for k in range(PANELS):
        share = first + (ti.cast(k, ti.f32) + 0.5) * part
        wind = f32x2(
            winds[0] + share * (winds[2] - winds[0]), winds[1] + share * (winds[3] - winds[1])
        )
        more = part * _hazard(wind, table[at + RATE], table[at + BLOWS], table[at + WIDTH])
        if due > 1.0 and spent + more >= wait and more > 0.0:
            due = first + (ti.cast(k, ti.f32) + ti.max(wait - spent, 0.0) / more) * part
        spent += more
    return f32x2(spent, due)


@ti.func
def _draw_line(
    table: ti.template(),
    at: ti.i32,
    terms: ti.template(),
    slot: ti.i32,
    number: ti.i32,
    time: ti.i32,
) -> f32x2:
    """Return slope and offset [m/s] of a leeway line of the new state: see prior.draw_object.

    at: the line in the table; number: of the line among all of the scenario's changes. time: of the
    change [s]: after resampling, a slot may change to a state that a former particle of the slot
    has changed to.
    """
    mean, least = table[at], table[at + 4]
    slope, n = least, (least - mean) / ti.max(table[at + 2], 1e-30)
    k, found = 0, 0
    while found == 0 and k < REDRAWS:
        w = noise.further(
            terms.seed0, terms.seed1, noise.STREAM_CHANGED, slot, time, number + k * MOST_LINES
        )
        drawn = noise.normals(w[0], w[1])[0]
        k += 1
        if mean + table[at + 2] * drawn >= least:
            slope, n, found = mean + table[at + 2] * drawn, drawn, 1
    return f32x2(slope, table[at + 1] + table[at + 3] * n)


@ti.func
def winds_felt(
    features: ti.template(),
    velocity: ti.template(),
    sea: ti.template(),
    own: ti.template(),
    x: ti.i32,
    y: ti.i32,
    dt: ti.f32,
    begin: ti.f32,
    end: ti.f32,
) -> ti.types.vector(4, ti.f32):
    """Return the winds [m/s] that a particle feels at both ends of its step, east and north.

    Its end is where the velocity at its begin would lead it: an error of second order in the step.
    own: its `Drifter`; begin, end: shares of the lattice step.
    """
    w = forcing_at(features, sea, own, WIND_FROM, x, y, begin)
    r = velocity(features, sea, own, x, y, begin)
    x_end, y_end = sphere.exponential(x, y, dt * r[0], dt * r[1])
    after = forcing_at(features, sea, own, WIND_FROM, x_end, y_end, end)
    known = after[2] > 0.5
    return ti.Vector(
        [
            w[0] + own.error[2],
            w[1] + own.error[3],
            ti.select(known, after[0], w[0]) + own.error[2],
            ti.select(known, after[1], w[1]) + own.error[3],
        ]
    )


@ti.func
def _whole_second(seconds: ti.f32, since: ti.i32) -> ti.i32:
    """Return the first whole second that is not before `seconds` after `since`."""
    return since + ti.cast(ti.ceil(ti.min(ti.max(seconds, 0.0), LATEST)), ti.i32)


@ti.func
def _began(core: ti.template(), own: ti.template(), i: ti.i32, state: ti.i32, n: ti.i32) -> ti.f32:
    """Return when the state of particle i at the begin of its step began [s]."""
    began = ti.cast(core.release[i], ti.f32)
    if state > 0:
        began = own.leeway_rows[(CAME + 2 * state - 2) * n + i]
    return began


@ti.func
def _cut_short(features: ti.template(), held: ti.template(), j: ti.i32, finish: ti.i32):
    """Let the step of particle j of the bundle end at `finish`, before it moves."""
    lasts = ti.cast(finish - held.left[0, j], ti.f32)
    part = lasts / ti.max(held.dt[0, j], 1.0)
    held.finish[0, j], held.dt[0, j] = finish, lasts
    held.share[0, j] *= part
    if ti.static(features & DIFFUSION):
        held.variance[0, j] *= part
        for k in ti.static(range(2)):
            held.walk[k, j] *= ti.sqrt(part)


@ti.func
def change(
    features: ti.template(),
    held: ti.template(),
    j: ti.i32,
    finish: ti.i32,
    for_good: ti.template(),
    table: ti.template(),
    core: ti.template(),
    own: ti.template(),
    terms: ti.template(),
    n: ti.i32,
):
    """Let the changes of a step come to particle j of the bundle.

    It is called twice. Before the particle moves, only its step changes: it drifts along the mean of
    its leeway lines before and after, each as long as it holds, since leeway is linear in them. If
    it sinks, its step ends there. After it has moved, `for_good`, the columns change: up to
    `finish`, since it may have met the shore.

    held, table, terms: see kernels.step.advance. n: length of a row.
    """
    i = held.i[0, j]
    base = terms.changes_at + held.story[0, j] * terms.changes * NUMBERS
    state = ti.cast(own.leeway_rows[STATE * n + i], ti.i32)
    begin, since, until, span = held.left[0, j], held.left[0, j], finish, held.span[0, j]
    winds = f32x4([held.winds[k, j] for k in ti.static(range(4))])
    line, mixed = f32x6(0.0), f32x6(0.0)  # lines now; their sum over the step so far, times seconds
    if ti.static(features & LINES):
        for m in ti.static(range(6)):
            line[m] = own.leeway_rows[m * n + i]
    for k in range(terms.changes):
        held.wait[k, j] = own.leeway_rows[(WAIT + 2 * k) * n + i]
    going, changed = 1, 0
    for _ in range(terms.changes):
        if going == 1:
            first, which = until + 1, -1
            from_share = ti.cast(since - begin, ti.f32) / span
            for k in range(terms.changes):
                at = base + k * NUMBERS
                if (ti.cast(table[at + LEAVES], ti.i32) >> state) & 1 == 1:
                    wait, due = held.wait[k, j], since
                    if table[at + COMES] == BY_WIND:
                        coming = _spend(table, at, winds, from_share, 1.0, wait / span)
                        due = _whole_second(coming[1] * span, begin)
                    elif table[at + COMES] == AT_RATE:
                        due = _whole_second(wait, since)
                    else:
                        if table[at + COMES] == AFTER:
                            wait += ti.select(
                                changed == 1, ti.cast(since, ti.f32), _began(core, own, i, state, n)
                            )
                        due = _whole_second(wait, 0)
                    due = ti.max(due, since)
                    if table[at + SINKS] > 0.5:
                        # at least a second, so that the step of a sinking particle has a length
                        due = ti.max(due, begin + 1)
                    if due < first:
                        first, which = due, k
            first = ti.min(first, until)
            share = ti.cast(first - begin, ti.f32) / span
            for k in range(terms.changes):
                at = base + k * NUMBERS
                if (ti.cast(table[at + LEAVES], ti.i32) >> state) & 1 == 1:
                    if table[at + COMES] == BY_WIND:
                        spent = _spend(table, at, winds, from_share, share, 0.0)
                        held.wait[k, j] -= spent[0] * span
                    elif table[at + COMES] == AT_RATE:
                        held.wait[k, j] -= ti.cast(first - since, ti.f32)
            if which < 0:
                going = 0
            else:
                at = base + which * NUMBERS
                mixed += ti.cast(first - since, ti.f32) * line
                since, state, changed = first, which + 1, 1
                if ti.static(for_good):
                    own.leeway_rows[(CAME + 2 * which) * n + i] = ti.cast(first, ti.f32)
                if table[at + SINKS] > 0.5:
                    until, going = first, 0
                    if ti.static(for_good):
                        core.sink_time[i] = first
                elif ti.static(bool(features & LINES)):
                    for m in ti.static(range(3)):
                        drawn = _draw_line(
                            table,
                            at + LINE + PER_LINE * m,
                            terms,
                            held.slot[0, j],
                            3 * which + m,
                            first,
                        )
                        for p in ti.static(range(2)):
                            line[2 * m + p] = table[at + KEEPS] * line[2 * m + p] + drawn[p]
    if ti.static(for_good):
        own.leeway_rows[STATE * n + i] = ti.cast(state, ti.f32)
        for k in range(terms.changes):
            own.leeway_rows[(WAIT + 2 * k) * n + i] = held.wait[k, j]
        if ti.static(features & LINES):
            for m in ti.static(range(6)):
                own.leeway_rows[m * n + i] = line[m]
    elif changed == 1:
        mixed += ti.cast(until - since, ti.f32) * line
        if ti.static(features & LINES):
            for m in ti.static(range(6)):
                held.line[m, j] = mixed[m] / ti.max(ti.cast(until - begin, ti.f32), 1.0)
        if until < held.finish[0, j]:
            _cut_short(features, held, j, until)


@ti.kernel
def _draw_wait(
    first: ti.i32,
    last: ti.i32,
    number: ti.i32,
    column: Reals,
    at: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
    which: ti.i32,
    time: ti.i32,
    mean: ti.f32,
    low: ti.f32,
    high: ti.f32,
    mode: ti.f32,
    flat: ti.f32,
):
    for i in range(first, last):
        w = noise.further(seed0, seed1, noise.STREAM_CHANGE, number + i - first, which, time)
        u, v = noise.uniform(w[0]), noise.uniform(w[1])
        wait = spreads.waiting(mean, u)
        if mean <= 0.0:
            wait = spreads.triangle(ti.Vector([low, high, mode, flat]), u, v)
        column[at + i] = ti.min(wait, LATEST)


def draw_wait(
    slots: tuple[int, int, int],
    column: Any,
    key: tuple[int, int],
    which: int,
    time: int,
    mean: float,
    law: Sequence[float],
) -> None:
    """Draw the wait for a change of each slot.

    Args:
        slots: the first, the one after the last, and the number of the first in the whole run.
        column: receives the waits, on the device, shape (n,).
        key: of random numbers.
        which: number of the change in its scenario.
        time: 0 at the start, later the time [s after start] from which the wait counts.
        mean: of an exponential wait; 0: by `law`.
        law: low, high, mode and uniform share of a truncated triangle (kernels.maths.spreads).
    """
    _draw_wait(*slots, *rows.located(column), *key, which, time, mean, *law)


# The numbers of the step's kernel about changes (kernels.step.advance.Terms), without any.
NO_CHANGE = {"changes": 0, "changes_at": 0, "by_wind": 0}


def with_changes(
    table: Any, changes: Sequence[Sequence[Sequence[float]]]
) -> tuple[Any, dict[str, int]]:
    """Return a table by scenario followed by the changes of state, and the kernel's numbers.

    Args:
        table: on the device, float32, flat.
        changes: of each scenario of the run, as rows of NUMBERS.
    """
    most, before = max(map(len, changes)), table.to_numpy()
    every = np.zeros((len(changes), most, NUMBERS), np.float32)
    for scenario, own in enumerate(changes):
        for number, row in enumerate(own):
            every[scenario, number] = row
    by_wind = bool((every[..., COMES] == BY_WIND).any())
    terms = {"changes": most, "changes_at": len(before), "by_wind": int(by_wind)}
    return runtime.upload(np.concatenate([before, every.reshape(-1)])), terms
