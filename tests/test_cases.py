"""Every shipped case runs and finds what it says it expects."""

import os
from collections.abc import Callable
from contextlib import AbstractContextManager

import pytest
import shipped
from places import ROOT

from drift.case import expect
from drift.case import file as case_file
from drift.pipeline import flow

NAMES = [name for name, _ in case_file.shipped() if name not in shipped.COMPARED]
# those whose run takes more than a second; the thorough stage has them all
SLOW = {
    "cast_submarine",
    "gulf_containers",
    "medsearch_transit",
    "pacsearch",
    "paria",
    "smuggler_bridge",
    "washington_drums",
    "zoe_containers",
}
CASES = ROOT / "cases"


@pytest.fixture
def given(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of a case, whose files can be found."""
    name: str = request.param
    if "DRIFT_DATA" in (CASES / f"{name}.toml").read_text():  # the others need no file
        monkeypatch.setenv("DRIFT_DATA", str(request.getfixturevalue("data")))
    return name


@pytest.mark.parametrize(
    "given",
    [pytest.param(name, marks=[pytest.mark.thorough] * (name in SLOW)) for name in NAMES],
    indirect=True,
)
def test_case_runs(given: str, small: Callable[[], AbstractContextManager[None]]) -> None:
    """With few particles: nothing is refused, and all of the probability is somewhere at its end."""
    fewer = {
        "output": '{ every = "100 d" }',
        "particles": str(max(400, 40 * len(case_file.load(given).scenarios))),
    }
    if case_file.load(given).spill:
        fewer |= {"spill.worlds": "64", "spill.per_world": "20"}
        del fewer["particles"]
    with small():  # here only: the areas below are read off maps
        account = flow.run(case_file.load(given, fewer)).summary["account"]
    assert sum(account.values()) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(
    "given",
    [pytest.param(name, marks=[pytest.mark.thorough] * (name != "overdue_boat")) for name in NAMES],
    indirect=True,
)
def test_case_finds_what_it_expects(given: str) -> None:
    # A fifth of the particles: means move by spread / sqrt(20,000), less than 1 % of any spread
    # here. Of a spill, 250 worlds of 80: shares move by their spread between worlds / sqrt(250), a
    # third of the ranges.
    fewer = {"particles": "20_000"}
    if case_file.load(given).spill:
        fewer = {"spill.worlds": "250", "spill.per_world": "80"}
    fewer["output"] = '{ every = "100 d" }'  # the start and the end: expectations are of the end
    assert shipped.misses(flow.run(case_file.load(given, fewer))) == []


def test_a_miss_is_told() -> None:
    wanted = expect.Expect.model_validate(
        {
            "ashore": [0.2, 0.3],
            "area_50": ["10 nmi2", "12 nmi2"],
            "mean_position_within": {"of": "60 00N 004 00E", "distance": "1 nmi"},
        }
    )
    end = {
        "probability": {"adrift": 0.75, "ashore": 0.25, "outside": 0.0, "left": 0.0},
        "area_nmi2": {"50%": 11.0, "95%": 40.0},
        "mean": {"lon": 4.0, "lat": 60.01},  # 0.6 nmi north
    }
    assert expect.misses(wanted, end) == []
    end |= {"mean": {"lon": 4.0, "lat": 60.02}, "area_nmi2": {"50%": None, "95%": 40.0}}
    end["probability"] |= {"ashore": 0.1}
    missed = expect.misses(wanted, end)
    assert [line.split(":")[0] for line in missed] == ["ashore", "area_50", "mean position"]


def test_data_are_asked_for_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DRIFT_DATA", raising=False)
    with pytest.raises(
        case_file.UserError, match="environment variable DRIFT_DATA; set it: export DRIFT_DATA="
    ):
        case_file.load("norkyst_raft")
    assert not os.environ.get("DRIFT_DATA")
    assert case_file.load("overdue_boat").path == ROOT / "cases" / "overdue_boat.toml"
