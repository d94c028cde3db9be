"""Particles guided toward finds of debris: posteriors by joint normals, whatever of what is shared
dominates.
"""

import contextlib
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import drift
from drift.engine.motion import simulate
from drift.evidence.filter.debris import pilot
from drift.evidence.filter.debris.proposal import Part, Proposal
from drift.pipeline import run_setup
from geo import sphere
from kernels.runtime import runtime

HOURS = 12
HEAD = """
start = "2026-11-21T00:00Z"
duration = "12 h"
particles = {particles}
seed = 5
output.every = "12 h"
clock.step = "15 min"
[coast]
source = "none"
"""
STILL = """
[[current]]
constant = {{ speed = "0 kn", toward = 0 }}
[[wind]]
constant = {{ speed = "8 m/s", from = 270 }}
[uncertainty]
diffusivity = "10 m2/s"
current = {{ std = "{current} m/s", time = "6 h", bias = "{bias} m/s" }}
wind = {{ std = "{wind} m/s", time = "9 h" }}
"""
PLACES = ((-0.03, 0.02), (0.05, -0.04))  # [deg] of the two scenarios
WEIGHTS = (0.7, 0.3)
SLOPES = (0.03, 0.04)  # of the object, and of its debris
D, ERROR = 10.0, 200.0
TINY = 0.0001  # [m/s] in place of no error, so that all move by one kernel: 4 m in the 12 hours


def text_of(particles, current, bias, wind, release):
    """Return a case of two scenarios that differ in their place; release [m]."""
    text = HEAD.format(particles=particles) + STILL.format(current=current, bias=bias, wind=wind)
    for name, place, weight in zip("ab", PLACES, WEIGHTS, strict=True):
        text += f'[[scenario]]\nname = "{name}"\nweight = {weight}\nobject = {{ windage = "{100 * SLOPES[0]:g} %" }}\n'
        text += f'position = {{ at = {list(place)}, std = ["{release} m", "{0.4 * release} m"], orientation = 30 }}\n'
    return text


def rows_between_steps(text):
    """Return a case with rows of its (still) current every 37 min 11 s: they cut steps of 15 min in
    two.
    """
    moments = (
        np.datetime64("2026-11-21T00:00:00") + np.timedelta64(2231, "s") * k for k in range(21)
    )
    rows = ", ".join(f'{{ time = "{moment}Z", speed = "0 kn", toward = 0 }}' for moment in moments)
    return text.replace('constant = { speed = "0 kn", toward = 0 }', f"table = [{rows}]")


def find_text(name, east, north, hours=HOURS, more=""):
    """Return a find of debris, so many metres from 0 N 0 E."""
    lon, lat = (float(np.degrees(x)) for x in sphere.destination(0.0, 0.0, east, north))
    text = f'[[contact]]\nname = "{name}"\ntime = "+{hours} h"\nof = {{ windage = "{100 * SLOPES[1]:g} %" }}\n'
    return text + f'position = {{ at = [{lon}, {lat}], std = "{ERROR} m" }}\n{more}'


def loaded(tmp_path: Path, text: str) -> drift.Case:
    (tmp_path / "case.toml").write_text(text)
    return drift.load(tmp_path / "case.toml")


def begun(tmp_path, text):
    """Return a case and the start of its run, with its forcing."""
    case = loaded(tmp_path, text)
    runtime.start()
    return case, run_setup.prepare(case, run_setup.open_for(case))


def run_of(tmp_path, text):
    """Return where particles are at the end [m] (2, n), their weights, what each find did, and the
    guide.
    """
    case, begin = begun(tmp_path, text)
    search = run_setup.build_search_filter(case, begin)
    with contextlib.closing(begin.scene.forcing):
        list(simulate.run(begin.ensemble, begin.scene, begin.clock, np.array([0]), search=search))
    lon, lat = (begin.ensemble.columns[name].to_numpy() * sphere.UNIT for name in ("lon", "lat"))
    weight = np.exp(begin.ensemble.log_weight.to_numpy().astype(float))
    return (
        np.stack(sphere.offset(0.0, 0.0, lon, lat)),
        weight / weight.sum(),
        search.updates,
        begin.guide,
    )


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
def test_guided_only_where_it_helps_and_is_asked_for(tmp_path):
    """A wide find, one with guide = false, and a case without debris leave particles as their
    streams draw them.
    """
    errors = (0.3, 0.0, 0.0, 300.0)
    bare = text_of(2000, *errors)

    def drawn(text):
        _, begin = begun(tmp_path, text)
        begin.scene.forcing.close()
        return begin

    plain = drawn(bare)
    wide = drawn(bare + find_text("oar", 9000.0, 5000.0).replace(f"{ERROR} m", "9 km"))
    asked = drawn(bare + find_text("oar", 9000.0, 5000.0, more="guide = false\n"))
    guided = drawn(bare + find_text("oar", 9000.0, 5000.0))
    assert (plain.guide, wide.guide, asked.guide) == (None, None, None)
    assert guided.guide is not None
    for one in (wide, asked):
        assert one.ensemble.columns.keys() == plain.ensemble.columns.keys()
        for name, column in plain.ensemble.columns.items():
            np.testing.assert_array_equal(one.ensemble.columns[name].to_numpy(), column.to_numpy())
    weight = np.exp(guided.ensemble.log_weight.to_numpy().astype(float))
    assert weight[:1400].sum() == pytest.approx(0.7, rel=1e-5)  # a scenario keeps its share
    assert weight.max() < 1.05 / 0.3 / 2000
    assert 1 / (weight**2).sum() > 0.25 * 2000


@pytest.mark.thorough
def test_a_scenario_that_is_under_way_is_not_guided(tmp_path):
    """Debris of what steers begins where it goes adrift: there particles stay as they are, beside
    guided ones.
    """
    text = text_of(2000, 0.3, 0.0, 0.0, 300.0).replace("weight = 0.3", "weight = 0.2") + """
[[scenario]]
name = "ferry"
weight = 0.1
object = { windage = "3 %" }
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = [[0.0, 0.0], [0.3, 0.1]]
departure = ["+0 h", "+1 h"]
speed = { low = "4 kn", best = "5 kn", high = "6 kn", ratio = 4 }
[scenario.distress]
between = ["+1 h", "+3 h"]
"""  # fmt: skip
    text += find_text("oar", 9000.0, 5000.0, more="belief = 0.9\n")
    _, begin = begun(tmp_path, text)
    begin.scene.forcing.close()
    assert begin.guide is not None
    assert [fit is not None for fit in begin.guide.passes[0]] == [True, True, False]
    first, last = begin.ensemble.scenarios[2]
    np.testing.assert_array_equal(
        begin.ensemble.log_weight.to_numpy()[first:last], np.float32(np.log(0.1 / 200))
    )
    assert not begin.ensemble.own["pull_0_east"].to_numpy()[first:last].any()
    *_, updates, guide = run_of(tmp_path, text)
    assert guide is not None
    assert updates.all[0].ess_after > 100


@pytest.mark.thorough
def test_shards_and_resampling(tmp_path):
    """Shards guide particles to the same bits; resampling waits for the find, and comes then."""
    text = text_of(12_000, 0.3, 0.0, 0.0, 300.0).replace("12 h", "14 h") + find_text(
        "oar", 9000.0, 5000.0, 11
    )
    text += (
        '[[sortie]]\nname = "early"\nstart = "+1 h"\nend = "+2 h"\nlaw = "random"\npod = 0.999\n'
    )
    text += "area = { polygon = [[-0.05, -0.05], [0.04, -0.05], [0.04, 0.05], [-0.05, 0.05]] }\n"
    text += "[resampling]\nbelow = 0.9\n"
    case = loaded(tmp_path, text)
    whole, parts = (drift.run(case, shards=many) for many in (1, 3))
    early, oar = whole.updates.all
    assert not early.resampled
    assert oar.resampled
    for one, other in zip(whole.updates.all, parts.updates.all, strict=True):
        assert one.ess_after == other.ess_after
        np.testing.assert_array_equal(one.log_evidence, other.log_evidence)
    np.testing.assert_array_equal(whole.probability.values, parts.probability.values)


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


def test_only_positions_of_debris_have_guide(tmp_path):
    """The key is rejected where it does nothing, and a warning of few particles names the find's
    error and the key.
    """
    bare = text_of(1000, 0.3, 0.0, 0.0, 300.0)
    own = find_text("oar", 9000.0, 5000.0, more="guide = false\n")
    with pytest.raises(drift.UserError, match="guide applies only to a position of debris"):
        loaded(tmp_path, bare + own.replace('of = { windage = "4 %" }\n', ""))
    case = loaded(tmp_path, bare + own)
    warning = drift.run(case).summary["warnings"][0]
    assert (
        "Check its position, time, error (0.13 nmi, which holds half of it) and class (of) first"
        in warning
    )
    assert "remove its guide = false" in warning
    contact = replace(case.contacts[0], guide=True)
    followed = drift.run(replace(case, contacts=(contact,)))  # the remedy works
    assert followed.summary["guide"] == {"finds": ["oar"], "prior_share": 0.3}
    assert followed.updates.all[0].ess_after > 200
    assert pilot.WORTHWHILE < 0.3
