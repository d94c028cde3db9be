"""Random numbers: published known answers, moments, no state."""

import numpy as np
import pytest
import taichi as ti
from scipy import stats

from kernels.maths import noise
from kernels.maths.noise import Purpose
from kernels.runtime import runtime

# Random123 1.14.0, tests/kat_vectors, philox4x32 10 rounds: counter, key, answer.
KNOWN = [
    (
        "00000000 00000000 00000000 00000000",
        "00000000 00000000",
        "6627e8d5 e169c58d bc57ac4c 9b00dbd8",
    ),
    (
        "ffffffff ffffffff ffffffff ffffffff",
        "ffffffff ffffffff",
        "408f276d 41c83b0e a20bc7c6 6d5451fd",
    ),
    (
        "243f6a88 85a308d3 13198a2e 03707344",
        "a4093822 299f31d0",
        "d16cfe09 94fdcceb 5001e420 24126ea1",
    ),
]
U32 = ti.types.ndarray(dtype=ti.u32, ndim=1)


@ti.kernel
def _philox(counter: U32, key: U32, out: U32):
    for _ in range(1):
        w = noise.philox(counter[0], counter[1], counter[2], counter[3], key[0], key[1])
        for j in ti.static(range(4)):
            out[j] = w[j]


@ti.kernel
def _draw(
    seed0: ti.u32,
    seed1: ti.u32,
    stream: ti.i32,
    step: ti.i32,
    first: ti.i32,
    out: ti.types.ndarray(ti.f32, ndim=2),
):
    for i in range(out.shape[0]):
        w = noise.noise_words(seed0, seed1, stream, first + i, step)
        a, b = noise.normals(w[0], w[1]), noise.normals(w[2], w[3])
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = a[0], a[1], b[0], b[1]
        out[i, 4] = noise.uniform(w[0])


@ti.kernel
def _pairs(seed0: ti.u32, seed1: ti.u32, out: ti.types.ndarray(ti.f32, ndim=2)):
    for i in range(out.shape[0]):
        w = noise.noise_words(seed0, seed1, 1, i, 0)
        n = noise.normals(w[0], w[1])
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = (
            noise.uniform(w[0]),
            noise.uniform(w[1]),
            n[0],
            n[1],
        )


def draw(n: int, seed: int = 1, stream: int = 4, step: int = 0, first: int = 0) -> np.ndarray:
    out = np.zeros((n, 5), np.float32)
    _draw(*noise.key(seed), stream, step, first, out)
    return out


@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN)
def test_philox_gives_the_published_answers(counter: str, key: str, answer: str) -> None:
    words = [np.array([int(x, 16) for x in text.split()], np.uint32) for text in (counter, key)]
    out = np.zeros(4, np.uint32)
    _philox(*words, out)
    assert " ".join(f"{x:08x}" for x in out) == answer


def test_normals_and_uniforms_have_their_moments() -> None:
    n = 400_000
    x = draw(n).astype(np.float64)
    normal = x[:, :4]
    assert np.abs(normal.mean(0)).max() < 4.5 / np.sqrt(n)
    assert np.abs(normal.var(0) - 1).max() < 4.5 * np.sqrt(2 / n)
    assert np.abs((normal**4).mean(0) - 3).max() < 4.5 * np.sqrt(96 / n)
    assert np.abs(np.corrcoef(normal.T) - np.eye(4)).max() < 4.5 / np.sqrt(n)
    assert stats.kstest(normal[:, 1], "norm").pvalue > 1e-4
    assert stats.kstest(x[:, 4], "uniform").pvalue > 1e-4
    assert 0 < x[:, 4].min() < x[:, 4].max() < 1


@pytest.mark.parametrize(
    "other", [{"seed": 2}, {"seed": 1 + 2**40}, {"stream": 5}, {"step": 1}, {"step": -1}]
)
def test_seeds_streams_and_steps_are_independent(other: dict[str, int]) -> None:
    n = 100_000
    a, b = draw(n)[:, 0], draw(n, **other)[:, 0]
    assert abs(np.corrcoef(a, b)[0, 1]) < 4.5 / np.sqrt(n)


def test_every_use_has_a_stream_of_its_own() -> None:
    """Two uses of one stream would draw the same numbers; classes of debris count on from the last
    one.
    """
    streams = {name: number for name, number in vars(noise).items() if name.startswith("STREAM_")}
    assert len(set(streams.values())) == len(streams) > 8
    assert max(streams, key=lambda name: streams[name]) == "STREAM_DEBRIS"


def test_seeds_of_purposes_are_hashes_by_splitmix64() -> None:
    """Its first numbers from the state 0, as Vigna's splitmix64.c (public domain) and
    java.util.SplittableRandom(0) give them.
    """
    golden = 0x9E3779B97F4A7C15
    known = [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F]
    assert [noise._mixed(k * golden % 2**64) for k in range(3)] == known


def test_no_two_purposes_share_a_seed() -> None:
    """Cases are often numbered 1, 2, 3, and so are forecasts, rounds, classes and renewals."""
    seeds = [*range(40), 2**63 - 1, 2**40, 2**41, 2**56]
    own = {
        (seed, purpose, number): noise.seed_for(seed, purpose, number)
        for seed in seeds
        for purpose in Purpose
        for number in (range(12) if purpose is not Purpose.RUN else (0,))
    }
    assert len(set(own.values())) == len(own)
    assert all(noise.seed_for(seed, Purpose.RUN) == seed for seed in seeds)
    assert all(0 <= value < 2**64 for value in own.values())
    renewed = noise.seed_for(
        7, Purpose.RENEWAL, 1
    )  # of a seed of another purpose: its worlds are not those of the case
    assert noise.seed_for(renewed, Purpose.WORLDS) != noise.seed_for(7, Purpose.WORLDS)


def test_normals_are_box_and_muller_of_their_uniforms() -> None:
    """Against NumPy in float64: r = sqrt(-2 log u), angle 2 pi v; within 6e-7 of r, all quadrants."""
    n = 100_000
    out = np.zeros((n, 4), np.float32)
    _pairs(*noise.key(9), out)
    u, v, a, b = out.astype(np.float64).T
    r = np.sqrt(-2 * np.log(u))
    assert np.abs(a - r * np.cos(2 * np.pi * v)).max() < 6e-7 * r.max()
    assert np.abs(b - r * np.sin(2 * np.pi * v)).max() < 6e-7 * r.max()


def test_a_shard_draws_what_the_whole_draws() -> None:
    whole = draw(1000)
    assert (draw(300, first=700) == whole[700:]).all()


def test_a_new_seed_compiles_nothing() -> None:
    draw(10, seed=3)
    before = len(_draw._primal.compiled_kernels)
    draw(10, seed=2**63 + 5, step=7)
    assert len(_draw._primal.compiled_kernels) == before
    assert runtime.backend() == "cpu"


@pytest.mark.parametrize("drawn", range(6))
@pytest.mark.parametrize("count", [0, 1, 2, 3, 4, 5, 11, 4001])
def test_numbers_that_are_passed_over_are_those_that_are_drawn(drawn: int, count: int) -> None:
    rng = noise.generator(7, Purpose.REALISATIONS)
    rng.random(drawn)
    ahead = noise.later(rng, count)
    rng.random(count)
    assert ahead.random(9).tolist() == rng.random(9).tolist()
