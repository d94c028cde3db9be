"""The lambda-sigma process: how long a passive sonar goes on hearing nothing of a target whose signal excess changes.

The signal excess has a fluctuation that keeps its value until it jumps, at a rate lambda, to an independent one. Written
with the fluctuation's own probability u, uniform on (0, 1), a target is heard as soon as u < p(t), p the probability that
signal excess and a fluctuation drawn anew are above 0. With M(t) the probability of having heard nothing,

    M(t) = e^(-lambda t) (1 - max p[0, t]) + integral of lambda e^(-lambda (t - s)) M(s) (1 - max p[s, t]) ds

(McCabe and Belkin 1973; Wagner, Mylander and Sanders 1999, Naval Operations Analysis, 3rd ed., chapter 5). Here M is
carried along instead: the density h(u) of having heard nothing, with a fluctuation of u, is 0 below p and obeys
h' = lambda (M - h) above, where p is constant; so M' = -lambda p M. h is a staircase. Where p rises it cuts steps off, where
p falls it adds one. A target that is not heard for a while forgets its stairs: all are as likely as M then.
"""

import taichi as ti

# Most steps; where there are more, the two most alike become one: several peaks err by 1 % of M.
STAIRS = 8
SURE = 1.0 - 1e-7  # p is at most this: float32 has no number nearer to 1
EVEN = 1e-5  # share by which steps may differ and count as forgotten

Steps = ti.types.vector(STAIRS, ti.f32)

# What is known of a target of which nothing has been heard. h is `held` of a step from its own edge to that of the step
# before, from the first to 1; the last edge is p now.
Silence = ti.types.struct(log=ti.f32, many=ti.i32, edge=Steps, held=Steps)


@ti.func
def at_first() -> Silence:
    """Return the silence before a target could be heard: its log probability is 0."""
    silence = Silence(log=0.0, many=1, edge=Steps(0.0), held=Steps(0.0))
    silence.held[0] = 1.0
    return silence


@ti.func
def _above(silence: ti.template(), j: ti.i32) -> ti.f32:
    """Return the upper end of step j."""
    upper = 1.0
    if j > 0:
        upper = silence.edge[j - 1]
    return upper


@ti.func
def _missed(silence: ti.template()) -> ti.f32:
    """Return M in units of exp(log): the integral of h."""
    total = 0.0
    for j in range(silence.many):
        total += silence.held[j] * (_above(silence, j) - silence.edge[j])
    return total


@ti.func
def _fewer(silence: Silence) -> Silence:
    """Return a silence with one step less: of neighbours, the two become one that change h least."""
    best, least = 0, ti.f32(3e38)
    for j in range(silence.many - 1):
        a = _above(silence, j) - silence.edge[j]
        b = silence.edge[j] - silence.edge[j + 1]
        loss = ti.abs(silence.held[j] - silence.held[j + 1]) * a * b / ti.max(a + b, 1e-30)
        if loss < least:
            best, least = j, loss
    a = _above(silence, best) - silence.edge[best]
    b = silence.edge[best] - silence.edge[best + 1]
    if a + b > 0.0:
        silence.held[best] = (a * silence.held[best] + b * silence.held[best + 1]) / (a + b)
    silence.edge[best] = silence.edge[best + 1]
    for j in range(best + 1, silence.many - 1):
        silence.edge[j], silence.held[j] = silence.edge[j + 1], silence.held[j + 1]
    silence.many -= 1
    return silence


@ti.func
def after(silence: Silence, chance: ti.f32, rate: ti.f32, lasting: ti.f32) -> Silence:
    """Return a silence that goes on for a while [s] in which p is constant: `chance`; rate: lambda [1/s].

    M of what comes in is 1 in units of exp(log), and so is that of what is returned.
    """
    p = ti.min(ti.max(chance, 0.0), SURE)
    m = silence.many
    while m > 1 and _above(silence, m - 1) <= p:  # all of the last step is heard
        m -= 1
    silence.many = m
    if p < silence.edge[m - 1]:  # what had been heard is drawn anew from now on
        if m == STAIRS:
            silence = _fewer(silence)
        silence.edge[silence.many], silence.held[silence.many] = p, 0.0
        silence.many += 1
    else:
        silence.edge[m - 1] = p
    missed = _missed(silence)
    over, kept = ti.exp(-rate * p * lasting), ti.exp(-rate * lasting)
    anew = missed * (over - kept) / (1.0 - p)
    if rate * lasting * (1.0 - p) < 1e-3:  # what the difference tends to
        anew = missed * rate * lasting * kept
    scale = 1.0 / ti.max(missed * over, 1e-37)
    for j in range(silence.many):
        silence.held[j] = (silence.held[j] * kept + anew) * scale
    silence.log += ti.log(ti.max(missed * over, 1e-37))
    return silence


@ti.func
def settled(silence: Silence, rate: ti.f32, lasting: ti.f32) -> Silence:
    """Return a silence that goes on for a while [s] in which the target cannot be heard."""
    if silence.many > 1 or silence.edge[0] > 0.0:
        silence = after(silence, 0.0, rate, lasting)
        low, high = silence.held[0], silence.held[0]
        for j in range(1, silence.many):
            low, high = ti.min(low, silence.held[j]), ti.max(high, silence.held[j])
        if high - low <= EVEN:
            log = silence.log
            silence = at_first()
            silence.log = log
    return silence
