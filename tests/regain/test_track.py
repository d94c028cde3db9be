"""drift track from the case to its files: what is written, what is said, and what is refused."""

import csv
import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
import shapely

import drift
from drift.case import tracking
from drift.cli import commands
from drift.regain import text
from drift.tracker import path
from geo.errors import UserError

SMALL = {"particles": "600"}
SPACE = {"g": "http://www.topografix.com/GPX/1/1"}


def test_a_track_is_written(tmp_path: Path) -> None:
    found = drift.track("lost_contact", tmp_path / "out", changes=SMALL)
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert names == {"manifest.json", "summary.json", "track.csv", "track.gpx", "track.png", "track_areas.geojson"}
    rows = list(csv.DictReader((tmp_path / "out" / "track.csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == len(found.held.time)
    assert [row["detection"] for row in rows].count("yes") == 9
    assert rows[0]["lat"] == ""  # before the first detection
    last = rows[-1]
    lon, lat = path.degrees(found.held.place[-1])
    assert (float(last["lat"]), float(last["lon"])) == pytest.approx((float(lat), float(lon)), abs=1e-4)
    root = ET.parse(tmp_path / "out" / "track.gpx").getroot()
    points = root.findall("g:trk/g:trkseg/g:trkpt", SPACE)
    assert len(points) == len(rows) - 1
    assert points[-1].findtext("g:time", namespaces=SPACE) == "2026-03-05T04:15:00Z" == last["time"]
    areas = json.loads((tmp_path / "out" / "track_areas.geojson").read_text(encoding="utf-8"))["features"]
    assert len(areas) == 2 * len(found.held.clouds)
    for k, (_, cloud) in enumerate(found.held.clouds):
        half, most = (shapely.geometry.shape(areas[2 * k + j]["geometry"]) for j in range(2))
        assert areas[2 * k]["properties"]["probability"] == 0.5
        assert most.area > half.area
        assert cloud is not None
        inside = cloud.weight[shapely.contains_xy(most, *path.degrees(cloud.place))].sum()
        assert inside > 0.85  # windows widen it: it holds more of the particles than its share
    told = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))["track"]
    assert told["lost"] == []
    assert [one["held"] for one in told["shown"]] == [True] * 5
    assert (tmp_path / "out" / "track.png").stat().st_size > 50_000


def test_the_command_writes_the_same_bits_with_one_thread_and_two(tmp_path: Path) -> None:
    made = []
    for threads in ("1", "2"):
        out = tmp_path / threads
        words = ["track", "lost_contact", "--set", "particles=600", "--threads", threads, "--out", str(out), "--quiet"]
        subprocess.run([sys.executable, "-m", "drift", *words], check=True)
        features = json.loads((out / "track_areas.geojson").read_text(encoding="utf-8"))["features"]
        made.append((features, *((out / name).read_bytes() for name in ("track.csv", "track.png"))))
    assert made[0] == made[1]


def test_a_lost_track_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every particle is too slow for the detections: what is drawn anew stays, until radar finds nothing there."""
    (tmp_path / "d.csv").write_text("time,sensor,bearing,range\n+1 min,radar,40,9\n", encoding="utf-8")
    case = """
title = "x"
start = "2026-03-05T02:00Z"
duration = "60 min"
detections = "d.csv"
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
    assert "no particle is left" in said
    assert (tmp_path / "out" / "track.png").exists()
    found = drift.track(tmp_path / "c.toml")
    assert text.numbers(found)["shown"][-1] == {"time": "2026-03-05T03:00:00Z", "held": False}


def test_what_has_no_detections_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r'"closing" has a .target., no detections: drift experiment closing'):
        drift.track("closing", tmp_path / "out")
    with pytest.raises(UserError, match="drift track lost_contact"):
        drift.experiment("lost_contact", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert "lost_contact" in tracking.shipped()
