"""Brownian bridges and boundaries: probability and time of the first touch of a line.

Also the probability that a bridge stays in a strip, a box or a disc. Everything lies in a plane, in
metres. A bridge connects two positions and deviates from the straight line between them; `variance`
is K^2 dt, that of a free walk of the same duration. Midway the deviation has a quarter of it, in
each component. Variance 0 is the straight line itself. Distributions of the bridge and a line:
Karatzas and Shreve 1991, Brownian Motion and Stochastic Calculus, eq. 4.3.40; Nunez, Singham and
Atkinson 2020, doi:10.1080/01605682.2019.1570806, eqs. 10 and 11.

`polyline` and `disc` decide whether the formula for one straight line is accurate for a piece of
path. Where it is not, near an end or a corner of a line, or on a curved part of a circle,
`kernels.evidence.observe` halves the piece.
"""

import taichi as ti

from kernels.maths import angles

# a bridge leaves its straight line by more than REACH K sqrt(dt) with probability exp(-2 REACH^2)
REACH = 3.0
SLIGHT = 1e-7  # probability of a touch that is neglected
# a circle counts as its tangent for bridges up to this share of its radius
FLAT = 0.125

# state of a piece: touches nothing; a line's formula applies; must be halved
FAR, TOLD, OPEN = range(3)

f32x2 = ti.types.vector(2, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)


@ti.func
def line(before: ti.f32, after: ti.f32, variance: ti.f32) -> ti.f32:
    """Return the probability that a bridge touches a line.

    before, after: signed distances [m] from the line at the bridge's begin and end.
    """
    touched = 1.0
    if before * after > 0.0:
        touched = 0.0
        if variance > 0.0:
            touched = ti.exp(-2.0 * before * after / variance)
    return touched


@ti.func
def _tail(z: ti.f32) -> ti.f32:
    """Return exp(z^2) erfc(z) for z >= 0, relative error 1.2e-7.

    Press et al. 1992, Numerical Recipes, section 6.2.
    """
    t = 1.0 / (1.0 + 0.5 * z)
    p = -0.82215223 + t * 0.17087277
    p = -1.13520398 + t * (1.48851587 + t * p)
    p = -0.18628806 + t * (0.27886807 + t * p)
    p = 0.37409196 + t * (0.09678418 + t * p)
    return t * ti.exp(-1.26551223 + t * (1.00002368 + t * p))


@ti.func
def _normal_below(x: ti.f32) -> ti.f32:
    """Return the standard normal distribution function at x."""
    z = ti.abs(x) * 0.7071067811865476
    half = 0.5 * _tail(z) * ti.exp(-z * z)
    return ti.select(x > 0.0, 1.0 - half, half)


@ti.func
def by(before: ti.f32, after: ti.f32, variance: ti.f32, share: ti.f32) -> ti.f32:
    """Return the probability that a bridge has touched a line by a share of its time (eq. 11)."""
    b, a = ti.abs(before), after
    if before < 0.0:
        a = -after
    touched = 0.0
    if share >= 1.0:
        touched = line(b, a, variance)
    elif b == 0.0:
        touched = 1.0
    elif variance <= 0.0:
        touched = ti.cast(b * (1.0 - share) + a * share <= 0.0, ti.f32)
    elif share > 0.0:
        spread = ti.sqrt(variance * share * (1.0 - share))
        mean, mirrored = (
            (b * (1.0 - share) + a * share) / spread,
            (b * (1.0 - share) - a * share) / spread,
        )
        touched = _normal_below(-mean)
        # The mirror image counts bridges that crossed the line and came back. exp(-2 a b /
        # variance) may overflow; its product with the tail does not.
        if mirrored >= 0.0:
            touched += 0.5 * ti.exp(-0.5 * mean * mean) * _tail(mirrored * 0.7071067811865476)
        else:
            touched += ti.exp(-2.0 * a * b / variance) * _normal_below(-mirrored)
    return ti.min(touched, 1.0)


@ti.func
def strip(before: ti.f32, after: ti.f32, width: ti.f32, variance: ti.f32) -> ti.f32:
    """Return the probability that a bridge stays within a strip.

    before, after: distances [m] from one of its sides at the bridge's begin and end.

    While K^2 dt is below half the square of the width, the sum runs over images in both sides, of
    which the third pair is below exp(-24). Above it the sum runs over eigenfunctions of the strip,
    of which the fourth is below exp(-37) of the first.
    """
    stays = 0.0
    if before > 0.0 and after > 0.0 and before < width and after < width:
        stays = 1.0
        if variance > 0.0:
            a, b, t = before / width, after / width, variance / (width * width)
            if t < 0.5:
                total = 0.0
                for m in ti.static(range(-2, 3)):
                    total += ti.exp(-2.0 * m * (m + b - a) / t) - ti.exp(
                        -2.0 * (m + a) * (m + b) / t
                    )
                stays = total
            else:
                total = 0.0
                for m in ti.static(range(1, 4)):
                    pi = 3.141592653589793 * m
                    total += angles.sin(pi * a) * angles.sin(pi * b) * ti.exp(-0.5 * pi * pi * t)
                stays = (
                    2.0
                    * ti.sqrt(6.283185307179586 * t)
                    * ti.exp(0.5 * (b - a) * (b - a) / t)
                    * total
                )
            stays = ti.min(ti.max(stays, 0.0), 1.0)
    return stays


@ti.func
def box(a: f32x2, b: f32x2, half: f32x2, variance: ti.f32) -> ti.f32:
    """Return the probability that a bridge from a to b stays in a box around the origin.

    half: half its width and height [m]; its sides are parallel to the axes. The components of a
    bridge are independent of each other.
    """
    stays = strip(a[0] + half[0], b[0] + half[0], 2.0 * half[0], variance)
    return stays * strip(a[1] + half[1], b[1] + half[1], 2.0 * half[1], variance)


@ti.func
def within(a: f32x2, half: f32x2) -> ti.i32:
    """Return 1 if a position lies in a box around the origin."""
    return ti.cast(ti.abs(a[0]) < half[0] and ti.abs(a[1]) < half[1], ti.i32)


@ti.func
def disc(a: f32x2, b: f32x2, radius: ti.f32, variance: ti.f32) -> f32x4:
    """Return (state, p, before, after) for a bridge from a to b and a circle around the origin.

    See `polyline`. The formula for a line applies where the circle is nearly flat: length and
    spread of the bridge are short against the radius. The curvature then shifts the circle by less
    than FLAT^2 / 8 of its radius.
    """
    way, reach = b - a, REACH * ti.sqrt(variance)
    far_a, far_b = (
        ti.sqrt(a[0] * a[0] + a[1] * a[1]) - radius,
        ti.sqrt(b[0] * b[0] + b[1] * b[1]) - radius,
    )
    length = ti.sqrt(way[0] * way[0] + way[1] * way[1])
    share = 0.0
    if length > 0.0:
        share = ti.min(ti.max(-(a[0] * way[0] + a[1] * way[1]) / (length * length), 0.0), 1.0)
    closest = a + share * way
    nearest = ti.sqrt(closest[0] * closest[0] + closest[1] * closest[1]) - radius
    found = f32x4(ti.cast(OPEN, ti.f32), line(far_a, far_b, variance), far_a, far_b)
    if nearest > reach or ti.max(far_a, far_b) < -reach:
        found = f32x4(ti.cast(FAR, ti.f32), 0.0, far_a, far_b)
    elif far_a * far_b <= 0.0 or (
        length <= FLAT * radius and variance <= FLAT * FLAT * radius * radius
    ):
        found[0] = ti.cast(TOLD, ti.f32)
    elif far_a > 0.0 and nearest < -reach:  # it passes right through
        found = f32x4(ti.cast(TOLD, ti.f32), 1.0, far_a, -far_b)
    return found


@ti.func
def polyline(a: f32x2, b: f32x2, variance: ti.f32, corners: ti.template()) -> f32x4:
    """Return (state, p, before, after) for a bridge from a to b and a line of straight parts.

    corners: (x, y, x, y, ...) [m]. state: FAR, TOLD or OPEN. p: the probability of a touch; for an
    OPEN piece only a rough one, from the most likely place of a touch on each part's straight line.
    before, after: signed distances [m] of a and b from the straight line that is touched, for the
    distribution of the time, see `by`.
    """
    reach = REACH * ti.sqrt(variance)
    told, told_before, told_after, many, open_ = 0.0, 1.0, 1.0, 0, 0
    rough, rough_before, rough_after, first = 0.0, 1.0, 1.0, 2.0
    for k in range(corners.shape[0] // 2 - 1):
        px, py = corners[2 * k], corners[2 * k + 1]
        ex, ey = corners[2 * k + 2] - px, corners[2 * k + 3] - py
        length = ti.sqrt(ex * ex + ey * ey)
        ex, ey = ex / length, ey / length
        aside_a, aside_b = ex * (a[1] - py) - ey * (a[0] - px), ex * (b[1] - py) - ey * (b[0] - px)
        p = line(aside_a, aside_b, variance)
        if p > SLIGHT:
            along_a, along_b = (
                ex * (a[0] - px) + ey * (a[1] - py),
                ex * (b[0] - px) + ey * (b[1] - py),
            )
            # The bridge may touch the line only where its straight line comes within reach.
            low, high, likely = 0.0, 1.0, 0.0
            if aside_a != aside_b:
                one, other = (
                    (aside_a - reach) / (aside_a - aside_b),
                    (aside_a + reach) / (aside_a - aside_b),
                )
                low = ti.min(ti.max(ti.min(one, other), 0.0), 1.0)
                high = ti.min(ti.max(ti.max(one, other), 0.0), 1.0)
            if aside_a != 0.0:
                likely = ti.abs(aside_a) / (ti.abs(aside_a) + ti.abs(aside_b))
            begin, end = along_a + low * (along_b - along_a), along_a + high * (along_b - along_a)
            least, most = ti.min(begin, end) - reach, ti.max(begin, end) + reach
            at = along_a + likely * (along_b - along_a)
            if most >= 0.0 and least <= length:
                if (least >= 0.0 and most <= length) or variance <= 0.0:
                    many += 1
                    if likely < first or many == 1:
                        told, told_before, told_after, first = p, aside_a, aside_b, likely
                else:
                    open_ = 1
                if at >= 0.0 and at <= length and p > rough:
                    rough, rough_before, rough_after = p, aside_a, aside_b
    found = f32x4(ti.cast(FAR, ti.f32), 0.0, 1.0, 1.0)
    if open_ == 1 or (many > 1 and variance > 0.0):
        found = f32x4(ti.cast(OPEN, ti.f32), rough, rough_before, rough_after)
    elif many > 0:
        found = f32x4(ti.cast(TOLD, ti.f32), told, told_before, told_after)
    return found
