"""The case file: what it turns into, and every refusal as one line that says what, where and what
is allowed.
"""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from places import DATA, ROOT

from drift.case import file as case_file
from drift.case.record import Case
from drift.case.scenario import scenario
from drift.engine.environment.forcing_spec import Slices
from drift.engine.motion import leeway
from drift.engine.motion.drift import DRIFT
from drift.engine.motion.models import MODELS
from drift.engine.motion.scenario import AreaPrior, PositionPrior, TracklinePrior
from geo import sphere
from geo.box import Box
from geo.errors import UserError

CASE = """
title = "A test"
start = "211830ZNOV26"
duration = "24 h"
particles = 1000

[[current]]
name = "set"
constant = { speed = "0.8 kn", toward = 120 }

[[wind]]
name = "report"
constant = { speed = "12 kn", from = 240 }

[[scenario]]
name = "raft"
object = "LIFE-RAFT-DB-10"
[scenario.position]
at = "27 30.5N 088 15.0W"
std = "5 nmi"
"""


def load(tmp_path: Path, text: str = CASE, **changes: str) -> Case:
    path = tmp_path / "test.toml"
    path.write_text(text, encoding="utf-8")
    return case_file.load(path, {key.replace("__", "."): value for key, value in changes.items()})


def refusal(tmp_path: Path, text: str = CASE, changes: dict[str, str] | None = None) -> str:
    path = tmp_path / "test.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UserError) as caught:
        case_file.load(path, changes)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("test.toml: ")
    return message.removeprefix("test.toml: ")


def with_prior(prior: str) -> str:
    return CASE[: CASE.index("[scenario.position]")] + prior


def test_case_in_si(tmp_path: Path) -> None:
    found = load(tmp_path)
    assert found.title == "A test"
    assert found.start == np.datetime64("2026-11-21T18:30:00")
    assert found.end == np.datetime64("2026-11-22T18:30:00")
    assert (found.direction, found.particles, found.seed, found.max_lost) == (1, 1000, 1, 0.2)
    assert (found.step, found.scheme, found.tolerance) == (None, "rk4", 20.0)
    assert found.forcing["current"][0].constant == pytest.approx(
        (
            0.8 * 1852 / 3600 * math.cos(math.radians(30)),
            -0.8 * 1852 / 3600 * math.sin(math.radians(30)),
        )
    )
    # Wind from 240 degrees blows toward 60.
    assert found.forcing["wind"][0].constant == pytest.approx(
        (
            12 * 1852 / 3600 * math.sin(math.radians(60)),
            12 * 1852 / 3600 * math.cos(math.radians(60)),
        )
    )
    only = found.scenarios[0]
    assert (only.weight, only.sources) == (
        1.0,
        {"current": ("set",), "wind": ("report",), "stokes": ()},
    )
    assert only.jibe_rate == pytest.approx(0.04 / 3600)
    assert isinstance(only.prior, PositionPrior)
    assert (only.prior.lon, only.prior.lat) == pytest.approx(
        (math.radians(-88.25), math.radians(27 + 30.5 / 60))
    )
    assert only.prior.major == only.prior.minor == 5 * 1852
    assert only.prior.release_start == only.prior.release_end == found.start


def test_outputs_are_in_order_of_the_run_with_both_ends(tmp_path: Path) -> None:
    hours = np.timedelta64(3600, "s")
    forward = load(tmp_path, output__every="'7 h'")
    assert ((forward.outputs - forward.start) / hours).tolist() == [0, 7, 14, 21, 24]
    chosen = load(tmp_path, output__times='["+13 h", "212030ZNOV26", "+13 h"]')
    assert ((chosen.outputs - chosen.start) / hours).tolist() == [0, 2, 13, 24]
    backward = load(tmp_path, direction="backward", output__every="'10 h'")
    assert backward.direction == -1
    assert ((backward.outputs - backward.start) / hours).tolist() == [0, -10, -20, -24]


def test_backward_with_an_end(tmp_path: Path) -> None:
    text = CASE.replace('duration = "24 h"', 'end = "201830ZNOV26"\ndirection = "backward"')
    found = load(tmp_path, text)
    assert (found.direction, found.end) == (-1, np.datetime64("2026-11-20T18:30:00"))


@pytest.mark.parametrize(
    ("error", "major", "minor", "orientation"),
    [
        ('std = ["6 nmi", "3 nmi"]\norientation = 30', 6 * 1852, 3 * 1852, 30),
        ('std = ["3 nmi", "6 nmi"]\norientation = 30', 6 * 1852, 3 * 1852, 120),
        # 1 - exp(-k^2/2) = p: k = 1.17741 for 50 %, 2.44775 for 95 % (circular and elliptical
        # normal, tables)
        ('error = "3 nmi"', 3 * 1852 / 1.177410, 3 * 1852 / 1.177410, 0),
        (
            'ellipse = { major = "4 km", minor = "1 km", orientation = 75 }',
            4000 / 1.177410,
            1000 / 1.177410,
            75,
        ),
        (
            'ellipse = { major = "4 km", minor = "1 km", orientation = 75, probability = 0.95 }',
            4000 / 2.447747,
            1000 / 2.447747,
            75,
        ),
    ],
)
def test_errors_of_a_position(
    tmp_path: Path, error: str, major: float, minor: float, orientation: float
) -> None:
    prior = load(tmp_path, CASE.replace('std = "5 nmi"', error)).scenarios[0].prior
    assert isinstance(prior, PositionPrior)
    assert (prior.major, prior.minor) == pytest.approx((major, minor), rel=1e-6)
    assert math.degrees(prior.orientation) == pytest.approx(orientation)


def test_displacement_and_unknown_time(tmp_path: Path) -> None:
    text = (
        CASE
        + 'until = "+3 h"\ndisplacement = { distance = ["2 nmi", "10 nmi"], direction = [350, 20] }\n'
    )
    prior = load(tmp_path, text).scenarios[0].prior
    assert isinstance(prior, PositionPrior)
    assert prior.displacement is not None
    assert prior.displacement.distance == (2 * 1852, 10 * 1852)
    assert np.degrees(prior.displacement.direction) == pytest.approx([350, 380])
    assert prior.release_end - prior.release_start == np.timedelta64(3, "h")


def test_area_over_the_antimeridian_has_no_jump(tmp_path: Path) -> None:
    text = with_prior(
        '[scenario.area]\npolygon = ["10S 179E", "10S 178W", "12S 179W", "13S 178E", "10S 179E"]\n'
    )
    prior = load(tmp_path, text).scenarios[0].prior
    assert isinstance(prior, AreaPrior)
    assert np.degrees(prior.lon) == pytest.approx([179, 182, 181, 178])
    assert np.degrees(prior.lat) == pytest.approx([-10, -10, -12, -13])


def test_trackline_lasts_as_long_as_its_legs(tmp_path: Path) -> None:
    text = with_prior(
        '[scenario.trackline]\nwaypoints = ["27N 88W", "28N 88W", "28N 87W"]\nspeed = "8 kn"\ncross_track = "2 nmi"\n'
    )
    prior = load(tmp_path, text).scenarios[0].prior
    assert isinstance(prior, TracklinePrior)
    # One degree of a meridian, and the chord formula for one degree of the parallel of 28 N.
    parallel = 2 * math.asin(math.cos(math.radians(28)) * math.sin(math.radians(0.5)))
    seconds = sphere.RADIUS * (math.radians(1) + parallel) / (8 * 1852 / 3600)
    assert (prior.arrival - prior.departure).astype(int) == pytest.approx(seconds, abs=1)
    assert (prior.low, prior.high, prior.mode) == (0, 1, None)
    assert (prior.release_start, prior.release_end) == (prior.departure, prior.arrival)

    between = (
        load(tmp_path, text + 'distress = { between = ["+3 h", "+9 h"] }\n').scenarios[0].prior
    )
    assert isinstance(between, TracklinePrior)
    assert (between.low, between.high) == pytest.approx((3 * 3600 / seconds, 9 * 3600 / seconds))
    assert (between.release_end - between.release_start).astype(int) == pytest.approx(
        6 * 3600, abs=1
    )
    peaked = (
        load(tmp_path, text + "distress = { triangular = { mode = 0.6 } }\n").scenarios[0].prior
    )
    assert isinstance(peaked, TracklinePrior)
    assert peaked.mode == 0.6


def test_objects(tmp_path: Path) -> None:
    def drifter(value: str) -> leeway.Drifter:
        return load(tmp_path, CASE.replace('"LIFE-RAFT-DB-10"', value)).scenarios[0].object

    own = drifter(
        '{ downwind = { slope = "3 %", offset = "1 cm/s", std = "5 cm/s" }, right = { slope = 0.02 }, left = { slope = -0.01 } }'
    )
    assert (own.down.slope, own.down.offset, own.down.std) == pytest.approx((0.03, 0.01, 0.05))
    assert (own.right.slope, own.left.slope) == (0.02, -0.01)
    sail = drifter('{ windage = "3 %", spread = "0.5 %" }')
    assert (sail.down.slope, sail.down.slope_std, sail.down.offset_std) == pytest.approx(
        (0.03, 0.005, 0)
    )
    assert not sail.jibes
    assert not drifter('"water"').uses_wind


def test_weights_are_normalised_and_sources_chosen(tmp_path: Path) -> None:
    text = CASE.replace(
        "[[wind]]",
        '[[current]]\nname = "rival"\nconstant = { east = 0.1, north = -0.3 }\n\n[[wind]]',
    )
    text += '[[scenario]]\nname = "other"\nweight = 3\nobject = "water"\ncurrents = ["rival"]\n'
    text += "[scenario.position]\nat = [-88, 27]\nerror = 100\n"
    one, other = load(tmp_path, text).scenarios
    assert (one.weight, other.weight) == (0.25, 0.75)
    assert (one.sources["current"], other.sources["current"]) == (("set", "rival"), ("rival",))
    assert other.jibe_rate == 0


def test_table_by_time(tmp_path: Path) -> None:
    rows = '[{ time = "+0 h", speed = "10 kn", from = 270 }, { time = "221830ZNOV26", speed = "20 kn", from = 0 }]'
    table = (
        load(
            tmp_path, CASE.replace('constant = { speed = "12 kn", from = 240 }', f"table = {rows}")
        )
        .forcing["wind"][0]
        .table
    )
    assert table is not None
    assert table.times[1] - table.times[0] == np.timedelta64(24, "h")
    assert table.east == pytest.approx((10 * 1852 / 3600, 0), abs=1e-12)
    assert table.north == pytest.approx((0, -20 * 1852 / 3600), abs=1e-12)


def test_files_relative_and_through_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "data"
    folder.mkdir()
    for name in ("b.nc", "a.nc", "c.txt"):
        (folder / name).touch()
    current = '[[current]]\nfiles = {}\nsteady = true\nvariables = {{ east = "u", north = "v" }}\n[[wind]]'
    names = [str(folder / "a.nc"), str(folder / "b.nc")]
    for written in ('"data/*.nc"', '["${SOME_DATA}/a.nc", "data/b.nc"]'):
        monkeypatch.setenv("SOME_DATA", str(folder))
        found = load(tmp_path, CASE.replace("[[wind]]", current.format(written))).forcing[
            "current"
        ][1]
        assert (list(found.files), found.name, found.steady) == (names, "current 2", True)
        assert found.variables == {"east": "u", "north": "v"}
    far = load(
        tmp_path, CASE.replace("[[wind]]", current.format('"https://host/dap/x.nc"'))
    ).forcing["current"][1]
    assert far.files == ("https://host/dap/x.nc",)
    timed = current.format('"data/a.nc"').replace(
        "steady = true", 'times = { start = "+1 h", every = "6 h" }'
    )
    times = load(tmp_path, CASE.replace("[[wind]]", timed)).forcing["current"][1].times
    assert times == Slices(np.datetime64("2026-11-21T19:30:00"), np.timedelta64(21_600, "s"))
    for text, meant in (
        ('{ zone = "-06:00" }', Slices(zone="-06:00")),
        ('{ stamp = "start", zone = "UTC" }', Slices(zone="UTC", stamp="start")),
    ):
        own = current.format('"data/a.nc"').replace("steady = true", f"times = {text}")
        assert load(tmp_path, CASE.replace("[[wind]]", own)).forcing["current"][1].times == meant
    for text, words in (
        ('{ start = "+1 h" }', "start and every go together"),
        ('{ start = "+1 h", every = "1 h", zone = "UTC" }', "zone applies to the file's own times"),
        ("{ }", "give start and every, or zone, or stamp"),
        ('{ zone = "CST" }', 'zone "CST": allowed are "UTC" and hours ahead of UTC'),
        ('{ stamp = "noon" }', "stamp"),
    ):
        own = current.format('"data/a.nc"').replace("steady = true", f"times = {text}")
        with pytest.raises(UserError, match=words):
            load(tmp_path, CASE.replace("[[wind]]", own))


def test_domain_over_the_antimeridian(tmp_path: Path) -> None:
    text = CASE + '[domain]\nwest = "170 30E"\nsouth = -20\neast = "175W"\nnorth = "10 15.0S"\n'
    assert load(tmp_path, text).domain == Box(170.5, -20, 185, -10.25)


def test_uncertainty_and_clock(tmp_path: Path) -> None:
    text = (
        CASE + '[uncertainty]\nwind = { std = "1.5 m/s", time = "6 h" }\ndiffusivity = "10 m2/s"\n'
    )
    found = load(tmp_path, text, clock__step="10 min", clock__scheme="rk2")
    assert (found.wind_error.std, found.wind_error.time, found.current_error.std) == (
        1.5,
        21_600,
        0,
    )
    assert (found.diffusivity, found.step, found.scheme) == (10, 600, "rk2")


def test_overrides_are_toml_and_are_kept(tmp_path: Path) -> None:
    found = load(
        tmp_path,
        scenario__0__position__std='["2 nmi", "1 nmi"]',
        scenario__0__position__orientation="45",
    )
    assert isinstance(found.scenarios[0].prior, PositionPrior)
    assert found.scenarios[0].prior.minor == 1852
    assert "# --set scenario.0.position.orientation=45" in found.text


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


def test_a_folder_hides_no_shipped_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "overdue_boat").mkdir()
    assert case_file.load("overdue_boat").title.startswith("Overdue boat")
    (tmp_path / "mine").mkdir()
    with pytest.raises(UserError, match='no case "mine": neither a file nor a shipped case'):
        case_file.load("mine")
    (tmp_path / "mine.toml").write_text("")
    with pytest.raises(UserError, match=r'no case "mine"; did you mean the file "mine\.toml"'):
        case_file.load("mine")


def test_shipped_cases_are_valid(monkeypatch: pytest.MonkeyPatch) -> None:
    data = DATA
    names = [name for name, title in case_file.shipped() if title]
    with_data = {
        "norkyst_raft",
        "washington_piw",
        "biscay_drifter",
        "paria_boat",
        "paria",
        "washington_drums",
    }
    assert with_data | {"overdue_boat", "gulf_containers"} <= set(names)
    for name in names if data.is_dir() else ["overdue_boat"]:
        monkeypatch.setenv("DRIFT_DATA", str(data))
        found = case_file.load(name)
        assert math.isclose(math.fsum(s.weight for s in found.scenarios), 1)
        assert any(value is not None for value in found.expect.model_dump().values())


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


def test_records_are_frozen(tmp_path: Path) -> None:
    found: Any = load(tmp_path)
    with pytest.raises(AttributeError):
        found.seed = 2


def test_the_example_of_the_documentation_is_a_case(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "spill.md").read_text(encoding="utf-8")
    example = text.split("```toml\n")[1].split("```")[0]
    head = 'start = "1973-11-01T12:00Z"\nduration = "10 d"\n[[current]]\nanalytic = "gulf"\n[[wind]]\nanalytic = "breeze"\n'
    (tmp_path / "case.toml").write_text(head + example)
    spill = case_file.load(tmp_path / "case.toml").spill
    assert spill is not None
    assert [kind.name for kind in spill.kinds] == ["drum", "box"]
    assert spill.finds[0].by == "patrol 1"
