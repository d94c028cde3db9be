"""Resampling: the number of offspring of each particle, in proportion to its weight.

Resampling within scenarios keeps every scenario alive. Resampling across scenarios gives the slots
of unlikely scenarios to likely ones; each scenario keeps a few. Three methods exist.

Systematic resampling gives exactly N offspring with the smallest variance (Kitagawa 1996; Douc,
Cappe and Moulines 2005, arXiv:cs/0507025). Kahn's Russian roulette and splitting (Kahn 1955, RAND
P-766) treats each particle independently, so that the number of particles fluctuates; forcing it to
N would introduce bias. In both, a particle's expected offspring are N times its share, and the
expected total weight of its offspring equals its own weight.

Duplication (Borovies 2007, Particle filter based tracking in a detection sparse discrete event
simulation environment, III.B.2) is a heuristic. Particles that searches have all but ruled out are
dropped. Their slots go to copies of the survivors, drawn by weight; copies and originals keep their
weights. A particle of share w with m copies drawn has the expected weight w (1 + m w) before
normalisation. Heavy particles thus gain weight: the result is not the posterior.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drift.engine.particles import weights
from geo.array import Array
from kernels.maths import noise
from kernels.maths.noise import Purpose

LEAST_SHARE = 0.1  # fewest slots of a scenario, as a share of an equal share
# share of a scenario's mean weight below which duplication treats a particle as ruled out
RULED_OUT = 1e-3
SPARE = 4.0  # spare slots for Kahn's method, in sqrt(N); the standard deviation is at most 0.5


def capacity(number: int) -> int:
    """Return the slots needed for the fluctuating number of particles of Kahn's method, aimed at
    `number`.
    """
    return number + int(np.ceil(SPARE * np.sqrt(number))) if number else 0


def systematic(weight: Array, number: int, uniform: float) -> Array:
    """Return the ancestors of `number` offspring, ascending, int64.

    weight: (n,), float64, at least one above 0; uniform: a random number in [0, 1).
    """
    total = np.cumsum(weight)
    points = (np.arange(number) + uniform) * (total[-1] / number)
    ancestors = np.searchsorted(total, points, side="right")
    return np.asarray(np.minimum(ancestors, np.flatnonzero(weight)[-1]))


def kahn(weight: Array, number: int, uniform: Array) -> Array:
    """Return the ancestors of about `number` offspring, ascending, int64.

    weight: as above; uniform: (n,) in [0, 1).
    """
    expected = weight * (number / weight.sum())
    whole = np.floor(expected)
    offspring = whole + (uniform < expected - whole)
    return np.asarray(np.repeat(np.arange(len(weight)), offspring.astype(np.int64)))


def _kahn_that_fits(weight: Array, number: int, random: np.random.Generator) -> Array:
    """Return Kahn's ancestors, drawn again while they exceed the number of slots."""
    drawn = kahn(weight, number, random.random(len(weight)))
    while len(drawn) > len(weight):  # eight standard deviations above: draw again
        drawn = kahn(weight, number, random.random(len(weight)))
    return drawn


def survivors(weight: Array) -> Array:
    """Return which particles of a scenario have more than a negligible weight, bool (n,)."""
    return np.asarray((weight > 0) & (weight >= RULED_OUT * weight.mean()))


def _duplicates(weight: Array, number: int, random: np.random.Generator) -> Array:
    """Return the survivors and, for each particle ruled out, a copy of a survivor drawn by weight;
    ascending.
    """
    left = np.flatnonzero(survivors(weight))
    copies = random.choice(left, number - len(left), p=weight[left] / weight[left].sum())
    return np.sort(np.concatenate([left, copies]))


class Method(NamedTuple):
    """A resampling method.

    draw: returns ancestors from weights, the number aimed at and random numbers. slots: returns the
    slots needed for a number of particles. keeps: whether offspring keep their ancestor's relative
    weight; otherwise all get the same weight. With `keeps` resampling is triggered by the number of
    survivors, otherwise by the effective sample size.
    """

    draw: Callable[[Array, int, np.random.Generator], Array]
    slots: Callable[[int], int]
    keeps: bool = False


DUPLICATES = Method(_duplicates, lambda number: number, keeps=True)
METHODS = {
    "duplicates": DUPLICATES,
    **dict.fromkeys(
        ("position", "course", "combined"), DUPLICATES
    ),  # drift.evidence.filter.filling also repopulates at contacts
    "systematic": Method(
        lambda weight, number, random: systematic(weight, number, random.random()),
        lambda number: number,
    ),
    "kahn": Method(_kahn_that_fits, capacity),
}


def offspring(
    log_weight: Array,
    scenarios: list[tuple[int, int]],
    target: list[int],
    method: str,
    seeds: tuple[int, int],
) -> tuple[Array, Array, Array]:
    """Return each slot's ancestor, its log weight, and which slots are empty, each (n,).

    Args:
        log_weight: of each slot, (n,); -inf marks an empty slot.
        scenarios: slots [first, last) of each scenario.
        target: number of particles aimed at, by scenario.
        method: name in METHODS.
        seeds: the run's seed and the number of the resampling event.
    """
    weight, scale = weights.relative(log_weight), float(log_weight.max())
    ancestors, spare = np.arange(len(log_weight)), np.zeros(len(log_weight), bool)
    new = np.full(len(log_weight), -np.inf, np.float32)
    for scenario, ((first, last), number) in enumerate(zip(scenarios, target, strict=True)):
        own = weight[first:last]
        total = own.sum()
        if total <= 0:
            continue
        random = generator(*seeds, scenario)
        drawn = METHODS[method].draw(own, number, random)
        ancestors[first : first + len(drawn)] = first + drawn
        spare[first + len(drawn) : last] = True
        each = own[drawn] * (total / own[drawn].sum()) if METHODS[method].keeps else total / number
        new[first : first + len(drawn)] = scale + np.log(each)
    return ancestors, new, spare


def resample_across_scenarios(
    log_weight: Array, scenarios: list[tuple[int, int]], number: int, seeds: tuple[int, int]
) -> tuple[Array, Array, tuple[int, ...]]:
    """Return each slot's ancestor and log weight, (n,) each, and the new bounds of the scenarios.

    `counts` gives each scenario its slots, which it fills by systematic resampling of its own
    particles. A particle's expected offspring are the scenario's slots times its share of the
    scenario, and their expected total weight equals its own. A scenario without weight keeps no
    slots.

    Args:
        log_weight: of each slot, (n,).
        scenarios: slots [first, last) of each scenario.
        number: total number of slots, n.
        seeds: the run's seed and the number of the resampling event.
    """
    weight, scale = weights.relative(log_weight), float(log_weight.max())
    totals = np.array([weight[first:last].sum() for first, last in scenarios])
    slots = counts(totals, number)
    bounds = np.concatenate([[0], np.cumsum(slots)])
    ancestors, new = np.empty(number, np.int64), np.empty(number, np.float32)
    for scenario in np.flatnonzero(slots):
        (first, last), (begin, end) = scenarios[scenario], bounds[scenario : scenario + 2]
        uniform = generator(*seeds, int(scenario)).random()
        ancestors[begin:end] = first + systematic(weight[first:last], int(slots[scenario]), uniform)
        new[begin:end] = scale + np.log(totals[scenario] / slots[scenario])
    return ancestors, new, tuple(int(bound) for bound in bounds)


def counts(weight: Array, number: int) -> npt.NDArray[np.int64]:
    """Return the slots of each scenario in proportion to its weight, (scenarios,).

    A scenario with any weight gets at least about LEAST_SHARE of an equal share, and at least one
    slot. number: total slots, at least the number of scenarios that have any weight.
    """
    alive = weight > 0
    share = np.where(alive, np.maximum(weight / weight.sum(), LEAST_SHARE / alive.sum()), 0.0)
    slots = np.diff(np.rint(np.cumsum(share / share.sum()) * number).astype(np.int64), prepend=0)
    for scenario in np.flatnonzero(alive & (slots == 0)):
        slots[np.argmax(slots)] -= 1
        slots[scenario] = 1
    return np.asarray(slots, np.int64)


def generator(seed: int, event: int, scenario: int) -> np.random.Generator:
    """Return the random generator of one scenario in one resampling event.

    It depends only on the run's seed, the event and the scenario.
    """
    numbers: np.random.Generator = noise.generator(
        seed, Purpose.RESAMPLING, event=(event, scenario)
    )
    return numbers
