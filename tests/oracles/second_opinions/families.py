"""Exact Bayes for ships that go north along meridians: routes x speeds x times of departure, in
closed form and NumPy alone.

A ship of a scenario goes from the latitude SOUTH along its route's meridian at a speed that is
uniform in the scenario's range, at a distance east of the meridian that is normal. What sensors say
is a product of factors a + b 1{east of the meridian in X} 1{speed in V}, so that means of products
are sums over subsets of the factors, of probabilities of intersections of intervals. It is all near
the equator: what a plane makes of it errs by 3e-4 of a distance.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np

RADIUS, NMI, HOUR = 6_371_008.8, 1852.0, 3600.0
DEGREE = math.radians(1) * RADIUS / NMI  # [nmi]
SOUTH, NORTH = -1.3, 1.7  # [deg]
ROUTES = np.arange(10)
MERIDIANS = 179.2 + 0.17 * ROUTES  # [deg] across 180
SHARES = (10.0 + 3.0 * ROUTES) / np.sum(10.0 + 3.0 * ROUTES)
SPEEDS = np.linspace(6.0, 15.0, 7)  # [kn] ends of six ranges
DEPARTURES = np.linspace(0.0, 8.0, 5)  # [h]
SPREAD = 4.0  # [nmi] cross-track
STORIES = list(itertools.product(range(10), range(6), range(5)))
PRIOR = np.array([SHARES[route] / 30 for route, _, _ in STORIES])

BARRIER = (7.0, 12.5, 0.8)  # along the equator: from, to [h], detection; silent
LOOK = (
    (179.62, -0.35),
    26.0,
    34.0,
    6.0,
    0.9,
)  # at, width, height [nmi], time [h], alpha; sees nothing, everywhere alike
PLOT = ((180.31, 0.62), 44.0, 40.0, 13.0, 0.85, 0.04)  # the same and false alarms; sees something


@dataclass(frozen=True)
class Factor:
    """a + b where a ship is in two intervals: east of its meridian [nmi], and of its speed [kn]."""

    a: float
    b: float
    east: tuple[float, float]
    speed: tuple[float, float]


def normal(low: float, high: float) -> float:
    """Return the probability of an interval east of the meridian."""
    a, b = (math.erf(x / SPREAD / math.sqrt(2)) for x in (low, high))
    return max(b - a, 0.0) / 2


def speeds(distance: float, first: float, last: float) -> tuple[float, float]:
    """Return by which speeds a distance [nmi] is covered after the first and before the last of two
    durations [h].
    """
    return distance / last if last > 0 else math.inf, distance / first if first > 0 else math.inf


def _field(
    at: tuple[float, float], width: float, height: float, after: float, meridian: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the intervals in which a ship is in a box, so long after its departure [h]."""
    middle = (at[0] - meridian) * DEGREE * math.cos(math.radians(at[1]))
    along = (at[1] - SOUTH) * DEGREE
    low, high = ((along + half) / after for half in (-height / 2, height / 2))
    return (middle - width / 2, middle + width / 2), (low, high)


def factors(story: tuple[int, int, int]) -> list[Factor]:
    """Return what the three sensors say of a ship of a story, in their order: look, barrier, plot."""
    meridian, departure = float(MERIDIANS[story[0]]), float(DEPARTURES[story[2]])
    at, width, height, time, alpha = LOOK
    look = (
        Factor(1.0, -alpha, *_field(at, width, height, time - departure, meridian))
        if time > departure
        else Factor(1.0, 0.0, (0, 0), (0, 0))
    )
    begin, end, detection = BARRIER
    crossed = speeds(-SOUTH * DEGREE, begin - departure, end - departure)
    barrier = Factor(1.0, -detection, (-math.inf, math.inf), crossed)
    at, width, height, time, alpha, false = PLOT
    plot = Factor(
        false, (1 - false) * alpha, *_field(at, width, height, time - departure, meridian)
    )
    return [look, barrier, plot]


def mean(story: tuple[int, int, int], some: list[Factor]) -> float:
    """Return the mean of a product of factors over the ships of a scenario."""
    low, high = (float(SPEEDS[story[1] + k]) for k in (0, 1))
    total = 0.0
    for chosen in itertools.product((False, True), repeat=len(some)):
        own = [one for one, taken in zip(some, chosen, strict=True) if taken]
        weight = math.prod(
            one.b if taken else one.a for one, taken in zip(some, chosen, strict=True)
        )
        east = (
            max([-math.inf, *(f.east[0] for f in own)]),
            min([math.inf, *(f.east[1] for f in own)]),
        )
        speed = (max([low, *(f.speed[0] for f in own)]), min([high, *(f.speed[1] for f in own)]))
        total += weight * normal(*east) * max(speed[1] - speed[0], 0.0) / (high - low)
    return total


def squared(one: Factor) -> Factor:
    """Return the square of a factor."""
    return Factor(one.a**2, 2 * one.a * one.b + one.b**2, one.east, one.speed)


def exact(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and variance of the likelihood of the first sensors, each (scenarios,)."""
    means = np.array([mean(story, factors(story)[:count]) for story in STORIES])
    squares = np.array(
        [mean(story, [squared(one) for one in factors(story)[:count]]) for story in STORIES]
    )
    return means, squares - means**2


def posterior(means: np.ndarray) -> np.ndarray:
    """Return the probability of each scenario."""
    weights = PRIOR * means
    return weights / weights.sum()


def error(means: np.ndarray, variances: np.ndarray, drawn: np.ndarray, value: np.ndarray) -> float:
    """Return the standard error of the mean of a value of scenarios, by a run of so many particles
    of each (delta method).

    value: (scenarios,), 1 where a scenario counts, else 0.
    """
    weights = PRIOR * means
    off = value - (weights @ value) / weights.sum()
    return float(np.sqrt(np.sum(PRIOR**2 * variances * off**2 / drawn)) / weights.sum())


def case(particles: int, *, below: float = 0.0) -> str:
    """Return the case file of all this: 300 scenarios of one family."""
    routes = "\n".join(
        f'"{lon:.2f}" = [[{lon:.2f}, {SOUTH}], [{lon:.2f}, {NORTH}]]' for lon in MERIDIANS
    )

    def box(sensor: tuple) -> str:
        at, width, height, time = sensor[:4]
        return (
            f'time = "+{time} h"\nat = {list(at)}\nwidth = "{width} nmi"\nheight = "{height} nmi"\n'
        )

    return f"""
title = "300 stories"
start = "2026-11-21T00:00Z"
duration = "14 h"
particles = {particles}
seed = 20
clock.step = "30 min"
output.times = ["+14 h"]
coast.source = "none"
resampling = {{ below = {below}, across_scenarios = {str(below > 0).lower()} }}
[[family]]
name = "north"
scenario.phase = [{{ voyage = {{ cross_track = "{SPREAD} nmi" }} }}]
axis.speed = {{ key = "phase.1.voyage.speed", from = "{SPEEDS[0]:g} kn", to = "{SPEEDS[-1]:g} kn", ranges = 6 }}
axis.departure = {{ key = "phase.1.voyage.departure", from = "+0 h", to = "+8 h", count = 5 }}
[family.axis.route]
key = "phase.1.voyage.waypoints"
weights = {(10 + 3 * ROUTES).tolist()}
[family.axis.route.values]
{routes}
[[look]]
name = "look"
sees = "nothing"
law = {{ table = [[0, {LOOK[4]}], [1, {LOOK[4]}]] }}
{box(LOOK)}[[barrier]]
name = "equator"
points = [[178.5, 0.0], [-178.5, 0.0]]
start = "+{BARRIER[0]} h"
end = "+{BARRIER[1]} h"
detection = {BARRIER[2]}
[[look]]
name = "plot"
sees = "something"
law = {{ table = [[0, {PLOT[4]}], [1, {PLOT[4]}]] }}
false_alarms = {PLOT[5]}
{box(PLOT)}"""
