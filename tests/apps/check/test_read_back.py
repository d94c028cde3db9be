"""`drift check` reads a case's own numbers back to the digits given, and rounds those derived from
them.

The oracle is the case file itself.
"""

import pytest

CASE = """
start = "2026-11-21T18:00Z"
duration = "6 h"
particles = 100
domain = { west = -1.123456, east = 1.5, south = 59.5, north = 61.25 }
coast = { source = "none" }
current = [{ constant = { speed = "0.25 kn", toward = 123.5 } }]
uncertainty = { current = "none", wind = { std = "1.23456 m/s", time = "2.25 h" }, diffusivity = "1.23456789 m2/s" }
[[wind]]
table = [
    { time = "+0 h", speed = "12.34 kn", from = 240.25 },
    { time = "+3 h", speed = "0 kn", from = 100 },
    { time = "+6 h", speed = "0.05 kn", from = 7.5 },
]
[[scenario]]
name = "raft"
weight = 0.125
object = { windage = "2.345 %" }
position = { at = "60 10.255N 000 10.125W", error = "1.2 nmi" }
[[scenario]]
name = "box"
weight = 0.875
object = { immersion = "62.5 %" }
position = { at = "60 10N 000 10W", error = "1.2 nmi" }
[[sortie]]
start = "+2 h"
end = "+3 h"
sweep_width = "0.1234 nmi"
spacing = "0.25 nmi"
area = { centre = "60 10.25N 000 10.1W", length = "2 nmi", width = "1 nmi", orientation = 12.5 }
[[unit]]
name = "lifeboat"
base = "60 10.255N 000 10.125W"
ready = "+3 h"
endurance = "1.255 h"
search_speed = "12.5 kn"
transit_speed = "25 kn"
sweep_width = "0.1234 nmi"
"""
SPILL = """
start = "2026-11-21T18:00Z"
duration = "6 h"
coast = { source = "land.geojson" }
current = [{ constant = { speed = "0.12345 m/s", toward = 90 } }]
wind = [{ constant = { speed = "10 kn", from = 240 } }]
[uncertainty]
wind = "none"
current = { std = "0.25 m/s", time = "100 min" }
[spill]
objects = 50
worlds = 50
per_world = 10
position = { at = "53 40N 004 50E", error = "3 nmi" }
windage_bias = 0.3
current_bias = "0.0875 m/s"
class = [{ name = "box", object = { immersion = "62.5 %" } }]
"""


LAND = """{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon",
"coordinates": [[[5, 53], [6, 53], [6, 54], [5, 54], [5, 53]]]}}"""


def read_back(path, case):
    """Return the lines of `drift check` of a case."""
    from drift.apps.check import check
    from drift.case import file as case_file

    path.write_text(case)
    return check.check(case_file.load(path))


@pytest.fixture(scope="module")
def lines(tmp_path_factory):
    return read_back(tmp_path_factory.mktemp("read_back") / "digits.toml", CASE)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("domain", "-1.123456 to 1.5 E, 59.5 to 61.25 N"),
        ("errors", "1.23456 m/s over 2.25 h"),
        ("errors", "1.23456789 m2/s"),
        ("current current 1", "0.25 kn toward 123.5"),
        ("wind wind 1", "12.34 kn from 240.25 then 0 kn then 0.05 kn from 007.5"),
        ('scenario "raft"', "12.5 %, windage: Windage 2.345 %"),
        ('scenario "box"', "Immersed to 62.5 %"),
        ('scenario "raft"', "; from 60-10.255N 000-10.125W, 50 % within 1.2 nmi"),
        ('unit "lifeboat"', "from 60-10.255N 000-10.125W"),
        ('unit "lifeboat"', "1.255 h on scene, W 0.1234 nmi"),
    ],
)
def test_check_reads_back(lines, line, words):
    assert words in lines[line]


@pytest.mark.thorough
def test_check_rounds_what_it_derives(tmp_path):
    """A factor from its logarithm, hours from minutes, knots from metres per second; what is stated
    stays.
    """
    (tmp_path / "land.geojson").write_text(LAND)
    lines = read_back(tmp_path / "spill.toml", SPILL)
    assert lines["biases"].startswith(
        "windage a factor of 1.35, current 0.0875 m/s, reporting a factor of 1 "
    )
    assert lines["released"].endswith("; from 53-40.0N 004-50.0E, 50 % within 3 nmi")
    assert "0.25 m/s over 1.667 h" in lines["errors"]
    assert "0.24 kn toward 090" in lines["current current 1"]
