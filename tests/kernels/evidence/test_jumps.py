"""The lambda-sigma process against simulations of it, its integral equation by quadrature, and
closed forms.
"""

import math

import numpy as np
import pytest
import taichi as ti
from scipy import integrate
from scipy.stats import norm

from kernels.evidence import jumps

Reals = ti.types.ndarray(dtype=ti.f32, ndim=1)
HOUR = 3600.0


@ti.kernel
def _silence(p: Reals, rate: ti.f32, lasting: ti.f32, log: Reals):
    for _ in range(1):
        silence = jumps.at_first()
        for k in range(p.shape[0]):
            silence = jumps.after(silence, p[k], rate, lasting)
            log[k] = jumps.log_missed(silence)


def missed(p, rate, lasting):
    """Return the probability of having heard nothing after each of the parts, in which p is
    constant.
    """
    log = np.zeros(len(p), np.float32)
    _silence(np.asarray(p, np.float32), rate, lasting, log)
    return np.exp(log.astype(np.float64))


def peaks(many, lasting, parts):
    """Return p [0, 1] in the middle of parts of a time in which a target comes near and goes off
    again so many times.
    """
    share = (np.arange(parts) + 0.5) / parts
    excess = -9.0 + 11.0 * np.abs(np.sin(math.pi * many * share)) ** 3 + 0.7 * np.sin(5 * share)
    return norm.cdf(excess / 6.5), lasting / parts


def simulated(p, rate, part, many, seed):
    """Return how many of as many processes, event by event, are never above their threshold, as a
    share.
    """
    rng = np.random.default_rng(seed)
    whole = len(p) * part
    most = [p]  # most of p over 2^level parts
    while 2 ** len(most) <= len(p):
        half = 2 ** (len(most) - 1)
        most.append(np.maximum(most[-1][:-half], most[-1][half:]))
    time, left = np.zeros(many), 0
    while time.size:
        u, jump = rng.random(time.size), time + rng.exponential(1 / rate, time.size)
        end = np.minimum(jump, whole)
        i, j = (np.minimum((x / part).astype(int), len(p) - 1) for x in (time, end))
        level = np.log2(j - i + 1).astype(int)
        highest = np.empty(time.size)
        for which in np.unique(level):
            of = level == which
            table = most[which]
            highest[of] = np.maximum(table[i[of]], table[j[of] - 2**which + 1])
        silent = u >= highest
        left += int(np.sum(silent & (jump >= whole)))
        time = jump[silent & (jump < whole)]
    return left / many


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("many", "parts"), [(1, 600), pytest.param(9, 3600, marks=pytest.mark.thorough)]
)
def test_against_a_simulation_of_the_process(many, parts):
    p, part = peaks(many, 9.3 * HOUR, parts)
    rate, draws = 1.1 / HOUR, 2_000_000
    ours = missed(p, rate, part)[-1]
    told = simulated(p, rate, part, draws, seed=71)
    assert ours == pytest.approx(told, abs=3 * math.sqrt(told * (1 - told) / draws))


def renewed(p, rate, part):
    """Return M after each part: M(t) = e^-lt (1 - max p[0, t]) + int l e^-l(t-s) M(s) (1 - max p[s,
    t]) ds.

    It is exact where p is constant in parts: within part i, M falls from its value at the begin by
    e^-(l p_i s), and so the integral has closed form, part by part.
    """
    begin = np.empty(len(p))  # M at the begin of each part, once its own p counts
    # int l e^-l(part - s) e^-(l p s) ds
    inner = (np.exp(-rate * p * part) - np.exp(-rate * part)) / (1 - p)
    for k in range(len(p)):
        # of p from the begin of each part until now
        highest = np.maximum.accumulate(p[: k + 1][::-1])[::-1]
        # from the end of each part before
        since = np.exp(-rate * part * (k - np.arange(1.0, k + 1)))
        begin[k] = math.exp(-rate * part * k) * (1 - highest[0]) + np.sum(
            since * begin[:k] * inner[:k] * (1 - highest[:-1])
        )
    return begin * np.exp(-rate * p * part)


@pytest.mark.parametrize("many", [1, 2, 9])
def test_against_the_integral_equation(many):
    p, part = peaks(many, 7.0 * HOUR, 500)
    rate = 0.9 / HOUR
    # The staircase has eight steps (jumps.STAIRS): what is made one costs several peaks 1 % of a
    # miss at the most. One peak makes nothing one that counts; there float32 adds up 500 parts.
    assert missed(p, rate, part) == pytest.approx(
        renewed(p, rate, part), rel=1e-2 if many > 1 else 500 * 6e-7
    )


@pytest.mark.parametrize("rate", [0.02 / HOUR, 1.1 / HOUR, 40 / HOUR])
def test_hardly_missed_then_hardly_heard(rate):
    """Up and down between 1 - 1e-4 and 1e-4, in parts of a minute to three hours: few steps, which
    are told exactly.

    What is left of 1 below p, in float32, is right to 6e-8 of 1e-4, eight times; and each part
    rounds its log.
    """
    p = np.array(
        [0.3, 0.9, 0.9999, 0.5, 1e-4, 0.0, 0.2, 0.4, 0.999, 0.1, 0.3, 1 - 1e-4, 0.0, 0.7],
        np.float32,
    )
    for part in (60.0, 1800.0, 3 * HOUR):
        exact = renewed(p.astype(float), rate, part)
        told = exact > 1e-30  # after long, next to nothing is left
        assert told.any()
        assert missed(p, rate, part)[told] == pytest.approx(
            exact[told], rel=8 * 6e-4 + len(p) * 70 * 6e-8
        )


def test_constant():
    """What stays as loud is heard at once with p, and then whenever it jumps to where it is: (1 -
    p) e^(-l p t).
    """
    ours = missed(np.full(240, 0.23), 2 / HOUR, 60.0)
    time = 60.0 * np.arange(1, 241)
    assert ours == pytest.approx(0.77 * np.exp(-2 / HOUR * 0.23 * time), rel=2e-5)


def test_single_rise_and_fall():
    """A single rise and fall: (1 - max p) exp(-l int p dt), whatever l."""
    share = (np.arange(400) + 0.5) / 400
    p = norm.cdf((-8 + 12 * np.sin(math.pi * share)) / 6)
    whole, _ = integrate.quad(lambda x: norm.cdf((-8 + 12 * math.sin(math.pi * x)) / 6), 0, 1)
    for rate in (0.1 / HOUR, 1 / HOUR, 6 / HOUR):
        told = (1 - norm.cdf(4 / 6)) * math.exp(-rate * 5 * HOUR * whole)
        assert missed(p, rate, 5 * HOUR / 400)[-1] == pytest.approx(told, rel=2e-4)


def test_no_jumps_leaves_the_best_chance():
    p = np.array([0.1, 0.4, 0.05, 0.6, 0.2, 0.5])
    assert missed(p, 0.0, 600.0) == pytest.approx(1 - np.maximum.accumulate(p), rel=1e-6)


def test_jumps_without_end_are_independent_looks():
    """Far between, looks know nothing of each other: the misses multiply."""
    p = np.array([0.3, 0.0, 0.5, 0.0, 0.2, 0.0])
    lasting = 50 * HOUR
    # at once, they are one look
    assert missed(p, 4 / HOUR, 0.0)[-1] == pytest.approx(1 - 0.5, rel=1e-6)
    waits = missed_with(p, [0.0 if chance > 0 else lasting for chance in p], 4 / HOUR)
    assert waits == pytest.approx(np.prod(1 - p), rel=1e-5)


@ti.kernel
def _with(p: Reals, lasting: Reals, rate: ti.f32, log: Reals):
    for _ in range(1):
        silence = jumps.at_first()
        for k in range(p.shape[0]):
            silence = jumps.after(silence, p[k], rate, lasting[k])
        log[0] = jumps.log_missed(silence)


def missed_with(p, lasting, rate):
    """Return the probability of having heard nothing, of parts of lengths of their own."""
    log = np.zeros(1, np.float32)
    _with(np.asarray(p, np.float32), np.asarray(lasting, np.float32), rate, log)
    return math.exp(log[0])


def test_hardly_anything_is_left_and_still_told():
    """Far below what float32 holds: the log goes on."""
    p = np.full(2000, 0.999)
    log = np.zeros(2000, np.float32)
    _silence(p.astype(np.float32), 3 / HOUR, 600.0, log)
    assert log[-1] == pytest.approx(math.log(0.001) - 3 / HOUR * 0.999 * 600 * 2000, rel=1e-4)


def test_many_cuts_leave_less_than_float32_holds():
    """Thirty independent looks, each of which hears nearly everything."""
    p = np.tile([0.99, 0.0], 30)
    lasting = np.tile([0.0, 50 * HOUR], 30)
    log = np.zeros(1, np.float32)
    _with(p.astype(np.float32), lasting.astype(np.float32), 4 / HOUR, log)
    assert log[0] == pytest.approx(30 * math.log(1 - np.float32(0.99)), rel=1e-5)


@ti.kernel
def _chances(deviations: Reals, found: Reals):
    for k in range(deviations.shape[0]):
        found[k] = jumps.chance(deviations[k])


def test_the_normal_distribution():
    """7.5e-8 of the formula, and what float32 rounds: six products of at most a half, and a number
    near 1.
    """
    deviations = np.concatenate([np.linspace(-13, 13, 9001), [0.0, -0.0, 40.0, -40.0]]).astype(
        np.float32
    )
    found = np.zeros(deviations.size, np.float32)
    _chances(deviations, found)
    off = np.abs(found - norm.cdf(deviations.astype(np.float64)))
    assert off.max() < 7.5e-8 + (6 * 0.5 + 1) * 2.0**-24
    assert ((found >= 0) & (found <= 1)).all()


def test_settled_is_the_same_as_silence_and_forgets():
    @ti.kernel
    def both(rate: ti.f32, found: Reals):
        for _ in range(1):
            silence = jumps.after(jumps.at_first(), 0.4, rate, 300.0)
            quiet = jumps.settled(silence, rate, 900.0)
            found[0] = jumps.log_missed(quiet)
            still = jumps.after(silence, 0.0, rate, 900.0)
            found[1] = jumps.log_missed(still)
            long = jumps.settled(jumps.settled(silence, rate, 1e6), rate, 1.0)
            found[2], found[3] = jumps.log_missed(long), ti.cast(long.many, ti.f32)
            after = jumps.after(long, 0.3, rate, 0.0)
            found[4] = jumps.log_missed(after)

    found = np.zeros(5, np.float32)
    both(1 / HOUR, found)
    assert found[0] == pytest.approx(found[1], rel=1e-6)
    assert found[3] == 1
    assert found[4] - found[2] == pytest.approx(math.log(0.7), rel=1e-5)


@ti.kernel
def _looks(p: Reals, quiet: Reals, rate: ti.f32, pieces: ti.i32, found: Reals):
    for _ in range(1):
        silence = jumps.at_first()
        for k in range(p.shape[0]):
            silence = jumps.after(silence, p[k], rate, 0.0)
            for _piece in range(pieces):
                silence = jumps.settled(silence, rate, quiet[k] / pieces)
        found[0], found[1] = jumps.log_missed(silence), ti.cast(silence.many, ti.f32)


def missed_looks(p, quiet, rate):
    """Return the probability that looks hear nothing, over all ways to jump or not between them.

    Looks between which the fluctuation does not jump are one, as good as the best of them; after a
    jump it is another one.
    """
    total = 0.0
    stays = np.exp(-rate * np.asarray(quiet[: len(p) - 1]))
    for jumped in np.ndindex(*[2] * (len(p) - 1)):
        ways = np.prod(np.where(jumped, 1 - stays, stays))
        groups = np.split(np.asarray(p), np.flatnonzero(jumped) + 1)
        total += ways * np.prod([1 - max(group) for group in groups])
    return float(total)


@pytest.mark.parametrize("pieces", [1, 5])
@pytest.mark.parametrize("wait", [0.03, 0.7, 2.9, 5.3, 7.6, 9.4, 13.0])
def test_what_was_heard_is_not_forgotten_before_next_to_nothing_is_left_of_it(
    wait: float, pieces: int
) -> None:
    """Looks with silence in between, of mean times until a jump: what is forgotten is 1e-5 of a
    step (EVEN) each time.
    """
    rate = 1.7 / HOUR
    p = np.array([0.31, 0.68, 0.22, 0.55, 0.83, 0.47])
    quiet = np.array([1.0, 0.3, 1.1, 0.94, 0.6, 0.0]) * wait / rate
    found = np.zeros(3, np.float32)
    _looks(p.astype(np.float32), quiet.astype(np.float32), rate, pieces, found)
    assert math.exp(found[0]) == pytest.approx(missed_looks(p, quiet, rate), rel=3e-5)


def test_what_was_heard_is_forgotten_when_next_to_nothing_is_left_of_it() -> None:
    """The step of a look of 0.4 is 1 / 0.6 high: after a time t it is so by 1e-5 of 1 where
    e^(-lambda t) = 0.6e-5.
    """
    rate = 1.7 / HOUR
    for waited, kept in ((11.7, True), (12.3, False)):
        found = np.zeros(3, np.float32)
        _looks(np.array([0.4], np.float32), np.array([waited / rate], np.float32), rate, 1, found)
        assert (found[1] > 1) == kept
