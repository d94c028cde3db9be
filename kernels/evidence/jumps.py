"""The lambda-sigma process: how long a passive sonar goes on hearing nothing of a target whose
signal excess changes.

The signal excess has a fluctuation that keeps its value until it jumps, at a rate lambda, to an
independent one. Written with the fluctuation's own probability u, uniform on (0, 1), a target is
heard as soon as u < p(t), p the probability that signal excess and a fluctuation drawn again are
above 0. With M(t) the probability of having heard nothing,

    M(t) = e^(-lambda t) (1 - max p[0, t]) + integral of lambda e^(-lambda (t - s)) M(s) (1 - max
    p[s, t]) ds

(McCabe and Belkin 1973; Wagner, Mylander and Sanders 1999, Naval Operations Analysis, 3rd ed.,
chapter 5). Here M is carried along instead: the density h(u) of having heard nothing, with a
fluctuation of u, is 0 below p and obeys h' = lambda (M - h) above, where p is constant; so M' =
-lambda p M. h is a staircase. Where p rises it cuts steps off, where p falls it adds one. A target
that is not heard for a while forgets its stairs: all are as likely as M then.

In units of M the height of a step, h / M, obeys y' = lambda (1 - (1 - p) y), the same for all. So a
time multiplies all of them by one number and adds another to all: these two are carried along, and
the steps only change where p does. Where there is one step, its height is 1 / (1 - its edge). A
step is the higher, the earlier it was added.
"""

import taichi as ti

# Most steps; where there are more, the two most alike become one: several peaks err by 1 % of M.
STAIRS = 8
SURE = 1.0 - 1e-7  # p is at most this: float32 has no number nearer to 1
# deviations of the fluctuation below which nothing is heard: p is 6e-8, less than float32 tells
# from 0 beside 1
QUIET = -5.3
EVEN = 1e-5  # share by which steps may differ and count as forgotten
# what is added to all steps is at most this when one is added: the new one's 0 is known to 4 * 6e-8
HIGH = 4.0
LEAST = 1e-18  # what a cut leaves is at least this: float32 holds the product of two
FADED = 1e-4  # and what they are multiplied by is at least this

Steps = ti.types.vector(STAIRS, ti.f32)

# What is known of a target of which nothing has been heard. A step goes from its own edge to that
# of the step before, the first to 1; the last edge is p now. The height of a step is `faded` *
# `held` + `anew`, in units in which M is 1. The log of M is `log` + log(`left`).
Silence = ti.types.struct(
    log=ti.f32, left=ti.f32, many=ti.i32, edge=Steps, held=Steps, faded=ti.f32, anew=ti.f32
)


@ti.func
def at_first() -> Silence:
    """Return the silence before a target could be heard: its log probability is 0."""
    silence = Silence(
        log=0.0, left=1.0, many=1, edge=Steps(0.0), held=Steps(0.0), faded=1.0, anew=0.0
    )
    silence.held[0] = 1.0
    return silence


@ti.func
def log_missed(silence: ti.template()) -> ti.f32:
    """Return the log of the probability of having heard nothing."""
    return silence.log + ti.log(silence.left)


@ti.func
def height(silence: ti.template(), j: ti.i32) -> ti.f32:
    """Return the height of step j."""
    found = silence.faded * silence.held[j] + silence.anew
    if silence.many == 1:
        found = 1.0 / (1.0 - silence.edge[0])
    return found


@ti.func
def _fold(silence: ti.template()):
    """Write down the heights of steps themselves."""
    for j in range(silence.many):
        silence.held[j] = height(silence, j)
    silence.faded, silence.anew = 1.0, 0.0


@ti.func
def _fewer(silence: ti.template()):
    """Make two neighbours one, those that change the staircase least."""
    best, least = 0, ti.f32(3e38)
    above, edge, held = ti.f32(1.0), silence.edge[0], silence.held[0]
    for j in range(silence.many - 1):
        after, next_ = silence.edge[j + 1], silence.held[j + 1]
        a, b = above - edge, edge - after
        loss = ti.abs(held - next_) * a * b / ti.max(a + b, 1e-30)
        if loss < least:
            best, least = j, loss
        above, edge, held = edge, after, next_
    a = 1.0 - silence.edge[best]
    if best > 0:
        a = silence.edge[best - 1] - silence.edge[best]
    b = silence.edge[best] - silence.edge[best + 1]
    if a + b > 0.0:
        silence.held[best] = (a * silence.held[best] + b * silence.held[best + 1]) / (a + b)
    silence.edge[best] = silence.edge[best + 1]
    for j in range(best + 1, silence.many - 1):
        silence.edge[j], silence.held[j] = silence.edge[j + 1], silence.held[j + 1]
    silence.many -= 1


@ti.func
def _cut(silence: ti.template(), p: ti.f32):
    """Have p rise to above the last edge: what lies below is heard."""
    left = ti.f32(0.0)  # of M
    if silence.many > 1:
        m = silence.many
        while m > 1 and silence.edge[m - 2] <= p:  # all of the last step
            m -= 1
        above = ti.f32(1.0)
        for j in range(m):
            edge = silence.edge[j] if j < m - 1 else p
            left += (silence.faded * silence.held[j] + silence.anew) * (above - edge)
            above = edge
        left = ti.max(left, LEAST)
        silence.many = m
        silence.faded /= left
        silence.anew /= left
    else:
        left = (1.0 - p) / (1.0 - silence.edge[0])
    silence.edge[silence.many - 1] = p
    silence.left *= left
    if silence.left < LEAST:
        silence.log += ti.log(silence.left)
        silence.left = 1.0


@ti.func
def _fall(silence: ti.template(), p: ti.f32):
    """Have p fall below the last edge: what had been heard there is drawn again from now on."""
    if silence.many == 1 or silence.anew > HIGH or silence.faded < FADED:
        _fold(silence)
    if silence.many == STAIRS:
        _fewer(silence)
    silence.edge[silence.many], silence.held[silence.many] = p, -silence.anew / silence.faded
    silence.many += 1


@ti.func
def go_on(silence: ti.template(), chance_: ti.f32, rate: ti.f32, lasting: ti.f32):
    """Have a silence go on for a while [s] in which p is constant: `chance_`; rate: lambda [1/s]."""
    p = ti.min(ti.max(chance_, 0.0), SURE)
    last = silence.edge[silence.many - 1]
    if p > last:
        _cut(silence, p)
    elif p < last:
        _fall(silence, p)
    silence.log -= rate * p * lasting
    if silence.many > 1:
        jumps = rate * lasting
        x = jumps * (1.0 - p)
        # (1 - e^-x) / x; where 1 - e^-x cancels by its series, whose rest is below x^4 / 120.
        each = 1.0 - x * (0.5 - x * (ti.f32(1 / 6) - x * ti.f32(1 / 24)))
        if x > 0.05:
            each = (1.0 - ti.exp(-x)) / x
        kept = 1.0 - x * each
        silence.faded *= kept
        silence.anew = silence.anew * kept + jumps * each


@ti.func
def settle(silence: ti.template(), rate: ti.f32, lasting: ti.f32):
    """Have a silence go on for a while [s] in which the target cannot be heard."""
    if lasting > 0.0 and (silence.many > 1 or silence.edge[0] > 0.0):
        go_on(silence, 0.0, rate, lasting)
        if silence.faded * (silence.held[0] - silence.held[silence.many - 1]) <= EVEN:
            silence.many, silence.edge[0], silence.faded, silence.anew = 1, 0.0, 1.0, 0.0
            silence.held[0] = 1.0


@ti.func
def chance(deviations: ti.f32) -> ti.f32:
    """Return the probability that a standard normal number is below a number, error 3e-7.

    Abramowitz and Stegun 1964, Handbook of Mathematical Functions, eq. 26.2.17: 7.5e-8 and what
    float32 rounds. Its polynomial and its exponential do not wait for each other.
    """
    z = ti.abs(deviations)
    t = 1.0 / (1.0 + 0.2316419 * z)
    tt = t * t
    p = (0.31938153 - 0.356563782 * t) + tt * ((1.781477937 - 1.821255978 * t) + tt * 1.330274429)
    beyond = 0.3989422804014327 * t * p * _exp(ti.max(-0.5 * z * z, -80.0))
    return ti.select(deviations > 0.0, 1.0 - beyond, beyond)


@ti.func
def _exp(x: ti.f32) -> ti.f32:
    """Return e^x for -80 <= x <= 0, relative error 2e-7, without a call of libm.

    e^x = 2^n e^r with |r| at most half of log 2, by a polynomial fitted there to 1e-8.
    """
    n = ti.floor(x * 1.4426950408889634 + 0.5)
    r = (x - n * 0.693359375) + n * 2.12194440e-4  # n log 2 in two parts, so that nothing is lost
    rr = r * r
    e = (1.0 + r) + rr * (
        (0.5 + r * 0.16666577) + rr * (0.04166646 + r * 0.00836318 + rr * 0.00139336)
    )
    return e * ti.bit_cast((ti.cast(n, ti.i32) + 127) << 23, ti.f32)


@ti.func
def hear(silence: ti.template(), over: ti.f32, spread: ti.f32, rate: ti.f32, lasting: ti.f32):
    """Have a silence go on for a while [s] with a signal excess `over` [dB], whose fluctuation is
    `spread`.
    """
    deviations = over / spread
    if deviations > QUIET:
        go_on(silence, chance(deviations), rate, lasting)
    else:
        settle(silence, rate, lasting)


@ti.func
def after(silence: Silence, chance_: ti.f32, rate: ti.f32, lasting: ti.f32) -> Silence:
    """Return a silence that goes on for a while: see `go_on`."""
    go_on(silence, chance_, rate, lasting)
    return silence


@ti.func
def settled(silence: Silence, rate: ti.f32, lasting: ti.f32) -> Silence:
    """Return a silence that goes on for a while in which the target cannot be heard."""
    settle(silence, rate, lasting)
    return silence
