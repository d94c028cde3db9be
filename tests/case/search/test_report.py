"""The [[report]] table: winds and currents on scene that are read, checked and rejected."""

import re
from pathlib import Path

import numpy as np
import pytest

import drift
from geo.errors import UserError
from geo.notation import KNOT

CASE = """
start = "2026-03-05T00:00Z"
duration = "24 h"
coast = { source = "none" }
[[current]]
constant = { speed = "0.4 kn", toward = 61 }
[[wind]]
constant = { speed = "14 kn", from = 200 }
[uncertainty]
current = { std = "0.25 m/s", time = "11 h" }
wind = { std = "2 m/s", time = "9 h" }
[[scenario]]
name = "raft"
object = "PIW-1"
position = { at = [179.95, 40.0], std = "1 km" }
"""
WIND = """
[[report]]
name = "Aurora"
wind = { speed = "28 kn", from = 240 }
at = "40-10N 179-50W"
time = "+90 min"
error = "3 kn"
"""
CURRENT = """
[[report]]
current = { speed = "0.9 kn", toward = 75 }
at = [179.9, 40.02]
time = "042230ZMAR26"
error = "0.2 kn"
"""


def load(folder: Path, more: str, text: str = CASE) -> drift.Case:
    path = folder / "case.toml"
    path.write_text(text + more)
    return drift.load(path)


def rejected(folder: Path, more: str, text: str = CASE) -> str:
    with pytest.raises(UserError) as error:
        load(folder, more, text)
    return "\n".join(error.value.lines)


def test_a_wind_and_a_current(tmp_path: Path) -> None:
    """One within the run, one before it; a wind comes from its direction, a current goes there."""
    one, two = load(tmp_path, WIND + CURRENT).reports
    assert (one.name, one.quantity, two.name, two.quantity) == (
        "Aurora", "wind", "report 2", "current",
    )  # fmt: skip
    begin = np.datetime64("2026-03-05T00:00:00").astype(int)
    assert (one.time - begin, two.time - begin) == (5400, -5400)
    np.testing.assert_allclose([one.lon, one.lat], [-179 - 50 / 60, 40 + 10 / 60])
    toward = np.radians(60)
    wind = 28 * KNOT * np.array([np.sin(toward), np.cos(toward)])
    np.testing.assert_allclose(one.velocity, wind)
    toward = np.radians(75)
    np.testing.assert_allclose(
        two.velocity, 0.9 * KNOT * np.array([np.sin(toward), np.cos(toward)])
    )
    np.testing.assert_allclose([one.error, two.error], [3 * KNOT, 0.2 * KNOT])


@pytest.mark.thorough
def test_check_says_what_was_reported(tmp_path: Path) -> None:
    few = "particles = 500\n" + CASE
    found = drift.check(load(tmp_path, WIND + CURRENT, few))
    assert str(found['report "Aurora"']) == (
        "wind 28 kn from 240 at 40-10.0N 179-50.0W, 050130ZMAR26, right to 3 kn"
    )
    assert "current 0.9 kn toward 075 at 40-01.2N 179-54.0E" in str(found['report "report 2"'])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("from = 240", "from = 400", r"direction 400 must be 0 to 360"),
        ("from = 240", 'from = "120 M"', r"is magnetic"),
        ("28 kn", "190 kn", r"wind: 97.74 m/s is too fast for a wind; at most 90 m/s \(175 kn\)"),
        ('error = "3 kn"', 'error = "0 kn"', r"error: 0 m/s of a wind must be 0.01 to 20 m/s"),
        ('error = "3 kn"', 'error = "60 kn"', r"must be 0.01 to 20 m/s"),
        ('error = "3 kn"', "", r"error"),
        ("at = ", "current = { speed = 1, toward = 3 }\nat = ",
         r"exactly one of wind, current must be given; found wind and current"),
        ('"40-10N 179-50W"', "[20.0, -5.0]",
         r'report "Aurora": at is 1.,... km from the nearest reported position .*correlated over 100 km, so at most 2e\+03 km'),
        ("+90 min", "08 MAR 2026 0000Z", r"time"),
        ('"+90 min"', '"2026-03-08T00:00Z"',
         r'report "Aurora": time 080000ZMAR26 is 48 h outside the run; .*over 9 h, so at most 45 h are of use'),
        ('wind = { speed = "28 kn", from = 240 }', 'wind = "240/28"', r"must be a table"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_rejected(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in WIND
    found = rejected(tmp_path, WIND.replace(old, new))
    assert re.search(message, found), found


def test_an_impossible_current_and_two_with_one_name(tmp_path: Path) -> None:
    found = rejected(tmp_path, CURRENT.replace("0.9 kn", "17 kn"))
    assert "current: 8.746 m/s is too fast for a current; at most 8 m/s (15.6 kn)" in found
    found = rejected(tmp_path, WIND + WIND)
    assert 'report "Aurora": two reports have this name; give each its own' in found


def test_reports_from_too_many_places(tmp_path: Path) -> None:
    """Several from one place count once."""
    each = [
        CURRENT.replace("179.9", f"179.{90 - k // 2}").replace("2230", f"22{10 + k}")
        for k in range(25)
    ]
    found = rejected(tmp_path, "".join(each))
    assert "[[report]]: they come from 13 places, and there are 0 drifters; at most 12 in" in found
    assert len(load(tmp_path, "".join(each[:24])).reports) == 24


@pytest.mark.parametrize(
    ("old", "new", "more", "message"),
    [
        ('wind = { std = "2 m/s", time = "9 h" }', "", WIND,
         r"the wind has no error that a report could correct \(not from model files\); give uncertainty.wind.std, or leave the report out"),
        ('current = { std = "0.25 m/s", time = "11 h" }', 'current = "none"', CURRENT,
         r'report "report 1": the current has no error that a report could correct \(case\)'),
        ('object = "PIW-1"', 'object = "water"', WIND, r"nothing of the case drifts with the wind"),
        ('time = "11 h"', 'time = "11 h", tail = 5', WIND,
         r'tail: errors are conditioned on the reports as normal ones; leave tail out, or write tail = "none" \(\[\[report\]\]\)'),
        ("start", 'direction = "backward"\nstart', CURRENT, r"\[\[report\]\]: has no effect in a backward run"),
    ],
)  # fmt: skip
def test_nothing_to_correct(tmp_path: Path, old: str, new: str, more: str, message: str) -> None:
    found = rejected(tmp_path, more, CASE.replace(old, new, 1))
    assert re.search(message, found), found


def test_a_bias_alone_can_be_corrected(tmp_path: Path) -> None:
    text = CASE.replace('{ std = "0.25 m/s", time = "11 h" }', '{ std = 0, bias = "0.2 m/s" }')
    assert len(load(tmp_path, CURRENT, text).reports) == 1
