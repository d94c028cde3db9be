"""A plan against its own execution: its POS is one minus the evidence of having flown it and found
nothing.
"""

import math
from pathlib import Path

import numpy as np
import plans
import pytest
from plans import few_trials  # noqa: F401 (a fixture)

import drift
from drift.evidence.suspend.further import Planned
from drift.pipeline import flow
from drift.planning.search import planner
from drift.planning.search.products import files
from drift.planning.search.records import Plan
from geo.errors import UserError

pytestmark = pytest.mark.usefixtures("few_trials")

CASE = (
    """
title = "Two units"
start = "2026-06-01T06:00Z"
duration = "8 h"
particles = 6000
"""
    + plans.SEA.replace("{every}", "8")
    + """[[scenario]]
name = "near"
weight = 0.7
object = "water"
position = { at = [179.95, 20.0], std = "4 nmi" }
survival = { median = "5 h", spread = 1.5 }
[[scenario]]
name = "far"
weight = 0.3
object = "water"
position = { at = [-179.80, 20.1], std = "3 nmi" }
[[sortie]]
name = "before"
start = "+0 h"
end = "+1 h"
area = { centre = [179.95, 20.0], length = "6 nmi", width = "6 nmi", orientation = 0 }
pod = 0.5
law = "random"
[plan]
particles = 3000
rounds = ROUNDS
objective = "OBJECTIVE"
[[unit]]
name = "plane"
base = [179.0, 20.5]
search_speed = "140 kn"
endurance = "1.5 h"
daylight = false
turnaround = "30 min"
sweep_width = { near = "1 nmi", far = "0.7 nmi" }
sweep_width_uncertainty = "30 %"
[[unit]]
name = "boat"
base = [179.9, 20.1]
search_speed = "15 kn"
endurance = "4 h"
daylight = false
sweep_width = "0.8 nmi"
"""
)


def case_of(folder: Path, rounds: int = 1, objective: str = "pos") -> drift.Case:
    return plans.loaded(folder, CASE.replace("ROUNDS", str(rounds)).replace("OBJECTIVE", objective))


@pytest.fixture(scope="module")
def planned(
    tmp_path_factory: pytest.TempPathFactory,
    few_trials: None,  # noqa: F811
) -> tuple[Path, Plan, drift.Result]:
    """The plan of one round for POS, and the folder of its case."""
    folder = tmp_path_factory.mktemp("planned")
    return folder, *planner.plan(case_of(folder))


@pytest.mark.thorough
def test_executing_a_plan_fails_as_often_as_it_said(
    planned: tuple[Path, Plan, drift.Result],
) -> None:
    folder, made, result = planned
    assert made.bound is not None
    assert 0.2 < made.seen <= made.bound  # of the same particles: no slack
    assert made.pos == made.value <= made.bound + 2 * made.bound_error  # of others
    assert 0 < made.bound_error < 0.02
    # As a debrief would do it: the plan's tables appended to the case, and run.
    executed = folder / "executed.toml"
    executed.write_text((folder / "case.toml").read_text() + "\n" + files.toml(made, ["before"]))
    again = drift.run(drift.load(executed))
    assert again.updates is not None
    evidence = sum(
        update.log_evidence[-1] for update in again.updates.all if update.name != "before"
    )
    # plan.toml's positions are right to 0.2 m
    assert 1 - math.exp(evidence) == pytest.approx(made.pos, abs=2e-4)
    assert again.updates.all[0].log_evidence[-1] == result.updates.all[0].log_evidence[-1]
    posterior = again.updates.all[-1].posterior
    miss = [1 - pos for pos in made.by_scenario]
    before = again.updates.all[0].posterior
    assert posterior[0] == pytest.approx(
        before[0] * miss[0] / (before[0] * miss[0] + before[1] * miss[1]), abs=1e-3
    )


@pytest.mark.thorough
def test_rounds_are_planned_on_the_failure_of_those_before(
    tmp_path: Path, planned: tuple[Path, Plan, drift.Result]
) -> None:
    made, _ = planner.plan(case_of(tmp_path, rounds=2))
    one = planned[1]
    planes = [tasking for tasking in made.taskings if tasking.unit.name == "plane"]
    assert [tasking.round for tasking in planes] == [1, 2]
    assert planes[1].takeoff >= planes[0].home + np.timedelta64(1800, "s")
    assert made.bound is not None
    assert one.seen < made.seen <= made.bound
    assert one.pos < made.pos <= made.bound + 2 * made.bound_error
    assert len({tasking.sortie.name for tasking in made.taskings}) == len(made.taskings)


@pytest.mark.thorough
def test_a_round_finds_alive_what_those_before_found_neither_alive_nor_dead(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two rounds find alive a1 + (1 - p1) a2; it was told as 1 - (1 - a1) (1 - a2), as if what is
    found dead were still to be found.
    """
    rounds, plan = [], planner.optimiser.plan

    def told(*given, **more):
        rounds.append(plan(*given, **more))
        return rounds[-1]

    monkeypatch.setattr(planner.optimiser, "plan", told)
    case_of(tmp_path, rounds=2, objective="alive")
    brief = {"scenario.0.survival": '{ median = "2 h", spread = 1.5 }'}
    made, _ = planner.plan(drift.load(tmp_path / "case.toml", brief))
    first, second = rounds
    found = 1 - math.prod(1 - tasking.pos for tasking in first.taskings)
    assert found > first.seen + 0.02
    assert made.seen == pytest.approx(first.seen + (1 - found) * second.seen, rel=1e-12)
    assert made.seen < 1 - (1 - first.seen) * (1 - second.seen) - 0.001


@pytest.mark.thorough
def test_finding_alive_is_worth_less_than_finding(tmp_path: Path) -> None:
    made, result = planner.plan(case_of(tmp_path, objective="alive"))
    assert 0.05 < made.value < made.pos
    # the plan is still to come: told from the sortie before it on
    sorties = [tasking.sortie for tasking in made.taskings]
    ahead = Planned(frozenset(one.name for one in sorties), max(one.end for one in sorties))
    told = flow.suspension_basis(result, ahead)
    assert told is not None
    assert told.now == np.datetime64("2026-06-01T07:00")
    assert [update.name for update, _ in told.sorties] == ["before"]
    assert len(told.further) == 1
    assert (told.further[0].pos, told.further[0].alive) == pytest.approx(
        (made.pos, made.value), abs=1e-12
    )
    assert made.bound is not None
    assert made.seen <= made.bound
    assert made.value <= made.bound + 2 * made.bound_error
    # no later than at the end of the last sortie, no earlier than at the plan's begin: within what
    # that leaves alive
    assert result.updates is not None
    assert all(
        update.alive is not None and update.alive[1] == pytest.approx(update.pos[1])
        for update in result.updates.all
    )


def test_nobody_to_send(tmp_path: Path) -> None:
    text = CASE.replace("ROUNDS", "1").replace("OBJECTIVE", "pos")
    (tmp_path / "none.toml").write_text(
        text[: text.index("[[unit]]")].replace(
            '[plan]\nparticles = 3000\nrounds = 1\nobjective = "pos"\n', ""
        )
    )
    with pytest.raises(UserError, match=r"none.toml: has no \[\[unit\]\] to plan with"):
        planner.plan(drift.load(tmp_path / "none.toml"), tmp_path / "out")
    far = text.replace("[179.0, 20.5]", "[90.0, 50.0]").replace("[179.9, 20.1]", "[90.0, 50.0]")
    (tmp_path / "far.toml").write_text(far)
    with pytest.raises(
        UserError, match="plan: no unit can search between 010700ZJUN26 and 011400ZJUN26"
    ):
        planner.plan(drift.load(tmp_path / "far.toml"), tmp_path / "out")
    assert not (tmp_path / "out").exists()
    # at 180 degrees the period is 19 h to 2 h local time; the sun rises at 0520 there
    (tmp_path / "night.toml").write_text(text.replace("daylight = false\n", ""))
    with pytest.raises(
        UserError, match=r"Night throughout for plane, boat: .*; next sunrise 0117[12]\dZJUN26"
    ):
        planner.plan(drift.load(tmp_path / "night.toml"), tmp_path / "out")


def test_a_plan_begins_when_all_is_known(tmp_path: Path) -> None:
    text = (
        CASE.replace("ROUNDS", "1")
        .replace("OBJECTIVE", "pos")
        .replace("[plan]", '[plan]\nbegin = "+30 min"')
    )
    (tmp_path / "early.toml").write_text(text)
    with pytest.raises(
        UserError,
        match=r'plan.begin 010630ZJUN26 is before the end of sortie "before", 010700ZJUN26',
    ):
        planner.plan(drift.load(tmp_path / "early.toml"))


def test_a_case_whose_time_is_over_runs_and_is_not_planned(tmp_path: Path) -> None:
    """After a debrief the last sortie may end with the case: that is the plan's concern alone."""
    text = (
        CASE.replace("ROUNDS", "1")
        .replace("OBJECTIVE", "pos")
        .replace('end = "+1 h"', 'end = "+8 h"')
    )
    (tmp_path / "over.toml").write_text(text)
    case = drift.load(tmp_path / "over.toml")
    with pytest.raises(
        UserError,
        match=r"over.toml: plan: the last sortie or contact is at 011400ZJUN26, when the plan",
    ):
        planner.plan(case)


LOSING = """
title = "Most of what a good plan leaves is lost"
start = "2026-06-01T06:00Z"
duration = "10 h"
particles = 5000
max_lost = 0.2
[output]
every = "5 h"
[clock]
step = "30 min"
[coast]
source = "none"
[domain]
west = 4.0
east = 5.6
south = 57.5
north = 58.5
[[current]]
constant = {{ speed = "0.5 kn", toward = 75 }}
[uncertainty]
diffusivity = "3 m2/s"
[[scenario]]
name = "near"
weight = {near}
object = "water"
position = {{ at = [4.6, 58.02], std = ["1 nmi", "0.7 nmi"], orientation = 20 }}
[[scenario]]
name = "at the edge"
weight = {edge}
object = "water"
position = {{ at = [5.55, 57.9], std = "0.5 nmi" }}
[plan]
particles = 3000
until = "+6 h"
[[unit]]
name = "plane"
base = [4.1, 58.1]
search_speed = "130 kn"
endurance = "3 h"
daylight = false
sweep_width = {{ near = "1.2 nmi", "at the edge" = 0 }}
law = "random"
"""


def losing(folder: Path, edge: float) -> drift.Case:
    (folder / "losing.toml").write_text(LOSING.format(near=1 - edge, edge=edge))
    return drift.load(folder / "losing.toml")


@pytest.mark.thorough
def test_a_plan_is_not_refused_for_being_good(tmp_path: Path) -> None:
    """A tenth of the probability leaves the domain; once the rest has been searched, most of what
    is left has left it.
    """
    made, result = planner.plan(losing(tmp_path, 0.1))
    assert made.pos > 0.8
    account = result.summary["account"]
    assert account["left"] > 0.3
    executed = tmp_path / "executed.toml"
    executed.write_text((tmp_path / "losing.toml").read_text() + "\n" + files.toml(made))
    drift.run(drift.load(executed, {"duration": "6 h"}))  # and so when it has been flown
    with pytest.raises(
        UserError,
        match=r"(29|3\d)\.?\d* % of the probability was lost by the end: 0 % ran out of forcing, (29|3\d)\.?\d* % left",
    ):
        planner.plan(losing(tmp_path, 0.3))
