"""What programs read: one JSON object on standard output, errors too; and commands that say
nothing.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import small_case
import spills
from plans import few_trials  # noqa: F401 (a fixture)

import drift
from drift.apps.cli import commands as cli
from drift.products.files import formats

PAINTS = False
UNIT = """
[[unit]]
name = "aircraft"
kind = "Aircraft"
base = "28 00N 088 00W"
ready = "+0 h"
search_speed = "120 kn"
transit_speed = "180 kn"
endurance = "3 h"
altitude = "500 ft"
daylight = false
sweep_width = "0.5 nmi"
[plan]
begin = "+1 h"
until = "+6 h"
particles = 1000
"""
BRIDGE = """
title = "A go-fast"
k = "12 nmi/sqrt(h)"
[[point]]
name = "coast"
at = "12 00N 072 00W"
time = "2026-11-21T00:00Z"
std = "5 nmi"
[[point]]
name = "meeting"
at = "15 00N 072 30W"
time = "2026-11-21T10:00Z"
std = "5 nmi"
[output]
times = ["+5 h"]
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "trial.toml").write_text(small_case.STEADY + UNIT)
    (tmp_path / "bridge.toml").write_text(BRIDGE)
    small_case.field().to_netcdf(tmp_path / "current.nc")
    return tmp_path


def told(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, dict[str, Any], str]:
    """Return the exit status, the one object on standard output, and what stands on standard error."""
    status = cli.main([*words, "--json"])
    streams = capsys.readouterr()
    assert streams.out.count("\n") == 1
    return status, json.loads(streams.out), streams.err


def test_a_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, found, err = told(capsys, "run", "trial.toml", "--out", "results")
    assert (status, err) == (0, "")
    assert (found["command"], found["title"], found["results"]) == ("run", "trial", "results")
    summary = json.loads((folder / "results" / "summary.json").read_text())
    end = summary["outputs"][-1]
    assert found["mean"] == {"lon_deg": end["mean"]["lon"], "lat_deg": end["mean"]["lat"]}
    assert found["area_m2"]["50%"] == pytest.approx(1e6 * end["area_km2"]["50%"])
    assert found["status"]["adrift"] == 1.0
    assert (found["particles"], found["seed"], found["time"]) == (
        500,
        summary["run"]["seed"],
        "2026-11-21T06:00:00Z",
    )
    assert found["facts"]["mean position"] == end["mean"]["text"]
    begin = summary["outputs"][1]  # the plan's: the map and the report open there
    assert (begin["time"], begin["area_km2"]["50%"] < end["area_km2"]["50%"]) == (
        "2026-11-21T01:00:00Z",
        True,
    )
    assert summary["opens"] == found["opens"]["time"] == begin["time"]
    assert found["opens"]["area_m2"]["50%"] == pytest.approx(1e6 * begin["area_km2"]["50%"])
    assert f"50% {begin['area_nmi2']['50%']:.3g} nmi2, " in found["facts"]["map.png, report.html"]


def test_a_run_whose_map_opens_at_its_end_says_nothing_of_it(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "plain.toml").write_text(small_case.STEADY)
    _, found, _ = told(capsys, "run", "plain.toml", "--out", "plain")
    assert found["opens"] == {"time": found["time"], "area_m2": found["area_m2"]}
    assert not [name for name in found["facts"] if "map.png" in name]


@pytest.mark.thorough
def test_a_plan(folder: Path, few_trials: None, capsys: pytest.CaptureFixture[str]) -> None:  # noqa: F811
    status, found, _ = told(capsys, "plan", "trial.toml", "--out", "plan")
    assert status == 0
    (own,), (written,) = (
        found["taskings"],
        json.loads((folder / "plan" / "plan.json").read_text())["taskings"],
    )
    assert own["length_m"] == pytest.approx(1852 * written["length_nmi"])
    assert own["spacing_m"] == pytest.approx(1852 * written["spacing_nmi"])
    assert own["centre"] == {
        "lon_deg": written["centre"]["lon"],
        "lat_deg": written["centre"]["lat"],
    }
    assert found["pos"] == pytest.approx(found["pos_by_scenario"]["boat"])


def test_a_comparison(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, found, _ = told(
        capsys, "compare", "trial.toml", "--set-b", "current.0.constant.speed=1 kn", "--out", "c"
    )
    assert status == 0
    rows = {(row["time"], row["quantity"]): row for row in found["differences"]}
    east = rows["2026-11-21T06:00:00Z", "mean, east"]
    assert east["unit"] == "m"
    # 0.5 kn more for six hours
    assert east["difference"] == pytest.approx(0.5 * 1852 / 3600 * 6 * 3600, abs=2)


@pytest.mark.thorough
def test_an_origin(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    find = '[[find]]\nname = "drum"\nat = [0.0, 0.05]\ntime = "+30 h"\n'
    case = spills.case_of(folder, more=find, worlds=100, per_world=30, duration="2 d")
    status, found, _ = told(capsys, "origin", str(case.path), "--out", "origin")
    assert status == 0
    assert {"time_50", "origin"} & {*found, *found["origin"]}


def test_lists_and_descriptions(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "overdue_boat" in {case["name"] for case in told(capsys, "cases")[1]["cases"]}
    (piw,) = [
        one for one in told(capsys, "objects", "swimmer")[1]["objects"] if one["name"] == "PIW-3"
    ]
    assert piw["downwind"] == {"slope": 0.016, "offset_m_per_s": -0.0398, "std_m_per_s": 0.0242}
    assert piw["search_objects"] == ["Person in Water"]
    status, found, _ = told(capsys, "check", "trial.toml")
    assert (status, found["ready"], found["title"]) == (0, True, "trial: ready to run")
    (source,) = told(capsys, "info", "current.nc")[1]["sources"]
    assert (source["quantity"], source["nlon"], source["nlat"], len(source["times"])) == (
        "current",
        21,
        17,
        13,
    )
    assert source["west_deg"] == pytest.approx(-90.125, abs=0.13)
    assert told(capsys, "new", "spill", "mine.toml")[1] == {"command": "new", "file": "mine.toml"}


def test_a_bridge(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, found, _ = told(capsys, "bridge", "bridge.toml")
    assert status == 0
    (place,) = found["positions"]
    assert place["time"] == "2026-11-21T05:00:00Z"
    assert place["lat_deg"] == pytest.approx(13.5, abs=0.01)  # half-way
    # Midway K^2 T / 4 and half of each end's variance: docs/bridges.md
    nmi = np.sqrt(12**2 * 10 / 4 + 5**2 / 2)
    assert place["std_major_m"] == pytest.approx(1852 * nmi, rel=0.01)
    assert place["area_m2"]["50%"] == pytest.approx(
        2 * np.pi * np.log(2) * place["std_major_m"] * place["std_minor_m"], rel=0.01
    )


@pytest.mark.parametrize(
    ("words", "status", "line"),
    [
        (("run", "nowhere"), 2, 'no case "nowhere"'),
        (("fly",), 2, "invalid choice"),
        (("check", "trial.toml", "--set", "particles=0", "--set", "seed=-1"), 2, "particles"),
        (("objects", "spaceship"), 2, "no leeway class"),
    ],
)
def test_errors_are_json_too_with_the_same_status(
    folder: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], status: int, line: str
) -> None:
    got, found, err = told(capsys, *words)
    assert got == status
    assert set(found) == {"error"}
    assert line in found["error"][0]
    # people who watch see them as ever
    assert err == "".join(f"drift: {text}\n" for text in found["error"])


def test_own_errors_are_json_too(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(given: object) -> Any:
        raise ZeroDivisionError("oops")

    monkeypatch.setitem(cli.COMMANDS, "cases", fail)
    assert told(capsys, "cases")[:2] == (
        1,
        {"error": ["internal error in drift: ZeroDivisionError: oops"]},
    )


def test_what_is_no_number_is_null() -> None:
    assert formats.plain({"a": np.nan, "b": np.datetime64("NaT", "s")}) == {"a": None, "b": None}


@pytest.mark.parametrize("command", ["run", "check", "bridge"])
def test_quiet_says_nothing(folder: Path, capsys: pytest.CaptureFixture[str], command: str) -> None:
    given = ["bridge.toml"] if command == "bridge" else ["trial.toml", "--set", "uncertainty=none"]
    assert cli.main([command, *given, "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert command != "run" or drift.results("trial-forecast")


def test_quiet_tells_errors_and_warnings(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # too few for areas
    assert cli.main(["run", "trial.toml", "--quiet", "--set", "particles=20"]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("drift: warning")
    assert cli.main(["run", "nowhere", "--quiet"]) == 2
    assert capsys.readouterr().err.startswith('drift: no case "nowhere"')
    assert cli.main(["run", "trial.toml", "--quiet", "--json"]) == 2
    assert "not allowed with" in capsys.readouterr().err
