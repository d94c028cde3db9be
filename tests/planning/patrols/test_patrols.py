"""Planned patrols: against brute force over all choices, particle by particle, and the closed form
of a straight coast.
"""

import itertools
import json
import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import shapely
from spills import DAY, METRE, case_of, sampled, scattered, spill

import drift
from drift.planning.patrols import chapter, files, patrol
from drift.planning.patrols import planner as patrol_planner
from drift.planning.patrols.planner import Slot
from drift.planning.plans import PlanOutputs
from drift.products.files import drawing
from drift.spills.worlds import exposure, renewal
from drift.spills.worlds.exposure import Reporting, Walk
from drift.spills.worlds.fates import FOREVER
from drift.spills.worlds.records import Team
from geo.errors import UserError

PAINTS = False  # but for one test
pytestmark = pytest.mark.usefixtures("coarse_maps")  # no number is read off a map

START = np.datetime64("2026-11-21T00:00:00")
RATE, LOSS = np.array([0.3, 0.05, 0.12]) / DAY, 0.07 / DAY
LENGTH = np.array([9e3, 12e3, 7e3])
TEAMS = """
[[patrol_unit]]
name = "walkers"
length = "21 km"
detection = 0.6
first = "+40 h"
days = 2
[[patrol_unit]]
name = "horse"
length = "10.5 km"
detection = 0.8
first = "+48 h"
base = [0.0, -0.2]
reach = "17 km"
"""


def slot(
    name: str, length: float, detection: float, day: float, reachable: tuple[int, ...]
) -> Slot:
    team = Team(name, length, detection, (START,))
    return Slot(team, START + np.timedelta64(round(day * 24), "h"), round(day * DAY), reachable)


SLOTS = (
    slot("a", 17e3, 0.5, 4.0, (0, 1, 2)),
    slot("b", 12e3, 0.9, 4.5, (1, 2)),
    slot("a", 17e3, 0.5, 6.0, (0, 1, 2)),
)


def ashore(worlds: int, n: int, seed: int):
    """Return fates of particles that come to one of three stretches for good, most to the first,
    and their arrivals by stretch.
    """
    rng = np.random.default_rng(seed)
    place = rng.choice(4, worlds * n, p=[0.45, 0.2, 0.25, 0.1])
    when = rng.integers(0, 6 * DAY, worlds * n)
    stays = [(k, int(place[k]), int(when[k]), FOREVER) for k in range(worlds * n) if place[k] < 3]
    return spill(worlds, [n], stays), place, when


def tabled(stays, worth):
    """Return tables of what lies on each stretch."""
    return {s: patrol_planner.stretch_table(stays, s, worth, SLOTS).total[:-1] for s in range(3)}


def by_hand(place, when, worth, factor, visits) -> float:
    """Return the expected number that visits, {stretch: numbers of slots}, find: each particle by
    itself.
    """
    total = 0.0
    for k in range(len(place)):
        missed = 1.0
        for j in sorted(visits.get(int(place[k]), ())):
            one = SLOTS[j]
            if when[k] <= one.time:
                rate = RATE[place[k]] * factor[k] + LOSS
                total += (
                    worth[k] * missed * one.team.detection * math.exp(-rate * (one.time - when[k]))
                )
                missed *= 1 - one.team.detection
    return total


def choices():
    """Yield all choices of visits that the teams' lengths and reaches allow."""
    sets = [
        [some for count in range(4) for some in itertools.combinations([j for j in range(3) if s in SLOTS[j].reachable], count)]
        for s in range(3)
    ]  # fmt: skip
    for chosen in itertools.product(*sets):
        walked = [sum(LENGTH[s] for s in range(3) if j in chosen[s]) for j in range(3)]
        if all(walked[j] <= SLOTS[j].team.length for j in range(3)):
            yield dict(enumerate(chosen))


@pytest.fixture(scope="module")
def valued():
    """Return tables of what lies on each stretch, and the values of all choices by hand."""
    fates, place, when = ashore(3, 12, 8)
    factor = np.array([0.5, 1.0, 2.2])
    worth = np.random.default_rng(4).uniform(0.2, 2, len(place))
    stays = exposure.expose(fates, Reporting(RATE, LOSS, factor), ())
    tables = tabled(stays, worth)
    return tables, {
        tuple(v.values()): by_hand(place, when, worth, factor[fates.world], v) for v in choices()
    }


def worth_of(tables, chosen) -> float:
    detection = [slot.team.detection for slot in SLOTS]
    return sum(patrol_planner.expected(tables[s], detection, chosen.get(s, ())) for s in range(3))


def test_visits_are_worth_what_each_particle_by_itself_says(valued) -> None:
    tables, values = valued
    assert len(values) > 20
    for chosen, value in values.items():
        assert worth_of(tables, dict(enumerate(chosen))) == pytest.approx(value, rel=1e-12)


def test_the_plan_is_the_best_of_all_choices(valued) -> None:
    tables, values = valued
    chosen, bound, daily = patrol_planner.choose(tables, LENGTH, SLOTS)
    best = max(values.values())
    assert not daily
    assert best * (1 - patrol_planner.GAP) <= worth_of(tables, chosen) <= best * (1 + 1e-12)
    assert best * (1 - 1e-9) <= bound <= best * (1 + patrol_planner.GAP)


def test_a_stretch_that_only_fills_a_day_is_not_visited() -> None:
    """10, 0.05 and 0.2 objects on one patrol are 97.6, 0.5 and 2 % of it; on a second patrol, that
    meets nothing else, 0.05 is all.
    """
    tables = {s: np.array([[lies, 0.0], [0.0, 0.0]]) for s, lies in enumerate((10.0, 0.05, 0.2))}
    tables[1][1, 1] = 0.03
    left = patrol_planner.worthwhile(tables, SLOTS[:2], {0: (0,), 1: (0, 1), 2: (0,)})
    assert left == {0: (0,), 1: (1,), 2: (0,)}


def test_day_by_day_the_bound_holds(valued, monkeypatch) -> None:
    tables, values = valued
    monkeypatch.setattr(patrol_planner, "CHOICES", 1)
    chosen, bound, daily = patrol_planner.choose(tables, LENGTH, SLOTS)
    best = max(values.values())
    assert daily
    assert tuple(chosen.get(s, ()) for s in range(3)) in values  # what the teams can do
    assert 0.5 * best < worth_of(tables, chosen) <= best * (1 + 1e-12) <= bound * (1 + 1e-9)


def test_what_refloats_is_never_worth_more_than_the_bound() -> None:
    """Particles that come to two stretches: each choice computed over all visits at once stays
    under the bound.
    """
    fates = scattered(3, [40])
    reporting = Reporting(RATE, LOSS, np.ones(3))
    stays = exposure.expose(fates, reporting, ())
    worth = np.random.default_rng(1).uniform(0.2, 2, fates.world.size)
    tables = tabled(stays, worth)
    # a lone visit is worth what it finds, in closed form elsewhere
    for s, j in itertools.product(range(3), range(3)):
        flown = exposure.expose(fates, reporting, (Walk((s,), SLOTS[j].time, 0.4),))
        rows, chance = exposure.patrol_probability(flown, s, 0)
        assert tables[s][: j + 1, j].sum() == pytest.approx(
            float(chance @ worth[flown.slot[rows]]) / 0.4, rel=1e-12
        )
    _, bound, _ = patrol_planner.choose(tables, LENGTH, SLOTS)
    for chosen in choices():
        visits = [(j, s) for s, some in chosen.items() for j in some]
        patrols = tuple(Walk((s,), SLOTS[j].time, SLOTS[j].team.detection) for j, s in visits)
        flown = exposure.expose(fates, reporting, patrols)
        value = 0.0
        for k, (_, s) in enumerate(visits):
            rows, chance = exposure.patrol_probability(flown, s, k)
            value += float(chance @ worth[flown.slot[rows]])
        assert value <= bound * (1 + 1e-9)


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("patrols")
    case = case_of(folder, duration="3 d", worlds=300)
    text = case.path.read_text() + TEAMS
    case.path.write_text(text)
    return *patrol.patrol(drift.load(case.path), folder / "out"), folder


@pytest.mark.thorough
def test_a_straight_coast_is_found_as_its_closed_form_says(planned) -> None:
    """Visits by what an independent sampler of the coast finds, report rates 0.02 a day: three
    standard errors.
    """
    plan, result, _ = planned
    rng, worlds = np.random.default_rng(3), 5000  # 300 of the plan err four times as much
    time, place = sampled(worlds, 60, rng)
    segments = result.aftermath.segments
    missed, whole = np.ones_like(time), np.zeros(worlds)
    for visit in plan.visits:
        middle, length = segments.lat[visit.segment] / METRE, segments.length[visit.segment]
        there = (time <= visit.slot.time) & (np.abs(place - middle) < length / 2)
        lies = there * missed * np.exp(-0.02 / DAY * (visit.slot.time - np.where(there, time, 0)))
        found = lies.sum(axis=1) * visit.slot.team.detection
        error = np.hypot(visit.error, found.std() / np.sqrt(worlds))
        assert abs(visit.found - found.mean()) <= 3 * error
        assert visit.lying == pytest.approx(visit.found / visit.slot.team.detection)
        missed = np.where(there, missed * (1 - visit.slot.team.detection), missed)
        whole += found
    assert plan.found == pytest.approx(sum(visit.found for visit in plan.visits))
    assert abs(plan.found - whole.mean()) <= 3 * np.hypot(plan.error, whole.std() / np.sqrt(worlds))
    assert 0.1 < plan.found <= plan.bound * (1 + 1e-9)
    by_team = {
        slot.team.name: [v.segment for v in visits]
        for slot, visits in patrol_planner.by_patrol(plan)
    }
    near = np.abs(segments.lat[by_team["horse"]] + 0.2) / METRE
    assert (near < 17_000).all()
    for slot, visits in patrol_planner.by_patrol(plan):
        assert sum(segments.length[v.segment] for v in visits) <= slot.team.length * (1 + 1e-9)


@pytest.mark.thorough
@pytest.mark.usefixtures("painted")
def test_patrols_made_as_planned_find_as_many(planned, tmp_path: Path) -> None:
    """patrols.toml appended to the case: the patrols are those planned, and drawn."""
    plan, result, folder = planned
    (tmp_path / "land.geojson").write_text((folder / "land.geojson").read_text())
    text = (folder / "case.toml").read_text().split("[[patrol_unit]]")[0]
    (tmp_path / "case.toml").write_text(text + (folder / "out" / "patrols.toml").read_text())
    case = drift.load(tmp_path / "case.toml")
    slots = [slot for slot, _ in patrol_planner.by_patrol(plan)]
    assert [patrol.time for patrol in case.spill.patrols] == [slot.when for slot in slots]
    assert [patrol.detection for patrol in case.spill.patrols] == [
        slot.team.detection for slot in slots
    ]
    walked = [
        row["segments"] for row in renewal.rows_of_patrols(case.spill, result.aftermath.segments)
    ]
    assert walked == [[v.segment for v in visits] for _, visits in patrol_planner.by_patrol(plan)]
    table = (folder / "out" / "patrols.csv").read_text().splitlines()
    assert len(table) == 1 + len(plan.visits)
    words = (folder / "out" / "patrols.txt").read_text()
    assert "no plan of these teams finds more than" in " ".join(words.split())
    assert max(map(len, words.splitlines())) <= 78
    chapter.PICTURES["patrols.png"](
        PlanOutputs(plan, result, result.setting, case, False), tmp_path / "patrols.png"
    )
    assert (tmp_path / "patrols.png").stat().st_size > 10_000


@pytest.mark.thorough
def test_patrols_and_stretches_for_other_programs(planned, tmp_path: Path) -> None:
    """GPX, KML and GeoJSON hold the line of each stretch that is visited, by its id, as long as it
    is.
    """
    plan, result, folder = planned
    segments = result.aftermath.segments
    visited = [
        (v.slot.team.name, v.segment)
        for _, visits in patrol_planner.by_patrol(plan)
        for v in visits
    ]
    made = {
        form: {path.name: path for path in drift.export(folder / "out", form, tmp_path / form)}
        for form in ("gpx", "kml", "geojson")
    }
    assert {"patrols.gpx", "stretches.gpx"} <= made["gpx"].keys()
    features = json.loads(made["geojson"]["patrols.geojson"].read_text())["features"]
    told = [(f["properties"]["patrol_unit"], f["properties"]["stretch_id"]) for f in features]
    assert told == [(team, segments.id[s]) for team, s in visited]
    tracks = ET.parse(made["gpx"]["patrols.gpx"]).getroot().findall("{*}trk")
    places = ET.parse(made["kml"]["forecast.kml"]).getroot().findall(".//{*}Placemark")
    named = {p.findtext("{*}name"): p for p in places}
    assert [track.findtext("{*}name") for track in tracks] == [
        f"{team} {segments.id[s]}" for team, s in visited
    ]
    for track, feature, (team, s) in zip(tracks, features, visited, strict=True):
        points = [(float(p.get("lon")), float(p.get("lat"))) for p in track.findall(".//{*}trkpt")]
        assert abs(shapely.LineString(points).length / METRE - segments.length[s]) < 1
        assert shapely.from_geojson(
            json.dumps(feature["geometry"])
        ).length / METRE == pytest.approx(segments.length[s], abs=1)
        text = named[f"{team} {segments.id[s]}"].findtext(".//{*}coordinates")
        assert len(text.split()) == len(points)
    stretches = ET.parse(made["gpx"]["stretches.gpx"]).getroot().findall("{*}trk")
    touched = json.loads((folder / "out" / "washup.geojson").read_text())["features"]
    assert [track.findtext("{*}name") for track in stretches] == [f["id"] for f in touched]


@pytest.mark.thorough
def test_what_is_longer_than_a_teams_day_is_told(tmp_path: Path, monkeypatch) -> None:
    """Of two named stretches one is longer than the walkers' day: its length and what lies there,
    in all that a plan hands out.
    """
    from matplotlib.figure import Figure

    case = case_of(tmp_path, duration="3 d", worlds=100)
    line = {
        "type": "LineString",
        "coordinates": [[0, -0.15], [0, 0.15]],
    }  # 33.4 km and the ends of edges, where most comes ashore
    feature = {"type": "Feature", "properties": {"name": "Long beach"}, "geometry": line}
    (tmp_path / "beaches.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": [feature]})
    )
    text = case.path.read_text().replace(
        'stretches.length = "10 km"', 'stretches = { file = "beaches.geojson" }'
    )
    case.path.write_text(text + TEAMS.split('[[patrol_unit]]\nname = "horse"')[0])
    written: list[str] = []
    draw = Figure.text
    monkeypatch.setattr(drawing, "MOST", 1)  # what a copy of the process draws is not seen here
    monkeypatch.setattr(
        Figure,
        "text",
        lambda self, x, y, s, *a, **k: written.append(s) or draw(self, x, y, s, *a, **k),
    )
    plan, result = patrol.patrol(drift.load(case.path), tmp_path / "out")
    after = result.aftermath
    (row,) = plan.left_out
    assert after.segments.name[row.segment] == "Long beach"
    there = after.washup["segment"].values == row.segment
    arrived = float(after.washup["arrived"].isel(time=-1).values[there][0])
    # by its first patrol at 40 h of 72, reported at 0.02 a day
    assert 0.5 * arrived < row.lying < arrived
    words = files.patrol_facts(plan, after)["warning 1"]
    long = f"{after.segments.length[row.segment] / 1000:.1f} km"
    assert words.startswith(f"walkers leaves out 1 stretch, {long}, where ")
    assert f"longer than its 21 km a day: Long beach ({long}, " in words
    assert words in (tmp_path / "out" / "report.html").read_text()
    assert words in " ".join((tmp_path / "out" / "patrols.txt").read_text().split())
    assert words[:60] in " ".join(written)
    table = (tmp_path / "out" / "patrols_left_out.csv").read_text().splitlines()
    assert len(table) == 2
    assert table[1].startswith(f"walkers,21,0,{after.segments.id[0]},Long beach,")


WRONG = {
    "before what is known": (TEAMS.replace("+40 h", "+1 h"), 'first 210100ZNOV26 is before the last find or patrol'),
    "after the run": (TEAMS.replace("days = 2", "days = 9"), "is after the run's end"),
    "no detection": (TEAMS.replace("0.6", "0"), "must be a probability above 0"),
    "a base without reach": (TEAMS.replace('reach = "17 km"\n', ""), "base and reach belong together"),
    "twice": (TEAMS.replace("horse", "walkers"), "two patrol_units have this name"),
    "both": (TEAMS.replace("base =", 'stretches = ["stretch 1"]\nbase ='), "give either stretches"),
}  # fmt: skip
SEEN = '[[patrol]]\nname = "first"\nbetween = [[0.0, -0.1], [0.0, 0.1]]\ntime = "+30 h"\ndetection = 0.2\n'


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_wrong_with_teams_is_said(kind: str, tmp_path: Path) -> None:
    given, word = WRONG[kind]
    case = case_of(tmp_path)
    case.path.write_text(case.path.read_text() + SEEN + given)
    with pytest.raises(UserError) as refused:
        drift.load(case.path)
    assert len(refused.value.lines) == 1
    assert word in refused.value.lines[0]


def test_a_team_that_can_walk_no_stretch(tmp_path: Path) -> None:
    case = case_of(tmp_path, worlds=50)
    case.path.write_text(case.path.read_text() + TEAMS.replace('"10.5 km"', '"3 km"'))
    with pytest.raises(UserError, match=r'patrol_unit "horse": no stretch .* at most 3.0 km long'):
        patrol.patrol(drift.load(case.path))
    with pytest.raises(UserError, match=r"has no \[\[patrol_unit\]\] to plan with"):
        patrol.patrol(case_of(tmp_path))
