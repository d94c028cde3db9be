"""Plans against what steers: a drifting raft, a yacht under way and then adrift, a smuggler on a
Brownian bridge.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import plans
import pytest
from plans import HOUR, NMI

from drift.case.record import Case
from drift.evidence.filter.records import Sortie
from drift.pipeline import flow
from drift.pipeline.run_options import Job, Options, open_job
from drift.planning.search import (
    bins,
    bound,
    candidates,
    follow,
    joint,
    optimiser,
    planner,
    rectangle,
)
from drift.planning.search import planning_tracks as record
from drift.planning.search.boats import availability
from drift.planning.search.candidates import Stage
from drift.planning.search.planning_tracks import Tracks
from drift.planning.search.rectangle import Crew
from geo.errors import UserError
from kernels.maths import noise
from kernels.maths.noise import Purpose
from kernels.planning import rectangles, sweeps

MIXTURE = (
    """
title = "A raft, a yacht and a smuggler"
start = "2026-06-01T06:00Z"
duration = "12 h"
particles = 3000
seed = 5
"""
    + plans.SEA.replace("{every}", "12")
    + """[[scenario]]
name = "raft"
weight = 0.35
object = "water"
position = { at = [179.95, 20.0], std = "7 nmi" }
[[scenario]]
name = "yacht"
weight = 0.35
object = "water"
distress = { between = { earliest = "+4 h", best = "+7 h", latest = "+11 h", ratio = 3 } }
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = [[179.55, 19.75], [179.93, 20.22], [-179.35, 20.05]]
departure = ["+0 h", "+2 h"]
speed = ["4 kn", "7 kn"]
cross_track = "3 nmi"
[[scenario]]
name = "smuggler"
weight = 0.3
vessel = { land = "stop" }
[[scenario.phase]]
[scenario.phase.bridge]
k = "8 nmi/sqrt(h)"
points = [
    { at = [179.3, 20.6], std = "5 nmi", time = ["+0 h", "+1 h"] },
    { at = [-179.3, 19.5], std = "6 nmi", time = ["+11 h", "+17 h"] },
]
[plan]
begin = "+6 h"
particles = 3000
[[unit]]
name = "plane"
base = [179.0, 20.5]
search_speed = "140 kn"
endurance = "4 h"
daylight = false
sweep_width = { raft = "1 nmi", yacht = "0.7 nmi", smuggler = "1 nmi" }
sweep_width_under_way = { raft = "1 nmi", yacht = "2.3 nmi", smuggler = "2 nmi" }
[[unit]]
name = "boat"
base = [179.9, 20.1]
search_speed = "15 kn"
endurance = "5 h"
daylight = false
sweep_width = { raft = "1.2 nmi", yacht = "0.8 nmi", smuggler = "1 nmi" }
sweep_width_under_way = { raft = "1.2 nmi", yacht = "3 nmi", smuggler = "2.5 nmi" }
[[unit]]
name = "at random"
base = [179.9, 20.1]
search_speed = "60 kn"
endurance = "4 h"
daylight = false
law = "random"
sweep_width = { raft = "1 nmi", yacht = "0.5 nmi", smuggler = "1 nmi" }
sweep_width_under_way = { raft = "1 nmi", yacht = "2 nmi", smuggler = "1.5 nmi" }
[[unit]]
name = "abeam"
base = [179.9, 20.1]
search_speed = "90 kn"
endurance = "4 h"
daylight = false
law = "definite_range"
sweep_width = { raft = "1 nmi", yacht = "0.5 nmi", smuggler = "1 nmi" }
sweep_width_under_way = { raft = "1 nmi", yacht = "2 nmi", smuggler = "1.5 nmi" }
"""
)
# Where each unit searches: x, y [nmi] of the middle, orientation [rad], spacing [nmi], logarithm of
# length over width, wait [h].
AREAS = {
    "plane": (2.0, 3.0, 1.83, 2.1, 0.4, 0.3),
    "boat": (9.0, 3.0, 1.38, 2.3, 0.9, 0.1),
    "at random": (-1.0, 2.0, 1.62, 1.9, 0.3, 0.6),
    "abeam": (3.0, 1.0, 1.47, 1.7, 0.5, 0.2),
}


@pytest.fixture(scope="module")
def mixture(tmp_path_factory: pytest.TempPathFactory) -> tuple[Job, Tracks]:
    """The case, and its tracks to plan on."""
    job = open_job(plans.loaded(tmp_path_factory.mktemp("mixture"), MIXTURE), Options())
    return job, follow.follow(job.case, job.where)


def scored(case: Case, tracks: Tracks, name: str) -> tuple[np.ndarray, Sortie]:
    """Return the POS by scenario that the planner computes of an area of AREAS, and the sortie that
    it makes of it.
    """
    plane = record.plane(tracks)
    (one,) = [unit for unit in case.units if unit.name == name]
    can = availability.of_unit(one, case.plan, (plane.lon, plane.lat))
    crew: Crew = rectangle.crew(one, can, plane, float(tracks.time[0]), np.ones(1))
    x, y, turn, spacing, aspect, wait = AREAS[name]
    row = np.array([x * NMI, y * NMI, turn, np.log(spacing * NMI), aspect, wait * HOUR, 1.0, -1.0])
    swarm = optimiser.swarm_of(tracks, case.plan, [None] * 3, plane)
    stage = Stage(tracks.m, swarm, tracks.weight, np.ones(1), True, 0.0)
    choice = candidates.choose(crew, row, stage)
    assert choice.flown.possible[0]
    found = tracks.weight * joint.worth([choice.find], np.ones(1))
    pos = np.bincount(tracks.scenario, found) / np.bincount(tracks.scenario, tracks.weight)
    (tasking,) = candidates.taskings([choice], stage)
    return pos, tasking.sortie


@pytest.mark.thorough
def test_what_a_sortie_is_reckoned_to_find_it_finds_when_executed(
    mixture: tuple[Job, Tracks],
) -> None:
    """On the same particles: each sortie alone is executed by the filter on a run with the planning
    particles' own seed.

    Drifters and yachts take the same ways in both. What is left is that tracks are straight for
    five minutes, and the flat plane: 1 %. A bridge is drawn again between the ends of its steps: K
    sqrt(30 min) / 2 = 2.8 nmi, about an area's margin; the two then differ by less than four
    standard errors of independent draws.
    """
    job, tracks = mixture
    same = replace(
        job.case, seed=noise.seed_for(job.case.seed, Purpose.PLANNING), particles=job.case.plan.particles,
    )  # fmt: skip
    for name in AREAS:
        reckoned, sortie = scored(job.case, tracks, name)
        result = flow.forecast_job(replace(job, case=replace(same, sorties=(sortie,))))
        assert result.updates is not None
        executed = np.asarray(result.updates.all[-1].pos)[:3]
        assert executed.min() > 0.03, name
        error = np.sqrt(2 * executed * (1 - executed) / np.bincount(tracks.scenario))
        np.testing.assert_array_less(np.abs(reckoned - executed), [0.01, 0.01, 4 * error[2]], name)


def test_legs_see_each_state_by_its_own_width() -> None:
    """A leg past ten particles, of which each goes adrift at a time of its own:

    Koopman's hazard in steps of 0.2 s.
    """
    rng = np.random.default_rng(8)
    time, m = np.array([0.0, 700.0, 1500.0, 2400.0]), 10
    x, y = (np.cumsum(rng.normal(0, 900, (4, m)), axis=0) for _ in range(2))
    turn = rng.uniform(200, 2200, m)
    width = np.array([[700.0, 1500.0], [2600.0, 400.0]])  # (state, scenario)
    scenario = np.arange(m) % 2
    path = np.array(
        [
            [150.0, -6000.0, 800.0, 1.0],
            [1300.0, 5000.0, -300.0, 1.0],
            [2300.0, -4000.0, -1500.0, 1.0],
        ]
    )
    swarm = rectangles.swarm(time, x, y, np.ones((4, m)), scenario, turn)
    chance, _ = sweeps.found(swarm, None, path, width, np.ones(1))
    fine = np.arange(150.0, 2300.0, 0.2) + 0.1
    at = np.stack([np.interp(fine, path[:, 0], path[:, k]) for k in (1, 2)])
    for i in range(m):
        own = np.stack([np.interp(fine, time, v[:, i]) for v in (x, y)])
        apart = own - at
        steps = np.hypot(*np.gradient(apart, 0.2, axis=1)) * 0.2
        w = np.where(fine < turn[i], width[1, scenario[i]], width[0, scenario[i]])
        hazard = np.sum(w**2 / (4 * np.pi) * steps / (2 * np.hypot(*apart) ** 3))
        assert chance[i, 0] == pytest.approx(1 - np.exp(-hazard), abs=2e-3)
    gains = sweeps.gains(swarm, None, [path], width, np.ones(1), np.ones((m, 1)), np.zeros((m, 1)))
    assert gains[0] == pytest.approx(chance.sum(), rel=1e-5)


def test_random_search_counts_the_time_in_each_state() -> None:
    """Two particles at rest inside, one of which goes adrift after 30 % of the search."""
    time, rest = np.array([0.0, 500.0, 1000.0]), np.zeros((3, 2))
    swarm = rectangles.swarm(
        time, rest + 20.0, rest - 30.0, np.ones((3, 2)), np.zeros(2), np.array([300.0, -np.inf])
    )
    box = np.array([[0.0, 0.0, 0.6, 0.8, 400.0, 300.0, 0.0, 1000.0, 1.0]])
    curve = np.arange(400) * 0.01  # the coverage itself
    found, _ = rectangles.found(swarm, True, box, np.array([[0.5], [2.0]]), np.ones(1), 0.01, curve)
    np.testing.assert_allclose(found[:, 0], [0.3 * 2.0 + 0.7 * 0.5, 0.5], rtol=1e-4)


@pytest.mark.thorough
def test_bins_end_where_steps_do_and_are_short(mixture: tuple[Job, Tracks]) -> None:
    job, tracks = mixture
    assert np.diff(tracks.time).max() <= follow.SHORTEST
    begin = float(job.case.plan.begin.astype("datetime64[s]").astype(np.int64))
    steps = begin + np.arange(0, 6 * HOUR + 1, 1800)
    assert np.isin(steps, tracks.time).all()
    assert tracks.turn is not None
    kinds = [tracks.turn[tracks.scenario == s] for s in range(3)]
    assert np.isneginf(kinds[0]).all()  # the raft drifts
    start = float(job.case.start.astype("datetime64[s]").astype(np.int64))
    assert ((kinds[1] > start + 4 * HOUR - 1) & (kinds[1] < start + 11 * HOUR + 1)).all()
    assert (kinds[2] > start + 1e6).all()  # the smuggler is in no distress


@pytest.mark.thorough
def test_the_bound_counts_the_wider_of_both_states(
    mixture: tuple[Job, Tracks], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A unit that sees only what is under way, and one that sees only what is adrift: neither bound
    is 0, both are below that of one that sees both.
    """
    monkeypatch.setattr(bins, "FINEST", follow.SHORTEST)  # as tracks have them
    job, tracks = mixture
    few = record.sample(tracks, 1000)
    plane = next(unit for unit in job.case.units if unit.name == "plane")
    nothing = (0.0, 0.0, 0.0)
    limit = {
        name: bound.bound(few, [replace(plane, **widths)], job.case.plan, [None] * 3).value
        for name, widths in {
            "both": {},
            "adrift": {"width_under_way": nothing},
            "under way": {"sweep_width": nothing},
        }.items()
    }
    for name in ("adrift", "under way"):
        assert 0.05 < limit[name] < limit["both"]


@pytest.mark.thorough
def test_there_is_no_bound_where_it_could_be_beaten(
    mixture: tuple[Job, Tracks], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows in which targets go farther than a sweep width; a sensor that counts first passes of
    each leg on a bridge.
    """
    job, tracks = mixture
    few = record.sample(tracks, 300)
    units = {one.name: one for one in job.case.units}
    words = bound._field(few, [units["abeam"]], job.case.plan, [None] * 3)[3]
    assert words.startswith("none is known for sensors that count passes abeam")
    assert bound.silent(0.4, 5000, 0.01, 0.2, 0.2, words) == words
    narrow = replace(units["at random"], sweep_width=(500.0,) * 3, width_under_way=(2000.0,) * 3)
    fast = plans.steered(
        np.arange(25) * 300.0,
        *(np.random.default_rng(1).normal(0, 300, (2, 1, 1500)) + np.arange(25)[:, None] * 4500.0),
    )
    assert bound._field(fast, [narrow], plans.spec(2), [None] * 3)[3] == ""
    monkeypatch.setattr(bins, "PLACES", 8 * 1500)
    assert "too fast" in bound.bound(fast, [narrow], plans.spec(2), [None] * 3).none


def test_a_plan_does_not_begin_before_it_is_known_what_is_overdue(tmp_path: Path) -> None:
    text = MIXTURE.replace('name = "yacht"\n', 'name = "yacht"\noverdue = "+8 h"\n')
    with pytest.raises(
        UserError, match='before the time by which scenario "yacht" is overdue, 011400ZJUN26'
    ):
        planner.plan(plans.loaded(tmp_path, text))
    assert plans.loaded(tmp_path, text.replace('begin = "+6 h"\n', "")).plan.begin == np.datetime64(
        "2026-06-01T14:00"
    )
