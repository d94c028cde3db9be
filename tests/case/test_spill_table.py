"""Errors of the tables of a spill: one line that says what is wrong, given, allowed and where."""

from pathlib import Path

import numpy as np
import pytest
from island_spill import AT, BOX, DRUM, FIND, PATROL, SPILL, TEN, refusal, written

from drift.case import file as case_file
from drift.spills.worlds import release
from geo.errors import UserError

pytestmark = pytest.mark.usefixtures("coarse_maps")  # no number is read off a map


@pytest.mark.parametrize("time", ["-1 h", "+0 h", "2026-11-20T00:00Z"])
def test_a_find_before_the_release(time: str, tmp_path: Path) -> None:
    line = refusal(tmp_path, FIND + AT + f'time = "{time}"\n')
    for word in (
        "find 1: found at 2",
        "not after the spill",
        "210000ZNOV26 at the earliest",
        "[spill] position.time",
    ):
        assert word in line


def test_more_finds_than_objects(tmp_path: Path) -> None:
    line = refusal(tmp_path, (FIND + AT + TEN) * 21)
    for word in ("21 finds", "only 20 objects", "[spill] objects", "being false"):
        assert word in line
    line = refusal(tmp_path, (FIND + AT + TEN + 'class = "box"\n') * 11, classes=DRUM + BOX)
    for word in (
        '11 finds of class "box"',
        "at most 10 of the 20",
        "[spill] objects",
        "being false",
    ):
        assert word in line


@pytest.mark.parametrize("detection", ["1.2", "-0.1", '"120 %"'])
def test_a_patrol_with_an_impossible_probability(detection: str, tmp_path: Path) -> None:
    line = refusal(tmp_path, PATROL + TEN + f"detection = {detection}\n")
    assert 'patrol "walk": detection' in line
    assert f"{1.2 if '1' in detection and '2' in detection else -0.1}" in line
    assert "must be a probability, 0 to 1" in line


@pytest.mark.parametrize(
    ("detection", "word"), [("nan", "not finite"), ("inf", "not finite"), ("true", '"0.8"')]
)
def test_a_patrol_with_no_probability(detection: str, word: str, tmp_path: Path) -> None:
    line = refusal(tmp_path, PATROL + TEN + f"detection = {detection}\n")
    assert 'patrol "walk".detection' in line
    assert word in line


FINDS = {
    "no place": (TEN, "exactly one of at, stretch"),
    "two places": (AT + 'stretch = "west"\n' + TEN, "found at and stretch"),
    "no time": (AT, "exactly one of time, by_time"),
    "two times": (AT + TEN + 'by_time = "+11 h"\n', "found time and by_time"),
    "after the end": (AT + 'time = "+13 h"\n', "after the run's end, 211200ZNOV26"),
    "unknown class": (
        AT + TEN + 'class = "boks"\n',
        'class "boks" is not a class of the spill with a share: drum',
    ),
    "unknown patrol": (
        AT + TEN + 'by = "walk"\n',
        'by "walk" is not a patrol; patrols: none is given',
    ),
    "surely false": (AT + TEN + "false = 1\n", "leave it out"),
    "falser than can be": (AT + TEN + "false = 1.5\n", "1.5 must be a share, 0 to 1"),
    "false without end": (AT + TEN + "false = nan\n", "nan is not finite"),
    "no longitude": ("at = [nan, 27.2]\n" + TEN, "longitude nan is outside -180 to 360"),
    "endless longitude": ("at = [inf, 27.2]\n" + TEN, "longitude inf is outside"),
    "swapped": ("at = [27.2, -88.0, 3]\n" + TEN, "find 1.at"),
    "at sea on a stretch": ('stretch = "west"\nat_sea = true\n' + TEN, "at_sea needs at"),
    "at sea by a patrol": (AT + 'by = "walk"\nat_sea = true\n' + TEN, "no patrol"),
    "no radius": (AT + 'at_sea = true\nradius = "0 m"\n' + TEN, "greater than 0"),
    "radius ashore": (
        AT + 'radius = "1 km"\n' + TEN,
        "radius belongs to a find with at_sea = true",
    ),
    "nameless": ('name = ""\n' + AT + TEN, "one line of letters"),
    "misspelled": (AT + 'tiem = "+10 h"\n', 'did you mean "time"?'),
}


@pytest.mark.parametrize("kind", FINDS)
def test_finds(kind: str, tmp_path: Path) -> None:
    given, word = FINDS[kind]
    line = refusal(tmp_path, FIND + given)
    assert "find" in line
    assert word in line


def test_names_that_come_twice(tmp_path: Path) -> None:
    assert 'find "a": two finds' in refusal(tmp_path, (FIND + 'name = "a"\n' + AT + TEN) * 2)
    assert 'find "find 2": two finds' in refusal(
        tmp_path, FIND + 'name = "find 2"\n' + AT + TEN + FIND + AT + TEN
    )
    assert 'patrol "walk": two patrols' in refusal(
        tmp_path, (PATROL + TEN + "detection = 0.5\n") * 2
    )
    assert 'class "drum": two classes' in refusal(tmp_path, classes=DRUM * 2)


PATROLS = {
    "before the release": ('time = "-1 h"\ndetection = 0.5\n', "", "not after the spill"),
    "after the end": ('time = "+13 h"\ndetection = 0.5\n', "", "after the run's end"),
    "two places": (
        TEN + "detection = 0.5\nbetween = [[-88, 27.1], [-88, 27.2]]\n",
        "",
        "either stretches",
    ),
    "found at another time": (
        TEN + "detection = 0.5\n",
        'time = "+9 h"\n',
        "was there at 211000ZNOV26",
    ),
    "found not later than": (
        TEN + "detection = 0.5\n",
        'by_time = "+9 h"\n',
        "give time, or leave it",
    ),
    "found by one that finds nothing": (TEN + "detection = 0\n", TEN, "whose detection is 0"),
}


@pytest.mark.parametrize("kind", PATROLS)
def test_patrols(kind: str, tmp_path: Path) -> None:
    patrol, find, word = PATROLS[kind]
    line = refusal(tmp_path, PATROL + patrol + (FIND + AT + 'by = "walk"\n' + find if find else ""))
    assert word in line


def test_a_find_by_a_patrol_has_the_time_of_the_patrol(tmp_path: Path) -> None:
    loaded = case_file.load(
        written(tmp_path, PATROL + TEN + 'detection = "80 %"\n' + FIND + AT + 'by = "walk"\n')
    )
    assert loaded.spill is not None
    assert loaded.spill.finds[0].time == np.datetime64("2026-11-21T10:00")
    assert loaded.spill.patrols[0].detection == pytest.approx(0.8)


SPILLS = {
    "no objects": ("objects = 20", "objects = 0", "1 to 1,000,000"),
    "fewer than none": ("objects = 20", "objects = -3", "1 to 1,000,000"),
    "half an object": ("objects = 20", "objects = 2.5", "not a whole number"),
    "endless objects": ("objects = 20", "objects = inf", "not a whole number"),
    "objects from high to low": ("objects = 20", "objects = [30, 10]", "[lowest, highest]"),
    "too few worlds": ("worlds = 60", "worlds = 10", "worlds 10: must be at least 50"),
    "too many worlds": ("worlds = 60", "worlds = 1000000000", "this machine's memory holds"),
    "too few particles": ("per_world = 40", "per_world = 5", "per_world 5: must be at least 10"),
    "negative release_duration": ('"1 h"', '"-1 h"', "0 to 366 d"),
    "endless release_duration": ('"1 h"', "inf", "not finite"),
    "release_duration beyond 32 bits": ('"1 h"', '"1000000 d"', "0 to 366 d"),
    "negative release_std": ('release_std = "1 km"', 'release_std = "-1 km"', "at least 0 m"),
    "destroyed from high to low": ("[0, 0.3]", "[0.5, 0.2]", "[0.5, 0.2] must go from low to high"),
    "more than all destroyed": ("[0, 0.3]", "1.5", "1.5 must be a share"),
    "destroyed nan": ("[0, 0.3]", "[nan, 0.3]", "nan is not finite"),
    "too uncertain": ("windage_bias = 0.3", "windage_bias = 5", "0 to 1"),
    "two places": (
        "redraws",
        "area = { polygon = [[-89, 27], [-88.5, 27], [-88.5, 28]] }\nredraws",
        "and area",
    ),
    "released after the end": ('"3 km" }', '"3 km", time = "+13 h" }', "outside the run"),
    "released backward": ('"3 km" }', '"3 km", time = "+3 h", until = "+1 h" }', "is before time"),
    "misspelled": ("objects = 20", "objcets = 20", 'did you mean "objects"?'),
    "stretches too short": ('"4 km"', '"1 m"', "stretches.length"),
    "no file of stretches": ('"4 km"', '"4 km"\nfile = "no.geojson"', 'no file "no.geojson"'),
    "rate without a unit": (
        '"4 km"',
        '"4 km"\n[spill.reporting]\nrate = { wild = 0.02 }',
        'like "0.02 /h"',
    ),
    "negative rate": (
        '"4 km"',
        '"4 km"\n[spill.reporting]\nrate = { wild = "-1 /day" }',
        "0 to 1 per second",
    ),
    "rate nan": ('"4 km"', '"4 km"\n[spill.reporting]\nremoval = nan', "removal"),
    "shore without a rate": (
        '"4 km"',
        '"4 km"\n[spill.reporting]\ncoast = "twon"',
        "town, road, wild",
    ),
    "known before the spill": (
        '"4 km"',
        '"4 km"\n[spill.reporting]\nuntil = "-1 h"',
        "is before the spill",
    ),
}


@pytest.mark.parametrize("kind", SPILLS)
def test_spills(kind: str, tmp_path: Path) -> None:
    old, new, word = SPILLS[kind]
    assert old in SPILL
    assert word in refusal(tmp_path, spill=SPILL.replace(old, new, 1))


OLD_KEYS = {"release_duration": "lasting", "release_std": "scatter", "redraws": "renewals"}


def test_old_keys_make_the_same_record(tmp_path: Path) -> None:
    """All three at once, with values that are no defaults."""
    new = SPILL.replace("redraws = 0", "redraws = 2")
    old = new
    for key, before in OLD_KEYS.items():
        old = old.replace(f"{key} = ", f"{before} = ")
    spill = case_file.load(written(tmp_path, spill=new)).spill
    assert spill is not None
    assert (spill.release_duration, spill.release_std, spill.redraws) == (3600.0, 1000.0, 2)
    assert case_file.load(written(tmp_path, spill=old)).spill == spill


@pytest.mark.parametrize("key", OLD_KEYS)
def test_a_key_by_both_names_is_refused(key: str, tmp_path: Path) -> None:
    """In one line that names both; so is --set with an old key, of a case that has the new one."""
    before = OLD_KEYS[key]
    (given,) = [line for line in SPILL.splitlines() if line.startswith(key)]
    line = refusal(tmp_path, spill=SPILL.replace(given, f"{given}\n{given.replace(key, before)}"))
    assert line.endswith(
        f'spill: "{before}" is the old name of "{key}", and both are given; give {key} alone'
    )
    with pytest.raises(UserError, match=f'"{before}" is the old name of "{key}"'):
        case_file.load(written(tmp_path), {f"spill.{before}": "1"})


def test_an_unknown_key_is_likened_to_the_keys_of_today(tmp_path: Path) -> None:
    line = refusal(tmp_path, spill=SPILL.replace("release_std", "scattre"))
    assert "scatter," not in line
    assert "release_std, release_duration" in line


CLASSES = {
    "none": ("", "spill.class"),
    "shares of nothing": (DRUM + "share = 0\n" + BOX + "share = 0\n", "add up to 0"),
    "shares of more than all": (
        DRUM + "share = 0.5\n" + BOX + "share = 0.55\n",
        "add up to 1.05 (drum 0.5, box 0.55); they must add up to 1",
    ),
    "a share of nothing left": (
        DRUM + BOX + "share = 1\n",
        "they must add up to 1, and leave a remainder for classes",
    ),
    "negative share": (DRUM + "share = -1\n", "at least 0"),
    "share nan": (DRUM + "share = nan\n", "not finite"),
    "five": ("".join(DRUM.replace("drum", f"d{k}") for k in range(5)), "at most 4"),
    "too deep": (
        DRUM.replace('windage = "2 %"', "immersion = [0.5, 1.2]"),
        "1.2 must be a share, 0 to 1",
    ),
    "not deep enough": (DRUM.replace('windage = "2 %"', "immersion = [0, 0.5]"), "0.05 to 1"),
    "immersion nan": (DRUM.replace('windage = "2 %"', "immersion = nan"), "not finite"),
    "sinks by two laws": (
        DRUM + 'sinking = { half_life = "5 d", waterlogged = "9 d" }\n',
        "found half_life and",
    ),
    "sinks by none": (DRUM + "sinking = {}\n", "found none"),
    "sinks at once": (DRUM + 'sinking = { half_life = "0 d" }\n', "above 0 s"),
    "half-life with a spread": (
        DRUM + 'sinking = { half_life = "5 d", spread = 2 }\n',
        "spread belongs to waterlogged",
    ),
    "spread nan": (DRUM + 'sinking = { waterlogged = "5 d", spread = nan }\n', "spread"),
    "unknown object": (DRUM.replace('{ windage = "2 %" }', '"OIL-DRUMM"'), 'nearest is "OIL-DRUM"'),
}


@pytest.mark.parametrize("kind", CLASSES)
def test_classes(kind: str, tmp_path: Path) -> None:
    classes, word = CLASSES[kind]
    assert word in refusal(tmp_path, classes=classes)


SCENARIO = '[[scenario]]\nname = "boat"\nobject = "PIW-1"\nposition = { at = [-88.1, 27.2], std = "1 km" }\n'


def test_what_does_not_go_together(tmp_path: Path) -> None:
    assert "either [[scenario]]" in refusal(tmp_path, SCENARIO)
    assert "belong to a [spill]" in refusal(
        tmp_path, SCENARIO + FIND + AT + TEN, spill="", classes=""
    )
    assert "either [[scenario]]" in refusal(tmp_path, spill="", classes="")
    for setting, word in (
        ('direction="backward"', "runs forward: give an end after the start"),
        ('coast.source="none"', 'give "gshhg" or a shoreline file'),
        ('coast.behaviour="refloat"', "needs a half_life"),
        ('coast.half_life="6 h"', "needs a half_life"),
        ("particles=100", "spill.worlds x spill.per_world"),
    ):
        key, value = setting.split("=")
        with pytest.raises(UserError, match=word.replace("[", r"\[")):
            case_file.load(written(tmp_path), {key: value})


def test_all_destroyed_and_yet_one_found(tmp_path: Path) -> None:
    line = refusal(tmp_path, FIND + AT + TEN, spill=SPILL.replace("[0, 0.3]", "1"))
    assert "destroyed = 1 leaves nothing to be found" in line


def test_a_class_without_a_share_is_left_out(tmp_path: Path) -> None:
    classes = DRUM + BOX + "share = 0\n"
    assert 'class "box" is not a class' in refusal(
        tmp_path, FIND + AT + TEN + 'class = "box"\n', classes=classes
    )
    loaded = case_file.load(written(tmp_path, classes=classes))
    assert [scenario.name for scenario in loaded.scenarios] == ["drum"]


def test_shares_are_rounded_and_the_rest_is_shared(tmp_path: Path) -> None:
    third = DRUM.replace("drum", "third") + "share = 0.33\n"
    for classes, shares in (
        (DRUM + "share = 0.33\n" + BOX + "share = 0.33\n" + third, [1 / 3] * 3),
        (DRUM + BOX, [0.5, 0.5]), (DRUM + BOX + third, [0.335, 0.335, 0.33]),
    ):  # fmt: skip
        spill = case_file.load(written(tmp_path, classes=classes)).spill
        assert spill is not None
        assert [kind.share for kind in spill.kinds] == pytest.approx(shares)


def test_a_class_with_a_small_share_has_particles(tmp_path: Path) -> None:
    spill = case_file.load(written(tmp_path, classes=DRUM + BOX + "share = 0.001\n")).spill
    assert spill is not None
    drums, boxes = release.particles_per_class(spill)
    assert drums + boxes == spill.per_world
    assert boxes >= 5
