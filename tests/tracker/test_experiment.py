"""Figures of tracking cases against plain loops, and targets that act."""

from dataclasses import replace

import numpy as np

from drift.case import tracking
from drift.tracker import experiment, figures, path, study
from drift.tracker.figures import Figure
from geo import sphere

KNOT, NMI = 1852 / 3600, 1852.0


def small(name: str, *, runs: int = 3, size: int = 150, end: float = 7200.0, **changes: object) -> study.Study:
    asked = tracking.load(name)
    return replace(asked, runs=runs, size=size, end=end, methods=asked.methods[:5], **changes)  # type: ignore[arg-type]


def test_figures_are_over_the_runs_that_have_one() -> None:
    rows = np.array([[3.0, np.nan, 5.0, 11.0], [np.nan] * 4, [np.nan, 2.5, np.nan, np.nan]])
    figure = Figure("x", "min", rows)
    np.testing.assert_allclose(figure.mean(), [19 / 3, np.nan, 2.5])
    np.testing.assert_allclose(figure.error(), [np.std([3, 5, 11], ddof=1) / np.sqrt(3), np.nan, np.nan])
    np.testing.assert_allclose(figure.quantiles()[0], np.quantile([3, 5, 11], figures.QUANTILES))
    assert figure.missing().tolist() == [1, 4, 3]


def test_the_time_to_criteria_is_the_first_at_which_all_are_met() -> None:
    """By a loop over what each detection left; beside it the mean errors at the marks inside the window."""
    asked = small("run_to_the_south", end=600.0, every=60.0, window=(120.0, 480.0))
    found = experiment.run(asked)
    worlds, ways = study.worlds(asked)
    kept = experiment.following.follow(worlds, asked.methods, asked.size, asked.seed)
    sweeps = worlds[0].sweeps
    told = [k for k in range(len(sweeps)) if sweeps.row[k] >= 0]
    met, near = np.full((5, 3), np.nan), np.zeros((5, 3))
    for way in range(5):
        for run in range(3):
            distances = []
            for k in told:
                row, time = int(sweeps.row[k]), sweeps.time[k]
                place, _ = ways[run].at([time])
                here = kept.place[way, run, row]
                off = np.arctan2(np.linalg.norm(np.cross(here, place[0])), here @ place[0]) * sphere.RADIUS
                turn = abs((np.degrees(kept.course[way, run, row]) - 180 + 180) % 360 - 180)
                pace = abs(kept.speed[way, run, row] - 22 * KNOT)
                if off < 0.1 * NMI and turn < 2.5 and pace < KNOT and np.isnan(met[way, run]):
                    met[way, run] = time / 60
                if sweeps.marked[k] and 120 <= time <= 480:
                    distances.append(off / NMI)
            assert len(distances) == 7
            near[way, run] = np.mean(distances)
    by_name = {figure.name: figure.values for figure in found.figures}
    np.testing.assert_allclose(by_name["position error"], near, rtol=1e-6)
    assert np.isfinite(met).any()
    np.testing.assert_allclose(by_name[experiment.MET], met)


def test_a_target_that_seeks_comes_nearer_in_every_run_and_one_that_keeps_its_course_does_as_its_legs_say() -> None:
    asked = tracking.load("closing")
    moments = np.arange(60.0, 7201.0, 60.0)
    seeks = replace(asked.methods[6].behaviour, seek=1.0, change=0.0)
    ways = experiment.following.wanders(asked.target.way, seeks, asked.tracker, moments, 4, 9)
    own = asked.tracker.place[0]
    for way in ways:
        gone = path.arc(way.at(moments)[0], own) * sphere.RADIUS
        np.testing.assert_allclose(np.diff(gone[15:]), -20 * KNOT * 60, rtol=1e-3)
    changes = replace(seeks, seek=0.0, change=1.0)
    others = experiment.following.wanders(asked.target.way, changes, asked.tracker, moments, 4, 9)
    ends = np.stack([way.at([7200.0])[0][0] for way in others])
    assert len(np.unique(ends.round(6), axis=0)) == 4
    assert all((way.rate * sphere.RADIUS <= 32 * KNOT * (1 + 1e-9)).all() for way in others)
    keeps = replace(seeks, seek=0.0, acts=None)
    (same,) = experiment.following.wanders(asked.target.way, keeps, asked.tracker, moments[:5], 1, 9)
    there = asked.target.way.at(moments[:5])[0]
    assert path.arc(same.at(moments[:5])[0], there).max() * sphere.RADIUS < 1.0  # it begins on the same course


def test_runs_of_a_target_that_acts_have_worlds_of_their_own() -> None:
    asked = small("triangulation", end=7200.0)
    law = replace(asked.methods[3].behaviour, change=1.0)
    found = experiment.run(replace(asked, target=replace(asked.target, acts=law), window=(0.0, np.inf)))
    errors = next(figure for figure in found.figures if figure.name == "position error").values
    assert np.isfinite(errors).any()
    assert len(np.unique(errors[0][np.isfinite(errors[0])])) > 1
