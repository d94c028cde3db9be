"""Numbers, names and times at their limits are told as what they are, at once."""

import time
from pathlib import Path

import pytest

from drift.case import file as case_file
from geo.errors import UserError

CASE = """
title = "limits"
start = "2026-11-21T18:00Z"
duration = "1 h"
particles = 100
output = { every = "1 h" }
coast = { source = "none" }
current = [{ name = "tide", constant = { speed = "1 kn", toward = 90 } }]
[[wind]]
constant = { east = 1, north = 0 }
[[scenario]]
name = "raft"
weight = 0.5
object = "PIW-1"
position = { at = "60 00N 000 00E", error = "1 nmi" }

"""
LONG = "x" * 100_000


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "weight = 0.5",
            "weight = 1e308",
            'scenario "raft".weight: weight 1e+308 must be 0, or 1e-30 to 1e+30',
        ),
        (
            "weight = 0.5",
            "weight = 1e-300",
            'scenario "raft".weight: weight 1e-300 must be 0, or 1e-30 to 1e+30',
        ),
        (
            "weight = 0.5",
            f"weight = 1{'0' * 400}",
            "10000000000000000000... is too large for a weight",
        ),
        ("weight = 0.5", 'weight = "1e400"', "'1e400' is not finite"),
        ("weight = 0.5", "weight = nan", "nan is not finite"),
        ('"1 h"\npart', '"1e-300 h"\npart', "duration '1e-300 h' must be at least 0.001 s"),
        (
            '"1 h"\npart',
            '"0.4 s"\npart',
            "duration 0.4 s is less than a second: nothing to forecast",
        ),
        ('"1 h"\npart', '"1e9 d"\npart', "duration '1e9 d' must be at most"),
        ('every = "1 h"', 'every = "0.5 s"', "output.every: 0.5 s must be at least 1 s"),
        (
            '"limits"',
            f'"{LONG}"',
            "title: 'xxxxxxxxxxxxxxxxxxxx'... has 100,000 letters; at most 1,000",
        ),
        ('"raft"', f'"{LONG}"', "has 100,000 letters; at most 1,000"),
        ('"tide"', f'"{LONG}"', "has 100,000 letters; at most 1,000"),
        ('"raft"', '""', "'' must be one line of letters"),
        ('"raft"', '"ra\\u0000ft"', "must be one line of letters"),
        ('"PIW-1"', f'"{LONG}"', 'or "water" for a pure water drifter'),
        ("particles", LONG, "(100,003 letters) allowed: title"),
        ('"1 h"\npart', f'"1 {LONG}"\npart', "has 100,002 letters, too many for a duration"),
        (
            '"60 00N 000 00E"',
            f'"{"6" * 100_000}N 0E"',
            "has 100,004 letters, too many for a position",
        ),
        ('"60 00N 000 00E"', "[0, 90.0000001]", "latitude 90.0000001 is outside -90 to 90"),
        (
            '"60 00N 000 00E"',
            f"[1{'0' * 400}, 0]",
            "10000000000000000000... is too large for a longitude",
        ),
        ("2026-11-21", "0001-01-01", "is in the year 1; 1800 to 2200 are allowed"),
        ("2026-11-21", "9999-12-31", "is in the year 9999; 1800 to 2200 are allowed"),
        ("particles = 100", "particles = 1e400", "particles: inf is not a whole number"),
    ],
)
def test_one_line_at_once(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in CASE
    path = tmp_path / "limits.toml"
    path.write_text(CASE.replace(old, new))
    begun = time.process_time()
    with pytest.raises(UserError) as refused:
        case_file.load(path)
    # [s]; arithmetic of units over 100,000 letters took minutes
    assert time.process_time() - begun < 5
    (line,) = refused.value.lines
    assert words in line
    assert len(line) < 700


def test_negative_zero_is_zero(tmp_path: Path) -> None:
    path = tmp_path / "limits.toml"
    other = '[[scenario]]\nname = "other"\nobject = "PIW-1"\nposition = { at = [0, 60], error = "1 nmi" }\n'
    path.write_text(CASE.replace("weight = 0.5", "weight = -0.0") + other)
    assert str(case_file.load(path).scenarios[0].weight) == "0.0"


def test_a_sweep_width_that_is_all_but_known_is_known(tmp_path: Path) -> None:
    """1 / x^2 of an uncertainty of 1e-300 is beyond any number."""
    sortie = (
        '[[sortie]]\nstart = "+0 h"\nend = "+1 h"\nsweep_width = "1 nmi"\nsweep_width_uncertainty = 1e-300\n'
        'spacing = "1 nmi"\narea = { centre = "60 00N 000 00E", length = "5 nmi", width = "5 nmi" }\n'
    )
    path = tmp_path / "limits.toml"
    path.write_text(CASE + sortie)
    assert case_file.load(path).sorties[0].shape == float("inf")
