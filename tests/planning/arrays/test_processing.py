"""Allocation of processing: against brute force over all choices, HiGHS where it is linear, and
closed forms.
"""

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, sparse

from drift.planning.arrays import choosing, manning, processing, records, relaxation
from drift.planning.arrays.records import Hearing
from geo.errors import UserError


def options(hearing: Hearing, slot: int) -> list[tuple[int, ...]]:
    """Return every set of beams to which different processors can be given in a slot, by trying
    all.
    """
    crew = hearing.serves[hearing.manned[slot]]
    found = set()
    for given in itertools.product(range(-1, hearing.beams), repeat=len(crew)):
        beams = [beam for beam in given if beam >= 0]
        if len(set(beams)) == len(beams) and all(
            b < 0 or crew[k][hearing.array[b]] for k, b in enumerate(given)
        ):
            found.add(tuple(sorted(beams)))
    return sorted(found)


def silent(table: np.ndarray, beams: tuple[int, ...], shared: np.ndarray) -> np.ndarray:
    """Return the chance that each particle is missed: of beams that share a level the best counts."""
    missed = np.ones(table.shape[1])
    for level in set(shared[list(beams)].tolist()):
        missed *= 1 - table[[beam for beam in beams if shared[beam] == level]].max(axis=0)
    return missed


def brute_force(hearing: Hearing) -> float:
    """Return the most that any choice of beams is worth."""
    sets = [options(hearing, slot) for slot in range(hearing.slots)]
    tables = [table.toarray().astype(float) for table in hearing.chance]
    missed = [[silent(tables[s], o, hearing.shared) for o in sets[s]] for s in range(hearing.slots)]
    cost = [[hearing.cost[s, list(o)].sum() for o in sets[s]] for s in range(hearing.slots)]
    best = 0.0
    for choice in itertools.product(*(range(len(o)) for o in sets)):
        rest = np.prod([missed[s][i] for s, i in enumerate(choice)], axis=0)
        paid = sum(cost[s][i] for s, i in enumerate(choice))
        best = max(best, float(hearing.weight @ (1 - rest)) - paid)
    return best


def small(seed: int) -> Hearing:
    """Return a random case that brute force can do; its beams overlap within slots and from slot to
    slot.
    """
    for attempt in itertools.count():
        rng = np.random.default_rng((seed, attempt))
        slots, beams, arrays = (int(rng.integers(*ends)) for ends in ((1, 4), (3, 7), (1, 4)))
        many, processors = int(rng.integers(3, 40)), int(rng.integers(1, 3))
        array = np.append(np.sort(rng.integers(0, arrays, beams - 1)), arrays - 1)
        share, power = rng.choice([0.2, 0.5, 0.9]), rng.choice([0.2, 1.0, 3.0])
        chance = (rng.random((slots, many, beams)) < share) * rng.random(
            (slots, many, beams)
        ) ** power
        if seed % 5 == 0:
            chance = np.where(chance > 0.5, 1.0, 0.0)  # all or nothing
        if seed % 7 == 0:
            chance = np.round(2 * chance) / 2  # ties
        manned = rng.random((slots, processors)) < (0.8 if seed % 3 == 0 else 1.1)
        cost = 0.1 * rng.random((slots, beams)) if seed % 4 == 0 else None
        weight = rng.gamma(0.5, 1, many)
        serves = rng.random((processors, arrays)) < 0.7
        try:
            return records.hearing(
                chance, weight / weight.sum(), array, serves, manned=manned, cost=cost
            )
        except UserError:
            continue  # more processors than beams
    raise AssertionError


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


def highs(hearing: Hearing) -> float:
    """Return the best sum of single gains by HiGHS: which processor works on which beam, as an
    integer programme.
    """
    total = 0.0
    for slot, table in enumerate(hearing.chance):
        gain = table.toarray().astype(float) @ hearing.weight - hearing.cost[slot]
        pairs = [
            (k, b)
            for k in np.flatnonzero(hearing.manned[slot])
            for b in range(hearing.beams)
            if hearing.serves[k, hearing.array[b]]
        ]
        rows = [[k == p for k, _ in pairs] for p in range(len(hearing.serves))]
        rows += [[b == beam for _, b in pairs] for beam in range(hearing.beams)]
        limits = optimize.LinearConstraint(np.array(rows, float), ub=1)
        solved = optimize.milp(
            [-gain[b] for _, b in pairs], constraints=limits, integrality=1, bounds=(0, 1)
        )
        total -= solved.fun
    return total


@pytest.mark.thorough
@pytest.mark.parametrize("block", [1, pytest.param(0, marks=pytest.mark.thorough)])
def test_beams_that_share_a_level_count_by_their_best(block: int) -> None:
    """What the allocation tells is what NumPy makes of it, no choice of brute force is above the
    bound, and few are better.
    """
    for seed in range(15 * block, 15 * block + 15):
        hearing = replace(small(seed), shared=small(seed).array)
        found, best = processing.allocate(hearing), brute_force(hearing)
        tables = [table.toarray().astype(float) for table in hearing.chance]
        missed = np.prod(
            [silent(t, o, hearing.shared) for t, o in zip(tables, found.chosen, strict=True)],
            axis=0,
        )
        assert found.heard == pytest.approx(hearing.weight @ (1 - missed), abs=1e-9)
        assert 0.98 * best - 1e-9 <= found.value <= best + 1e-9
        assert best <= found.bound + 1e-9
        for slot, beams in enumerate(found.chosen):  # gains: by leaving each out, or adding it
            for beam in range(hearing.beams):
                other = [set(one) for one in found.chosen]
                other[slot] ^= {beam}
                rest = np.prod(
                    [
                        silent(t, tuple(o), hearing.shared)
                        for t, o in zip(tables, other, strict=True)
                    ],
                    axis=0,
                )
                change = hearing.weight @ (rest - missed) * (1 if beam in beams else -1)
                if np.isfinite(found.gain[slot, beam]):
                    assert found.gain[slot, beam] == pytest.approx(change, abs=1e-9)


@pytest.mark.parametrize("slots", [1, 3])
def test_where_nothing_is_heard_twice_it_is_highs_optimum(slots: int) -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        array = np.repeat([0, 1, 2], [5, 3, 4])
        chance = np.zeros((slots, 200, 12))
        chance[rng.integers(0, slots, 200), np.arange(200), rng.integers(0, 12, 200)] = rng.random(
            200
        )
        serves = np.array([[1, 1, 0], [0, 1, 1], [1, 0, 0], [0, 1, 0]], bool)
        manned = rng.random((slots, 4)) < 0.9
        hearing = records.hearing(
            chance, rng.random(200), array, serves, manned=manned, cost=rng.random((slots, 12)) * 4
        )
        found = processing.allocate(hearing)
        assert found.exact
        assert found.value == pytest.approx(highs(hearing), rel=1e-9)


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


def plane(power: float) -> Hearing:
    """Return the lines of the projective plane of order 2 as beams: any two hear one point in
    common.
    """
    lines = [[0, 1, 2], [0, 3, 4], [0, 5, 6], [1, 3, 5], [1, 4, 6], [2, 3, 6], [2, 4, 5]]
    chance = np.zeros((7, 7))
    for beam, points in enumerate(lines):
        chance[points, beam] = power
    return records.hearing([chance, chance], np.full(7, 1 / 7), [0] * 7, 2)


ADVERSARIES: dict[str, Callable[[], Hearing]] = {
    "sure, in a plane": lambda: plane(1.0),
    "all but sure, in a plane": lambda: plane(np.nextafter(np.float32(1), np.float32(0))),
    "in a plane, by halves": lambda: plane(0.5),
    "next to nothing": lambda: plane(1e-30),
    "all alike": lambda: records.hearing(np.full((3, 5, 4), 0.3), np.ones(5), [0, 0, 1, 1], 2),
    "one for sure and many hardly": lambda: records.hearing(
        [np.hstack([np.full((9, 1), 1e-7), np.eye(9)[:, :5]])] * 2,
        10.0 ** np.arange(-4, 5),
        [0] * 6,
        2,
    ),
    "hazards that add up": lambda: records.hearing(
        np.full((3, 4, 3), 1 - 1e-6), np.array([1, 2, 3, 1e9]), [0] * 3, 2
    ),
    "weights near nothing": lambda: records.hearing(
        np.eye(5)[None] * 0.4 + 0.2, np.full(5, 1e-200), [0] * 5, 2
    ),
    "dear": lambda: records.hearing(
        np.full((2, 3, 4), 0.5), np.ones(3), [0] * 4, 2, cost=np.full((2, 4), 0.7)
    ),
    "too dear": lambda: records.hearing(
        np.full((2, 3, 4), 0.5), np.ones(3), [0] * 4, 2, cost=np.full((2, 4), 9.0)
    ),
    "nothing heard": lambda: records.hearing(np.zeros((2, 3, 4)), np.ones(3), [0] * 4, 2),
}


@pytest.mark.parametrize("name", ADVERSARIES)
def test_the_bound_holds_against(name: str) -> None:
    hearing = ADVERSARIES[name]()
    most = brute_force(hearing)
    found = processing.allocate(hearing)
    scale = float(hearing.weight.sum())
    assert found.bound >= most - 1e-15 * scale
    assert found.value == pytest.approx(most, rel=1e-9, abs=1e-12 * scale)
    # From anywhere, even after one step or none that helps.
    rng = np.random.default_rng(1)
    for steps in (1, 2, 9):
        share = rng.random((hearing.slots, hearing.beams)) * 2 / hearing.beams
        assert relaxation.bound(hearing, share, steps=steps, gap=0.0).bound >= most - 1e-15 * scale


@pytest.mark.thorough
def test_the_relaxations_bound_is_what_a_general_solver_finds() -> None:
    """Where the exponential alone is the lesser side: its maximum over sum x = 2 by SLSQP."""
    rng = np.random.default_rng(3)
    chance, weight = 0.05 * rng.random((30, 6)) ** 3, rng.random(30)
    # many slots alike: little in each, much in all
    hearing = records.hearing([chance] * 12, weight, [0] * 6, 2)
    hazard = -np.log1p(-hearing.chance[0].toarray().T.astype(float))

    def lost(x: np.ndarray) -> float:
        return float(weight @ np.exp(-12 * hazard @ x))

    solved = optimize.minimize(
        lost, np.full(6, 1 / 3), bounds=[(0, 1)] * 6, constraints={"type": "ineq", "fun": lambda x: 2 - x.sum()},
        options={"ftol": 1e-14},
    )  # fmt: skip
    expected = float(weight.sum()) - solved.fun
    relaxed = relaxation.bound(hearing, np.zeros((12, 6)), steps=3000, gap=1e-5, soft=(1e-3, 1e-4))
    # It is no higher, and no choice is worth more; with the lesser of both sides it may be lower.
    assert processing.allocate(hearing).value <= relaxed.bound <= expected * (1 + 1e-4)


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


def passing(many: int, arrays: int, per: int, slots: int, processors: int) -> Hearing:
    """Return line arrays that targets pass on straight ways: beams leak into those beside them,
    port and starboard are one.
    """
    rng = np.random.default_rng(1)
    place, velocity = rng.normal(0, 300, (many, 2)), rng.normal(0, 8, (many, 2))
    where, heading = rng.normal(0, 250, (arrays, 2)), rng.uniform(0, np.pi, arrays)
    middle = (np.arange(per) + 0.5) / per * 2 - 1
    chance = []
    for slot in range(slots):
        columns = []
        for site, head in zip(where, heading, strict=True):
            east, north = (place + 6 * slot * velocity - site).T
            r = np.hypot(east, north)
            cosine = np.cos(np.arctan2(east, north) - head - 0.02 * slot)
            hears = (
                0.7 * np.exp(-((r / 250) ** 2)) * (0.4 + 0.6 * (np.cos(2 * np.pi * r / 60) > 0.3))
            )
            beam = np.exp(-((per * (cosine[:, None] - middle)) ** 2))
            columns.append(
                sparse.csc_array(np.where(beam * hears[:, None] < 0.003, 0, beam * hears[:, None]))
            )
        chance.append(sparse.hstack(columns))
    return records.hearing(
        chance, rng.gamma(1, 1, many) / many, np.repeat(np.arange(arrays), per), processors
    )


@pytest.mark.thorough
def test_it_comes_near_the_bound_on_a_sample_and_on_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """More particles than the sample: the bound is of all, for it is settled on them."""
    monkeypatch.setattr(processing, "SAMPLE", 2_500)
    hearing = passing(5_250, 3, 8, 8, 4)
    assert len(processing.sampled(hearing).weight) < 2_750
    found = processing.allocate(hearing)
    assert 0.97 * found.bound < found.value <= found.bound
    assert all(other.value < found.value for other in found.alternatives)
