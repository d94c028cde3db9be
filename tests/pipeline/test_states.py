"""A run reports what has become of its objects: summary.json and the posteriors."""

from pathlib import Path

import numpy as np
import pytest
from changing import KEEL, case, column
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
