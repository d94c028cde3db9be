"""Random numbers as a function of (seed, stream, slot, step): Philox-4x32-10.

Salmon, Moraes, Dror and Shaw 2011, "Parallel random numbers: as easy as 1, 2, 3",
doi:10.1145/2063384.2063405. There is no state: the same call gives the same bits on any thread, in
any order, in any shard. The integer stream is the same on every backend; normals differ between
backends in the last bits of log, sin and cos.
"""

import copy
import enum

import numpy as np
import taichi as ti

# One stream per use, so that no two uses ever share a number.
STREAM_FELT = 0  # current error of targets under way
STREAM_PRIOR = 1
STREAM_OBJECT = 2
STREAM_ERROR = 3
STREAM_STEP = 4
STREAM_WIND = 5
STREAM_BRIDGE = 6
STREAM_COAST = 7
STREAM_REFLOAT = 8
STREAM_RELEASE = 9
# properties of a steering target that are fixed at birth; the slot is its birth slot
STREAM_BIRTH = 10
STREAM_AIM = 11  # way points, courses and legs drawn under way
STREAM_WAY = 12  # its Brownian bridges
STREAM_MIDWAY = 13  # its Brownian bridges at times within a piece
STREAM_LEVY = 15  # Levy midpoints of its pieces, for sensors
STREAM_TOUCH = 14  # midpoints of its pieces, for touches of a line or area
# particles drawn for a tracker's cloud; negative, as the classes of debris count upwards
STREAM_CLOUD = -1
STREAM_ACT = -2  # acts of these particles
STREAM_BUOYS = -3  # errors that particles share with buoys
STREAM_BUOYS_BEGIN = -4  # and those at the begin of the run
STREAM_TAIL = -5  # scales of the current's errors
STREAM_CHANGE = -6  # waits for changes of state
STREAM_CHANGED = -7  # leeway lines after changes of state
STREAM_DISTRESS = -8  # distress of targets under way by a hazard
STREAM_DEBRIS = 16  # the first of many: each class of debris has its own stream

u32x4 = ti.types.vector(4, ti.u32)
f32x2 = ti.types.vector(2, ti.f32)


@ti.func
def philox(c0: ti.u32, c1: ti.u32, c2: ti.u32, c3: ti.u32, key0: ti.u32, key1: ti.u32) -> u32x4:
    """Return four independent uniform 32-bit words for a counter and a key."""
    x0, x1, x2, x3, k0, k1 = c0, c1, c2, c3, key0, key1
    for _ in ti.static(range(10)):
        a = ti.cast(x0, ti.u64) * ti.u64(0xD2511F53)
        b = ti.cast(x2, ti.u64) * ti.u64(0xCD9E8D57)
        y0 = ti.cast(b >> ti.u64(32), ti.u32) ^ x1 ^ k0
        y2 = ti.cast(a >> ti.u64(32), ti.u32) ^ x3 ^ k1
        x1 = ti.cast(b, ti.u32)
        x3 = ti.cast(a, ti.u32)
        x0, x2 = y0, y2
        k0 += ti.u32(0x9E3779B9)
        k1 += ti.u32(0xBB67AE85)
    return u32x4(x0, x1, x2, x3)


@ti.func
def noise_words(seed0: ti.u32, seed1: ti.u32, stream: ti.i32, slot: ti.i32, step: ti.i32) -> u32x4:
    """Return four words of a stream for one slot and lattice step."""
    return philox(
        ti.cast(slot, ti.u32),
        ti.cast(step, ti.u32),
        ti.cast(stream, ti.u32),
        ti.u32(0),
        seed0,
        seed1,
    )


@ti.func
def further(
    seed0: ti.u32, seed1: ti.u32, stream: ti.i32, slot: ti.i32, step: ti.i32, number: ti.i32
) -> u32x4:
    """Return four words of a stream for one slot and lattice step.

    number: counts from 1 where one use needs several. The words are those of `philox`, whose rounds
    are a loop here, which compiles in a tenth of the time: for numbers that are seldom drawn.
    """
    x0, x1, x2, x3 = (
        ti.cast(slot, ti.u32),
        ti.cast(step, ti.u32),
        ti.cast(stream, ti.u32),
        ti.cast(number, ti.u32),
    )
    k0, k1 = seed0, seed1
    for _ in range(10):
        a = ti.cast(x0, ti.u64) * ti.u64(0xD2511F53)
        b = ti.cast(x2, ti.u64) * ti.u64(0xCD9E8D57)
        y0 = ti.cast(b >> ti.u64(32), ti.u32) ^ x1 ^ k0
        y2 = ti.cast(a >> ti.u64(32), ti.u32) ^ x3 ^ k1
        x1, x3 = ti.cast(b, ti.u32), ti.cast(a, ti.u32)
        x0, x2 = y0, y2
        k0 += ti.u32(0x9E3779B9)
        k1 += ti.u32(0xBB67AE85)
    return u32x4(x0, x1, x2, x3)


@ti.func
def uniform(word: ti.u32) -> ti.f32:
    """Return a uniform number in (0, 1), never 0 or 1: the middle of one of 2**23 intervals."""
    return (ti.cast(word >> ti.u32(9), ti.f32) + 0.5) * (1.0 / 8388608.0)


@ti.func
def normals(a: ti.u32, b: ti.u32) -> f32x2:
    """Return two independent standard normals (Box and Muller 1958).

    Tails end at 5.8 standard deviations.
    """
    return turned(ti.log(uniform(a)), b)


@ti.func
def turned(log: ti.f32, b: ti.u32) -> f32x2:
    """Return `normals` from the logarithm of `uniform(a)`, without a call of a library."""
    r = ti.sqrt(-log)  # sqrt(-2 log u), times the diagonal's sqrt(1/2)
    t = 4.0 * uniform(b)
    quadrant = ti.cast(t, ti.i32)
    # Cosine and sine of the angle from the quadrant's diagonal, at most 45 degrees, come from their
    # series, with an error of 3e-8: without a call of libm they are the same on every backend.
    x = (t - ti.cast(quadrant, ti.f32) - 0.5) * 1.5707963267948966
    y = x * x
    c = 1.0 - y * (1 / 2 - y * (1 / 24 - y * (1 / 720 - y * (1 / 40320))))
    s = x * (1.0 - y * (1 / 6 - y * (1 / 120 - y * (1 / 5040 - y * (1 / 362880)))))
    p, q = c - s, c + s
    if quadrant & 1 == 1:
        p, q = -q, p
    if quadrant & 2 == 2:
        p, q = -p, -q
    return f32x2(r * p, r * q)


class Purpose(enum.IntEnum):
    """Purposes of random numbers; `number` distinguishes several of one purpose."""

    RUN = 0  # particles of a run, in kernels: the seed itself
    WORLDS = 1  # properties shared by the particles of a world
    RENEWAL = 2  # run of a spill in new worlds; number: of the renewal, from 1
    RESAMPLING = 3
    REALISATIONS = 4  # complete spills, drawn from the worlds
    DEBRIS = 5  # coefficients of a class of debris; number: of the class, from 1
    DEBRIS_BRIDGE = 6  # positions of debris within a step
    PLANNING = 7  # run for planning
    OPTIMISER = 8  # number: of the round, from 1
    VERIFICATION = 9  # a run along a drifter; number: of the forecast
    BACKWARD = 10  # particles of a backward run, in the kernels
    BACKWARD_PLACES = 11  # their starts
    BACKWARD_WORLDS = 12
    BACKWARD_PRIOR = 13  # releases from which the prior's map is made
    # class of debris at the coast: walks near it, landings, waits; number: of the class, from 1
    DEBRIS_COAST = 14
    TARGET = 15  # path of a target that acts, for tracking
    PURSUIT = 16  # independent cloud on which a planned path is evaluated
    FILLING = 17  # particles placed where a contact may have been; number: of the contact
    GUIDE = 18  # guidance of particles towards finds


def seed_for(seed: int, purpose: Purpose, number: int = 0) -> int:
    """Return the seed (0 <= seed < 2**64) of a purpose, from that of a case or another purpose.

    The particles of a run use the run's own seed. Any other purpose has a hash of seed, purpose and
    number (0 <= number < 2**32), so that no two of them draw the same numbers, whatever seeds users
    choose: two equal hashes are as likely as two equal random numbers of 64 bits.
    """
    if not 0 <= number < 2**32:
        raise ValueError(f"number of a purpose: {number}; from 0 to 2**32 - 1")
    if purpose == Purpose.RUN:
        return seed
    return _mixed(_mixed(seed) ^ (int(purpose) << 32 | number))


def _mixed(word: int) -> int:
    """Return a word of 64 bits with its bits mixed: one step of SplitMix64.

    Steele et al. 2014, doi:10.1145/2660193.2660195.
    """
    word = (word + 0x9E3779B97F4A7C15) % 2**64
    word = (word ^ word >> 30) * 0xBF58476D1CE4E5B9 % 2**64
    word = (word ^ word >> 27) * 0x94D049BB133111EB % 2**64
    return word ^ word >> 31


def key(seed: int, purpose: Purpose = Purpose.RUN, number: int = 0) -> tuple[int, int]:
    """Return the two 32-bit words of the Philox key of a purpose."""
    own = seed_for(seed, purpose, number)
    return own & 0xFFFFFFFF, own >> 32


def generator(
    seed: int, purpose: Purpose = Purpose.RUN, number: int = 0, event: tuple[int, int] = (0, 0)
) -> np.random.Generator:
    """Return a generator of random numbers on the host for a purpose.

    It is NumPy's Philox-4x64-10, started at the counter (0, 0, *event).
    """
    own = seed_for(seed, purpose, number)
    return np.random.Generator(np.random.Philox(key=own, counter=[0, 0, *event]))


def later(rng: np.random.Generator, count: int) -> np.random.Generator:
    """Return a copy of a generator advanced by `count` calls of `random()`, without drawing all."""
    ahead = copy.deepcopy(rng)
    # a step of its counter gives four numbers
    left = min(4 - ahead.bit_generator.state["buffer_pos"], count)
    ahead.random(left)
    steps, rest = divmod(count - left, 4)
    if steps:
        ahead.bit_generator.advance(steps)
    ahead.random(rest)
    return ahead
