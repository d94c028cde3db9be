"""What legs and rectangles of a plan score, against Shapely, brute force and sums by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from plans import BEGIN, HOUR, NMI, PLACE, spec, unit
from scipy import special

from drift.evidence.filter.records import Law
from drift.planning.search import joint, rectangle
from drift.planning.search import planning_tracks as record
from drift.planning.search.boats import availability
from kernels.planning import rectangles, sweeps


def test_rectangles_are_as_far_apart_as_shapely_says() -> None:
    rng = np.random.default_rng(4)
    rows = np.zeros((200, 8))
    rows[:, :2], rows[:, rectangle.TURN] = rng.uniform(-30, 30, (200, 2)), rng.uniform(0, 7, 200)
    sides = rng.uniform(2, 40, (2, 200))

    def flown(k: slice) -> rectangle.Sweeps:
        zero = np.zeros(len(rows[k]))
        return rectangle.Sweeps(
            zero,
            zero + 1,
            zero,
            zero,
            *sides[:, k],
            zero == 0,
            zero,
            np.zeros((len(zero), 2)),
            zero + 1,
        )

    def shape(k: int) -> shapely.Polygon:
        sin, cos = np.sin(rows[k, rectangle.TURN]), np.cos(rows[k, rectangle.TURN])
        a, b = (
            np.array([-1, 1, 1, -1]) * sides[0, k] / 2,
            np.array([-1, -1, 1, 1]) * sides[1, k] / 2,
        )
        return shapely.Polygon(
            np.column_stack([rows[k, 0] + a * sin + b * cos, rows[k, 1] + a * cos - b * sin])
        )

    shapes = np.array([shape(k) for k in range(200)])
    for k, found in enumerate(
        rectangle.apart(rows, flown(slice(None)), rows[:20], flown(slice(20)))
    ):
        np.testing.assert_allclose(
            np.maximum(found, 0), shapely.distance(shapes[k], shapes), atol=1e-9
        )
        np.testing.assert_array_equal(found < 1e-9, shapely.intersects(shapes[k], shapes))
    later = flown(slice(0, 1))._replace(start=np.array([500.0]))
    assert np.all(np.isinf(rectangle.apart(rows, flown(slice(None)), rows[:1], later)))


def test_legs_on_moving_particles_as_by_brute_force() -> None:
    """The hazard a / (2 r^3) of ds integrated in small steps."""
    rng = np.random.default_rng(5)
    time = np.array([0.0, 1800, 3600, 5400])
    x, y = (
        rng.uniform(-6000, 6000, 40) + np.cumsum(rng.normal(0, 400, (4, 40)), axis=0)
        for _ in range(2)
    )
    swarm = rectangles.swarm(time, x, y, np.ones((4, 40)), np.zeros(40))
    node = np.array(
        [
            [600.0, -5000, -2000],
            [1400, 5000, -2000],
            [1500, 5000, -500],
            [2300, -5000, -500],
            [4000, 5000, 3000],
        ]
    )
    node = np.column_stack([node, np.ones(5)])
    width = 1500.0
    t = np.linspace(600.0, 4000.0, 17_001)  # a fifth of a second; turns fall on it
    apart = [
        np.stack([np.interp(t, time, v[:, i]) for i in range(40)])
        - np.interp(t, node[:, 0], node[:, k])
        for k, v in ((1, x), (2, y))
    ]
    middle = [(v[:, 1:] + v[:, :-1]) / 2 for v in apart]
    rate = np.hypot(*(np.diff(v, axis=1) for v in apart)) / (2 * np.hypot(*middle) ** 3)
    near = np.hypot(*apart).min(axis=1) > 100  # there such a step is fine enough
    want = -np.expm1(-rate.sum(axis=1) * width**2 / (4 * np.pi))
    chance, worth = sweeps.found(swarm, None, node, np.array([width]), np.ones(1))
    np.testing.assert_allclose(chance[near, 0], want[near], atol=2e-4)
    assert np.all((worth == 1) | (chance[:, 0] == 0))
    gains = sweeps.gains(
        swarm,
        None,
        [node, node[:3]],
        np.array([width]),
        np.ones(1),
        np.ones((40, 1)),
        np.zeros((40, 1)),
    )
    assert gains[0] == pytest.approx(chance.sum(), rel=1e-5)
    assert gains[1] < gains[0]
    # A leg that does not search finds nothing: the exposures of the others add up
    node[1, 3] = 0
    parts = [
        sweeps.found(swarm, None, some, np.array([width]), np.ones(1))[0]
        for some in (node[:2], node[2:])
    ]
    both, _ = sweeps.found(swarm, None, node, np.array([width]), np.ones(1))
    np.testing.assert_allclose(1 - both, (1 - parts[0]) * (1 - parts[1]), atol=2e-6)
    assert both.sum() < chance.sum()
    short = node[:, :3]  # was read as other nodes, of other times and places
    with pytest.raises(ValueError, match=r"shape \(5, 3\)"):
        sweeps.found(swarm, None, short, np.array([width]), np.ones(1))
    with pytest.raises(ValueError, match=r"shape \(5, 3\)"):
        sweeps.gains(
            swarm, None, [short], np.array([width]), np.ones(1), np.ones((40, 1)), np.zeros((40, 1))
        )


def test_drifting_particles_score_alike_beside_one_that_steers() -> None:
    """Particles in vectors and one by one: 13 of them, one of whom cannot be found for a while."""
    rng = np.random.default_rng(8)
    time = np.array([0.0, 1800, 3600, 5400])
    x, y = rng.uniform(-4000, 4000, (2, 1, 13)) + np.cumsum(rng.normal(0, 400, (2, 4, 13)), axis=1)
    value = rng.uniform(0.2, 1.0, (4, 13))
    value[2, 4] = -1.0
    scenario = np.array([0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0])
    others = np.full(14, rectangles.NEVER)
    others[13] = 1e4
    alone = rectangles.swarm(time, x, y, value, scenario)
    extra = [np.column_stack([v, np.full(4, 9e5)]) for v in (x, y, value)]
    beside = rectangles.swarm(time, *extra, np.append(scenario, 0), others)
    assert alone.drifting
    assert not beside.drifting
    node = np.array([[500.0, -3000, -900, 1], [2100, 3000, 700, 0], [2200, 3000, 2000, 1]])
    node = np.concatenate([node, [[4100.0, -2500, 2200, 0]]])
    width, factor = np.array([1500.0, 0.0]), np.array([0.7, 0.7, 1.4])
    (chance, worth), (chance_beside, worth_beside) = (
        sweeps.found(swarm, None, node, width, factor) for swarm in (alone, beside)
    )
    np.testing.assert_array_equal(chance, chance_beside[:13])
    np.testing.assert_array_equal(worth, worth_beside[:13])
    assert np.all((chance[:, 0] > 0) == (scenario == 0))
    left, later = rng.uniform(0.1, 1, (2, 14, 3)) / 10
    scored = [
        sweeps.gains(swarm, None, [node[:2], node], width, factor, left[:m], later[:m])
        for swarm, m in ((alone, 13), (beside, 14))
    ]
    np.testing.assert_array_equal(*scored)
    gain = (left[:13] * (worth[:, None] - later[:13]) * chance)[scenario == 0].sum()
    assert scored[0][1] == pytest.approx(gain, rel=1e-5)
    # In a rectangle, who cannot be found at either end of a bin is not covered in it.
    table = np.array([[200.0, -100, math.sin(0.4), math.cos(0.4), 30_000, 30_000, 1900, 3400, 1]])
    curve = np.linspace(0, 1, 30)
    for random in (False, True):
        covered, _ = rectangles.found(
            alone, random, table, np.array([0.4, 0.6]), factor, 0.05, curve
        )
        assert np.all((covered[:, 0] > 0) == (np.arange(13) != 4))
        assert np.all(covered[:, 0] == covered[:, 1])


def test_smeared_legs_are_the_mean_of_legs() -> None:
    """Over a wide field of particles that drift along with the creep or against it, legs and the
    front find alike.
    """
    one = unit(40.0, 3, NMI, Law())
    plane = record.Plane(*np.radians(PLACE))
    rng = np.random.default_rng(6)
    x, y = rng.uniform(-40, 40, (2, 20_000)) * NMI
    time = np.linspace(0, 4 * HOUR, 9)
    crew = rectangle.crew(
        one, availability.of_unit(one, spec(), PLACE), plane, float(BEGIN.astype(int)), np.ones(1)
    )
    row = np.array([1000.0, -2000, 0.4, math.log(1.3 * NMI), math.log(1.5), 0, 1, -1])
    for drift in (-0.5, 0.0, 0.8):
        east, north = drift * math.cos(0.4), -drift * math.sin(0.4)
        swarm = rectangles.swarm(
            time,
            x + east * time[:, None],
            y + north * time[:, None],
            np.ones((9, len(x))),
            np.zeros(len(x)),
        )
        flown = rectangle.fly(crew, row[None, :])
        table, coverage = rectangle.smeared(crew, row[None, :], flown)
        smeared, _ = rectangles.found(
            swarm, False, table, coverage[0], np.ones(1), rectangle.STEP, crew.curve
        )
        legs, _ = sweeps.found(
            swarm, None, rectangle.path(crew, row, flown, 0), crew.width, np.ones(1)
        )
        # what spills over its edge is left out
        assert smeared.mean() == pytest.approx(legs.mean(), rel=0.08)
        share = (flown.length * flown.width)[0] / (80 * NMI) ** 2
        if drift == 0:
            assert smeared.mean() == pytest.approx(
                share * special.erf(math.sqrt(math.pi) / 2 * coverage[0, 0]), rel=0.05
            )


def test_units_of_one_group_share_what_is_not_known() -> None:
    """Twenty looks at C = 0.3, nu = 4: chance of a miss 0.026 if the factor is shared, 0.0031 if
    not (SEARCH.md).
    """
    looks = [unit(10, 1, 1, Law("random"), name=f"{k}", group="eye", shape=4.0) for k in range(20)]
    factor, weight = joint.nodes(looks)
    finds = [
        joint.Find(float(k), -np.expm1(-0.3 * factor[k])[None, :], np.ones(1)) for k in range(20)
    ]
    assert 1 - joint.worth(finds, weight)[0] == pytest.approx((1 + 6 / 4) ** -4, rel=0.01)
    pair, _ = joint.nodes([looks[0], replace(looks[1], group="other")])
    assert pair.shape == (2, 16)


def test_what_one_adds_to_others_is_the_difference_of_the_whole() -> None:
    rng = np.random.default_rng(8)
    finds = [joint.Find(t, rng.random((50, 2)), rng.random(50)) for t in (3.0, 1.0, 2.0)]
    weight = np.array([0.3, 0.7])
    for k, one in enumerate(finds):
        rest = finds[:k] + finds[k + 1 :]
        before, later = joint.others(rest, one.time, weight, 50)
        adds = np.sum(before * one.chance * (one.worth[:, None] - later), axis=1)
        np.testing.assert_allclose(
            adds, joint.worth(finds, weight) - joint.worth(rest, weight), atol=1e-12
        )


def test_nodes_at_which_a_unit_has_one_factor_count_together() -> None:
    """The gain of a sortie is the sum over all joint nodes: distributive law."""
    rng = np.random.default_rng(9)
    units = [unit(10, 1, 1, Law("random"), name=name, shape=4.0) for name in "abc"]
    factors, weight = joint.nodes(units)
    assert factors.shape == (3, 27)
    others = [joint.Find(t, rng.random((50, 27)), np.ones(50)) for t in (1.0, 3.0)]
    others[0].chance[:5] = 1.0  # nothing is left of these
    before, later = joint.others(others, 2.0, weight, 50)
    worth = rng.random((50, 1))
    for factor in factors:
        distinct, left, rest = joint.by_factor(factor, before, later)
        assert left.shape == rest.shape == (50, 3)
        np.testing.assert_allclose(
            np.sum(left * (worth - rest) * np.exp(-distinct), axis=1),
            np.sum(before * (worth - later) * np.exp(-factor), axis=1),
            atol=1e-14,
        )


@pytest.mark.parametrize("turn", [rectangles.NEVER, 600.0])
def test_a_leg_right_over_a_particle_detects_it(turn: float) -> None:
    """At range 0 inverse cube detects for certain, but never what has no sweep width."""
    still, worth = np.zeros((2, 2)), np.full((2, 2), 0.7)
    time = np.array([0.0, 1800.0])
    swarm = rectangles.swarm(time, still, still, worth, np.array([0, 1]), np.full(2, turn))
    node = np.array([[0.0, -40_000, 0, 1], [1000, 40_000, 0, 1], [1800, -24_000, 0, 1]])
    width = np.array([1500.0, 0.0])
    chance, when = sweeps.found(swarm, None, node, width, np.ones(1))
    np.testing.assert_array_equal(chance[:, 0], [1, 0])
    np.testing.assert_allclose(when, [0.7, 0], rtol=1e-6)
    left = np.ones((2, 1))
    gain = sweeps.gains(swarm, None, [node], width, np.ones(1), left, 0 * left)
    assert gain[0] == pytest.approx(0.7)
