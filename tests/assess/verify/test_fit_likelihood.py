"""The likelihood of errors against a dense normal law, and the sums and integrals in it."""

import math

import numpy as np
import pytest
from scipy import stats
from simulated_drifters import TRUE, simulated, ways

from drift.assess.verify import along, error_law, hold_out
from drift.assess.verify.error_law import Law
from drift.engine.environment import along_track
from drift.tracking.tracks import clusters
from drift.tracking.tracks.records import Track


def dense(tracks, law, mean):
    """Log likelihood of the increments by their dense covariance: double integrals in closed form,
    drifter by drifter.
    """
    total, information = 0.0, 0.0
    for d in range(len(tracks.step)):
        n = int(tracks.there[d].sum())
        t = np.cumsum(tracks.step[d, :n])
        stretch = np.cumsum(tracks.fresh[d, :n])
        a, b = np.meshgrid(t, t, indexing="ij")
        low, high = np.minimum(a, b), np.maximum(a, b)
        memory = law.time
        integral = law.std**2 * memory * (
            2 * low + memory * (np.exp(-low / memory) + np.exp(-high / memory) - 1 - np.exp(-(high - low) / memory))
        )  # fmt: skip
        position = (
            integral + law.bias**2 * a * b + 2 * law.diffusivity * low + law.noise**2 * np.eye(n)
        )
        steps = np.array(
            [
                row
                for row, k in zip(np.diff(np.eye(n), axis=0), np.diff(stretch), strict=True)
                if k == 0
            ]
        )
        covariance = steps @ position @ steps.T
        for c in range(2):
            # sums start again with each stretch, and no step crosses from one to the next
            left = steps @ (tracks.data[d, :n, c] - tracks.regressors[d, :n, c] @ mean)
            total += stats.multivariate_normal(np.zeros(len(left)), covariance).logpdf(left)
            design = steps @ tracks.regressors[d, :n, c]
            information = information + design.T @ np.linalg.solve(covariance, design)
    return total, np.atleast_2d(information)


def test_likelihood_is_that_of_a_dense_normal_law():
    tracks = simulated(np.random.default_rng(4), 3, 0.7)
    long = tracks[1]  # a night of silence splits one track; its velocity and bias go on
    awake = (long.time < long.time[5]) | (long.time > long.time[5] + 5 * 3600)
    tracks[1] = Track(
        long.name,
        long.time[awake],
        long.lon[awake],
        long.lat[awake],
        {k: v[awake] for k, v in long.columns.items()},
    )
    found = along.residuals(ways(tracks), wind=True)
    assert found.fresh[1].sum() == 2
    for law in (TRUE, Law(0.05, 400.0, 0.3, 0.0, 3.0), Law(0.4, 9e6, 0.0, 40.0, 700.0)):
        made = error_law.likelihood(law, found)
        total, information = dense(found, law, made.mean)
        assert made.own.sum() == pytest.approx(total, rel=1e-9)
        assert made.covariance == pytest.approx(np.linalg.inv(information), rel=1e-6)
        size = len(made.mean)
        restricted = total + size / 2 * math.log(2 * np.pi) - np.linalg.slogdet(information)[1] / 2
        assert made.log == pytest.approx(restricted, rel=1e-9)
        for shift in np.eye(size) * 1e-3:  # the unknowns of the mean are at their best
            assert dense(found, law, made.mean + shift)[0] < total


@pytest.mark.parametrize("hours", [0.001, 0.05, 1.0, 40.0])
def test_spread_and_correlation_are_integrals_of_the_covariance(hours):
    span, lag = hours * 3600, hours * 3600 * 2.3
    nodes, weight = np.polynomial.legendre.leggauss(60)
    t, w = (nodes + 1) * span / 2, weight * span / 2
    # the kernel has an edge on the diagonal: what lies below it counts twice, by a second rule on
    # [0, t]
    inner = np.array(
        [(weight * x / 2 * np.exp(-(x - (nodes + 1) * x / 2) / TRUE.time)).sum() for x in t]
    )
    variance = 2 * TRUE.std**2 * (w * inner).sum()
    expected = variance + TRUE.bias**2 * span**2 + 2 * TRUE.diffusivity * span + 2 * TRUE.noise**2
    assert error_law.error_variance(TRUE, span) == pytest.approx(expected, rel=1e-9)
    far = np.exp(-(lag + t[:, None] - t[None]) / TRUE.time)
    cross = TRUE.bias**2 + TRUE.std**2 * (w[:, None] * w[None] * far).sum() / span**2
    assert error_law.correlation(TRUE, lag, span) == pytest.approx(cross, rel=1e-9)


def test_clustered_errors_are_the_sum_over_pairs_that_share_a_cluster():
    rng = np.random.default_rng(6)
    who, when = rng.integers(0, 7, 60), rng.integers(0, 11, 60)
    x = rng.normal(0, 1, 60) + rng.normal(0, 1, 7)[who] + rng.normal(0, 1.5, 11)[when]
    e = x - x.mean()
    both = {(a, b) for a, b in zip(who.tolist(), when.tolist(), strict=True)}

    def pairs(same, groups):
        return (
            sum(e[i] * e[j] for i in range(60) for j in range(60) if same(i, j))
            * groups
            / (groups - 1)
            / 60**2
        )

    drifter = pairs(lambda i, j: who[i] == who[j], 7)
    day = pairs(lambda i, j: when[i] == when[j], 11)
    crossed = pairs(lambda i, j: who[i] == who[j] and when[i] == when[j], len(both))
    found = clusters.mean(x, who, when)
    assert found.error**2 == pytest.approx(max(drifter, day, drifter + day - crossed), rel=1e-9)
    assert (found.drifters, found.days, found.count) == (7, 11, 60)
    alone = clusters.mean(x, np.zeros(60), when)
    assert alone.error**2 == pytest.approx(day, rel=1e-9)
    sure = clusters.mean(np.ones(20), who[:20], when[:20], share=True)
    assert sure.error == pytest.approx(math.sqrt(21 / 22 * (1 / 22) / 20), rel=1e-9)


def test_halves_share_no_way():
    tracks = ways(simulated(np.random.default_rng(12), 1, 10.0))
    halves = hold_out.split_halves(tracks)
    spans = [{(float(t), float(s)) for t, s, f in zip(w.time, w.step, w.fresh, strict=True) if not f} for w in (*halves.fitted, *halves.held)]  # fmt: skip
    assert not spans[0] & spans[1]
    assert all(spans)
    # none leads over days that were held out
    assert all(max(step for _, step in span) <= 3 * 3600 for span in spans)


def test_quadrature_is_exact_for_cubics_but_for_whole_seconds():
    time = np.array([0.0, 5000.0, 12_000.0])
    at, weight, owner = along_track.quadrature_points(time)
    for k in (1, 2):
        found = (weight[owner == k] * at[owner == k] ** 3).sum()
        exact = (time[k] ** 4 - time[k - 1] ** 4) / 4
        # half a second of each point
        assert abs(found - exact) < 0.5 * 3 * time[k] ** 2 * (time[k] - time[k - 1])
