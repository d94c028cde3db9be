"""[[sensor]] tables of passive sonars: what is wrong with them is one line that says what, and
where.
"""

from pathlib import Path

import pytest

from drift.case import file as case_file
from geo.errors import UserError

CASE = """
start = "2026-11-21T00:00Z"
duration = "12 h"
[[current]]
constant = { speed = "0.5 kn", toward = 90 }
[[scenario]]
name = "raft"
object = "water"
position = { at = "27 30N 088 00W", std = "1 nmi" }
[[sensor]]
name = "west"
at = "27 30N 088 30W"
heading = 20
[sensor.sonar]
source_level = { raft = "140 dB" }
loss = { spreading = 18, to = "100 nmi" }
noise = [[0, "70 dB"], [90, "75 dB"], [180, "68 dB"], [270, "72 dB"], [45, "71 dB"], [135, "72 dB"], [225, "72 dB"], [315, "72 dB"]]
gain = { line = { elements = 8, spacing = "15 m", frequency = "50 Hz", beams = 5 } }
threshold = "10 dB"
unknown = "3 dB"
[[sortie]]
name = "ears"
start = "+1 h"
end = "+5 h"
watch = { sensor = "west" }
"""
OTHER = '[[sensor]]\nname = "east"\ngroup = "west"\nat = "27 30N 087 30W"\n[sensor.sonar]\nsource_level = 140\nnoise = 70\n'
LOOK = '[[look]]\ntime = "+6 h"\nsees = "nothing"\nsensor = "west"\n'


def refusal(tmp_path: Path, text: str) -> str:
    path = tmp_path / "case.toml"
    path.write_text(text)
    with pytest.raises(UserError) as caught:
        case_file.load(path)
    (line,) = caught.value.lines
    return line.removeprefix("case.toml: ")


def changed(*pairs: tuple[str, str]) -> str:
    text = CASE
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    return text


TOWED = (('at = "27 30N 088 30W"\nheading = 20\n', ""),)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (changed(('source_level = { raft = "140 dB" }\n', "")), 'source_level is missing for scenario "raft"; give it here'),
        (changed(("raft = ", "rafts = ")), 'source_level: no scenario "rafts"; did you mean "raft"?'),
        (changed(('{ raft = "140 dB" }', "{}")), "source_level is empty"),
        (changed(('"140 dB"', '"14 dB"')), "source level '14 dB' must be 50 to 250 dB"),
        (changed(('"140 dB"', '"140 Pa"')), "source level '140 Pa' is no number of decibels"),
        (changed(('"140 dB"', "nan")), "source level nan must be finite"),
        (changed(('"140 dB"', "true")), "source level True is no number of decibels"),
        (changed(('"140 dB"', '[["5 kn", "140 dB"]]')), "needs two or more rows"),
        (changed(('"140 dB"', '[["5 kn", "140 dB"], ["4 kn", "141 dB"]]')), "speed '4 kn' does not come after '5 kn'"),
        (changed(('threshold = "10 dB"', "threshold = inf")), "threshold inf must be finite"),
        (changed(('threshold = "10 dB"', 'treshold = "10 dB"')), 'unknown key "treshold"; did you mean "threshold"?'),
        (changed(('threshold = "10 dB"', "fluctuation = 0")), "fluctuation 0 must be above 0"),
        (changed(('threshold = "10 dB"', 'jump_rate = "-1 /h"')), "rate '-1 /h' must be 0 to 1 per second"),
        (changed(('unknown = "3 dB"', 'unknown = "12 dB"')), "unknown 12 dB must be at most 1.5 times the fluctuation, 6 dB"),
        (changed(('[270, "72 dB"], ', ""), ('[225, "72 dB"], ', "")), "nothing between the bearings 180 and 315 degrees"),
        (changed(('[0, "70 dB"]', '[0, "70 dB", 3]')), "is not a row; write [bearing, decibels]"),
        (changed(("line = {", "symmetric = true, lines = {")), 'unknown key "lines"; did you mean "line"?'),
        (changed(("spreading = 18", 'spreading = 18, file = "x.nc"')), "file and spreading: the loss is that of a file, or"),
        (changed(("spreading = 18, ", 'file = "x.nc", '), (', to = "100 nmi"', "")), 'loss.file: no file "x.nc"'),
        (changed(("spreading = 18", 'absorption = "-1 dB/km"')), "absorption '-1 dB/km' must be 0 to 1000 dB/km"),
        (changed(("spreading = 18", 'zones = [["5 km", "4 km", "3 dB"]]')), "convergence zone 5000 to 4000 m; allowed are"),
        (changed(('[[sortie]]', OTHER.replace('"east"', '"west"') + "[[sortie]]"), ('heading = 20\n', 'heading = 20\n')),
         "two sensors have this name"),
        (changed(("[[sortie]]", OTHER + 'unknown = "2 dB"\n[[sortie]]')), "its unknown is 2 dB, and that of sensor \"west\""),
        (changed(("heading = 20\n", "")), 'sensor "west": heading is missing: it stands and has an array'),
        (changed(("[sensor.sonar]", 'pod = { file = "x.nc" }\n[sensor.sonar]')), "exactly one of sonar, pod must be given"),
        (changed(('at = "27 30N 088 30W"\n', "")), "heading is of a sensor that stands; give at, or leave heading out"),
        (changed(("watch = {", 'speed = "5 kn"\nwaypoints = ["27 30N 088 00W", "27 40N 088 00W"]\nwatch = {')),
         'sensor "west" has a fixed position (at in its table); leave at, waypoints and track out here'),
        (changed(*TOWED), 'where is sensor "west"? Give waypoints or a track along which it moves'),
        (changed(*TOWED, ('watch = {', 'watch = { at = "27 30N 088 00W",')), 'sensor "west" has an array, which has a heading'),
        (changed(('sensor = "west" }', 'sensor = "west", beams = [6] }')), "beams [6] must be numbers from 1 to 5"),
        (changed(('sensor = "west" }', 'sensor = "west", beams = [2, 2] }')), "beams [2, 2] must be numbers from 1 to 5"),
        (changed(('sensor = "west" }', 'sensor = "wets" }')), 'no sensor "wets"; did you mean "west"?'),
        (changed(('watch = {', 'law = "random"\nwatch = {')), "law does not belong to a watch"),
        (changed(*TOWED).split("[[sortie]]")[0] + LOOK + 'at = "27 30N 088 00W"\n', "has an array: give its heading at the time"),
        (CASE + LOOK + 'at = "27 30N 088 00W"\n', "has a fixed position (at in its table); leave at and heading out here"),
        (CASE + LOOK + 'radius = "5 nmi"\n', "radius belongs to a field; a sensor has its own detection function"),
        (CASE + LOOK + "beams = [9]\n", "beams [9] must be numbers from 1 to 5"),
        (CASE.split("[[sortie]]")[0].replace("start =", 'direction = "backward"\nstart ='), "[[sensor]] belongs to a forward run"),
    ],
)  # fmt: skip
def test_one_line_says_what_is_wrong(tmp_path: Path, text: str, said: str) -> None:
    assert said in refusal(tmp_path, text)


def test_bare_numbers_are_decibels(tmp_path: Path) -> None:
    """They say the same as texts with their unit, in sonars as in rows of speed and level."""
    path = tmp_path / "case.toml"
    path.write_text(changed(('"140 dB"', "140"), ('threshold = "10 dB"', "threshold = 10")))
    bare = case_file.load(path).sorties[0].sensor
    path.write_text(CASE)
    told = case_file.load(path).sorties[0].sensor
    assert bare is not None
    assert told is not None
    assert bare.sees.levels.level.tolist() == told.sees.levels.level.tolist() == [[140.0]]
    assert bare.sees.threshold == told.sees.threshold == 10


SPILL = """
[spill]
objects = 20
worlds = 60
per_world = 40
position = { at = [-88.1, 27.2], error = "3 km" }
[[spill.class]]
name = "drum"
object = { windage = "2 %" }
"""


def test_a_spill_has_no_sensors(tmp_path: Path) -> None:
    head, rest = CASE.split("[[scenario]]")
    sensor = "[[sensor]]" + rest.split("[[sensor]]")[1].split("[[sortie]]")[0]
    wind = '[[wind]]\nconstant = { speed = "5 m/s", from = 270 }\n'
    assert "[[sensor]] belongs to a search" in refusal(tmp_path, head + wind + SPILL + sensor)
