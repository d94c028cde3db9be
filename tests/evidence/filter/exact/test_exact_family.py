"""A family of 300 scenarios against exact Bayes, each scenario and each axis:
tests/oracles/second_opinions/families.py knows the sums in closed form.

The scenarios stand in the order speed, departure, route of the case; the oracle's in its own, by
which they are found.
"""

import csv
import io
from pathlib import Path

import families
import numpy as np
import pytest

import drift
from drift.evidence.posterior import ranking, tables
from drift.pipeline.result import Result

PARTICLES = 300_000


def names() -> list[str]:
    """Return what the oracle's scenarios are called in the case."""
    return [
        f"north, {families.SPEEDS[v]:g}-{families.SPEEDS[v + 1]:g} kn, +{families.DEPARTURES[t]:g} h, {families.MERIDIANS[r]:.2f}"
        for r, v, t in families.STORIES
    ]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Result:
    path = tmp_path_factory.mktemp("family") / "case.toml"
    path.write_text(families.case(PARTICLES))
    return drift.run(drift.load(path))


@pytest.fixture(scope="module")
def number(run: Result) -> list[int]:
    """Return where the oracle's scenarios stand among the scenarios."""
    found = {scenario.name: k for k, scenario in enumerate(run.case.scenarios)}
    return [found[name] for name in names()]


@pytest.mark.thorough
def test_the_family_is_what_the_oracle_thinks(run: Result, number: list[int]) -> None:
    assert sorted(number) == list(range(300))
    weights = np.array([run.case.scenarios[k].weight for k in number])
    np.testing.assert_allclose(weights, families.PRIOR, rtol=1e-12)


def drawn() -> np.ndarray:
    """Return how many particles scenarios have: as their weights, to the nearest."""
    return np.maximum(families.PRIOR * PARTICLES - 1, 1)


@pytest.mark.thorough
@pytest.mark.parametrize("count", [1, 2, 3])
def test_each_scenario_after_each_update(run: Result, number: list[int], count: int) -> None:
    """Of 300 differences from the exact sums not one is beyond 4.4 standard errors, and their mean
    square is 1.

    By chance one of 300 is beyond 4.4 in 0.3 % of the runs; the mean square of 300 normal numbers
    has a standard deviation of 0.08. Particles are not all drawn alone, which makes differences
    smaller.
    """
    means, variances = families.exact(count)
    exact = families.posterior(means)
    found = np.asarray(run.updates.all[count - 1].posterior)[number]
    error = np.array(
        [families.error(means, variances, drawn(), np.eye(300)[k]) for k in range(300)]
    )
    z = (found - exact) / error
    assert np.abs(z).max() < 4.4
    assert np.mean(z**2) < 1 + 3 * 0.08


@pytest.mark.parametrize("axis", ["speed", "departure", "route"])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_marginals_by_axis(run: Result, axis: str, count: int) -> None:
    means, variances = families.exact(count)
    exact, place = families.posterior(means), ("route", "speed", "departure").index(axis)
    rows = csv.DictReader(io.StringIO(tables.csv(run.posteriors, "x")))
    found = [
        float(row["share"])
        for row in rows
        if row["quantity"] == f"axis {axis}" and row["update"] == str(count)
    ]
    assert len(found) == {"route": 10, "speed": 6, "departure": 5}[axis]
    for k, share in enumerate(found):
        value = np.array([float(story[place] == k) for story in families.STORIES])
        assert (
            abs(share - exact @ value) < 3 * families.error(means, variances, drawn(), value) + 1e-6
        )


def test_ranks_and_how_many_count(run: Result) -> None:
    """Entropy and ranks of the exact posterior: cumulative probabilities by rank, and exp of the
    entropy within 2 %.
    """
    ranked = ranking.ranking_of(run.posteriors)
    assert ranked is not None
    exact = families.posterior(families.exact(3)[0])
    told = ranking.summary_of_ranking(ranked)["effective"]
    entropy = -np.sum(exact[exact > 0] * np.log(exact[exact > 0]))
    assert told["posterior"] == pytest.approx(np.exp(entropy), rel=0.02)
    assert told["prior"] == pytest.approx(
        np.exp(-np.sum(families.PRIOR * np.log(families.PRIOR))), rel=1e-6
    )
    rows = list(csv.DictReader(io.StringIO(ranking.csv(ranked, "x"))))
    assert [int(row["rank"]) for row in rows] == list(range(1, 301))
    posterior = [float(row["posterior"]) for row in rows]
    assert posterior == sorted(posterior, reverse=True)
    np.testing.assert_allclose(
        [float(row["cumulative"]) for row in rows], np.cumsum(posterior), atol=1e-6
    )
    likeliest = names()[int(np.argmax(exact))]
    assert likeliest in [row["scenario"] for row in rows[:3]]


@pytest.mark.thorough
def test_with_particles_drawn_anew_across_scenarios(tmp_path: Path) -> None:
    """Resampled after the look and the barrier: scenarios and axes within three standard errors
    that the particles left say themselves.

    The variance of a share p by n effective particles is p (1 - p) / n at most; n: the least of all
    updates, over the number of resamplings and one, for each of them adds no more than a draw of
    that many would.
    """
    path = tmp_path / "case.toml"
    path.write_text(families.case(PARTICLES, below=0.9))
    run = drift.run(drift.load(path))
    again = sum(update.resampled for update in run.updates.all)
    assert again > 0
    n = min(update.ess_after for update in run.updates.all) / (again + 1)
    found = {s.name: k for k, s in enumerate(run.case.scenarios)}
    exact = families.posterior(families.exact(3)[0])
    posterior = np.asarray(run.updates.all[-1].posterior)[[found[name] for name in names()]]
    z = (posterior - exact) / np.sqrt(exact * (1 - exact) / n)
    assert np.abs(z).max() < 4.4
    for place in range(3):
        for k in range((10, 6, 5)[place]):
            value = np.array([float(story[place] == k) for story in families.STORIES])
            p = exact @ value
            assert abs(posterior @ value - p) < 3 * np.sqrt(p * (1 - p) / n)
