"""Allocation of processing: against brute force over all choices, and closed forms."""

import itertools

import numpy as np
import pytest
from allocations import brute_force, options, small
from scipy import sparse

from drift.planning.arrays import choosing, manning, processing, records
from geo.errors import UserError


@pytest.mark.thorough
@pytest.mark.parametrize(
    "block", [0, *(pytest.param(block, marks=pytest.mark.thorough) for block in (1, 2))]
)
def test_it_finds_what_brute_force_finds_and_the_bound_holds(block: int) -> None:
    shares = []
    for seed in range(25 * block, 25 * block + 25):
        hearing = small(seed)
        most, found = brute_force(hearing), processing.allocate(hearing)
        assert found.bound >= most
        assert found.value <= most + 1e-12
        if found.exact:
            assert found.value >= most - 2e-9
        if most > 1e-9:
            shares.append(found.value / most)
    assert len(shares) > 20
    assert min(shares) >= 0.98
    assert np.mean(shares) > 0.999


@pytest.mark.parametrize("seed", [200, 224, 693])
def test_exchange_alone_would_be_trapped(seed: int) -> None:
    """Cases in which the best of all single exchanges is 1 to 3 % short of the best."""
    hearing = small(seed)
    most = brute_force(hearing)
    assert (
        choosing.value(hearing, choosing.exchanged(hearing, choosing.greedy(hearing))) < 0.99 * most
    )
    assert processing.allocate(hearing).value == pytest.approx(most, rel=1e-9)


def test_two_beams_that_hear_the_same_are_not_counted_twice() -> None:
    """A linear programme takes the two loudest beams and finds 0.49, where 0.63 is best."""
    weight = [0.49, 0.14, 0.37]
    chance = [[[1, 0.98, 0], [0, 0, 1], [0, 0, 0]]]  # beams 1 and 2 hear the same, beam 3 another
    hearing = records.hearing(chance, np.array(weight), [0, 0, 1], 2)
    linear = choosing.value(
        hearing, (manning.best(hearing.chance[0] @ hearing.weight, hearing.array, hearing.crew(0)),)
    )
    assert linear == pytest.approx(0.49)
    found = processing.allocate(hearing)
    assert found.chosen == ((0, 2),)
    assert found.value == pytest.approx(0.63)
    assert found.bound >= 0.63


def test_greedy_alone_would_be_trapped() -> None:
    """The beam that hears most leaves less to the other than the two that share everything."""
    weight = np.full(6, 1 / 6)
    middle, left, right = [0, 1, 1, 1, 1, 0], [1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]
    hearing = records.hearing([np.array([middle, left, right]).T], weight, [0, 0, 0], 2)
    assert choosing.value(hearing, choosing.greedy(hearing)) == pytest.approx(5 / 6)
    found = processing.allocate(hearing)
    assert found.chosen == ((1, 2),)
    assert found.value == pytest.approx(1)
    assert found.exact


def test_ties_fall_to_the_first_and_stay() -> None:
    hearing = records.hearing(np.full((4, 3, 5), 0.25), np.ones(3), [0, 0, 1, 1, 1], 2)
    first, second = processing.allocate(hearing), processing.allocate(hearing)
    assert np.array_equal(first.processing, second.processing)
    assert first.chosen == ((0, 1),) * 4
    assert np.array_equal(first.processing, [[0, 1]] * 4)  # each processor keeps its beam


def test_what_it_tells_of_a_choice_adds_up() -> None:
    hearing = small(8)
    found = processing.allocate(hearing)
    tables = [table.toarray().astype(float) for table in hearing.chance]
    rest = hearing.weight.copy()
    for slot, beams in enumerate(found.chosen):
        for beam in beams:
            rest = rest * (1 - tables[slot][beam])
        assert found.by_slot[slot] == pytest.approx(hearing.weight.sum() - rest.sum())
    assert found.heard == pytest.approx(found.by_slot[-1])
    for slot, beam in itertools.product(range(hearing.slots), range(hearing.beams)):
        others = [
            set(beams) - {beam} if s == slot else set(beams) for s, beams in enumerate(found.chosen)
        ]
        without = tuple(tuple(sorted(beams)) for beams in others)
        together = tuple(
            tuple(sorted(beams | {beam})) if s == slot else without[s]
            for s, beams in enumerate(others)
        )
        if not np.isnan(found.gain[slot, beam]):
            added = choosing.heard(hearing, together) - choosing.heard(hearing, without)
            assert found.gain[slot, beam] == pytest.approx(added, abs=1e-14)
    for other in found.alternatives:
        assert other.value == pytest.approx(choosing.value(hearing, other.beams))
        assert other.value <= found.value + 1e-12


def test_today_is_told_and_never_better() -> None:
    hearing = small(12)
    today = tuple(options(hearing, slot)[-1] for slot in range(hearing.slots))
    found = processing.allocate(hearing, today=today)
    assert {other.name: other.value for other in found.alternatives}["as today"] <= found.value
    with pytest.raises(UserError, match=r"processing\.today: 1 slots of beams for"):
        processing.allocate(hearing, today=today[:1])
    with pytest.raises(UserError, match=r"slot 1 has beams \[0, 0\]"):
        processing.allocate(hearing, today=((0, 0), *today[1:]))
    with pytest.raises(UserError, match="no processors for all of them"):
        processing.allocate(hearing, today=(tuple(range(hearing.beams)), *today[1:]))


def test_processors_work_on_what_they_serve() -> None:
    for seed in (3, 6, 8, 9, 12, 15):  # some of which have hours in which not all work
        hearing = small(seed)
        found = processing.allocate(hearing)
        for row, works in zip(found.processing, hearing.manned, strict=True):
            for k, beam in enumerate(row):
                assert beam < 0 or (works[k] and hearing.serves[k, hearing.array[beam]])


def test_sets_that_fit_are_those_that_can_be_matched() -> None:
    """Independent sets, their rank and the best of them, by trying all ways to give processors to
    beams.
    """
    for seed in range(60):
        hearing, rng = small(seed), np.random.default_rng(seed)
        score = rng.normal(0.3, 1, hearing.beams).round(1)
        for slot in range(hearing.slots):
            sets = options(hearing, slot)
            expected = max(score[list(beams)].sum() for beams in sets)
            found = manning.best(score, hearing.array, hearing.crew(slot))
            assert found in sets
            assert score[list(found)].sum() == pytest.approx(expected)
            for beams in sets:
                fit = manning.extends(beams, hearing.array, hearing.crew(slot))
                for beam in set(range(hearing.beams)) - set(beams):
                    assert fit[beam] == (tuple(sorted((*beams, beam))) in sets)


CHANCE = np.full((2, 3, 4), 0.5)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"processors": 5}, "5 processors for 4 beams in slot 1"),
        (
            {"array": [0, 1, 1, 2], "processors": np.array([[1, 0, 1], [1, 0, 0], [0, 0, 1], [0, 1, 0]], bool)},
            "3 processors for 2 beams in slot 1",
        ),
        ({"array": [0, 0, 0, 0], "processors": np.array([[1, 0], [0, 1]], bool)}, "1 processors for 0 beams"),
        ({"chance": np.zeros((2, 3, 0)), "array": []}, "no beam or no time slot"),
        ({"chance": []}, "no beam or no time slot"),
        ({"chance": CHANCE + 0.6}, "slot 1 has 12 chances outside of 0 to 1, such as 1.1"),
        ({"chance": CHANCE - 0.6}, "such as -0.1"),
        ({"chance": np.where(np.arange(4) == 2, np.nan, CHANCE)}, "slot 2 has 3 chances outside of 0 to 1, such as nan"),
        ({"chance": CHANCE[:, :2]}, r"slot 1 has the shape \(2, 4\), not \(particles, beams\) = \(3, 4\)"),
        ({"weight": np.array([1, -2, 3])}, "1 are negative, such as -2"),
        ({"weight": np.array([1, np.inf, 3])}, "1 are not finite"),
        ({"weight": np.zeros(3)}, "all are 0"),
        ({"array": [0, 0, -1, 0]}, "-1 is no index of an array"),
        ({"array": [0, 0, 1, 3], "processors": np.ones((2, 3), bool)}, r"shape \(2, 3\) for 4 arrays"),
        ({"processors": 0}, r"shape \(0, 1\)"),
        ({"manned": np.ones((2, 3), bool)}, r"processing\.manned: shape \(2, 3\), not \(slots, processors\) = \(2, 2\)"),
        ({"cost": np.ones((2, 3))}, r"processing\.cost: shape"),
        ({"cost": np.full((2, 4), -1.0)}, "-1 is no cost"),
    ],
)  # fmt: skip
def test_refusals(given: dict, expected: str) -> None:
    usual = {"chance": CHANCE, "weight": np.ones(3), "array": [0, 0, 0, 0], "processors": 2}
    with pytest.raises(UserError, match=expected):
        records.hearing(**{**usual, **given})


def test_sparse_and_dense_tables_are_the_same() -> None:
    rng = np.random.default_rng(5)
    chance = (rng.random((2, 30, 6)) < 0.3) * rng.random((2, 30, 6))
    weight, array = rng.random(30), [0, 0, 1, 1, 1, 2]
    found = [
        processing.allocate(records.hearing(tables, weight, array, 2))
        for tables in (
            chance,
            [sparse.coo_array(t) for t in chance],
            [sparse.csr_matrix(t) for t in chance],
        )
    ]
    assert all(np.array_equal(found[0].processing, other.processing) for other in found)
    assert len({other.bound for other in found}) == 1
