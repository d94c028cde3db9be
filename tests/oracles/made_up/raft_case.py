"""A case of a raft in a current and a wind, with its text changed."""

from pathlib import Path

import pytest

from drift.case import file as case_file
from drift.case.record import Case
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
