"""Changes of state of objects that strand on the way, and leeway lines of changes after resampling."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from changing import HOUR, HULL, KEEL, column, end_of

from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.status import Status

# The raft starts 1.8 nmi west of this land, and strands after 57 min.
LAND = [[-87.95, 26.0], [-86.0, 26.0], [-86.0, 29.0], [-87.95, 29.0], [-87.95, 26.0]]
NEAR = {"position": {"at": "27 30N 087 58W", "std": "1 m"}}
STAYS = {"source": "land.geojson"}
LEAVES = {"source": "land.geojson", "behaviour": "refloat", "half_life": "2 h"}


def stranded(
    folder: Path, changes: list[dict[str, Any]], coast: dict[str, str], **tables: Any
) -> Ensemble:
    """Return the particles at the end of a run towards the shore."""
    shape = {"type": "Polygon", "coordinates": [LAND]}
    (folder / "land.geojson").write_text(json.dumps(shape))
    return end_of(folder, changes, coast=coast, scenario=NEAR, particles=1500, **tables)


@pytest.mark.thorough
@pytest.mark.parametrize("law", [{}, {"wind": "16 m/s"}, {"sinks": True}], ids=str)
def test_a_stranded_object_stays_as_it_is_at_any_step(tmp_path: Path, law: dict[str, Any]) -> None:
    """No change comes after the stranding, be it in the same step; nothing sinks ashore."""
    change = {"name": "changed", "rate": "1/h", **law}
    fine, coarse = (
        stranded(tmp_path, [change], STAYS, duration="2 h", clock={"step": step})
        for step in ("3 min", "1 h")
    )
    for ensemble in (fine, coarse):
        came, state = column(ensemble, "changed_1"), column(ensemble, "state")
        ashore = column(ensemble, "status") == Status.ASHORE
        assert ashore.sum() > 200
        assert (np.minimum(came, 1e9)[ashore & (state == 1)] <= 3470).all()
        assert ((came > 1e9) == (state == 0)).all()
        sank = column(ensemble, "status") == Status.SUNK
        assert (sank == ((state == 1) & law.get("sinks", False))).all()
    # a particle that is due within the seconds in which the strandings differ may go either way
    assert (column(fine, "state") != column(coarse, "state")).mean() < 0.01


@pytest.mark.thorough
def test_a_rate_counts_only_the_time_adrift(tmp_path: Path) -> None:
    """A raft strands, refloats in a current off the shore, and capsizes at a rate: later by just as
    long as it was ashore. The state "afloat again", due while it is ashore, notes when it refloats.
    """
    rate = {"name": "capsized", "from": ["unchanged", "afloat again"], "rate": "0.25/h"}
    changes = [{"name": "afloat again", "at": "+100 min"}, rate]
    table = [
        {"time": time, "speed": speed, "toward": 270}
        for time, speed in (("+0 h", "0 kn"), ("+1 h", "0 kn"), ("+2 h", "3 kn"), ("+9 h", "3 kn"))
    ]
    tables = {"duration": "9 h", "clock": {"step": "20 min"}, "current": {"table": table}}
    ensemble = stranded(tmp_path, changes, LEAVES, **tables)
    begin = column(stranded(tmp_path, [], STAYS, duration="2 h"), "status_since")
    wait = column(end_of(tmp_path, changes, duration="48 h", particles=1500), "changed_2")
    refloats, came = column(ensemble, "changed_1"), column(ensemble, "changed_2")
    again = (refloats > 100 * 60) & (refloats < 9 * HOUR) & (wait > begin)
    assert again.sum() > 500
    wanted = (wait + refloats - begin)[again]
    # whole seconds: of the stranding, which depends on the step, and of the change
    near = 20
    within = wanted < 9 * HOUR - near
    assert (came[again][wanted > 9 * HOUR + near] > 1e9).all()
    assert np.abs(came[again][within] - wanted[within]).max() <= near


@pytest.mark.thorough
def test_no_two_objects_have_the_same_new_lines_after_resampling(tmp_path: Path) -> None:
    """A copy that changes draws lines of its own: not those of the particle that had its slot."""
    seen = (
        '[[contact]]\nname = "seen"\ntime = "+3 h"\n'
        '[contact.position]\nat = "27 33N 087 54W"\nerror = "1.3 nmi"'
    )
    change = {"name": "in the water", "rate": "0.35/h", "object": "PIW-1"}
    ensemble = end_of(tmp_path, [change], seen, resampling={"below": 0.95})
    came, slope = column(ensemble, "changed_1"), column(ensemble, "down_slope")
    early, late = came < 3 * HOUR, (came > 3 * HOUR) & (came < 1e9)
    assert len(np.unique(slope[early])) < 0.8 * early.sum()  # it was resampled
    assert late.sum() > 500
    assert not np.isin(slope[late], slope[early]).any()
    assert len(np.unique(slope[late])) == late.sum()


def test_lines_are_those_of_the_state_in_which_it_stranded(tmp_path: Path) -> None:
    """A raft that would have capsized in the rest of its step refloats keel down."""
    change = {"name": "capsized", "rate": "0.8/h", "object": HULL}
    ensemble = stranded(tmp_path, [change], STAYS, duration="2 h", clock={"step": "1 h"})
    state, slope = column(ensemble, "state"), column(ensemble, "down_slope")
    assert KEEL["downwind"]["slope"] == "3 %"
    np.testing.assert_allclose(slope, np.where(state == 1, 0.011, 0.03), rtol=1e-6)
