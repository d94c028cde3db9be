"""Itineraries of cases: what is rejected, in one line that says where, and what is taken as it was
meant.
"""

from pathlib import Path

import numpy as np
import pytest
from itinerary_tables import (
    AT,
    HEAD,
    OPEN,
    PHASE,
    STILL,
    STORY,
    VOYAGE,
    bridge,
    course,
    lanes,
    loiter,
)

from drift.case import file as case_file
from drift.case.file import UserError
from drift.engine.motion.steering.itinerary import Course, Loiter, Spread


def refused(tmp_path: Path, text: str) -> str:
    """Return the one line by which a case is refused."""
    path = tmp_path / "trial.toml"
    path.write_text(text)
    with pytest.raises(UserError) as told:
        case_file.load(path)
    (line,) = told.value.lines
    return line


LOOKED = """
[[sortie]]
name = "it"
unit = "Boat"
start = "+2 h"
speed = "14 kn"
sweep_width = { visibility = "8 nmi", wind = "20 kn", seas = "1.5 m" }
waypoints = [[-30.2, 45.1], [-30.4, 45.3]]
"""
BAD = {
    "a ratio below 1": (
        STORY + AT + course("{ low = 10, best = 30, high = 50, ratio = 0.5 }"),
        'scenario "one".phase 1.course.course: ratio 0.5, of the highest to the lowest density, must be at least 1',
    ),
    "a best value beyond the others": (
        STORY + AT + course(speed='{ low = "5 kn", best = "13 kn", high = "12 kn", ratio = 2 }'),
        "scenario \"one\".phase 1.course.speed: best '13 kn' must lie between low '5 kn' and high '12 kn'",
    ),
    "a bridge all over the Earth": (
        STORY + bridge('time = "+2 h"', 'time = "+50 h"', 'k = "900 nmi/sqrt(h)"'),
        'scenario "one".phase 1.bridge: it strays by 3,118 nmi (standard deviation), more than the 1,720 nmi',
    ),
    "a bridge between antipodes": (
        STORY
        + bridge('time = "+2 h"', 'time = "+50 h"').replace("[-31.4, 46.3]", "[151.2, -45.3]"),
        'scenario "one".phase 1.bridge: way points 1 and 2 are 179 degrees apart: the track between them is hardly known',
    ),
    "a distress at a rate a second": (
        STORY
        + "object = 'water'\ndistress = { rate = 0.02 }\n"
        + VOYAGE.format('departure = "+1 h"')
        + STILL,
        'scenario "one".distress.rate: rate 0.02 needs a unit, like "0.02 /h"',
    ),
    "legs of metres": (
        STORY + AT + loiter().replace('"9 nmi"', "9"),
        'scenario "one".phase 1.loiter.leg: a mean leg of 9 m is too short; at least 500 m',
    ),
    "a best course outside a sector through north": (
        STORY + AT + course("{ low = 340, best = 50, high = 20, ratio = 3 }"),
        'scenario "one".phase 1.course.course: best 410.0 must lie between',
    ),
    "a course without a place": (
        STORY + course(),
        "begins at a position or in an area; give one of them",
    ),
    "loitering without a place": (
        STORY + loiter(),
        "begins at a position or in an area; give one of them",
    ),
    "a place beside a voyage": (
        STORY + AT + VOYAGE.format('departure = "+1 h"'),
        "position: its first phase defines the starting position",
    ),
    "a phase of two kinds": (
        STORY + AT + course() + loiter().removeprefix(PHASE),
        'scenario "one".phase 1: exactly one of course, behaviour, track, lanes, voyage, loiter, bridge must be given; found course and',
    ),
    "a phase of no kind": (STORY + AT + PHASE, "must be given; found none"),
    "a phase after one without end": (
        STORY + AT + course() + course("90"),
        "phase 1 has no end, so phase 2 never begins; give course.until or course.for",
    ),
    "a route through a missing lane": (
        STORY + lanes('["Cape Spartel", "Oran"]'),
        'scenario "one".phase 1.lanes: route: no lane from "Cape Spartel" to "Oran"; from "Cape Spartel" lanes lead to',
    ),
    "a route to an unknown node": (
        STORY + lanes('{ from = "Cape Spartel", to = "Orann" }'),
        'scenario "one".phase 1.lanes: route: no node "Orann" in the network; nearest is "Oran"',
    ),
    "a network that is not there": (
        STORY + lanes('["A", "B"]', "nowhere.toml"),
        'scenario "one".phase 1.lanes: network: no file "nowhere.toml"',
    ),
    "an arrival before the departure": (
        STORY + bridge('time = "+20 h"', 'time = ["+10 h", "+18 h"]'),
        'scenario "one".phase 1.bridge: arrives 051800ZMAR26, before it departs, 052000ZMAR26; give times in the order',
    ),
    "a track that goes back in time": (
        STORY
        + PHASE
        + 'track = { points = [{ at = [-30, 45], after = "9 h" }, { at = [-31, 46], after = "5 h" }] }\n',
        'scenario "one".phase 1.track: arrives after 5 h, before it departs, after 9 h',
    ),
    "a K below 0": (
        STORY + bridge('time = "+2 h"', 'time = "+18 h"', 'k = "-12 nmi/sqrt(h)"'),
        "scenario \"one\".phase 1.bridge.k: spread rate '-12 nmi/sqrt(h)' must be at least 0 m/sqrt(s)",
    ),
    "a lowest speed above the highest": (
        STORY
        + bridge(
            'time = "+2 h"', 'time = "+18 h"', 'k = 5\nmin_speed = "9 kn"\nmax_speed = "3 kn"'
        ),
        'scenario "one".phase 1.bridge: min_speed 4.63 m/s is above max_speed 1.54 m/s',
    ),
    "a way too far for its time": (  # 87.9 nmi apart, by the spherical law of cosines; 16 h
        STORY + bridge('time = "+2 h"', 'time = "+18 h"', 'k = 5\nmax_speed = "5.4 kn"'),
        'scenario "one".phase 1.bridge: max_speed 5.4 kn is too slow: 88 nmi at least between two way points, in 16 h at most',
    ),
    "a way too short for its time": (
        STORY + bridge('time = "+2 h"', 'time = "+18 h"', 'k = 5\nmin_speed = "5.6 kn"'),
        'scenario "one".phase 1.bridge: min_speed 5.6 kn is too fast: 88 nmi at most between two way points, in 16 h at least',
    ),
    "a bridge that feels the current": (
        STORY
        + 'vessel = { currents = "felt" }\n'
        + bridge('time = "+2 h"', 'time = "+18 h"')
        + STILL,
        'scenario "one": vessel.currents is "felt": the path of a bridge does not depend on the current',
    ),
    "a current to be felt that is not there": (
        STORY + 'vessel = { currents = "felt" }\n' + AT + course(),
        'scenario "one".vessel.currents is "felt" and there is no current: add [[current]] with files, or leave it out',
    ),
    "probabilities that do not add up": (
        STORY
        + PHASE
        + "[scenario.phase.bridge]\nk = 5\npoints = [{ at = [-30, 45], time = '+1 h' }]\ndestinations = ["
        "{ at = [-31, 46], time = '+9 h', probability = 0.5 }, { at = [-31, 47], time = '+9 h', probability = 0.4 }]\n",
        'scenario "one".phase 1.bridge: destinations: their probabilities add up to 0.9; they must add up to 1',
    ),
    "a correlation with a place that is certain": (
        STORY + bridge('time = "+2 h"', 'time = "+18 h", std = "3 nmi", correlation = 0.4'),
        'scenario "one".phase 1.bridge: correlation: the way point before has no normal error',
    ),
    "a polygon that crosses itself": (
        STORY + AT + loiter("[[-30.1, 45.2], [-29.3, 45.9], [-29.2, 45.1], [-30.3, 45.8]]"),
        'scenario "one".phase 1.loiter: polygon crosses itself near [-29.787, 45.474]',
    ),
    "distress without an object": (
        STORY + 'distress = { rate = "0.01/h" }\n' + VOYAGE.format('departure = "+1 h"') + STILL,
        'scenario "one": object is missing: give the object that drifts',
    ),
    "an object without distress": (
        STORY + 'object = "SKIFF-1"\n' + VOYAGE.format('departure = "+1 h"'),
        'scenario "one": object belongs to an object adrift; add distress, or leave object out',
    ),
    "distress after a part of a course": (
        STORY + 'object = "water"\ndistress = { part = 0.5 }\n' + AT + course() + STILL,
        'scenario "one".distress: part applies only to a voyage or a route along lanes; give between or rate',
    ),
    "a departure before the run": (
        STORY + VOYAGE.format('departure = ["-3 h", "+2 h"]'),
        'scenario "one": it may get under way at 042100ZMAR26, outside the run, 050000ZMAR26 to 071200ZMAR26',
    ),
    "a departure after the run": (
        STORY + VOYAGE.format('departure = ["+50 h", "+70 h"]'),
        'scenario "one": it may get under way at 072200ZMAR26, outside the run',
    ),
    "a bridge that begins before the run": (
        STORY + bridge('time = ["-5 h", "+1 h"]', 'time = "+30 h"'),
        'scenario "one": it may get under way at 041900ZMAR26, outside the run',
    ),
    "times out of order": (
        STORY + VOYAGE.format('departure = ["+9 h", "+2 h"]'),
        'scenario "one".phase 1.voyage: times go from 050900ZMAR26 to 050200ZMAR26, or the best one lies outside',
    ),
    "times of distress out of order": (
        STORY
        + 'object = "water"\ndistress = { between = ["+9 h", "+2 h"] }\n'
        + VOYAGE.format('departure = "+1 h"')
        + STILL,
        'scenario "one".distress: times go from 050900ZMAR26 to 050200ZMAR26',
    ),
    "overdue after the run": (
        STORY + 'overdue = "+90 h"\n' + VOYAGE.format('departure = "+1 h"'),
        'scenario "one".overdue: 081800ZMAR26 is outside the run',
    ),
    "overdue of what is adrift": (
        STORY + 'object = "water"\noverdue = "+20 h"\n' + AT + STILL,
        'scenario "one": overdue belongs to a target under way; add [[scenario.phase]]',
    ),
    "a search object of what never goes adrift": (
        STORY + 'search_object = "sail boat 30ft"\n' + VOYAGE.format('departure = "+1 h"'),
        'scenario "one": search_object "Sail Boat 30ft" applies to an object adrift, and this target stays under way; write vessel = { search_object = '
        '"Sail Boat 30ft" }, or add distress',
    ),
    "no search object of what stays under way": (
        STORY + VOYAGE.format('departure = "+1 h"') + LOOKED,
        'sortie "it": the sweep width tables need search_object in scenario "one", which stays under way: there write vessel = { search_object = '
        '"Raft 4 person" }; or give sweep_width as a length here',
    ),
    "a key that is not known": (
        STORY + AT + PHASE + 'course = { corse = 30, speed = "5 kn" }\n',
        'scenario "one".phase 1.course: unknown key "corse"; did you mean "course"?',
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_one_line_says_what_is_wrong_and_where(what: str, tmp_path: Path) -> None:
    body, told = BAD[what]
    assert told in refused(tmp_path, HEAD + OPEN + body)


def test_all_mistakes_of_all_phases_at_once(tmp_path: Path) -> None:
    path = tmp_path / "trial.toml"
    first = lanes('["Cape Spartel", "Oran"]')
    path.write_text(
        HEAD
        + OPEN
        + STORY
        + first
        + loiter(more=', until = "+30 h"')
        + bridge('time = "+9 h"', 'time = "+4 h"')
    )
    with pytest.raises(UserError) as told:
        case_file.load(path)
    assert [line.split(": ")[1] for line in told.value.lines] == [
        'scenario "one".phase 1.lanes',
        'scenario "one".phase 3.bridge',
    ]


def test_uncertain_numbers_are_as_meant(tmp_path: Path) -> None:
    path = tmp_path / "trial.toml"
    changing = '{ low = 340, best = 5, high = 20, ratio = 4 }, change = "7 h", for = "20 h"'
    path.write_text(HEAD + OPEN + STORY + AT + course(changing, '["3 kn", "9 kn"]') + loiter())
    first, second = case_file.load(path).scenarios[0].itinerary.phases  # type: ignore[union-attr]
    assert isinstance(first, Course)
    assert isinstance(second, Loiter)
    knot = 1852 / 3600
    np.testing.assert_allclose(
        np.degrees([first.course.low, first.course.mode, first.course.high]), [340, 365, 380]
    )
    assert first.course.ratio == 4
    assert first.speed == Spread(
        pytest.approx(3 * knot), pytest.approx(9 * knot), pytest.approx(6 * knot)
    )  # type: ignore[arg-type]
    assert (first.change, first.lasting, second.leg) == (7 * 3600, 20 * 3600, 9 * 1852)


SHARED = """
[voyage.passage]
waypoints = [[-30.2, 45.1], [-31.4, 46.3]]
departure = ["+1 h", "+2 h"]
speed = ["4 kn", "6 kn"]
cross_track = "2 nmi"
[[scenario]]
name = "adrift"
object = "water"
distress = { rate = "0.1 /h" }
[[scenario.phase]]
voyage = "passage"
[[scenario]]
name = "late"
[[scenario.phase]]
voyage = { like = "passage", speed = "3 kn" }
"""


def test_stories_share_a_voyage(tmp_path: Path) -> None:
    """Each is as if it had been written out."""
    out = """waypoints = [[-30.2, 45.1], [-31.4, 46.3]], departure = ["+1 h", "+2 h"], cross_track = "2 nmi" }"""
    written = SHARED.replace('"passage"\n', f'{{ speed = ["4 kn", "6 kn"], {out}\n')
    written = written.replace('{ like = "passage", speed = "3 kn" }', f'{{ speed = "3 kn", {out}')
    path = tmp_path / "trial.toml"
    found = []
    for text in (SHARED, written[written.index("[[scenario]]") :]):
        path.write_text(HEAD + OPEN + STILL + text)
        found.append([scenario.itinerary for scenario in case_file.load(path).scenarios])
    assert found[0] == found[1]
    assert found[0][0].phases[0].speed != found[0][1].phases[0].speed


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            '"passage"\n',
            '"pasage"\n',
            "scenario \"adrift\".phase 1.voyage: no voyage 'pasage'; there are: [voyage.passage]",
        ),
        ('{ like = "passage"', "{ like = 3", 'scenario "late".phase 1.voyage: no voyage 3'),
        (
            'speed = "3 kn" }',
            'sped = "3 kn" }',
            'scenario "late".phase 1.voyage: unknown key "sped"; did you mean "speed"?',
        ),
        ("[voyage.passage]", "[voyage.other]", "no voyage 'passage'; there are: [voyage.other]"),
    ],
)
def test_a_shared_voyage_that_is_wrong(tmp_path: Path, old: str, new: str, told: str) -> None:
    path = tmp_path / "trial.toml"
    path.write_text(HEAD + OPEN + STILL + SHARED.replace(old, new))
    with pytest.raises(UserError) as refusal:
        case_file.load(path)
    assert all(
        told in line or line.startswith("trial.toml: scenario") for line in refusal.value.lines
    )
    # a line for each scenario that names it
    assert any(told in line for line in refusal.value.lines)
