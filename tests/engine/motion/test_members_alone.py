"""What drifts in a member moves, to the bit, as it does in a run in that member alone, whatever
else there is.

Noise is keyed by the slot, and a member is nothing but winds and currents: so steering, jibes,
errors, diffusion, the coast and debris must not notice it.
"""

import json
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
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

FLOW = (
    "{ east = 0.5, north = 0.1 }",
    "{ east = -0.2, north = 0.3 }",
    "{ east = 0.1, north = -0.6 }",
)
AIR = (
    '{ speed = "20 kn", from = 250 }',
    '{ speed = "12 kn", from = 20 }',
    '{ speed = "28 kn", from = 140 }',
)
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


RAFT = (
    CASE[: CASE.index('[[scenario]]\nname = "vessel"')]
    .replace("land.geojson", "none")
    .replace(', behaviour = "refloat", half_life = "3 h"', "")
)
SORTIE = """
[[sortie]]
name = "square"
start = "+3 h"
end = "+8 h"
pattern = { kind = "square", datum = [5.0, 60.05], spacing = "1.5 nmi" }
speed = "10 kn"
sweep_width = "3 nmi"
"""


@dataclass(frozen=True)
class Run:
    """The ensemble at the end, logs of weights after the sortie and before the contact, and the
    filter.
    """

    ensemble: Ensemble
    searched: Array
    search: SearchFilter | None


def moved(folder: Path, current: str, wind: str, more: str = "", text: str = CASE) -> Run:
    """Return a run of a case."""
    ring = [[5.6, 59.0], [6.4, 59.0], [6.4, 61.0], [5.6, 61.0], [5.6, 59.0]]
    land = {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    (folder / "land.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": [land]})
    )
    (folder / "case.toml").write_text(text.format(current=current, wind=wind, more=more))
    case = drift.load(folder / "case.toml")
    begin = run_setup.prepare(case, run_setup.open_for(case))
    search = run_setup.build_search_filter(case, begin)
    with closing(begin.scene.forcing):
        times = np.array([10 * 3600, 18 * 3600])
        after, _ = simulate.run(begin.ensemble, begin.scene, begin.clock, times, search=search)
    return Run(begin.ensemble, after.log_weight, search)


def typed(constants: tuple[str, ...]) -> str:
    return f"members = [{', '.join(f'{{ constant = {one} }}' for one in constants)}]"


def states(ensemble: Ensemble) -> dict[str, Array]:
    """Return all columns but weights, by name."""
    return {
        name: column.to_numpy()
        for name, column in ensemble.columns.items()
        if name not in ("log_weight", "member")
    }


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, list[Run]]:
    """Return the run in all members, and those in each member alone, with debris and a pattern."""
    folder = tmp_path_factory.mktemp("members")
    each = [
        moved(folder, f"constant = {f}", f"constant = {a}", SORTIE + CONTACT)
        for f, a in zip(FLOW, AIR, strict=True)
    ]
    return moved(folder, typed(FLOW), typed(AIR), SORTIE + CONTACT), each


def same_as_alone(together: Ensemble, alone: Sequence[Ensemble]) -> None:
    """Assert that each particle ends as it does in its member alone."""
    member = members.member_of_particles(together)
    assert member is not None
    assert np.bincount(member).tolist() == [200] * 3
    for k, one in enumerate(alone):
        for name, values in states(together).items():
            np.testing.assert_array_equal(
                values[member == k], one.columns[name].to_numpy()[member == k], err_msg=name
            )


@pytest.mark.thorough
def test_drifting_and_steering_are_those_of_the_member_alone(runs: tuple[Run, list[Run]]) -> None:
    together, alone = runs
    same_as_alone(together.ensemble, [run.ensemble for run in alone])
    assert len(np.unique(together.ensemble.status.to_numpy())) > 1  # some have been ashore


@pytest.mark.thorough
def test_members_of_the_current_alone(tmp_path: Path) -> None:
    alone = [
        moved(tmp_path, f"constant = {flow}", f"constant = {AIR[0]}").ensemble for flow in FLOW
    ]
    same_as_alone(moved(tmp_path, typed(FLOW), f"constant = {AIR[0]}").ensemble, alone)


@pytest.mark.thorough
def test_debris_drifts_in_the_member_of_its_object(runs: tuple[Run, list[Run]]) -> None:
    found = []
    for run in (runs[0], *runs[1]):
        assert run.search is not None
        (beside,) = run.search._debris.values()
        found.append(beside.ensemble)
    same_as_alone(found[0], found[1:])
    member = members.member_of_particles(found[0])
    np.testing.assert_array_equal(member, members.member_of_particles(runs[0].ensemble))


@pytest.mark.parametrize(
    "scenarios", ["raft", pytest.param("raft and vessel", marks=pytest.mark.thorough)]
)
def test_a_pattern_drifts_with_the_water_of_each_member(tmp_path: Path, scenarios: str) -> None:
    """A square about a datum that drifts: each particle is missed as in its member alone, adrift or
    under way.

    Weights differ by the same prior for all of a scenario: single precision of their logarithms,
    about 10, twice.
    """
    text = CASE if scenarios == "raft and vessel" else RAFT
    together = moved(tmp_path, typed(FLOW), typed(AIR), SORTIE, text)
    member, weight = members.member_of_particles(together.ensemble), together.searched
    assert member is not None
    seen = np.zeros(3)
    for k, (flow, air) in enumerate(zip(FLOW, AIR, strict=True)):
        alone = moved(tmp_path, f"constant = {flow}", f"constant = {air}", SORTIE, text)
        for first, last in alone.ensemble.scenarios:
            own = np.flatnonzero(member[first:last] == k) + first
            lost = alone.searched[own] - alone.searched[own].max()
            assert weight[own] - weight[own].max() == pytest.approx(lost, abs=4e-6)
            seen[k] = max(seen[k], -lost.min())
    assert (seen > 0.2).all()  # it was there in each


def test_drifters_are_compared_with_one_member(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text(RAFT.format(more="", current=typed(FLOW), wind=typed(AIR)))
    time = np.datetime64("2026-03-05T01:00", "s").astype(np.int64) + 3600 * np.arange(5)
    track = Track("buoy", time, 5.0 + 0.01 * np.arange(5), 60.0 + 0.0 * np.arange(5), {})
    with pytest.raises(
        UserError, match=r"compared with one current and one wind, not with 3 members"
    ):
        along.compare_displacements(
            case_file.load(tmp_path / "case.toml"), [track], {}, 7200.0, 5.0
        )
