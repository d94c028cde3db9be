"""Where teams can go: two islands and a mainland by hand, and plans against brute force over all
that can be walked.
"""

import itertools
import json
import math

import numpy as np
import pytest
import shapely
from spills import CASE, DAY

import drift
from drift.planning.patrols import access, files, patrol
from drift.planning.patrols import planner as patrol_planner
from drift.planning.patrols.planner import Slot
from drift.products.maps import gazetteer
from drift.spills.worlds import evidence
from drift.spills.worlds.records import Team
from geo import sphere
from geo.box import Box
from geo.coast import edges
from geo.coast.shore import Shore
from geo.errors import UserError

START = np.datetime64("2026-11-21T00:00:00")
DEGREE = math.pi * sphere.RADIUS / 180
# A mainland with a bay in its north, from x = 0.1 to 0.2, and two islands north of it, 2.2 km
# apart.
BAY = shapely.Polygon(
    [(-0.2, 0), (0.5, 0), (0.5, 0.2), (0.2, 0.2), (0.2, 0.05), (0.1, 0.05), (0.1, 0.2), (-0.2, 0.2)]
)
WEST, EAST = shapely.box(0.0, 0.25, 0.14, 0.3), shapely.box(0.16, 0.25, 0.3, 0.3)
AROUND = Box(-1.0, -0.8, 1.0, 0.9)


def spill_of(tmp_path, more=""):
    shapes = [
        {"type": "Feature", "properties": {}, "geometry": json.loads(shapely.to_geojson(p))}
        for p in (BAY, WEST, EAST)
    ]
    (tmp_path / "land.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": shapes})
    )
    values = {"duration": "3 d", "objects": 60, "worlds": 50, "per_world": 60, "seed": 3}
    (tmp_path / "case.toml").write_text(CASE.format(more="", **values) + more)
    return drift.load(tmp_path / "case.toml")


def unit(more, length="40 km", name="team"):
    return f'\n[[patrol_unit]]\nname = "{name}"\nlength = "{length}"\ndetection = 0.5\nfirst = "+40 h"\n{more}\n'


def walkable(case):
    coast = edges.build_coast(
        Shore(np.array([BAY, WEST, EAST], object), "test", box=AROUND.grown(1, 1)), AROUND
    )
    segments = evidence.cut_stretches(case.spill, coast)
    teams = access.of_teams(
        case.spill.teams, segments, lambda box: coast.polygons, lambda: coast.polygons
    )
    return segments, teams


def lands(segments, found):
    """Return on which polygons the stretches of a team lie, and their middles."""
    at = shapely.points(segments.lon[list(found)], segments.lat[list(found)])
    near = [
        k for k, shape in enumerate((BAY, WEST, EAST)) if shapely.dwithin(shape, at, 1e-6).any()
    ]
    return near, shapely.get_coordinates(at)


def test_a_team_stays_on_the_land_of_its_base(tmp_path):
    """A circle of 30 km about the west island's middle holds stretches of all three."""
    reach = 'base = [0.07, 0.28]\nreach = "30 km"'
    segments, teams = walkable(
        spill_of(tmp_path, unit(reach) + unit(f"{reach}\ncrosses_water = true", name="boat"))
    )
    assert lands(segments, teams.teams[0].stretches)[0] == [1]
    assert lands(segments, teams.teams[1].stretches)[0] == [0, 1, 2]
    assert not any(team.stays for team in teams.teams)


def test_a_bridge_lets_it_cross(tmp_path):
    case = spill_of(tmp_path, unit('base = [0.07, 0.28]\nreach = "30 km"'))
    text = case.path.read_text().replace(
        "[[spill.class]]", "bridges = [[[0.14, 0.28], [0.16, 0.28]]]\n[[spill.class]]"
    )
    case.path.write_text(text)
    segments, teams = walkable(drift.load(case.path))
    assert lands(segments, teams.teams[0].stretches)[0] == [1, 2]


def test_reach_is_measured_round_the_bay(tmp_path):
    """From its west head: the east head is 11 km off straight and 44 km over land."""
    segments, teams = walkable(spill_of(tmp_path, unit('base = [0.095, 0.195]\nreach = "30 km"')))
    found, places = lands(segments, teams.teams[0].stretches)
    assert found == [0]
    assert len(places) > 3
    head = (places[:, 0] > 0.2) & (places[:, 1] > 0.1)
    assert not head.any()
    straight = sphere.distance(
        *np.radians([0.095, 0.195]), np.radians(segments.lon), np.radians(segments.lat)
    )
    assert (
        (straight <= 30e3) & (segments.lon > 0.2) & (segments.lat > 0.1) & (segments.lat < 0.21)
    ).any()


def test_a_base_on_water_begins_at_the_nearest_land_and_says_so(tmp_path):
    segments, teams = walkable(spill_of(tmp_path, unit('base = [0.07, 0.31]\nreach = "20 km"')))
    (team,) = teams.teams
    assert lands(segments, team.stretches)[0] == [1]
    assert (
        f"lies on water: the team starts at the nearest land, {0.01 * DEGREE / 1000:.3g} km off, at 00-18.0N"
        in team.note
    )


@pytest.mark.parametrize(
    ("given", "words", "remedy"),
    [
        ('base = [-0.6, 0.6]\nreach = "20 km"', "no land lies within its reach of 20 km from its base; the nearest is 6",
         'base = [-0.6, 0.6]\nreach = "90 km"'),
        ('base = [0.15, 0.12]\nreach = "2 km"', "no land lies within its reach of 2 km", 'base = [0.1, 0.1]\nreach = "9 km"'),
        ('base = [0.161, 0.262]\nreach = "4 km"', "no stretch within 4 km of its base can be reached over land",
         'base = [0.161, 0.262]\nreach = "4 km"\ncrosses_water = true'),
        ('base = [0, 0]\nreach = "2000 km"', "at most 1000 km over land", ""),
    ],
)  # fmt: skip
def test_what_cannot_be_reached_is_told_and_the_remedy_works(given, words, remedy, tmp_path):
    with pytest.raises(UserError, match=words):
        walkable(spill_of(tmp_path, unit(given)))
    _, teams = walkable(spill_of(tmp_path, unit(remedy)))
    assert teams.teams[0].stretches


def test_a_team_without_a_base_stays_on_one_of_all(tmp_path):
    segments, teams = walkable(
        spill_of(tmp_path, unit("") + unit("crosses_water = true", name="boat"))
    )
    assert [team.stays for team in teams.teams] == [True, False]
    assert teams.teams[0].stretches == teams.teams[1].stretches == tuple(range(len(segments.name)))
    assert len(set(teams.mass.tolist())) == 3


def slots(*stays):
    teams = [
        Team(name, length, detection, (START,))
        for name, length, detection in (("a", 15e3, 0.5), ("b", 11e3, 0.9))
    ]
    rows = ((0, 2.0), (1, 2.5), (0, 3.0))
    return [
        Slot(
            teams[k],
            START + np.timedelta64(round(24 * day), "h"),
            round(day * DAY),
            (0, 1, 2, 3),
            stays[k],
        )
        for k, day in rows
    ]


@pytest.mark.parametrize("choices", [patrol_planner.CHOICES, 1])
@pytest.mark.parametrize("stays", list(itertools.product([False, True], repeat=2)))
def test_plan_and_bound_are_of_plans_that_can_be_walked(stays, choices, monkeypatch):
    """Four stretches on two islands: the best of all choices in which teams that stay are on one
    island each.
    """
    monkeypatch.setattr(patrol_planner, "CHOICES", choices)
    rng, length, mass = (
        np.random.default_rng(5),
        np.array([9e3, 5e3, 6e3, 8e3]),
        np.array([0, 1, 0, 1]),
    )
    tables = {s: rng.uniform(0, 2, (4, 3)) for s in range(4)}
    teams = slots(*stays)
    detection = [slot.team.detection for slot in teams]
    sets = [some for count in range(3 + 1) for some in itertools.combinations(range(3), count)]
    values = {}
    for chosen in itertools.product(sets, repeat=4):
        walked = [sum(length[s] for s in range(4) if j in chosen[s]) for j in range(3)]
        islands = [
            {int(mass[s]) for s in range(4) for j in chosen[s] if teams[j].team.name == name}
            for name in "ab"
        ]
        one = all(len(island) <= 1 for island, stay in zip(islands, stays, strict=True) if stay)
        if one and all(walked[j] <= teams[j].team.length for j in range(3)):
            values[chosen] = sum(
                patrol_planner.expected(tables[s], detection, chosen[s]) for s in range(4)
            )
    best = max(values.values())
    chosen, bound, daily = patrol_planner.choose(tables, length, teams, mass)
    planned = tuple(chosen.get(s, ()) for s in range(4))
    assert planned in values
    assert best <= bound * (1 + 1e-9)
    if not daily:
        assert values[planned] >= best * (1 - patrol_planner.GAP)
        assert bound <= best * (1 + 1e-3)
    assert daily == (choices == 1)


def test_a_town_across_water_is_not_what_a_shore_lies_near(tmp_path, monkeypatch):
    """Towns on the mainland and on the east island; what has none within 100 km on its own land
    says so.
    """
    towns = (
        ["main", "east"],
        np.array([0.0, 0.23]),
        np.array([0.19, 0.27]),
        np.ones(2),
        np.ones(2, bool),
    )
    monkeypatch.setattr(gazetteer, "_all", lambda: towns)
    segments, _ = walkable(spill_of(tmp_path, unit("")))
    at = [(0.02, 0.25), (0.29, 0.25), (0.16, 0.25), (0.2, 0.2)]
    near = gazetteer.nearest_towns(*np.array(at).T, segments.land)
    assert [(town.name, town.across) for town in near] == [
        ("main", True),
        ("east", False),
        ("east", False),
        ("main", False),
    ]
    assert gazetteer.place_in_words(near[0]) == "near main, across water"
    assert (
        gazetteer.place_in_words(near[3])
        == f"{math.hypot(0.2, 0.01) * DEGREE / 1000:.0f} km from main"
    )
    assert [town.name for town in gazetteer.nearest_towns(*np.array(at).T)] == [
        "main",
        "east",
        "east",
        "east",
    ]


@pytest.mark.thorough
def test_a_whole_plan_crosses_no_water(tmp_path):
    """drift plan on the bay: every stretch that it sends a team to lies on the mainland; without
    reach to it none.
    """
    more = 'base = [-0.1, 0.15]\nreach = "40 km"'
    case = spill_of(tmp_path, unit(more))
    plan, result = patrol.patrol(case)
    segments = result.aftermath.segments
    assert plan.visits
    assert lands(segments, [visit.segment for visit in plan.visits])[0] == [0]
    words = " ".join(files.patrol_text(plan, result.aftermath, "T", "run", False).split())
    assert (
        "Unless it crosses water a team stays on one land mass, and its reach is measured over land."
        in words
    )
