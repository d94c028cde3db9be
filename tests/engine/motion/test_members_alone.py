"""What drifts in a member moves, to the bit, as it does in a run in that member alone, whatever else there is.

Noise is keyed by the slot, and a member is nothing but winds and currents: so steering, jibes, errors, diffusion, the coast and
debris must not notice it.
"""

import json
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import drift
from drift.assess.verify import along
from drift.case import file as case_file
from drift.engine.motion import simulate
from drift.engine.particles import members
from drift.engine.particles.ensemble import Ensemble
from drift.evidence.filter.filter import SearchFilter
from drift.pipeline import run_setup
from drift.tracking.tracks.records import Track
from geo.array import Array
from geo.errors import UserError

FLOW = ("{ east = 0.5, north = 0.1 }", "{ east = -0.2, north = 0.3 }", "{ east = 0.1, north = -0.6 }")
AIR = ('{ speed = "20 kn", from = 250 }', '{ speed = "12 kn", from = 20 }', '{ speed = "28 kn", from = 140 }')
CASE = """
title = "alone"
start = "2026-03-05T00:00Z"
duration = "18 h"
particles = 600
coast = {{ source = "land.geojson", behaviour = "refloat", half_life = "3 h" }}
domain = {{ west = 2, south = 58, east = 8, north = 62 }}
clock.step = "30 min"
{more}
[uncertainty]
current = {{ std = "0.2 m/s", time = "6 h", bias = "0.05 m/s" }}
wind = {{ std = "2 m/s", time = "12 h" }}
diffusivity = "10 m2/s"
[[current]]
{current}
[[wind]]
{wind}
[[scenario]]
name = "raft"
object = "LIFE-RAFT-DB-10"
position = {{ at = [5.0, 60.0], error = "2 nmi", until = "+2 h" }}
[[scenario]]
name = "vessel"
vessel = {{ currents = "felt" }}
object = "PIW-1"
position = {{ at = [4.6, 60.2], std = "5 nmi" }}
distress = {{ between = ["+5 h", "+12 h"] }}
[[scenario.phase]]
course = {{ course = 63, speed = "4 kn" }}
"""
CONTACT = """
[[contact]]
time = "+16 h"
of = "CONTAINER-2"
position = { at = [5.3, 60.1], error = "20 nmi" }
belief = 0.5
"""


SORTIE = """
[[sortie]]
name = "square"
start = "+3 h"
end = "+8 h"
pattern = { kind = "square", datum = [5.0, 60.05], spacing = "1.5 nmi" }
speed = "10 kn"
sweep_width = "3 nmi"
"""


def moved(folder: Path, current: str, wind: str, more: str = "") -> tuple[Ensemble, SearchFilter | None]:
    """Return the ensemble at the end, and the filter."""
    ring = [[5.6, 59.0], [6.4, 59.0], [6.4, 61.0], [5.6, 61.0], [5.6, 59.0]]
    land = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    (folder / "land.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [land]}))
    (folder / "case.toml").write_text(CASE.format(current=current, wind=wind, more=more))
    case = drift.load(folder / "case.toml")
    begin = run_setup.prepare(case, run_setup.open_for(case))
    search = run_setup.search(case, begin)
    with closing(begin.scene.forcing):
        for _ in simulate.run(begin.ensemble, begin.scene, begin.clock, np.array([18 * 3600]), search=search):
            pass
    return begin.ensemble, search


def typed(constants: tuple[str, ...]) -> str:
    return f"members = [{', '.join(f'{{ constant = {one} }}' for one in constants)}]"


def states(ensemble: Ensemble) -> dict[str, Array]:
    """Return all columns but weights, by name."""
    return {
        name: column.to_numpy() for name, column in ensemble.columns.items() if name not in ("log_weight", "member")
    }


@pytest.mark.parametrize("one_wind", [False, True], ids=["both", "current alone"])
def test_drifting_and_steering_are_those_of_the_member_alone(tmp_path: Path, one_wind: bool) -> None:
    wind = f"constant = {AIR[0]}" if one_wind else typed(AIR)
    together, _ = moved(tmp_path, typed(FLOW), wind)
    member = members.member_of_particles(together)
    assert member is not None
    assert np.bincount(member).tolist() == [200] * 3
    for k, (flow, air) in enumerate(zip(FLOW, AIR, strict=True)):
        alone, _ = moved(tmp_path, f"constant = {flow}", f"constant = {AIR[0] if one_wind else air}")
        for name, values in states(together).items():
            np.testing.assert_array_equal(
                values[member == k], alone.columns[name].to_numpy()[member == k], err_msg=name
            )
    assert len(np.unique(together.status.to_numpy())) > 1  # some have been ashore


def test_debris_drifts_in_the_member_of_its_object(tmp_path: Path) -> None:
    together, search = moved(tmp_path, typed(FLOW), typed(AIR), CONTACT)
    assert search is not None
    (beside,) = search._debris.values()
    member = members.member_of_particles(beside.ensemble)
    assert member is not None
    np.testing.assert_array_equal(member, members.member_of_particles(together))
    for k, (flow, air) in enumerate(zip(FLOW, AIR, strict=True)):
        _, other = moved(tmp_path, f"constant = {flow}", f"constant = {air}", CONTACT)
        assert other is not None
        (alone,) = other._debris.values()
        for name, values in states(beside.ensemble).items():
            own = alone.ensemble.columns[name].to_numpy()
            np.testing.assert_array_equal(values[member == k], own[member == k], err_msg=name)


def test_a_pattern_drifts_with_the_water_of_each_member(tmp_path: Path) -> None:
    """A square about a datum that drifts: each particle is missed as in its member alone, adrift or under way.

    Weights differ by the same prior for all of a scenario: single precision of their logarithms, about 10, twice.
    """
    together, _ = moved(tmp_path, typed(FLOW), typed(AIR), SORTIE)
    member, weight = members.member_of_particles(together), together.log_weight.to_numpy()
    assert member is not None
    seen = np.zeros(3)
    for k, (flow, air) in enumerate(zip(FLOW, AIR, strict=True)):
        alone, _ = moved(tmp_path, f"constant = {flow}", f"constant = {air}", SORTIE)
        for first, last in alone.scenarios:
            own = np.flatnonzero(member[first:last] == k) + first
            lost = alone.log_weight.to_numpy()[own] - alone.log_weight.to_numpy()[own].max()
            assert weight[own] - weight[own].max() == pytest.approx(lost, abs=4e-6)
            seen[k] = max(seen[k], -lost.min())
    assert (seen > 0.2).all()  # it was there in each


def test_drifters_are_compared_with_one_member(tmp_path: Path) -> None:
    text = (
        CASE[: CASE.index('[[scenario]]\nname = "vessel"')]
        .replace("land.geojson", "none")
        .replace(', behaviour = "refloat", half_life = "3 h"', "")
    )
    (tmp_path / "case.toml").write_text(text.format(more="", current=typed(FLOW), wind=typed(AIR)))
    time = np.datetime64("2026-03-05T01:00", "s").astype(np.int64) + 3600 * np.arange(5)
    track = Track("buoy", time, 5.0 + 0.01 * np.arange(5), 60.0 + 0.0 * np.arange(5), {})
    with pytest.raises(UserError, match=r"compared with one current and one wind, not with 3 members"):
        along.compared(case_file.load(tmp_path / "case.toml"), [track], {}, 7200.0, 5.0)
