"""Errors of current and wind that particles share with drifting buoys whose tracks are known.

The errors at the buoys are a few standard normal processes (drift.engine.motion.buoy_errors). Given
the tracks they have a mean, the same for all particles, and a deviation from it, which each particle
draws for itself: a linear Gaussian process that is advanced once a step. The error of a particle
has a correlation with that at each buoy that falls with the distance; the rest of its error is its
own (kernels.step.errors).
"""

from typing import Any

import taichi as ti

from kernels.maths import noise, sphere
from kernels.runtime import rows, runtime
from kernels.step.coast import Ints, Reals

# Columns in the rows of one array [m/s]: the mean over the step of the shared errors of current and
# wind, the current's bias in it; and the share of a particle's own errors that is left (1: all).
SHARED = (
    *("shared_current_east", "shared_current_north", "shared_wind_east", "shared_wind_north"),
    *("own_share_current", "own_share_wind"),
)
CURRENT, WIND, OWN_CURRENT, OWN_WIND = 0, 2, 4, 5


Numbers = ti.types.struct(
    buoys=ti.i32,
    # states of each component: processes of the current, the wind and the bias, then displacements
    states=ti.i32,
    windy=ti.i32,  # 1: a buoy feels errors of the wind
    biased=ti.i32,  # 1: the current has a constant bias
    current_std=ti.f32,  # [m/s]
    wind_std=ti.f32,
    bias_std=ti.f32,
    current_length=ti.f32,  # [m] over which errors are correlated
    wind_length=ti.f32,
    members=ti.i32,  # of the forcing ensemble, 1 without one
    worlds=ti.i32,  # 1: the particles of a world have one deviation; 0: each has its own
    begins=ti.i32,  # 1: the deviation is drawn, before the first step
    ahead=ti.f32,  # half of the step, in lengths of the one before; 0 in the first step
)


@ti.func
def _normal(seed0: ti.u32, seed1: ti.u32, stream: ti.i32, key: ti.i32, step: ti.i32, j: ti.i32):
    """Return two standard normals (east, north) for state j."""
    w = noise.further(seed0, seed1, stream, key, step, 1 + (j >> 1))
    a, b = w[0], w[1]
    if j & 1 == 1:
        a, b = w[2], w[3]
    return noise.normals(a, b)


@ti.func
def _move(
    z: ti.template(),
    old: ti.template(),
    n: ti.i32,
    i: ti.i32,
    states: ti.i32,
    moves: ti.template(),
    kicks: ti.template(),
    row: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
    stream: ti.i32,
    key: ti.i32,
    step: ti.i32,
):
    """Write z = moves z + kicks normals of particle i, in rows (state, component) of n columns.

    old: scratch that holds z before. moves, kicks: (rows, states, states), flat.
    """
    for k in range(2 * states):
        old[k * n + i] = z[k * n + i]
        z[k * n + i] = 0.0
    for j in range(states):
        normal = _normal(seed0, seed1, stream, key, step, j)
        east, north = old[2 * j * n + i], old[(2 * j + 1) * n + i]
        for k in range(states):
            at = (row * states + k) * states + j
            z[2 * k * n + i] += moves[at] * east + kicks[at] * normal[0]
            z[(2 * k + 1) * n + i] += moves[at] * north + kicks[at] * normal[1]


@ti.func
def _alpha(
    mixes: ti.template(), near: ti.template(), first: ti.i32, n: ti.i32, i: ti.i32, buoys: ti.i32,
    at: ti.i32, j: ti.i32,
):  # fmt: skip
    """Return the weight of process j in a particle's error: row j of the inverse of the buoys'
    Cholesky factor times the correlations with the buoys, which stand in `near` from row `first`.
    """
    total = ti.f32(0.0)
    for b in range(j + 1):
        total += mixes[(at * buoys + j) * buoys + b] * near[(first + b) * n + i]
    return total


@ti.func
def _correlate(
    scratch: ti.template(), first: ti.i32, n: ti.i32, i: ti.i32, buoys: ti.i32, length: ti.f32
):
    """Write the correlation of a particle's error with that of each buoy behind the distances, which
    stand in rows `first` to `first` + buoys - 1 of the scratch.
    """
    for b in range(buoys):
        share = scratch[(first + b) * n + i] / length
        # drift.engine.motion.buoy_errors.POWER
        scratch[(first + buoys + b) * n + i] = ti.exp(-share * ti.sqrt(share))


@ti.func
def _measure(
    z: ti.template(), scratch: ti.template(), first: ti.i32, n: ti.i32, i: ti.i32, lon: ti.i32,
    lat: ti.i32, buoys: ti.i32, places: ti.template(), row: ti.i32, ahead: ti.f32,
):  # fmt: skip
    """Write a particle's distance from each buoy in the middle of the step into the scratch.

    It is extrapolated from the distances at the begins of this step and of the one before, which
    stand in rows `first` on of z; the error is of second order in the step.
    """
    for b in range(buoys):
        at = 2 * (row * buoys + b)
        apart = sphere.offset_near(lon, lat, places[at], places[at + 1]).norm()
        last = z[(first + b) * n + i]
        scratch[(first + b) * n + i] = ti.max(apart + ahead * (apart - last), 0.0)
        z[(first + b) * n + i] = apart


@ti.kernel
def share_errors(
    first: ti.i32,
    last: ti.i32,
    shift: Ints,
    scenario: Ints,
    world: Ints,
    member: Ints,
    lon: Ints,
    lat: Ints,
    z: Reals,
    old: Reals,
    shared: Reals,
    moves: Reals,
    kicks: Reals,
    means: Reals,
    mixes: Reals,
    places: Ints,
    numbers: Numbers,
    row: ti.i32,
    step: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
):
    """Advance the deviations of particles over a step, and write their shared errors.

    Args:
        first: first slot.
        last: slot after the last one.
        shift: by scenario, from a slot to its number in the whole run, the key of its noise.
        scenario: of each particle.
        world: of each particle.
        member: of the forcing ensemble, of each particle; (1,) without one.
        lon: position at the begin of the step [binary angle].
        lat: position at the begin of the step.
        z: deviations, rows (state, component), then the distances from the buoys at the begin of the
            step before [m], flat ((2 states + buoys) n,).
        old: scratch, flat ((2 states + 2 buoys) n,).
        shared: written: rows SHARED.
        moves: transition of the deviations, (steps, states, states), flat; row 0: the first draw.
        kicks: root of the covariance of what is added, as `moves`.
        means: mean of the processes at begin and end of a step, by scenario and member,
            (steps, scenarios members, 2, states, 2), flat.
        mixes: inverses of the Cholesky factors of the correlations between buoys in the middle of a
            step, of the current's and of the wind's errors, (steps, 2, buoys, buoys), flat.
        places: lon, lat of each buoy at the begin of a step [binary angle], (steps, buoys, 2), flat.
        numbers: sizes and scales.
        row: of this step in the tables.
        step: number of the step, a key of the noise.
        seed0: first word of the run's key.
        seed1: second word of it.
    """
    for i in range(first, last):
        n = lon.shape[0]
        states, buoys = numbers.states, numbers.buoys
        key = i + shift[scenario[i]]
        if numbers.worlds == 1:
            key = world[i]
        if numbers.begins == 1:
            _move(
                z, old, n, i, states, moves, kicks, 0, seed0, seed1, noise.STREAM_BUOYS_BEGIN, key, 0
            )  # fmt: skip
        which = scenario[i] * numbers.members
        if numbers.members > 1:
            which += member[i]
        apart = 2 * states  # row of the first distance
        _measure(z, old, apart, n, i, lon[i], lat[i], buoys, places, row, numbers.ahead)
        # deviations at the begin, then those at the end, each with weight one half
        for k in range(6):
            shared[k * n + i] = 0.0
        for half in range(2):
            if half == 1:
                _move(
                    z, old, n, i, states, moves, kicks, row, seed0, seed1, noise.STREAM_BUOYS, key,
                    step,
                )  # fmt: skip
            mean_at = ((row * (shift.shape[0] * numbers.members) + which) * 2 + half) * states * 2
            _correlate(old, apart, n, i, buoys, numbers.current_length)
            used = ti.f32(0.0)
            for j in range(buoys):
                a = _alpha(mixes, old, apart + buoys, n, i, buoys, 2 * row, j)
                used += a * a
                bias_at = (1 + numbers.windy) * buoys + j
                for c in range(2):
                    u = means[mean_at + 2 * j + c] + z[(2 * j + c) * n + i]
                    total = numbers.current_std * u
                    if numbers.biased == 1:
                        v = means[mean_at + 2 * bias_at + c] + z[(2 * bias_at + c) * n + i]
                        total += numbers.bias_std * v
                    shared[(CURRENT + c) * n + i] += 0.5 * a * total
            shared[OWN_CURRENT * n + i] = ti.sqrt(ti.max(1.0 - used, 0.0))
            shared[OWN_WIND * n + i] = 1.0
            if numbers.windy == 1:
                _correlate(old, apart, n, i, buoys, numbers.wind_length)
                used = 0.0
                for j in range(buoys):
                    a = _alpha(mixes, old, apart + buoys, n, i, buoys, 2 * row + 1, j)
                    used += a * a
                    for c in range(2):
                        u = means[mean_at + 2 * (buoys + j) + c] + z[(2 * (buoys + j) + c) * n + i]
                        shared[(WIND + c) * n + i] += 0.5 * a * numbers.wind_std * u
                shared[OWN_WIND * n + i] = ti.sqrt(ti.max(1.0 - used, 0.0))


def shared_of(columns: Any, shares: bool) -> Any:
    """Return the array of shared errors, float32 (6 n,); a placeholder (1,) without buoys."""
    return rows.whole(columns, SHARED) if shares else runtime.empty(1, ti.f32)
