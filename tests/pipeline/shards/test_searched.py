"""A search in shards tells and writes what it does in one piece, also where its particles have to
meet on the way.
"""

import gc
import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shards as runs
from searched_cases import HEARD, STEERED

import drift
from drift.case import case_digest
from drift.engine.particles.ensemble import Ensemble
from drift.evidence.filter.filter import SearchFilter
from drift.pipeline import flow
from drift.pipeline.shards import unit, work
from drift.products.files import hidden


def load(folder: Path, text: str) -> drift.Case:
    (folder / "land.geojson").write_text(runs.SHORE)
    (folder / "case.toml").write_text(text)
    return drift.load(folder / "case.toml")


def same(one: drift.Result, other: drift.Result) -> None:
    """Hold all that is told of two runs against each other, to the bit."""
    runs.same(one, other)
    assert one.updates is not None
    assert one.posteriors is not None
    assert told(one.updates) == told(other.updates)
    assert told(one.posteriors) == told(other.posteriors)
    assert told(one.begun) == told(other.begun)


def told(what: object) -> object:
    """Return a record in words, to the bit."""
    if isinstance(what, np.ndarray):
        return what.dtype.str, what.shape, what.tobytes()
    if isinstance(what, float | np.floating):
        return float(what).hex()
    if isinstance(what, tuple | list):
        return [told(part) for part in what]
    if hasattr(what, "__dataclass_fields__"):
        return {name: told(getattr(what, name)) for name in what.__dataclass_fields__}
    return repr(what)


@pytest.fixture(autouse=True)
def unwritten(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flow, "write_results", lambda *given, **more: None)


@pytest.fixture(scope="module")
def searched(tmp_path_factory: pytest.TempPathFactory) -> tuple[drift.Case, drift.Result]:
    """Return the case that drifts, and its result in one piece."""
    case = runs.searched(tmp_path_factory.mktemp("searched"))
    return case, drift.run(case)


@pytest.fixture(scope="module")
def resampled(tmp_path_factory: pytest.TempPathFactory) -> tuple[drift.Case, drift.Result]:
    """Return the case that steers, resampled within its scenarios, and its result in one piece."""
    case = load(
        tmp_path_factory.mktemp("resampled"), STEERED.replace("below = 0\n", "below = 0.6\n")
    )
    return case, drift.run(case)


RESAMPLED = {
    "never": "",
    "kahn": 'below = 0.6\nmethod = "kahn"',
    "across": "below = 0.6\nacross_scenarios = true",
    "duplicates": 'below = 0.99\nmethod = "duplicates"',
}


@pytest.mark.thorough
@pytest.mark.parametrize(
    "rule",
    [
        pytest.param(rule, id=name, marks=[pytest.mark.thorough] * (name != "duplicates"))
        for name, rule in RESAMPLED.items()
    ],
)
def test_what_steers_is_searched_as_in_one_piece(rule: str, tmp_path: Path) -> None:
    case = load(tmp_path, STEERED.replace("below = 0\n", f"{rule}\n" if rule else "below = 0\n"))
    whole = drift.run(case)
    assert whole.updates is not None
    kinds = [update.kind for update in whole.updates.all]
    assert {"sortie", "contact", "look", "presence", "barrier", "overdue"} <= set(kinds)
    assert any(update.resampled for update in whole.updates.all) == bool(rule)
    assert whole.updates.crossings is not None
    shares: list[float] = []
    report = lambda phase, share: shares.append(share) if phase == "drift" else None  # noqa: E731
    same(whole, drift.run(case, shards=2, report=report))
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert whole.posteriors is not None
    told_by = [one.quantity.name for one in whole.posteriors.told].index("scenario")
    for update, stage in zip(whole.updates.all, whole.posteriors.stages[1:], strict=True):
        np.testing.assert_allclose(stage.marginals[told_by].table[-1], update.posterior, atol=1e-9)


@pytest.mark.thorough
def test_what_a_sonar_heard_is_as_in_one_piece(tmp_path: Path) -> None:
    case = load(tmp_path, STEERED.replace("below = 0\n", "below = 0.6\n") + HEARD)
    whole = drift.run(case)
    assert whole.updates is not None
    assert {"first", "heard, in doubt", "last", "listened"} <= {
        update.name for update in whole.updates.all
    }
    assert sum(update.resampled for update in whole.updates.all) > 1
    same(whole, drift.run(case, shards=3))


@pytest.mark.thorough
def test_what_drifts_is_searched_as_in_one_piece(searched: tuple[drift.Case, drift.Result]) -> None:
    """On a coast that refloats, with debris and a sortie that drifts with its marker."""
    case, whole = searched
    same(whole, drift.run(case, shards=4))


@pytest.mark.thorough
def test_what_drifts_is_resampled_as_in_one_piece(
    searched: tuple[drift.Case, drift.Result],
) -> None:
    case, _ = searched
    anew = drift.vary(case, {"resampling": {"below": 0.9}})
    again = drift.run(anew)
    assert again.updates is not None
    assert sum(update.resampled for update in again.updates.all) > 1
    same(again, drift.run(anew, shards=4))


@pytest.mark.thorough
def test_a_contact_at_the_begin_is_asked_for_before_the_first_step(tmp_path: Path) -> None:
    text = runs.FEWER + runs.SEARCHED.replace('"+140 min"', '"+0 min"')
    case = load(tmp_path, text)
    same(drift.run(case), drift.run(case, shards=4))


class Killed(Exception):
    """Stands for a kill: nothing of what was under way is tidied."""


@pytest.mark.parametrize("after", [1, 8, 14])
@pytest.mark.thorough
def test_a_search_that_was_killed_goes_on(
    after: int,
    resampled: tuple[drift.Case, drift.Result],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Killed as its files come to stand, one more of them at a time: the same comes of it."""
    (case, whole), out, put, stood = resampled, tmp_path / "out", work.replace, []

    def killed(path: Path, text: str) -> None:
        if path.name != work.ABOUT and len(stood) == after:
            raise Killed
        stood.append(path.name)
        put(path, text)

    monkeypatch.setattr(work, "replace", killed)
    with pytest.raises(Killed):
        drift.run(case, out, shards=3)
    monkeypatch.setattr(work, "replace", put)
    same(whole, drift.run(case, out, shards=3))


@pytest.mark.thorough
def test_a_stretch_whose_begin_is_gone_begins_anew(
    searched: tuple[drift.Case, drift.Result],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """A stretch is altered after the state from which it went on has been taken away."""
    (case, whole), out = searched, tmp_path / "out"
    monkeypatch.setattr(work.Work, "drop", lambda self: None)
    monkeypatch.setattr(flow, "build_result", lambda *given: (_ for _ in ()).throw(Killed))
    with pytest.raises(Killed):
        drift.run(case, out, shards=3)
    monkeypatch.undo()
    monkeypatch.setattr(flow, "write_results", lambda *given, **more: None)
    kept = sorted(path.name for path in (tmp_path / f".out{hidden.UNFINISHED}").glob("*.bin"))
    late = (
        tmp_path
        / f".out{hidden.UNFINISHED}"
        / next(name for name in kept if name.startswith("shard-00001-001"))
    )
    late.write_bytes(late.read_bytes()[:-1])
    filled: list[int] = []
    fill = unit.Unit._fill
    monkeypatch.setattr(
        unit.Unit, "_fill", lambda *given: (filled.append(given[0].stretch), fill(*given))[1]
    )
    with caplog.at_level(logging.WARNING, "drift"):
        same(whole, drift.run(case, out, shards=3))
    assert "it starts again" in caplog.text
    assert filled.count(0) == 3


@pytest.mark.thorough
def test_a_search_that_contradicts_all_keeps_nothing(tmp_path: Path) -> None:
    text = runs.FEWER + runs.SEARCHED.replace("belief = 0.7\n", "").replace(
        "[0.03, 0.05]", "[-0.5, -0.5]"
    )
    case, out = load(tmp_path, text), tmp_path / "out"
    with pytest.raises(drift.UserError, match='contact "seen" contradicts every scenario') as whole:
        drift.run(case)
    with pytest.raises(drift.UserError) as cut:
        drift.run(case, out, shards=4)
    assert str(cut.value) == str(whole.value)
    assert not list((tmp_path / f".out{hidden.UNFINISHED}").glob("*.bin"))


UNIT = """
[plan]
begin = "+4.5 h"
until = "+5 h"
particles = 2000
[[unit]]
name = "helicopter"
kind = "Helicopter"
base = [-0.4, 0.3]
search_speed = "90 kn"
endurance = "0.4 h"
daylight = false
sweep_width = "0.5 nmi"
"""


@pytest.mark.thorough
def test_a_plan_is_scored_in_shards_as_in_one_piece(tmp_path: Path) -> None:
    case = load(tmp_path, runs.FEWER + runs.SEARCHED + UNIT)
    plan, whole = drift.plan(case)
    again, cut = drift.plan(case, tmp_path / "out", shards=4)
    assert told(plan) == told(again)
    same(whole, cut)
    assert not (tmp_path / f".out{hidden.UNFINISHED}").exists()


@pytest.mark.thorough
def test_a_plan_on_workers_is_that_of_one_process(client: Any, tmp_path: Path) -> None:
    """Its forecast ends with the plan, before the run would: a built-in wind over the reach of a
    shorter run is another, as would be the part of a file.
    """
    text = runs.FEWER + runs.SEARCHED + UNIT
    for old, new in (
        ('duration = "5 h"', 'duration = "7 h"'),
        ("domain = { west = -0.6, south = -0.6, east = 0.5, north = 0.6 }\n", ""),
        ('constant = { speed = "9 m/s", from = 250 }', 'name = "breeze"\nanalytic = "breeze"'),
    ):
        assert old in text
        text = text.replace(old, new)
    case = load(tmp_path, text)
    assert case.plan.until < case.period.end
    plan, whole = drift.plan(case)
    again, cut = drift.plan(case, tmp_path / "out", client=client)
    assert told(plan) == told(again)
    same(whole, cut)


def test_a_case_changed_in_python_is_another(tmp_path: Path) -> None:
    """Its text is that of the file: what is kept of the file's run is none of its own."""
    case = runs.searched(tmp_path)
    fewer = replace(case, sorties=case.sorties[1:])
    assert fewer.text == case.text
    assert case_digest.digest(fewer) != case_digest.digest(case)
    assert case_digest.digest(drift.load(case.path)) == case_digest.digest(case)


@dataclass(frozen=True)
class Nothing:
    """What stands for a run's result, and holds nothing of it."""

    saved: object = None


@pytest.mark.thorough
@pytest.mark.parametrize(
    "text",
    [
        pytest.param(STEERED, id="steered", marks=pytest.mark.thorough),
        pytest.param(runs.FEWER + runs.SEARCHED, id="searched"),
    ],
)
def test_a_shard_that_is_done_leaves_nothing_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    """Its columns go with it, and do not wait for the garbage collector, which does not see how
    large they are.
    """
    (tmp_path / "land.geojson").write_text(runs.SHORE)
    (tmp_path / "case.toml").write_text(text)
    left = []
    move = unit.Unit.move

    def alive() -> int:
        return sum(isinstance(what, Ensemble | SearchFilter) for what in gc.get_objects())

    def moved(self: unit.Unit, *rest: Any) -> Any:
        before = alive()
        reel = move(self, *rest)
        left.append(alive() - before)
        return reel

    monkeypatch.setattr(unit.Unit, "move", moved)
    monkeypatch.setattr(flow, "build_result", lambda job, run: Nothing())
    gc.collect()
    gc.disable()
    try:
        drift.run(drift.load(tmp_path / "case.toml"), shards=3)
    finally:
        gc.enable()
    assert len(left) > 6
    assert not any(left)
