"""Rank of a target's position among the containment areas of a cloud."""

import taichi as ti

from kernels.maths import doubles
from kernels.tracking.follower import Own, anchor_and_tangent, f64x3, turned, vector

SAME = 1e-9  # [rad] particles within this distance are at the same place: 6 mm
PICKS = 101  # number of particles among which the target is ranked by density


@ti.func
def level(
    cloud: ti.template(),
    base: ti.i32,
    count: ti.i32,
    time: ti.f64,
    mean: f64x3,
    total: ti.f64,
    target: f64x3,
):
    """Return the share of a cloud in denser places than the target: the areas that contain it.

    Densities are Epanechnikov kernel estimates from all particles but the one at the place, with
    its own share of the spread (Silverman 1986, Density estimation, table 4.1). 101 particles and
    the target are treated alike.
    """
    squared = ti.f64(0.0)
    for j in range(count):
        p0, u0 = anchor_and_tangent(cloud, base + j)
        p, _u = turned(
            p0,
            u0,
            cloud.own_real[base + j, Own.RATE] * (time - cloud.own_real[base + j, Own.SINCE]),
        )
        for d in ti.static(range(3)):
            cloud.own_real[base + j, Own.SCRATCH + d] = p[d]
        apart, w = p - mean, cloud.own_real[base + j, Own.WEIGHT]
        squared += w * apart.dot(apart)
    picks = ti.min(count, PICKS)
    # Duplicates that have not diverged count once: each pick's weight is that of all particles at
    # its place.
    picked, together = ti.f64(0.0), ti.f64(0.0)
    for pick in range(picks):
        i = base + pick * count // picks
        picked += cloud.own_real[i, Own.WEIGHT]
        together += cloud.own_real[i, Own.WEIGHT] * _at_one(
            cloud, base, count, vector(cloud.own_real, i, Own.SCRATCH)
        )
    effective = total * picked / together
    reach = ti.f64(2.4 * 2.4) * squared / total * ti.f64(0.5) * doubles.inverse_cube_root(effective)
    there = _density(cloud, base, count, target, -1, reach)
    denser = ti.f64(0.0)
    for pick in range(picks):
        i = base + pick * count // picks
        if _density(cloud, base, count, vector(cloud.own_real, i, Own.SCRATCH), i, reach) > there:
            denser += cloud.own_real[i, Own.WEIGHT]
    return denser / picked


@ti.func
def _at_one(cloud: ti.template(), base: ti.i32, count: ti.i32, place: f64x3) -> ti.f64:
    """Return the weight of all particles at a place."""
    found = ti.f64(0.0)
    for j in range(count):
        apart = vector(cloud.own_real, base + j, Own.SCRATCH) - place
        if apart.dot(apart) < ti.f64(SAME * SAME):
            found += cloud.own_real[base + j, Own.WEIGHT]
    return found


@ti.func
def _density(
    cloud: ti.template(), base: ti.i32, count: ti.i32, place: f64x3, without: ti.i32, reach: ti.f64
) -> ti.f64:
    """Return a cloud's density at a place, up to a factor, without one particle.

    reach: squared kernel radius [rad2].
    """
    found = ti.f64(0.0)
    for j in range(count):
        i = base + j
        apart = vector(cloud.own_real, i, Own.SCRATCH) - place
        if i != without:
            found += cloud.own_real[i, Own.WEIGHT] * ti.max(
                1.0 - apart.dot(apart) / reach, ti.f64(0.0)
            )
    return found
