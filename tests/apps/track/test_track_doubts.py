"""Results of drift track that must be doubted are reported as such."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from doubtful_track import DOUBTFUL, SPACE

import drift
from drift.apps.cli import commands
from drift.apps.track import files, text
from drift.apps.track.record import Regained
from drift.case.tracking import tracking
from drift.tracking.tracker import detections, doubts, holding, said
from drift.tracking.tracker.detections import Detections
from drift.tracking.tracker.following import Clouds, World


@pytest.mark.thorough
def test_a_lost_track_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every particle is too slow for the detections: what is drawn again stays, until radar finds
    nothing there.
    """
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+1 min,radar,40,9\n", encoding="utf-8"
    )
    case = """
title = "x"
start = "2026-03-05T02:00Z"
duration = "60 min"
detections = "d.csv"
particles = 400
[tracker]
at = "14N 077W"
[[sensor]]
name = "radar"
reach = "18 nmi"
range_ambiguity = 0.05
bearing_ambiguity = 1
sweep = "12 s"
[[method]]
name = "m"
fastest = "32 kn"
"""
    (tmp_path / "c.toml").write_text(case, encoding="utf-8")
    assert commands.main(["track", str(tmp_path / "c.toml"), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "no track is held" in said
    assert (
        "fewer than 10 % of the particles were left by sensors that detected nothing at 050206ZMAR26 by radar (within 18 nmi, grace 5 min)"
        in said
    )
    assert "found again since" not in said
    assert (tmp_path / "out" / "track.png").exists()
    found = drift.track(tmp_path / "c.toml")
    last = files.summary_of_track(found)["shown"][-1]
    assert last.pop("carried").keys() == {"lat", "lon"}
    assert last == {
        "time": "2026-03-05T03:00:00Z", "held": False, "others_holding": 0,
    }  # fmt: skip
    assert files.summary_of_track(found)["lost"] == [
        {"time": "2026-03-05T02:06:00Z", "sensors": ["radar"]}
    ]


@pytest.mark.usefixtures("alone")
def test_a_mean_that_lies_in_no_area_is_no_place(tmp_path: Path) -> None:
    """After a range alone the mean is on the tracker: track.csv says so, track.gpx leaves it out,
    and what is said calls it no single position.
    """
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+2 min,radar,,8\n+12 min,radar,70,8\n", encoding="utf-8"
    )
    (tmp_path / "c.toml").write_text(DOUBTFUL, encoding="utf-8")
    changes = {"particles": "1500", "show": "['5 min', '12 min']"}
    found = drift.track(tmp_path / "c.toml", tmp_path / "out", changes=changes)
    rows = list(
        csv.DictReader((tmp_path / "out" / "track.csv").read_text(encoding="utf-8").splitlines())
    )
    within = {row["time"][11:16]: row["within_percent"] for row in rows}
    assert list(within) == [
        "00:00",
        "00:02",
        "00:05",
        "00:10",
        "00:12",
        "00:15",
        "00:20",
        "00:25",
        "00:30",
    ]
    assert [within[minute] for minute in ("00:00", "00:02", "00:05", "00:10")] == [
        "",
        "none",
        "none",
        "none",
    ]
    assert {within[minute] for minute in ("00:12", "00:15", "00:20")} <= {"50", "90"}
    root = ET.parse(tmp_path / "out" / "track.gpx").getroot()
    points = [
        point.findtext("g:time", namespaces=SPACE) or ""
        for point in root.findall("g:trk/g:trkseg/g:trkpt", SPACE)
    ]
    assert [point[11:16] for point in points] == [
        minute for minute, share in within.items() if share not in {"", "none"}
    ]
    assert [
        point.findtext("g:name", namespaces=SPACE) for point in root.findall("g:wpt", SPACE)
    ] == ["050012ZMAR26"]
    told = text.track_facts(found)
    assert (
        "no single position (the mean, 13-59.9N 077-00.0W, is outside the areas), any course"
        in told["050005ZMAR26"]
    )
    assert "no single position" not in told["050012ZMAR26"]
    shown = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))["track"][
        "shown"
    ]
    assert [one["within"] for one in shown] == [None, pytest.approx(0.5, abs=0.41)]


@pytest.mark.thorough
def test_what_must_be_doubted_is_told(tmp_path: Path) -> None:
    """A plot on the other side 3 minutes later needs 16 nmi less both boxes' slack, 8 nmi x
    hypot(0.05, 1 deg) each, in 3 min: 303 kn.
    """
    (tmp_path / "c.toml").write_text(DOUBTFUL, encoding="utf-8")
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+2 min,radar,80,8\n+5 min,radar,260,8\n", encoding="utf-8"
    )
    told = text.track_facts(drift.track(tmp_path / "c.toml"))["warning"]
    speed = (16 - 2 * 8 * np.hypot(0.05, np.radians(1))) / 0.05
    assert (
        f"the plot of 050005ZMAR26 needs {speed:,.0f} kn from the one before, fastest is 32 kn"
        in told
    )
    assert "areas depend on chance: that of " in told
    assert 'followed by "first" only, the first of 2 methods' in told
    # before it is followed too
    checked = said.tracking_facts(tracking.load(tmp_path / "c.toml"))["warning"]
    assert checked.startswith(f"the plot of 050005ZMAR26 needs {speed:,.0f} kn")
    assert "areas" not in checked
    twice = "time,sensor,bearing,range\n+2 min,radar,80,8\n+2 min,radar,80,8\n+2 min,radar,80,7.9\n"
    for own in (
        twice,
        twice.replace(",80,8\n", ",0,8\n", 1)
        .replace(",80,8\n", ",360,8\n", 1)
        .replace(",80,", ",0,"),
    ):
        (tmp_path / "d.csv").write_text(own, encoding="utf-8")
        assert said.tracking_facts(tracking.load(tmp_path / "c.toml"))["warning"] == (
            "the plot of 050002ZMAR26 by radar stands 2 times: check for one that is missing"
        )
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+2 min,radar,80,8\n+12 min,radar,70,8\n", encoding="utf-8"
    )
    inland = {"land": "turn", "tracker.at": "'15 30N 091 00W'"}  # Guatemala
    told = text.track_facts(drift.track(tmp_path / "c.toml", changes=inland))["warning"]
    assert told.startswith(
        "100 % of the box of the plot of 050002ZMAR26 is land: check its bearing and range"
    )
    assert (
        "no track is held from 050002ZMAR26, 050012ZMAR26 on, as there is no water in the box of the detection"
        in told
    )
    plots = (tmp_path / "d.csv").read_text(encoding="utf-8")
    # by bearing alone
    (tmp_path / "d.csv").write_text(plots.replace(",8\n", ",\n"), encoding="utf-8")
    told = text.track_facts(drift.track(tmp_path / "c.toml", changes=inland))["warning"]
    assert (
        "no track is held from 050002ZMAR26, 050012ZMAR26 on, as there is no water in the box of the detection: check position"
        in told
    )
    (tmp_path / "d.csv").write_text(plots, encoding="utf-8")
    plan = {"sensor.0.on": "{ every = '10 min', lasting = '2 min', begin = '121 s' }"}
    assert not any(
        "radar was off" in words
        for words in doubts.doubts_about(tracking.load(tmp_path / "c.toml", plan))
    )  # a second early
    plan = {"sensor.0.on": "{ every = '10 min', lasting = '2 min' }"}
    told = text.track_facts(drift.track(tmp_path / "c.toml", changes=plan))["warning"]
    assert "radar was off" not in told  # at 0002 and 0012 it still turns
    (tmp_path / "d.csv").write_text(
        "time,sensor,bearing,range\n+3 min,radar,80,8\n", encoding="utf-8"
    )
    told = text.track_facts(drift.track(tmp_path / "c.toml", changes=plan))["warning"]
    assert "radar was off when it detected something at 050003ZMAR26: check when it is on" in told
    # its silence is not to count
    assert "was off" not in text.track_facts(drift.track(tmp_path / "c.toml"))["warning"]
    told = text.track_facts(drift.track(tmp_path / "c.toml", changes={"particles": "1"}))["warning"]
    assert (
        "areas depend on chance: that of 50 % at 050003ZMAR26 contains 0 % of 9 other clouds"
        in told
    )
    many = {"particles": "2000"}
    told = text.track_facts(drift.track(tmp_path / "c.toml", changes=many))["warning"]
    assert "needs" not in told
    assert "areas depend on chance" not in told


def test_clouds_that_disagree_on_whether_a_track_is_held_are_told() -> None:
    """Clouds of one particle, each followed alone by the random numbers of a run of its own:
    whichever the first, the others are told.
    """
    asked = replace(
        tracking.load("lost_contact", {"particles": "1", "show": "['45 min', '100 min']"}),
        pursuit=None,
    )
    held = holding.hold(asked)
    assert isinstance(asked.target, Detections)
    told = detections.ordered(
        asked.sensors, asked.target, asked.tracker, np.array([2700.0, 6000.0]), asked.end
    )
    kept = []
    for run in range(10):
        alone = Clouds([World(asked.tracker, told)], asked.methods[:1], 1, asked.seed, run=run)
        kept.append(
            [len(alone.go(time).particles(0, 0, time).weight) > 0 for time in (2700.0, 6000.0)]
        )
    kept = np.array(kept)
    assert 0 < kept[1:, 0].sum() < 9
    said = text.track_facts(Regained(held))["warning"]
    for when, own, others in zip(
        ("050245ZMAR26", "050340ZMAR26"), kept[0], kept[1:].T, strict=True
    ):
        many, what = (9 - others.sum(), "no") if own else (others.sum(), "a")
        assert (
            f"at {when} {many} of 9 clouds with other random numbers hold {what} track" in said
        ) == (many > 0)
