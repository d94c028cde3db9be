"""How likely somebody adrift is still alive, from survival times and when he may have gone adrift.

Within a scenario, the time of going adrift is taken to say nothing of where the object is.
"""

from collections.abc import Sequence

import numpy as np

from drift.engine.motion.scenario import Scenario
from drift.evidence.filter.standing import Standing
from geo import notation
from geo.array import Array

HOUR = 3600.0  # [s]


def alive_at(scenarios: Sequence[Scenario], standing: Standing, time: float) -> tuple[Array, Array]:
    """Return the probability of being alive at a time by scenario and of all, and its standard
    error.

    time: [s after start]. Both have shape (S + 1,). A scenario without survival times counts as
    alive.
    """
    if not any(scenario.survival for scenario in scenarios):
        return np.ones(len(scenarios) + 1), np.zeros(len(scenarios) + 1)
    by_bin = np.ones_like(standing.mass)
    for s, scenario in enumerate(scenarios):
        if scenario.survival:
            by_bin[s] = scenario.survival.alive(time - standing.release[s])
    chance, error = np.ones(len(scenarios) + 1), np.zeros(len(scenarios) + 1)
    for s in range(len(scenarios) + 1):
        of_all = s == len(scenarios)
        mass, alive = (
            (standing.mass.ravel(), by_bin.ravel()) if of_all else (standing.mass[s], by_bin[s])
        )
        if mass.sum() > 0:
            chance[s] = mass @ alive / mass.sum()
            variance = mass @ (alive - chance[s]) ** 2 / mass.sum()
            error[s] = np.sqrt(variance / max(standing.effective * mass.sum(), 1.0))
    return chance, error


def basis(scenario: Scenario) -> str | None:
    """Return a scenario's survival times in words, None where it has none."""
    survival = scenario.survival
    if survival is None:
        return None
    spread = notation.number(survival.spread, 3)
    median = f"median {notation.number(survival.median / HOUR, 3)} h"
    return f"{median}, 68 % between 1/{spread} and {spread} times that ({survival.basis})"


def seconds(time: np.datetime64, start: np.datetime64) -> float:
    """Return a time as [s after start]."""
    return float((time - start) / np.timedelta64(1, "s"))
