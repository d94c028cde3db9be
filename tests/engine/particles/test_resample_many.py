"""Resampling with 300 scenarios: what all particles and each scenario weigh, their mean and
covariance stay, over 80 repetitions.

Each figure is a sum over particles of weight times a value, so that its mean over repetitions is
that before. Tolerances are three standard errors of that mean, from the scatter of the repetitions
themselves; of the 300 scenarios together 4.4, which one of 300 passes by chance in 0.3 % of all
cases.
"""

import numpy as np
import pytest

from drift.engine.particles import ensemble as record
from drift.engine.particles import resample
from geo.array import Array

MANY, ROUNDS = 300, 80


class Cloud:
    """Particles of 300 scenarios, of which three hold 70 %; east and north differ in mean and
    spread, and go together.
    """

    def __init__(self) -> None:
        random = np.random.default_rng(15)
        sizes = random.integers(25, 55, MANY)
        self.bounds = np.concatenate([[0], np.cumsum(sizes)])
        self.n, self.scenario = int(self.bounds[-1]), np.repeat(np.arange(MANY), sizes)
        middle = random.normal(0, [40.0, 15.0], (MANY, 2))
        east = random.normal(0, 9.0, self.n)
        north = 0.5 * east + random.normal(0, 4.0, self.n)
        self.at = middle[self.scenario] + np.column_stack([east, north])
        share = np.full(MANY, 0.3 / (MANY - 3))
        share[[11, 160, 299]] = 0.4, 0.2, 0.1
        weight = random.gamma(0.8, size=self.n)
        weight *= (share / np.bincount(self.scenario, weight))[self.scenario]
        self.log_weight = np.log(weight).astype(np.float32)
        self.weight = np.exp(self.log_weight.astype(float))
        self.ranges = list(zip(self.bounds[:-1].tolist(), self.bounds[1:].tolist(), strict=True))

    def sums(self, scenario: Array, weight: Array, at: Array) -> tuple[Array, Array]:
        """Return mean (2,) and second moments about the mean before (3,) of all together, then the
        weight of each scenario.
        """
        off = at - (self.weight @ self.at) / self.weight.sum()
        values = np.column_stack([off, off[:, 0] ** 2, off[:, 1] ** 2, off[:, 0] * off[:, 1]])
        return weight @ values, np.bincount(scenario, weight, MANY)


def drawn(cloud: Cloud, how: str, event: int) -> tuple[Array, Array, Array]:
    """Return the scenario, the weight and the place of each particle that was drawn again."""
    if how == "across":
        ancestors, new, bounds = resample.resample_across_scenarios(
            cloud.log_weight, cloud.ranges, cloud.n, (15, event)
        )
        owner = record.owners(bounds)
    else:
        target = [last - first for first, last in cloud.ranges]
        room = cloud.log_weight
        ancestors, new, _ = resample.offspring(room, cloud.ranges, target, how, (15, event))
        owner = cloud.scenario
    assert np.array_equal(cloud.scenario[ancestors], owner)
    return owner, np.exp(new.astype(float)), cloud.at[ancestors]


@pytest.mark.thorough
@pytest.mark.parametrize("how", ["systematic", "across"])
def test_mean_covariance_and_masses_stay(how: str) -> None:
    cloud = Cloud()
    before, masses = cloud.sums(cloud.scenario, cloud.weight, cloud.at)
    figures, kept = zip(
        *(cloud.sums(*drawn(cloud, how, event)) for event in range(ROUNDS)), strict=True
    )
    figures, kept = np.array(figures), np.array(kept)
    error = figures.std(axis=0, ddof=1) / np.sqrt(ROUNDS)
    assert np.all(np.abs(figures.mean(axis=0) - before) < 3 * error + 1e-6 * np.abs(before))
    # float32 logarithms
    np.testing.assert_allclose(kept, np.broadcast_to(masses, kept.shape), rtol=2e-6)


@pytest.mark.thorough
def test_kahns_way_keeps_them_in_the_mean() -> None:
    """Its numbers float, and masses with them."""
    cloud = Cloud()
    # Slots to spare, without anybody in them, behind the particles of each scenario.
    slots = [resample.capacity(last - first) for first, last in cloud.ranges]
    first = np.concatenate([[0], np.cumsum(slots)])
    log_weight = np.full(first[-1], -np.inf, np.float32)
    at, scenario = np.zeros((first[-1], 2)), np.repeat(np.arange(MANY), slots)
    for k, (a, b) in enumerate(cloud.ranges):
        log_weight[first[k] : first[k] + b - a], at[first[k] : first[k] + b - a] = (
            cloud.log_weight[a:b],
            cloud.at[a:b],
        )
    ranges = list(zip(first[:-1].tolist(), first[1:].tolist(), strict=True))
    before, masses = cloud.sums(cloud.scenario, cloud.weight, cloud.at)
    figures, kept = [], []
    for event in range(ROUNDS):
        ancestors, new, _ = resample.offspring(
            log_weight, ranges, [b - a for a, b in cloud.ranges], "kahn", (16, event)
        )
        one = cloud.sums(scenario, np.exp(new.astype(float)), at[ancestors])
        figures.append(one[0])
        kept.append(one[1])
    for found, expected, errors in ((figures, before, 3.0), (kept, masses, 4.4)):
        scatter = np.std(found, axis=0, ddof=1) / np.sqrt(ROUNDS)
        assert np.all(
            np.abs(np.mean(found, axis=0) - expected) < errors * scatter + 1e-6 * np.abs(expected)
        )
