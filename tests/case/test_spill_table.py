"""Bad and odd input of a spill: one line that says what is wrong, given, allowed and where; what is
odd is called so.

The spill: 20 objects 10 km west of an island, carried east at about half a metre a second, ashore
after some six hours.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drift.apps.cli.commands import main
from drift.case import file as case_file
from drift.pipeline import flow
from drift.spills.worlds import evidence, release
from geo.errors import UserError

pytestmark = pytest.mark.usefixtures("coarse_maps")  # no number is read off a map

HEAD = """
title = "trial"
start = "2026-11-21T00:00Z"
duration = "12 h"
max_lost = 1.0
output.every = "6 h"
clock.step = "30 min"
[coast]
source = "shore.geojson"
[[current]]
name = "sea"
constant = { speed = "0.5 m/s", toward = 90 }
[[wind]]
name = "air"
constant = { speed = "5 m/s", from = 270 }
"""
SPILL = """
[spill]
objects = 20
worlds = 60
per_world = 40
position = { at = [-88.1, 27.2], error = "3 km" }
windage_bias = 0.3
release_duration = "1 h"
release_std = "1 km"
destroyed = [0, 0.3]
redraws = 0
[spill.stretches]
length = "4 km"
"""
DRUM = '[[spill.class]]\nname = "drum"\nobject = { windage = "2 %" }\n'
BOX = DRUM.replace("drum", "box")
ISLAND = {
    "type": "Polygon",
    "coordinates": [[[-88, 27], [-87.7, 27], [-87.7, 27.4], [-88, 27.4], [-88, 27]]],
}
FIND = "[[find]]\n"
PATROL = '[[patrol]]\nname = "walk"\nstretches = ["west"]\n'
AT = "at = [-88.0, 27.2]\n"  # on the western shore, where most come
TEN = 'time = "+10 h"\n'
EAST = "27-19.9N 087-42.0W"  # a stretch of the lee shore


def written(
    tmp_path: Path, more: str = "", spill: str = SPILL, classes: str = DRUM, shore: Any = ISLAND
) -> Path:
    (tmp_path / "shore.geojson").write_text(json.dumps(shore))
    path = tmp_path / "trial.toml"
    path.write_text(HEAD + spill + classes + more, encoding="utf-8")
    return path


def refusal(tmp_path: Path, *arguments: Any, **given: Any) -> str:
    """Return the one line with which a case file is refused when it is read."""
    with pytest.raises(UserError) as caught:
        case_file.load(written(tmp_path, *arguments, **given))
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 400
    assert message.startswith("trial.toml: ")
    return message


def refused_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], *arguments: Any, **given: Any
) -> str:
    """Return the one line with which `drift run` refuses a case; nothing may have been written."""
    path = written(tmp_path, *arguments, **given)
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert {file.name for file in tmp_path.iterdir()} == {"trial.toml", "shore.geojson"}
    (line,) = captured.err.strip().splitlines()
    return line


def run(tmp_path: Path, *arguments: Any, **given: Any) -> dict[str, Any]:
    """Return the summary's spill; all finite, the totals add up to N."""
    after = flow.run(case_file.load(written(tmp_path, *arguments, **given)))
    spill = after.summary["spill"]
    # NaN: not known
    known = [value for place, value in numbers(spill) if not place.endswith(("_se", "_se_h"))]
    assert np.isfinite(known).all()
    low, high = spill["objects"]
    assert low - 1e-6 <= sum(total["expected"] for total in spill["totals"].values()) <= high + 1e-6
    return dict(spill)


def numbers(value: Any, place: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, dict):
        for key, part in value.items():
            yield from numbers(part, f"{place}.{key}")
    elif isinstance(value, list | tuple):
        for part in value:
            yield from numbers(part, place)
    elif isinstance(value, int | float):
        yield place, float(value)


def total(spill: dict[str, Any], fate: str) -> float:
    return float(spill["totals"][fate]["expected"])


def patrols(names: list[str], detection: float, **times: str) -> str:
    return "".join(
        f'[[patrol]]\nname = "{name}"\nstretches = {json.dumps(names)}\ntime = "{time}"\ndetection = {detection}\n'
        for name, time in times.items()
    )


@pytest.fixture(scope="module")
def stretches(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Names of all stretches of the island."""
    after = flow.run(case_file.load(written(tmp_path_factory.mktemp("plain")))).aftermath
    assert after is not None
    return list(after.segments.name)


# --- the list -------------------------------------------------------------------------------------------------


def test_a_find_on_open_sea(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """0.2 degrees of longitude off the western shore at 27.2 N: 0.2 * 111.195 km * cos(27.2) = 19.8
    km.
    """
    line = refused_run(tmp_path, capsys, FIND + 'name = "box 7"\nat = [-88.2, 27.2]\n' + TEN)
    for word in (
        "box 7",
        "27-12.0N 088-12.0W",
        "19.8 km off the coast",
        "27-12.0N 088-00.0W",
        "within 3 km",
        "at_sea",
    ):
        assert word in line


def test_a_find_far_inland(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """0.14 degrees of longitude from the eastern shore at 27.2 N: 13.8 km."""
    line = refused_run(tmp_path, capsys, FIND + "at = [-87.84, 27.2]\n" + TEN)
    for word in ("find 1", "13.8 km inland", "27-12.0N 087-42.0W", "within 3 km", "move it"):
        assert word in line
    assert "at_sea" not in line


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


@pytest.mark.parametrize(
    "shore",
    [
        {"type": "LineString", "coordinates": [[-88, 27], [-87.7, 27.4]]},
        {"type": "Point", "coordinates": [-88, 27]},
        {"type": "FeatureCollection", "features": []},
    ],
)
def test_a_shoreline_without_polygons(
    shore: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = refused_run(tmp_path, capsys, shore=shore)
    for word in ("shore.geojson", "holds no land polygon", "give polygons of land", '"gshhg"'):
        assert word in line


def test_a_shoreline_that_crosses_itself_is_repaired_and_that_is_said(tmp_path: Path) -> None:
    """A bow tie: two triangles that meet in the middle; its western one still catches what comes."""
    bow = {
        "type": "Polygon",
        "coordinates": [[[-88, 27], [-87.7, 27.4], [-87.7, 27], [-88, 27.4], [-88, 27]]],
    }
    result = flow.run(case_file.load(written(tmp_path, shore=bow)))
    assert (
        "1 of 1 shoreline polygons crossed themselves and were repaired"
        in result.summary["coast"]["notes"]
    )
    assert total(result.summary["spill"], "ashore") > 10


def test_a_domain_with_no_coast(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    domain = "[domain]\nwest = -95\neast = -94\nsouth = 25\nnorth = 26\n"
    line = refused_run(tmp_path, capsys, domain, spill=SPILL.replace("-88.1, 27.2", "-94.5, 25.5"))
    for word in (
        "no coast in its domain",
        "-95.00..-94.00 E",
        "25.00..26.00 N",
        "[domain]",
        "[coast] source",
    ):
        assert word in line


# --- what else a case file may get wrong ------------------------------------------------------------------------------

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
        ("particles=100", "spill.worlds times spill.per_world"),
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


# --- finds and patrols that only the coast can refuse -----------------------------------------------------------------


def test_a_stretch_that_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused_run(tmp_path, capsys, FIND + 'stretch = "27-10.9N 087-42.0E"\n' + TEN)
    assert 'find 1: no stretch "27-10.9N 087-42.0E"' in line
    assert f'nearest is "{EAST}"' in line
    line = refused_run(tmp_path, capsys, PATROL + TEN + "detection = 0.5\n")
    assert 'patrol "walk": no stretch "west"' in line


def test_a_find_where_the_patrol_did_not_go(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = refused_run(
        tmp_path, capsys, patrols([EAST], 0.5, walk="+10 h") + FIND + AT + 'by = "walk"\n'
    )
    assert (
        'find 1: found by patrol "walk" on stretch "27-11.2N 088-00.0W", where that patrol did not go'
        in line
    )


def test_a_patrol_between_places_off_the_coast(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = (
        '[[patrol]]\nname = "walk"\nbetween = [[-88.3, 27.1], [-88.3, 27.3]]\ndetection = 0.5\n'
        + TEN
    )
    line = refused_run(tmp_path, capsys, given)
    assert 'patrol "walk": no stretch has its middle within 3 km' in line


def test_a_find_at_sea_on_land(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused_run(tmp_path, capsys, FIND + "at = [-87.85, 27.2]\nat_sea = true\n" + TEN)
    for word in ("find 1", "27-12.0N 087-51.0W", "not at sea but on land", "at_sea"):
        assert word in line


def test_a_release_on_land(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused_run(tmp_path, capsys, spill=SPILL.replace("-88.1, 27.2", "-87.9, 27.2"))
    for word in ("position.at", "27-12.0N 087-54.0W lies on land", "27-12.0N 088-00.0W"):
        assert word in line


def test_stretches_whose_kind_of_shore_has_no_rate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = [[-88.0, 27.1], [-88.0, 27.3]]
    feature = {"type": "Feature", "geometry": {"type": "LineString", "coordinates": line}}
    feature["properties"] = {"name": "Long Beach", "access": "harbour"}
    (tmp_path / "named.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": [feature]})
    )
    spill = SPILL.replace('"4 km"', '"4 km"\nfile = "named.geojson"')
    path = written(tmp_path, spill=spill)
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 2
    message = capsys.readouterr().err
    assert 'stretch "Long Beach": its kind of shore "harbour" has no reporting rate' in message
    assert "town, road, wild" in message
    assert not (tmp_path / "out").exists()


# --- finds that are possible but odd ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "find",
    [
        f'stretch = "{EAST}"\n' + TEN,  # in the lee, where no particle of any world comes
        AT + 'time = "+2 min"\n',  # before the first can arrive
        AT + 'by_time = "+2 min"\n',
        'at = [-88.3, 27.45]\nat_sea = true\nradius = "200 m"\ntime = "+2 h"\n',
        'at = [10, 50]\nat_sea = true\ntime = "+2 h"\n',  # in another ocean
    ],
)
def test_a_find_where_nothing_comes_is_called_odd(find: str, tmp_path: Path) -> None:
    spill = run(tmp_path, FIND + find)
    (told,) = spill["finds"]
    assert told["odd"]
    assert told["probability_beforehand"] < 0.001
    assert total(spill, "found") == pytest.approx(1)
    assert spill["effective_worlds"] > 59  # it tells no world from another


def test_an_odd_find_leaves_numbers_in_the_files(tmp_path: Path) -> None:
    path = written(tmp_path, FIND + f'stretch = "{EAST}"\n' + TEN)
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 0
    for name in (
        "summary.json",
        "washup.csv",
        "washup_times.csv",
        "totals.csv",
        "unknowns.csv",
        "washup.geojson",
    ):
        assert "nan" not in (tmp_path / "out" / name).read_text().lower()
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["spill"]["finds"][0]["odd"]


def test_nothing_comes_ashore_and_yet_one_was_found(tmp_path: Path) -> None:
    """The current leads away from the island."""
    path = written(tmp_path, FIND + AT + TEN)
    path.write_text(
        path.read_text().replace("toward = 90", "toward = 270").replace("from = 270", "from = 90")
    )
    result = flow.run(case_file.load(path))
    assert result.summary["spill"]["finds"][0]["odd"]
    assert total(result.summary["spill"], "ashore") == 0


def test_all_sunk_and_yet_one_was_found(tmp_path: Path) -> None:
    spill = run(tmp_path, FIND + AT + TEN, classes=DRUM + 'sinking = { half_life = "1 s" }\n')
    assert spill["finds"][0]["odd"]
    assert total(spill, "sunk") > 10


@pytest.mark.parametrize("count", [2, 20])
def test_identical_finds(count: int, tmp_path: Path) -> None:
    """Two at one place and time are two objects; with twenty of twenty nothing is left."""
    spill = run(tmp_path, (FIND + AT + TEN) * count)
    assert total(spill, "found") == pytest.approx(count)
    if count == 20:
        assert total(spill, "destroyed") == 0
        assert total(spill, "ashore") == 0


def test_finds_that_may_all_be_false(tmp_path: Path) -> None:
    """More of them than objects: no error, for some must then be false."""
    spill = run(tmp_path, (FIND + AT + TEN + "false = 0.1\n") * 22)
    assert 10 < total(spill, "found") <= 20


@pytest.mark.thorough
def test_two_hundred_finds(tmp_path: Path) -> None:
    given = (
        SPILL.replace("objects = 20", "objects = 240")
        .replace("[0, 0.3]", "0")
        .replace('"1 h"', "0")
    )
    spill = run(tmp_path, (FIND + AT + TEN) * 200, spill=given)
    assert total(spill, "found") == pytest.approx(200)
    assert spill["effective_worlds"] < 50
    assert "spill.worlds" in spill["warning"]
    assert len(spill["finds"]) == 200


@pytest.mark.parametrize("lon", [180.0, -180.0, 179.999, -179.999])
def test_finds_at_the_antimeridian(lon: float, tmp_path: Path) -> None:
    """A shore along 180 degrees: either spelling is the same stretch, and no odd one."""
    shore = {
        "type": "Polygon",
        "coordinates": [[[180, 27], [180.3, 27], [180.3, 27.4], [180, 27.4], [180, 27]]],
    }
    given = SPILL.replace("-88.1, 27.2", "179.9, 27.2")
    spill = run(tmp_path, FIND + f"at = [{lon}, 27.2]\n" + TEN, spill=given, shore=shore)
    (told,) = spill["finds"]
    assert told["stretch"] == f"stretch {told['segment']}, 27-11.6N 180-00.0W"
    assert told["number"] == 1
    assert not told["odd"]


def test_a_find_beyond_the_antimeridian_is_measured_across_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """0.05 degrees of longitude inside the shore at 27.2 N: 4.9 km."""
    shore = {
        "type": "Polygon",
        "coordinates": [[[180, 27], [180.3, 27], [180.3, 27.4], [180, 27.4], [180, 27]]],
    }
    given = SPILL.replace("-88.1, 27.2", "179.9, 27.2")
    line = refused_run(
        tmp_path, capsys, FIND + "at = [-179.95, 27.2]\n" + TEN, spill=given, shore=shore
    )
    assert "4.9 km inland" in line


def test_a_certain_patrol_that_found_nothing_where_others_may_lie(
    stretches: list[str], tmp_path: Path
) -> None:
    """Sweeping the lee, where nothing comes, changes nothing."""
    spill = run(tmp_path, patrols([EAST], 1.0, walk="+10 h"))
    assert spill["effective_worlds"] > 59
    assert total(spill, "ashore") > 10


def test_a_certain_patrol_that_found_all(stretches: list[str], tmp_path: Path) -> None:
    """Twenty of twenty found by a sweep of the whole island: none is left anywhere."""
    finds = (FIND + AT + 'by = "walk"\n') * 20
    spill = run(tmp_path, patrols(stretches, 1.0, walk="+11 h") + finds)
    assert total(spill, "found") == pytest.approx(20)
    assert total(spill, "ashore") == total(spill, "destroyed") == 0


def test_release_duration_beyond_the_run(tmp_path: Path) -> None:
    """Objects go adrift over a day, the run lasts half of it: half are not yet, and that is in the
    account.
    """
    spill = run(tmp_path, spill=SPILL.replace('"1 h"', '"1 d"'))
    assert 0.4 < total(spill, "pending") / (20 - total(spill, "destroyed")) < 0.6


def test_the_grid_of_destroyed_shares_stays_inside_its_range(tmp_path: Path) -> None:
    spill = case_file.load(written(tmp_path)).spill
    assert spill is not None
    shares = evidence._number_priors(spill).destroyed
    assert 0 < shares.min() < shares.max() < 0.3
    assert math.isclose(shares.mean(), 0.15)


# --- known to fail, each with its cure in another file ----------------------------------------------------------------


def test_a_certain_patrol_that_found_nothing_where_all_lie(
    stretches: list[str], tmp_path: Path
) -> None:
    spill = run(
        tmp_path, patrols(stretches, 1.0, walk="+11 h"), spill=SPILL.replace("[0, 0.3]", "0")
    )
    assert spill["warning"] is not None


def test_a_find_by_a_certain_patrol_after_another(stretches: list[str], tmp_path: Path) -> None:
    given = patrols(stretches, 1.0, first="+10 h", second="+11 h") + FIND + AT + 'by = "second"\n'
    run(tmp_path, given, spill=SPILL.replace("[0, 0.3]", "0"))


def test_a_find_where_nothing_comes_that_may_be_false_is_false(tmp_path: Path) -> None:
    spill = run(tmp_path, FIND + f'stretch = "{EAST}"\nfalse = 0.2\n' + TEN)
    assert total(spill, "found") < 0.2


@pytest.mark.thorough
def test_early_particles_of_worlds_that_the_finds_rule_out(tmp_path: Path) -> None:
    """At the start only few are adrift: all of worlds that sixty finds make next to impossible."""
    given = (
        SPILL.replace("objects = 20", "objects = 600")
        .replace("[0, 0.3]", "0")
        .replace("worlds = 60", "worlds = 50")
    )
    run(tmp_path, (FIND + AT + TEN) * 60, spill=given, classes=DRUM + BOX)
