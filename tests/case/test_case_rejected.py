"""Every error of a case file is one line that says what, where and what is allowed."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from raft_case import CASE, load, refusal, with_prior

from drift.case import file as case_file
from drift.case.scenario import scenario
from drift.engine.motion.models.by_name import MODELS
from drift.engine.motion.models.drift import DRIFT
from geo.errors import UserError

REFUSED: list[tuple[dict[str, str], str]] = [
    ({"partcles": "5"}, r'unknown key "partcles"; did you mean "particles"\? Allowed: title, start'),
    ({"scenario.0.objet": "'PIW-1'"}, r'scenario "raft": unknown key "objet"; did you mean "object"\?'),
    ({"scenario.0.position.att": "[1, 2]"}, r'scenario "raft".position: unknown key "att"; did you mean "at"\?'),
    ({"duration": "'12 parsecs'"}, r'duration: "12 parsecs" is not a duration: "parsecs" is a unit of another kind'),
    ({"duration": "'-3 h'"}, r"duration: duration '-3 h' must be above 0 s"),
    ({"scenario.0.position.std": "'5 kg'"}, r'scenario "raft".position.std: "5 kg" is not a distance'),
    ({"scenario.0.position.std": "'5 nm'"}, r"can be misread; write nmi"),
    ({"scenario.0.position.std": "-5"}, r"at least 0 m"),
    ({"direction": "sideways"}, r"direction: 'sideways' is not allowed; write 'forward' or 'backward'"),
    ({"end": "'211930ZNOV26'"}, r"exactly one of duration, end .* found duration and end"),
    ({"scenario.0.object": "LIFERAFT-9"}, r'scenario "raft".object: no leeway class "LIFERAFT-9"; nearest is'),
    ({"scenario.0.object": "{ windage = 3 }"}, r'scenario "raft".object.windage: .* at most 0.5'),
    ({"scenario.0.object": "{ windage = 0.03, downwind = { slope = 0.03 } }"}, "not both"),
    ({"scenario.0.object": "{ downwind = { slope = 0.03 }, right = { slope = 0.01 } }"}, "both right and left"),
    ({"scenario.0.object": "{ downwind = { slope = '-3 %' } }"}, r"object.*: downwind slope -3 % must be 0 to 50 %"),
    ({"scenario.0.object": "{}"}, "give a class"),
    ({"scenario.0.position.at": "[10, 95]"}, r"position.at: latitude 95 is outside -90 to 90 \(the order is"),
    ({"scenario.0.position.at": "'27 30 88 15'"}, "ambiguous"),
    ({"scenario.0.position.error": "100"}, "exactly one of std, ellipse, error"),
    ({"scenario.0.position.orientation": "370"}, "0 to 360 degrees"),
    ({"scenario.0.position.time": "'211700ZNOV26'"}, "may go adrift at 211700ZNOV26, outside the run"),
    ({"scenario.0.position.until": "'+25 h'"}, "may go adrift at 221930ZNOV26, outside the run"),
    ({"scenario.0.position.until": "'-1 h'"}, "until 211730ZNOV26 is before time 211830ZNOV26"),
    ({"scenario.0.jibe": "-1"}, "jibing rate"),
    ({"scenario.0.motion": "sail"}, r"scenario \"raft\".motion: no model of motion 'sail'; allowed are \"drift\", .*or a Python file"),
    ({"scenario.0.motion": "[1]"}, r'scenario "raft".motion: no model of motion \[1\]'),
    ({"scenario.0.weight": "-1"}, r'scenario "raft".weight: weight -1 must be at least 0'),
    ({"scenario.0.weight": "0"}, "weights add up to 0"),
    ({"scenario.0.currents": "['gulf']"}, r'scenario "raft".currents: no source "gulf"; there are: set'),
    ({"scenario.0.currents": "[]"}, "has no current: add"),
    ({"scenario.0.winds": "[]"}, r'object "LIFE-RAFT-DB-10" drifts with the wind and there is none: add \[\[wind\]\]'),
    ({"scenario": "[]"}, r"give either \[\[scenario\]\] or \[\[family\]\] tables, of one object, or a \[spill\] of many"),
    ({"particles": "0"}, "particles: 0 particles; at least 1"),
    ({"particles": "1_000_000_000_000"}, "1,000,000,000,000 particles; at most 2,147,483,647"),
    ({"particles": "2.5"}, "not a whole number"),
    ({"particles": "true"}, "not a whole number"),
    ({"seed": "-1"}, "seed: -1 must be 0 to"),
    ({"max_lost": "20"}, "max_lost: 20 must be a share, 0 to 1"),
    ({"start": "'2026-11-21T18:30'"}, "start: .* has no zone"),
    ({"start": "'+2 h'"}, "start: cannot be relative"),
    ({"start": "2026-11-21T18:30:00"}, "start: .* has no zone"),
    ({"clock.step": "0"}, "clock.step: 0 must be"),
    ({"clock.step": "'fast'"}, "clock.step"),
    ({"clock.scheme": "euler"}, "'rk2' or 'rk4'"),
    ({"clock": "5"}, "clock: must be a table"),
    ({"output.every": "'1 s'"}, "86,400 output times; at most 1000"),
    ({"output.times": "['+30 h']"}, "output.times: 230030ZNOV26 is outside the run"),
    ({"output": "{ every = '1 h', times = ['+1 h'] }"}, "every or times, not both"),
    ({"domain": "{ west = 1, east = 2, south = 5, north = 5 }"}, "south 5 is not below north 5"),
    ({"coast.behaviour": "bounce"}, "coast.behaviour"),
    ({"coast.source": "nowhere.bna"}, r'coast.source: no file "nowhere.bna"; .* allowed are "gshhg", "none"'),
    ({"current.0.files": "'x.nc'"}, r'current "set": exactly one of files, dataset, constant, table, analytic .* files and constant'),
    ({"current.0": "{ files = 'x.nc' }"}, r'current 1: no file "x.nc"; looked for /'),
    ({"current.0": "{ files = '${NOT_SET_42}/x.nc' }"}, "environment variable NOT_SET_42; set it: export NOT_SET_42="),
    ({"current.0": "{ name = 'x' }"}, "exactly one of files, dataset, constant, table, analytic must be given; found none"),
    ({"current.0.steady": "true"}, "steady belongs to files"),
    ({"current.0.fill": "50"}, "0 to 20"),
    ({"current.0.constant": "{ speed = 1, toward = 3, from = 183 }"}, "found from, speed, toward"),
    ({"current.0.constant": "{ speed = 1 }"}, "found speed"),
    ({"current.0.constant": "'1 kn'"}, r'current "set".constant: \'1 kn\' has no direction; write \{ speed = "15 kn", from = 240 \}'),
    ({"current.0.constant": "[{ speed = 1, toward = 3 }]"}, "constant: must be one vector, constant in time; given a list"),
    ({"wind.0": "{ table = { speed = 5, from = 3 } }"}, "wind 1.table: must be rows by time, .*; given one vector"),
    ({"wind": "{ constant = { speed = 5, from = 3 } }"}, r"wind: must be a list of tables, \[\[wind\]\] in place of \[wind\]"),
    ({"current.0.table": "[]"}, r"found constant and table; leave one out \(--set replaces a whole source: current.0='\{ constant"),
    ({"wind.0": "{ table = [{ time = '+0 h', speed = 5, from = 3 }] }"}, "at least two rows"),
    ({"wind.0": "{ table = [{ time = '+1 h', east = 5, north = 3 }, { time = '+1 h', east = 1, north = 3 }] }"}, "come after"),
    ({"scenario.5.weight": "1"}, r'^scenario.5.weight: "5" is not a number from 0 to 0'),
    ({"current.0.constant": "{ speed = 1, toward = 'sw' }"}, '"sw" is not a direction in degrees; write 225'),
    ({"title.x": "1"}, "nothing called"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "words"), REFUSED, ids=[next(iter(changes)) for changes, _ in REFUSED]
)
def test_refused(tmp_path: Path, changes: dict[str, str], words: str) -> None:
    message = refusal(tmp_path, changes=changes)
    assert re.search(words, message), message


MORE = """
[[wind]]
name = "model"
files = "no.nc"
[[stokes]]
files = ["neither.nc"]
"""


def beginnings(tmp_path: Path, text: str, changes: dict[str, str] | None = None) -> list[str]:
    """Return the mistakes of a case, each up to its first semicolon."""
    (tmp_path / "test.toml").write_text(text, encoding="utf-8")
    with pytest.raises(UserError) as caught:
        case_file.load(tmp_path / "test.toml", changes)
    assert str(caught.value) == "\n".join(caught.value.lines)
    assert all(line.startswith("test.toml: ") and line.isprintable() for line in caught.value.lines)
    return [line.removeprefix("test.toml: ").split("; ")[0] for line in caught.value.lines]


def test_all_mistakes_in_tables_are_told_and_none_that_only_follows(tmp_path: Path) -> None:
    """Not that duration and a place are missing, whose keys are misspelled, nor that the source
    "set" is none.
    """
    text = CASE.replace("duration", "durration").replace(
        'constant = { speed = "0.8 kn"', "constnt = { speed = 1", 1
    )
    text = text.replace("[scenario.position]", "[scenario.positon]") + MORE
    changes = {
        "particles": "0",
        "scenario.0.weight": "-1",
        "scenario.0.object": "'RAFT-9'",
        "title.x": "1",
        "seed.3": "1",
    }
    assert beginnings(tmp_path, text, changes) == [
        'title.x: there is nothing called "x" inside a value',
    ]
    del changes["title.x"], changes["seed.3"]
    found = beginnings(tmp_path, text, changes)
    assert found == [
        'unknown key "durration"',
        "particles: 0 particles",
        'current "set": unknown key "constnt"',
        'scenario "raft": unknown key "positon"',
        'scenario "raft".weight: weight -1 must be at least 0',
        'scenario "raft".object: no leeway class "RAFT-9"',
        'wind "model": no file "no.nc"',
        'stokes 1: no file "neither.nc"',
    ]


def test_all_that_only_the_whole_case_tells_is_told(tmp_path: Path) -> None:
    raft = CASE[CASE.index("[[scenario]]") :]
    boat = raft.replace('"raft"', '"boat"') + 'time = "+30 h"\n'
    late = raft.replace('"raft"', '"late"\ncurrents = ["gulf"]\nwinds = ["air"]')
    search = """
[[sortie]]
name = "first"
start = "+30 h"
end = "+33 h"
speed = "90 kn"
sweep_width = "2 nmi"
area = { polygon = ["27N 88W", "28N 88W", "28N 87W"] }
[[contact]]
name = "flare"
time = "-3 h"
position = { at = "27 30N 088 15W", error = "1 nmi" }
[[unit]]
name = "cutter"
base = "27 30N 088 15W"
ready = "+25 h"
search_speed = "15 kn"
endurance = "4 h"
sweep_width = "2 nmi"
"""
    changes = {
        "output.times": "['+99 h']",
        "coast.source": "'no.bna'",
        "coast.lakes": "'no.geojson'",
    }
    assert beginnings(tmp_path, CASE + MORE + search, changes) == [
        'wind "model": no file "no.nc"',
        'stokes 1: no file "neither.nc"',
        'sortie "first": 230030ZNOV26 to 230330ZNOV26 is outside the run, 211830ZNOV26 to 221830ZNOV26',
        'contact "flare": 211530ZNOV26 is outside the run, 211830ZNOV26 to 221830ZNOV26',
        'unit "cutter": ready at 221930ZNOV26, not before the plan\'s end, 221830ZNOV26',
        "output.times: 252130ZNOV26 is outside the run, 211830ZNOV26 to 221830ZNOV26",
        'coast.source: no file "no.bna"',
        'coast.lakes: no file "no.geojson"',
    ]
    assert beginnings(tmp_path, CASE + boat + late) == [
        'scenario "boat": it may go adrift at 230030ZNOV26, outside the run, 211830ZNOV26 to 221830ZNOV26',
        'scenario "late".currents: no source "gulf"',
        'scenario "late".winds: no source "air"',
    ]


def test_more_mistakes_than_help_are_counted(tmp_path: Path) -> None:
    corners = ", ".join(f'"95N {k}E"' for k in range(27))
    found = beginnings(tmp_path, with_prior(f"[scenario.area]\npolygon = [{corners}]\n"))
    assert len(found) == 21
    assert found[0].startswith(
        'scenario "raft".area.polygon 1: latitude "95N" is outside -90 to 90'
    )
    assert found[-1] == "and 7 more"


def test_who_makes_it(tmp_path: Path) -> None:
    """Of ACDD's names, each one line of words."""
    assert load(tmp_path).about == {}
    text = load(tmp_path, **{"output.about": '{ institution = "MRCC", license = "CC0" }'})
    assert text.about == {"institution": "MRCC", "license": "CC0"}
    assert "institution" in refusal(tmp_path, changes={"output.about.institutoin": '"MRCC"'})
    assert "must be one line" in refusal(tmp_path, changes={"output.about.license": '"a\\nb"'})


def test_end_before_start(tmp_path: Path) -> None:
    text = CASE.replace('duration = "24 h"', 'end = "201830ZNOV26"')
    assert (
        "end 201830ZNOV26 is before start 211830ZNOV26 in a forward run; give an end after"
        in refusal(tmp_path, text)
    )
    text = CASE.replace('duration = "24 h"', 'end = "221830ZNOV26"\ndirection = "backward"')
    assert "give an end before the start" in refusal(tmp_path, text)
    assert "nothing to forecast" in refusal(
        tmp_path, CASE.replace('duration = "24 h"', 'end = "+0 h"')
    )


@pytest.mark.parametrize(
    ("polygon", "words"),
    [
        ('["27N 88W", "28N 88W"]', "2 corners; at least 3"),
        ('["27N 88W", "28N 88W", "27N 88W"]', "2 corners; at least 3"),
        (
            '["27N 88W", "28N 87W", "28N 88W", "27N 87W"]',
            r"crosses itself near \[-87.500, 27.500\]",
        ),
        (
            '["27N 179E", "28N 179W", "28N 179E", "27N 179W"]',
            r"crosses itself near \[-180.000, 27.500\]",
        ),
        ('["27N 88W", "28N 88W", "29N 88W"]', "polygon"),
        ('["80N 0E", "80N 120E", "80N 120W"]', "round a pole"),
        ('["27N 88W", "95N 88W", "27N 87W"]', r"polygon 2: latitude"),
    ],
)
def test_polygons_refused(tmp_path: Path, polygon: str, words: str) -> None:
    message = refusal(tmp_path, with_prior(f"[scenario.area]\npolygon = {polygon}\n"))
    assert re.search(words, message), message


def test_tracklines_refused(tmp_path: Path) -> None:
    track = '[scenario.trackline]\nwaypoints = ["27N 88W", "28N 88W"]\nspeed = "8 kn"\ncross_track = 0\n'
    assert "on the voyage, which lasts from 211830ZNOV26 to 220200ZNOV26" in refusal(
        tmp_path, with_prior(track + 'distress = { between = ["+1 h", "+9 h"] }\n')
    )
    assert "earlier to the later" in refusal(
        tmp_path, with_prior(track + 'distress = { between = ["+2 h", "+1 h"] }\n')
    )
    assert "no length" in refusal(tmp_path, with_prior(track.replace("28N", "27N")))
    assert "must be above 0" in refusal(tmp_path, with_prior(track.replace("8 kn", "0 kn")))
    assert 'write "uniform"' in refusal(tmp_path, with_prior(track + 'distress = "soon"\n'))
    assert "outside the run" in refusal(tmp_path, with_prior(track.replace("8 kn", "1 kn")))


def test_names_once(tmp_path: Path) -> None:
    twice = CASE + CASE[CASE.index("[[scenario]]") :]
    assert 'scenario "raft": two scenarios have this name' in refusal(tmp_path, twice)
    source = '[[current]]\nname = "set"\nconstant = { east = 0, north = 0 }\n[[wind]]'
    assert 'current "set": two sources have this name' in refusal(
        tmp_path, CASE.replace("[[wind]]", source)
    )


def test_no_place_or_two(tmp_path: Path) -> None:
    assert "exactly one of position, area, trackline must be given; found none" in refusal(
        tmp_path, with_prior("")
    )
    both = CASE + '[scenario.area]\npolygon = ["27N 88W", "28N 88W", "28N 87W"]\n'
    assert "found position and area" in refusal(tmp_path, both)


def test_no_current_at_all(tmp_path: Path) -> None:
    without = CASE[: CASE.index("[[current]]")] + CASE[CASE.index("[[wind]]") :]
    assert 'has no current: add [[current]] with files, or constant = { speed = "0 kn"' in refusal(
        tmp_path, without
    )


def test_a_model_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its parameters are made of the scenario's keys; it needs no current if it is not forced."""
    for forced in (True, False):
        monkeypatch.setitem(MODELS, "steaming", replace(DRIFT, forced=forced))
        monkeypatch.setitem(scenario.PARAMETERS, "steaming", lambda table: (table.name, 8.0))
        changes = {"scenario.0.motion": "steaming", "scenario.0.currents": "[]"}
        if forced:
            assert "has no current: add" in refusal(tmp_path, changes=changes)
        else:
            (own,) = load(tmp_path, **changes).scenarios
            assert (own.model, own.motion) == ("steaming", ("raft", 8.0))
    (own,) = load(tmp_path).scenarios
    assert (own.model, own.motion) == ("drift", None)


def test_files_that_are_no_case(tmp_path: Path) -> None:
    assert re.search(r"not valid TOML: .*line 3", refusal(tmp_path, "\ntitle = 'x'\nstart = = 5\n"))
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00CDF")
    with pytest.raises(UserError, match="not text in UTF-8"):
        case_file.load(tmp_path / "binary.toml")
    with pytest.raises(
        UserError, match=r'no case "no_such": .*\(.*overdue_boat.*\). See: drift cases'
    ):
        case_file.load("no_such")
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(UserError, match="cannot read case"):
        case_file.load(tmp_path / "folder.toml")


ODD = (
    "0", "-1", "1e400", "nan", "true", "''", "'x'", "'5 kn'", "[]", "{}", "[[]]", "[1, 2]", "[1, 2, 3]", "{ x = 1 }", "'+6 h'",
    "2026-11-21", "07:32:00", "'1 1/s'", "'1 %'", "'1 degC'", "1_000_000_000_000_000_000", "'\u00e9'", "['a', 1]", "'5 h h'",
    "'1 s s'", "'NaN m'", "'999999999 d'", "'+9999999999 d'", "'-9999999999 d'", "'1 /'", "'1 **'", "'1 ('", '"""a\nb"""',
)  # fmt: skip
PLACES = (
    "title", "start", "duration", "end", "direction", "particles", "seed", "max_lost", "output", "output.every", "output.times",
    "output.trajectories", "clock.step", "clock.tolerance", "domain", "coast", "coast.source", "current", "current.0",
    "current.0.name", "current.0.files", "current.0.constant", "current.0.constant.toward", "current.0.fill", "current.0.analytic",
    "current.0.parameters", "wind.0.table", "uncertainty.current", "uncertainty.diffusivity", "scenario", "scenario.0",
    "scenario.0.name", "scenario.0.weight", "scenario.0.object", "scenario.0.object.windage", "scenario.0.jibe",
    "scenario.0.winds", "scenario.0.position", "scenario.0.position.at", "scenario.0.position.std", "scenario.0.position.until",
    "scenario.0.position.time", "scenario.0.position.ellipse", "scenario.0.position.displacement", "scenario.0.area.polygon",
    "scenario.0.trackline", "expect", "expect.area_50", "expect.mean_position_within",
)  # fmt: skip


@pytest.mark.parametrize("place", PLACES)
def test_whatever_is_written_is_a_case_or_lines_of_text(tmp_path: Path, place: str) -> None:
    path = tmp_path / "test.toml"
    path.write_text(CASE, encoding="utf-8")
    for odd in ODD:
        message = "test.toml: fine"
        try:
            case_file.load(path, {place: odd})
        except UserError as error:
            message = str(error)
        for line in message.split("\n"):
            assert line.startswith("test.toml: ")
            assert line.isprintable(), message
