"""Bounds of an allocation of processing: against HiGHS where it is linear, a general solver and
brute force.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from allocations import brute_force, silent, small
from scipy import optimize, sparse

from drift.planning.arrays import processing, records, relaxation
from drift.planning.arrays.records import Hearing


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
