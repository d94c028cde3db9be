"""Alternative plans to compare with, among them the one that manuals make by hand."""

import math
from collections.abc import Sequence

import numpy as np

from drift.planning.search import candidates, joint
from drift.planning.search.candidates import Plan, Stage
from drift.planning.search.records import Alternative
from drift.planning.search.rectangle import Crew
from geo.array import Array

# sides of the square that are tried, as multiples of the root of the swept area
SIZES = np.geomspace(0.4, 3.0, 12)


def by_hand(crews: Sequence[Crew], stage: Stage) -> list[tuple[str, Plan]]:
    """Return the plan of manuals: one square about the mean position, divided into strips.

    The widths of the strips are proportional to the units' effort. The best of several sizes is
    taken.
    """
    able, times = [], []
    for crew in crews:
        start, duration = crew.available.slot(
            crew.available.arrival(crew.plane.lon, crew.plane.lat)
        )
        if duration >= crew.shortest:
            able.append((crew, float(duration) * crew.unit.search_speed))
            times.append(float(start - crew.zero + duration / 2))
    if not able:
        return []
    edges = stage.swarm.time.shape[0]
    middle = int(np.clip(np.searchsorted(stage.swarm.time, np.mean(times)), 0, edges - 1))
    x, y = (
        float(stage.weight @ stage.swarm.at_edges(v)[middle])
        for v in (stage.swarm.x, stage.swarm.y)
    )
    effort = np.array([crew.widest * track for crew, track in able])
    sizes = []
    for size in np.sqrt(effort.sum()) * SIZES:
        strips, west = [], x - size / 2
        for (crew, track), share in zip(able, effort / effort.sum(), strict=True):
            strip_width = size * share
            legs = max(math.floor((track + strip_width) / size), 1)
            spacing = max(strip_width / legs, crew.unit.least_spacing, 1.0)
            aspect = math.log(track / legs / (legs * spacing))
            row = np.array(
                [west + strip_width / 2, y, 0.0, math.log(spacing), aspect, 0.0, -1.0, -1.0]
            )
            strips.append(candidates.choose(crew, row, stage))
            west += strip_width
        strips_plan: Plan = [choice if choice.flown.possible[0] else None for choice in strips]
        sizes.append((candidates.value(strips_plan, stage), strips_plan))
    best = max(sizes, key=lambda candidate: candidate[0])[1]
    return [("one square round the mean position, shared out by effort", best)]


def alternative(name: str, other_plan: Plan, gain: Array, stage: Stage) -> Alternative:
    """Return how another plan scores beside this one.

    Args:
        name: of the other plan.
        other_plan: a choice for each unit.
        gain: worth of what this plan finds of each particle, shape (m,).
        stage: particles on which both are scored.
    """
    finds = [choice.find for choice in other_plan if choice is not None]
    other_gain = joint.worth(finds, stage.nodes) if finds else np.zeros_like(gain)
    difference = float(stage.weight @ (gain - other_gain))
    error = math.sqrt(float(stage.weight**2 @ (gain - other_gain - difference) ** 2))
    return Alternative(
        name,
        float(stage.weight @ other_gain),
        difference,
        error,
        candidates.apart(other_plan, stage),
    )
