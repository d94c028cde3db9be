"""Objects realised from weighed worlds: every object is accounted for, and drawn by its
probability.
"""

import numpy as np
import pytest
from scipy import special, stats
from spills import DAY, scattered, spill
from weighed_worlds import SEARCHES, SEEN, known, numbers, realised, weigh

from drift.engine.particles import weights
from drift.spills.worlds import finds, shrinkage
from drift.spills.worlds.exposure import Reporting, Walk
from drift.spills.worlds.fates import FOREVER
from drift.spills.worlds.finds import Detection
from geo.errors import UserError


@pytest.mark.parametrize("seen", [SEEN, []])
def test_every_object_is_accounted_for(seen: list[Detection]) -> None:
    fates, count = scattered(40, [20, 30]), numbers([30, 90], [0.4, 0.6], [0.0, 0.3])
    told = weigh(fates, known(count, seen, SEARCHES, 40, 7 * DAY))
    drawn = realised(fates, told, 5, 3)
    for each in drawn:
        total = np.bincount(fates.world, each.stands, 40) + each.destroyed + each.found
        assert set(total) <= {30, 90}
        assert (each.found >= max(len(seen) - 1, 0)).all()  # one may be false
    assert (drawn[0].stands != drawn[1].stands).any()


def test_without_finds_objects_are_drawn_without_replacement() -> None:
    fates = scattered(400, [20])
    told = weigh(fates, known(numbers([6], None, [0.5]), [], [], 400, 7 * DAY))
    assert told.log_likelihood == pytest.approx(np.zeros(400), abs=1e-12)
    drawn = realised(fates, told, 2, 3)
    stands = np.stack([each.stands for each in drawn]).reshape(3, 400, 20)
    assert stands.max() == 1
    assert stands.sum(0).max() == 1  # three times at most six of twenty: all different
    destroyed = np.concatenate([each.destroyed for each in drawn])
    assert abs(destroyed.mean() - 3) < 4 * np.sqrt(6 / 4 / 1200)
    place = stands.sum((0, 1))  # every particle as often: chi-square on 19 degrees of freedom
    assert stats.chisquare(place).pvalue > 1e-3


def test_objects_are_copied_evenly_where_particles_are_few() -> None:
    fates = scattered(10, [20])
    (each,) = realised(fates, weigh(fates, known(numbers([50]), [], [], 10, 0)), 2, 1)
    assert set(each.stands) == {2, 3}


def test_what_was_not_found_is_the_likelier_to_have_been_destroyed() -> None:
    """All lay where they would have been found with probability 0.8, had they not been destroyed,
    as half were; none was.
    """
    worlds, n, destroyed, pod = 400, 20, 0.5, 0.8
    fates = spill(
        worlds, [n], [(w * n + k, 0, 0, FOREVER) for w in range(worlds) for k in range(n)]
    )
    still = Reporting(np.zeros(3), 0.0, np.ones(worlds))
    told = weigh(
        fates,
        known(
            numbers([10], None, [destroyed]), [], [Walk((0,), 5, pod)], worlds, 5, reporting=still
        ),
    )
    drawn = realised(fates, told, 4, 3)
    share = destroyed / (1 - (1 - destroyed) * pod)  # Bayes
    found = np.concatenate([each.destroyed for each in drawn]).mean() / 10
    assert abs(found - share) < 4 * np.sqrt(share * (1 - share) / (10 * worlds * 3))


def test_those_not_found_are_drawn_by_their_chance() -> None:
    """Half of the particles were found with probability 0.8: of the unfound, one in six lies there."""
    worlds, n = 500, 60
    stays = [(w * n + k, 0, 0, FOREVER) for w in range(worlds) for k in range(n // 2)]
    fates = spill(worlds, [n], stays)
    still = Reporting(np.zeros(3), 0.0, np.ones(worlds))
    told = weigh(fates, known(numbers([20]), [], [Walk((0,), 5, 0.8)], worlds, 5, reporting=still))
    (each,) = realised(fates, told, 4, 1)
    there = each.stands.reshape(worlds, n)[:, : n // 2].sum() / (20 * worlds)
    # conditional Poisson sampling of 20 of 36 accepted on average: near 1/6 of the draws, up to
    # O(1/n) = 0.01
    assert there == pytest.approx(1 / 6, abs=0.012)


def test_surprise_is_the_share_of_each_stretch() -> None:
    worlds, n = 3, 100
    stays = [(w * n + k, min(k // 60, 2), 0, FOREVER) for w in range(worlds) for k in range(90)]
    stays += [(w * n + k, 2, 0, FOREVER) for w in range(worlds) for k in range(90, 96)]
    told = known(
        numbers([50]),
        [Detection("late", 0, 2, 5 * DAY), Detection("early", 0, 0, DAY)],
        [],
        worlds,
        9 * DAY,
    )
    early, late = finds.surprises(
        spill(worlds, [n], stays[:-18]), told, np.zeros((worlds, 0)), np.zeros(worlds)
    )
    assert (early.find.name, late.find.name) == ("early", "late")
    assert early.probability == pytest.approx(60 / 90)
    assert early.tail == pytest.approx(1)
    assert (late.probability, late.tail) == (0, pytest.approx(0))


def test_more_finds_than_objects_are_refused() -> None:
    fates = scattered(5, [20])
    seen = [Detection(f"{k}", 0, 1, 2 * DAY) for k in range(4)]
    with pytest.raises(UserError, match=r"4 objects were found.*\[spill\] objects"):
        weigh(fates, known(numbers([3]), seen, [], 5, 7 * DAY))


def test_classes_get_whole_numbers_that_add_up() -> None:
    count = numbers([520, 7, 1], [0.4, 0.35, 0.25])
    assert count.by_class.tolist() == [[208, 182, 130], [3, 2, 2], [1, 0, 0]]


def test_tempering_leaves_as_many_worlds_as_asked() -> None:
    log = np.random.default_rng(6).normal(-900, 8, 500)
    power = finds.tempering_exponent(log, 50)
    assert 0 < power < 1
    weight = np.exp(power * (log - log.max()))
    assert weights.effective(weight) == pytest.approx(50, rel=1e-6)
    assert finds.tempering_exponent(log * 1e-3, 50) == 1


def test_strength_is_borrowed_where_worlds_agree_and_not_where_they_differ() -> None:
    """Gamma-Poisson worlds: Bayes with the prior that they were drawn from, known here, is met."""
    rng = np.random.default_rng(7)
    worlds, n = 2000, 500
    z = rng.standard_normal((worlds, 2))
    for width in (1e-3, 1.0):  # variance of the truth in squared means
        mean = np.exp(1 + 0.8 * z[:, 0] - 0.3 * z[:, 1] ** 2)
        truth = mean * rng.gamma(1 / width, width, worlds)
        count = rng.poisson(truth).astype(float)
        law = np.log(shrinkage.shrink_means(count, count, n, shrinkage.world_similarity(z)))
        exact = np.log((1 / width + count) / (1 / width / mean + 1) / n)
        # six coefficients of 2000 worlds, and a grid of widths
        assert np.sqrt(np.mean((law - exact) ** 2)) < 0.12


def test_shares_are_drawn_together_as_far_as_their_noise_goes() -> None:
    """Beta-binomial worlds:

    Bayes with the prior that they were drawn from, known here, is met; noise is not taken for
    truth.
    """
    rng = np.random.default_rng(9)
    worlds, n = 3000, 120
    z = rng.standard_normal((worlds, 2))
    mean = special.expit(-1.2 + 0.5 * z[:, 0] - 0.4 * z[:, 1])
    # of the prior, in particles: no differences of their own, and large ones
    for size in (1e6, 15.0):
        truth = rng.beta(mean * size, (1 - mean) * size)
        found = rng.binomial(n, truth) / n
        share = shrinkage.shrink_shares(
            found, found * (1 - found), n, shrinkage.world_similarity(z)
        )
        exact = (mean * size + found * n) / (size + n)
        noise = np.sqrt(np.mean(truth * (1 - truth)) / n)
        assert (
            np.sqrt(np.mean((share - exact) ** 2)) < 0.15 * noise
        )  # three coefficients of 3000 worlds, a credibility to 5 %
