"""Shares of the area where all spread is normal: closed forms, and Shapley values written out."""

import math
from pathlib import Path
from typing import Any

import gaussian_spread
import numpy as np
import pytest
import trial_case

import drift
from geo.errors import UserError

# A tenth of the cells: still 240 across, far finer than the kernels of a few thousand particles.
pytestmark = pytest.mark.usefixtures("coarse_maps")
KEYS = ("start", "current", "wind", "leeway", "diffusion")


def case_of(folder: Path, **tables: Any) -> drift.Case:
    return trial_case.load(folder, **{**gaussian_spread.CASE, **tables})


def check_against_closed_form(found: Any, keys: tuple[str, ...], margin: float) -> None:
    """Compare with the closed form: three standard errors, and a margin for the estimate of areas.

    From few particles it is too large by a few per cent, by the same factor in all forecasts
    that are not almost a line.
    """
    assert tuple(source.key for source in found.sources) == keys
    for t, time in enumerate(found.times):
        seconds = float((time - found.case.start) / np.timedelta64(1, "s"))
        for s, share in enumerate(found.shares):
            whole = gaussian_spread.area(share, keys, seconds)
            expected = gaussian_spread.shapley(share, keys, seconds)
            limit = 3 * found.total.error[t, s] + 0.05 * whole
            assert found.total.value[t, s] == pytest.approx(whole, abs=limit)
            for k, key in enumerate(keys):
                rest = gaussian_spread.area(share, {*keys} - {key}, seconds)
                for estimate, value in (
                    (found.share, expected[key] / whole),
                    (found.without, rest / whole - 1),
                ):
                    limit = 3 * estimate.error[k, t, s] + margin
                    got = estimate.value[k, t, s]
                    assert got == pytest.approx(value, abs=limit), (key, share)


def test_shares_of_start_and_current(tmp_path: Path) -> None:
    errors = {"current": gaussian_spread.CASE["uncertainty"]["current"]}
    case = case_of(tmp_path, uncertainty=errors, wind=None, scenario={
        "position": gaussian_spread.CASE["scenario"]["position"],
    })  # fmt: skip
    found = drift.budget(case, particles=4000)
    total = found.share.value.sum(axis=0) + found.rest.value
    np.testing.assert_allclose(total, 1.0, atol=1e-12)
    assert (found.share.error > 0).all()
    check_against_closed_form(found, ("start", "current"), 0.02)
    assert found.greatest.key == "current"
    seconds = gaussian_spread.HOURS * 3600
    for s, share in enumerate(found.shares):
        for k, key in enumerate(("start", "current")):
            alone = gaussian_spread.area(share, [key], seconds)
            limit = 3 * found.alone.error[k, 0, s] + 0.05 * alone
            assert found.alone.value[k, 0, s] == pytest.approx(alone, abs=limit)


@pytest.mark.thorough
def test_shares_of_five_sources_at_two_times(tmp_path: Path) -> None:
    found = drift.budget(case_of(tmp_path), times=["+3 h", "+8 h"])
    check_against_closed_form(found, KEYS, 0.01)
    rows = found.table
    assert list(rows["source"][:5]) == list(KEYS)
    assert len(rows) == 2 * 2 * 5
    assert rows["share"].groupby([rows["time"], rows["area"]]).sum().to_numpy() == pytest.approx(
        1 - found.rest.value.ravel(), abs=1e-9
    )


@pytest.mark.thorough
def test_two_scenarios_far_apart(tmp_path: Path) -> None:
    """Two normal clouds: the density at the edge is the same in both, so both areas are known."""
    std, weights = 2500.0, (0.7, 0.3)
    scenarios = [
        {"name": name, "weight": weight, "object": "water", "position": {"at": at, "std": std}}
        for name, weight, at in zip(
            ("raft", "boat"), weights, ("27 30N 088 00W", "28 30N 086 40W"), strict=True
        )
    ]
    case = trial_case.load(tmp_path, scenario=scenarios, output={"areas": [50, 95]}, duration="2 h")
    found = drift.budget(case)
    assert [source.key for source in found.sources] == ["scenarios", "start"]
    for s, share in enumerate(found.shares):
        edge = (1 - share) / 2  # of each cloud: its weight times exp(-r^2 / 2 std^2) there
        logs = [max(math.log(weight / edge), 0.0) for weight in weights]
        if edge > weights[1]:  # only the heavier cloud is inside
            logs = [math.log(weights[0] / (weights[0] - share)), 0.0]
        both = 2 * math.pi * std**2 * sum(logs)
        one = 2 * math.pi * std**2 * -math.log1p(-share)
        limit = 3 * found.total.error[0, s] + 0.03 * both
        assert found.total.value[0, s] == pytest.approx(both, abs=limit)
        limit = 3 * found.without.error[0, 0, s] + 0.03
        assert found.without.value[0, 0, s] == pytest.approx(one / both - 1, abs=limit)


@pytest.mark.thorough
def test_other_times_change_no_bit(tmp_path: Path) -> None:
    case = case_of(tmp_path, uncertainty={"current": {"std": 0.2}, "wind": "none"})
    one = drift.budget(case, particles=4000)
    other = drift.budget(case, particles=4000, times=["+8 h", "+3 h"])
    np.testing.assert_array_equal(one.areas[:, 0], other.areas[:, 1])
    np.testing.assert_array_equal(one.batches[:, :, 0], other.batches[:, :, 1])


@pytest.mark.thorough
def test_a_time_at_which_nothing_is_left_on_the_map_is_rejected(tmp_path: Path) -> None:
    """The remedy works: a time before all have sunk, also where all sink in some forecasts."""
    sinks = {"name": "sunk", "at": "+1 h", "sinks": True}
    case = case_of(tmp_path, scenario={"change": [sinks]}, uncertainty="none")
    with pytest.raises(UserError, match=r"times: at .* nothing is left on the map.*earlier"):
        drift.budget(case, particles=4000)
    found = drift.budget(case, particles=4000, times=["+30 min"])
    assert np.isfinite(found.share.value).all()
