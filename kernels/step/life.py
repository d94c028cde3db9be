"""A particle's states, the part of a step in which it moves, and how the step ends.

Times are whole seconds after the run's start, also in backward runs. A particle waits for its
release, drifts, and ends stranded, outside of the forcing, outside of the domain or sunk. A
refloated particle continues from the beach.
"""

import taichi as ti

ADRIFT, ASHORE, OUTSIDE, LEFT, SUNK, PENDING, UNDER_WAY, ARRIVED, AGROUND = range(
    9
)  # drift.engine.particles.status.Status

NEVER = 2**31 - 1  # [s] later than any time of a run
LONGEST = 2.0e9  # [s] longest wait on a beach that whole seconds can hold


@ti.func
def ahead(
    status: ti.i32,
    release: ti.i32,
    due: ti.i32,
    sink_time: ti.i32,
    elapsed: ti.i32,
    duration: ti.i32,
):
    """Return (moves, left, finish) of the step that begins at `elapsed`, before the step is made.

    moves: whether the particle moves in it; left, finish: from when to when [s]. due: when its wait
    on the beach ends, `NEVER` without refloating; sink_time: when it sinks, `NEVER` without
    sinking. If a particle's time to sink comes before it would begin to move, finish equals left:
    an adrift one sinks at once; a stranded one stays on the beach, waterlogged.
    """
    end = elapsed + duration
    begins = release
    moves = status == ADRIFT or ((status == PENDING or status == UNDER_WAY) and release < end)
    if status == ASHORE:
        begins = due
        moves = due < end
    left = ti.max(elapsed, begins)
    finish = end
    if sink_time < end:
        finish = ti.max(sink_time, left)
        moves = moves and (finish > left or status != ASHORE)
    return moves, left, finish


@ti.func
def ending(
    core: ti.template(),
    domain: ti.template(),
    i: ti.i32,
    met: ti.i32,
    number: ti.i32,
    part: ti.f32,
    known: ti.template(),
    lon: ti.i32,
    lat: ti.i32,
    left: ti.i32,
    finish: ti.i32,
    over: ti.i32,
):
    """Write the position, state and time of particle i at the end of a step.

    core: columns lon, lat, status, status_since and edge. domain: has west, south, width, height,
    the box outside which a particle has left. met, number, part: whether and where it met the
    shore, as kernels.step.shore.meet returns them; lon, lat: its position there, or at the end of
    its path. known: whether the whole path had forcing; otherwise the particle stays where it was.
    It moved from `left` to `finish` [s]; over: the end of the step [s]. Stranding takes precedence
    over leaving the domain and sinking.
    """
    if met == 1:
        core.lon[i], core.lat[i] = lon, lat
        core.status[i] = ASHORE
        core.status_since[i] = left + ti.cast(part * ti.cast(finish - left, ti.f32), ti.i32)
        core.edge[i] = number
    elif known:
        core.lon[i], core.lat[i] = lon, lat
        core.status[i] = ADRIFT
        if (
            ti.cast(lon - domain.west, ti.u32) > domain.width
            or ti.cast(lat - domain.south, ti.u32) > domain.height
        ):
            core.status[i] = LEFT
            core.status_since[i] = over
        elif finish < over:
            core.status[i] = SUNK
            core.status_since[i] = finish
    else:
        core.status[i] = OUTSIDE
        core.status_since[i] = left


@ti.func
def behind(
    status: ti.i32,
    release: ti.i32,
    status_since: ti.i32,
    moving_since: ti.i32,
    elapsed: ti.i32,
    duration: ti.i32,
):
    """Return (seen, left, finish, gone) [s] of the step just made, or of a part of it.

    The step or part began at `elapsed`. Pending particles are not allowed. The particle was visible
    from `seen` until `gone`, and moved straight from `left` to `finish`: not before its release,
    nor before it refloated (`moving_since`), nor after it ended (`status_since`). Stranded
    particles stay visible.
    """
    finish = elapsed + duration
    gone = finish
    if status != ADRIFT:
        finish = ti.min(finish, status_since)
        if status != ASHORE:
            gone = finish
    seen = ti.max(elapsed, release)
    # the minimum: it may refloat after this part of the step
    left = ti.max(seen, ti.min(moving_since, finish))
    return seen, left, finish, gone


@ti.func
def refloats(status_since: ti.i32, uniform: ti.f32, stay: ti.f32) -> ti.i32:
    """Return when [s] a particle that stranded at `status_since` is afloat again.

    The wait on the beach is exponential with mean `stay` [s]. uniform: a number in (0, 1) that
    belongs to this landing, so that every step computes the same wait.
    """
    wait = ti.min(-ti.log(uniform) * stay, LONGEST)
    return status_since + ti.cast(ti.min(wait, LONGEST - ti.cast(status_since, ti.f32)), ti.i32)
