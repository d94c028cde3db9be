"""Calibration over many finds against SciPy's distributions, and the command with its files."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import trial_case
from scipy import stats

import drift
from drift.apps.cli import commands as cli
from drift.assess.score import calibration

PAINTS = False
pytestmark = pytest.mark.usefixtures("coarse_maps")
HEAD = "run,time,lon,lat\n"


@pytest.mark.parametrize(("count", "of", "share"), [(3, 7, 0.75), (0, 5, 0.5), (9, 9, 0.9)])
def test_interval_and_test_of_an_area(count: int, of: int, share: float) -> None:
    """Clopper and Pearson by quantiles of beta; the binomial test by its probabilities."""
    inside = np.linspace(0, share, count)
    held = calibration.count_held(np.concatenate([inside, np.full(of - count, 0.999)]), share)
    assert (held.count, held.of) == (count, of)
    low = 0.0 if count == 0 else stats.beta.ppf(0.025, count, of - count + 1)
    high = 1.0 if count == of else stats.beta.ppf(0.975, count + 1, of - count)
    assert (held.low, held.high) == pytest.approx((low, high), abs=1e-9)
    chance = stats.binom.pmf(np.arange(of + 1), of, share)
    assert held.p == pytest.approx(chance[chance <= chance[count] * (1 + 1e-7)].sum(), rel=1e-6)


def test_kolmogorovs_distance() -> None:
    values = np.array([0.61, 0.13, 0.94, 0.92, 0.55])
    order = np.sort(values)
    steps = np.arange(6) / 5
    expected = max(np.abs(order - steps[1:]).max(), np.abs(order - steps[:-1]).max())
    distance, p = calibration.kolmogorov(values)
    assert distance == pytest.approx(expected, abs=1e-15)
    assert p == pytest.approx(stats.kstwo.sf(expected, 5), rel=1e-9)
    assert stats.kstwo.sf(calibration.band(5), 5) == pytest.approx(0.05, rel=1e-6)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two small runs, in folders "one" and "two"."""
    folder = tmp_path_factory.mktemp("runs")
    for name, seed in (("one", 1), ("two", 2)):
        drift.run(trial_case.load(folder, seed=seed, duration="2 h"), folder / name)
    return folder


def found_in(folder: Path, *lines: str) -> Path:
    path = folder / "found.csv"
    path.write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")
    return path


ONE = "one,2026-11-21T02:00Z,87 58W,27 30.4N"
TWO = "two,210130ZNOV26,-88.0,27.49"


def test_the_command_writes_a_row_for_each_find(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = found_in(tmp_path, ONE, TWO)
    argv = ["score", str(runs / "one"), str(runs / "two"), "--found", str(path)]
    assert cli.main([*argv, "--out", str(tmp_path / "out"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    with (tmp_path / "out" / "score.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["run"] for row in rows] == ["one", "two"]
    assert float(rows[0]["lon"]) == pytest.approx(-(87 + 58 / 60))
    assert float(rows[1]["lead_h"]) == 1.5
    stored = json.loads((tmp_path / "out" / "summary.json").read_text())["score"]
    assert printed["score"]["finds"] == stored["finds"]
    assert [held["of"] for held in stored["held"]] == [2] * 4
    assert (tmp_path / "out" / "score.png").exists()
    (summary,) = {row["run_id"] for row in rows}
    assert summary not in {row["scored_run_id"] for row in rows}
    assert "areas" in printed["facts"]["in short"]


def rejected(*folders: Path, **options: object) -> tuple[str, ...]:
    with pytest.raises(drift.UserError) as raised:
        drift.score(folders, **options)
    return raised.value.lines


def test_what_is_rejected(runs: Path, tmp_path: Path) -> None:
    one, two = runs / "one", runs / "two"
    (line,) = rejected(one)
    assert 'where was it found? Give found FILE with a line for run "one"' in line
    lines = rejected(one, found=found_in(tmp_path, ONE.replace("one", "three")))
    assert 'run "three" is none of the folders given: one' in lines[0]
    lines = rejected(one, two, found=found_in(tmp_path, ONE, ONE))
    assert lines == ('found.csv, line 3: there is a second find of run "one"; give one',)
    lines = rejected(one, found=found_in(tmp_path, "one,2026-11-21T02:00,0,0", "one,+1 h,0,0"))
    assert "has no zone" in lines[0]
    assert '"+1 h" must be a date and time' in lines[1]
    (line,) = rejected(one, found=found_in(tmp_path, "one,2026-11-21T02:00Z,0"))
    assert "as many values as names are needed" in line
    (line,) = rejected(one, found=found_in(tmp_path, ONE.replace("21T02", "22T02")))
    assert "no output is within 60 min of the find at 220200ZNOV26" in line
    (line,) = rejected(runs)
    assert "not the complete result of a run" in line
    assert rejected() == ("drift score: no folder is given; name the results of drift run",)
    lines = rejected(one, one, found=found_in(tmp_path, ONE))
    assert 'two folders are called "one"' in lines[0]
    assert rejected(one, within=-1.0) == ("within = -1 s must be at least 0 s",)
