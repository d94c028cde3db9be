"""Tables of sorties, contacts and units, and what a case makes of them."""

from pathlib import Path

import numpy as np
import pytest

from drift.case import file as case_file
from drift.case.record import Case
from drift.evidence.filter.records import Contact, Sortie, Unit
from geo.errors import UserError
from geo.polyline import Legs

NMI, KNOT, FOOT = 1852.0, 1852.0 / 3600.0, 0.3048
HEAD = """
title = "trial"
start = "2026-11-21T00:00Z"
duration = "24 h"
output.every = "12 h"
[[current]]
name = "sea"
constant = { speed = "0.5 kn", toward = 90 }
[[wind]]
name = "air"
constant = { speed = "10 kn", from = 270 }
"""
SCENARIOS = """
[[scenario]]
name = "raft"
object = "PIW-1"
search_object = "raft 4 person"
position = { at = "27 30N 088 00W", std = "1 nmi" }
[[scenario]]
name = "swimmer"
object = "PIW-1"
search_object = "Person in Water"
position = { at = "27 30N 088 00W", std = "1 nmi" }
"""
SORTIE = '[[sortie]]\nname = "first"\n'
WHEN = 'start = "+6 h"\nend = "+8 h"\n'
WIDTH = 'sweep_width = "1.2 nmi"\n'
BOX = (
    'area = { centre = "27 30N 088 00W", length = "20 nmi", width = "10 nmi", orientation = 30 }\n'
)
FAST = 'speed = "90 kn"\n'
POINTS = 'waypoints = ["27 30N 088 00W", "27 45N 088 00W"]\n'  # 15.01 nmi: 10 minutes at 90 kn
TIMED = 'waypoints = [["+6 h", "27 30N 088 00W"], ["+7 h", "27 45N 088 00W"]]\n'
SWEEP = 'pattern = { kind = "parallel", centre = "27 30N 088 00W", length = "20 nmi", width = "6 nmi", spacing = "1 nmi" }\n'
SWEPT = 119 * NMI  # six legs of 19 nmi and five of 1
SQUARE = 'pattern = { kind = "square", datum = "27 30N 088 00W", spacing = "1 nmi", legs = 6 }\n'
WATCH = 'watch = { at = "27 30N 088 00W", zones = [["28 nmi", "32 nmi", 0.6], ["0 nmi", "5 nmi", 0.8]] }\n'
CONTACT = '[[contact]]\nname = "flare"\ntime = "+9 h"\n'
SEEN = 'position = { at = "27 30N 088 00W", error = "1 nmi" }\n'
UNIT = (
    '[[unit]]\nname = "H60"\nbase = "28 30N 088 00W"\nsearch_speed = "90 kn"\nendurance = "3 h"\n'
)


def written(tmp_path: Path, *more: str, scenarios: str = SCENARIOS, head: str = HEAD) -> Path:
    path = tmp_path / "trial.toml"
    path.write_text(head + scenarios + "".join(more), encoding="utf-8")
    return path


def load(tmp_path: Path, *more: str, **given: str) -> Case:
    return case_file.load(written(tmp_path, *more, **given))


def one(tmp_path: Path, *more: str) -> Sortie:
    (sortie,) = load(tmp_path, SORTIE, *more).sorties
    return sortie


def contact(tmp_path: Path, *more: str) -> Contact:
    (found,) = load(tmp_path, CONTACT, *more).contacts
    return found


def unit(tmp_path: Path, *more: str) -> Unit:
    (found,) = load(tmp_path, UNIT, *more).units
    return found


def refusal(tmp_path: Path, *more: str, **given: str) -> str:
    """Return the one line with which a case file is refused."""
    with pytest.raises(UserError) as caught:
        load(tmp_path, *more, **given)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 400
    assert message.startswith("trial.toml: ")
    return message


def legs(sortie: Sortie) -> Legs:
    assert sortie.legs is not None
    return sortie.legs


def hour(number: float) -> np.datetime64:
    return np.datetime64("2026-11-21T00:00") + np.timedelta64(round(3600 * number), "s")


def gpx(tmp_path: Path, *points: tuple[float, float, float | None], name: str = "t.gpx") -> str:
    """Write a track of (longitude, latitude, hour of the run); return its key's value."""
    rows = "".join(
        f'<trkpt lon="{lon}" lat="{lat}">'
        + ("" if when is None else f"<time>{hour(when)}Z</time>")
        + "</trkpt>"
        for lon, lat, when in points
    )
    (tmp_path / name).write_text(f"<gpx><trk><trkseg>{rows}</trkseg></trk></gpx>")
    return f'"{name}"'
