"""Trigonometric functions of float32 by series, equal on every backend to the last bits.

A graphics card's own functions are faster and worse: Vulkan guarantees 2**-11 of a sine, which is 3
km of the Earth's radius. Arguments are at most some thousand turns. `kernels.maths.doubles` has the
functions of float64.
"""

import taichi as ti

# pi/2 in three parts, of 11, 11 and 24 bits, so that the first two times a number of quarters below
# 2**13 are exact.
QUARTERS = (1.5703125, 1014 / 2097152, 3.139164786504813e-07)
# (2 k) (2 k + 1): the series of the sine to x**9, within 2e-9 for 45 degrees
SINE = (6.0, 20.0, 42.0, 72.0)
COSINE = (2.0, 12.0, 30.0, 56.0, 90.0)  # (2 k - 1) (2 k): that of the cosine to x**10, within 1e-10
# atan(x) / x in powers of x**2, interpolated at Chebyshev's points of 0 <= x <= tan(pi/8), within
# 7e-10.
ARC_TANGENT = (
    0.9999999994,
    -0.3333330689,
    0.1999818304,
    -0.1423953267,
    0.1056982879,
    -0.06026305214,
)
EIGHTH = 0.41421356237309503  # tan(pi/8)


@ti.func
def series(
    kind: ti.template(),
    x: ti.template(),
    quarters: ti.template(),
    sine_terms: ti.template(),
    cosine_terms: ti.template(),
):
    """Return sine and cosine of an angle of quarter turns plus x [rad], by Taylor series about 0.

    Args:
        kind: type of the numbers, ti.f32 or ti.f64.
        x: remainder of the angle after the quarter turns [rad], from -pi/4 to pi/4.
        quarters: number of quarter turns, a whole number.
        sine_terms: (2 k) (2 k + 1) for each term of the sine.
        cosine_terms: (2 k - 1) (2 k) for each term of the cosine.
    """
    y = x * x
    sine, cosine = kind(1.0), kind(1.0)
    for k in ti.static(range(len(sine_terms) - 1, -1, -1)):
        sine = 1.0 - y * kind(1 / sine_terms[k]) * sine
    for k in ti.static(range(len(cosine_terms) - 1, -1, -1)):
        cosine = 1.0 - y * kind(1 / cosine_terms[k]) * cosine
    sine *= x
    turned = ti.cast(quarters, ti.i32)
    s, c = sine, cosine
    if turned & 1 == 1:
        s, c = cosine, -sine
    if turned & 2 == 2:
        s, c = -s, -c
    return s, c


@ti.func
def sincos(angle: ti.f32):
    """Return sine and cosine of an angle [rad], within 1e-7."""
    quarters = ti.round(angle * ti.f32(0.6366197723675814))
    x = angle - quarters * QUARTERS[0] - quarters * QUARTERS[1] - quarters * ti.f32(QUARTERS[2])
    return series(ti.f32, x, quarters, SINE, COSINE)


@ti.func
def sin(angle: ti.f32) -> ti.f32:
    """Return the sine of an angle [rad], within 1e-7."""
    s, _c = sincos(angle)
    return s


@ti.func
def cos(angle: ti.f32) -> ti.f32:
    """Return the cosine of an angle [rad], within 1e-7."""
    _s, c = sincos(angle)
    return c


@ti.func
def tan(angle: ti.f32) -> ti.f32:
    """Return the tangent of an angle [rad]."""
    s, c = sincos(angle)
    return s / c


@ti.func
def atan2(y: ti.f32, x: ti.f32) -> ti.f32:
    """Return the angle [rad] of (x, y) from the x axis, in (-pi, pi]; 0 for (0, 0).

    The relative error is 3e-7.
    """
    far, near = ti.max(ti.abs(x), ti.abs(y)), ti.min(ti.abs(x), ti.abs(y))
    # atan(t) is 45 degrees less the arc tangent of (1 - t) / (1 + t), where t = near / far.
    over, under, base = near, far, ti.f32(0.0)
    if near > ti.f32(EIGHTH) * far:
        over, under, base = near - far, near + far, ti.f32(0.7853981633974483)
    t = ti.f32(0.0)
    if under > 0.0:
        t = over / under
    row = ti.f32(ARC_TANGENT[-1])
    for k in ti.static(range(len(ARC_TANGENT) - 2, -1, -1)):
        row = ti.f32(ARC_TANGENT[k]) + t * t * row
    angle = base + t * row
    if ti.abs(y) > ti.abs(x):
        angle = ti.f32(1.5707963267948966) - angle
    if x < 0.0:
        angle = ti.f32(3.141592653589793) - angle
    return -angle if y < 0.0 else angle


@ti.func
def asin(sine: ti.f32) -> ti.f32:
    """Return the angle [rad] in [-pi/2, pi/2] of a sine from -1 to 1."""
    return atan2(sine, ti.sqrt(ti.max((1.0 - sine) * (1.0 + sine), 0.0)))
