"""Errors of sorties in a case: one line each."""

import itertools
from pathlib import Path
from typing import Any

import pytest
from search_tables import (
    BOX,
    CONTACT,
    FAST,
    HEAD,
    NMI,
    POINTS,
    SCENARIOS,
    SEEN,
    SORTIE,
    SQUARE,
    SWEEP,
    TIMED,
    UNIT,
    WATCH,
    WHEN,
    WIDTH,
    gpx,
    load,
    one,
    refusal,
)

FULL = WHEN + WIDTH + BOX + FAST  # a sortie in order
SORTIES = {
    "before the run": (FULL.replace('"+6 h"', '"-1 h"'), "202300ZNOV26 to 210800ZNOV26 is outside the run"),
    "after the run": (FULL.replace('"+8 h"', '"+25 h"'), "220100ZNOV26 is outside the run, 210000ZNOV26 to 220000ZNOV26"),
    "backward": (FULL.replace('"+8 h"', '"+5 h"'), "end 210500ZNOV26 is not after start 210600ZNOV26"),
    "no time at all": (FULL.replace('"+8 h"', '"+6 h"'), "is not after start"),
    "no start": (WIDTH + BOX + FAST + 'end = "+8 h"\n', "start is missing"),
    "no end": (WIDTH + BOX + FAST + 'start = "+6 h"\n', "end is missing"),
    "no place": (WHEN + WIDTH + FAST, "exactly one of area, pattern, waypoints, track, watch"),
    "area and pattern": (FULL + SWEEP, "found area and pattern"),
    "area and legs": (FULL + POINTS, "found area and waypoints"),
    "area and watch": (FULL + WATCH, "watch and area"),
    "two corners": (WHEN + WIDTH + FAST + "area = { polygon = [[-88, 27], [-87, 27]] }\n", "has 2 corners; at least 3"),
    "a bow tie": (WHEN + WIDTH + FAST + "area = { polygon = [[0, 0], [1, 1], [1, 0], [0, 1]] }\n", "crosses itself"),
    "polygon and centre": (FULL.replace("{ centre", "{ polygon = [[0, 0], [1, 1], [1, 0]], centre"), "polygon and centre"),
    "a rectangle without a width": (FULL.replace(', width = "10 nmi"', ""), "width is missing"),
    "a flat rectangle": (FULL.replace('"10 nmi"', '"0 nmi"'), "greater than 0"),
    "spacing zero": (WHEN + WIDTH + BOX + "spacing = 0\n", "spacing 0 must be 10 m to"),
    "negative spacing": (WHEN + WIDTH + BOX + 'spacing = "-1 nmi"\n', "spacing '-1 nmi' must be 10 m to"),
    "spacing in no unit": (WHEN + WIDTH + BOX + "spacing = 1\n", 'write its unit, like "1 nmi"'),
    "a pattern's spacing zero": (WHEN + WIDTH + FAST + SWEEP.replace('"1 nmi"', "0"), 'sortie "first".pattern.spacing: spacing 0'),
    "a spacing as wide as the area": (WHEN + WIDTH + FAST + SWEEP.replace('"1 nmi"', '"20 nmi"'), "leaves no legs"),
    "POD above 1": (WHEN + BOX + "pod = 1.2\n", "POD 1.2 must be a probability, 0 to 1"),
    "POD of 120 %": (WHEN + BOX + 'pod = "120 %"\n', "POD '120 %' must be a probability"),
    "negative POD": (WHEN + BOX + "pod = -0.1\n", "must be a probability"),
    "POD nan": (WHEN + BOX + "pod = nan\n", "not finite"),
    "a certain POD": (WHEN + BOX + "pod = 1\n", "needs endless effort"),
    "POD for no scenario": (WHEN + BOX + "pod = { raft = 0.5, swimer = 0.5 }\n", 'no scenario "swimer"; did you mean "swimmer"?'),
    "POD for one scenario": (WHEN + BOX + "pod = { raft = 0.5 }\n", 'pod lacks scenario "swimmer"'),
    "POD and spacing": (FULL + 'pod = 0.5\nspacing = "1 nmi"\n', "give pod or spacing, not both"),
    "POD of legs": (WHEN + WIDTH + FAST + SWEEP + "pod = 0.5\n", "pod belongs with area"),
    "spacing beside a pattern": (WHEN + WIDTH + FAST + SWEEP + 'spacing = "1 nmi"\n', "spacing belongs inside pattern"),
    "an area without effort": (WHEN + WIDTH + BOX, "how well was the area searched?"),
    "an area that cannot be flown": (FULL + 'spacing = "0.5 nmi"\n', "200 nmi2 at a spacing of 0.5 nmi take 4.4 h at 90 kn"),
    "no sweep width": (WHEN + BOX + FAST, "sweep_width is missing"),
    "sweep width zero": (FULL.replace('"1.2 nmi"', "0"), "sweep width 0 must be 10 m to"),
    "sweep width in no unit": (FULL.replace('"1.2 nmi"', "1.2"), 'write its unit, like "1.2 nmi"'),
    "sweep width in a unit misread": (FULL.replace('"1.2 nmi"', '"1.2 nm"'), "can be misread"),
    "negative sweep width": (FULL.replace('"1.2 nmi"', '"-1 nmi"'), "must be 10 m to"),
    "sweep width of no scenario": (FULL.replace('"1.2 nmi"', '{ raft = "1 nmi", boat = "1 nmi" }'), 'no scenario "boat"'),
    "sweep width of one scenario": (FULL.replace('"1.2 nmi"', '{ raft = "1 nmi" }'), 'lacks scenario "swimmer"'),
    "an empty table": (FULL.replace('"1.2 nmi"', "{}"), "is empty"),
    "tables without visibility": (FULL.replace('"1.2 nmi"', '{ wind = "5 kn" }'), "visibility: is missing"),
    "tables without weather": (FULL.replace('"1.2 nmi"', '{ visibility = "5 nmi" }'), "wind or seas is missing"),
    "tables misspelled": (FULL.replace('"1.2 nmi"', '{ visibility = "5 nmi", wimd = "5 kn" }') + 'unit = "Aircraft"\naltitude = "500 ft"\n', 'did you mean "wind"?'),
    "an unlikely uncertainty": (FULL + "sweep_width_uncertainty = 30\n", "standard deviation as a share"),
    "a group of nothing": (FULL + 'sweep_group = ""\n', "one line of letters"),
    "unknown law": (FULL + 'law = "inverse cube"\n', 'did you mean "inverse_cube"?'),
    "a law that is a number": (FULL + "law = 0.8\n", "no detection function 0.8"),
    "a beta above 1": (FULL + "law = { m_beta = 1.8 }\n", "m_beta 1.8 must be a probability"),
    "a beta of nothing": (FULL + "law = { m_beta = 0 }\n", "never detects"),
    "a curve of one row": (FULL + 'law = { curve = [["0 nmi", 0.9]] }\n', "two or more rows"),
    "a curve that begins far": (FULL + 'law = { curve = [["1 nmi", 0.9], ["2 nmi", 0.4]] }\n', "must be 0"),
    "a curve that goes back": (FULL + 'law = { curve = [[0, 0.9], ["2 nmi", 0.4], ["1 nmi", 0]] }\n', "does not come after"),
    "a curve above 1": (FULL + 'law = { curve = [[0, 9], ["2 nmi", 0.4]] }\n', "must be a probability"),
    "a curve of nothing": (FULL + 'law = { curve = [[0, 0], ["2 nmi", 0]] }\n', "detects nothing"),
    "a curve and another width": (FULL + 'law = { curve = [[0, 1], ["1 nmi", 1]] }\n', "the curve sweeps 2 nmi"),
    "random legs": (WHEN + WIDTH + FAST + SWEEP + 'law = "random"\n', "applies to an area without legs"),
    "unknown unit": (FULL + 'unit = "Zeppelin"\n', 'no kind of unit "Zeppelin"; allowed: "Aircraft", "Helicopter", "Boat"'),
    "unknown key": (FULL + 'spede = "90 kn"\n', 'did you mean "speed"?'),
    "unknown frame": (FULL + 'frame = "sea"\n', "'ground' or 'datum'"),
    "standing still": (FULL.replace('"90 kn"', '"0 kn"'), "must be above 0"),
    "completed nothing": (FULL + "completed = 0\n", "must be a share above 0"),
    "completed too much": (FULL + "completed = 60\n", 'like 0.6 or "60 %"'),
    "unknown pattern": (WHEN + WIDTH + FAST + SWEEP.replace("parallel", "zigzag"), "'zigzag' is not allowed"),
    "a pattern without a speed": (WHEN + WIDTH + SWEEP, "speed is missing"),
    "a pattern without a length": (WHEN + WIDTH + FAST + SWEEP.replace('length = "20 nmi", ', ""), "length is missing; a parallel"),
    "a square with a width": (WHEN + WIDTH + FAST + SQUARE.replace("legs = 6", 'width = "1 nmi"'), "width does not belong here"),
    "a square without an end": (
        'start = "+6 h"\n' + WIDTH + FAST + SQUARE.replace(", legs = 6", ""),
        "needs legs = their number, or the sortie's end",
    ),
    "no corner": (WHEN + WIDTH + FAST + SWEEP.replace(" }", ', corner = "left" }'), "'left' is not a corner"),
    "half a corner": (WHEN + WIDTH + FAST + SWEEP.replace(" }", ', corner = "N" }'), "two corners are equally far in that direction"),
    "a pattern that takes too long": (
        WHEN.replace("+8", "+7") + WIDTH + FAST + SWEEP,
        "119 nmi of legs take 79 min, but start to end is 60 min",
    ),
    "a share that takes too long": (
        'start = "+6 h"\nend = "+6.5 h"\ncompleted = 0.5\n' + WIDTH + FAST + SWEEP,
        "59.5 nmi of legs take 40 min",
    ),
    "one waypoint": (WHEN + WIDTH + FAST + 'waypoints = ["27 30N 088 00W"]\n', "two or more waypoints"),
    "waypoints in one place": (WHEN + WIDTH + FAST + "waypoints = [[-88, 27], [-88, 27]]\n", "has no length"),
    "waypoints without a speed": (WHEN + WIDTH + POINTS, "speed is missing"),
    "half of the times": (
        WHEN + WIDTH + FAST + 'waypoints = [["+6 h", [-88, 27]], [-88, 27.5]]\n',
        "1 of 2 waypoints have a time",
    ),
    "times that go back": (WIDTH + TIMED.replace("+7 h", "+5 h"), "210500ZNOV26 does not come after 210600ZNOV26"),
    "legs before the start": (WIDTH + TIMED + 'start = "+6.5 h"\n', "begin at 210600ZNOV26, before its start, 210630ZNOV26"),
    "legs after the end": (WIDTH + TIMED + 'end = "+6.5 h"\n', "15 nmi of legs take 60 min"),
    "legs faster than the unit": (WIDTH + TIMED + 'speed = "12 kn"\n', "is made at 15 kn; its speed is 12 kn"),
    "legs faster than any": (WIDTH + TIMED.replace("27 45N", "37 45N"), "is made at 615 kn; at most 292 kn is allowed"),
    "no track": (WHEN + WIDTH + 'track = "none.gpx"\n', 'track: no file "none.gpx"'),
    "a watch without zones": (WHEN + 'watch = { at = "27 30N 088 00W" }\n', "watch: give exactly one of zones and sensor"),
    "a watch in two places": (WHEN + WATCH + TIMED, "exactly one place"),
    "a watch nowhere": (WHEN + WATCH.replace('at = "27 30N 088 00W", ', ""), "exactly one place"),
    "a watch with a law": (WHEN + WATCH + 'law = "random"\n', "law does not belong to a watch"),
    "a watch in part": (WHEN + WATCH + "completed = 0.5\n", "completed does not belong to a watch"),
    "overlapping zones": (WHEN + WATCH.replace('"5 nmi"', '"29 nmi"'), "two zones overlap between 28 and 29 nmi"),
    "a zone from far to near": (WHEN + WATCH.replace('"28 nmi", "32 nmi"', '"32 nmi", "28 nmi"'), "from its inner to its outer"),
    "a zone with a POD of 6": (WHEN + WATCH.replace("0.6", "6"), "POD 6 must be a probability"),
    "a zone of two": (WHEN + WATCH.replace(", 0.6", ""), "is not a zone"),
    "unknown in a watch": (WHEN + WATCH.replace("zones", "zone"), 'did you mean "zones"?'),
    "actual and completed": (FULL + "completed = 0.5\n" + 'actual = [["+6 h", [0, 0]], ["+7 h", [0, 0.1]]]\n', "not both"),
    "actual without times": (FULL + "actual = [[-88, 27], [-88, 27.1]]\n", "with their times"),
    "actual too fast": (FULL + 'actual = [["+6 h", [-88, 27]], ["+7 h", [-88, 29]]]\n', "is made at 120 kn; its speed is 90 kn"),
    "a marker on the ground": (
        FULL + 'marker = { positions = [["+6 h", [0, 0]], ["+8 h", [0, 1]]] }\n',
        'marker belongs to frame = "datum"',
    ),
    "a marker that comes late": (
        WHEN + WIDTH + FAST + SQUARE + 'marker = { positions = [["+7 h", [0, 0]], ["+8 h", [0, 1]]] }\n',
        "known from 210700ZNOV26 to 210800ZNOV26, not for the whole sortie",
    ),
    "a marker without times": (
        WHEN + WIDTH + FAST + SQUARE + "marker = { positions = [[0, 0], [0, 1]] }\n",
        "positions of a marker need their times",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", SORTIES)
def test_what_is_wrong_with_a_sortie(kind: str, tmp_path: Path) -> None:
    given, word = SORTIES[kind]
    line = refusal(tmp_path, SORTIE, given)
    assert "sortie" in line or "TOML" in line
    assert word in line


def test_tables_ask_for_what_they_need(tmp_path: Path) -> None:
    looked = (
        WHEN + BOX + 'spacing = "1 nmi"\nsweep_width = { visibility = "5 nmi", wind = "5 kn" }\n'
    )
    plane = 'unit = "Aircraft"\n'
    high = 'altitude = "500 ft"\n'
    assert "need the kind of unit" in refusal(tmp_path, SORTIE, looked)
    assert "need altitude" in refusal(tmp_path, SORTIE, looked, plane, FAST)
    assert "need its speed" in refusal(tmp_path, SORTIE, looked, plane, high)
    fast = 'speed = "150 kn"\n'
    assert one(tmp_path, looked, plane, high, fast).sweep_width[0] == pytest.approx(1.3 * 1.1 * NMI)
    assert 'not to sensor "radar"' in refusal(
        tmp_path, SORTIE, looked, plane, high, fast, 'sensor = "radar"\n'
    )
    line = refusal(
        tmp_path,
        SORTIE,
        looked,
        plane,
        high,
        fast,
        scenarios=SCENARIOS.replace('search_object = "raft', '#"'),
    )
    assert 'need search_object in scenario "raft"' in line
    line = refusal(tmp_path, SORTIE, looked, plane, 'altitude = "9000 ft"\n', fast)
    assert "300 to 3000 ft" in line


def test_an_unknown_search_object(tmp_path: Path) -> None:
    line = refusal(tmp_path, scenarios=SCENARIOS.replace("raft 4 person", "raft 5 person"))
    assert 'scenario "raft".search_object: no search object "raft 5 person"' in line
    assert 'nearest by size are "Raft 4 person" or "Raft 6 person"' in line


def test_a_name_of_nothing(tmp_path: Path) -> None:
    assert "must be one line of letters" in refusal(tmp_path, SORTIE.replace("first", ""), FULL)


def test_names_that_come_twice(tmp_path: Path) -> None:
    assert 'sortie "first": two sorties have this name' in refusal(tmp_path, (SORTIE + FULL) * 2)
    assert 'sortie "sortie 2": two' in refusal(
        tmp_path, SORTIE.replace("first", "sortie 2"), FULL, "[[sortie]]\n", FULL
    )
    assert 'contact "flare": two contacts' in refusal(tmp_path, (CONTACT + SEEN) * 2)
    assert 'unit "H60": two units' in refusal(tmp_path, (UNIT + WIDTH) * 2)


def test_one_group_has_one_uncertainty(tmp_path: Path) -> None:
    second = "[[sortie]]\n" + FULL + 'sweep_width_uncertainty = "30 %"\n'
    line = refusal(tmp_path, SORTIE, FULL, 'sweep_group = "b"\n', second, 'sweep_group = "b"\n')
    for word in ('sortie "sortie 2"', "is 30 %, but 0", 'sortie "first"', 'sweep_group "b"'):
        assert word in line
    # by default what is known differently is apart
    assert len(load(tmp_path, SORTIE, FULL, second).sorties) == 2
    # a watch has no sweep width
    assert len(load(tmp_path, SORTIE, WHEN, WATCH, second).sorties) == 2


def test_tracks_that_do_not_fit(tmp_path: Path) -> None:
    early = gpx(tmp_path, (-88, 27.5, 1), (-88, 27.6, 2))
    assert "covers 210100ZNOV26 to 210200ZNOV26" in refusal(
        tmp_path, SORTIE, WHEN, WIDTH, f"track = {early}\n"
    )
    plain = gpx(tmp_path, (-88, 27.5, None), (-88, 27.6, None), name="plain.gpx")
    line = refusal(tmp_path, SORTIE, WHEN, WIDTH, f"track = {plain}\n")
    assert 'track: "plain.gpx": its points have no times; give the speed and the start' in line
    fast = gpx(tmp_path, (-88, 27.0, 6), (-88, 29, 7))
    assert "is made at 120 kn; its speed is 90 kn" in refusal(
        tmp_path, SORTIE, WHEN, WIDTH, FAST, f"track = {fast}\n"
    )
    (tmp_path / "t.gpx").write_text("hello")
    assert '"t.gpx" is not a GPX file' in refusal(
        tmp_path, SORTIE, WHEN, WIDTH, 'track = "t.gpx"\n'
    )
    assert 'marker.track: "plain.gpx" has no times' in refusal(
        tmp_path, SORTIE, WHEN, WIDTH, FAST, SQUARE, 'marker = { track = "plain.gpx" }\n'
    )


SEARCHES = [SORTIE + FULL, CONTACT + SEEN, UNIT + WIDTH, "[plan]\n", "[resampling]\n"]


@pytest.mark.parametrize("given", SEARCHES)
def test_backward_runs_and_spills_have_no_search(given: str, tmp_path: Path) -> None:
    table = given.splitlines()[0]
    backward = HEAD.replace('duration = "24 h"', 'duration = "24 h"\ndirection = "backward"')
    assert f"{table} belongs to a forward run" in refusal(tmp_path, given, head=backward)
    spill = '[spill]\nobjects = 5\nposition = { at = [-88, 27.5], std = "1 nmi" }\n[[spill.class]]\nname = "drum"\nobject = "PIW-1"\n'
    assert f"{table} belongs to a search with [[scenario]]" in refusal(
        tmp_path, given, scenarios=spill
    )


def test_every_kind_of_table_is_told_by_name(tmp_path: Path) -> None:
    """Whatever of a search is misspelled is refused with its place."""
    for given, place in (
        (SORTIE + FULL, 'sortie "first"'),
        (CONTACT + SEEN, 'contact "flare"'),
        (UNIT + WIDTH, 'unit "H60"'),
    ):
        assert f'{place}: unknown key "colour"' in refusal(tmp_path, given, 'colour = "red"\n')


def test_any_mix_of_kinds_of_search_is_refused(tmp_path: Path) -> None:
    kinds: dict[str, Any] = {
        "area": BOX,
        "pattern": SWEEP,
        "waypoints": POINTS,
        "track": 'track = "t.gpx"\n',
    }
    for first, second in itertools.combinations(kinds, 2):
        assert f"found {first} and {second}" in refusal(
            tmp_path, SORTIE, WHEN, WIDTH, FAST, kinds[first], kinds[second]
        )
