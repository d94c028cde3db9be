"""Classes after the US Coast Guard's list: published figures, and the rule for what none states."""

import csv
from importlib import resources
from typing import Any

import numpy as np
import pytest

from drift.engine.motion.objects import leeway

# Brushett et al. 2014, abstract: leeway speed in % of the wind
PUBLISHED = {"PANGA-LIGHT": 7.71, "PANGA-FULL": 4.40, "OUTRIGGER-CANOE": 2.40, "PWC": 4.24}
UNKNOWN_STATE = {"down": 12.0, "right": 9.4, "left": 9.4}  # [cm/s], as of PIW-1, FISHING-VESSEL-1
ESTIMATED = {
    "RUBBER-BOAT": [f"LIFE-RAFT-NB-{k}" for k in (2, 3, 4, 5)],
    "WOODEN-BOAT": [
        *(f"FISHING-VESSEL-{k}" for k in (2, 3, 4, 5, 6)),
        *("SKIFF-1", "SKIFF-2", "SKIFF-4", "REFUGEE-RAFT-1"),
    ],
}


def table() -> dict[str, dict[str, Any]]:
    text = resources.files("drift.data").joinpath("leeway.csv").read_text(encoding="utf-8")
    rows = csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))
    return {row["name"]: row for row in rows}


def percent_and_cm(line: leeway.Line) -> tuple[float, float, float]:
    return 100 * line.slope, 100 * line.offset, 100 * line.std


def by_rule(speeds: list[float], error: float) -> tuple[float, float, float]:
    """Return the slope [%], offset and error [cm/s] of a line from speeds [cm/s] at 10 m/s."""
    half = (max(speeds) - min(speeds)) / 2
    return (max(speeds) + min(speeds)) / 2 / 10, 0.0, float(np.hypot(error, half))


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_leeway_speeds_are_downwind_with_the_errors_of_an_unknown_state(
    name: str,
) -> None:
    drifter = leeway.find_class(name)
    assert percent_and_cm(drifter.down) == pytest.approx((PUBLISHED[name], 0, 12.0))
    for line in (drifter.right, drifter.left):
        assert percent_and_cm(line) == pytest.approx((0, 0, 9.4))
    general = leeway.find_class("FISHING-VESSEL-1")
    assert (drifter.down.std, drifter.right.std) == (general.down.std, general.right.std)


def test_a_panga_of_unknown_load_is_the_middle_and_covers_both() -> None:
    speeds = [10 * PUBLISHED["PANGA-LIGHT"], 10 * PUBLISHED["PANGA-FULL"]]
    want = by_rule(speeds, UNKNOWN_STATE["down"])
    found = percent_and_cm(leeway.find_class("PANGA").down)
    assert found == pytest.approx(want, abs=0.05)  # three digits
    assert abs(found[0] - want[0]) <= 0.0051
    assert leeway.find_class("PANGA-FULL").level == 1 + leeway.find_class("PANGA").level


@pytest.mark.parametrize("name", ESTIMATED)
def test_boats_that_nobody_measured_are_wide_about_classes_like_them(name: str) -> None:
    drifter, rows = leeway.find_class(name), table()
    for side in ("down", "right"):
        line = getattr(drifter, side)
        speeds = [
            10 * float(rows[like][f"{side}_slope"]) + float(rows[like][f"{side}_offset"])
            for like in ESTIMATED[name]
        ]
        slope, offset, error = by_rule(speeds, UNKNOWN_STATE[side])
        assert 100 * line.slope == pytest.approx(slope, abs=0.0051)
        assert line.offset == offset
        assert 100 * line.std == pytest.approx(error, abs=0.051)
        # the error covers each of the classes that it stands for
        assert max(abs(speed - 1000 * line.slope) for speed in speeds) < 100 * line.std
    assert drifter.left == leeway.Line(-drifter.right.slope, 0.0, drifter.right.std)
    assert drifter.measured == "estimated"
    assert "no field experiment" in drifter.warning


def test_every_class_says_how_it_was_measured_and_whether_waves_are_inside() -> None:
    for drifter in leeway.classes().values():
        assert drifter.measured in leeway.STOKES
        assert drifter.source
        assert bool(drifter.warning) == (drifter.source != leeway.COAST_GUARD)
        inside = drifter.measured != "direct" and drifter.uses_wind
        assert drifter.stokes == ("inside" if inside else "added")
    # Sutherland et al. 2024: those of containers were measured directly
    direct = {name for name, one in leeway.classes().items() if one.measured == "direct"}
    assert direct == {"CONTAINER-1", "CONTAINER-2"}
    assert leeway.find_class("SLDMB").stokes == "added"
