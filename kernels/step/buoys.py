"""Errors of current and wind that particles share with drifting buoys whose tracks are known.

The errors at the buoys are Ornstein-Uhlenbeck processes (drift.engine.motion.errors.buoy_errors). Given the
tracks they have a mean, the same for all particles, and a deviation from it, which each particle
draws for itself: a linear Gaussian process that is advanced once a step. What a particle shares with
the buoys are their innovations: the normals of its own error in a step are correlated with theirs,
by its distance from each buoy. So a particle's error alone is exactly the case's process, however
far it moves from a buoy, and a buoy that shows nothing changes nothing.
"""

from typing import Any

import taichi as ti

from kernels.maths import noise, sphere
from kernels.runtime import bundle, rows, runtime
from kernels.step import life
from kernels.step.coast import Ints, Reals

# Columns in the rows of one array: for this step's normals of the errors of current and wind, the
# part that is given by the buoys, and the factor of what a particle draws itself.
SHARED = (
    *("shared_current_east", "shared_current_north", "shared_wind_east", "shared_wind_north"),
    *("own_share_current", "own_share_wind"),
)
OWN_CURRENT = 4  # row of the current's factor; the wind's is the next
BIAS = 4  # row of the bias in kernels.step.errors.ROWS


# The arguments of the kernel in groups. Columns of particles:
Particles = ti.types.argpack(
    scenario=Ints,
    world=Ints,
    member=Ints,  # of the forcing ensemble; (1,) without one
    status=Ints,
    release=Ints,  # when each begins to drift [s]
    lon=Ints,  # position at the begin of the step [binary angle]
    lat=Ints,
    # rows kernels.step.errors.ROWS, updated where a particle begins to drift
    error_rows=Reals,
    # updated: deviations, rows (state, component), then the distances from the buoys at the begin
    # of the step before [m], (2 states + buoys) rows
    buoy_rows=Reals,
    shared_rows=Reals,  # written: rows SHARED
)
# Tables by step, flat. Row 0 holds the first draw, before the first step.
Tables = ti.types.argpack(
    moves=Reals,  # transition of the deviations, (steps + 1, states, states)
    kicks=Reals,  # lower triangular root of the covariance of what is added, as `moves`
    # number of the normals of each state, -1 where its column of `kicks` is 0, (steps + 1, states)
    order=Ints,
    # mean of the states at begin and end of a step, by scenario and member,
    # (steps + 1, scenarios members, 2, states, 2)
    means=Reals,
    # inverses of the Cholesky factors of the correlations between buoys in the middle of a step, of
    # the current's and of the wind's errors, (steps + 1, 2, buoys, buoys)
    mixes=Reals,
    # lon, lat of each buoy at the begin of a step [binary angle], (steps + 1, buoys, 2)
    places=Ints,
)
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


def _registers(buoys: int, states: int) -> Any:
    """Return the structure of what a bundle of particles holds in a step, for that many buoys and
    states of each component.
    """
    reals = {
        "z": 2 * states,  # deviations at the step's end, rows (state, component)
        "old": 2 * states,  # and at its begin
        "log": 1,
        "normal": 2,
        "apart": buoys,  # distances in the middle of the step [m]
        "near": buoys,  # correlation of a particle's error with that of each buoy
        "weight": buoys,  # of the buoys' standard processes in a particle's error
        "own": 1,  # factor of what is independent of the buoys
        "shared": 2,
        "first": 2,
    }
    return bundle.held(reals=reals, ints={"key": 1, "mean": 1, "begins": 1}, words={"word": 4})


@ti.func
def _move(
    width: ti.template(),
    held: ti.template(),
    states: ti.i32,
    tables: ti.template(),
    row: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
    stream: ti.i32,
    step: ti.i32,
):
    """Advance the deviations of a bundle: z = moves old + kicks normals, where old is z before."""
    for k in range(2 * states):
        for j in range(width):
            held.old[k, j] = held.z[k, j]
            held.z[k, j] = 0.0
    for source in range(states):
        for k in range(states):
            move = tables.moves[(row * states + k) * states + source]
            for j in range(width):
                held.z[2 * k, j] += move * held.old[2 * source, j]
                held.z[2 * k + 1, j] += move * held.old[2 * source + 1, j]
        number = tables.order[row * states + source]
        if number >= 0:
            if number & 1 == 0:  # four words are two pairs of normals
                for j in range(width):
                    w = noise.philox(
                        ti.cast(held.key[0, j], ti.u32),
                        ti.cast(step, ti.u32),
                        ti.cast(stream, ti.u32),
                        ti.cast(1 + (number >> 1), ti.u32),
                        seed0,
                        seed1,
                    )
                    for m in ti.static(range(4)):
                        held.word[m, j] = w[m]
            first = 2 * (number & 1)
            for j in range(width):
                held.log[0, j] = ti.log(noise.uniform(held.word[first, j]))
            for j in range(width):
                pair = noise.turned(held.log[0, j], held.word[first + 1, j])
                held.normal[0, j], held.normal[1, j] = pair[0], pair[1]
            for k in range(source, states):
                kick = tables.kicks[(row * states + k) * states + source]
                for j in range(width):
                    held.z[2 * k, j] += kick * held.normal[0, j]
                    held.z[2 * k + 1, j] += kick * held.normal[1, j]


@ti.func
def _weigh(
    width: ti.template(),
    held: ti.template(),
    buoys: ti.i32,
    length: ti.f32,
    tables: ti.template(),
    at: ti.i32,
):
    """Write `weight`: the inverse of the buoys' Cholesky factor, row `at` of the tables, times the
    correlations with the buoys; and `own`.
    """
    for b in range(buoys):
        for j in range(width):
            share = held.apart[b, j] / length
            # drift.engine.motion.errors.buoy_errors.POWER
            held.near[b, j] = ti.exp(-share * ti.sqrt(share))
    for j in range(width):
        held.own[0, j] = 1.0
    for k in range(buoys):
        for j in range(width):
            held.weight[k, j] = 0.0
        for b in range(k + 1):
            mix = tables.mixes[(at * buoys + k) * buoys + b]
            for j in range(width):
                held.weight[k, j] += mix * held.near[b, j]
        for j in range(width):
            held.own[0, j] -= held.weight[k, j] * held.weight[k, j]
    for j in range(width):
        held.own[0, j] = ti.sqrt(ti.max(held.own[0, j], 0.0))


@ti.func
def _innovate(
    width: ti.template(),
    held: ti.template(),
    numbers: Numbers,
    state: ti.i32,
    keep: ti.f32,
    tables: ti.template(),
    at: ti.i32,
):
    """Write `shared`: what a bundle shares of the innovations of one quantity's errors.

    state: the first of the quantity's; keep: its autocorrelation over the step.
    """
    scale = 1.0 / ti.sqrt(1.0 - keep * keep)
    end = 2 * numbers.states  # from a mean at the step's begin to that at its end
    for j in range(width):
        held.shared[0, j], held.shared[1, j] = 0.0, 0.0
    for k in range(numbers.buoys):
        for b in range(k + 1):
            mix = scale * tables.mixes[(at * numbers.buoys + k) * numbers.buoys + b]
            for c in ti.static(range(2)):
                of = 2 * (state + b) + c
                for j in range(width):
                    mean = held.mean[0, j] + of
                    before = tables.means[mean] + held.old[of, j]
                    after = tables.means[mean + end] + held.z[of, j]
                    held.shared[c, j] += mix * held.weight[k, j] * (after - keep * before)


@ti.func
def _begin(
    held: ti.template(),
    j: ti.i32,
    numbers: Numbers,
    state: ti.i32,
    std: ti.f32,
    tables: ti.template(),
    at: ti.i32,
    particles: ti.template(),
    place: ti.i32,
    n: ti.i32,
):
    """Correlate a first error of particle j of a bundle, which begins to drift, with the buoys'.

    state: the first of the error's; place: of its east component in its columns of errors, n
    each.
    """
    held.first[0, j], held.first[1, j] = 0.0, 0.0
    for k in range(numbers.buoys):
        for b in range(k + 1):
            mix = tables.mixes[(at * numbers.buoys + k) * numbers.buoys + b]
            for c in ti.static(range(2)):
                of = 2 * (state + b) + c
                value = tables.means[held.mean[0, j] + of] + held.old[of, j]
                held.first[c, j] += mix * held.weight[k, j] * value
    for c in ti.static(range(2)):
        there = place + c * n
        old = particles.error_rows[there]
        particles.error_rows[there] = std * held.first[c, j] + held.own[0, j] * old


@ti.kernel
def _share_errors(
    width: ti.template(),
    held_of: ti.template(),
    count: ti.i32,
    shift: Ints,
    particles: Particles,
    tables: Tables,
    numbers: Numbers,
    row: ti.i32,
    step: ti.i32,
    end: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
):
    for block in range((count + width - 1) // width):
        begin, many = block * width, ti.min(width, count - block * width)
        n, states, buoys = particles.lon.shape[0], numbers.states, numbers.buoys
        held = held_of()
        for j in range(many):
            i = begin + j
            held.key[0, j] = i + shift[particles.scenario[i]]
            if numbers.worlds == 1:
                held.key[0, j] = particles.world[i]
            which = particles.scenario[i] * numbers.members
            if numbers.members > 1:
                which += particles.member[i]
            held.mean[0, j] = (row * shift.shape[0] * numbers.members + which) * 4 * states
            waits = particles.status[i] == life.PENDING or particles.status[i] == life.UNDER_WAY
            held.begins[0, j] = ti.cast(waits and particles.release[i] < end, ti.i32)
        for k in range(2 * states):
            for j in range(many):
                held.z[k, j] = particles.buoy_rows[k * n + begin + j]
        if numbers.begins == 1:
            first = noise.STREAM_BUOYS_BEGIN
            _move(width, held, states, tables, 0, seed0, seed1, first, 0)
        _move(width, held, states, tables, row, seed0, seed1, noise.STREAM_BUOYS, step)
        for k in range(2 * states):
            for j in range(many):
                particles.buoy_rows[k * n + begin + j] = held.z[k, j]
        # The distance in the middle of the step is extrapolated from those at the begins of this
        # step and of the one before; the error is of second order in the step.
        for b in range(buoys):
            at = 2 * (row * buoys + b)
            x, y = tables.places[at], tables.places[at + 1]
            for j in range(many):
                i = begin + j
                apart = sphere.offset_near(particles.lon[i], particles.lat[i], x, y).norm()
                place = (2 * states + b) * n + i
                last = particles.buoy_rows[place]
                held.apart[b, j] = ti.max(apart + numbers.ahead * (apart - last), 0.0)
                particles.buoy_rows[place] = apart
        for kind in ti.static(range(2)):  # errors of the current, of the wind
            if kind == 0 or numbers.windy == 1:
                of, at = ti.static(2 * kind), 2 * row + kind
                state, length, keep, std = (
                    (0, numbers.current_length, numbers.current_keep, numbers.current_std)
                    if ti.static(kind == 0)
                    else (buoys, numbers.wind_length, numbers.wind_keep, numbers.wind_std)
                )
                _weigh(width, held, buoys, length, tables, at)
                _innovate(width, held, numbers, state, keep, tables, at)
                for j in range(many):
                    i = begin + j
                    particles.shared_rows[of * n + i] = held.shared[0, j]
                    particles.shared_rows[(of + 1) * n + i] = held.shared[1, j]
                    particles.shared_rows[(OWN_CURRENT + kind) * n + i] = held.own[0, j]
                    if held.begins[0, j] == 1:
                        place = of * n + i
                        _begin(held, j, numbers, state, std, tables, at, particles, place, n)
                        if kind == 0 and numbers.biased == 1:
                            bias, there = (1 + numbers.windy) * buoys, BIAS * n + i
                            std_bias = numbers.bias_std
                            _begin(
                                held, j, numbers, bias, std_bias, tables, at, particles, there, n
                            )


def share_errors(
    count: int,
    shift: Any,
    particles: Any,
    tables: Any,
    numbers: Any,
    row: int,
    step: int,
    end: int,
    key: tuple[int, int],
) -> None:
    """Advance the deviations of particles over a step, and write their shared innovations.

    Args:
        count: of particles.
        shift: by scenario, from a slot to its number in the whole run, the key of its noise.
        particles: a pack of `Particles`.
        tables: a pack of `Tables`.
        numbers: a structure of `Numbers`.
        row: of this step in the tables.
        step: number of the step, a key of the noise.
        end: of the step [s].
        key: of the run.
    """
    held_of = _registers(numbers.buoys, numbers.states)
    width = bundle.width()
    _share_errors(width, held_of, count, shift, particles, tables, numbers, row, step, end, *key)


def shared_of(columns: Any, shares: bool) -> Any:
    """Return the array of shared innovations, float32 (6 n,); a placeholder (1,) without buoys."""
    return rows.whole(columns, SHARED) if shares else runtime.empty(1, ti.f32)
