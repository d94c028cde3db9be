"""Launches of kernels with every kind of argument, held against NumPy, and what they leave behind."""

import gc
import weakref

import numpy as np
import pytest
import taichi as ti

from kernels.runtime import launch, runtime, taichi_way

Reals = ti.types.ndarray(dtype=ti.f32, ndim=1)
Pairs = ti.types.ndarray(dtype=ti.types.vector(2, ti.f32), ndim=1)
Packed = ti.types.argpack(packed_one=Reals, packed_other=Reals)
inside = pytest.mark.skipif(not taichi_way.inside, reason="of Taichi 1.7.4 by its insides")


@ti.kernel
def _mixed(
    doubles: ti.template(),
    column: Reals,
    share: ti.f32,
    host: Reals,
    pack: Packed,
    shift: ti.f32,
    n: ti.i32,
    word: ti.u32,
):
    for i in range(n):
        found = share * host[i] + pack.packed_one[i] - pack.packed_other[i] * shift
        if ti.static(doubles):
            found *= 2.0
        column[i] = found + ti.cast(word >> ti.u32(31), ti.f32)


@ti.kernel
def _seconds(column: Reals, pairs: Pairs):
    for i in range(column.shape[0]):
        column[i] = pairs[i][1]


@ti.kernel
def _packed(column: Reals, pack: Packed, host: Reals, share: ti.f32):
    for i in range(column.shape[0]):
        column[i] = share * pack.packed_one[i] + pack.packed_other[i] + host[i]


@ti.kernel
def _sum(values: Reals) -> ti.f32:
    total = 0.0
    for i in range(values.shape[0]):
        total += values[i]
    return total


def arguments(n: int) -> tuple[list[np.ndarray], list[ti.Ndarray]]:
    rng = np.random.default_rng(4)
    hosts = [rng.normal(size=n).astype(np.float32) for _ in range(3)]
    return hosts, [runtime.upload(own) for own in hosts[1:]]


@pytest.mark.parametrize("doubles", [False, True])
@pytest.mark.parametrize("number", [float, np.float32, np.float64])
def test_every_kind_of_argument_in_its_place(doubles: bool, number: type) -> None:
    """Sums of four terms of order one in float32: 8 roundings of 6e-8 on at most 10."""
    runtime.start()
    n = 37
    (host, one, other), columns = arguments(n)
    column, pack = runtime.empty(n), launch.pack(Packed, *columns)
    share, shift = 0.25 + 1 / 128, -0.75
    _mixed(doubles, column, number(share), host, pack, shift, np.int64(n), 2**31 + 5)
    factor = 2 if doubles else 1
    expected = factor * (share * host + one - other * shift) + 1
    np.testing.assert_allclose(column.to_numpy(), expected, atol=8 * 6e-8 * 10)


def test_what_is_left_to_taichi() -> None:
    """A result, an array in Fortran's order, one of vectors on the host."""
    runtime.start()
    pairs, column = np.arange(14, dtype=np.float32).reshape(7, 2), runtime.empty(7)
    _seconds(column, pairs)
    assert column.to_numpy().tolist() == [1, 3, 5, 7, 9, 11, 13]
    host = np.asfortranarray(np.arange(1, 8, dtype=np.float32))
    assert _sum(host) == _sum(runtime.upload(host)) == 28.0


@pytest.mark.parametrize(
    "wrong",
    [{"n": 3.0}, {"share": "a half"}, {"host": np.zeros(8, np.float32)[::2]}],
    ids=["a number with a fraction", "a word", "every other value"],
)
def test_what_taichi_does_not_take_is_refused(wrong: dict) -> None:
    """Neither cut to a whole number nor read beside the array."""
    runtime.start()
    (host, *_), columns = arguments(4)
    given = {"share": 0.5, "host": host, "n": 4} | wrong
    pack = launch.pack(Packed, *columns)
    with pytest.raises((ti.TaichiRuntimeTypeError, ti.TaichiTypeError, ValueError)):
        _mixed(
            False,
            runtime.empty(4),
            given["share"],
            given["host"],
            pack,
            -1,
            given["n"],
            1,
        )


@inside
def test_a_launch_keeps_nothing() -> None:
    """Without Python's search for cycles, columns of a pack are free as soon as they are dropped.

    Not so at the first launch, which compiles.
    """
    runtime.start()
    target, host = runtime.empty(5), np.zeros(5, np.float32)
    left: list[weakref.ref] = []
    gc.collect()
    gc.disable()
    try:
        for _ in range(2):
            _, columns = arguments(5)
            _packed(target, launch.pack(Packed, *columns), host, 0.5)
            left = [weakref.ref(own) for own in columns]
            del columns
        assert [own() for own in left] == [None, None]
    finally:
        gc.enable()
