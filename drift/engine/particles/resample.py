"""Resampling: how many offspring each particle has, in proportion to its weight.

Within a scenario, so that no scenario dies by chance; or across scenarios, where those that have
become likely take slots of the others, of which each keeps a few. Systematic: N offspring, the
smallest spread (Kitagawa 1996; Douc, Cappe and Moulines 2005, arXiv:cs/0507025). Kahn's Russian
roulette and splitting (Kahn 1955, RAND P-766): each particle on its own, so that their number
floats; held at N it would be biased. Either way a particle's expected offspring are N times its
share, and the weights of its offspring add up to its own in the mean.

Duplicates (Borovies 2007, Particle filter based tracking in a detection sparse discrete event
simulation environment, III.B.2) are a heuristic: what searches have all but ruled out is dropped,
and its slots go to copies of the others, drawn by weight, which keep their weight as the originals
keep theirs. So a particle of share w is expected to weigh w (1 + m w) with m copies made, before
all are scaled to what they were together: what is heavy grows, and the posterior is lost.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drift.engine.particles import weights
from geo.array import Array
from kernels.maths import noise
from kernels.maths.noise import Purpose

LEAST_SHARE = 0.1  # least slots of a scenario, as a share of an equal share
# of the mean weight of a scenario: a particle of less is ruled out, by those who duplicate
RULED_OUT = 1e-3
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


def survivors(weight: Array) -> Array:
    """Return which particles of a scenario are not ruled out, bool (n,), by their weights."""
    return np.asarray((weight > 0) & (weight >= RULED_OUT * weight.mean()))


def _duplicates(weight: Array, number: int, random: np.random.Generator) -> Array:
    """Return survivors and as many copies of them, drawn by weight, as there are others; ascending."""
    left = np.flatnonzero(survivors(weight))
    copies = random.choice(left, number - len(left), p=weight[left] / weight[left].sum())
    return np.sort(np.concatenate([left, copies]))


class Method(NamedTuple):
    """A way to resample.

    draw: ancestors, from weights, the number aimed at and random numbers. slots: how many a number
    of particles needs. keeps: whether offspring weigh what their ancestor does, relative to one
    another; else all are alike. It is then done by how many particles survive, not by how many are
    effective.
    """

    draw: Callable[[Array, int, np.random.Generator], Array]
    slots: Callable[[int], int]
    keeps: bool = False


DUPLICATES = Method(_duplicates, lambda number: number, keeps=True)
METHODS = {
    "duplicates": DUPLICATES,
    **dict.fromkeys(
        ("position", "course", "combined"), DUPLICATES
    ),  # besides what drift.evidence.filter.filling does at contacts
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
    """Return each slot's ancestor, its log weight, and which slots are left over, each (n,).

    A log weight of -inf means that nobody is there. scenarios: first and last slot of each; target:
    how many particles each aims at; seeds: of the run, and number of the event.
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


def across(
    log_weight: Array, scenarios: list[tuple[int, int]], number: int, seeds: tuple[int, int]
) -> tuple[Array, Array, tuple[int, ...]]:
    """Return each slot's ancestor, its log weight, (n,) each, and the bounds of the scenarios
    afterwards.

    Scenarios have slots by `counts` and draw systematically, each from its own particles: so a
    particle's offspring are expected to be the number of its scenario's slots times its share of
    the scenario, and weigh as much together as it did. number: of all slots, n; scenarios: first
    and last slot of each; seeds: of the run, and number of the event. A scenario without weight has
    no slots left.
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
    """Return how many of a number of slots each scenario gets, (scenarios,), in proportion to its
    weight.

    None that has any weight gets fewer than about LEAST_SHARE of an equal share, or than one;
    number: at least as many as there are of these.
    """
    alive = weight > 0
    share = np.where(alive, np.maximum(weight / weight.sum(), LEAST_SHARE / alive.sum()), 0.0)
    slots = np.diff(np.rint(np.cumsum(share / share.sum()) * number).astype(np.int64), prepend=0)
    for scenario in np.flatnonzero(alive & (slots == 0)):
        slots[np.argmax(slots)] -= 1
        slots[scenario] = 1
    return np.asarray(slots, np.int64)


def generator(seed: int, event: int, scenario: int) -> np.random.Generator:
    """Return the random numbers of one resampling.

    They depend on the run's seed, the event and the scenario alone.
    """
    numbers: np.random.Generator = noise.generator(
        seed, Purpose.RESAMPLING, event=(event, scenario)
    )
    return numbers
