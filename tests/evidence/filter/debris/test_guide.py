"""Particles guided toward finds of debris: posteriors by joint normals, also with land and with
finds that may be false.
"""

import math

import numpy as np
import pytest
from guided_case import ERROR, HOURS, PLACES, SLOPES, WEIGHTS, D, find_text, run_of, text_of
from scipy import stats

from drift.evidence.filter.debris.proposal import Part, Proposal
from geo import sphere

TINY = 0.0001  # [m/s] in place of no error, so that all move by one kernel: 4 m in the 12 hours


def rows_between_steps(text):
    """Return a case with rows of its (still) current every 37 min 11 s: they cut steps of 15 min in
    two.
    """
    moments = (
        np.datetime64("2026-11-21T00:00:00") + np.timedelta64(2231, "s") * k for k in range(21)
    )
    rows = ", ".join(f'{{ time = "{moment}Z", speed = "0 kn", toward = 0 }}' for moment in moments)
    return text.replace('constant = { speed = "0 kn", toward = 0 }', f"table = [{rows}]")


def of_forcing(std, time, early, late):
    """Return the covariance of the integrals of an Ornstein-Uhlenbeck process over two times from
    its begin.
    """
    if std == 0:
        return 0.0
    a, b, both = (math.exp(-t / time) for t in (early, late, late - early))
    return std**2 * time**2 * (2 * early / time - 1 + a + b - both)


def joint(times, current, bias, wind, release):
    """Return the covariance of the object at the end and of debris at some times [s], both
    components together.
    """
    turn = math.radians(30)
    axes = np.array([[math.sin(turn), math.cos(turn)], [math.cos(turn), -math.sin(turn)]])
    place = axes @ np.diag([release**2, (0.4 * release) ** 2]) @ axes.T
    moments, slopes = (HOURS * 3600.0, *times), (SLOPES[0], *(SLOPES[1] for _ in times))
    size = len(moments)
    alike = np.zeros((size, size))
    for i in range(size):
        for j in range(size):
            early, late = sorted((moments[i], moments[j]))
            alike[i, j] = of_forcing(current, 6 * 3600.0, early, late) + bias**2 * early * late
            alike[i, j] += slopes[i] * slopes[j] * of_forcing(wind, 9 * 3600.0, early, late)
            if i == j or (
                i > 0 and j > 0
            ):  # walks: the object's own, and the debris' own, which finds of one class share
                alike[i, j] += 2 * D * early
    return np.kron(alike, np.eye(2)) + np.kron(np.ones((size, size)), place)


def mean_of(place, times):
    """Return the means that go with `joint` [m]: winds of 8 m/s from the west."""
    at = np.array(sphere.offset(0.0, 0.0, *np.radians(place)))
    moments, slopes = (HOURS * 3600.0, *times), (SLOPES[0], *(SLOPES[1] for _ in times))
    return np.concatenate(
        [at + np.array([slope * 8.0 * t, 0.0]) for slope, t in zip(slopes, moments, strict=True)]
    )


def given(place, times, found, *errors):
    """Return mean (2,), covariance (2, 2) of the object given finds (k, 2) [m], and the density of
    these.
    """
    mean, cov = mean_of(place, times), joint(times, *errors)
    seen = cov[2:, 2:] + ERROR**2 * np.eye(2 * len(times))
    gain = cov[:2, 2:] @ np.linalg.inv(seen)
    density = stats.multivariate_normal.pdf(np.ravel(found), mean[2:], seen)
    return mean[:2] + gain @ (np.ravel(found) - mean[2:]), cov[:2, :2] - gain @ cov[2:, :2], density


def held_to(at, weight, bounds, exact, evidence, shares):
    """Compare weighted places with the mean and covariance of each scenario, in standard errors."""
    for number, (mean, cov) in enumerate(exact):
        own = slice(bounds[number], bounds[number + 1])
        share = weight[own] / weight[own].sum()
        effective = 1 / (share**2).sum()
        found = at[:, own] @ share
        off = at[:, own] - found[:, None]
        spread = (share * off) @ off.T
        assert np.all(np.abs(found - mean) < 4 * np.sqrt(np.diag(cov) / effective))
        width = np.sqrt((np.outer(np.diag(cov), np.diag(cov)) + cov**2) / effective)
        assert np.all(np.abs(spread - cov) < 4 * width + 5e-3 * np.abs(cov).max())
    effective = 1 / (weight**2).sum()
    assert weight[: bounds[1]].sum() == pytest.approx(
        shares[0], abs=4 * math.sqrt(1 / (4 * effective))
    )
    assert evidence[0] == pytest.approx(evidence[1], abs=4 / math.sqrt(effective))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("errors", "clocked"),  # str: the case as it is
    [
        ((0.3, TINY, TINY, 300.0), str),
        ((TINY, TINY, TINY, 15_000.0), str),
        ((0.02, TINY, 9.0, 300.0), str),
        ((TINY, 0.4, TINY, 500.0), str),
        ((0.3, TINY, TINY, 300.0), rows_between_steps),
    ],
    ids=["current", "release", "wind", "bias", "cut steps"],
)
def test_posterior_by_joint_normals(tmp_path, errors, clocked):
    """Whatever spreads the debris, guided particles hold the posterior, and enough of them are
    effective.
    """
    found = (9000.0, 5000.0)
    at, weight, updates, guide = run_of(
        tmp_path, clocked(text_of(8000, *errors)) + find_text("oar", *found)
    )
    told = [given(place, (HOURS * 3600.0,), found, *errors) for place in PLACES]
    densities = np.array([density for *_, density in told]) * WEIGHTS
    (update,) = updates.all
    assert len(guide.passes) == 1
    assert update.ess_after > 0.2 * 8000
    assert update.ess_after == pytest.approx(1 / (weight**2).sum(), rel=1e-3)
    evidence = updates.log_evidence, math.log(densities.sum())
    held_to(
        at,
        weight,
        (0, 5600, 8000),
        [own[:2] for own in told],
        evidence,
        densities / densities.sum(),
    )


@pytest.mark.thorough
def test_two_finds_of_which_one_may_be_false(tmp_path):
    """A doubtful find that fits no other is believed as its likelihood says: particles follow each
    find alone too.
    """
    errors, times = (0.3, 0.0, 0.0, 300.0), (8 * 3600.0, HOURS * 3600.0)
    finds = ((9000.0, 5000.0), (2500.0, -9000.0))
    text = (
        text_of(12_000, *errors)
        + find_text("oar", *finds[0], 8)
        + find_text("hat", *finds[1], 12, "belief = 0.6\n")
    )
    at, weight, updates, guide = run_of(tmp_path, text)
    one = [given(place, times[:1], finds[0], *errors) for place in PLACES]
    two = [given(place, times, finds, *errors) for place in PLACES]
    first = np.array([density for *_, density in one]) * WEIGHTS
    second = np.array([density for *_, density in two]) * WEIGHTS
    parts = 0.6 * second / second.sum(), 0.4 * first / first.sum()
    assert guide.subsets == [[0, 1], [0], [1]]
    assert [u.name for u in updates.all] == ["oar", "hat"]
    assert updates.all[-1].ess_after > 0.05 * 12_000
    share = parts[0] + parts[1]
    exact = []
    for k in range(2):
        mix = np.array([parts[0][k], parts[1][k]]) / share[k]
        mean = mix[0] * two[k][0] + mix[1] * one[k][0]
        cov = sum(
            m * (own[1] + np.outer(own[0] - mean, own[0] - mean))
            for m, own in zip(mix, (two[k], one[k]), strict=True)
        )
        exact.append((mean, cov))
    evidence = updates.log_evidence, math.log(second.sum())  # E[N] is the unit of doubt: 0.6 + 0.4
    held_to(at, weight, (0, 8400, 12_000), exact, evidence, share)


@pytest.mark.thorough
def test_land_in_the_prior_and_on_the_way(tmp_path):
    """Releases stay in water; the scenario keeps its probability; against four times as many
    particles, unguided.
    """
    shore = '{"type": "Polygon", "coordinates": [[[0.0, -1], [0.03, -1], [0.03, 0.1], [0.0, 0.1], [0.0, -1]]]}'
    (tmp_path / "land.geojson").write_text(shore)
    errors = (0.15, 0.0, 0.0, 4000.0)
    text = text_of(5000, *errors).replace('source = "none"', 'source = "land.geojson"')
    find = find_text("oar", 16_000.0, 14_000.0).replace(f"{ERROR} m", "900 m")
    *_, guided, guide = run_of(tmp_path, text + find)
    *_, plain, none = run_of(tmp_path, text.replace("5000", "20000") + find + "guide = false\n")
    assert (guide is None, none) == (False, None)
    (one,), (other,) = guided.all, plain.all
    assert one.ess_after > 2 * other.ess_after / 4
    error = math.sqrt(1 / one.ess_after + 1 / other.ess_after)
    assert one.log_evidence[-1] == pytest.approx(other.log_evidence[-1], abs=4 * error)
    assert one.posterior[0] == pytest.approx(other.posterior[0], abs=2 * error)
    np.testing.assert_allclose(guided.prior, WEIGHTS, atol=1e-6)


def test_proposal_weighs_by_its_density():
    """Prior over proposal by densities of scipy, also where a covariance is singular in one
    direction.
    """
    rng = np.random.default_rng(4)
    root = rng.standard_normal((4, 4))
    covariance = root @ root.T
    parts = [
        Part(np.arange(4), 0.3 * np.eye(4)),
        Part(np.array([0, 1]), np.array([[0.5, 0.1], [0.1, 0.2]])),
    ]
    own = Proposal(covariance, parts, 0.3)
    y = np.repeat([[1.0, -2.0, 0.5, 1.5]], 40_000, axis=0)
    s, log_weight = own.draw(
        y, (np.arange(40_000) + 0.5) / 40_000, rng.standard_normal((40_000, 8))
    )
    density = 0.3 * stats.multivariate_normal.pdf(s, np.zeros(4), covariance)
    for part in parts:
        gain = covariance[:, part.rows] @ np.linalg.inv(
            covariance[np.ix_(part.rows, part.rows)] + part.error
        )
        mean, cov = gain @ y[0, part.rows], covariance - gain @ covariance[part.rows]
        density += 0.35 * stats.multivariate_normal.pdf(s, mean, cov)
    expected = stats.multivariate_normal.pdf(s, np.zeros(4), covariance) / density
    np.testing.assert_allclose(np.exp(log_weight), expected, rtol=1e-6)
    assert np.exp(log_weight).mean() == pytest.approx(1.0, abs=4 * np.exp(log_weight).std() / 200)
    singular = Proposal(np.kron(np.ones((2, 2)), np.eye(2)), parts[:1], 0.3)
    s, log_weight = singular.draw(
        y, np.linspace(0, 0.999, 40_000), rng.standard_normal((40_000, 8))
    )
    np.testing.assert_allclose(s[:, :2], s[:, 2:], atol=1e-6)
    assert np.exp(log_weight).mean() == pytest.approx(1.0, abs=4 * np.exp(log_weight).std() / 200)
