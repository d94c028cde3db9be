"""Phases of behaviour and the trackers that they name: what is refused, in one line that says
where, and what is taken.
"""

from pathlib import Path

import numpy as np
import pytest

from drift.case import file as case_file
from drift.case.file import UserError
from drift.engine.motion.steering.itinerary import Acts
from geo import sphere

HEAD = 'title = "trial"\nstart = "2026-03-05T00:07Z"\nduration = "2 h"\ncoast.source = "none"\n'
PATROL = '[tracker.patrol]\nat = [179.4, -52.0]\nlegs = [{ course = 60, speed = "14 kn", lasting = "40 min" }, { course = 200, speed = "9 kn" }]\n'
STORY = '[[scenario]]\nname = "one"\nposition = { at = [179.9, -51.9], std = "2 nmi" }\n[[scenario.phase]]\n'
ACTS = 'fastest = "32 kn", acts = ["3 min", "15 min"]'
GPX = """<?xml version="1.0"?><gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>
<trkpt lat="-52.0" lon="179.4"><time>2026-03-05T00:00:00Z</time></trkpt>
<trkpt lat="-52.1" lon="-179.9"><time>2026-03-05T{}:00Z</time></trkpt></trkseg></trk></gpx>"""


def behaviour(more: str, head: str = PATROL) -> str:
    return f"{HEAD}{head}{STORY}behaviour = {{ {more} }}\n"


BAD = {
    "nobody to seek": (behaviour(f"{ACTS}, seek = 0.2"), "phase 1.behaviour: tracker: is missing: name the vessel to seek or hide from"),
    "a tracker that there is not": (
        behaviour(f'{ACTS}, hide = 0.2, tracker = "frigate"'),
        "phase 1.behaviour.tracker: no tracker 'frigate'; there are: [tracker.patrol]",
    ),
    "no tracker at all": (behaviour(f'{ACTS}, hide = 0.2, tracker = "frigate"', ""), "there are: none; write it as [tracker.NAME]"),
    "no acts": (behaviour('fastest = "32 kn"'), "phase 1.behaviour: acts: is missing, like"),
    "acts at once": (behaviour('fastest = "32 kn", acts = ["0 min", "3 min"]'), "must be above 0"),
    "probabilities above 1": (
        behaviour(f'{ACTS}, change = 0.5, seek = 0.3, hide = 0.3, tracker = "patrol"'),
        "change 0.5, seek 0.3 and hide 0.3 are 1.1 together; at most 1",
    ),
    "too fast at first": (behaviour(f'{ACTS}, speed = "40 kn"'), "speed: 40 kn is above fastest, 32 kn"),
    "no speed": (behaviour('acts = ["3 min", "15 min"]'), "phase 1.behaviour.fastest"),
    "a tracker without a place": (
        behaviour(f"{ACTS}, seek = 0.1, tracker = {{ }}"), "phase 1.behaviour: tracker: it has no position"
    ),
    "a tracker of two ways": (
        behaviour(f'{ACTS}, seek = 0.1, tracker = {{ at = [1, 2], track = "own.gpx" }}'), "at and track are both given; give one"
    ),
    "legs from nowhere": (
        behaviour(f'{ACTS}, seek = 0.1, tracker = {{ legs = [{{ course = 10, speed = "3 kn" }}] }}'), "at: is missing; legs begin there"
    ),
    "a file that is not there": (
        behaviour(f'{ACTS}, seek = 0.1, tracker = {{ track = "missing.gpx" }}'), 'phase 1.behaviour: track: no file "missing.gpx"'
    ),
    "a track that ends before": (
        behaviour(f'{ACTS}, seek = 0.1, tracker = {{ track = "own.gpx" }}'),
        "tracker: is known from 050000ZMAR26 to 050150ZMAR26, not from 050007ZMAR26 to 050207ZMAR26; complete its track",
    ),
    "a behaviour without a place": (
        HEAD + PATROL + STORY.replace('position = { at = [179.9, -51.9], std = "2 nmi" }\n', "") + f"behaviour = {{ {ACTS} }}\n",
        "begins at a position or in an area",
    ),
    "a phase that never comes": (
        behaviour(ACTS) + f"[[scenario.phase]]\nbehaviour = {{ {ACTS} }}\n", "phase 1 has no end, so phase 2 never begins; give behaviour.until"
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD)
def test_one_line_says_what_is_wrong_and_where(what: str, tmp_path: Path) -> None:
    text, told = BAD[what]
    path = tmp_path / "trial.toml"
    path.write_text(text)
    (tmp_path / "own.gpx").write_text(GPX.format("01:50"))
    with pytest.raises(UserError) as refused:
        case_file.load(path)
    (line,) = refused.value.lines
    assert told in line
    assert "\n" not in line


def phase(tmp_path: Path, text: str) -> Acts:
    path = tmp_path / "trial.toml"
    path.write_text(text)
    itinerary = case_file.load(path).scenarios[0].itinerary
    assert itinerary is not None
    (own,) = itinerary.phases
    assert isinstance(own, Acts)
    assert itinerary.fastest == pytest.approx(32 * 1852 / 3600)
    return own


def test_a_behaviour_is_taken_as_it_was_meant(tmp_path: Path) -> None:
    """By default any course and speed at first; the tracker's rhumb lines by their latitudes and
    lengths, across 180 degrees.
    """
    own = phase(
        tmp_path,
        behaviour(
            f'{ACTS}, change = 0.2, hide = 0.3, leave = 0.05, spread = 40, tracker = "patrol"'
        ),
    )
    assert (own.change, own.seek, own.hide, own.leave, own.between) == (
        0.2,
        0.0,
        0.3,
        0.05,
        (180.0, 900.0),
    )
    assert own.spread == pytest.approx(np.radians(40))
    assert (own.course.low, own.course.high) == (0, 2 * np.pi)
    assert (own.speed.low, own.speed.high) == (0, own.fastest)
    way = own.tracker
    assert way is not None
    k = way.time.index(2400.0)
    metres = 14 * 1852 / 3600 * 2400
    assert np.degrees(way.lat[k]) == pytest.approx(
        -52 + np.degrees(metres * np.cos(np.radians(60)) / sphere.RADIUS)
    )
    assert way.time[-1] == 7200
    lon = np.array(way.lon)
    assert sphere.distance(lon[0], way.lat[0], lon[k], way.lat[k]) == pytest.approx(
        metres, rel=1e-5
    )


def test_a_tracker_by_its_track_is_enough_until_the_phase_ends(tmp_path: Path) -> None:
    (tmp_path / "own.gpx").write_text(GPX.format("01:50"))
    more = f'{ACTS}, seek = 0.1, tracker = {{ track = "own.gpx" }}, until = "+90 min"'
    own = phase(tmp_path, behaviour(more))
    assert own.tracker is not None
    assert own.tracker.time == (-420.0, 6180.0)
    np.testing.assert_allclose(np.degrees(own.tracker.lon) % 360, [179.4, 180.1])
