"""What each unit moves the POS of sorties by, against differences of POS that a unit's own weight
makes.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from drift.assess.compare import detection
from drift.assess.compare.units import SamplingUnits
from drift.engine.particles.columns import Columns
from drift.engine.particles.partials import Blocks
from drift.evidence.filter.updates import Update

NAMES = ("plane", "boat", "drone")
UNIT = np.array([0, 0, 1, 2, 3, 3, 3, 4])  # of each particle; unit 5 has no offspring any more
WEIGHT = np.array([0.7, 1.3, 0.4, 2.2, 0.9, 0.3, 1.1, 0.6])
MISSED = np.array(
    [[0.9, 0.35, 1.0, 0.5, 0.72, 0.11, 0.88, 0.6], [0.2, 0.95, 0.4, 1.0, 0.31, 0.64, 0.5, 0.9], [0.97, 1, 0.8, 0.7, 1, 0.9, 0.6, 1]]
)  # fmt: skip


def chance(flown: list[int], more: np.ndarray) -> float:
    """Return the probability that any of some sorties finds the object, given that those before the
    first of them have not.

    They are flown one after the other; more: by which each unit's log weight is larger.
    """
    weight = WEIGHT * np.exp(more)[UNIT]
    product = 1.0
    for k in flown:
        before = weight * np.prod(MISSED[:k], axis=0)
        product *= np.sum(before * MISSED[k]) / np.sum(before)
    return float(1 - product)


@pytest.fixture
def log() -> detection.SortieLog:
    blocks = Blocks(UNIT.size, 1, np.zeros(1, int), np.zeros(1, int), np.zeros(1, int))
    log = detection.SortieLog(SamplingUnits(np.zeros(6, int), np.ones(6, bool), worlds=False))
    before = np.log(WEIGHT)
    for name, missed in zip(NAMES, MISSED, strict=True):
        after = before + np.log(missed)
        evidence = np.log(np.exp(after).sum() / np.exp(before).sum())
        columns = Columns.held(
            blocks, {"before": before - 3.0, "after": after + 5.0, "lineage": UNIT}
        )
        log.note(
            Update(
                name,
                "sortie",
                np.datetime64("2026-01-01"),
                np.array([0.0, evidence]),
                np.ones(1),
                9,
                8,
            ),
            columns,
        )
        log.note(
            Update(
                "wreckage",
                "contact",
                np.datetime64("2026-01-01"),
                np.array([0.0, -2.0]),
                np.ones(1),
                9,
                8,
            ),
            columns,
        )
        before = after
    return log


@pytest.mark.parametrize(
    ("quantity", "name", "flown"),
    [
        ("POS", "plane", [0]),
        ("POS", "boat", [1]),
        ("POS", "drone", [2]),
        ("cumulative POS", "all", [0, 1, 2]),
    ],
)
def test_influence_is_what_a_units_weight_moves_the_pos_by(
    log: detection.SortieLog, quantity: str, name: str, flown: list[int]
) -> None:
    """Central differences of 1e-5 err by 1e-10."""
    found = log.figures(NAMES)[quantity, name, "1"]
    assert found.value == pytest.approx(chance(flown, np.zeros(6)), abs=1e-12)
    step = 1e-5 * np.eye(6)
    moved = [(chance(flown, own) - chance(flown, -own)) / 2e-5 for own in step]
    np.testing.assert_allclose(found.influence, moved, atol=1e-9)
    assert np.abs(found.influence).max() > 0.01


def test_a_plan_counts_the_sorties_that_it_has(log: detection.SortieLog) -> None:
    plan = SimpleNamespace(
        taskings=[SimpleNamespace(sortie=SimpleNamespace(name=name)) for name in NAMES[1:]]
    )
    ((key, found),) = detection.pos_of_plan(log, plan).items()
    assert key == ("POS of the next plan", "all", "1")
    assert found.value == pytest.approx(chance([1, 2], np.zeros(6)), abs=1e-12)
    moved = [(chance([1, 2], own) - chance([1, 2], -own)) / 2e-5 for own in 1e-5 * np.eye(6)]
    np.testing.assert_allclose(found.influence, moved, atol=1e-9)


def test_of_no_sortie_there_is_no_pos() -> None:
    assert (
        detection.SortieLog(
            SamplingUnits(np.zeros(2, int), np.ones(2, bool), worlds=False)
        ).figures(())
        == {}
    )
