"""A plan where most lies on a beach: it looks for the rest, unless its units see the shore."""

import json
from pathlib import Path

import numpy as np
import pytest
import trial_case
from plans import few_trials  # noqa: F401 (a fixture)

import drift
from drift.planning.search import planner
from drift.planning.search.products import text

pytestmark = pytest.mark.usefixtures("few_trials")

# A current of 1 knot leads east to a shore; all begin within 10 nautical miles of it. After 7 h 70
# % are ashore on 6 nmi of beach, the others on 18 square miles off it.
START = [[0.833333, -0.05], [0.999999, -0.05], [0.999999, 0.05], [0.833333, 0.05]]
HELICOPTER = {
    "name": "helicopter",
    "kind": "Helicopter",
    "base": [1.5, 0.3],
    "search_speed": "60 kn",
    "endurance": "0.3 h",
    "daylight": False,
    "sweep_width": "0.5 nmi",
}
LAND = {"type": "Polygon", "coordinates": [[[1, -2], [2, -2], [2, 2], [1, 2], [1, -2]]]}


def planned(folder: Path, **plan: bool) -> drift.planning.search.records.Plan:
    (folder / "land.geojson").write_text(json.dumps(LAND), encoding="utf-8")
    case = trial_case.load(
        folder,
        start="2026-03-05T00:00Z",
        duration="7.8 h",
        particles=4000,
        uncertainty="none",
        coast={"source": "land.geojson"},
        clock={"step": 1800},
        current={"constant": {"speed": "1 kn", "toward": 90}},
        scenario={"position": None, "area": {"polygon": START}},
        plan={"begin": "+7 h", "particles": 2000, **plan},
        unit=[HELICOPTER],
    )
    return planner.plan(case, folder / "out")[0]


@pytest.mark.thorough
def test_legs_are_spent_on_what_is_afloat(tmp_path: Path) -> None:
    made = planned(tmp_path)
    (task,) = made.taskings
    off = (1 - task.centre[0]) * 60  # [nmi] of its middle off the beach
    assert 0.5 < off < 3.5
    assert made.ashore == pytest.approx(0.7, abs=3 * np.sqrt(0.7 * 0.3 / 4000))
    assert 0 < made.pos <= 1 - made.ashore
    # no more than what lands while the unit is there: it was seen before
    assert made.pos_ashore < 0.3 / 10
    assert not task.sortie.ashore
    words = text.stranded(made)
    assert "this plan covers only objects afloat" in words
    assert " ".join(words.split()[:5]) in " ".join(
        (tmp_path / "out" / "plan.txt").read_text().split()
    )
    # What it is worth is one less the evidence of executing it, as written for the case.
    (tmp_path / "flown.toml").write_text(
        (tmp_path / "case.toml").read_text() + (tmp_path / "out" / "plan.toml").read_text()
    )
    flown = drift.run(drift.load(tmp_path / "flown.toml"))
    assert flown.summary["search"]["cumulative_pos"]["all"] == pytest.approx(made.pos, abs=0.003)


@pytest.mark.thorough
def test_units_that_see_the_shore_are_sent_there(tmp_path: Path) -> None:
    made = planned(tmp_path, ashore=True)
    assert made.pos > 1 - made.ashore  # more than all that is afloat
    assert made.pos_ashore > 0.5 * made.pos
    assert made.taskings[0].pos_ashore == made.pos_ashore
    assert "of the POS is for stranded objects" in text.stranded(made)
