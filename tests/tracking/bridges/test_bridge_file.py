"""The file of `drift bridge` and both commands: what is written becomes a bridge, every mistake is
a line, pictures and GeoJSON stand.
"""

import json
import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
import shapely
from places import ROOT

from drift.apps.cli import commands, grammar
from drift.case.tracking import bridge as bridge_file
from drift.tracking.bridges import bridge as bridges
from drift.tracking.bridges import ellipse, study, text
from geo import sphere
from geo.errors import UserError

NMI = 1852.0
WRITTEN = """
title = "Smuggler off the Guajira"
k = "12 nmi/sqrt(h)"

[[point]]
name = "creek"
at = "12 10N 072 10W"
time = "010000ZJUN26"
ellipse = { major = "30 nmi", minor = "12 nmi", orientation = 70, probability = 0.9 }

[[point]]
at = [-70.5, 15.2]
time = "+31 h"

[[point]]
name = "beach"
at = "17 55N 067 05W"
time = "2026-06-03T06:00Z"
std = ["9 nmi", "4 nmi"]
orientation = 20

[[line]]
name = "halfway"
through = ["14 30N 075 00W", "14 30N 066 00W"]

[output]
times = ["+6 h", "+40 h"]
areas = [90, 50]
coast = "none"
"""


def written(folder: Path, words: str = WRITTEN) -> Path:
    path = folder / "smuggler.toml"
    path.write_text(words, encoding="utf-8")
    return path


def test_what_is_written_becomes_a_bridge(tmp_path: Path) -> None:
    found = bridge_file.load(written(tmp_path))
    assert found.bridge.spread_rate == pytest.approx(12 * NMI / 60)
    assert np.degrees(found.bridge.lon) == pytest.approx([-72 - 10 / 60, -70.5, -67 - 5 / 60])
    assert np.degrees(found.bridge.lat) == pytest.approx([12 + 10 / 60, 15.2, 17 + 55 / 60])
    assert np.diff(found.bridge.time) / 3600 == pytest.approx([31, 23])
    assert found.names == ("creek", "way point 2", "beach")
    assert (found.times - found.bridge.time[0]) / 3600 == pytest.approx([6, 40])
    assert (found.shares, found.percentiles) == ((0.5, 0.9), (0.05, 0.5, 0.95))
    # an ellipse that holds 90 % within 30 and 12 nmi: variance along its axes, turned from 070
    holds = -2 * math.log(0.1)
    ahead = np.array([math.sin(math.radians(70)), math.cos(math.radians(70))])
    beside = np.array([ahead[1], -ahead[0]])
    creek = (30 * NMI) ** 2 / holds * np.outer(ahead, ahead) + (12 * NMI) ** 2 / holds * np.outer(
        beside, beside
    )
    assert found.bridge.covariance[:2, :2] == pytest.approx(creek)
    assert np.abs(found.bridge.covariance[2:4]).max() == 0
    long, short, direction = ellipse.axes(found.bridge.covariance[4:, 4:])
    assert (long / NMI, short / NMI, math.degrees(direction)) == pytest.approx((9, 4, 20))


def test_correlation_of_two_places(tmp_path: Path) -> None:
    """A number holds for east and north alike; a matrix has rows of the point before; error is the
    radius that holds half.
    """
    words = WRITTEN.replace(
        "orientation = 20", "orientation = 20\ncorrelation = [[0.2, -0.1], [0.05, 0.4]]"
    )
    words = words.replace('time = "+31 h"', 'time = "+31 h"\nerror = "5 nmi"\ncorrelation = -0.3')
    whole = bridge_file.load(written(tmp_path, words)).bridge.covariance
    sd = np.sqrt(np.diag(whole))
    assert sd[2:4] / NMI == pytest.approx(5 / math.sqrt(2 * math.log(2)))
    correlation = whole / np.outer(sd, sd)
    assert correlation[:2, 2:4] == pytest.approx(-0.3 * np.eye(2))
    assert correlation[2:4, 4:6] == pytest.approx(np.array([[0.2, -0.1], [0.05, 0.4]]))
    assert np.abs(whole[:2, 4:]).max() == 0


def test_defaults_and_every(tmp_path: Path) -> None:
    words = WRITTEN.replace('times = ["+6 h", "+40 h"]', 'every = "9 h"')
    found = bridge_file.load(written(tmp_path, words), "3 m/sqrt(s)")
    assert found.bridge.spread_rate == 3
    assert (found.times - found.bridge.time[0]) / 3600 == pytest.approx([0, 9, 18, 27, 36, 45, 54])
    found = bridge_file.load(written(tmp_path, WRITTEN.replace('times = ["+6 h", "+40 h"]', "")))
    assert (found.times - found.bridge.time[0]) / 3600 == pytest.approx([9, 18, 27, 36, 45])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            '"12 nmi/sqrt(h)"',
            '"-12 nmi/sqrt(h)"',
            r"k: spread rate '-12 nmi/sqrt\(h\)' must be at least 0",
        ),
        (
            '"12 nmi/sqrt(h)"',
            '"12 kn"',
            'k: "12 kn" is not a spread rate: "kn" is no length over the square root',
        ),
        ('"12 nmi/sqrt(h)"', '"12 nm/sqrt(h)"', 'the unit "nm" can be misread'),
        ('"+31 h"', '"+61 h"', "way point 3 is reached 7 h before way point 2"),
        ('"010000ZJUN26"', '"+3 h"', "point 1: its time must be a date and time"),
        ('["9 nmi", "4 nmi"]\norientation = 20', '["9 nmi", "4 nmi"]', "give orientation too"),
        ("orientation = 20", "correlation = 1.2", "correlation 1.2 must be a number from -1 to 1"),
        (
            "orientation = 20",
            'orientation = 20\nerror = "3 nmi"',
            "one of error, std and ellipse .* found error and std",
        ),
        ('time = "+31 h"', 'time = "+31 h"\norientation = 5', "found orientation alone"),
        (
            'name = "creek"',
            "correlation = 0.5",
            "point 1.correlation: the first point has no point before it",
        ),
        ('"14 30N 066 00W"]', '"14 30N 075 00W"]', 'line "halfway".*are one place'),
        (', "14 30N 066 00W"]', "]", 'line "halfway".through: .*at least 2 items'),
        (
            '"+40 h"',
            '"+60 h"',
            "output.times: 031200ZJUN26 is outside the bridge, 010000ZJUN26 to 030600ZJUN26",
        ),
        ("[90, 50]", "[90, 100]", "100 must be a percentage above 0 and below 100"),
        ("[90, 50]", "[]", "must be a list of percentages"),
        ('times = ["+6 h", "+40 h"]', 'every = "10 s"', "gives 19,441 times"),
        ("[output]", '[output]\nevery = "6 h"', "give times or every, not both"),
        ('coast = "none"', 'coast = "shore.bna"', 'output.coast: no file "shore.bna"'),
        ("title = ", "titel = ", 'unknown key "titel"; did you mean "title"'),
        ("title =", "title", "not valid TOML"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in WRITTEN
    with pytest.raises(UserError, match=words) as refusal:
        bridge_file.load(written(tmp_path, WRITTEN.replace(old, new, 1)))
    assert len(refusal.value.lines) == 1
    assert refusal.value.lines[0].startswith("smuggler.toml: ")


def test_one_way_point_is_no_bridge(tmp_path: Path) -> None:
    words = 'title = "x"\nk = 3\n[[point]]\nat = [3.0, 50.0]\ntime = "010000ZJUN26"\n'
    with pytest.raises(UserError, match=r"point: .*at least 2 items"):
        bridge_file.load(written(tmp_path, words))


def test_all_mistakes_at_once(tmp_path: Path) -> None:
    words = WRITTEN.replace("12 nmi/sqrt(h)", "12 kn").replace("[90, 50]", "[0]")
    with pytest.raises(UserError) as refusal:
        bridge_file.load(written(tmp_path, words))
    assert len(refusal.value.lines) == 2


@pytest.mark.parametrize("name", ["nothing.toml", "."])
def test_a_file_that_cannot_be_read(tmp_path: Path, name: str) -> None:
    with pytest.raises(UserError, match="cannot be read"):
        bridge_file.load(tmp_path / name)


def test_answers_are_those_of_the_laws(tmp_path: Path) -> None:
    asked = bridge_file.load(written(tmp_path))
    found = study.answers(asked)
    law = bridges.bridge_at(asked.bridge, asked.times)
    assert found.position.covariance == pytest.approx(law.covariance)
    for k in range(2):
        spread = math.sqrt(np.linalg.det(law.covariance[k]))
        assert found.areas[k] == pytest.approx(
            [math.pi * f * spread / NMI**2 for f in (2 * math.log(2), 2 * math.log(10))]
        )
    facts = text.answers(found)
    assert list(facts) == ["bridge", "010600ZJUN26, +6 h", "021600ZJUN26, +40 h", 'line "halfway"']
    assert "K = 12 nmi/sqrt(h)" in facts["bridge"]
    assert "touched with probability 1; if so, first 5 % by" in facts['line "halfway"']
    time, touched = study.curve(found.touches[0])
    half = np.interp(0.5 * touched[-1], touched, time)
    assert found.touches[0].percentiles[1] == pytest.approx(half, abs=(time[1] - time[0]) / 10)


def test_what_strays_far_is_told_to_be_rough(tmp_path: Path) -> None:
    found = study.answers(bridge_file.load(written(tmp_path), "150 nmi/sqrt(h)"))
    assert found.notes[0].startswith(
        "it strays so far that the distributions (first order in the deviation) have an error of about"
    )


@pytest.mark.thorough
def test_command_writes_a_picture_and_geojson(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from matplotlib import image

    path, picture, areas = written(tmp_path), tmp_path / "bridge.png", tmp_path / "areas.geojson"
    arguments = [
        "bridge",
        str(path),
        "--out",
        str(picture),
        "--geojson",
        str(areas),
        "--k",
        "8 nmi/sqrt(h)",
    ]
    assert commands.main(arguments) == 0
    said = capsys.readouterr().out
    assert "K = 8 nmi/sqrt(h)" in said
    pixels = image.imread(picture)
    assert pixels.shape == (1162, 1638, 3)
    # colours: it is no empty page
    assert len(np.unique(pixels.reshape(-1, 3) @ [1.0, 256.0, 65536.0])) > 500
    written_areas = json.loads(areas.read_text(encoding="utf-8"))
    shapes = [f for f in written_areas["features"] if f["properties"]["kind"] == "area"]
    assert [(f["properties"]["time"], f["properties"]["probability"]) for f in shapes] == [
        (time, share)
        for time in ("2026-06-01T06:00:00Z", "2026-06-02T16:00:00Z")
        for share in (0.5, 0.9)
    ]
    for (
        shape
        # the area on the sphere of the polygon that was written: l'Huilier would do, a local plane
        # does here
    ) in shapes:
        lon, lat = np.radians(shape["geometry"]["coordinates"][0][0]).T
        middle = float(np.mean(lat))
        plane = (
            shapely.Polygon(np.column_stack([lon * math.cos(middle), lat])).area
            * (sphere.RADIUS / NMI) ** 2
        )
        assert plane == pytest.approx(shape["properties"]["area_nmi2"], rel=5e-3)


@pytest.mark.thorough
def test_a_picture_across_the_antimeridian_and_near_a_pole(tmp_path: Path) -> None:
    words = WRITTEN.replace('"12 10N 072 10W"', '"71 00N 176 00E"').replace(
        "[-70.5, 15.2]", "[-177.0, 76.0]"
    )
    words = words.replace('"17 55N 067 05W"', '"82 00N 150 00W"')
    picture = tmp_path / "arctic.png"
    assert commands.main(["bridge", str(written(tmp_path, words)), "--out", str(picture)]) == 0
    assert picture.stat().st_size > 50_000


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--out", "bridge.jpg"], "--out bridge.jpg: must be a .png file"),
        (
            ["--geojson", "no/where.geojson"],
            "--geojson no/where.geojson: must be a .geojson file in a folder that exists",
        ),
        (["--k", "12 kn"], '"12 kn" is not a spread rate'),
    ],
)
def test_options_that_cannot_be_done(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert commands.main(["bridge", str(written(tmp_path)), *arguments]) == 2
    complaint = capsys.readouterr().err
    assert words in complaint
    assert complaint.count("\n") == 1


def ships(folder: Path, count: int = 12, fixes: int = 40) -> Path:
    """A table of ships that steam east at 10 kn and stray by 2 nmi/sqrt(h), with fixes every hour
    to the second.
    """
    rng = np.random.default_rng(6)
    rows = ["ship,time,lon,lat"]
    for ship in range(count):
        place = np.cumsum(rng.normal((10 * NMI, 0), 2 * NMI, (fixes, 2)), axis=0)
        lon, lat = sphere.destination(np.radians(3.0 + ship), np.radians(48.0), *place.T)
        for k in range(fixes):
            when = np.datetime64("2021-03-20T00:00:07") + np.timedelta64(k, "h")
            rows.append(f"{ship},{when}Z,{np.degrees(lon[k]):.6f},{np.degrees(lat[k]):.6f}")
    path = folder / "ships.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    return path


def test_fit_bridge_prints_k_and_a_line_of_a_case(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """K of simulated ships within three standard errors, 2 / (2 sqrt(228)) by the triples' number;
    what it prints can be read back.
    """
    path = ships(tmp_path)
    assert commands.main(["fit-bridge", str(path), "--hold-out", "--error", "0 m"]) == 0
    said = capsys.readouterr().out
    last = said.strip().splitlines()[-1]
    assert last.startswith('k = "')
    found = float(last.split('"')[1].split()[0])
    assert found == pytest.approx(2.0, abs=3 * 2 / (2 * math.sqrt(228)))
    assert (
        "12, 228 comparisons in 12 stretches; all fixes, steps of at most 24 h; 1 h from fix to fix (median)"
        in said
    )
    assert "held out, 50 % area" in said
    assert (
        commands.main(
            ["fit-bridge", str(path), "--every", "3 h", "--by", "steady", "--error", "fit"]
        )
        == 0
    )
    assert "fixes every 3 h, steps of at most 4.5 h" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("content", "arguments", "words"),
    [
        (
            "ship,time,lon,lat\n7,2021-03-20T00:22Z,32.3,31.4\n",
            [],
            "no step from fix to fix is left",
        ),
        ("ship,when,lon,lat\n7,2021-03-20T00:22Z,32.3,31.4\n", [], "no column of time"),
        (None, ["--min-speed", "500 kn"], "no step from fix to fix is left"),
        (None, ["--every", "6 kn"], "--every"),
        (None, ["--every", "-6 h"], '--every "-6 h" must be above 0'),
        (None, ["--error", "-3 m"], '--error "-3 m" must be from 0 to 20,000 km'),
        (None, ["--error", "some"], 'or write "fit"'),
        (None, ["--error", "60 nmi"], "explains all of their deviation"),
        (None, ["--without", "3,50"], "must be west,south,east,north"),
        (None, ["--without", "3,50,5,40"], "south is below north"),
        (None, ["--by", "horne"], "invalid choice"),
    ],
)
def test_fit_bridge_refuses_in_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    content: str | None,
    arguments: list[str],
    words: str,
) -> None:
    path = ships(tmp_path, 2, 8)
    if content is not None:
        path.write_text(content, encoding="utf-8")
    assert commands.main(["fit-bridge", str(path), *arguments]) == 2
    complaint = capsys.readouterr().err
    assert words in complaint
    assert complaint.count("\n") == 1
    assert "--drifters" not in complaint


def test_fit_bridge_of_no_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert commands.main(["fit-bridge", str(tmp_path / "none.csv")]) == 2
    assert "cannot be read" in capsys.readouterr().err


def test_the_documented_file_is_understood() -> None:
    """The block of docs/bridges.md, and what the page says of it and of the command."""
    page = (ROOT / "docs" / "bridges.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```toml\n(.*?)^```", page, flags=re.MULTILINE | re.DOTALL)
    asked = bridge_file.study(bridge_file.BridgeTable.model_validate(tomllib.loads(block)), ROOT)
    assert [line.name for line in asked.lines] == ["14 30 N", "Pedro Bank"]
    assert asked.bridge.covariance[0, 2] != 0
    options = re.findall(r"^\| `(--[a-z-]+)", page, flags=re.MULTILINE)
    command = grammar.parser()._subparsers._group_actions[0].choices["fit-bridge"]
    there = {
        option
        for action in command._actions
        for option in action.option_strings
        if option.startswith("--")
    }
    assert set(options) == there - {"--help"}
