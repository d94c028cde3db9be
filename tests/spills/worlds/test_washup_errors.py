"""Standard errors and quantiles of washup: against repeated forecasts."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from washup_spills import START, build, level, once, random_spill, spill, stretches

from drift.spills.worlds import estimate
from drift.spills.worlds.fates import FOREVER, Stays


@pytest.mark.thorough
@pytest.mark.parametrize("repeats", [100, pytest.param(400, marks=pytest.mark.thorough)])
def test_standard_errors_are_the_spread_of_repeated_forecasts(repeats):
    # Worlds differ (each has its own chance and arrival time) and are weighted; repeated forecasts
    # of 500 worlds. The mean of estimated variances, over the variance of estimates, is 1 within 3
    # sqrt(2 / repeats), 21 % of 400; weighting and the smoothness that Woodruff's method asks for
    # take another 15 %.
    rng, worlds, each = np.random.default_rng(20), 500, 4
    found = {
        name: []
        for name in ("expected", "probability", "first_arrival", "bulk_arrival", "total", "ever")
    }
    errors = {name: [] for name in found}
    for _ in range(repeats):
        chance, centre = rng.beta(0.5, 3, worlds), rng.normal(20_000, 4000, worlds)
        weight = np.exp(-((centre - 21_000) ** 2) / 2 / 5000**2)
        slots = np.flatnonzero(rng.random(worlds * each) < np.repeat(chance, each))
        world = np.repeat(np.arange(worlds), each)
        arrival = np.maximum(centre[world[slots]] + rng.exponential(4000, len(slots)), 1)
        stays = Stays(
            *(a.astype(np.int32) for a in (slots, 0 * slots, arrival, 0 * slots + FOREVER))
        )
        fates = replace(spill(world, [], worlds=worlds), stays=stays)
        weight /= weight.sum()
        made = build(
            fates,
            stretches(1),
            [once(np.ones(len(world)), worlds)],
            weight,
            np.array([25_000]),
            START,
        )
        for name in found:
            pick = 2 if name == "total" else 1 if "_" in name else 0
            found[name].append(made[name].values.ravel()[pick])
            errors[name].append(made[f"{name}_se"].values.ravel()[pick])
    for name in found:
        ratio = np.mean(np.square(errors[name])) / np.var(found[name])
        assert abs(ratio - 1) < 3 * np.sqrt(2 / repeats) + 0.15, (name, ratio)


def test_two_errors_of_a_rare_number_hold_whatever_its_mean():
    """Of so many worlds that hits are Poisson: the share of counts whose two errors hold their
    mean, summed exactly.
    """
    many = 1e7
    errors = []
    for count in range(200):
        weight = np.full(max(count, 1), 1 / many)
        value = np.full((max(count, 1), 1), float(count > 0))
        hits, square = np.array([[count / many]]), np.array([[count / many**3]])
        _, error = estimate.mean(value, weight, np.array([0]), 1 / many)
        if count == 0:  # what a missed world brings is known from another group alone
            hits, square = np.array([[0.0], [9 / many]]), np.array([[0.0], [9 / many**3]])
        more = estimate.unseen(hits, np.rint(hits * many), square, many)[0, 0]
        errors.append(many * np.hypot(error[0, 0], more))
    means = np.linspace(0.02, 100, 5000)[:, None]
    count = np.arange(200)
    held = np.abs(count - means) <= 2 * np.array(errors)
    assert (stats.poisson.pmf(count, means) * held).sum(axis=1).min() >= 0.95


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("worlds", "each", "scatter", "length", "drawn"),
    [
        pytest.param(2000, 30, 0.1, 0.2, (0, 1), marks=pytest.mark.thorough),
        pytest.param(500, 100, 0.05, 0.15, (0, 1), marks=pytest.mark.thorough),
        (2000, 30, 0.1, 0.2, (0.3, 1.4)),
    ],
)
def test_two_standard_errors_hold_what_they_say_on_rare_stretches_too(
    worlds, each, scatter, length, drawn
):
    """A straight coast: plumes land about normal centres, objects about these; the truth is a
    normal integral.

    A rare stretch is hit by whole plumes in a few worlds, or by stragglers of more. Errors from the
    spread over worlds alone held 12 to 87 % below 0.1 objects. Two errors hold 95.4 % of what is
    normal; three standard errors of that by seeds, whose stretches share their worlds, are left for
    chance. Classes by the truth and by what is printed. drawn: mean and standard deviation of the
    normal that worlds are drawn from, and then weighed to the standard one.
    """
    count, seeds = 80, 16
    edges = (np.arange(count + 1) - count // 2) * length
    true = each * np.diff(stats.norm.cdf(edges / np.hypot(1, scatter)))
    coast, rows = stretches(count), []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        middle = drawn[0] + drawn[1] * rng.standard_normal(worlds)
        weight = stats.norm.pdf(middle) / stats.norm.pdf(middle, *drawn)
        centre = np.repeat(middle, each)
        place = (
            np.floor((centre + scatter * rng.standard_normal(worlds * each)) / length).astype(int)
            + count // 2
        )
        slot = np.flatnonzero((place >= 0) & (place < count))
        at = np.stack(
            [slot, place[slot], np.full(len(slot), 10), np.full(len(slot), FOREVER)], axis=1
        )
        fates = spill(np.repeat(np.arange(worlds), each), [], worlds=worlds)
        fates = replace(fates, stays=Stays(*(column.astype(np.int32) for column in at.T)))
        made = build(
            fates,
            coast,
            [once(np.ones(worlds * each), worlds)],
            weight / weight.sum(),
            np.array([20]),
            START,
            ["drum"],
        )
        for name in ("expected", "arrived", "expected_by_kind"):
            value, error = (made[name + end].values.reshape(-1) for end in ("", "_se"))
            rows.append(
                np.stack(
                    [true[made["segment"].values], value, error, np.full(len(value), seed)], axis=1
                )
            )
    truth, value, error, seed = np.concatenate(rows).T
    held = np.abs(value - truth) <= 2 * error
    for what in (truth, value):
        for low, high in ((0, 0.01), (0.01, 0.1), (0.1, 1), (1, each)):
            chosen = (what >= low) & (what < high)
            by_seed = np.array([held[chosen & (seed == k)].mean() for k in np.unique(seed[chosen])])
            if (
                len(by_seed) < seeds / 2
            ):  # plumes of many objects leave hardly a stretch with less than one in a hundred
                assert (low, each) == (0, 100)
                continue
            assert by_seed.mean() >= 0.954 - 3 * by_seed.std(ddof=1) / np.sqrt(len(by_seed)), (
                low,
                high,
            )


def test_realisations_of_a_world_are_one_unit():
    # Twice the same realisation tells nothing more: the same figures, the same errors
    fates, draws = random_spill(np.random.default_rng(2), worlds=40)
    arguments = (stretches(4), level(40), np.arange(0, 40, 8), START)
    one = build(fates, arguments[0], draws[:1], *arguments[1:])
    two = build(fates, arguments[0], draws[:1] * 2, *arguments[1:])
    for name in one.data_vars:
        if name != "realisations":
            np.testing.assert_allclose(two[name].values, one[name].values, rtol=1e-12, atol=1e-12)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), groups=st.integers(1, 6))
def test_quantiles_of_ragged_groups(seed, groups):
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, 30, groups)
    values = [np.sort(rng.integers(0, 15, size)) for size in sizes]
    weights = [rng.integers(1, 9, size) for size in sizes]  # whole: the oracle repeats values
    start = np.cumsum(sizes) - sizes
    shares = (0.1, 0.5, 0.9)
    found, _ = estimate.quantiles(
        np.concatenate(values),
        np.concatenate(weights).astype(float) * rng.random(),
        start,
        shares,
        50.0,
    )
    for g in range(groups):
        repeated = np.repeat(values[g], weights[g])
        np.testing.assert_array_equal(
            found[:, g], np.quantile(repeated, shares, method="inverted_cdf")
        )


def test_quantiles_too_few_to_tell():
    values, weights = np.arange(8.0), np.full(8, 1 / 8)
    _, error = estimate.quantiles(values, weights, np.array([0]), (0.1, 0.5), 8.0)
    assert np.isnan(error[0, 0])  # a tenth less its error of 0.106 is below 0
    assert error[1, 0] == (5 - 2) / 2  # between the quantiles at 0.5 -+ 0.177
