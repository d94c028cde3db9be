"""A case of which all that spreads is normal, in a uniform flow: areas in closed form."""

import itertools
import math
from collections.abc import Iterable, Sequence

import numpy as np

KNOT, NMI, HOUR = 1852 / 3600, 1852.0, 3600.0
HOURS = 8.0
STD, TIME, BIAS = 0.24, 1.5 * HOUR, 0.11  # of the current
WIND, WIND_STD, WIND_TIME = 21 * KNOT, 2.6, 2.5 * HOUR
WINDAGE, SPREAD = 0.045, 0.011
DIFFUSIVITY = 47.0
ALONG, ACROSS, TURN = 1.4 * NMI, 0.7 * NMI, 35.0
TOWARD = 118.0  # of the wind
CASE = {
    "duration": f"{HOURS:g} h",
    "seed": 7,
    "current": {"constant": {"speed": "0.7 kn", "toward": 215}},
    "wind": {"constant": {"speed": "21 kn", "toward": TOWARD}},
    "clock": {"step": "10 min"},
    "output": {"areas": [50, 95]},
    "uncertainty": {
        "current": {"std": STD, "time": TIME, "bias": BIAS},
        "wind": {"std": WIND_STD, "time": WIND_TIME},
        "diffusivity": f"{DIFFUSIVITY} m2/s",
    },
    "scenario": {
        "object": {"windage": WINDAGE, "spread": SPREAD},
        "position": {
            "at": "43 10N 051 20W",
            "std": [f"{ALONG} m", f"{ACROSS} m"],
            "orientation": TURN,
        },
    },
}


def ornstein_uhlenbeck(std: float, time: float, t: float) -> float:
    """Return the variance of a component of a position after t [s]."""
    return 2 * std**2 * time * (t - time * (1 - math.exp(-t / time)))


def line(angle: float, std: float) -> np.ndarray:
    """Return the covariance of a spread along a direction [deg from north]."""
    unit = np.array([np.sin(np.radians(angle)), np.cos(np.radians(angle))])
    return std**2 * np.outer(unit, unit)


def covariance(sources: Iterable[str], t: float) -> np.ndarray:
    """Return the covariance (east, north) [m2] by some sources after t [s].

    The error of the wind moves each object by its own windage, where both differ.
    """
    on, gusts = set(sources), ornstein_uhlenbeck(WIND_STD, WIND_TIME, t)
    isotropic = {
        "current": ornstein_uhlenbeck(STD, TIME, t) + (BIAS * t) ** 2,
        "wind": WINDAGE**2 * gusts,
        "diffusion": 2 * DIFFUSIVITY * t,
    }
    total = sum(isotropic.get(name, 0.0) for name in on) * np.eye(2)
    if "start" in on:
        total += line(TURN, ALONG) + line(TURN + 90, ACROSS)
    if "leeway" in on:
        total += line(TOWARD, SPREAD * WIND * t)
    if {"leeway", "wind"} <= on:
        total += SPREAD**2 * gusts * np.eye(2)
    return total


def area(share: float, sources: Iterable[str], t: float) -> float:
    """Return the area [m2] that holds a share of the normal distribution by some sources."""
    determinant = max(float(np.linalg.det(covariance(sources, t))), 0.0)
    return 2 * math.pi * -math.log1p(-share) * math.sqrt(determinant)


def shapley(share: float, sources: Sequence[str], t: float) -> dict[str, float]:
    """Return the mean of what each source adds to the area, over every order of the sources."""
    found = dict.fromkeys(sources, 0.0)
    every = list(itertools.permutations(sources))
    for order in every:
        for k, name in enumerate(order):
            added = area(share, order[: k + 1], t) - area(share, order[:k], t)
            found[name] += added / len(every)
    return found
