"""A particle's life within a step, second by second: an oracle that follows each particle through
the step in plain Python.
"""

import numpy as np
import taichi as ti
from scipy import stats

from kernels.runtime import launch
from kernels.step import life
from kernels.step.coast import Ints, Reals

RNG = np.random.default_rng(11)
MOMENT, STEP = 40, 13  # [s] begin and length of the step
END = MOMENT + STEP


@ti.kernel
def _ahead(
    status: Ints,
    release: Ints,
    due: Ints,
    sinks: Ints,
    elapsed: ti.i32,
    duration: ti.i32,
    out: Ints,
):
    for i in range(status.shape[0]):
        moves, left, finish = life.ahead(status[i], release[i], due[i], sinks[i], elapsed, duration)
        out[3 * i], out[3 * i + 1], out[3 * i + 2] = ti.cast(moves, ti.i32), left, finish


@ti.kernel
def _behind(
    status: Ints,
    release: Ints,
    ended: Ints,
    afloat: Ints,
    elapsed: ti.i32,
    duration: ti.i32,
    out: Ints,
):
    for i in range(status.shape[0]):
        times = life.behind(status[i], release[i], ended[i], afloat[i], elapsed, duration)
        for k in ti.static(range(4)):
            out[4 * i + k] = times[k]


@ti.kernel
def _refloats(ended: Ints, uniform: Reals, stay: ti.f32, out: Ints):
    for i in range(ended.shape[0]):
        out[i] = life.refloats(ended[i], uniform[i], stay)


Ends = ti.types.argpack(**dict.fromkeys(("lon", "lat", "status", "status_since", "edge"), Ints))
Ways = ti.types.argpack(
    **dict.fromkeys(("met", "number", "known", "east", "north", "left", "finish"), Ints), part=Reals
)
Corner = ti.types.struct(west=ti.i32, south=ti.i32, width=ti.u32, height=ti.u32)


@ti.kernel
def _ending(core: Ends, ways: Ways, box: Corner, over: ti.i32):
    for i in range(ways.met.shape[0]):
        life.ending(
            core, box, i, ways.met[i], ways.number[i], ways.part[i], ways.known[i] == 1, ways.east[i], ways.north[i],
            ways.left[i], ways.finish[i], over,
        )  # fmt: skip


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
    """All states; releases, ends of waits and sinkings before, in and after the step, and at its
    very begin and end.
    """
    n = 4000
    status = RNG.integers(0, 6, n).astype(np.int32)
    times = RNG.integers(MOMENT - 9, END + 9, (3, n)).astype(np.int32)
    times[:, ::5] = RNG.choice([MOMENT, END, END - 1, life.NEVER], times[:, ::5].shape)
    release, due, sinks = times
    release = np.where(status == life.PENDING, release, np.minimum(release, MOMENT)).astype(
        np.int32
    )
    out = np.zeros(3 * n, np.int32)
    _ahead(status, release, due, sinks, MOMENT, STEP, out)
    for own, got in zip(
        zip(status, release, due, sinks, strict=True), out.reshape(-1, 3), strict=True
    ):
        moves, left, finish = followed(*(int(x) for x in own))
        assert got[0] == moves, own
        if moves:
            assert tuple(got[1:]) == (left, finish), own
    assert 0 < (out[::3] == 1).sum() < n


def test_a_step_ends_on_the_shore_or_where_nothing_is_known_or_outside_or_under_water_or_adrift() -> (
    None
):
    """In this order, against plain integers: a box over the antimeridian, with places on its very
    edges and just beyond.
    """
    n, west, south, width, height = 4000, 2**31 - 40, -7, 90, 25
    box = {"west": west, "south": south, "width": width, "height": height}
    met, known = RNG.integers(0, 2, (2, n)).astype(np.int32)
    met[: n // 2] = 0
    # from the box's corner
    east, north = RNG.integers(-3, width + 4, n), RNG.integers(-3, height + 4, n)
    lon, lat = (
        ((east + west + 2**31) % 2**32 - 2**31).astype(np.int32),
        (north + south).astype(np.int32),
    )
    left, finish = np.sort(RNG.integers(MOMENT, END + 1, (2, n)), axis=0).astype(np.int32)
    finish[::3] = END
    number, part = RNG.integers(0, 99, n).astype(np.int32), RNG.random(n).astype(np.float32)
    before = np.full((5, n), -9, np.int32)
    after = before.copy()
    core = launch.pack(Ends, *(own := [ti.ndarray(ti.i32, n) for _ in range(5)]))
    for array, values in zip(own, before, strict=True):
        array.from_numpy(values)
    given = met, number, known, lon, lat, left, finish, part
    ways = [ti.ndarray(ti.f32 if values.dtype == np.float32 else ti.i32, n) for values in given]
    for array, values in zip(ways, given, strict=True):
        array.from_numpy(values)
    _ending(core, launch.pack(Ways, *ways), Corner(**box), END)
    for k in range(n):
        inside = 0 <= east[k] <= width and 0 <= north[k] <= height
        if met[k]:
            shore = left[k] + int(part[k] * np.float32(finish[k] - left[k]))
            after[:, k] = lon[k], lat[k], life.ASHORE, shore, number[k]
        elif not known[k]:
            after[2:4, k] = life.OUTSIDE, left[k]
        elif not inside:
            after[:4, k] = lon[k], lat[k], life.LEFT, END
        elif finish[k] < END:
            after[:4, k] = lon[k], lat[k], life.SUNK, finish[k]
        else:
            after[:3, k] = lon[k], lat[k], life.ADRIFT
    assert np.array_equal([array.to_numpy() for array in own], after)
    assert set(after[2]) == {life.ADRIFT, life.ASHORE, life.OUTSIDE, life.LEFT, life.SUNK}


def test_what_has_moved_was_seen_from_its_release_to_its_end() -> None:
    """Of each second of a part of a step: was it there, and did it move, once it had left a beach?
    Ashore it is still there.
    """
    n = 4000
    status = RNG.choice([life.ADRIFT, life.ASHORE, life.OUTSIDE, life.LEFT, life.SUNK], n).astype(
        np.int32
    )
    release, ended, afloat = RNG.integers(MOMENT - 9, END, (3, n)).astype(np.int32)
    ended = np.maximum(ended, release)  # it ends after it began
    out = np.zeros(4 * n, np.int32)
    _behind(status, release, ended, afloat, MOMENT, STEP, out)
    for own, got in zip(
        zip(status, release, ended, afloat, strict=True), out.reshape(-1, 4), strict=True
    ):
        state, begun, over, since = (int(x) for x in own)
        stop = END if state == life.ADRIFT else over
        there = [
            s
            for s in range(MOMENT, END)
            if s >= begun and (state in (life.ADRIFT, life.ASHORE) or s < over)
        ]
        moved = [s for s in range(MOMENT, END) if s >= max(begun, since) and s < stop]
        seen, left, finish, gone = (int(x) for x in got)
        assert list(range(seen, gone)) == there
        assert list(range(left, finish)) == moved


def test_a_wait_on_the_beach_is_exponential() -> None:
    """Of a number u it is -ln(u) times its mean, in float64, but for seconds that are cut off and
    24 bits; it never overflows.
    """
    n, stay = 20_000, 31_000.0
    uniform = ((RNG.integers(0, 2**23, n) + 0.5) / 2**23).astype(np.float32)
    ended = RNG.integers(0, 900_000, n).astype(np.int32)
    due = np.zeros(n, np.int32)
    _refloats(ended, uniform, stay, due)
    exact = -np.log(uniform.astype(float)) * stay
    assert np.abs(due - ended - exact).max() <= 1 + exact.max() * 4 * 2.0**-24
    assert (
        stats.kstest(due - ended + 0.5, stats.expon(scale=stay).cdf).statistic
        < 1.95 / np.sqrt(n) + 0.5 / stay
    )
    late = np.full(n, 1_900_000_000, np.int32)
    _refloats(late, uniform, 1e30, due)
    assert (due >= late).all()
