"""Scenarios by rank and by axis: files, picture, terminal and report of a run with a family."""

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest

import drift
from drift.apps.cli import outcome
from drift.case import file as case_file
from drift.evidence.posterior import chapter, ranking, scenarios_map, tables
from drift.evidence.posterior.records import Posteriors
from drift.pipeline.result import Result
from drift.products.maps.imprint import Imprint, Setting

PAINTS = False  # but for one test
CASE = """
title = "A few stories"
start = "2026-11-21T00:00Z"
duration = "12 h"
particles = 9000
coast.source = "none"
output.times = ["+12 h"]
[[family]]
name = "transit"
weight = 3
scenario.phase = [{ voyage = { waypoints = [[-30.0, 10.0], [-30.0, 12.5]], cross_track = "4 nmi" } }]
axis.speed = { key = "phase.1.voyage.speed", from = "5 kn", to = "11 kn", ranges = 6 }
axis.departure = { key = "phase.1.voyage.departure", from = "+0 h", to = "+4 h", count = 3 }
[[scenario]]
name = "=south"
phase = [{ voyage = { waypoints = [[-30.0, 10.0], [-30.0, 8.5]], speed = "5 kn" } }]
[[look]]
name = "north"
sees = "something"
time = "+8 h"
at = [-30.0, 11.0]
width = "60 nmi"
height = "30 nmi"
false_alarms = 0.05
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    folder = tmp_path_factory.mktemp("stories")
    (folder / "case.toml").write_text(CASE)
    result = drift.run(drift.load(folder / "case.toml"), folder / "out")
    return result, folder / "out"


def posteriors(run: tuple[Result, Path]) -> Posteriors:
    assert run[0].posteriors is not None
    return run[0].posteriors


@pytest.mark.thorough
def test_the_table_is_ranked(run: tuple[Result, Path]) -> None:
    rows = list(csv.DictReader(io.StringIO((run[1] / "scenarios.csv").read_text())))
    assert len(rows) == 19
    posterior = np.array([float(row["posterior"]) for row in rows])
    assert (np.diff(posterior) <= 0).all()
    np.testing.assert_allclose(
        [float(row["cumulative"]) for row in rows], np.cumsum(posterior), atol=1e-6
    )
    assert posterior.sum() == pytest.approx(1, abs=1e-6)
    for row in rows:
        assert float(row["factor"]) == pytest.approx(
            float(row["posterior"]) / float(row["prior"]), rel=1e-5
        )
        if row["family"]:
            speed, departure = row["scenario"].removeprefix("transit, ").split(", ")
            assert (row["axis speed"], row["axis departure"]) == (
                speed,
                f"'{departure}",
            )  # no formula for a spreadsheet
            assert float(row["prior"]) == pytest.approx(0.75 / 18, rel=1e-5)
        else:
            assert row["scenario"] == "'=south"
            assert row["axis speed"] == ""
    assert run[0].tables["scenarios"]["rank"].tolist() == list(range(1, 20))


@pytest.mark.thorough
def test_shares_by_axis_are_sums_of_scenarios(run: tuple[Result, Path]) -> None:
    own = posteriors(run)
    rows = list(csv.DictReader(io.StringIO(tables.csv(own, "x"))))
    for update, stage in enumerate(own.stages):
        found = {
            r["value"]: float(r["share"])
            for r in rows
            if r["quantity"] == "axis speed" and r["update"] == str(update)
        }
        for label, share in found.items():
            summed = sum(
                p
                for name, p in zip(own.scenarios, stage.scenarios, strict=True)
                if label in name.split(", ")
            )
            assert share == pytest.approx(summed, abs=2e-7)
        assert sum(found.values()) == pytest.approx(
            1 - stage.scenarios[own.scenarios.index("=south")], abs=1e-6
        )
    assert not any(row["quantity"].startswith("axis") and row["scenario"] != "all" for row in rows)


def test_the_summary_and_the_terminal(run: tuple[Result, Path]) -> None:
    told = json.loads((run[1] / "summary.json").read_text())
    ranked = ranking.ranking_of(posteriors(run))
    assert ranked is not None
    stories = told["stories"]
    assert stories["number"] == 19
    entropy = -float(
        np.sum(
            ranked.posterior
            * np.log(ranked.posterior, where=ranked.posterior > 0, out=np.zeros(19))
        )
    )
    assert stories["effective"]["posterior"] == pytest.approx(np.exp(entropy))
    assert stories["entropy_bit"]["posterior"] == pytest.approx(entropy / np.log(2))
    assert stories["effective"]["prior"] == pytest.approx(
        np.exp(0.75 * np.log(18 / 0.75) + 0.25 * np.log(4)), rel=1e-6
    )
    assert list(stories["axes"]) == ["speed", "departure"]
    assert sum(value["prior"] for value in stories["axes"]["speed"].values()) == pytest.approx(0.75)
    words = outcome.forecast(told)
    assert words["scenarios by departure"].count("before") == 3
    assert words["effective scenarios"].startswith(f"{stories['effective']['posterior']:.3g} of 19")
    values = told["posteriors"][-1]["quantities"]["scenario"]["values"]
    assert len(values) == 11
    assert sum(values.values()) == pytest.approx(1)


@pytest.mark.usefixtures("painted")
def test_the_picture_is_drawn_however_long_names_are(
    run: tuple[Result, Path], tmp_path: Path
) -> None:
    ranked = ranking.ranking_of(posteriors(run))
    assert ranked is not None
    assert (run[1] / "scenarios.png").read_bytes().startswith(b"\x89PNG")
    scenarios_map.plot_scenario_ranking(
        ranked,
        tmp_path / "few.png",
        Setting(Imprint("Of a $ and a $", caution="SYNTHETIC"), particles=100),
    )
    assert (tmp_path / "few.png").stat().st_size > 10_000


def test_the_report_lists_few_rows(run: tuple[Result, Path]) -> None:
    """Scenarios by rank and by axis; the table of what is believed has no rows of single scenarios."""
    found = {
        leaf["title"]: leaf
        for leaf in chapter._leaves(posteriors(run), ranking.ranking_of(posteriors(run)))
    }
    assert len(found["Scenarios by rank"]["rows"]) == 19
    assert len(found["Scenarios by axis"]["rows"]) == 9
    assert "scenario" not in found["Posteriors besides position"]["where"]["quantity"]


def test_one_scenario_or_no_update_has_no_ranks(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(CASE[: CASE.index("[[look]]")])
    made = drift.run(case_file.load(path))
    assert made.posteriors is not None
    assert ranking.ranking_of(made.posteriors) is None
    assert "scenarios" not in made.tables
    assert "stories" not in made.summary


def test_a_check_tells_families_by_their_axes(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(CASE)
    told = drift.check(case_file.load(path))
    assert (
        told['family "transit"']
        == "75 %, 18 scenarios: speed 5-6 kn to 10-11 kn (6); departure +0 h, +2 h, +4 h"
    )
    assert 'such as "transit, 5-6 kn, +0 h"' in told
    assert [name for name in told if name.startswith("scenario")] == ['scenario "=south"']
