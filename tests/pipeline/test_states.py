"""A run reports what has become of its objects: summary.json and the posteriors."""

from pathlib import Path

import numpy as np
import pytest
from changing import KEEL, case, column, within
from filtered import run, weights

import drift

CHANGES = [
    {"name": "capsized", "rate": "0.4/h", "leeway": 0.5},
    {"name": "sunk", "from": "capsized", "rate": "0.6/h", "sinks": True},
]
CONTACT = """
[[contact]]
name = "hull"
time = "+3 h"
state = "capsized"
belief = 0.6
[contact.position]
at = "27 35N 087 48W"
error = "6 nmi"
[[scenario]]
name = "stays"
object = "water"
weight = 0.3
position = { at = "27 30N 088 00W", std = "2 nmi" }
"""


def test_shares_of_states_given_all_evidence(tmp_path: Path) -> None:
    """By hand from the particles of the filter: only of the scenario whose object may change."""
    own = case(tmp_path, CHANGES, CONTACT, scenario={"object": KEEL}, particles=1500)
    _, ensemble, _ = run(own)
    result = drift.run(own)
    first = column(ensemble, "scenario") == 0
    weight, state = weights(ensemble)[first], column(ensemble, "state")[first]
    shares = np.bincount(state.astype(int), weight, 3) / weight.sum()
    ((name, found),) = result.summary["states"].items()
    assert name == "raft"
    assert found == pytest.approx(
        dict(zip(("unchanged", "capsized", "sunk"), shares, strict=True)), abs=1e-6
    )
    (told,) = [one for one in result.posteriors.told if one.quantity.name == "state"]
    assert told.labels == ("unchanged", "capsized", "sunk")


@pytest.mark.parametrize("step", ["10 min", "1 h"])
def test_states_are_those_at_the_time_also_within_a_step(tmp_path: Path, step: str) -> None:
    """At the end of a run, and after a contact that says only that it floats then: no change counts
    that comes between then and the end of the step. By the closed form, and as sunk on the map.
    """
    seen = (
        '[[contact]]\nname = "vague"\ntime = "+130 min"\n'
        '[contact.position]\nat = "27 30N 088 00W"\nerror = "500 nmi"'
    )
    changes = [
        {"name": "capsized", "rate": "0.5/h", "leeway": 1},
        {"name": "sunk", "from": ["unchanged", "capsized"], "rate": "0.3/h", "sinks": True},
    ]
    tables = {"start": "2026-11-21T00:17Z", "duration": "3 h", "clock": {"step": step}}
    own = case(tmp_path, changes, seen, scenario={"object": KEEL}, particles=8000, **tables)
    result = drift.run(own)
    found = result.summary["states"]["raft"]
    assert found["sunk"] == pytest.approx(result.summary["account"]["sunk"], abs=1e-4)
    floats = round(8000 * np.exp(-0.3 * 130 / 60))
    assert within(found["sunk"], 1 - np.exp(-0.3 * 50 / 60), floats)
    assert within(found["unchanged"], np.exp(-0.5 * 3 - 0.3 * 50 / 60), floats)
    (number,) = [k for k, one in enumerate(result.posteriors.told) if one.quantity.name == "state"]
    table = result.posteriors.stages[1].marginals[number].table
    assert within(table[-1, 1], 1 - np.exp(-0.5 * 130 / 60), floats)
