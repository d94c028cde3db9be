"""Drawing particles anew in proportion to their weights: who has how many offspring.

Within a scenario, so that no story dies by chance. Systematic: N offspring, the smallest spread (Kitagawa 1996; Douc,
Cappe and Moulines 2005, arXiv:cs/0507025). Kahn's Russian roulette and splitting (Kahn 1955, RAND P-766): each particle
on its own, so that their number floats; held at N it would be biased. Either way a particle's expected offspring are N
times its share.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from drift.particles import weights
from geo.array import Array
from kernels import noise
from kernels.noise import Purpose

SPARE = 4.0  # slots to spare for Kahn's way, in units of sqrt(N); the spread is at most half of one


def capacity(number: int) -> int:
    """Return how many slots hold the floating number of particles of Kahn's way, aimed at `number`."""
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
    drawn = kahn(weight, number, random.random(len(weight)))
    while len(drawn) > len(weight):  # eight standard deviations above: draw again
        drawn = kahn(weight, number, random.random(len(weight)))
    return drawn


class Method(NamedTuple):
    """A way to resample.

    draw: ancestors, from weights, the number aimed at and random numbers. slots: how many a number of particles needs.
    """

    draw: Callable[[Array, int, np.random.Generator], Array]
    slots: Callable[[int], int]


METHODS = {
    "systematic": Method(
        lambda weight, number, random: systematic(weight, number, random.random()), lambda number: number
    ),
    "kahn": Method(_kahn_that_fits, capacity),
}


def offspring(
    log_weight: Array, scenarios: list[tuple[int, int]], target: list[int], method: str, seeds: tuple[int, int]
) -> tuple[Array, Array, Array]:
    """Return each slot's ancestor, its log weight, and which slots are left over, each (n,).

    A log weight of -inf means that nobody is there. scenarios: first and last slot of each; target: how many particles
    each aims at; seeds: of the run, and number of the event.
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
        new[first : first + len(drawn)] = scale + np.log(total / number)
    return ancestors, new, spare


def generator(seed: int, event: int, scenario: int) -> np.random.Generator:
    """Return the random numbers of one resampling.

    They depend on the run's seed, the event and the scenario alone.
    """
    numbers: np.random.Generator = noise.generator(seed, Purpose.RESAMPLING, event=(event, scenario))
    return numbers
