"""Experiments of any case: files, refusals, common random numbers, the same bits with one thread
and two.
"""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trial_case
from one_thread import Process

import drift
from drift.apps.cli import commands
from drift.assess.experiment import command, map, ordinary, text
from drift.assess.experiment.record import Experiment
from drift.products.maps.imprint import Imprint
from drift.tracking.tracker.figures import Figure
from geo.errors import UserError

AREA = "outputs.-1.area_nmi2.95%"


@pytest.fixture
def case(tmp_path: Path) -> str:
    path = trial_case.write(
        tmp_path,
        seed=40,
        output={"every": "3 h"},
        wind={"constant": {"speed": "14 kn", "from": 250}},
        scenario={"object": "LIFE-RAFT-DB-10"},
    )
    return str(path)


@pytest.mark.thorough
def test_figures_are_those_of_runs_with_the_seeds_that_follow(case: str, tmp_path: Path) -> None:
    """Each by drift.run of the case; a variant that changes nothing differs by nothing, one that
    does by its own runs.
    """
    variants = {"the same": {"duration": "6 h"}, "wider": {"scenario.0.position.std": "6 nmi"}}
    found = command.experiment(case, tmp_path / "out", variants=variants, figures=[AREA], runs=2)
    assert found.ways == ("as it is", "the same", "wider")
    (figure,) = found.figures
    for way, changes in enumerate([{}, {}, {"scenario.0.position.std": "6 nmi"}]):
        for run in range(2):
            result = drift.run(drift.load(case, {**changes, "seed": str(40 + run)}))
            area = float(result.forecast.data["containment_area"].sel(share=0.95)[-1]) / 1852**2
            assert figure.values[way, run] == pytest.approx(area)
    difference, error = figure.difference()
    assert difference[1] == error[1] == 0
    apart = figure.values[2] - figure.values[0]
    assert difference[2] == pytest.approx(apart.mean())
    assert error[2] == pytest.approx(apart.std(ddof=1) / np.sqrt(2))
    assert difference[2] > 0
    assert text.groups_of_equal_ways(found) == [[0, 1], [2]]
    rows = list(
        csv.DictReader(
            (tmp_path / "out" / "experiment.csv").read_text(encoding="utf-8").splitlines()
        )
    )
    assert [row["way"] for row in rows] == list(found.ways)
    assert float(rows[2]["difference"]) == pytest.approx(difference[2], rel=1e-5)
    assert (tmp_path / "out" / "experiment.png").stat().st_size > 10_000
    assert not (tmp_path / "out" / "experiment_times.csv").exists()


def test_numbers_of_a_summary_by_their_paths() -> None:
    summary = {"a": [{"b.c": 1}, {"b.c": 2.5}], "d": {"e": None, "f": True, "g": np.float64(3)}}
    assert dict(ordinary.numbers_by_path(summary)) == {
        "a.0.b.c": 1,
        "a.1.b.c": 2.5,
        "a.-1.b.c": 2.5,
        "d.g": 3,
    }


def test_differences_are_of_runs_that_share_their_numbers() -> None:
    figure = Figure("x", "", np.array([[1.0, 5.0, 9.0], [2.0, 6.5, np.nan]]))
    difference, error = figure.difference()
    np.testing.assert_allclose(difference, [0, 1.25])
    np.testing.assert_allclose(error, [0, np.std([1, 1.5], ddof=1) / np.sqrt(2)])


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"figures": ["outputs.-1.area_nmi2.94%"]}, "no such number in the summary of this case (as it is); similar ones: outputs.-1.area_nmi2.95%"),
        ({"variants": {"x": {"duration": "1 parsec"}}}, "duration"),
        ({"variants": {"as it is": {"particles": "100"}}}, 'variants "as it is": this is the name of the unchanged case; take another name'),
        ({"variants": {"a": {"seed": "9"}}}, 'variants "a": all variants share their random numbers, so a variant cannot set seed; give --seed'),
        ({"runs": 0}, "runs = 0 must be at least 1"),
    ],
)  # fmt: skip
def test_what_cannot_be_run_is_refused_before_the_first_or_after_one(
    case: str, tmp_path: Path, asked: dict[str, object], words: str
) -> None:
    with pytest.raises(UserError) as told:
        command.experiment(case, tmp_path / "out", **{"runs": 2, **asked})  # type: ignore[arg-type]
    assert words in str(told.value)
    assert not (tmp_path / "out").exists()


def test_two_variants_of_one_name_are_refused(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "experiment",
        case,
        "--with",
        "a: particles=100",
        "--with",
        "a: particles=200",
        "--out",
        str(tmp_path / "out"),
    ]
    assert commands.main(words) == 2
    assert '--with "a": the name is used twice' in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.thorough
def test_a_tracking_case_has_its_own_ways_and_figures(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="a tracking case has"):
        command.experiment("closing", figures=["x"])
    found = command.experiment(
        "closing", changes={"particles": "100", "duration": "90 min"}, runs=2
    )
    assert (
        "naive, weighted position; naive, heading and speed; naive, combined"
        in text.experiment_facts(found)
    )
    assert text.groups_of_equal_ways(found)[0] == [0, 1, 2]


@pytest.mark.thorough
def test_how_often_areas_hold_the_target_is_told_at_each_time(tmp_path: Path) -> None:
    """While a track is held at every time the mean over times is that of the runs, of errors and of
    areas.
    """
    small = {"particles": "1000", "duration": "40 min", "seed": "8"}
    found = command.experiment("fast_boat", tmp_path / "out", changes=small, runs=6)
    tables = {
        name: list(
            csv.DictReader(
                (tmp_path / "out" / f"{name}.csv").read_text(encoding="utf-8").splitlines()
            )
        )
        for name in ("experiment", "experiment_times")
    }
    columns = {
        "position error": "position_error_nmi", "course error": "course_error_deg", "speed error": "speed_error_kn",
        "in 50 % area": "in_50_percent_area_percent", "in 90 % area": "in_90_percent_area_percent",
    }  # fmt: skip
    whole = [way for way in found.ways if all(
        float(row["mean"]) == 100.0 for row in tables["experiment"] if (row["way"], row["figure"]) == (way, "track held")
    )]  # fmt: skip
    assert whole
    for way in whole:
        rows = [row for row in tables["experiment_times"] if row["way"] == way]
        assert [float(row["minutes"]) for row in rows] == list(range(5, 41, 5))
        for figure, column in columns.items():
            (mean,) = (
                float(row["mean"])
                for row in tables["experiment"]
                if (row["way"], row["figure"]) == (way, figure)
            )
            assert np.mean([float(row[column]) for row in rows]) == pytest.approx(mean, rel=1e-5)
        shares = [float(row["in_50_percent_area_percent"]) / 100 for row in rows]
        errors = [float(row["in_50_percent_area_standard_error_percent"]) / 100 for row in rows]
        # Of shares of six runs; six digits are written
        np.testing.assert_allclose(
            errors, [np.sqrt(p * (1 - p) / 5) for p in shares], rtol=1e-4, atol=1e-9
        )
        assert len(set(shares)) > 2


@pytest.mark.thorough
def test_the_command_writes_the_same_bits_with_one_thread_and_two(
    one_thread: Process, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = {}
    for threads in (1, 2):
        out = tmp_path / str(threads)
        words = [
            "experiment",
            "closing",
            "--runs",
            "3",
            "--set",
            "particles=200",
            "--out",
            str(out),
        ]
        if threads == 1:
            done = one_thread.ask(
                "from drift.apps.cli import commands; answer = commands.main(given)", *words
            )
        else:
            done = commands.main(words)
            assert "naive, combined" in capsys.readouterr().out
        assert done == 0
        made[threads] = {
            name: (out / name).read_bytes()
            for name in ("experiment.csv", "experiment_runs.csv", "experiment_times.csv")
        }
        assert (out / "experiment.png").stat().st_size > 20_000
    assert made[1] == made[2]
    rows = list(
        csv.DictReader((tmp_path / "1" / "experiment.csv").read_text(encoding="utf-8").splitlines())
    )
    assert len(rows) == 10 * 5
    assert {row["published"] for row in rows if row["way"] == "naive, combined"} == {
        "7.52",
        "116.3",
        "12.69",
        "",
    }


def test_runs_that_are_all_alike_have_no_standard_error_of_rounding() -> None:
    alike = np.full(10, 10 / 21 * 100) * (1 + np.array([0, 1e-16] * 5))
    alike[3] = np.nextafter(alike[3], 100)
    figure = Figure("track held", "%", alike[None])
    assert 0 < figure.error()[0] < 1e-12
    assert text._mean_and_error(figure.mean()[0], figure.error()[0]) == ("47.62",)
    assert text._mean_and_error(47.61904, 1e-7) == ("47.61904000", "+-", "0.00000010")


def test_differences_from_the_first_way_are_told(tmp_path: Path) -> None:
    """Two ways apart by 0.5 +- 0.1 in every of four runs that scatter by ten times that, one that
    never ends, and one run without a number.
    """
    runs = np.array([10.0, 14.0, 12.0, 8.0])
    apart = np.array([0.3, 0.7, 0.5, 0.5])
    late = np.array([1.0, 2.0, np.inf, np.inf])
    figures = (
        Figure("area", "nmi2", np.stack([runs, runs + apart, [*runs[:3], np.nan]])),
        Figure("time to criteria", "min", np.stack([late, late, [np.inf] * 4])),
    )
    found = Experiment("x", "", 1, 4, "a particle", ("as it is", "more", "less"), figures)
    error = np.std(apart, ddof=1) / 2
    told = text.experiment_facts(found)
    assert f"area 11.5 +- 1.3 nmi2 (+0.500 +- {error:.3f})" in told["more"]
    assert told["as it is"].startswith(
        "area 11.0 +- 1.3 nmi2; time to criteria median never (never in 2 of 4 runs)"
    )
    assert (
        "area 12.0 +- 1.2 nmi2 (+0) (none in 1 runs); time to criteria median never (never in 4 of 4 runs)"
        in told["less"]
    )
    assert told["in brackets"] == "the difference from the first, run by run"
    only = text.experiment_facts(
        replace(found, ways=("as it is",), figures=(Figure("area", "nmi2", runs[None]),))
    )
    assert only == {"as it is": "area 11.0 +- 1.3 nmi2"}
    runs = np.array([27.1, 28.3, 28.75])
    noise = Figure("lat", "", np.stack([runs, np.nextafter(runs, [30, 30, 0])]))
    assert text.difference_from_first(noise, 1) == "+0"  # of 3e-15 +- 2e-15
    once = text.experiment_facts(
        replace(
            found,
            ways=("x",),
            figures=(Figure("time to criteria", "min", np.array([[1.0, 2, 3, np.inf]])),),
        )
    )
    assert once == {"x": "time to criteria median 2.5 min (never in 1 of 4 runs)"}
    numbers = text.summary_of_experiment(found)["figures"][2]
    assert (numbers["way"], numbers["difference"]) == ("more", 0.5)
    assert numbers["difference_standard_error"] == pytest.approx(error, rel=1e-5)
    rows = list(csv.DictReader(text.experiment_table(found).splitlines()))
    assert [row["quantile_50"] for row in rows if row["figure"] == "time to criteria"] == [
        "inf",
        "inf",
        "inf",
    ]
    assert [row["quantile_10"] for row in rows if row["figure"] == "time to criteria"][2] == "inf"
    assert text.runs_csv(found).splitlines()[:2] == [
        "way,run,area_[nmi2],time_to_criteria_[min]",
        "as it is,1,10.0,1.0",
    ]
    assert text.runs_csv(found).splitlines()[3] == "as it is,3,12.0,inf"
    map.plot_experiment(found, tmp_path / "x.png", Imprint("x", "casp-drift", {}))
    assert (tmp_path / "x.png").stat().st_size > 10_000
