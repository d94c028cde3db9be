"""Tracking cases: every mistake is a line that says what is wrong, what was given and what is
allowed.
"""

from pathlib import Path

import numpy as np
import pytest

import drift
from drift.case.tracking import tracking
from geo.errors import UserError

GOOD = """
title = "t"
start = "2026-03-05T00:00Z"
duration = "1 h"
[target]
at = "34 00N 120 30W"
legs = [{ course = 200, speed = "12 kn" }]
radiates = { every = "20 min", lasting = "5 min" }
[tracker]
at = "34 00N 121 00W"
[[sensor]]
name = "eyes"
reach = "10 nmi"
range_ambiguity = 0.3
bearing_ambiguity = 1.5
[[method]]
name = "m"
fastest = "32 kn"
acts = ["3 min", "15 min"]
change = 0.5
"""


def load(folder: Path, text: str, **changes: str) -> object:
    (folder / "c.toml").write_text(text, encoding="utf-8")
    return tracking.load(folder / "c.toml", changes)


def test_a_good_case_is_read(tmp_path: Path) -> None:
    asked = load(tmp_path, GOOD)
    assert isinstance(asked, tracking.Study)
    assert asked.start == np.datetime64("2026-03-05T00:00:00")
    assert (asked.end, asked.every, asked.size, asked.runs) == (3600.0, 300.0, 2500, 100)
    assert asked.sensors[0].bearing_error == pytest.approx(np.radians(1.5))
    assert asked.methods[0].behaviour.acts == (180.0, 900.0)
    for name in tracking.shipped():
        assert tracking.load(name).size == 2500


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('duration = "1 h"', 'duration = "1 h"\ngrace = "5 min"', 'unknown key "grace"; it is a key of [[sensor]]. Allowed: title, start,'),
        ('duration = "1 h"', 'duration = "1 h"\nwindow = 3', 'unknown key "window"; it is a key of [experiment]. Allowed: title,'),
        ("change = 0.5", 'change = 0.5\n[experiment.published.m]\n"position eror" = 2.5', 'experiment.published "m": no figure "position eror"; there are position error, course'),
        ('reach = "10 nmi"', 'reach = "10 nmi"\nseed = 3', 'sensor "eyes": unknown key "seed"; it is a key of the file itself, above its first [table]. Allowed: name,'),
        ('reach = "10 nmi"', 'reach = "10 nmi"\ngrace = "20 min"', 'sensor "eyes".grace: only applies to cases with detections; with a [target] every sweep is simulated'),
        ('duration = "1 h"', 'duration = "1 h"\nshow = ["5 min"]', "show: needs detections; this case has a [target], for experiments"),
        ('acts = ["3 min", "15 min"]', 'acts = ["0.001 s", "15 min"]', "acts: the shortest time between acts must be 1 s or more"),
        ('fastest = "32 kn"', "fastest = 1e-300", "fastest 1e-300 m/s must be 0.01 m/s or more"),
        ('reach = "10 nmi"', 'reach = "10 nmi"\non = { every = 1e-300, lasting = 1 }', "duration 1e-300 must be at least 0.001 s"),
        ('reach = "10 nmi"', 'reach = "10 kn"', '"10 kn" is not a distance'),
        ('duration = "1 h"', 'duration = "1 h"\nevery = "1 ms"', "every: gives more than 100,000 figures; the case lasts 60 min"),
        ('at = "34 00N 120 30W"', 'at = "90 00N 120 30W"', "target: legs: at a pole a course has no meaning; begin beside it"),
        ("change = 0.5", "change = 0.5\n[experiment]\nareas = [0.5, 90]", "areas: 0.5 is less than 1 per cent; write 50 for a share of 0.5"),
        ("range_ambiguity = 0.3", "range_ambiguity = 1.2", "range_ambiguity: 1.2 must be a share of the range, 0 (exact) to 1"),
        ("bearing_ambiguity = 1.5", "bearing_ambiguity = 200", "must be above 0 and at most 180 degrees"),
        ("change = 0.5", "change = 0.7\nseek = 0.2\nhide = 0.2", "change 0.7, seek 0.2 and hide 0.2 are 1.1 together; at most 1"),
        ('acts = ["3 min", "15 min"]', "", "change, seek and hide are at times of acts"),
        ('acts = ["3 min", "15 min"]', 'acts = ["15 min", "3 min"]', "acts"),
        ('[tracker]\nat = "34 00N 121 00W"', "", "tracker: it has no position; give at with legs"),
        ('[tracker]\nat = "34 00N 121 00W"', "[tracker]\nlegs = []", "tracker: it has no position"),
        ('lasting = "5 min"', 'lasting = "25 min"', "longer than every"),
        ('speed = "12 kn" }]', 'speed = "12 kn" }, { course = 10, speed = "3 kn" }]', "only the last leg lasts until the end"),
        ('name = "eyes"', 'name = "eyes"\non = { every = "2 min", lasting = "5 min" }', "on: lasting, 5 min, is longer than every, 2 min"),
        ('name = "eyes"', 'name = "eyes"\non = { evry = "2 min", lasting = "1 min" }', 'did you mean "every"'),
        ('name = "eyes"', 'name = "eyes"\non = "always"', "on: 'always' must be true, false, or a table like"),
        ('name = "eyes"', 'name = "eyes"\nhears = true\non = false', "on: a sensor that hears does so while the target radiates"),
        ('name = "eyes"', 'name = "eyes"\nsweep = "1 ms"', "sweep 0.001 s must be 0.1 s or more"),
        ('title = "t"', 'title = "t"\nparticles = 0', "particles: 0 must be 1 to 100,000"),
        ('title = "t"', 'title = "t"\nparticels = 5', 'did you mean "particles"'),
        ('title = "t"', 'title = "t"\nevery = "2 h"', "every: 120 min is longer than the case, 60 min"),
        ('fastest = "32 kn"', 'fastest = "32 kn"\nbulk = 0.9', "bulk 0.9 must not be above partial 0.75"),
        ('radiates = { every = "20 min", lasting = "5 min" }', "", ""),
        ("change = 0.5", "change = 0.5\n[experiment]\nareas = [50, 120]", "must be a percentage above 0 and below 100"),
        ("change = 0.5", 'change = 0.5\n[experiment]\nwindow = ["61 min", "99 min"]', "no figure is taken from 61 min to 99 min; the case lasts 60 min"),
        ("change = 0.5", "change = 0.5\n[experiment.published.other]\nx = 1", 'no method "other"'),
    ],
)  # fmt: skip
def test_each_mistake_is_one_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in GOOD
    if not words:  # nothing hears its radar: allowed until a sensor does
        load(tmp_path, GOOD.replace(old, new))
        words, new = "which is never on", ""
        text = GOOD.replace(old, "").replace("range_ambiguity", "hears = true\nrange_ambiguity")
    else:
        text = GOOD.replace(old, new)
    with pytest.raises(UserError) as told:
        load(tmp_path, text)
    assert len(told.value.lines) == 1, told.value.lines
    assert words in told.value.lines[0]
    assert told.value.lines[0].startswith("c.toml: ")


def test_other_files_are_refused_by_what_they_are(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="is a case of drift run"):
        load(tmp_path, 'title = "x"\n[[scenario]]\nname = "s"\n')
    with pytest.raises(UserError, match="not valid TOML"):
        load(tmp_path, "title =")
    with pytest.raises(
        UserError,
        match="shipped tracking cases: closing, fast_boat, lost_contact, run_to_the_south",
    ):
        tracking.load("closin")
    with pytest.raises(UserError, match='unknown key "x"'):
        load(tmp_path, GOOD, **{"tracker.x.y": "3"})


def test_times_to_show_and_the_begin_of_a_path_are_after_the_start_or_dates() -> None:
    """16 and 70 min after 0200Z are 0216Z and, two hours east of Greenwich, 0510."""
    shown = {
        "show": "['50 min', '050216ZMAR26', '2026-03-05T05:10+02:00']",
        "pursuit.begin": "2026-03-05T03:12:00Z",
    }
    asked = tracking.load("lost_contact", shown)
    assert asked.shown == (960.0, 3000.0, 4200.0)
    assert asked.pursuit is not None
    assert asked.pursuit.begin == 4320.0
    with pytest.raises(
        UserError, match="show: 050159ZMAR26 is not within the case, 050200ZMAR26 to 050415ZMAR26"
    ):
        tracking.load("lost_contact", {"show": "['2026-03-05T01:59Z']"})


@pytest.mark.parametrize("key", ["detectons", "Detections"])
def test_a_tracking_case_is_known_by_its_ways_of_following_whatever_else_is_wrong(
    key: str, tmp_path: Path
) -> None:
    text = GOOD[: GOOD.index("[target]")] + f'{key} = "x.csv"\n' + GOOD[GOOD.index("[tracker]") :]
    (tmp_path / "c.toml").write_text(text, encoding="utf-8")
    assert tracking.is_tracking_case(tmp_path / "c.toml")
    with pytest.raises(
        UserError, match=r"c\.toml: is a tracking case: drift track for one with detections"
    ):
        drift.load(tmp_path / "c.toml")
