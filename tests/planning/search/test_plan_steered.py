"""Plans against what steers: a drifting raft, a yacht under way and then adrift, a smuggler on a
Brownian bridge.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import plans
import pytest
from plans import HOUR, NMI

from drift.case.record import Case
from drift.evidence.filter.records import Law, Sortie
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
from geo import sphere
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
    swarm = optimiser._swarm(tracks, case.plan, [None] * 3, plane)
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


def placed(some: Tracks) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times [s] of tracks since they begin, and where particles are then [m]."""
    plane = record.plane(some)
    return some.time - some.time[0], *plane.flat(some.lon * sphere.UNIT, some.lat * sphere.UNIT)


def hunted(some: Tracks, speed: float, search: float, width: np.ndarray, count: int) -> float:
    """Return the most that legs by hand find of tracks in some hours of search, which may begin
    anywhere and at any time.

    Half of them go from one particle that they can meet to the next, at most half an hour away; the
    others go to and fro in a place where one is some time, along its course, across it, or with it.
    """
    rng = np.random.default_rng(2)
    time, x, y = placed(some)
    swarm = optimiser._swarm(some, plans.spec(), [None], record.plane(some))

    def at(i: int, t: float) -> np.ndarray:
        return np.array([np.interp(t, time, v[:, i]) for v in (x, y)])

    best = 0.0
    for number in range(count):
        now, i = float(rng.uniform(0, time[-1] - search * HOUR)), int(rng.integers(some.m))
        spot, end = at(i, now), now + search * HOUR
        path = [(now, *spot, 1.0)]
        course = at(i, now + 300) - at(i, now - 300)
        turn = np.arctan2(*course[::-1]) + (number // 2 % 2) * np.pi / 2
        drift_by = course / 600 * (number // 4 % 2)
        reach = float(rng.uniform(0.3, 3) * width.max())
        while now < end - 60:
            if number % 2:
                way = (-1) ** len(path) * reach * np.array([np.cos(turn), np.sin(turn)])
                way += drift_by * np.hypot(*way) / speed
            else:
                i = int(rng.integers(some.m))
                goal = at(i, now)
                for _ in range(5):
                    goal = at(i, min(now + float(np.hypot(*(goal - spot))) / speed, end))
                way = goal - spot
                if not 60 < np.hypot(*way) / speed < 1800 and rng.random() < 0.98:
                    continue
            share = min(1.0, (end - now) * speed / float(np.hypot(*way)))
            now, spot = now + share * float(np.hypot(*way)) / speed, spot + share * way
            path.append((now, *spot, 1.0))
        chance, _ = sweeps.found(swarm, None, np.array(path), width, np.ones(1))
        best = max(best, float(some.weight @ chance[:, 0]))
    return best


def strait(m: int) -> Tracks:
    """Return ships from far and wide at 4 to 7 m/s through a gap of 0.3 nmi, one after the other,
    and on fanwise.
    """
    rng = np.random.default_rng(6)
    time = np.arange(49) * 300.0
    passes, gap, speed = (
        rng.uniform(0.5, 3.5, m) * HOUR,
        rng.normal(0, 0.3 * NMI, m),
        rng.uniform(4, 7, m),
    )
    before, after = rng.uniform(-0.8, 0.8, m), rng.uniform(-0.5, 1.2, m)
    ahead = speed * (time[:, None] - passes)
    turn = np.where(ahead < 0, before, after)
    return plans.steered(time, ahead * np.cos(turn), gap + ahead * np.sin(turn))


def burst(m: int) -> Tracks:
    """Return boats that leave a place of 0.4 nmi by all courses at 2 to 6 m/s: a cloud that spreads
    more than tenfold.
    """
    rng = np.random.default_rng(3)
    time = np.arange(37) * 300.0
    turn, speed = rng.uniform(0, 2 * np.pi, m), rng.uniform(2, 6, m)
    x, y = (
        0.4 * NMI * rng.standard_normal(m) + time[:, None] * speed * part(turn)
        for part in (np.sin, np.cos)
    )
    assert np.hypot(x[-1].std(), y[-1].std()) > 10 * np.hypot(x[0].std(), y[0].std())
    return plans.steered(time, x, y)


def mixed(m: int) -> Tracks:
    """Return yachts of one course at 3 m/s through rafts that drift; most yachts go adrift some
    time.
    """
    rng = np.random.default_rng(4)
    time = np.arange(37) * 300.0
    sails = np.arange(m) % 3 > 0
    turn = np.where(sails, rng.uniform(0, 4, m) * HOUR, -np.inf)
    x = np.where(sails, rng.normal(-8, 4, m), rng.normal(0, 5, m)) * NMI
    y = np.where(sails, rng.normal(0, 0.7, m), rng.normal(1, 4, m)) * NMI
    sailed = np.clip(time[:, None], None, np.maximum(turn, 0.0))
    return plans.steered(
        time, x + 3.0 * sailed + 0.3 * time[:, None], y - 0.2 * time[:, None], turn
    )


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("targets", "speed", "search"),
    [
        pytest.param(strait, 9.0, 1.4, marks=pytest.mark.thorough),
        (burst, 14.0, 0.75),
        (mixed, 16.0, 2.4),
    ],
)
def test_no_legs_by_hand_find_more_than_the_bound(
    targets: Callable[[int], Tracks], speed: float, search: float
) -> None:
    """On the same particles, seen farther while under way: below the bound, and that below 1, or it
    would tell nothing.
    """
    some = targets(1200)
    width = np.array([[0.3], [0.5]]) * NMI
    one = replace(plans.unit(speed, search, width[0, 0], Law()), width_under_way=(width[1, 0],))
    reckoned = bound.bound(some, [one], plans.spec((some.time[-1] - some.time[0]) / HOUR), [None])
    assert reckoned.none == ""
    assert 0.15 < hunted(some, speed, search, width, 160) < reckoned.value < 0.9


@pytest.mark.thorough
def test_what_stands_still_is_bounded_as_what_drifts() -> None:
    """A circular normal, random search: 1 - (1 + u) e^-u.

    Chance makes the bound higher: boxes of 51 by less than a tenth.
    """
    u, std = 1.1, 5 * NMI
    still = plans.cloud(2**13, std, hours=1)
    one = plans.unit(plans.speed_for(u, std, 1, NMI), 1, NMI, Law("random"))
    value = bound.bound(
        replace(still, turn=np.full(still.m, np.inf)), [one], plans.spec(1), [None]
    ).value
    assert 1 < value / (1 - (1 + u) * np.exp(-u)) < 1.1


def test_bins_of_a_convoy_are_short_and_of_a_stream_long() -> None:
    """What goes by as one is less dense in boxes that stand still; a stream is as dense all the
    time.
    """
    rng = np.random.default_rng(5)
    time, m = np.arange(13) * 300.0, 2500
    convoy = plans.steered(
        time,
        900 * rng.standard_normal(m) + 8 * time[:, None],
        900 * rng.standard_normal((1, m)) + 0 * time[:, None],
    )
    stream = plans.steered(
        time,
        rng.uniform(-9e4, 9e4, m) + 8 * time[:, None],
        900 * rng.standard_normal((1, m)) + 0 * time[:, None],
    )
    long = {
        name: np.diff(bins.of_streams(some, record.plane(some)).first)
        for name, some in (("convoy", convoy), ("stream", stream))
    }
    assert long["convoy"].max() <= 2
    assert (long["stream"] == bins.LONGEST).all()


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
