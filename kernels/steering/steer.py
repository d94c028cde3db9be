"""Lattice steps of steering targets, and their positions inside a step.

A target moves from one event of its itinerary to the next in pieces, each along a rhumb line, a
great circle, or a Brownian bridge about a great circle (kernels.steering.ways). Whenever something
inside a step is needed, the same pieces are computed again, bit for bit, from the state at the
step's begin: a target's position at a time, or the pieces for all sensors
(kernels.steering.pieces).

A target that is subject to the current follows its itinerary by dead reckoning. The current sets it
off its dead-reckoned track, steadily within a step (kernels.steering.felt). The columns hold its
true position; itineraries use the dead-reckoned position only.
"""

from typing import Any

import taichi as ti

from kernels.maths import angles, noise, sphere, spreads
from kernels.runtime import batch, bundle, launch, rows, runtime
from kernels.runtime.batch import Batch
from kernels.steering import itinerary, ways
from kernels.steering.itinerary import (
    BETWEEN,
    NEVER,
    PHASE,
    POINT,
    POINT_LAW,
    RATE,
    SHARE,
    STOPPED,
    STORY,
    STORY_LAW,
    TRIES,
    Chance,
    Plan,
    Target,
    aim,
    on_course,
    own_k,
    own_speed,
    own_start,
    set_at,
)
from kernels.steering.pieces import NONE, Pieces, Room, note
from kernels.step import life
from kernels.step.coast import (
    Coast,
    DeviceCoast,
    Ints,
    Reals,
    first_crossing,
    is_clear,
    is_wet,
    open_sea,
)

MOVED, NOTED, BOTH = range(3)  # what a launch does: move targets, write their pieces, or both
BIRTH = -(2**31)  # number of the step in the key of numbers that are drawn before any step
MOST_TRIES = 4096  # candidates of a start position, as in kernels.step.prior
LATER = -1  # instead of a state: the rest needs the second loop
Longs = ti.types.ndarray(dtype=ti.i64, ndim=1)

f32x2 = ti.types.vector(2, ti.f32)

# Columns of an ensemble that itineraries need, of shape (n,) each: core columns, then the rows of
# one array of integers and of one of floats (kernels.runtime.rows).
CORE = ("lon", "lat", "status", "release", "status_since", "edge", "scenario")
WHOLE = (
    "birth",
    "departure",
    "phase",
    "leg",
    "to_lon",
    "to_lat",
    "to_time",
    "phase_end",
    "set_lon",
    "set_lat",
)
REAL = ("course", "speed", "set_rate_lon", "set_rate_lat")
COLUMNS = {**dict.fromkeys((*CORE, *WHOLE), Ints), **dict.fromkeys(REAL, Reals)}
Columns = ti.types.argpack(**dict.fromkeys(CORE, Ints), steer_whole=Ints, steer_real=Reals)


class Own:
    """Row numbers of the columns WHOLE and REAL in their arrays."""

    BIRTH, DEPARTURE, PHASE, LEG, TO_LON, TO_LAT, TO_TIME, PHASE_END, SET_LON, SET_LAT = range(10)
    COURSE, SPEED, SET_RATE_LON, SET_RATE_LAT = range(4)


Terms = ti.types.struct(
    seed0=ti.u32,
    seed1=ti.u32,
    west=ti.i32,  # see kernels.step.advance.Domain
    south=ti.i32,
    width=ti.u32,
    height=ti.u32,
)


@ti.func
def _loaded(columns: ti.template(), i: ti.i32, elapsed: ti.i32) -> Target:
    """Return target i from its columns, at the begin of a step [s] or at its departure."""
    own, real = ti.static(columns.steer_whole, columns.steer_real)
    n = columns.lon.shape[0]  # a row's length
    begin = ti.max(elapsed, departure(columns, i))
    set_lon, set_lat = own[Own.SET_LON * n + i], own[Own.SET_LAT * n + i]
    return Target(
        lon=columns.lon[i] - set_lon,
        lat=columns.lat[i] - set_lat,
        time=begin,
        phase=own[Own.PHASE * n + i],
        leg=own[Own.LEG * n + i],
        to_lon=own[Own.TO_LON * n + i],
        to_lat=own[Own.TO_LAT * n + i],
        to_time=own[Own.TO_TIME * n + i],
        phase_end=own[Own.PHASE_END * n + i],
        course=real[Own.COURSE * n + i],
        speed=real[Own.SPEED * n + i],
        over=0,
        set_lon=set_lon,
        set_lat=set_lat,
        rate_lon=real[Own.SET_RATE_LON * n + i],
        rate_lat=real[Own.SET_RATE_LAT * n + i],
        set_since=begin,
    )


@ti.func
def departure(columns: ti.template(), i: ti.i32) -> ti.i32:
    """Return when [s] target i gets under way."""
    return columns.steer_whole[Own.DEPARTURE * columns.lon.shape[0] + i]


@ti.func
def birth(columns: ti.template(), i: ti.i32) -> ti.i32:
    """Return the slot in which target i was created."""
    return columns.steer_whole[Own.BIRTH * columns.lon.shape[0] + i]


@ti.func
def under_way(columns: ti.template(), i: ti.i32, end: ti.i32):
    """Return whether target i is under way before the end [s] of the step to be made."""
    state = columns.status[i]
    return state == life.UNDER_WAY or (state == life.PENDING and departure(columns, i) < end)


@ti.func
def _wanders(plan: ti.template(), key: Chance, target: Target) -> ti.f32:
    """Return K [m/sqrt(s)] of the path on which a target is; 0: it keeps to its line."""
    k = 0.0
    if plan.numbers[target.phase * PHASE] == itinerary.WAY:
        k = own_k(plan, key, target.phase)
    return k


@ti.func
def _piece(plan: ti.template(), key: Chance, target: Target, k: ti.f32, until: ti.i32):
    """Return (lon, lat, time) at the end of a target's next piece.

    The piece ends at `until` [s] or at the next event. k: see `_wanders`.
    """
    end = ti.min(until, target.to_time)
    x, y = target.to_lon, target.to_lat
    if on_course(plan, target.phase):
        x, y = ways.rhumb(
            target.lon, target.lat, target.course, target.speed * ti.cast(end - target.time, ti.f32)
        )
    elif end < target.to_time:
        dt, rest = ti.cast(end - target.time, ti.f32), ti.cast(target.to_time - end, ti.f32)
        normal = f32x2(0.0)
        if k > 0.0:
            w = noise.further(key.seed0, key.seed1, noise.STREAM_WAY, key.slot, key.step, key.count)
            normal = noise.normals(w[0], w[1])
        x, y = ways.toward(
            target.lon, target.lat, target.to_lon, target.to_lat, dt, rest, k, normal
        )
    return x, y, end


@ti.func
def _amid(
    plan: ti.template(),
    target: Target,
    k: ti.f32,
    x: ti.i32,
    y: ti.i32,
    end: ti.i32,
    time: ti.f32,
    normal: f32x2,
):
    """Return a target's position at a time within a piece that ends at (x, y) at `end` [s].

    normal: two standard normal numbers of a Brownian bridge between the ends of the piece.
    """
    at_x, at_y = target.lon, target.lat
    dt = time - ti.cast(target.time, ti.f32)
    if on_course(plan, target.phase):
        at_x, at_y = ways.rhumb(target.lon, target.lat, target.course, target.speed * dt)
    elif dt > 0.0:
        at_x, at_y = ways.toward(
            target.lon, target.lat, x, y, dt, ti.cast(end, ti.f32) - time, k, normal
        )
    return at_x, at_y


@ti.func
def _stretch(
    apart: ti.template(),
    coastal: ti.i32,
    plan: ti.template(),
    key: Chance,
    scenario: ti.i32,
    target: Target,
    k: ti.f32,
    until: ti.i32,
    coast: ti.template(),
):
    """Return (lon, lat, time, state, edge) at the end of a target's next piece.

    A piece that meets the shore ends there. apart: whether to return the state LATER if a way point
    is reached or the shore may be met.
    """
    x, y, time = _piece(plan, key, target, k, until)
    state, edge = life.UNDER_WAY, -1
    if ti.static(apart):
        if time == target.to_time:
            state = LATER
    if coastal == 1:
        if plan.numbers[plan.stories_at + scenario * STORY + 2] & STOPPED:
            ax, ay = set_at(target, target.time)
            bx, by = set_at(target, time)
            ax, ay, bx, by = target.lon + ax, target.lat + ay, x + bx, y + by
            if ti.static(apart):
                if not is_clear(ax, ay, ti.max(abs(bx - ax), abs(by - ay)), coast):
                    state = LATER
            else:
                hit, x_stop, y_stop, share, number = first_crossing(ax, ay, bx - ax, by - ay, coast)
                if hit == 1:
                    time = target.time + ti.cast(
                        share * ti.cast(time - target.time, ti.f32), ti.i32
                    )
                    bx, by = set_at(target, time)
                    x, y, state, edge = x_stop - bx, y_stop - by, life.AGROUND, number
    return x, y, time, state, edge


@ti.func
def _reached(
    apart: ti.template(),
    coastal: ti.i32,
    plan: ti.template(),
    key: Chance,
    scenario: ti.i32,
    target: Target,
    x,
    y,
    time,
    coast: ti.template(),
) -> Target:
    """Return a target at the end of a piece; at a way point, the next one is drawn."""
    t = target
    t.lon, t.lat, t.time = x, y, time
    if ti.static(not apart):
        if time == t.to_time:
            t = aim(coastal, plan, key, scenario, t, coast)
    return t


@ti.func
def _put_aside(i: ti.i32, aside: ti.template()):
    """Leave target i to the second loop of a kernel."""
    aside[1 + ti.atomic_add(aside[0], 1)] = i


@ti.func
def _moved(
    apart: ti.template(),
    coastal: ti.i32,
    i: ti.i32,
    shift: ti.template(),
    columns: ti.template(),
    plan: ti.template(),
    coast: ti.template(),
    terms: ti.template(),
    elapsed: ti.i32,
    duration: ti.i32,
    step: ti.i32,
    noted: ti.i32,
    pieces: ti.template(),
    aside: ti.template(),
):
    """Move target i and write its pieces, as `_steer` does for all.

    apart: whether to put the target aside when `_stretch` returns LATER.
    """
    end = elapsed + duration
    resting = columns.status[i] == life.ARRIVED or columns.status[i] == life.AGROUND
    if noted != MOVED:
        pieces.piece_count[i] = NONE
    if under_way(columns, i, end) or (noted != MOVED and resting):
        t = _loaded(columns, i, elapsed)
        which = columns.scenario[i]
        key = Chance(terms.seed0, terms.seed1, birth(columns, i), i + shift[which], step, 0)
        state, until = life.UNDER_WAY, ti.min(end, columns.release[i])
        if resting:
            state, t.time, until = columns.status[i], elapsed, end
        here, met, stopped, turned = NONE, -1, t.time, 0
        while t.time < until:
            x, y, time, state_then = t.lon, t.lat, until, state  # for a target that has stopped
            k = ti.f32(0.0)
            if state == life.UNDER_WAY:
                key.count += 1
                k = _wanders(plan, key, t)
                x, y, time, state_then, met = _stretch(
                    apart, coastal, plan, key, which, t, k, until, coast
                )
            if ti.static(apart):
                if state_then == LATER:
                    state = LATER
                    break
            if noted != MOVED:
                seen = t
                dlon, dlat = set_at(t, t.time)
                seen.lon, seen.lat = t.lon + dlon, t.lat + dlat
                dlon, dlat = set_at(t, time if state == life.UNDER_WAY else t.time)
                here = note(pieces, i, here, seen, x + dlon, y + dlat, time, k, key.count)
            if state == life.UNDER_WAY and state_then == life.UNDER_WAY:
                turned |= ti.cast(time == t.to_time, ti.i32)
                t = _reached(apart, coastal, plan, key, which, t, x, y, time, coast)
                if t.over == 1:
                    state_then = life.ARRIVED
            else:
                t.lon, t.lat, t.time = x, y, time
            if state == life.UNDER_WAY:
                stopped = t.time
            state = state_then
            if state != life.UNDER_WAY:
                until = end if noted != MOVED else t.time
            if ti.static(apart):
                # the whole path was one piece: the compiler need not keep registers for a second
                # one
                break
        if state == LATER:
            _put_aside(i, aside)
        elif noted != NOTED and not resting:
            t.time = stopped
            if state != life.UNDER_WAY:
                columns.status_since[i] = stopped
                if state == life.AGROUND:
                    columns.edge[i] = met
            x, y = _placed(columns, i, t)
            # Write only changed columns: arrays of equal size compete for the same cache lines.
            if turned == 1:
                _aimed(columns, i, t)
            outside = (
                ti.cast(x - terms.west, ti.u32) > terms.width
                or ti.cast(y - terms.south, ti.u32) > terms.height
            )
            if state == life.UNDER_WAY and outside:
                state = life.LEFT
                columns.status_since[i] = end
            columns.status[i] = state


@ti.kernel
def _steer(
    coastal: ti.i32,
    listed: ti.i32,
    first: ti.i32,
    last: ti.i32,
    slots: Ints,
    shift: Ints,
    columns: Columns,
    plan: Plan,
    coast: Coast,
    terms: Terms,
    elapsed: ti.i32,
    duration: ti.i32,
    step: ti.i32,
    noted: ti.i32,
    pieces: Pieces,
    aside: Ints,
):
    """Move targets, or write their pieces without changing the columns, or both.

    noted: MOVED, NOTED or BOTH.
    """
    # On a graphics card, targets that reach a way point or come near the shore have a loop of their
    # own: it takes three times the registers of everything else, and each thread would be given
    # them.
    apart = ti.static(bundle.alone())
    if ti.static(apart):
        aside[0] = 0
    if ti.static(bundle.threads(512)):
        ti.loop_config(block_dim=512)
    for j in range(first, last):
        i = batch.listed_slot(listed, slots, j)
        _moved(
            apart,
            coastal,
            i,
            shift,
            columns,
            plan,
            coast,
            terms,
            elapsed,
            duration,
            step,
            noted,
            pieces,
            aside,
        )
    if ti.static(apart):
        if ti.static(bundle.threads(256)):
            ti.loop_config(block_dim=256)
        for p in range(aside[0]):
            _moved(
                False,
                coastal,
                aside[1 + p],
                shift,
                columns,
                plan,
                coast,
                terms,
                elapsed,
                duration,
                step,
                noted,
                pieces,
                aside,
            )


@ti.func
def _placed(columns: ti.template(), i: ti.i32, t: Target):
    """Write and return the position of target i; write how far the current has set it."""
    dlon, dlat = set_at(t, t.time)
    x, y = t.lon + dlon, t.lat + dlat
    columns.lon[i], columns.lat[i] = x, y
    if t.rate_lon != 0.0 or t.rate_lat != 0.0:
        own, real = ti.static(columns.steer_whole, columns.steer_real)
        n = columns.lon.shape[0]  # a row's length
        own[Own.SET_LON * n + i], own[Own.SET_LAT * n + i] = dlon, dlat
        # Until the current is sampled again.
        real[Own.SET_RATE_LON * n + i], real[Own.SET_RATE_LAT * n + i] = 0.0, 0.0
    return x, y


@ti.func
def _aimed(columns: ti.template(), i: ti.i32, t: Target):
    """Write the phase, way point, course and speed of target i."""
    own, real = ti.static(columns.steer_whole, columns.steer_real)
    n = columns.lon.shape[0]  # a row's length
    own[Own.PHASE * n + i], own[Own.LEG * n + i], own[Own.PHASE_END * n + i] = (
        t.phase,
        t.leg,
        t.phase_end,
    )
    own[Own.TO_LON * n + i], own[Own.TO_LAT * n + i], own[Own.TO_TIME * n + i] = (
        t.to_lon,
        t.to_lat,
        t.to_time,
    )
    real[Own.COURSE * n + i], real[Own.SPEED * n + i] = t.course, t.speed


@ti.func
def _found_inside(
    apart: ti.template(),
    coastal: ti.i32,
    i: ti.i32,
    shift: ti.template(),
    before: ti.template(),
    plan: ti.template(),
    coast: ti.template(),
    terms: ti.template(),
    elapsed: ti.i32,
    duration: ti.i32,
    step: ti.i32,
    then: ti.i32,
    half: ti.i32,
    since: ti.i32,
    moment: ti.i32,
    at_lon: ti.template(),
    at_lat: ti.template(),
    east: ti.template(),
    north: ti.template(),
    aside: ti.template(),
):
    """Find target i at a time inside the step, as `_inside` does for all; apart: see `_moved`."""
    end = elapsed + duration
    begin, until = ti.max(elapsed, departure(before, i)), ti.min(end, before.release[i])
    when = then
    if half >= 0:
        when = begin + half * (until - begin) // 2
    if under_way(before, i, end) and when <= until and departure(before, i) <= when:
        t = _loaded(before, i, elapsed)
        which = before.scenario[i]
        key = Chance(terms.seed0, terms.seed1, birth(before, i), i + shift[which], step, 0)
        state = life.UNDER_WAY
        while t.time < when and state == life.UNDER_WAY:
            key.count += 1
            k = _wanders(plan, key, t)
            x, y, time, state_then, _edge = _stretch(
                apart, coastal, plan, key, which, t, k, until, coast
            )
            if ti.static(apart):
                if state_then == LATER:
                    state = LATER
                    break
            if time > when:
                if t.time < since and since < time:
                    off_lon, off_lat = set_at(t, since)
                    t.lon, t.lat, t.time = at_lon[i] - off_lon, at_lat[i] - off_lat, since
                w = noise.noise_words(
                    terms.seed0, terms.seed1, noise.STREAM_MIDWAY, key.slot, moment
                )
                normal = noise.normals(w[0], w[1])
                t.lon, t.lat = _amid(plan, t, k, x, y, time, ti.cast(when, ti.f32), normal)
                t.time = when
            else:
                state = state_then
                if state == life.UNDER_WAY:
                    t = _reached(apart, coastal, plan, key, which, t, x, y, time, coast)
                    if t.over == 1:
                        state = life.ARRIVED
                else:
                    t.lon, t.lat, t.time = x, y, time
            if ti.static(apart):
                break
        if state == LATER:
            _put_aside(i, aside)
        else:
            dlon, dlat = set_at(t, t.time)
            at_lon[i], at_lat[i] = t.lon + dlon, t.lat + dlat
            east[i], north[i] = 0.0, 0.0
            if state == life.UNDER_WAY:
                v = velocity(plan, t)
                metres = ti.f32(sphere.RADIUS * sphere.UNIT)
                east[i] = v[0] + t.rate_lon * metres * sphere.cos_lat(at_lat[i])
                north[i] = v[1] + t.rate_lat * metres


@ti.kernel
def _inside(
    coastal: ti.i32,
    listed: ti.i32,
    first: ti.i32,
    last: ti.i32,
    slots: Ints,
    shift: Ints,
    before: Columns,
    plan: Plan,
    coast: Coast,
    terms: Terms,
    elapsed: ti.i32,
    duration: ti.i32,
    step: ti.i32,
    then: ti.i32,
    half: ti.i32,
    since: ti.i32,
    moment: ti.i32,
    at_lon: Ints,
    at_lat: Ints,
    east: Reals,
    north: Reals,
    aside: Ints,
):
    apart = ti.static(bundle.alone())  # see `_steer`
    if ti.static(apart):
        aside[0] = 0
    if ti.static(bundle.threads(512)):
        ti.loop_config(block_dim=512)
    for j in range(first, last):
        i = batch.listed_slot(listed, slots, j)
        _found_inside(
            apart,
            coastal,
            i,
            shift,
            before,
            plan,
            coast,
            terms,
            elapsed,
            duration,
            step,
            then,
            half,
            since,
            moment,
            at_lon,
            at_lat,
            east,
            north,
            aside,
        )
    if ti.static(apart):
        if ti.static(bundle.threads(256)):
            ti.loop_config(block_dim=256)
        for p in range(aside[0]):
            _found_inside(
                False,
                coastal,
                aside[1 + p],
                shift,
                before,
                plan,
                coast,
                terms,
                elapsed,
                duration,
                step,
                then,
                half,
                since,
                moment,
                at_lon,
                at_lat,
                east,
                north,
                aside,
            )


@ti.func
def velocity(plan: ti.template(), target: Target) -> f32x2:
    """Return a target's dead-reckoned velocity (east, north) [m/s].

    It is along its course, or to its way point in time.
    """
    s, c = angles.sincos(target.course)
    found = target.speed * f32x2(s, c)
    if not on_course(plan, target.phase):
        way = sphere.offset(target.lon, target.lat, target.to_lon, target.to_lat)
        found = way / ti.max(ti.cast(target.to_time - target.time, ti.f32), 1.0)
    return found


@ti.kernel
def _born(
    coastal: ti.i32,
    listed: ti.i32,
    first: ti.i32,
    last: ti.i32,
    slots: Ints,
    shift: Ints,
    columns: Columns,
    plan: Plan,
    coast: Coast,
    terms: Terms,
    tries: Longs,
):
    if ti.static(bundle.threads(256)):
        ti.loop_config(block_dim=256)
    for j in range(first, last):
        i = batch.listed_slot(listed, slots, j)
        which = columns.scenario[i]
        slot = i + shift[which]
        n = columns.lon.shape[0]  # a row's length
        columns.steer_whole[Own.BIRTH * n + i] = slot
        key = Chance(terms.seed0, terms.seed1, slot, slot, BIRTH, 0)
        story = plan.stories_at + which * STORY
        first_phase = plan.numbers[story]
        t = Target(
            lon=columns.lon[i],
            lat=columns.lat[i],
            time=columns.release[i],
            phase=first_phase,
            leg=0,
        )
        if plan.numbers[first_phase * PHASE] == itinerary.WAY:
            point = plan.numbers[first_phase * PHASE + 1]
            found, tried = 0, 0
            while found == 0 and tried < MOST_TRIES:
                w = noise.noise_words(terms.seed0, terms.seed1, noise.STREAM_PRIOR, slot, tried)
                t.lon, t.lat, found = itinerary.draw_waypoint(
                    plan, key, first_phase, point, f32x2(0.0), w
                )
                if found == 1:
                    tries[2 * which] += 1
                if coastal == 1:
                    if found == 1 and plan.numbers[story + 2] & itinerary.WET:
                        found = is_wet(t.lon, t.lat, coast)
                tried += 1
            tries[2 * which + 1] += 1 - found
            t.time, t.leg = own_start(plan, key, first_phase), 1
            if plan.numbers[plan.points_at + point * POINT + 9] != itinerary.BY_SPEED:
                w = noise.noise_words(terms.seed0, terms.seed1, noise.STREAM_PRIOR, slot, -1)
                t.time = itinerary.when(plan, point, t.time, w[0], w[1])
        columns.steer_whole[Own.DEPARTURE * n + i] = t.time
        columns.release[i] = _distress(plan, key, which, t.time)
        t = aim(coastal, plan, key, which, t, coast)
        _placed(columns, i, t)
        _aimed(columns, i, t)


@ti.func
def _distress(plan: ti.template(), key: Chance, scenario: ti.i32, departure: ti.i32) -> ti.i32:
    """Return when [s] a target with this departure goes adrift; `NEVER`: it does not."""
    story, law = plan.stories_at + scenario * STORY, plan.story_laws_at + scenario * STORY_LAW
    phase = plan.numbers[story]
    kind = plan.numbers[story + 3]
    time = NEVER
    if kind == BETWEEN:
        tries = 0
        time = departure - 1
        while time < departure and tries < TRIES:
            w = noise.further(
                key.seed0, key.seed1, noise.STREAM_BIRTH, key.birth, 8 * phase + 4, tries + 1
            )
            after = spreads.triangle(
                itinerary.law(plan.laws, law), noise.uniform(w[0]), noise.uniform(w[1])
            )
            time = plan.numbers[story + 4] + ti.cast(ti.round(after), ti.i32)
            tries += 1
        time = ti.max(time, departure)
    elif kind == RATE:
        w = itinerary.settled(key, phase, 4)
        wait = spreads.waiting(1.0 / plan.laws[law + 4], noise.uniform(w[0]))
        if wait < ti.cast(NEVER - departure, ti.f32) * 0.99:
            time = departure + ti.cast(ti.round(wait), ti.i32)
    elif kind == SHARE:
        w = itinerary.settled(key, phase, 4)
        share = spreads.triangle(
            itinerary.law(plan.laws, law), noise.uniform(w[0]), noise.uniform(w[1])
        )
        length = 0.0
        row = phase * PHASE
        for k in range(1, plan.numbers[row + 2]):
            length += plan.laws[plan.point_laws_at + (plan.numbers[row + 1] + k) * POINT_LAW + 3]
        time = departure + ti.cast(ti.round(share * length / own_speed(plan, key, phase)), ti.i32)
    return time


def terms(seed: int, domain: Any = None) -> dict[str, int]:
    """Return the numbers that are constant in a run.

    domain: a kernels.step.advance.Domain that targets may leave; None: they cannot leave.
    """
    seed0, seed1 = noise.key(seed)
    box = domain._asdict() if domain else {"west": 0, "south": 0, "width": 0, "height": 0}
    return {"seed0": seed0, "seed1": seed1, **box}


def _room_aside(own: Batch) -> Any:
    """Return the buffer for targets put aside, preceded by their number."""
    return runtime.empty(1 + (own.last - own.first if bundle.alone() else 0), ti.i32)


def packed(columns: Any) -> Any:
    """Return the named columns of targets as a pack."""
    together = rows.whole(columns, WHOLE), rows.whole(columns, REAL)
    return launch.pack(Columns, *(columns[name] for name in CORE), *together)


def born(
    columns, own: Batch, plan, seed: int, domain: Any, coast: DeviceCoast | None, tries
) -> None:
    """Draw the start, the distress and the first way points of targets, in place.

    Args:
        columns: by name, those of COLUMNS. If a scenario's first phase has no way point to begin
            at, lon, lat and release hold the position and time of its begin.
        own: the slots of steering targets.
        plan: the itineraries, see kernels.steering.itinerary.packed.
        seed: of the run.
        domain: that targets may leave; None: they cannot.
        coast: the coast; None: open sea.
        tries: int64 (2 scenarios,) on the device; candidates drawn and slots without a candidate in
            water are added.
    """
    _born(
        coast is not None,
        *own.launched,
        packed(columns),
        plan,
        (coast or open_sea()).pack,
        Terms(**terms(seed, domain)),
        tries,
    )


def mover(columns, own: Batch, plan, seed: int, domain: Any, coast: DeviceCoast | None):
    """Return a function that moves targets over one lattice step, in place, until their distress.

    See `born`; the function takes a kernels.step.advance.Step.
    """
    sea = (coast or open_sea()).pack
    none = Room(0).pack
    args = (
        coast is not None,
        *own.launched,
        packed(columns),
        plan,
        sea,
        terms(seed, domain),
        0,
        1,
        0,
        MOVED,
        none,
        _room_aside(own),
    )
    move = launch.bind(_steer, args, ("elapsed", "duration", "step"))
    return lambda step: move(step.elapsed, step.duration, step.number)


def move_targets(
    columns, own: Batch, plan, seed: int, domain: Any, coast: DeviceCoast | None, step, room: Room
) -> bool:
    """Move targets by a step and write the pieces of their tracks.

    Returns:
        Whether all pieces fitted into `room`. If not, the targets have moved, but the pieces must
        be written again by `write_pieces`.
    """
    fixed = coast is not None, *own.launched, packed(columns), plan, (coast or open_sea()).pack
    every = *fixed, Terms(**terms(seed, domain)), step.elapsed, step.duration, step.number, BOTH
    return room.enough(lambda pack: _steer(*every, pack, _room_aside(own)))


def write_pieces(
    before, own: Batch, plan, seed: int, coast: DeviceCoast | None, step, room: Room
) -> None:
    """Write the pieces of targets in a step that has been made.

    before: the columns at the step's begin, by name, those of COLUMNS. room: for all slots of the
    ensemble.
    """
    fixed = (
        coast is not None,
        *own.launched,
        packed(before),
        plan,
        (coast or open_sea()).pack,
        Terms(**terms(seed)),
    )
    room.fill(
        lambda pack: _steer(
            *fixed, step.elapsed, step.duration, step.number, NOTED, pack, _room_aside(own)
        )
    )


def inside(
    before,
    own: Batch,
    plan,
    seed: int,
    domain: Any,
    coast: DeviceCoast | None,
    step,
    begin,
    since: int,
    when: int,
    moment: int,
    velocity=None,
    half: int = -1,
) -> None:
    """Write the positions of targets under way at a time inside a step that has been made.

    Args:
        before: the columns at the step's begin, by name, those of COLUMNS.
        own: the slots of steering targets.
        plan: the itineraries.
        seed: of the run.
        domain: see `terms`.
        coast: the coast; None: open sea.
        step: the step, a kernels.step.advance.Step.
        begin: lon, lat [binary angle] at `since`, on the device; overwritten for targets under way
            at `when`.
        since: [s after the run's start].
        when: [s after the run's start].
        moment: together with seed and slot, the key of the noise at that time.
        velocity: east, north [m/s], float32 (n,) on the device, written likewise; None: not needed.
        half: 0 or 1: instead of `when`, the begin or the middle of the part of the step in which
            each target is under way.
    """
    east, north = velocity or (runtime.empty(begin[0].shape[0]), runtime.empty(begin[0].shape[0]))
    _inside(
        coast is not None,
        *own.launched,
        packed(before),
        plan,
        (coast or open_sea()).pack,
        Terms(**terms(seed, domain)),
        step.elapsed,
        step.duration,
        step.number,
        when,
        half,
        since,
        moment,
        *begin,
        east,
        north,
        _room_aside(own),
    )
