"""Statistics of all particles at one time, computed in one pass before any map.

`sum_output` sums some particles of an output, and `merge_sums` makes the statistics of all.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from drift.engine.particles import partials, snapshot
from drift.engine.particles.partials import Partial
from drift.engine.particles.snapshot import Deal, Means, Output, mapped
from drift.engine.particles.status import Status, under_way
from drift.forecast import effective
from drift.forecast.effective import Effective
from geo.array import Array
from kernels.step import tally


@dataclass(frozen=True)
class Survey:
    """Statistics of all particles at one time; "on the map" means adrift, under way or at rest."""

    time: np.datetime64
    status: Array  # (statuses,) probability of each
    scenario: Array  # (scenarios,) probability of each
    direction: Array  # (2,) sum of cos and sin of longitudes on the map
    means: Means
    weight: Partial  # of the particles on the map, by block
    lightest: float  # smallest weight on the map; 1 if the map is empty
    heaviest: float
    ashore: bool  # whether any probability on the map is ashore
    steers: bool  # whether any target is under way
    effective: float  # effective particles in all statuses; copies count as one, here and below
    effective_map: float  # on the map
    effective_status: Array  # (statuses,)
    effective_scenario: Array  # (scenarios,) on the map
    spread: float  # effective particles on the map, each copy counted separately
    effective_worlds: float  # on the map; NaN where there are none
    worlds: int  # that were drawn; 0 where there are none


@dataclass(frozen=True)
class SurveySums:
    """Sums over some particles of an output, from which `merge_sums` makes its survey."""

    time: np.datetime64
    sums: Partial  # of kernels.step.tally, by block
    lightest: float
    heaviest: float
    ashore: bool
    steers: bool
    copied: bool  # whether particles have families
    last_world: int  # largest number of a world; -1: none
    # effective particles in all statuses, on the map, of worlds, by status and by scenario
    counts: tuple[Effective, ...]


def survey_outputs(outputs: Sequence[Output], scenarios: int, deal: Deal) -> list[Survey]:
    """Return the statistics of each output.

    Args:
        outputs: the particles at some times.
        scenarios: their number.
        deal: reads the particles.
    """
    question = partial(sum_output, scenarios=scenarios)
    return [merge_sums(parts) for parts in deal(outputs, [question] * len(outputs))]


def survey_output(output: Output, scenarios: int) -> Survey:
    """Return the statistics of an output; scenarios: their number."""
    return merge_sums([sum_output(output, scenarios)])


def sum_output(output: Output, scenarios: int) -> SurveySums:
    """Return the sums over an output's particles; scenarios: their number."""
    parts: list[Partial] = []
    lightest, heaviest, ashore, steers, copied, last_world = 1.0, 0.0, False, False, False, -1
    # only for resampled copies and worlds; without them the sums suffice
    every, shown, worlds = (Effective() for _ in range(3))
    by_status, by_scenario = Effective(len(Status)), Effective(scenarios)
    for part in output.parts():
        blocks, probability = part.blocks, part.probability
        summed = tally.summed(snapshot.swarm(part), np.append(blocks.first, blocks.n))
        parts.append(Partial(scenarios, blocks.scenario, blocks.number, summed.sums[:, None]))
        lightest = min(lightest, summed.lightest.min(initial=1.0))
        heaviest = max(heaviest, summed.heaviest.max(initial=0.0))
        ashore |= bool((probability[part.status == Status.ASHORE] > tally.LEAST).any())
        steers |= bool(under_way(part.status).any())
        if part.family is None and part.world is None:
            continue
        weight = np.where(mapped(part), probability, 0.0)
        if part.family is not None:
            every.add(probability, blocks, family=part.family)
            shown.add(weight, blocks, family=part.family)
            by_status.add(probability, blocks, part.status, part.family)
            by_scenario.add(weight, blocks, part.scenario, part.family)
            copied = True
        if part.world is not None:
            worlds.add(weight, blocks, family=part.world)
            last_world = max(last_world, int(part.world.max()))
    return SurveySums(
        output.time,
        partials.merge_partials(parts),
        float(lightest),
        float(heaviest),
        ashore,
        steers,
        copied,
        last_world,
        (every, shown, worlds, by_status, by_scenario),
    )


def merge_sums(parts: Sequence[SurveySums]) -> Survey:
    """Return the statistics of an output from the sums of all its parts, in their order."""
    whole = partials.merge_partials([part.sums for part in parts])
    joined = zip(*(part.counts for part in parts), strict=True)
    every, shown, worlds, by_status, by_scenario = (own[0].join(own[1:]) for own in joined)
    copied = any(part.copied for part in parts)
    last_world = max(part.last_world for part in parts)
    total, of_scenarios = whole.total[0], whole.by_scenario[:, 0]
    status, squares = total[tally.STATUS].reshape(2, -1)
    spread = effective.of_sums(*total[tally.WEIGHT])
    return Survey(
        time=parts[0].time,
        status=status,
        scenario=of_scenarios[:, 0],
        direction=total[tally.DIRECTION],
        means=snapshot.means(
            replace(whole, sums=whole.sums[:, 0, tally.VECTORS].reshape(-1, 2, 3))
        ),
        weight=replace(whole, sums=whole.sums[:, :, tally.WEIGHT.start][:, :, None]),
        lightest=min(part.lightest for part in parts),
        heaviest=max(part.heaviest for part in parts),
        ashore=any(part.ashore for part in parts),
        steers=any(part.steers for part in parts),
        effective=float(
            every.numbers[0] if copied else effective.of_sums(*total[tally.PROBABILITY])
        ),
        effective_map=float(shown.numbers[0] if copied else spread),
        effective_status=by_status.numbers if copied else effective.of_sums(status, squares),
        effective_scenario=by_scenario.numbers
        if copied
        else effective.of_sums(*of_scenarios[:, tally.WEIGHT].T),
        spread=float(spread),
        effective_worlds=float(worlds.numbers[0]) if last_world >= 0 else np.nan,
        worlds=1 + last_world,
    )
