"""What the warm process answers: bases of units, and when a first map opens."""

import threading
from typing import Any

import numpy as np
import pytest
import small_case

from drift.apps.serve.answers import process


def test_bases_of_units_are_on_the_map() -> None:
    """In degrees, by the number of the row; a row without a base has none, and does not hide it."""
    unit = '\n[[unit]]\nname = "{}"\nkind = "Boat"\nsearch_speed = "14 kn"\nendurance = "4 h"\nsweep_width = "0.5 nmi"\n'
    text = small_case.STEADY + unit.format("one") + 'base = ""\n' + unit.format("two")
    text += 'base = "50 06.0N 005 30.0W"\n[plan]\nbegin = "+2 h"\nuntil = "+5 h"\n'
    request = {"do": "search", "text": text, "path": "/nowhere/case.toml"}
    told: Any = process._answer(request, threading.Event())["answer"]
    assert list(told["shapes"]["unit"]) == [1]
    assert told["shapes"]["unit"][1] == pytest.approx([-5.5, 50.1], abs=1e-5)
    found: Any = process._answer(request | {"do": "check"}, threading.Event())["answer"]
    beside = {one["field"]: one["message"] for one in found["messages"]}
    assert "unit.0.base" in beside
    assert "the place is missing: type it, or press the button" in beside["unit.0.base"]


HOUR = np.timedelta64(3600, "s")
OUTPUTS = np.datetime64("2026-11-21T18:30", "s") + np.arange(5) * 3 * HOUR


@pytest.mark.parametrize(
    ("hours", "shown"), [(-0.1, None), (0, 0), (1.4, 0), (1.6, 1), (11.9, 4), (12.1, None)]
)
def test_a_first_map_opens_at_the_present(hours: float, shown: int | None) -> None:
    now = OUTPUTS[0] + np.timedelta64(round(3600 * hours), "s")
    found = process.present(OUTPUTS, now)
    assert found == (None if shown is None else OUTPUTS[shown])
