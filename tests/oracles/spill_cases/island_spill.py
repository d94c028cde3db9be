"""A spill off an island, for bad and odd input: 20 objects 10 km west of it.

The current carries them east at about half a metre a second; they reach the shore after some six
hours.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drift.apps.cli.commands import main
from drift.case import file as case_file
from drift.pipeline import flow
from geo.errors import UserError

HEAD = """
title = "trial"
start = "2026-11-21T00:00Z"
duration = "12 h"
max_lost = 1.0
output.every = "6 h"
clock.step = "30 min"
[coast]
source = "shore.geojson"
[[current]]
name = "sea"
constant = { speed = "0.5 m/s", toward = 90 }
[[wind]]
name = "air"
constant = { speed = "5 m/s", from = 270 }
"""
SPILL = """
[spill]
objects = 20
worlds = 60
per_world = 40
position = { at = [-88.1, 27.2], error = "3 km" }
windage_bias = 0.3
release_duration = "1 h"
release_std = "1 km"
destroyed = [0, 0.3]
redraws = 0
[spill.stretches]
length = "4 km"
"""
DRUM = '[[spill.class]]\nname = "drum"\nobject = { windage = "2 %" }\n'
BOX = DRUM.replace("drum", "box")
ISLAND = {
    "type": "Polygon",
    "coordinates": [[[-88, 27], [-87.7, 27], [-87.7, 27.4], [-88, 27.4], [-88, 27]]],
}
FIND = "[[find]]\n"
PATROL = '[[patrol]]\nname = "walk"\nstretches = ["west"]\n'
AT = "at = [-88.0, 27.2]\n"  # on the western shore, where most come
TEN = 'time = "+10 h"\n'
EAST = "27-19.9N 087-42.0W"  # a stretch of the lee shore


def written(
    tmp_path: Path, more: str = "", spill: str = SPILL, classes: str = DRUM, shore: Any = ISLAND
) -> Path:
    (tmp_path / "shore.geojson").write_text(json.dumps(shore))
    path = tmp_path / "trial.toml"
    path.write_text(HEAD + spill + classes + more, encoding="utf-8")
    return path


def refusal(tmp_path: Path, *arguments: Any, **given: Any) -> str:
    """Return the one line with which a case file is refused when it is read."""
    with pytest.raises(UserError) as caught:
        case_file.load(written(tmp_path, *arguments, **given))
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 400
    assert message.startswith("trial.toml: ")
    return message


def refused_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], *arguments: Any, **given: Any
) -> str:
    """Return the one line with which `drift run` refuses a case; nothing may have been written."""
    path = written(tmp_path, *arguments, **given)
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert {file.name for file in tmp_path.iterdir()} == {"trial.toml", "shore.geojson"}
    (line,) = captured.err.strip().splitlines()
    return line


def run(tmp_path: Path, *arguments: Any, **given: Any) -> dict[str, Any]:
    """Return the summary's spill; all finite, the totals add up to N."""
    after = flow.run(case_file.load(written(tmp_path, *arguments, **given)))
    spill = after.summary["spill"]
    # NaN: not known
    known = [value for place, value in numbers(spill) if not place.endswith(("_se", "_se_h"))]
    assert np.isfinite(known).all()
    low, high = spill["objects"]
    assert low - 1e-6 <= sum(total["expected"] for total in spill["totals"].values()) <= high + 1e-6
    return dict(spill)


def numbers(value: Any, place: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, dict):
        for key, part in value.items():
            yield from numbers(part, f"{place}.{key}")
    elif isinstance(value, list | tuple):
        for part in value:
            yield from numbers(part, place)
    elif isinstance(value, int | float):
        yield place, float(value)


def total(spill: dict[str, Any], fate: str) -> float:
    return float(spill["totals"][fate]["expected"])


def patrols(names: list[str], detection: float, **times: str) -> str:
    return "".join(
        f'[[patrol]]\nname = "{name}"\nstretches = {json.dumps(names)}\ntime = "{time}"\ndetection = {detection}\n'
        for name, time in times.items()
    )
