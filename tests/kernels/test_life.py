"""A particle's life within a step, second by second: an oracle that follows each particle through the step in plain Python."""

import numpy as np
import taichi as ti
from scipy import stats

from kernels import life
from kernels.coast import Ints, Reals

RNG = np.random.default_rng(11)
MOMENT, STEP = 40, 13  # [s] begin and length of the step
END = MOMENT + STEP


@ti.kernel
def _ahead(status: Ints, release: Ints, due: Ints, sinks: Ints, elapsed: ti.i32, duration: ti.i32, out: Ints):
    for i in range(status.shape[0]):
        moves, left, finish = life.ahead(status[i], release[i], due[i], sinks[i], elapsed, duration)
        out[3 * i], out[3 * i + 1], out[3 * i + 2] = ti.cast(moves, ti.i32), left, finish


@ti.kernel
def _behind(status: Ints, release: Ints, ended: Ints, afloat: Ints, elapsed: ti.i32, duration: ti.i32, out: Ints):
    for i in range(status.shape[0]):
        times = life.behind(status[i], release[i], ended[i], afloat[i], elapsed, duration)
        for k in ti.static(range(4)):
            out[4 * i + k] = times[k]


@ti.kernel
def _refloats(ended: Ints, uniform: Reals, stay: ti.f32, out: Ints):
    for i in range(ended.shape[0]):
        out[i] = life.refloats(ended[i], uniform[i], stay)


def followed(status: int, release: int, due: int, sinks: int) -> tuple[bool, int, int]:
    """Return (moves, left, finish) as a particle lives it, one second after another."""
    moving = []
    for second in range(MOMENT, END):
        if status == life.PENDING and second >= release:
            status = life.ADRIFT
        if status == life.ASHORE and second >= due and second < sinks:
            status = life.ADRIFT
        if status == life.ADRIFT and second >= sinks:
            status = life.SUNK
            return True, *((moving[0], second) if moving else (second, second))
        if status == life.ADRIFT:
            moving.append(second)
    return bool(moving), moving[0] if moving else 0, END


def test_what_moves_in_a_step_does_so_from_its_release_to_its_end() -> None:
    """All states; releases, ends of waits and sinkings before, in and after the step, and at its very begin and end."""
    n = 4000
    status = RNG.integers(0, 6, n).astype(np.int32)
    times = RNG.integers(MOMENT - 9, END + 9, (3, n)).astype(np.int32)
    times[:, ::5] = RNG.choice([MOMENT, END, END - 1, life.NEVER], times[:, ::5].shape)
    release, due, sinks = times
    release = np.where(status == life.PENDING, release, np.minimum(release, MOMENT)).astype(np.int32)
    out = np.zeros(3 * n, np.int32)
    _ahead(status, release, due, sinks, MOMENT, STEP, out)
    for own, got in zip(zip(status, release, due, sinks, strict=True), out.reshape(-1, 3), strict=True):
        moves, left, finish = followed(*(int(x) for x in own))
        assert got[0] == moves, own
        if moves:
            assert tuple(got[1:]) == (left, finish), own
    assert 0 < (out[::3] == 1).sum() < n


def test_what_has_moved_was_seen_from_its_release_to_its_end() -> None:
    """Of each second of the step: was it there, and did it move? Ashore it is still there, elsewhere it has gone."""
    n = 4000
    status = RNG.choice([life.ADRIFT, life.ASHORE, life.OUTSIDE, life.LEFT, life.SUNK], n).astype(np.int32)
    release, ended, afloat = RNG.integers(MOMENT - 9, END, (3, n)).astype(np.int32)
    ended = np.maximum(ended, release)  # it ends after it began
    out = np.zeros(4 * n, np.int32)
    _behind(status, release, ended, afloat, MOMENT, STEP, out)
    for own, got in zip(zip(status, release, ended, afloat, strict=True), out.reshape(-1, 4), strict=True):
        state, begun, over, since = (int(x) for x in own)
        stop = END if state == life.ADRIFT else over
        waits = since if since < min(stop, END) else begun  # a beach that it has left before it ended again
        there = [s for s in range(MOMENT, END) if s >= begun and (state in (life.ADRIFT, life.ASHORE) or s < over)]
        moved = [s for s in range(MOMENT, END) if s >= max(begun, waits) and s < stop]
        seen, left, finish, gone = (int(x) for x in got)
        assert list(range(seen, gone)) == there
        assert list(range(left, finish)) == moved


def test_a_wait_on_the_beach_is_exponential() -> None:
    """Of a number u it is -ln(u) times its mean, in float64, but for seconds that are cut off and 24 bits; it never overflows."""
    n, stay = 20_000, 31_000.0
    uniform = ((RNG.integers(0, 2**23, n) + 0.5) / 2**23).astype(np.float32)
    ended = RNG.integers(0, 900_000, n).astype(np.int32)
    due = np.zeros(n, np.int32)
    _refloats(ended, uniform, stay, due)
    exact = -np.log(uniform.astype(float)) * stay
    assert np.abs(due - ended - exact).max() <= 1 + exact.max() * 4 * 2.0**-24
    assert stats.kstest(due - ended + 0.5, stats.expon(scale=stay).cdf).statistic < 1.95 / np.sqrt(n) + 0.5 / stay
    late = np.full(n, 1_900_000_000, np.int32)
    _refloats(late, uniform, 1e30, due)
    assert (due >= late).all()
