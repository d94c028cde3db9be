"""A particle's life: its states, and during which part of a step it moves.

Times are whole seconds after the run's start, also of a run backward in time. A particle waits for its release, drifts,
and ends ashore, outside of the forcing, outside of the domain or sunk; what refloats goes on from the beach.
"""

import taichi as ti

ADRIFT, ASHORE, OUTSIDE, LEFT, SUNK, PENDING = range(6)  # drift.particles.status.Status

NEVER = 2**31 - 1  # [s] a time that does not come
LONGEST = 2.0e9  # [s] longest wait on a beach that whole seconds can hold


@ti.func
def ahead(status: ti.i32, release: ti.i32, due: ti.i32, sink_time: ti.i32, elapsed: ti.i32, duration: ti.i32):
    """Return (moves, left, finish) of the step that begins at `elapsed`, before the step is made.

    moves: whether the particle moves in it; left, finish: from when to when [s]. due: when its wait on the beach ends,
    `NEVER` where nothing refloats; sink_time: when it sinks, `NEVER` where nothing sinks. A particle whose time to sink
    comes before it would begin to move has finish equal to left: adrift it sinks at once; on the beach it stays,
    waterlogged.
    """
    end = elapsed + duration
    begins = release
    moves = status == ADRIFT or (status == PENDING and release < end)
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
def behind(
    status: ti.i32, release: ti.i32, status_since: ti.i32, moving_since: ti.i32, elapsed: ti.i32, duration: ti.i32
):
    """Return (seen, left, finish, gone) [s] of the step just made, which began at `elapsed`.

    Pending particles are not allowed. The particle was there to be seen from `seen` until `gone`, and moved straight
    from `left` to `finish`: not before its release, nor before it refloated (`moving_since`), nor after it ended
    (`status_since`). What lies ashore is still there to be seen.
    """
    finish = elapsed + duration
    gone = finish
    if status != ADRIFT:
        finish = ti.min(finish, status_since)
        if status != ASHORE:
            gone = finish
    seen = ti.max(elapsed, release)
    left = seen
    if moving_since < finish:
        left = ti.max(left, moving_since)
    return seen, left, finish, gone


@ti.func
def refloats(status_since: ti.i32, uniform: ti.f32, stay: ti.f32) -> ti.i32:
    """Return when [s] a particle that went ashore at `status_since` is afloat again.

    The wait on the beach is exponential of mean `stay` [s]. uniform: a number in (0, 1) of this landing, so that no
    step draws the wait anew.
    """
    wait = ti.min(-ti.log(uniform) * stay, LONGEST)
    return status_since + ti.cast(ti.min(wait, LONGEST - ti.cast(status_since, ti.f32)), ti.i32)
