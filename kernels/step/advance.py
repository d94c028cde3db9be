"""Lattice steps of all particles: drift in current, wind and waves, errors, diffusion, coast.

A step from position (lon, lat) integrates dlon/dt = u / (R cos lat), dlat/dt = v / R by an explicit
Runge-Kutta scheme and adds a random walk. It ends at its first crossing of the shore, or slides
along the shore. Positions are integers; within the step everything is float32, relative to the
position at its begin. Adding the increment costs one rounding of at most 5 mm.

One launch does everything, so that the columns are read once. It processes particles in bundles
(kernels.runtime.bundle), each over all its steps, so that a bundle's data stay in the cache. Other
motion models can share the parts: kernels.step.life determines when a particle moves in the step
and writes its end, errors draws the random terms of a bundle, integrate moves a particle along any
velocity field, and shore applies the coast. Only velocity.drift belongs to this model.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import taichi as ti

from kernels.maths import noise, sphere
from kernels.maths.noise import Purpose
from kernels.runtime import batch, bundle, launch, rows, runtime
from kernels.runtime.batch import Batch
from kernels.step import buoys, change, curve, errors, guide, integrate, life, shore
from kernels.step.coast import POLEWARD, Coast, DeviceCoast, Ints, Reals, open_sea
from kernels.step.errors import Physics
from kernels.step.features import (
    BIAS,
    CHANGES,
    COAST,
    DEBRIS,
    DIFFUSION,
    DIVERGENCE,
    ERRORS,
    FORCING,
    GUIDED,
    JIBE,
    LAYERS,
    LINES,
    MEMBERS,
    PARAMETERS,
    POLAR,
    REFLOAT,
    RK4,
    SHARED,
    SINK,
    SLIDE,
    TAIL,
    WIND,
)
from kernels.step.life import ASHORE, OUTSIDE, SUNK
from kernels.step.sample import Ranges, Sea, Tiles, members_of, numbers_of
from kernels.step.velocity import Drifter, drift

# longest valid step [binary angle units], 42 degrees
FARTHEST = 5.0e8
LONGEST = 1.0e6  # [m] the same in a domain with a pole
ASIDE = 10  # numbers that a graphics card saves per particle near the shore

f32x2 = ti.types.vector(2, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)

# Columns of an ensemble, of shape (n,) each: those of every motion model, and those of this one,
# some of which are rows of one array (kernels.runtime.rows).
CORE = {
    **dict.fromkeys(
        ("lon", "lat", "status", "release", "status_since", "edge", "sink_time", "moving_since"),
        Ints,
    ),
    "scenario": Ints,
    "log_weight": Reals,
}
LEEWAY = ("down_slope", "down_offset", "right_slope", "right_offset", "left_slope", "left_offset")
OWN = ("side", *LEEWAY, *errors.ROWS)


# The arguments of the kernel in groups: arrays in packs, numbers in structures.
CoreColumns = ti.types.argpack(**CORE)
OwnColumns = ti.types.argpack(
    side=Ints,
    leeway_rows=Reals,  # (6 n,) rows LEEWAY; with changes of state more: kernels.step.change
    error_rows=Reals,  # (7 n,) rows errors.ROWS
    nudge_rows=Reals,  # (4 n,) rows guide.NUDGES
    shared_rows=Reals,  # (6 n,) rows buoys.SHARED
    member_of=Ints,
    bend=Reals,
)
Terms = ti.types.struct(
    direction=ti.f32,  # +1 forward in time, -1 backward
    seed0=ti.u32,
    seed1=ti.u32,
    coast0=ti.u32,  # key of the noise at the coast: debris has one of its own
    coast1=ti.u32,
    stay=ti.f32,  # see Beach
    offing=ti.f32,
    debris=ti.i32,  # see Surroundings
    west=ti.i32,  # see Domain
    south=ti.i32,
    width=ti.u32,
    height=ti.u32,
    keeps=ti.i32,  # whether `bend` is written: see kernels.step.curve
    changes=ti.i32,  # most changes of state of a scenario, and where in `table` they begin
    changes_at=ti.i32,
    by_wind=ti.i32,  # whether any of them comes by the wind
)


def _rows(features: int) -> dict[str, dict[str, int]]:
    """Return the rows of the registers that hold a bundle's particles, by name and type.

    The features decide which rows are needed; see kernels.runtime.bundle.
    """
    chance, lines = bool(features & (DIFFUSION | ERRORS)), bool(features & LINES)
    walks, wanders, beached = (bool(features & bit) for bit in (DIFFUSION, ERRORS, REFLOAT))
    changes = bool(features & CHANGES)
    reals = {
        "dt": 1,  # [s] during which it moves
        "begin": 1,  # share of the lattice step at which it starts
        "share": 1,  # of the lattice step
        "trig": 2,  # cosine and sine of its latitude at the start
        # leeway: slope and offset downwind, across to the right, across to the left
        "line": 6 * lines,
        "errors": 4 * wanders,
        "nudge": 4 * bool(wanders and features & GUIDED),  # added to the normals of the errors
        "shared": 6 * bool(wanders and features & SHARED),  # see kernels.step.buoys
        "bias": 2,
        "scale": bool(wanders and features & TAIL),
        "error": 4,
        "log": 3,
        "keep": 2,
        "variance": 1,
        "walk": 2 * walks,
        "off": 2 * beached,
        "first": 2,  # displacement over the whole step at the first stage's velocity
        "last": 2,
        "total": 2,
        "valid": 1,
        "sets_off": 1,  # see kernels.step.integrate
        # of changes of state: winds at both ends of the step, its length, what is left of the waits
        "winds": 4 * changes,
        "span": 1 * changes,
        "wait": change.MOST * changes,
    }
    ints = {
        "moving": 1,  # whether it moves
        "i": 1,  # its slot here
        "slot": 1,  # its number in the whole run, the key of its noise
        "story": 1,
        "left": 1,  # [s] when it starts
        "finish": 1,  # [s] when its path ends
        "side": lines,
        "member": bool(features & MEMBERS),  # member of the forcing ensemble
        "waits": beached,  # whether it is on a beach
        "place": 2,  # lon, lat where its path begins [binary angle]
        "move": 2,  # its displacement [binary angle units]
        "known": 1,  # whether its whole path has forcing
        "far": 1,  # whether the shore is out of reach
    }
    return {"reals": reals, "ints": ints, "words": {"word": 3 * chance}}


@ti.func
def _muster(
    features: ti.template(),
    i: ti.i32,
    j: ti.i32,
    held: ti.template(),
    core: ti.template(),
    own: ti.template(),
    shift: ti.template(),
    terms: ti.template(),
    n: ti.i32,
    elapsed: ti.i32,
    duration: ti.i32,
):
    """Load particle i into entry j of the bundle if it moves in this step; n: length of a row."""
    story = core.scenario[i]
    slot = i + shift[story]
    state, due, sinking = core.status[i], life.NEVER, life.NEVER
    if ti.static(features & REFLOAT):
        if state == ASHORE:
            w = noise.further(
                terms.coast0, terms.coast1, noise.STREAM_REFLOAT, slot, core.status_since[i], 0
            )
            due = life.refloats(core.status_since[i], noise.uniform(w[0]), terms.stay)
    if ti.static(features & SINK):
        sinking = core.sink_time[i]
    moves, left, finish = life.ahead(state, core.release[i], due, sinking, elapsed, duration)
    if ti.static(features & SINK):
        if moves and finish == left:
            core.status[i], core.status_since[i], moves = SUNK, finish, False
    if moves:
        held.moving[0, j], held.i[0, j], held.story[0, j], held.slot[0, j] = 1, i, story, slot
        held.left[0, j], held.finish[0, j] = left, finish
        if ti.static(features & REFLOAT):
            held.waits[0, j] = ti.cast(state == ASHORE, ti.i32)
        held.place[0, j], held.place[1, j] = core.lon[i], core.lat[i]
        # All values of an array are read before any is stored, which saves 2 % of the time of a
        # step.
        if ti.static(features & ERRORS):
            many = ti.static(4 if features & WIND else 2)
            error = ti.Vector([own.error_rows[k * n + i] for k in ti.static(range(many))])
            for k in ti.static(range(many)):
                held.errors[k, j] = error[k]
            if ti.static(features & TAIL):
                held.scale[0, j] = own.error_rows[errors.CURRENT_SCALE * n + i]
            if ti.static(features & GUIDED):
                nudge = ti.Vector([own.nudge_rows[k * n + i] for k in ti.static(range(4))])
                for k in ti.static(range(4)):
                    held.nudge[k, j] = nudge[k]
            if ti.static(features & SHARED):
                shared = ti.Vector([own.shared_rows[k * n + i] for k in ti.static(range(6))])
                for k in ti.static(range(6)):
                    held.shared[k, j] = shared[k]
        if ti.static(features & BIAS):
            for k in ti.static(range(2)):
                held.bias[k, j] = own.error_rows[(errors.CURRENT_BIAS + k) * n + i]
        if ti.static(features & MEMBERS):
            held.member[0, j] = own.member_of[i]
        if ti.static(features & LINES):
            held.side[0, j] = own.side[i]
            line = ti.Vector([own.leeway_rows[k * n + i] for k in ti.static(range(6))])
            for k in ti.static(range(6)):
                held.line[k, j] = line[k]


@ti.func
def _keep(features: ti.template(), j: ti.i32, held: ti.template(), own: ti.template(), n: ti.i32):
    """Store the new errors and side of particle j of the bundle; n: length of a row."""
    i = held.i[0, j]
    if ti.static(features & ERRORS):
        for k in ti.static(range(4 if features & WIND else 2)):
            own.error_rows[k * n + i] = held.errors[k, j]
    if ti.static(features & JIBE):
        own.side[i] = held.side[0, j]


@ti.func
def _carry(
    features: ti.template(),
    held: ti.template(),
    j: ti.i32,
    turn: f32x2,
    own: ti.template(),
    n: ti.i32,
):
    """Rotate the errors of particle j of the bundle along its path, as east and north turn.

    See sphere.convergence; n: length of a row.
    """
    i = held.i[0, j]
    if ti.static(features & ERRORS):
        for k in ti.static(
            (errors.CURRENT_ERROR, errors.WIND_ERROR)
            if features & WIND
            else (errors.CURRENT_ERROR,)
        ):
            error = sphere.carried_on(
                f32x2(own.error_rows[k * n + i], own.error_rows[(k + 1) * n + i]), turn
            )
            own.error_rows[k * n + i], own.error_rows[(k + 1) * n + i] = error[0], error[1]
    if ti.static(features & BIAS):
        first = errors.CURRENT_BIAS * n + i
        bias = sphere.carried_on(f32x2(own.error_rows[first], own.error_rows[first + n]), turn)
        own.error_rows[first], own.error_rows[first + n] = bias[0], bias[1]


@ti.func
def _drifter(
    features: ti.template(), held: ti.template(), j: ti.i32, row: ti.i32, asks: ti.f32
) -> Drifter:
    """Return the `Drifter` of particle j of the bundle; asks: 0 if its drift will not be used."""
    line = f32x4(0.0)
    if ti.static(features & LINES):
        left = held.side[0, j] < 0
        across = (
            ti.select(left, held.line[4, j], held.line[2, j]),
            ti.select(left, held.line[5, j], held.line[3, j]),
        )
        line = f32x4(held.line[0, j], held.line[1, j], across[0], across[1])
    among = 0
    if ti.static(features & MEMBERS):
        among = held.member[0, j]
    error = f32x4([held.error[k, j] for k in ti.static(range(4))])
    return Drifter(line=line, error=error, member=among, row=row, asks=asks)


@ti.func
def _way(held: ti.template(), j: ti.i32) -> integrate.Way:
    """Return the displacement of particle j of the bundle so far."""
    last, total = f32x2(held.last[0, j], held.last[1, j]), f32x2(held.total[0, j], held.total[1, j])
    return integrate.Way(
        last=last, total=total, valid=held.valid[0, j], sets_off=held.sets_off[0, j]
    )


@ti.func
def _bend(features: ti.template(), held: ti.template(), j: ti.i32) -> f32x4:
    """Return the departure of particle j's drift from its chord: see kernels.step.curve."""
    chord = f32x2(held.total[0, j], held.total[1, j])
    first = f32x2(held.first[0, j], held.first[1, j]) - chord
    last = -first  # midpoint scheme: the parabola through its stages
    if ti.static(features & RK4):
        last = f32x2(held.last[0, j], held.last[1, j]) - chord
    return f32x4(first[0], first[1], last[0], last[1])


@ti.func
def _flat(features: ti.template(), bend: f32x4, c: ti.f32) -> f32x4:
    """Return a bend in binary angle units; c: cosine of the latitude.

    In a domain with a pole it is given in metres.
    """
    flat = bend
    if ti.static(features & POLAR):
        north = ti.f32(1.0 / shore.METRES)
        flat = f32x4(bend[0] * north / c, bend[1] * north, bend[2] * north / c, bend[3] * north)
    return flat


@ti.func
def _off(features: ti.template(), held: ti.template(), j: ti.i32) -> f32x2:
    """Return the direction off the beach of particle j of the bundle; zero if it is afloat."""
    off = f32x2(0.0)
    if ti.static(features & REFLOAT):
        off = f32x2(held.off[0, j], held.off[1, j])
    return off


@ti.func
def _refloat(
    features: ti.template(),
    velocity: ti.template(),
    held: ti.template(),
    j: ti.i32,
    core: ti.template(),
    sea: ti.template(),
    coast: ti.template(),
    terms: ti.template(),
    elapsed: ti.i32,
    duration: ti.i32,
    row: ti.i32,
):
    """Place particle j of the bundle off its beach, as soon as the drift there leads off it.

    If the drift leads onto the beach when the wait ends, and off it at the step's end, it is
    assumed to change linearly in between.
    """
    c = sphere.cos_lat(held.place[1, j])
    x, y, east, north = shore.leave(
        held.place[0, j], held.place[1, j], c, terms.offing, core.edge[held.i[0, j]], coast
    )
    held.place[0, j], held.place[1, j] = x, y
    held.off[0, j], held.off[1, j] = terms.direction * east, terms.direction * north
    if ti.static(features & ERRORS):
        for k in ti.static(range(4 if features & WIND else 2)):
            held.error[k, j] = held.errors[k, j]
    if ti.static(features & BIAS):
        held.error[0, j] += held.bias[0, j]
        held.error[1, j] += held.bias[1, j]
    led = f32x2(0.0)  # drift off the beach at both ends [m/s]
    for k in range(2):
        when = held.left[0, j] if k == 0 else held.finish[0, j]
        fraction = ti.cast(when - elapsed, ti.f32) / duration
        r = velocity(features, sea, _drifter(features, held, j, row, 1.0), x, y, fraction)
        led[k] = r[0] * held.off[0, j] + r[1] * held.off[1, j]
    if led[0] <= 0.0 and led[1] > 0.0:
        waits = led[0] / (led[0] - led[1]) * ti.cast(held.finish[0, j] - held.left[0, j], ti.f32)
        held.left[0, j] = ti.min(
            held.left[0, j] + ti.cast(ti.ceil(waits), ti.i32) + 1, held.finish[0, j] - 1
        )


@ti.func
def _put_aside(held: ti.template(), j: ti.i32, bend: f32x4, aside: ti.template(), k: ti.i32):
    """Save particle j of the bundle, at index k of the batch: the shore may change its step."""
    row = 1 + ASIDE * ti.atomic_add(aside[0], 1)
    aside[row] = 2 * k + held.known[0, j]
    for m in ti.static(range(2)):
        aside[row + 1 + m] = held.move[m, j]
    for m in ti.static(range(4)):
        aside[row + 3 + m] = ti.bit_cast(bend[m], ti.i32)
    aside[row + 7], aside[row + 8], aside[row + 9] = (
        held.place[0, j],
        held.place[1, j],
        held.left[0, j],
    )


@ti.func
def _end(
    features: ti.template(),
    held: ti.template(),
    j: ti.i32,
    bend: f32x4,
    table: ti.template(),
    core: ti.template(),
    own: ti.template(),
    coast: ti.template(),
    terms: ti.template(),
    n: ti.i32,
    elapsed: ti.i32,
    duration: ti.i32,
    step: ti.i32,
):
    """End the step of moving particle j of the bundle: on the shore, or where its path leads.

    bend: of its path, see `_bend`; n: length of a row.
    """
    i, slot = held.i[0, j], held.slot[0, j]
    x, y, left, finish = held.place[0, j], held.place[1, j], held.left[0, j], held.finish[0, j]
    move_lon, move_lat, known = held.move[0, j], held.move[1, j], held.known[0, j] == 1
    x_end, y_end = x + move_lon, y + move_lat
    curved = bend
    met, number, part = 0, -1, ti.cast(1.0, ti.f32)
    if ti.static(features & COAST):
        # The shore comes first: a stage may lie inland, behind the shore, and lack forcing only for
        # that reason.
        if held.far[0, j] == 0:
            met, x_end, y_end, part, number = shore.meet(
                ti.static(bool(features & DIFFUSION)),
                ti.static(bool(features & SLIDE)),
                x,
                y,
                move_lon,
                move_lat,
                _flat(features, curved, held.trig[0, j]),
                held.trig[0, j],
                held.variance[0, j],
                terms.coast0,
                terms.coast1,
                slot,
                step,
                coast,
            )
        if ti.static(features & SLIDE):
            if x_end != x + move_lon or y_end != y + move_lat:
                known = True  # it slid along the shore: a stage without forcing was inland
    if ti.static(features & POLAR):
        turned = sphere.convergence(x, y, x_end, y_end)
        _carry(features, held, j, turned, own, n)
    if terms.keeps == 1:
        if met == 1:
            curved = curve.cut_short(curved, part)
        elif not known or x_end != x + move_lon or y_end != y + move_lat:  # it slid or stays
            curved = f32x4(0.0)
        if ti.static(features & POLAR):
            turn = sphere.meridian(x, y)
            at_first = sphere.carried_back(f32x2(curved[0], curved[1]), turn)
            at_last = sphere.carried_back(f32x2(curved[2], curved[3]), turn)
            curved = f32x4(at_first[0], at_first[1], at_last[0], at_last[1])
        for k in ti.static(range(4)):
            own.bend[4 * i + k] = curved[k]
    life.ending(
        core, terms, i, met, number, part, known, x_end, y_end, left, finish, elapsed + duration
    )
    if ti.static(features & CHANGES):
        adrift_until = finish
        if core.status[i] == ASHORE or core.status[i] == OUTSIDE:
            adrift_until = core.status_since[i]
        change.change(features, held, j, adrift_until, True, table, core, own, terms, n)


def _late(features: int) -> bool:
    """Return whether the few particles near the shore are processed in a separate loop.

    This is so on a graphics card: the shore's 64-bit integers need twice the registers of
    everything else, and every thread would be given them. Changes of state need what is known of
    the step at its end.
    """
    return bool(features & COAST) and not features & CHANGES and bundle.alone()


@ti.func
def _lead(
    features: ti.template(),
    velocity: ti.template(),
    width: ti.template(),
    held: ti.template(),
    table: ti.template(),
    core: ti.template(),
    own: ti.template(),
    sea: ti.template(),
    coast: ti.template(),
    terms: ti.template(),
    aside: ti.template(),
    place: ti.i32,
    n: ti.i32,
    elapsed: ti.i32,
    duration: ti.i32,
    step: ti.i32,
    row: ti.i32,
):
    """Move a bundle over one step.

    place: index of its first particle in the batch; n: length of a row in arrays of several
    columns; row: see `Drifter`.
    """
    if ti.static(features & REFLOAT):
        for j in range(width):
            if held.waits[0, j] == 1:
                _refloat(
                    features, velocity, held, j, core, sea, coast, terms, elapsed, duration, row
                )
    for j in range(width):
        held.dt[0, j] = ti.cast(held.finish[0, j] - held.left[0, j], ti.f32)
        held.begin[0, j] = ti.cast(held.left[0, j] - elapsed, ti.f32) / duration
        held.share[0, j] = held.dt[0, j] / duration
        held.trig[0, j], held.trig[1, j] = (
            sphere.cos_lat(held.place[1, j]),
            sphere.sin_lat(held.place[1, j]),
        )
        held.valid[0, j], held.sets_off[0, j] = 1.0, 1.0
    errors.draw_errors(features, width, held, table, terms, step)
    if ti.static(bundle.alone() and features & DIFFUSION):
        # The walk is used here, so that a graphics card keeps it during the stages, instead of the
        # dozen numbers that it is made of.
        held.valid[0, 0] = ti.select(held.walk[0, 0] + held.walk[1, 0] < sphere.RADIUS, 1.0, 0.0)
    for j in range(width):
        if held.moving[0, j] == 1:
            _keep(features, j, held, own, n)
            if ti.static(features & CHANGES):
                winds = f32x4(0.0)
                if ti.static(features & WIND):
                    if terms.by_wind == 1:
                        winds = change.winds_felt(
                            features,
                            velocity,
                            sea,
                            _drifter(features, held, j, row, 1.0),
                            held.place[0, j],
                            held.place[1, j],
                            held.dt[0, j],
                            held.begin[0, j],
                            held.begin[0, j] + held.share[0, j],
                        )
                for k in ti.static(range(4)):
                    held.winds[k, j] = winds[k]
                held.span[0, j] = ti.max(held.dt[0, j], 1.0)
                change.change(
                    features, held, j, held.finish[0, j], False, table, core, own, terms, n
                )
    scheme = ti.static(integrate.CLASSICAL if features & RK4 else integrate.MIDPOINT)
    # The loop runs at run time: unrolled it takes three times as long to compile and runs no
    # faster.
    for stage in range(ti.static(len(scheme[0]))):
        entry = integrate.tableau(scheme, stage)
        for j in range(width):
            way = _way(held, j)
            own_drift = _drifter(features, held, j, row, way.valid)
            if ti.static(features & POLAR):
                way = integrate.lead_over_pole(
                    velocity,
                    ti.static(bool(features & REFLOAT)),
                    features,
                    sea,
                    own_drift,
                    way,
                    held.place[0, j],
                    held.place[1, j],
                    terms.direction * held.dt[0, j],
                    held.begin[0, j] + entry[0] * held.share[0, j],
                    entry,
                    _off(features, held, j),
                )
            else:
                way = integrate.lead(
                    velocity,
                    ti.static(bool(features & REFLOAT)),
                    features,
                    sea,
                    own_drift,
                    way,
                    held.place[0, j],
                    held.place[1, j],
                    held.trig[0, j],
                    held.trig[1, j],
                    terms.direction * held.dt[0, j],
                    held.begin[0, j] + entry[0] * held.share[0, j],
                    entry,
                    _off(features, held, j),
                )
            for k in ti.static(range(2)):
                held.first[k, j] = ti.select(stage == 0, way.last[k], held.first[k, j])
                held.last[k, j], held.total[k, j] = way.last[k], way.total[k]
            held.valid[0, j], held.sets_off[0, j] = way.valid, way.sets_off
    for j in range(width):
        way = integrate.led(_way(held, j))
        for k in ti.static(range(2)):
            held.total[k, j] = way[k]
        if ti.static(features & POLAR):
            if ti.static(features & DIFFUSION):
                way += f32x2(held.walk[0, j], held.walk[1, j])
            near = way.norm() < LONGEST
            x, y = held.place[0, j], held.place[1, j]
            x_end, y_end = sphere.exponential(
                x, y, ti.select(near, way[0], 0.0), ti.select(near, way[1], 0.0)
            )
            held.move[0, j], held.move[1, j] = x_end - x, y_end - y
            held.known[0, j] = ti.cast(near & (held.valid[0, j] > 0.5), ti.i32)
        else:
            if ti.static(features & DIFFUSION):
                way += errors.walked(
                    f32x2(held.walk[0, j], held.walk[1, j]), held.trig[0, j], held.trig[1, j]
                )
            near = ti.max(ti.abs(way[0]), ti.abs(way[1])) < FARTHEST
            for k in ti.static(range(2)):
                held.move[k, j] = ti.cast(ti.round(ti.select(near, way[k], 0.0)), ti.i32)
            held.known[0, j] = ti.cast(near & (held.valid[0, j] > 0.5), ti.i32)
        if ti.static(features & COAST):
            off = curve.bulge(_flat(features, _bend(features, held, j), held.trig[0, j]))
            far = shore.is_far(
                ti.static(bool(features & DIFFUSION)),
                held.place[0, j],
                held.place[1, j],
                held.move[0, j],
                held.move[1, j],
                ti.cast(ti.max(off[0], off[1]), ti.i32) + 1,
                held.trig[0, j],
                held.variance[0, j],
                coast,
            )
            if ti.static(features & POLAR):
                far |= (
                    ti.min(ti.abs(held.place[1, j]), ti.abs(held.place[1, j] + held.move[1, j]))
                    > POLEWARD
                )
            held.far[0, j] = ti.cast(far, ti.i32)
    for j in range(width):
        # Where the drift leads onto the beach, the particle waits until it leads off.
        if held.moving[0, j] == 1 and held.sets_off[0, j] > 0.5:
            i, x, y = held.i[0, j], held.place[0, j], held.place[1, j]
            if ti.static(features & REFLOAT):
                core.moving_since[i] = held.left[0, j]
            if ti.static(features & DIVERGENCE):
                x_half, y_half = (
                    x + ti.cast(0.5 * held.total[0, j], ti.i32),
                    y + ti.cast(0.5 * held.total[1, j], ti.i32),
                )
                if ti.static(features & POLAR):
                    x_half, y_half = sphere.exponential(
                        x, y, 0.5 * held.total[0, j], 0.5 * held.total[1, j]
                    )
                core.log_weight[i] -= held.dt[0, j] * integrate.divergence(
                    velocity,
                    features,
                    sea,
                    _drifter(features, held, j, row, 1.0),
                    x_half,
                    y_half,
                    held.begin[0, j] + 0.5 * held.share[0, j],
                )
            if ti.static(_late(features)):
                if held.far[0, j] == 0:
                    _put_aside(held, j, _bend(features, held, j), aside, place + j)
                else:
                    _end(
                        ti.static(features & ~(COAST | SLIDE)),
                        held,
                        j,
                        _bend(features, held, j),
                        table,
                        core,
                        own,
                        coast,
                        terms,
                        n,
                        elapsed,
                        duration,
                        step,
                    )
            else:
                _end(
                    features,
                    held,
                    j,
                    _bend(features, held, j),
                    table,
                    core,
                    own,
                    coast,
                    terms,
                    n,
                    elapsed,
                    duration,
                    step,
                )


@ti.kernel
def _advance(
    features: ti.template(),
    velocity: ti.template(),
    width: ti.template(),
    held_of: ti.template(),
    listed: ti.template(),
    first: ti.i32,
    last: ti.i32,
    slots: Ints,
    shift: Ints,
    table: Reals,
    core: CoreColumns,
    own: OwnColumns,
    sea: Sea,
    coast: Coast,
    terms: Terms,
    aside: Ints,
    elapsed: ti.i32,
    duration: ti.i32,
    step: ti.i32,
    row: ti.i32,
    count: ti.i32,
):
    late = ti.static(_late(features))
    if ti.static(late):
        aside[0] = 0
    # more would spill registers
    threads = ti.static(bundle.threads(448 if features & DIFFUSION else 512))
    if ti.static(threads):
        ti.loop_config(block_dim=threads)
    for block in range((last - first + width - 1) // width):
        begin = first + block * width
        n = core.lon.shape[0]  # length of a row in arrays of several columns
        for k in range(count):
            since, number = elapsed + k * duration, step + k * ti.cast(terms.direction, ti.i32)
            held = held_of()
            for j in range(ti.min(width, last - begin)):
                i = batch.slot(listed, slots, begin + j)
                _muster(features, i, j, held, core, own, shift, terms, n, since, duration)
            if ti.static(bundle.alone()):
                if held.moving[0, 0] == 0:
                    continue
            _lead(
                features,
                velocity,
                width,
                held,
                table,
                core,
                own,
                sea,
                coast,
                terms,
                aside,
                begin - first,
                n,
                since,
                duration,
                number,
                (row + k) * numbers_of(sea),
            )
    if ti.static(late):
        for p in range(aside[0]):
            held = held_of()
            n = core.lon.shape[0]
            q = 1 + ASIDE * p
            i = batch.slot(listed, slots, first + (aside[q] >> 1))
            _muster(features, i, 0, held, core, own, shift, terms, n, elapsed, duration)
            held.known[0, 0] = aside[q] & 1
            for m in ti.static(range(2)):
                held.move[m, 0] = aside[q + 1 + m]
            curved = f32x4([ti.bit_cast(aside[q + 3 + m], ti.f32) for m in ti.static(range(4))])
            if ti.static(features & REFLOAT):  # where and when it left the beach
                held.place[0, 0], held.place[1, 0], held.left[0, 0] = (
                    aside[q + 7],
                    aside[q + 8],
                    aside[q + 9],
                )
            held.trig[0, 0] = sphere.cos_lat(held.place[1, 0])
            if ti.static(features & DIFFUSION):
                dt = ti.cast(held.finish[0, 0] - held.left[0, 0], ti.f32)
                held.variance[0, 0] = errors.variance(table, held.story[0, 0], dt)
            _end(
                features,
                held,
                0,
                curved,
                table,
                core,
                own,
                coast,
                terms,
                n,
                elapsed,
                duration,
                step,
            )


class Beach(NamedTuple):
    """Behaviour at the coast: a particle stays for good, stays for a while, or slides along."""

    stay: float = 0.0  # [s] mean time on the beach; 0: it stays for good
    offing: float = 0.0  # [m] distance off the beach at which it is afloat again
    slides: bool = False


class Step(NamedTuple):
    """One step of the lattice clock."""

    number: int  # number of the lattice step: the key of its noise
    elapsed: int  # [s] from the run's start to the begin of the step
    duration: int  # [s] > 0
    direction: int  # +1 forward in time, -1 backward
    pieces: int = 1  # straight pieces per path of a drifting particle, for evidence


class Move(Protocol):
    """A function that moves particles over one step, or over `count` equal steps in a row."""

    def __call__(self, step: Step, count: int = 1) -> None:
        """Move the particles in place. `Tiles.blend` must have set the weights of each step."""


class Domain(NamedTuple):
    """The box outside which a particle has left the domain [binary angle]."""

    west: int
    south: int
    width: int
    height: int


class Surroundings(NamedTuple):
    """Settings common to all scenarios of a run: the domain, the coast, the terms of a step."""

    domain: Domain
    coast: DeviceCoast | None = None
    beach: Beach = Beach()
    bias: bool = False  # whether particles have a constant bias of the current
    sinks: bool = False
    # subtract the divergence along the track from log weights: a backward run's likelihood
    divergence: bool = False
    # Number of a class of debris, 0: none. Debris shares the errors of the forcing with the object,
    # slot by slot, but has a random walk and jibes of its own.
    debris: int = 0
    scheme: str = "rk4"
    still: bool = False  # without random motion: its terms are compiled, and zero
    polar: bool = False  # whether the domain holds a pole
    guided: bool = False  # whether noise is nudged: kernels.step.guide
    shares: bool = False  # whether errors are shared with buoys: kernels.step.buoys
    # changes of state by scenario of the run, each a row of numbers: kernels.step.change; (): none
    changes: tuple[tuple[tuple[float, ...], ...], ...] = ()


def features(ranges: Ranges, physics: Sequence[Physics], place: Surroundings) -> int:
    """Return the compile-time features that these scenarios need together.

    A feature that a scenario does not use leaves its bits unchanged: each term is off at zero.
    """
    forcing = sum(
        FORCING.get(quantity, 0) for quantity, (first, last) in ranges.items() if last > first
    )
    wind = bool(forcing & WIND)
    coastal = place.coast is not None
    return (
        forcing
        | ERRORS * any(own.current_std > 0 or (wind and own.wind_std > 0) for own in physics)
        | DIFFUSION * any(own.diffusivity > 0 for own in physics)
        | JIBE * (wind and any(own.jibe_rate > 0 for own in physics))
        | COAST * coastal
        | RK4 * (place.scheme == "rk4")
        | BIAS * place.bias
        | SINK * place.sinks
        | REFLOAT * (coastal and place.beach.stay > 0)
        | SLIDE * (coastal and place.beach.slides)
        | DIVERGENCE * place.divergence
        | DEBRIS * (place.debris > 0)
        | POLAR * place.polar
        | GUIDED * place.guided
        | SHARED * place.shares
        | TAIL * any(own.tailed > 0 for own in physics)
        | LAYERS * any(last - first > 1 for first, last in ranges.values())
    )


def _set_aside(needed: int, count: int) -> int:
    """Return the size of the buffer for particles near the shore: see `_put_aside`."""
    return 1 + ASIDE * count if bundle.alone() and needed & COAST else 1


def advance(
    ensemble: Any,
    slots: tuple[int, int, int],
    tiles: Tiles,
    ranges: Ranges,
    physics: Physics,
    step: Step,
    place: Surroundings,
    velocity: Any = drift,
) -> None:
    """Move slots of one scenario of an ensemble over one lattice step, in place: see `mover`.

    slots: the first, the one after the last, and the number of the first in the whole run, which is
    the key of its noise.
    """
    first, last, number = slots
    own = batch.batch_of((first, last), (number,), (0,))
    mover(ensemble, own, tiles, ranges, (physics,), place, step.direction, velocity)(step)


def mover(
    ensemble: Any,
    own: Batch,
    tiles: Tiles,
    ranges: Ranges,
    physics: Sequence[Physics],
    place: Surroundings,
    direction: int,
    velocity: Any = drift,
    bend: Any = None,
    parameters: bool = False,
) -> Move:
    """Return a function that moves slots of an ensemble over one or more lattice steps, in place.

    Several steps take one launch; on a graphics card with a coast one each, without waiting. A
    particle moves only while adrift, from its release on; it ends stranded, sunk, outside the
    forcing or outside the domain.

    Args:
        ensemble: a drift.engine.particles.ensemble.Ensemble.
        own: its slots that are moved; the number of each in the whole run is the key of its noise.
        tiles: the forcing.
        ranges: first and last tile by quantity.
        physics: of each scenario of the batch.
        place: the settings common to all scenarios.
        direction: of all steps: +1 forward in time, -1 backward.
        velocity: a function as kernels.step.integrate takes it, so that the order of the scheme can
            be measured on an analytic flow.
        bend: float32 (4 n,) on the device, receives each path's departure from its chord
            (kernels.step.curve); None: not stored.
        parameters: whether velocity takes the parameters of a user's own function
            (kernels.step.own_velocity).
    """
    seed0, seed1 = noise.key(ensemble.seed)
    coastal = Purpose.DEBRIS_COAST if place.debris else Purpose.RUN
    coast0, coast1 = noise.key(ensemble.seed, coastal, place.debris)
    keeps = bend is not None
    needed = (
        features(ranges, physics, place) | MEMBERS * (tiles.members > 1) | PARAMETERS * parameters
    )
    table, changing = (
        own.table([Physics()] * len(physics) if place.still else physics),
        change.NO_CHANGE,
    )
    if any(place.changes[number] for number in own.scenarios if place.changes):
        needed |= CHANGES
        table, changing = change.with_changes(table, place.changes)
    args = (
        needed,
        velocity,
        bundle.width(),
        bundle.held(**_rows(needed)),
        own.listed,
        own.first,
        own.last,
        own.slots,
        own.shift,
        table,
        launch.pack(CoreColumns, *(getattr(ensemble, name) for name in CORE)),
        launch.pack(
            OwnColumns,
            ensemble.own["side"],
            rows.whole(ensemble.own, LEEWAY),
            rows.whole(ensemble.own, errors.ROWS),
            guide.nudges_of(ensemble.own, place.guided),
            buoys.shared_of(ensemble.own, place.shares),
            members_of(ensemble.own, tiles),
            bend if keeps else runtime.empty(4),
        ),
        tiles.sea(ranges),
        (place.coast or open_sea()).pack,
        {
            "direction": direction,
            "seed0": seed0,
            "seed1": seed1,
            "coast0": coast0,
            "coast1": coast1,
            "stay": place.beach.stay,
            "offing": place.beach.offing,
            "debris": place.debris,
            **place.domain._asdict(),
            "keeps": int(keeps),
            **changing,
        },
        runtime.empty(_set_aside(needed, own.last - own.first), ti.i32),
        *(0, 1, 0, 0, 1),
    )
    launched = launch.bind(_advance, args, ("elapsed", "duration", "step", "row", "count"))

    def move(step: Step, count: int = 1) -> None:
        at_once = 1 if _late(needed) else count
        for k in range(0, count, at_once):
            elapsed, number = step.elapsed + k * step.duration, step.number + k * direction
            launched(elapsed, step.duration, number, k, at_once)

    return move
