"""Washup by stretch and time: against counts by hand, brute force and closed forms; the account."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from washup_spills import (
    HOUR,
    START,
    build,
    level,
    once,
    quantile,
    random_spill,
    spill,
    state,
    stretches,
)

from drift.engine.particles.status import Status
from drift.products.files import formats
from drift.spills.worlds import washup
from drift.spills.worlds.fates import FOREVER, Stays
from drift.spills.worlds.products import dataset as washup_dataset
from drift.spills.worlds.products import tables as washup_tables


def test_by_hand():
    # world 0: two objects on stretch 3, at 1 h and 3 h, and one that sinks at 2 h; world 1: one at
    # 2 h, afloat again at 4 h and on stretch 1 at 5 h, where another lies from 5 h on, and one
    # released at 6 h
    fates = spill(
        [0, 0, 0, 1, 1, 1],
        [
            (0, 3, HOUR, FOREVER),
            (1, 3, 3 * HOUR, FOREVER),
            (3, 3, 2 * HOUR, 4 * HOUR),
            (3, 1, 5 * HOUR, FOREVER),
            (4, 1, 5 * HOUR, FOREVER),
        ],
        release=[0, 0, 0, 0, 0, 6 * HOUR],
        ended={2: (2 * HOUR, Status.SUNK)},
    )
    weight = np.array([0.25, 0.75])
    made = build(
        fates,
        stretches(5),
        [once(np.ones(6), 2, destroyed=1)],
        weight,
        np.arange(0, 7) * HOUR,
        START,
        ["drum"],
    )
    assert made["segment"].values.tolist() == [1, 3]
    np.testing.assert_allclose(made["expected"].sel(segment=3), [0, 0.25, 1, 1.25, 0.5, 0.5, 0.5])
    np.testing.assert_allclose(made["expected"].sel(segment=1), [0, 0, 0, 0, 0, 1.5, 1.5])
    np.testing.assert_allclose(
        made["probability"].sel(segment=3), [0, 0.25, 1, 1, 0.25, 0.25, 0.25]
    )
    np.testing.assert_allclose(made["arrived"].sel(segment=3), [0, 0.25, 1, 1.25, 1.25, 1.25, 1.25])
    assert made["number"].sel(segment=3, quantile=0.9).values.tolist() == [0, 1, 1, 2, 2, 2, 2]
    begin = int(START.astype("datetime64[s]").astype(int))
    first, bulk = (
        (made[f"{n}_arrival"].sel(segment=3).values - begin) / HOUR for n in ("first", "bulk")
    )
    assert first.tolist() == [1, 2, 2]
    assert bulk.tolist() == [2, 2, 2]  # of world 0: the mean of its two middle ones, 1 h and 3 h
    assert made["ever"].values.tolist() == [0.75, 1]
    ends = made["world_total"].isel(time=-1).values
    assert dict(zip(washup_dataset.FATES, ends[0], strict=True)) == {
        "pending": 0,
        "afloat": 0,
        "ashore": 2,
        "sunk": 1,
        "gone": 0,
        "destroyed": 1,
        "found": 0,
    }
    np.testing.assert_allclose(made["total"].sel(fate="pending"), [0.75] * 6 + [0])
    assert made["first_arrival"].attrs["units"] == formats.EPOCH


@pytest.mark.thorough
@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_every_figure_is_that_of_brute_force(seed):
    rng = np.random.default_rng(seed)
    fates, draws = random_spill(rng)
    weight = rng.dirichlet(np.full(5, 0.7))
    outputs = np.array([0, 3, 4, 9, 15, 40])
    made = build(fates, stretches(4), draws, weight, outputs, START, ["a", "b"])
    n = len(fates.world)
    pooled = np.tile(weight, 2) / 2
    names = list(washup_dataset.FATES)
    for i, time in enumerate(outputs):
        now = [state(fates, slot, time) for slot in range(n)]
        totals = np.zeros((2, 5, len(names)))
        for r, draw in enumerate(draws):
            for slot, (fate, _) in enumerate(now):
                totals[r, fates.world[slot], names.index(fate)] += draw.stands[slot]
            totals[r, :, names.index("destroyed")] = draw.destroyed
            totals[r, :, names.index("found")] = draw.found
        np.testing.assert_array_equal(made["world_total"].values[:, i], totals.mean(axis=0))
        np.testing.assert_allclose(
            made["total"].values[:, i], weight @ totals.mean(axis=0), atol=1e-12
        )
        for k in range(len(names)):
            assert made["total_number"].values[1, k, i] == quantile(
                totals[:, :, k].ravel(), pooled, 0.5
            )
        for j, segment in enumerate(made["segment"].values):
            number = np.zeros((2, 5, 2))
            for r, draw in enumerate(draws):
                for slot, (_, where) in enumerate(now):
                    if where == segment:
                        number[r, fates.world[slot], fates.kind[slot]] += draw.stands[slot]
            both = number.sum(axis=-1)
            np.testing.assert_allclose(
                made["expected"].values[i, j], weight @ both.mean(axis=0), atol=1e-12
            )
            np.testing.assert_allclose(
                made["probability"].values[i, j], weight @ (both > 0).mean(axis=0), atol=1e-12
            )
            by_kind = np.einsum("w,rwk->k", weight, number) / 2
            np.testing.assert_allclose(
                made["expected_by_kind"].values[:, i, j], by_kind, atol=1e-12
            )
            for q, share in enumerate(washup_dataset.SHARES):
                assert made["number"].values[q, i, j] == quantile(both.ravel(), pooled, share)
    begin = int(START.astype("datetime64[s]").astype(int))
    for j, segment in enumerate(made["segment"].values):
        first, bulk, of = [], [], []
        for draw in draws:
            for world in range(5):
                arrivals = []
                for slot in np.flatnonzero(fates.world == world):
                    mine = [
                        max(fates.stays.arrival[i], fates.release[slot])
                        for i in np.flatnonzero(
                            (fates.stays.slot == slot) & (fates.stays.segment == segment)
                        )
                        if fates.stays.arrival[i] < fates.ended[slot]
                    ]
                    arrivals += [min(mine)] * draw.stands[slot] if mine else []
                if arrivals:
                    first.append(min(arrivals))
                    bulk.append(np.median(arrivals))
                    of.append(weight[world])
        np.testing.assert_allclose(made["ever"].values[j], np.sum(of) / 2, atol=1e-12)
        for q, share in enumerate(washup_dataset.SHARES):
            assert made["first_arrival"].values[q, j] - begin == quantile(first, of, share)
            assert made["bulk_arrival"].values[q, j] - begin == quantile(bulk, of, share)


@pytest.mark.thorough
@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_account_adds_up_in_every_world_at_every_time(seed):
    rng = np.random.default_rng(seed)
    fates, draws = random_spill(rng, worlds=3, each=20, segments=7)
    outputs = np.unique(rng.integers(0, 60, 9))
    for draw in draws:
        counts = washup.fates_by_world(fates, draw, outputs)
        objects = np.bincount(fates.world, draw.stands, 3) + draw.destroyed + draw.found
        assert (counts.sum(axis=-1) == objects[:, None]).all()
        assert counts.min() >= 0
    made = build(fates, stretches(7), draws, level(3), outputs, START)
    ashore = made["total"].sel(fate="ashore").values
    np.testing.assert_allclose(made["expected"].values.sum(axis=1), ashore, atol=1e-9)


def test_stretch_by_stretch_is_the_same_as_all_at_once(monkeypatch):
    fates, draws = random_spill(np.random.default_rng(3), worlds=6, each=40, segments=30)
    arguments = (fates, stretches(30), draws, level(6), np.arange(0, 40, 3), START)
    whole = build(*arguments)
    monkeypatch.setattr(washup.stretches, "CELLS", 1)
    assert build(*arguments).identical(whole)


def test_binomial_and_hypergeometric():
    # Every world has the same 200 particles, 30 of them on stretch 0; 50 are drawn without
    # replacement: the number there is hypergeometric, and with one stand of each of 50 independent
    # slots it would be binomial
    rng, worlds, n, there, drawn = np.random.default_rng(11), 3000, 200, 30, 50
    world = np.repeat(np.arange(worlds), n)
    slots = (n * np.arange(worlds)[:, None] + np.arange(there)).ravel()
    stays = np.column_stack([slots, 0 * slots, 0 * slots + 50, 0 * slots + FOREVER]).astype(
        np.int32
    )
    fates = replace(
        spill(world, [], worlds=worlds), stays=Stays(*(stays[:, i].copy() for i in range(4)))
    )
    stands = np.argsort(np.argsort(rng.random((worlds, n)), axis=1), axis=1) < drawn
    made = build(
        fates, stretches(1), [once(stands.ravel(), worlds)], level(worlds), np.array([60]), START
    )
    law = stats.hypergeom(n, there, drawn)
    error = law.std() / np.sqrt(worlds)
    assert abs(made["expected"].item() - law.mean()) < 3 * error
    # relative error of a spread
    assert made["expected_se"].item() == pytest.approx(error, rel=4 / np.sqrt(2 * worlds))
    none = law.pmf(0)
    assert abs(made["probability"].item() - (1 - none)) < 3 * np.sqrt(none * (1 - none) / worlds)
    assert made["number"].values.ravel().tolist() == law.ppf(washup_dataset.SHARES).tolist()
    # with replacement: multinomial stands, binomial number
    stands = rng.multinomial(drawn, np.full(n, 1 / n), worlds)
    made = build(
        fates, stretches(1), [once(stands.ravel(), worlds)], level(worlds), np.array([60]), START
    )
    law = stats.binom(drawn, there / n)
    assert abs(made["expected"].item() - law.mean()) < 3 * law.std() / np.sqrt(worlds)
    assert made["number"].values.ravel().tolist() == law.ppf(washup_dataset.SHARES).tolist()


def test_weight_on_one_world_gives_that_worlds_numbers():
    fates, draws = random_spill(np.random.default_rng(8), worlds=4)
    outputs = np.arange(0, 40, 5)
    made = build(fates, stretches(4), draws[:1], np.array([0, 0, 1.0, 0]), outputs, START)
    alone = washup.fates_by_world(fates, draws[0], outputs)[2]
    np.testing.assert_array_equal(made["total"].values.T, alone)
    for share in range(3):
        np.testing.assert_array_equal(made["total_number"].values[share].T, alone)
        np.testing.assert_array_equal(made["number"].values[share], made["expected"].values)
    assert made["effective_worlds"].item() == 1
    for name in ("expected", "probability", "number", "first_arrival", "total", "total_number"):
        assert np.isnan(made[f"{name}_se"].values).all()  # one world tells nothing about the others


def test_worlds_without_weight_touch_no_stretch():
    fates = spill([0, 1], [(0, 3, 5, FOREVER), (1, 1, 5, FOREVER)])
    made = build(fates, stretches(5), [once([1, 1], 2)], np.array([0, 1.0]), np.array([9]), START)
    assert made["segment"].values.tolist() == [1]


def test_a_stay_that_ends_is_followed_by_another():
    fates = spill([0], [(0, 1, 10, 20), (0, 1, 30, 40), (0, 2, 40, FOREVER)])
    outputs = np.array([9, 10, 19, 20, 30, 39, 40, 100])
    made = build(fates, stretches(3), [once([2], 1)], level(1), outputs, START)
    assert made["expected"].values.T.tolist() == [
        [0, 2, 2, 0, 2, 2, 0, 0],
        [0, 0, 0, 0, 0, 0, 2, 2],
    ]
    assert made["arrived"].values.T.tolist() == [[0, 2, 2, 2, 2, 2, 2, 2], [0, 0, 0, 0, 0, 0, 2, 2]]
    assert made["total"].sel(fate="afloat").values.tolist() == [2, 0, 0, 2, 0, 0, 0, 0]


def test_what_sinks_ashore_no_longer_lies_there():
    fates = spill([0], [(0, 1, 10, FOREVER)], ended={0: (25, Status.SUNK)})
    made = build(fates, stretches(3), [once([1], 1)], level(1), np.array([10, 24, 25]), START)
    assert made["expected"].values[:, 0].tolist() == [1, 1, 0]
    assert made["total"].sel(fate="sunk").values.tolist() == [0, 0, 1]


def test_nothing_ashore():
    made = build(
        spill([0, 1], []), stretches(2), [once([3, 3], 2)], level(2), np.array([0, 10]), START
    )
    assert made.sizes["segment"] == 0
    assert made["total"].sel(fate="afloat").values.tolist() == [3, 3]
    for text in (
        washup_tables.washup_csv(made, "run"),
        washup_tables.washup_times_csv(made, "run"),
    ):
        assert len(text.splitlines()) == 1
    assert washup_tables.washup_geojson(made, stretches(2), {})["features"] == []
