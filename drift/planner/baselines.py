"""Plans that a plan is compared with, on the same particles: what is done by hand."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from drift.planner import candidates, joint, rectangle
from drift.planner.candidates import Plan, Stage
from drift.planner.records import Alternative
from drift.planner.rectangle import Crew

Array = npt.NDArray[Any]

SIZES = np.geomspace(0.4, 3.0, 12)  # of the square's side, in roots of the area that would be swept


def by_hand(crews: Sequence[Crew], stage: Stage, whole: Stage) -> list[tuple[str, Plan]]:
    """Return the plan of manuals: one square round the mean position, cut into strips by effort, of the best size for that."""
    able, times = [], []
    for crew in crews:
        start, duration = crew.reach.slot(crew.reach.arrival(crew.plane.lon, crew.plane.lat))
        if duration >= rectangle.SHORTEST:
            able.append((crew, float(duration) * crew.unit.search_speed))
            times.append(float(start - crew.zero + duration / 2))
    if not able:
        return []
    edges = stage.swarm.time.shape[0]
    middle = int(np.clip(np.searchsorted(stage.swarm.time, np.mean(times)), 0, edges - 1))
    x, y = (float(stage.weight @ v.reshape(stage.m, edges)[:, middle]) for v in (stage.swarm.x, stage.swarm.y))
    effort = np.array([crew.widest * track for crew, track in able])
    sizes = []
    for size in np.sqrt(effort.sum()) * SIZES:
        strips, west = [], x - size / 2
        for (crew, track), share in zip(able, effort / effort.sum(), strict=True):
            wide = size * share
            legs = max(math.floor((track + wide) / size), 1)
            spacing = max(wide / legs, crew.unit.least_spacing, 1.0)
            row = np.array(
                [west + wide / 2, y, 0.0, math.log(spacing), math.log(track / legs / (legs * spacing)), 0.0, -1.0, -1.0]
            )
            strips.append(candidates.choose(crew, row, stage))
            west += wide
        made: Plan = [choice if choice.flown.possible[0] else None for choice in strips]
        sizes.append((candidates.value(made, stage), made))
    return [
        (
            "one square round the mean position, shared out by effort",
            candidates.moved(max(sizes, key=lambda one: one[0])[1], whole),
        )
    ]


def against(name: str, rival: Plan, gain: Array, weight: Array, nodes: Array) -> Alternative:
    """Return another plan beside what this one finds of each particle."""
    finds = [choice.find for choice in rival if choice is not None]
    other = joint.worth(finds, nodes) if finds else np.zeros_like(gain)
    difference = float(weight @ (gain - other))
    error = math.sqrt(float(weight**2 @ (gain - other - difference) ** 2))
    return Alternative(name, float(weight @ other), difference, error)
