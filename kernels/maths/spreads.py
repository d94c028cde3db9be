"""Distributions of one uncertain number: a truncated triangle, and an exponential time."""

import taichi as ti

f32x4 = ti.types.vector(4, ti.f32)


@ti.func
def triangle(law: f32x4, u: ti.f32, v: ti.f32) -> ti.f32:
    """Return a number from a truncated triangle (Richardson et al. 2003, section 4.2: CAST).

    law: low, high, mode and the weight of the uniform component. The density is highest at the
    mode, r times that at both ends: a mixture of a uniform distribution, of weight 2 / (1 + r), and
    a triangle. u, v: uniform in (0, 1).
    """
    low, span = law[0], law[1] - law[0]
    t = v
    if u >= law[3] and span > 0.0:
        peak = (law[2] - low) / span
        t = ti.sqrt(v * peak) if v < peak else 1.0 - ti.sqrt((1.0 - v) * (1.0 - peak))
    return low + span * t


@ti.func
def waiting(mean: ti.f32, u: ti.f32) -> ti.f32:
    """Return an exponential time or length with this mean; u: uniform in (0, 1)."""
    return -ti.log(u) * mean
