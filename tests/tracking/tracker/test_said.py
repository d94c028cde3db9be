"""How tracking cases were understood, beside what their files say."""

import csv
import tomllib
from collections import Counter
from pathlib import Path

import pytest

from drift.apps.cli import commands
from drift.case.tracking import tracking
from drift.tracking.tracker import said

CASES = Path(__file__).parents[3] / "cases" / "tracking"


@pytest.mark.parametrize("name", tracking.shipped())
def test_each_part_of_a_case_is_told(name: str) -> None:
    given, told = (
        tomllib.loads((CASES / f"{name}.toml").read_text()),
        said.tracking_facts(tracking.load(name)),
    )
    for sensor in given["sensor"]:
        words = told[f'sensor "{sensor["name"]}"']
        assert (
            f"to {float(sensor['reach'].split()[0]):g} nmi, range +- {100 * sensor['range_ambiguity']:g} %"
            in words
        )
        assert ("hears" in words) == sensor.get("hears", False)
    ways = [key for key in told if key.startswith("way of following")]
    assert len(ways) == len(given.get("method", [1]))
    for way in given.get("method", []):
        words = told[f'way of following "{way["name"]}"']
        for key, verb in (("change", "changes"), ("seek", "seeks"), ("hide", "hides")):
            assert (f"{verb} with {100 * way.get(key, 0):g} %" in words) == (way.get(key, 0) > 0)


def test_detections_are_counted_as_they_stand_in_the_file() -> None:
    with (CASES / "lost_contact.csv").open(newline="") as file:
        rows = [
            row["sensor"]
            for row in csv.DictReader(file, skipinitialspace=True)
            if row["sensor"].strip()
        ]
    told = said.tracking_facts(tracking.load("lost_contact"))
    assert told["detections"].startswith(f"{len(rows)}, 050200Z")
    for sensor, number in Counter(rows).items():
        assert f"{number} by {sensor}" in told["detections"]
    assert told["pursuit"].startswith("to meet it, from 14-20.405N 076-36.986W")


def test_check_takes_tracking_cases(capsys: pytest.CaptureFixture[str]) -> None:
    assert commands.main(["check", "closing", "--set", "particles=123"]) == 0
    assert "123 particles" in capsys.readouterr().out
    assert commands.main(["check", "closing", "--set", "particles=0"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
