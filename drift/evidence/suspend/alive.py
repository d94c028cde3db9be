"""Probability of survival, from survival times and the distribution of the time adrift.

Within a scenario, the time of going adrift is taken as independent of the position.
"""

from collections.abc import Sequence

import numpy as np

from drift.engine.motion.scenario import Scenario
from drift.evidence.filter.standing import BINS, SearchStatus
from geo import notation
from geo.array import Array

HOUR = 3600.0  # [s]


def alive_at(
    scenarios: Sequence[Scenario], standing: SearchStatus, time: float
) -> tuple[Array, Array]:
    """Return the probability of being alive at a time, and its standard error.

    A scenario without survival times counts as alive. Where a change of state changes survival, each
    object stays in its present state from the status on.

    Args:
        scenarios: of the case.
        standing: status of the search.
        time: [s after start].

    Returns:
        Probability and standard error, by scenario and of all, both of shape (S + 1,).
    """
    if not any(scenario.survival for scenario in scenarios):
        return np.ones(len(scenarios) + 1), np.zeros(len(scenarios) + 1)
    by_bin = np.ones_like(standing.mass)
    for s, scenario in enumerate(scenarios):
        many = standing.mass.shape[1] // BINS
        for number, survival in enumerate(scenario.survivals[:many]):
            if survival:
                own = slice(number * BINS, (number + 1) * BINS)
                by_bin[s, own] = survival.alive(time - standing.release[s, own])
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
    """Return a scenario's survival times in words, None if it has none."""
    survival = scenario.survival
    if survival is None:
        return None
    spread = notation.number(survival.spread, 3)
    median = f"median {notation.number(survival.median / HOUR, 3)} h"
    text = f"{median}, 68 % between 1/{spread} and {spread} times that ({survival.basis})"
    for one in scenario.changes:
        if one.survival is not None:
            hours = notation.number(one.survival.median / HOUR, 3)
            text += f'; once "{one.name}", median {hours} h'
    if any(one.survival for one in scenario.changes):
        text += "; changes of state still to come are not included"
    return text


def seconds(time: np.datetime64, start: np.datetime64) -> float:
    """Return a time as [s after start]."""
    return float((time - start) / np.timedelta64(1, "s"))
