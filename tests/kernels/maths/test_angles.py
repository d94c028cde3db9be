"""The program's own functions of angles against NumPy's in float64."""

from collections.abc import Callable

import numpy as np
import pytest
import taichi as ti

from kernels.maths import angles, doubles
from kernels.runtime import runtime

F32 = ti.types.ndarray(dtype=ti.f32, ndim=1)
F64 = ti.types.ndarray(dtype=ti.f64, ndim=1)
EPSILON = {np.float32: 2.0**-24, np.float64: 2.0**-53}  # half a unit in the last place of 1


@ti.kernel
def reals(own: ti.template(), x: F32, out: F32):
    for i in range(x.shape[0]):
        out[i] = own(x[i])


@ti.kernel
def reals2(own: ti.template(), y: F32, x: F32, out: F32):
    for i in range(x.shape[0]):
        out[i] = own(y[i], x[i])


@ti.kernel
def double(own: ti.template(), x: F64, out: F64):
    for i in range(x.shape[0]):
        out[i] = own(x[i])


@ti.kernel
def double2(own: ti.template(), y: F64, x: F64, out: F64):
    for i in range(x.shape[0]):
        out[i] = own(y[i], x[i])


def of(function: Callable, *values: np.ndarray) -> np.ndarray:
    """Return a function's values, in the type of its arguments."""
    runtime.start()
    kernels = {
        (np.float32, 1): reals,
        (np.float32, 2): reals2,
        (np.float64, 1): double,
        (np.float64, 2): double2,
    }
    out = np.zeros_like(values[0])
    kernels[values[0].dtype.type, len(values)](function, *values, out)
    return out


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_sine_and_cosine(kind: type) -> None:
    """Twelve turns, every quarter's end, and 0: within three roundings of 1."""
    module = angles if kind is np.float32 else doubles
    x = np.concatenate(
        [np.linspace(-75, 77, 100_001), np.arange(-40, 41) * np.pi / 2, [0, 1e-6, -1e-12]]
    ).astype(kind)
    for own, exact in ((module.sin, np.sin), (module.cos, np.cos)):
        error = np.abs(of(own, x).astype(np.float64) - exact(x.astype(np.float64)))
        assert error.max() < 3 * EPSILON[kind]


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_sine_of_a_small_angle_keeps_its_digits(kind: type) -> None:
    module = angles if kind is np.float32 else doubles
    x = np.geomspace(1e-12, 0.7, 10_001).astype(kind)
    exact = np.sin(x.astype(np.float64))
    assert np.abs(of(module.sin, x) / exact - 1).max() < 4 * EPSILON[kind]


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_arc_tangent(kind: type) -> None:
    """All round, over 24 powers of ten of the length, on the axes and diagonals: within six
    roundings of the angle.
    """
    module = angles if kind is np.float32 else doubles
    angle = np.concatenate([np.linspace(-3.1415, 3.1415, 100_001), np.arange(-3, 5) * np.pi / 4])
    length = 10.0 ** np.linspace(-12, 12, angle.size)
    y, x = (length * np.sin(angle)).astype(kind), (length * np.cos(angle)).astype(kind)
    exact = np.arctan2(y.astype(np.float64), x.astype(np.float64))
    apart = np.abs(of(module.atan2, y, x) - exact) / np.maximum(np.abs(exact), 1e-30)
    assert apart.max() < 6 * EPSILON[kind]


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_arc_tangent_on_the_axes(kind: type) -> None:
    module = angles if kind is np.float32 else doubles
    y, x = np.array([0, 0, 0, 2, -3], kind), np.array([0, 5, -7, 0, 0], kind)
    assert np.allclose(
        of(module.atan2, y, x), [0, 0, np.pi, np.pi / 2, -np.pi / 2], rtol=2 * EPSILON[kind], atol=0
    )


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_arc_sine(kind: type) -> None:
    module = angles if kind is np.float32 else doubles
    x = np.concatenate([np.linspace(-1, 1, 20_001), [1 - 1e-6, -1 + 1e-6]]).astype(kind)
    exact = np.arcsin(x.astype(np.float64))
    assert np.abs(of(module.asin, x) - exact).max() < 4 * EPSILON[kind]


def test_tangent() -> None:
    x = np.linspace(-1.5, 1.5, 20_001).astype(np.float32)
    exact = np.tan(x.astype(np.float64))
    # Sine and cosine are right to 3 roundings of 1; the cosine's divides by itself.
    least = 3 * EPSILON[np.float32] * (1 + 1 / np.cos(x.astype(np.float64)))
    assert np.all(np.abs(of(angles.tan, x) - exact) <= least * (1 + np.abs(exact)))


def test_inverse_cube_root() -> None:
    x = np.geomspace(1e-6, 1e9, 10_001)
    assert np.abs(of(doubles.inverse_cube_root, x) * np.cbrt(x) - 1).max() < 1e-15
