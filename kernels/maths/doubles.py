"""Trigonometric functions and inverse cube root of float64 on every backend, to about 1e-15.

SPIR-V, and so Vulkan, lacks them: GLSL.std.450 has these functions for float32 only.
"""

import taichi as ti

from kernels.maths import angles

# pi/2 in two parts; the first has 33 bits, so that its product with a number of quarters below
# 2**20 is exact.
QUARTERS = (1.5707963267341256, 6.077100506506192e-11)
SINE = tuple(float(2 * k * (2 * k + 1)) for k in range(1, 9))  # the series of the sine to x**17
COSINE = tuple(float((2 * k - 1) * 2 * k) for k in range(1, 10))  # that of the cosine to x**18


@ti.func
def sincos(angle: ti.f64):
    """Return sine and cosine of an angle [rad], within 3e-16."""
    quarters = ti.round(angle * ti.f64(0.6366197723675814))
    x = angle - quarters * ti.f64(QUARTERS[0]) - quarters * ti.f64(QUARTERS[1])
    return angles.series(ti.f64, x, quarters, SINE, COSINE)


@ti.func
def sin(angle: ti.f64) -> ti.f64:
    """Return the sine of an angle [rad]."""
    s, _c = sincos(angle)
    return s


@ti.func
def cos(angle: ti.f64) -> ti.f64:
    """Return the cosine of an angle [rad]."""
    _s, c = sincos(angle)
    return c


@ti.func
def atan2(y: ti.f64, x: ti.f64) -> ti.f64:
    """Return the angle [rad] of (x, y) from the x axis, in (-pi, pi]; 0 for (0, 0).

    The float32 result has an error of 3e-7; adding the sine of that error corrects it to 1e-16, as
    the next term, the sine's cube, is below 1e-20.
    """
    angle = ti.f64(0.0)
    far = ti.sqrt(x * x + y * y)
    if far > 0.0:
        angle = ti.cast(angles.atan2(ti.cast(y / far, ti.f32), ti.cast(x / far, ti.f32)), ti.f64)
        s, c = sincos(angle)
        angle += (y * c - x * s) / far
    return angle


@ti.func
def asin(sine: ti.f64) -> ti.f64:
    """Return the angle [rad] in [-pi/2, pi/2] of a sine from -1 to 1."""
    return atan2(sine, ti.sqrt(ti.max((1.0 - sine) * (1.0 + sine), ti.f64(0.0))))


@ti.func
def inverse_cube_root(x: ti.f64) -> ti.f64:
    """Return x ** (-1 / 3) of a positive number, to 1e-15.

    It is the float32 value, corrected by two Newton steps.
    """
    y = ti.cast(ti.pow(ti.cast(x, ti.f32), ti.f32(-1 / 3)), ti.f64)
    for _ in ti.static(range(2)):
        y *= (4.0 - x * y * y * y) * ti.f64(1 / 3)
    return y
