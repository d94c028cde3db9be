"""What is known of all particles at a time: one pass over them, part by part, before any map is made."""

from dataclasses import dataclass

import numpy as np

from drift.forecast.effective import Effective
from drift.particles import partials, snapshot
from drift.particles.partials import Partial
from drift.particles.snapshot import Means, Output, mapped
from drift.particles.status import Status, under_way
from geo import sphere
from geo.array import Array


@dataclass(frozen=True)
class Survey:
    """All particles at a time in figures. What is on the map is adrift, under way or at rest."""

    time: np.datetime64
    status: Array  # (statuses,) probability of each
    scenario: Array  # (scenarios,) probability of each
    direction: Array  # (2,) sum of cos and sin of longitudes on the map
    means: Means
    weight: Partial  # of what is on the map, by block
    lightest: float  # weight on the map; 1 where nothing is
    heaviest: float
    ashore: bool  # whether anything on the map is
    steers: bool  # whether any target is under way
    effective: float  # particles that count, in all statuses; copies count as one, here and below
    effective_map: float  # on the map
    effective_status: Array  # (statuses,)
    effective_scenario: Array  # (scenarios,) on the map
    spread: float  # particles that count on the map, copies each by itself
    effective_worlds: float  # on the map; NaN where there are none
    worlds: int  # that were drawn; 0 where there are none


def of(output: Output, scenarios: int) -> Survey:
    """Return the survey of an output."""
    tables: dict[str, list[Partial]] = {name: [] for name in ("status", "scenario", "direction", "means", "weight")}
    every, shown, alone, worlds = (Effective() for _ in range(4))
    by_status, by_scenario = Effective(len(Status)), Effective(scenarios)
    lightest, heaviest, ashore, steers, copied, last_world = 1.0, 0.0, False, False, False, -1
    for part in output.parts():
        blocks, probability, there = part.blocks, part.probability, mapped(part)
        weight = np.where(there, probability, 0.0)
        lon = part.lon * sphere.UNIT
        tables["status"].append(blocks.partial(probability, code=part.status, many=len(Status)))
        tables["scenario"].append(blocks.partial(probability, code=part.scenario, many=scenarios))
        tables["direction"].append(blocks.partial(weight * np.cos(lon), weight * np.sin(lon)))
        tables["means"].append(snapshot.vectors(part, scenarios))
        tables["weight"].append(blocks.partial(weight))
        every.add(probability, blocks, family=part.family)
        shown.add(weight, blocks, family=part.family)
        by_status.add(probability, blocks, part.status, part.family)
        by_scenario.add(weight, blocks, part.scenario, part.family)
        if part.family is not None:
            alone.add(weight, blocks)
            copied = True
        if part.world is not None:
            worlds.add(weight, blocks, family=part.world)
            last_world = max(last_world, int(part.world.max()))
        if there.any():
            lightest = min(lightest, float(probability[there].min()))
            heaviest = max(heaviest, float(weight.max()))
        ashore |= bool((there & (part.status == Status.ASHORE)).any())
        steers |= bool(under_way(part.status).any())
    sums = {name: partials.merged(parts) for name, parts in tables.items()}
    return Survey(
        output.time, sums["status"].total[:, 0], sums["scenario"].total[:, 0], sums["direction"].total[0],
        snapshot.means(sums["means"]), sums["weight"], lightest, heaviest, ashore, steers,
        float(every.numbers[0]), float(shown.numbers[0]), by_status.numbers, by_scenario.numbers,
        float((alone if copied else shown).numbers[0]), float(worlds.numbers[0]) if last_world >= 0 else np.nan, 1 + last_world,
    )  # fmt: skip
