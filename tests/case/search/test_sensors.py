"""Looks, presences, barriers and lines as a case gives them: the records made of them, and a line
for what is wrong.
"""

import math
from pathlib import Path

import numpy as np
import pytest
import trial_case

from drift.case import file as case_file
from drift.evidence.filter.records import Barrier, Field, Line, Look, Presence, Sensors, Sight
from geo import gnomonic, sphere
from geo.errors import UserError

NMI = 1852.0
HEAD = trial_case.text(duration="24 h", output={"every": "12 h"})
LOOK = '[[look]]\nname = "dip"\ntime = "+9 h"\nat = "27 30N 088 12W"\nsees = "nothing"\n'
BOX = 'width = "6 nmi"\nheight = "4 nmi"\nturned = 30\n'
PRESENCE = (
    '[[presence]]\nname = "buoys"\nat = "27 30N 088 12W"\nradius = "5 nmi"\npresent = "never"\n'
)
WHEN = 'start = "+6 h"\nend = "+8.5 h"\n'
BARRIER = (
    '[[barrier]]\nname = "picket"\ndetection = 0.8\npoints = ["27 30N 088 00W", "27 50N 088 10W"]\n'
)
LINE = '[[line]]\nname = "sound"\npoints = ["27 30N 088 00W", "27 50N 088 10W"]\n'


def load(tmp_path: Path, *more: str, head: str = HEAD) -> Sensors:
    path = tmp_path / "case.toml"
    path.write_text(head + "".join(more))
    return case_file.load(path).sensors


def refusal(tmp_path: Path, *more: str, head: str = HEAD) -> list[str]:
    with pytest.raises(UserError) as caught:
        load(tmp_path, *more, head=head)
    return [line.removeprefix("case.toml: ") for line in caught.value.lines]


def after(hours: float) -> np.datetime64:
    return np.datetime64("2026-11-21T00:00:00") + np.timedelta64(round(3600 * hours), "s")


def test_records(tmp_path: Path) -> None:
    """In SI and UTC, by time."""
    found = load(
        tmp_path,
        LOOK + BOX + "law = { linear = 0.95 }\nfalse_alarms = 0.02\n",
        '[[look]]\ntime = "+3 h"\nat = "27 30N 088 12W"\nradius = "5 nmi"\nsees = "something"\n',
        PRESENCE + WHEN + "detection = 0.9\n",
        BARRIER + WHEN + 'reported = "+7 h"\nerror = "10 min"\nfalse_alarms = "0.01 /h"\n',
        LINE,
    )
    box = Field(-88.2, 27.5, width=6 * NMI, height=4 * NMI, turned=math.radians(30))
    points = ((-88.0, 27.5), (-88 - 1 / 6, 27 + 5 / 6))
    assert found.looks == (
        Look("look 2", after(3), Field(-88.2, 27.5, radius=5 * NMI), True),
        Look("dip", after(9), box, False, Sight("linear", 0.95), 0.02),
    )
    circle = Field(-88.2, 27.5, radius=5 * NMI)
    assert found.presences == (Presence("buoys", after(6), after(8.5), circle, "never", 0.9, 0.0),)
    (barrier,) = found.barriers
    np.testing.assert_allclose(barrier.points, points, rtol=1e-12)
    assert barrier == Barrier(
        "picket",
        after(6),
        after(8.5),
        barrier.points,
        0.8,
        after(7),
        600.0,
        pytest.approx(0.01 / 3600),
    )
    assert found.lines == (Line("sound", barrier.points),)


@pytest.mark.parametrize(
    ("law", "sight"),
    [
        ('"cookie_cutter"', Sight()),
        ("{ exponential = 2.5 }", Sight("exponential", 2.5)),
        ('{ table = [[0, "90 %"], [1.5, 0.2]] }', Sight("table", 1.0, (0.0, 1.5), (0.9, 0.2))),
    ],
)
def test_laws_of_a_look(tmp_path: Path, law: str, sight: Sight) -> None:
    assert load(tmp_path, LOOK + BOX + f"law = {law}\n").looks[0].sight == sight


# The tables as written, and the line that refuses them.
WRONG = {
    "a look outside the case's time": (
        LOOK.replace("+9 h", "+25 h") + BOX,
        'look "dip": 220100ZNOV26 is outside the run, 210000ZNOV26 to 220000ZNOV26; change its times, or the case\'s '
        "start, duration or end",
    ),
    "no shape": (LOOK, 'look "dip": width and height, or radius, are missing: a field is a box or a circle about `at`'),
    "half a box": (LOOK + 'width = "6 nmi"\n', 'look "dip": height is missing: a field is a box or a circle about `at`'),
    "both shapes": (
        LOOK + BOX + 'radius = "2 nmi"\n',
        'look "dip": width and height and turned (a box) and radius (a circle): give one or the other',
    ),
    "a box of width 0": (
        LOOK + 'width = "0 nmi"\nheight = "4 nmi"\n',
        "look \"dip\".width: '0 nmi' must be 10 m to 1000 nmi; write its unit, like \"30 nmi\"",
    ),
    "an unknown law": (
        LOOK + BOX + 'law = "cookie_cuter"\n',
        'look "dip".law: no detection function \'cookie_cuter\'; did you mean "cookie_cutter"? Allowed: "cookie_cutter", '
        "{ linear = 0.95 }, { exponential = 2 }, { table = [[0, 0.9], [1, 0.4]] }",
    ),
    "alpha above 1": (
        LOOK + BOX + "law = { linear = 1.2 }\n",
        'look "dip".law: alpha 1.2 must be a probability, 0 to 1',
    ),
    "beta of 0": (
        LOOK + BOX + "law = { exponential = 0 }\n",
        'look "dip".law: beta 0 must be above 0 and at most 100; beyond, it is a cookie cutter',
    ),
    "a table that goes back": (
        LOOK + BOX + "law = { table = [[0, 0.9], [2, 0.4], [1, 0.2]] }\n",
        'look "dip".law: table: 1 does not come after 2',
    ),
    "a table not from the middle": (
        LOOK + BOX + "law = { table = [[0.5, 0.9], [2, 0.4]] }\n",
        'look "dip".law: table begins at 0.5; its first distance must be 0, the middle of the field',
    ),
    "a table that sees nothing": (
        LOOK + BOX + "law = { table = [[0, 0], [2, 0]] }\n",
        'look "dip".law: table detects nothing at any distance',
    ),
    "a table of one row": (
        LOOK + BOX + "law = { table = [[0, 0.4]] }\n",
        'look "dip".law: table needs two or more rows of distance and chance of detection, like [1, 0.4]',
    ),
    "false alarms above 1": (
        LOOK + BOX + "false_alarms = 1.5\n",
        'look "dip".false_alarms: false_alarms 1.5 must be a probability, 0 to 1',
    ),
    "nothing but false alarms": (
        LOOK + BOX + "false_alarms = 1\n",
        'look "dip": false_alarms = 1 reports something everywhere and is no evidence; leave the look out',
    ),
    "a presence that ends before it starts": (
        PRESENCE + 'start = "+8 h"\nend = "+6 h"\n',
        'presence "buoys": end 210600ZNOV26 is not after start 210800ZNOV26',
    ),
    "a presence outside the run": (
        PRESENCE + 'start = "+20 h"\nend = "+26 h"\n',
        'presence "buoys": 212000ZNOV26 to 220200ZNOV26 is outside the run, 210000ZNOV26 to 220000ZNOV26; change its '
        "times, or the case's start, duration or end",
    ),
    "a presence that says something else": (
        PRESENCE.replace("never", "maybe") + WHEN,
        "presence \"buoys\".present: 'maybe' is not allowed; write 'throughout', 'sometime' or 'never'",
    ),
    "detection of 0": (
        PRESENCE + WHEN + "detection = 0\n",
        'presence "buoys".detection: detection = 0 is no evidence; leave the sensor out',
    ),
    "a presence of false alarms": (
        PRESENCE + WHEN + "false_alarms = 1\n",
        'presence "buoys": false_alarms = 1 gives the same report wherever the object is; leave the presence out',
    ),
    "a barrier of one point": (
        BARRIER.replace(', "27 50N 088 10W"', "") + WHEN,
        'barrier "picket": points are 1; a line has at least 2, with great circles between them',
    ),
    "a barrier without length": (
        BARRIER.replace("27 50N 088 10W", "27 30N 088 00W") + WHEN,
        'barrier "picket": points: the line has no length: all its points are the same',
    ),
    "a barrier half round the Earth": (
        BARRIER.replace("27 50N 088 10W", "10 00S 070 00E") + WHEN,
        'barrier "picket": points: they reach 76 degrees from their middle; at most 40 are allowed: make two lines of it',
    ),
    "an error without a report": (
        BARRIER + WHEN + 'error = "5 min"\n',
        'barrier "picket": error belongs to a report: give reported, or leave it out',
    ),
    "a report without an error": (
        BARRIER + WHEN + 'reported = "+7 h"\n',
        'barrier "picket": error is missing: the standard deviation of the time reported, like "10 min"',
    ),
    "a report when nobody was there": (
        BARRIER + WHEN + 'reported = "+9 h"\nerror = "5 min"\n',
        'barrier "picket": reported 210900ZNOV26 is outside the time it was manned, 210600ZNOV26 to 210830ZNOV26',
    ),
    "a rate without a unit": (
        BARRIER + WHEN + 'reported = "+7 h"\nerror = "5 min"\nfalse_alarms = "0.01"\n',
        "barrier \"picket\".false_alarms: rate '0.01' needs a unit, like \"0.01 /h\"",
    ),
    "no detection": (
        BARRIER.replace("detection = 0.8\n", "") + WHEN,
        'barrier "picket".detection: is missing and has no default',
    ),
    "a line of one point": (
        '[[line]]\nname = "sound"\npoints = ["27 30N 088 00W"]\n',
        'line "sound": points are 1; a line has at least 2, with great circles between them',
    ),
    "one name twice": (LINE + LINE, 'line "sound": two lines have this name; give each its own'),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_refusals(tmp_path: Path, name: str) -> None:
    given, expected = WRONG[name]
    (line,) = refusal(tmp_path, given)
    assert line == expected


def test_all_that_is_wrong_is_told_at_once(tmp_path: Path) -> None:
    """Of several tables that are each in order by themselves, and do not fit the run."""
    lines = refusal(
        tmp_path,
        LOOK.replace("+9 h", "+25 h") + BOX,
        PRESENCE + 'start = "+8 h"\nend = "+6 h"\n',
        LINE + LINE,
    )
    assert [line.split(":")[0] for line in lines] == [
        'look "dip"',
        'presence "buoys"',
        'line "sound"',
    ]


def test_a_spill_and_a_backward_run_have_none(tmp_path: Path) -> None:
    backward = HEAD.replace('duration = "24 h"', 'duration = "24 h"\ndirection = "backward"')
    assert refusal(tmp_path, LINE, head=backward) == [
        "[[line]] belongs to a forward run; leave it out, or remove direction"
    ]


def test_sensors_are_worth_a_map_and_a_plan_begins_after_them(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(HEAD + LOOK + BOX + PRESENCE + WHEN)
    case = case_file.load(path)
    assert {after(6), after(8.5), after(9)} < set(case.outputs)
    assert case.plan.begin == after(9)


def test_great_circles_are_straight_in_the_plane_of_a_line() -> None:
    """Points of one great circle, across the antimeridian and near a pole, and the distance of one
    of them by hand.
    """
    lon, lat = np.radians([178.2, -179.1]), np.radians([71.3, 73.9])
    east, north = sphere.offset(lon[0], lat[0], lon[1], lat[1])
    x, y = sphere.destination(
        lon[0], lat[0], np.array([0, 0.3, 1]) * east, np.array([0, 0.3, 1]) * north
    )
    found = gnomonic.build_plane_line(
        [(float(a), float(b)) for a, b in np.degrees(np.stack([x, y], axis=1))]
    )
    a, b, c = found.corners
    # [m]
    assert abs(np.cross(np.append(b - a, 0), np.append(c - a, 0))[2]) / math.dist(a, c) < 0.01
    assert found.reach == pytest.approx(float(np.hypot(east, north)) / 2, rel=0.2)
