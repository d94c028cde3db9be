"""Finds and patrols: closed forms, quadrature, and exact Bayes on small sums."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats
from spills import DAY, scattered, spill
from weighed_worlds import LOSS, RATE, SEARCHES, SEEN, known, numbers, weigh

from drift.engine.particles.status import Status
from drift.spills.worlds import exposure, finds
from drift.spills.worlds.exposure import Reporting, Walk
from drift.spills.worlds.fates import FOREVER, Adrift
from drift.spills.worlds.finds import AtSea, Detection, SpillEvidence
from geo import sphere


def test_the_number_of_carcasses_from_a_search_is_exact() -> None:
    fates = spill(1, [50], [(k, 0, 0, FOREVER) for k in range(50)])
    count = numbers(list(range(201)))
    search = Walk((0,), 10, 0.3)
    still = Reporting(np.zeros(3), 0.0, np.ones(1))
    seen = [Detection(f"{k}", 0, 0, 10, by=0) for k in range(7)]
    told = weigh(fates, known(count, seen, [search], 1, 10, reporting=still))
    exact = stats.binom.pmf(7, np.arange(201), 0.3)
    assert told.objects == pytest.approx(exact / exact.sum(), abs=1e-12)


def test_destroyed_and_undetected_multiply() -> None:
    """The share destroyed, by Bayes on its grid: finds thin the survivors."""
    fates = spill(1, [40], [(k, 0, 0, FOREVER) for k in range(40)])
    grid = [0.0, 0.25, 0.5, 0.75]
    still = Reporting(np.zeros(3), 0.0, np.ones(1))
    seen = [Detection(f"{k}", 0, 0, 10, by=0) for k in range(5)]
    told = weigh(
        fates,
        known(numbers([30], destroyed=grid), seen, [Walk((0,), 10, 0.4)], 1, 10, reporting=still),
    )
    exact = stats.binom.pmf(5, 30, 0.4 * (1 - np.array(grid)))
    assert told.destroyed == pytest.approx(exact / exact.sum(), abs=1e-12)


def test_two_stretches_in_closed_form() -> None:
    """Two worlds, no strength to borrow (a latent each, many particles): the ratio of likelihoods
    is known.
    """
    n, share = 4000, (0.25, 0.5)
    stays = [
        (w * n + k, 0 if k < share[w] * n else 1, 0, FOREVER) for w in range(2) for k in range(n)
    ]
    rates = Reporting(np.array([RATE, RATE / 4, RATE]), 0.0, np.ones(2))
    now, seen = (
        5 * DAY,
        [
            Detection("a", 0, 0, 2 * DAY),
            Detection("b", 0, 1, 4 * DAY),
            Detection("c", 0, 0, 5 * DAY),
        ],
    )
    told = weigh(spill(2, [n], stays), known(numbers([60]), seen, [], 2, now, reporting=rates))
    p = np.array(share)
    left = p * np.exp(-RATE * now) + (1 - p) * np.exp(-RATE / 4 * now)
    exact = 2 * np.log(p) + np.log(1 - p) + 57 * np.log(left)
    ratio = told.log_likelihood[1] - told.log_likelihood[0]
    # a world's own 1000 particles on a stretch weigh against one particle's worth of prior: some 3
    # finds x 1/1000
    assert ratio == pytest.approx(exact[1] - exact[0], abs=0.05)


@pytest.mark.parametrize("latest", [False, True])
def test_integrals_between_patrols_against_quadrature(latest: bool) -> None:
    arrival, leave, now = 3_000, 700_000, 900_000
    fates = spill(1, [1], [(0, 1, arrival, leave), (0, 2, leave + 50, FOREVER)])
    patrols = tuple(
        Walk(s, t, d)
        for s, t, d in [
            ((1,), 1_000, 0.9),
            ((0, 1), arrival, 0.2),
            ((1,), 400_000, 0.5),
            ((2, 1), 800_000, 0.7),
        ]
    )
    here = exposure.expose(fates, Reporting(np.full(3, RATE), LOSS, np.full(1, 2.0)), patrols)
    h, k = 2 * RATE, 2 * RATE + LOSS

    def alive(t: float) -> float:
        if t < leave:
            return np.exp(-k * (t - arrival)) * 0.8 ** (t > arrival) * 0.5 ** (t > 400_000)
        first = np.exp(-k * (leave - arrival)) * 0.8 * 0.5
        return first * np.exp(-k * (t - leave - 50)) * 0.3 ** (t > 800_000)

    def by(end: float, begin: float) -> float:
        breaks = [t for t in (400_000, 800_000) if begin < t < end]
        return integrate.quad(
            lambda t: h * alive(t), begin, end, points=breaks or None, epsabs=1e-13
        )[0]

    if latest:
        assert exposure.reported_probability(here, 1, 600_000)[1] == pytest.approx(
            by(600_000, arrival), rel=1e-9
        )
        assert exposure.reported_probability(here, 2, now)[1] == pytest.approx(
            by(now, leave + 50), rel=1e-9
        )
        caught = 0.2 + 0.5 * alive(400_000) + 0.7 * alive(800_000)
        assert exposure.found_probability(here, now) == pytest.approx(
            by(leave, arrival) + by(now, leave + 50) + caught, rel=1e-9
        )
    else:
        for t in (100_000.0, 500_000.0):
            assert exposure.report_density(here, 1, t)[1] == pytest.approx(h * alive(t), rel=1e-12)
        assert exposure.report_density(here, 1, leave)[1] == [0]
        assert exposure.report_density(here, 2, now)[1] == pytest.approx(h * alive(now), rel=1e-12)


def test_a_certain_patrol_leaves_nothing() -> None:
    fates = spill(1, [2], [(0, 1, 0, FOREVER), (1, 1, 20, FOREVER)])
    here = exposure.expose(
        fates, Reporting(np.full(3, RATE), 0.0, np.ones(1)), (Walk((1,), 10, 1.0),)
    )
    assert exposure.report_density(here, 1, 30)[1] == pytest.approx([0, RATE * np.exp(-RATE * 10)])
    assert exposure.found_probability(here, 10) == pytest.approx([1, 0])


def test_the_order_of_finds_does_not_matter() -> None:
    fates = scattered(30, [20, 30])
    latent = np.random.default_rng(1).standard_normal((30, 2))
    count = numbers([40, 45], [0.4, 0.6], [0.0, 0.3])
    one = weigh(fates, known(count, SEEN, SEARCHES, 30, 7 * DAY), latent)
    other = weigh(fates, known(count, SEEN[::-1], SEARCHES, 30, 7 * DAY), latent)
    assert other.log_likelihood == pytest.approx(one.log_likelihood, rel=1e-10)


def test_the_order_of_particles_in_a_world_does_not_matter() -> None:
    fates = scattered(30, [25])
    swap = np.concatenate([w * 25 + np.random.default_rng(w).permutation(25) for w in range(30)])
    stays = fates.stays
    moved = list(zip(swap[stays.slot], stays.segment, stays.arrival, stays.leave, strict=True))
    told = known(
        numbers([40]),
        [Detection("a", 0, 1, 2 * DAY), Detection("b", 0, 2, 4 * DAY)],
        SEARCHES,
        30,
        7 * DAY,
    )
    one, other = weigh(fates, told), weigh(spill(30, [25], moved), told)
    assert other.log_likelihood == pytest.approx(one.log_likelihood, rel=1e-10)
    assert finds.found(spill(30, [25], moved), told)[swap] == pytest.approx(
        finds.found(fates, told), abs=1e-14
    )


def test_a_patrol_that_finds_nothing_only_lowers_what_may_be_missed() -> None:
    fates = scattered(20, [60])
    seen = [Detection("a", 0, 1, 2 * DAY)]
    without = weigh(fates, known(numbers([50]), seen, [], 20, 7 * DAY))
    patrolled = weigh(fates, known(numbers([50]), seen, [Walk((0,), 6 * DAY, 0.7)], 20, 7 * DAY))
    chance = [finds.found(fates, t.known) for t in (without, patrolled)]
    assert (chance[1] >= chance[0] - 1e-12).all()
    assert chance[1].sum() > chance[0].sum() + 1
    evidence = [
        finds._evidence(
            fates,
            t.known,
            finds._sums_by_world(fates, t.known, []),
            np.zeros((20, 0)),
            np.zeros(20),
        )
        for t in (without, patrolled)
    ]
    assert evidence[0].density == pytest.approx(evidence[1].density)  # on another stretch


def test_an_unknown_class_is_the_sum_over_classes() -> None:
    fates, count = scattered(20, [30, 20]), numbers([30, 40], [0.5, 0.5], [0.0, 0.5])
    rest = [Detection("a", 0, 1, 2 * DAY), Detection("b", 1, 0, 4 * DAY)]

    def log(kind: int | None) -> Any:
        return weigh(
            fates, known(count, [*rest, Detection("c", kind, 2, 5 * DAY)], [], 20, 7 * DAY)
        ).log_likelihood

    assert log(None) == pytest.approx(np.logaddexp(log(0), log(1)), rel=1e-12)


def test_a_find_that_may_be_false_is_the_sum_of_both() -> None:
    fates, count = scattered(20, [30]), numbers([35], None, [0.0, 0.5])
    first, now = Detection("a", 0, 1, 2 * DAY), 7 * DAY

    def told(*seen: Detection) -> finds.Posterior:
        return weigh(fates, known(count, list(seen), [], 20, now))

    odd = Detection("b", 0, 2, 5 * DAY)
    alone, both = told(first).log_likelihood, told(first, odd).log_likelihood
    here = exposure.expose(fates, Reporting(np.full(3, RATE), LOSS, np.ones(20)), ())
    public = (
        np.array([exposure.reported_probability(here, s, now)[1].sum() for s in range(3)])
        * 35
        * 0.75
        / fates.world.size
    )
    unrelated = 0.3 / 0.7 * (public**2).sum() / public.sum() / now  # equal stretches, since time 0
    exact = np.logaddexp(both, alone + np.log(unrelated))
    doubtful = told(first, dataclasses.replace(odd, false=0.3))
    assert doubtful.log_likelihood == pytest.approx(exact, rel=1e-12)
    # Bayes by hand: of all worlds together, the share of what the find is worth as a false one.
    assert doubtful.unrelated == pytest.approx(
        [0, unrelated * np.exp(alone).sum() / np.exp(exact).sum()], rel=1e-10
    )
    surely = told(first, dataclasses.replace(odd, false=1.0))
    assert surely.log_likelihood == pytest.approx(alone, rel=1e-12)
    assert surely.unrelated.tolist() == [0, 1]


def usual_by_hand(
    lengths: list[float], rates: list[float], shares: list[float], find: Detection, now: float
) -> float:
    """B of a public find by quadrature, in float64: objects of one world lie on stretches by shares
    from time 0 on.

    What lies s dense is found with the density s: that is averaged over the finds themselves, along
    the coast.
    """
    found = np.array(
        [share * -np.expm1(-rate * now) for rate, share in zip(rates, shares, strict=True)]
    )
    edges = np.concatenate([[0.0], np.cumsum(lengths)])

    def dense(x: float) -> float:  # finds by metre and reporting rate, at a place along the coast
        s = int(np.searchsorted(edges, x, side="right") - 1)
        return float(found[s] / (lengths[s] * rates[s]))

    def drawn(x: float) -> float:  # finds by metre
        s = int(np.searchsorted(edges, x, side="right") - 1)
        return float(found[s] / lengths[s])

    mean = (
        integrate.quad(lambda x: dense(x) * drawn(x), 0, edges[-1], points=edges[1:-1], epsabs=0)[0]
        / found.sum()
    )
    return mean * lengths[find.place] * rates[find.place] / now


@pytest.mark.parametrize("empty", [0, 3, 40])
@pytest.mark.parametrize("latest", [False, True])
def test_coast_where_nothing_comes_does_not_decide_whether_a_find_is_ours(
    empty: int, latest: bool
) -> None:
    """A domain of twice or ten times the coast:

    B, the likelihood and what is none of ours stay, to rounding.
    """
    lengths, rates = [1e4, 3e4, 2e4], [RATE, RATE / 4, 2 * RATE]
    n, now, shares = 400, 6 * DAY, [0.5, 0.3, 0.0]
    stays = [(k, 0 if k < 200 else 1, 0, FOREVER) for k in range(320)]
    find = Detection("odd", 0, 2, 5 * DAY, latest=latest, false=0.1)
    coast = np.array([*lengths, *[2.5e4] * empty])
    reporting = Reporting(np.array([*rates, *[RATE] * empty]), 0.0, np.ones(1))
    seen = (Detection("a", 0, 0, 2 * DAY), find)
    told = SpillEvidence(numbers([30]), seen, (), reporting, coast, now)
    fates = spill(1, [n], stays)
    by_hand = 30 * usual_by_hand(lengths, rates, shares, find, now) * (find.time if latest else 1)
    assert finds.usual(fates, told, np.zeros(1)) == pytest.approx([0, by_hand], rel=1e-12)
    weighed = weigh(fates, told)
    small = weigh(
        fates,
        SpillEvidence(
            numbers([30]), seen, (), Reporting(np.array(rates), 0.0, np.ones(1)), coast[:3], now
        ),
    )
    assert weighed.log_likelihood == pytest.approx(small.log_likelihood, rel=1e-13)
    assert weighed.unrelated == pytest.approx(small.unrelated, rel=1e-12)
    # none of 400 particles came there: at most half of one in 400 does
    assert weighed.unrelated[1] > 0.99


def test_what_others_leave_on_the_shore_is_reckoned_once() -> None:
    fates = scattered(20, [30])
    seen = [Detection("a", 0, 1, 2 * DAY), Detection("b", 0, 2, 5 * DAY, false=0.3)]
    told = known(numbers([35]), seen, [], 20, 7 * DAY)
    usual = finds.usual(fates, told, np.zeros(20))
    same = weigh(fates, dataclasses.replace(told, usual=usual))
    assert (same.log_likelihood == weigh(fates, told).log_likelihood).all()
    twice = weigh(fates, dataclasses.replace(told, usual=2 * usual))
    assert twice.unrelated[1] > same.unrelated[1]


def test_a_find_at_sea_prefers_the_world_adrift_there() -> None:
    """Two worlds of particles on a normal cloud: the mean kernel density is that of the sum of both
    normals.
    """
    n, worlds, radius, spread = 4000, 2, 3e3, 5e3
    rng = np.random.default_rng(8)
    lon, lat = np.radians(179.99), np.radians(-60.0)
    centre = np.repeat([0.0, 12e3], n)
    x, y = rng.normal(centre, spread), rng.normal(0, spread, worlds * n)
    lon, lat = sphere.destination(lon, lat, x, y)
    place = AtSea(179.99, -60.0, radius, 0.1)
    status = np.where(np.arange(worlds * n) % 2, Status.ADRIFT, Status.SUNK).astype(np.int32)
    adrift = {
        0: Adrift(sphere.to_binary(np.degrees(lon)), sphere.to_binary(np.degrees(lat)), status)
    }
    fates = dataclasses.replace(spill(worlds, [n], []), adrift=adrift)
    told = weigh(
        fates, known(numbers([10]), [Detection("a", 0, place, 5)], [], worlds, 9)
    ).log_likelihood
    variance = spread**2 + radius**2
    exact = np.log(10 * 0.1 * 0.5 / (2 * np.pi * variance)) - np.array([0, 12e3**2]) / (
        2 * variance
    )
    # some 500 and 60 effective particles: 4 % and 13 %, three standard errors
    assert told == pytest.approx(exact, abs=0.4)
    assert told[0] - told[1] == pytest.approx(exact[0] - exact[1], abs=0.4)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 20 * DAY), st.floats(0, 1e-4), st.floats(0, 1e-4),
    st.lists(st.tuples(st.integers(0, 2), st.integers(0, 20 * DAY), st.floats(0, 1)), max_size=5), st.integers(0, 99),
)  # fmt: skip
def test_the_chance_of_having_been_found_is_one(
    now: int, rate: float, loss: float, walks: Any, seed: int
) -> None:
    fates = scattered(2, [10], seed)
    patrols = tuple(Walk((s,), t, d) for s, t, d in walks)
    here = exposure.expose(fates, Reporting(np.full(3, rate), loss, np.ones(2)), patrols)
    parts = np.concatenate(
        [exposure.reported_probability(here, s, now)[1] for s in range(3)]
        + [
            exposure.patrol_probability(here, s, k)[1]
            for k, p in enumerate(patrols)
            for s in p.segments
        ]
    )
    chance = exposure.found_probability(here, now)
    assert parts.min(initial=0) >= 0
    assert parts.max(initial=0) <= 1 + 1e-12
    assert ((chance >= 0) & (chance <= 1)).all()
    assert (exposure.found_probability(here, now + DAY) >= chance - 1e-12).all()
