"""Errors of current and wind that particles share with drifting buoys whose tracks are known.

The errors at the buoys are Ornstein-Uhlenbeck processes (drift.engine.motion.buoy_errors). Given the
tracks they have a mean, the same for all particles, and a deviation from it, which each particle
draws for itself: a linear Gaussian process that is advanced once a step. What a particle shares with
the buoys are their innovations: the normals of its own error in a step are correlated with theirs,
by its distance from each buoy. So a particle's error alone is exactly the case's process, however
far it moves from a buoy, and a buoy that shows nothing changes nothing.
"""

from typing import Any

import taichi as ti

from kernels.maths import noise, sphere
from kernels.runtime import rows, runtime
from kernels.step import life
from kernels.step.coast import Ints, Reals

# Columns in the rows of one array: for this step's normals of the errors of current and wind, the
# part that is given by the buoys, and the factor of what a particle draws itself.
SHARED = (
    *("shared_current_east", "shared_current_north", "shared_wind_east", "shared_wind_north"),
    *("own_share_current", "own_share_wind"),
)
CURRENT, WIND, OWN_CURRENT, OWN_WIND = 0, 2, 4, 5
BIAS = 4  # row of the bias in kernels.step.errors.ROWS


Numbers = ti.types.struct(
    buoys=ti.i32,
    # states of each component: processes of the current, the wind and the bias, then displacements
    states=ti.i32,
    windy=ti.i32,  # 1: a buoy feels errors of the wind
    biased=ti.i32,  # 1: the current has a constant bias
    current_std=ti.f32,  # [m/s]
    wind_std=ti.f32,
    bias_std=ti.f32,
    current_keep=ti.f32,  # autocorrelation over the step
    wind_keep=ti.f32,
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


@ti.func
def _share(
    own: ti.template(), shared: ti.template(), z: ti.template(), scratch: ti.template(),
    means: ti.template(), mean_at: ti.i32, mixes: ti.template(), at: ti.i32, n: ti.i32, i: ti.i32,
    numbers: Numbers, state: ti.i32, keep: ti.f32, row: ti.i32, share_row: ti.i32, begins: ti.i32,
    std: ti.f32, bias_state: ti.i32,
):  # fmt: skip
    """Write what particle i shares of the innovations of one quantity's errors.

    state: the first state of the quantity; row: its east component in `own` and `shared`; begins:
    1 where the particle begins to drift, so that its first error, and with bias_state >= 0 its
    bias, are correlated with the buoys' too.
    """
    buoys, apart = numbers.buoys, 2 * numbers.states
    east, north, used = ti.f32(0.0), ti.f32(0.0), ti.f32(0.0)
    first, bias = ti.Vector([ti.f32(0.0), ti.f32(0.0)]), ti.Vector([ti.f32(0.0), ti.f32(0.0)])
    scale = 1.0 / ti.sqrt(1.0 - keep * keep)
    end_at = mean_at + 2 * numbers.states  # of the means at the step's end
    for j in range(buoys):
        a = _alpha(mixes, scratch, apart + buoys, n, i, buoys, at, j)
        used += a * a
        for b in range(j + 1):
            weight = a * mixes[(at * buoys + j) * buoys + b]
            for c in ti.static(range(2)):
                k = 2 * (state + b) + c
                before = means[mean_at + k] + scratch[k * n + i]
                after = means[end_at + k] + z[k * n + i]
                kick = weight * scale * (after - keep * before)
                if ti.static(c == 0):
                    east += kick
                else:
                    north += kick
                first[c] += weight * before
                if bias_state >= 0:
                    v = 2 * (bias_state + b) + c
                    bias[c] += weight * (means[mean_at + v] + scratch[v * n + i])
    left = ti.sqrt(ti.max(1.0 - used, 0.0))
    shared[row * n + i], shared[(row + 1) * n + i] = east, north
    shared[share_row * n + i] = left
    if begins == 1:
        for c in ti.static(range(2)):
            own[(row + c) * n + i] = std * first[c] + left * own[(row + c) * n + i]
            if bias_state >= 0:
                at_bias = (BIAS + c) * n + i
                own[at_bias] = numbers.bias_std * bias[c] + left * own[at_bias]


@ti.kernel
def share_errors(
    first: ti.i32,
    last: ti.i32,
    shift: Ints,
    scenario: Ints,
    world: Ints,
    member: Ints,
    status: Ints,
    release: Ints,
    lon: Ints,
    lat: Ints,
    own: Reals,
    z: Reals,
    scratch: Reals,
    shared: Reals,
    moves: Reals,
    kicks: Reals,
    means: Reals,
    mixes: Reals,
    places: Ints,
    numbers: Numbers,
    row: ti.i32,
    step: ti.i32,
    end: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
):
    """Advance the deviations of particles over a step, and write their shared innovations.

    Args:
        first: first slot.
        last: slot after the last one.
        shift: by scenario, from a slot to its number in the whole run, the key of its noise.
        scenario: of each particle.
        world: of each particle.
        member: of the forcing ensemble, of each particle; (1,) without one.
        status: of each particle.
        release: when each begins to drift [s].
        lon: position at the begin of the step [binary angle].
        lat: position at the begin of the step.
        own: updated where a particle begins to drift: rows kernels.step.errors.ROWS.
        z: deviations, rows (state, component), then the distances from the buoys at the begin of the
            step before [m], flat ((2 states + buoys) n,).
        scratch: flat ((2 states + 2 buoys) n,).
        shared: written: rows SHARED.
        moves: transition of the deviations, (steps, states, states), flat; row 0: the first draw.
        kicks: root of the covariance of what is added, as `moves`.
        means: mean of the states at begin and end of a step, by scenario and member,
            (steps, scenarios members, 2, states, 2), flat.
        mixes: inverses of the Cholesky factors of the correlations between buoys in the middle of a
            step, of the current's and of the wind's errors, (steps, 2, buoys, buoys), flat.
        places: lon, lat of each buoy at the begin of a step [binary angle], (steps, buoys, 2), flat.
        numbers: sizes and scales.
        row: of this step in the tables.
        step: number of the step, a key of the noise.
        end: of the step [s].
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
                z, scratch, n, i, states, moves, kicks, 0, seed0, seed1, noise.STREAM_BUOYS_BEGIN,
                key, 0,
            )  # fmt: skip
        # the scratch holds the deviations at the begin of the step
        _move(
            z, scratch, n, i, states, moves, kicks, row, seed0, seed1, noise.STREAM_BUOYS, key, step
        )  # fmt: skip
        which = scenario[i] * numbers.members
        if numbers.members > 1:
            which += member[i]
        mean_at = (row * (shift.shape[0] * numbers.members) + which) * 2 * states * 2
        begins = ti.cast(
            (status[i] == life.PENDING or status[i] == life.UNDER_WAY) and release[i] < end, ti.i32
        )
        apart = 2 * states  # row of the first distance
        _measure(z, scratch, apart, n, i, lon[i], lat[i], buoys, places, row, numbers.ahead)
        _correlate(scratch, apart, n, i, buoys, numbers.current_length)
        bias_state = -1
        if numbers.biased == 1:
            bias_state = (1 + numbers.windy) * buoys
        _share(
            own, shared, z, scratch, means, mean_at, mixes, 2 * row, n, i, numbers, 0,
            numbers.current_keep, CURRENT, OWN_CURRENT, begins, numbers.current_std, bias_state,
        )  # fmt: skip
        shared[WIND * n + i], shared[(WIND + 1) * n + i], shared[OWN_WIND * n + i] = 0.0, 0.0, 1.0
        if numbers.windy == 1:
            _correlate(scratch, apart, n, i, buoys, numbers.wind_length)
            _share(
                own, shared, z, scratch, means, mean_at, mixes, 2 * row + 1, n, i, numbers, buoys,
                numbers.wind_keep, WIND, OWN_WIND, begins, numbers.wind_std, -1,
            )  # fmt: skip


def shared_of(columns: Any, shares: bool) -> Any:
    """Return the array of shared innovations, float32 (6 n,); a placeholder (1,) without buoys."""
    return rows.whole(columns, SHARED) if shares else runtime.empty(1, ti.f32)
