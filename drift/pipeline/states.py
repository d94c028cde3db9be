"""Shares of the states of the object at the end of a run, of objects that change on the way."""

from collections.abc import Sequence
from typing import Any

from drift.engine.motion import changes
from drift.engine.motion.scenario import UNCHANGED, Scenario
from drift.engine.motion.spool import SnapshotStore
from drift.engine.particles import partials


def summary_of_states(
    snapshots: SnapshotStore, scenarios: Sequence[Scenario]
) -> dict[str, dict[str, float]]:
    """Return the probability of each state at the end of a run, given all evidence.

    Returns:
        By the name of a scenario whose object may change, given that scenario: the probability by
        the name of the state. Those that have sunk are in it.
    """
    most = max(len(scenario.changes) for scenario in scenarios) + 1
    sums = []
    for part in snapshots.outputs[-1].parts():
        (state,) = snapshots.at_end((changes.STATE,), part.blocks.places)
        sums.append(part.blocks.partial(part.probability, code=state.astype(int), many=most))
    shares = partials.merge_partials(sums).by_scenario[..., 0]
    found: dict[str, Any] = {}
    for scenario, own in zip(scenarios, shares, strict=True):
        if scenario.changes and own.sum() > 0:
            names = (UNCHANGED, *(one.name for one in scenario.changes))
            given = (own / own.sum()).tolist()
            found[scenario.name] = dict(zip(names, given, strict=False))
    return found
