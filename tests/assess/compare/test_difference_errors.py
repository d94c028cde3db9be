"""Standard errors of differences are the spread over seeds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from drift.assess.compare import figures, units
from drift.assess.compare.maps import paired_maps
from drift.assess.compare.units import GROUPS, SamplingUnits
from drift.engine.particles.snapshot import Snapshot
from drift.engine.particles.status import Status
from geo import cells, sphere
from geo.cells import Cells

# differences of maps are made on a grid of their own
pytestmark = pytest.mark.usefixtures("coarse_maps")
SEEDS = 200
STRATA = (700, 300)
GRID = Cells(-(2**20), -(2**20), 2**16, 2**16, 32, 32)  # 0.6 km, 20 km across


def cloud(seed: int) -> tuple[Snapshot, Snapshot, SamplingUnits]:
    """Two clouds of pairs: of one law within each of two strata, weighted at random, b wider and
    farther east than a.
    """
    rng = np.random.default_rng(seed)
    n, stratum = sum(STRATA), np.repeat([0, 1], STRATA)
    x, y = rng.normal(0, 2500, n) + 1500 * stratum, rng.normal(0, 1500, n)
    more = rng.normal(0, 300, (2, n))
    base = np.repeat([0.6 / STRATA[0], 0.4 / STRATA[1]], STRATA)
    snapshots = []
    for east, north, miss in ((x, y, 0.5), (1.1 * x + 500 + more[0], y + more[1], 0.7)):
        weight = base * np.where(north > 0, miss, 1.0)
        lon, lat = sphere.destination(0.0, 0.0, east, north)
        status = np.where(east > 3000, Status.ASHORE, Status.ADRIFT).astype(np.int32)
        binary = (sphere.to_binary(np.degrees(angle)) for angle in (lon, lat))
        time = np.datetime64("2026-11-21T00:00:00")
        snapshots.append(
            Snapshot(time, *binary, weight / weight.sum(), status, stratum.astype(np.int32))
        )
    return snapshots[0], snapshots[1], SamplingUnits(stratum, np.ones(n, bool), worlds=False)


def bounds(n: int) -> tuple[float, float]:
    """Return what a standard deviation of n normal values is of its own, 99.8 % of the time:
    chi-square.
    """
    return tuple(np.sqrt(stats.chi2.ppf([0.001, 0.999], n - 1) / (n - 1)))


def test_standard_errors_are_the_spread_over_seeds() -> None:
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for seed in range(SEEDS):
        a, b, drawn = cloud(seed)
        told = [
            figures.status_shares(snapshot, ("one", "two"), drawn)
            | figures.mean_position(snapshot, drawn, (0.0, 0.0))
            for snapshot in (a, b)
        ]
        for row in units.differences(a.time, told[0], told[1], drawn, figures.SHIFT):
            found.setdefault((row.quantity, row.name), []).append((row.difference, row.error))
    low, high = bounds(SEEDS)
    checked = 0
    for key, pairs in found.items():
        differences, errors = np.array(pairs).T
        spread = differences.std(ddof=1)
        if spread > 1e-12:
            checked += 1
            assert low < spread / np.sqrt(np.mean(errors**2)) < high, key
    assert checked == 6  # two statuses, two scenarios, east and north


@pytest.mark.thorough
def test_standard_errors_of_maps_are_the_spread_over_seeds() -> None:
    """Pooled over the cells that have anything; of independent cells, of which there are tens, the
    ratio is nearer to 1.
    """
    seeds = 60
    pairs = []
    for seed in range(seeds):
        a, b, drawn = cloud(seed)
        made = paired_maps(a, b, drawn, GRID, None, 40.0)
        pairs.append((made.difference, made.error))
        on = cells.index_of_cells(a.lon, a.lat, GRID) >= 0  # a few lie off it
        assert made.a.sum() == pytest.approx(a.probability[on].sum())
    differences, errors = np.stack(pairs, axis=1)
    spread, error = differences.var(axis=0, ddof=1), np.mean(errors**2, axis=0)
    busy = spread > 0.05 * spread.max()
    low, high = bounds(seeds)
    assert low < np.sqrt(spread[busy].sum() / error[busy].sum()) < high


def weighted(groups: np.ndarray, seed: int) -> Snapshot:
    """Return a cloud of which every group has the same particles, one part ashore; the groups have
    these weights.
    """
    rng, each = np.random.default_rng(seed), 50
    lon, lat = sphere.destination(0.0, 0.0, rng.normal(900, 2500, each), rng.normal(0, 1500, each))
    binary = (np.repeat(sphere.to_binary(np.degrees(angle)), GROUPS) for angle in (lon, lat))
    status = np.repeat(np.where(np.arange(each) % 5, Status.ADRIFT, Status.ASHORE), GROUPS)
    weight = np.outer(rng.uniform(0.5, 1.5, each), groups).ravel()
    time = np.datetime64("2026-11-21T00:00:00")
    return Snapshot(
        time,
        *binary,
        weight / weight.sum(),
        status.astype(np.int32),
        np.zeros(weight.size, np.int32),
    )


def test_groups_that_weigh_more_move_no_map() -> None:
    """Where all groups have the same map, the map of all is that one, whatever the groups weigh:
    it has no error. If groups pulled by their weight alone, the error would be some 10 % of a cell.
    """
    rng = np.random.default_rng(8)
    a, b = (weighted(rng.uniform(0.5, 1.5, GROUPS), seed=2) for _ in range(2))
    drawn = SamplingUnits(np.zeros(a.lon.size, int), np.ones(a.lon.size, bool), worlds=False)
    made = paired_maps(a, b, drawn, GRID, None, 40.0)
    assert made.a.max() > 0.005
    np.testing.assert_allclose(made.b, made.a, rtol=0, atol=1e-12)
    np.testing.assert_allclose(made.error, 0.0, rtol=0, atol=1e-12)


def test_maps_of_two_runs_are_those_of_the_same_runs_exchanged() -> None:
    """Neither run alone decides how both are smoothed."""
    a, b, drawn = cloud(5)
    made, exchanged = (paired_maps(*pair, drawn, GRID, None, 40.0) for pair in ((a, b), (b, a)))
    assert np.abs(made.difference).max() > 1e-4
    for one, other in (
        (made.a, exchanged.b),
        (made.b, exchanged.a),
        (made.difference, -exchanged.difference),
        (made.error, exchanged.error),
    ):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)


def test_groups_have_as_many_of_every_stratum() -> None:
    drawn = cloud(0)[2]
    count = np.zeros((2, GROUPS), int)
    np.add.at(count, (drawn.stratum, drawn.group), 1)
    assert np.ptp(count, axis=1).max() <= 1


def test_means_of_strata_are_no_chance() -> None:
    """Influences that are level within each stratum have no error; what never had a weight does not
    count.
    """
    drawn = cloud(0)[2]
    level = np.where(drawn.stratum == 0, 3.0, -1.0)
    assert drawn.error(level) == pytest.approx(0.0, abs=1e-12)
    rng = np.random.default_rng(1)
    noise = rng.normal(size=drawn.size)
    expected = np.sqrt(sum(n * noise[drawn.stratum == k].var(ddof=1) for k, n in enumerate(STRATA)))
    assert drawn.error(level + noise) == pytest.approx(expected)
    spare = replace(drawn, begun=np.arange(drawn.size) % 2 == 0)
    half = np.sqrt(
        sum(
            n / 2 * noise[(drawn.stratum == k) & spare.begun].var(ddof=1)
            for k, n in enumerate(STRATA)
        )
    )
    assert spare.error(level + noise) == pytest.approx(half)
