"""The upper bound against optimal search theory: closed forms, water-filling, and plans that it
must not fall below.
"""

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from plans import HOUR, NMI, PLACE, cloud, spec, speed_for, tracks, unit
from scipy import integrate, optimize, special

from drift.engine.motion.scenario import Survival
from drift.evidence.filter.detection import laws
from drift.evidence.filter.records import Law
from drift.planning.search import bins as binned
from drift.planning.search import bound, concave
from drift.planning.search import planning_tracks as record
from geo import sphere
from kernels.planning import allocate

STD = 5 * NMI
LAWS = [Law(), Law("random"), Law("definite_range"), Law("m_beta", beta=0.7)]


def found(
    u: float, law: Law, drift: tuple[float, float] = (0.0, 0.0), m: int = 2**14
) -> bound.Bound:
    some = cloud(m, STD, drift=drift)
    return bound.bound(some, [unit(speed_for(u, STD, 4, NMI), 4, NMI, law)], spec(), [None])


def filled(u: float, b: Callable[[np.ndarray], np.ndarray]) -> float:
    """Water-filling: b'(C(r)) rho(r) = price wherever C > 0; radii in units of the standard
    deviation.
    """
    grid = np.linspace(0, 6, 6001)
    found = b(grid)
    slope = np.gradient(found, grid)
    radius = np.linspace(0, 5, 2001)
    rho = np.exp(-(radius**2) / 2) / (2 * np.pi)

    def coverage(price: float) -> np.ndarray:
        return np.interp(-price / rho, -slope, grid, left=0.0)

    def effort(price: float) -> float:
        return float(integrate.trapezoid(2 * np.pi * radius * coverage(price), radius))

    price = optimize.brentq(lambda p: effort(p) - np.pi * u * u, 1e-7, 1 / (2 * np.pi))
    return float(
        integrate.trapezoid(
            2 * np.pi * radius * rho * np.interp(coverage(price), grid, found), radius
        )
    )


def any_legs(c: np.ndarray) -> np.ndarray:
    """What any legs of inverse cube find at the most, in closed form."""
    return 1 - np.exp(-4 * c * c / np.pi) + c * special.erfc(2 * c / np.sqrt(np.pi))


@pytest.mark.thorough
@pytest.mark.parametrize("u", [pytest.param(0.6, marks=pytest.mark.thorough), 1.9])
def test_a_circular_normal(u: float) -> None:
    """Koopman 1957: 1 - (1 + u) e^-u; a disc searched once: 1 - exp(-u^2 / 2).

    Never below, and little above.
    """
    optima = [
        (Law("random"), 1 - (1 + u) * np.exp(-u)),
        (Law("definite_range"), 1 - np.exp(-u * u / 2)),
    ]
    for law, optimum in [*optima, (Law(), filled(u, any_legs))]:
        assert 1 < found(u, law).value / optimum < 1.05
    # parallel sweeps find less
    assert filled(u, lambda c: laws.pod(Law(), c)) < filled(u, any_legs)


@pytest.mark.thorough
@pytest.mark.parametrize("grows", [4.0, 0.25])
def test_a_circular_normal_that_grows_or_shrinks(grows: float) -> None:
    """As Koopman's that stands still, an hour's search counting by 1 over the square of how wide
    the cloud is then: 1 / grows in all.
    """
    u, std = 1.1, 20 * NMI
    still = cloud(2**14, std, bins=12)
    wide = np.linspace(1, grows, 13)[:, None]
    x, y = sphere.offset(
        *np.radians(PLACE), *(np.radians(sphere.to_degrees(v[0])) for v in (still.lon, still.lat))
    )
    lon, lat = sphere.destination(*np.radians(PLACE), x * wide, y * wide)
    some = replace(
        still, lon=sphere.to_binary(np.degrees(lon)), lat=sphere.to_binary(np.degrees(lat))
    )
    one = unit(speed_for(u, std, 4, NMI) * grows, 4, NMI, Law("random"))
    optimum = 1 - (1 + u) * np.exp(-u)
    value = bound.bound(some, [one], spec(), [None]).value
    # Above it by what a standing cloud's is, and by bins that count as when the cloud is densest in
    # them; particles' own speed is 1.3 % of the unit's.
    w = u * np.sqrt(max(grows, 1 / grows) ** (1 / binned.FEWEST) * 1.013)
    assert optimum < value < 1.05 * (1 - (1 + w) * np.exp(-w))


def test_few_particles_leave_it_above() -> None:
    """Noise raises it: at 1,000 random particles, on the whole, no less than what is true."""
    rng = np.random.default_rng(11)
    for u in (0.5, 1.0, 2.0):
        one = unit(speed_for(u, STD, 4, NMI), 4, NMI, Law("random"))
        values = [
            bound.bound(
                tracks(*(STD * rng.standard_normal((2, 1000))), 4, 4, (0.1, 0.0)),
                [one],
                spec(),
                [None],
            ).value
            for _ in range(2)
        ]
        assert np.mean(values) > 1 - (1 + u) * np.exp(-u)


@pytest.mark.thorough
def test_a_box_that_can_be_swept_once() -> None:
    """An even prior with sharp edges, definite range: what is swept, to the edge; tight boxes lose
    none of it outside.
    """
    rng = np.random.default_rng(4)
    for share in (0.5, 0.97):
        x, y = rng.uniform(-1, 1, (2, 20_000)) * np.array([[8 * NMI], [3 * NMI]])
        cos, sin = np.cos(0.3), np.sin(0.3)
        some = tracks(x * cos - y * sin, x * sin + y * cos, 4, 4, (0.0, 0.0))
        one = unit(share * 96 * NMI**2 / (NMI * 4 * HOUR), 4, NMI, Law("definite_range"))
        # Boxes of 78 particles: as tight as these, (1 + 2 / 77)^2 too dense; the half that looks
        # densest by 0.8 / sqrt(78) more.
        dense = (1 + 2 / 77) ** 2 * (1 + 0.8 / np.sqrt(78))
        assert share < bound.bound(some, [one], spec(), [None]).value < min(dense * share, 1.0001)


def hazards(path: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the sum over legs of 1/2 1/d^2 [s / r], the hazard of inverse cube for W = 2 sqrt(pi)."""
    total = np.zeros(x.shape)
    for (x0, y0), (x1, y1) in itertools.pairwise(path):
        long = np.hypot(x1 - x0, y1 - y0)
        ex, ey = (x1 - x0) / long, (y1 - y0) / long
        along, aside = (x - x0) * ex + (y - y0) * ey, (x - x0) * ey - (y - y0) * ex
        total += (
            0.5
            * (along / np.hypot(along, aside) - (along - long) / np.hypot(along - long, aside))
            / aside**2
        )
    return total


def test_no_legs_find_more_than_the_curve() -> None:
    """Brute force: legs parallel, crossing, at random, short squares; what they find inside and
    outside of an area counts as in it.
    """
    rng = np.random.default_rng(8)
    width, side = 2 * np.sqrt(np.pi), 40.0
    grid = (np.arange(250) + 0.5) / 250 * side
    x, y = np.meshgrid(grid, grid + 0.0123)
    turns = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
    sets: list[list[np.ndarray]] = []
    for gap in (2.0, 4.0, 8.0):
        lines = np.arange(gap / 2, side, gap) + 0.001
        sets.append([np.array([(0, v), (side, v)]) for v in lines])
        sets.append([*sets[-1], *(np.array([(v, 0), (v, side)]) for v in lines)])
    for reach in (0.5, 3.0):
        steps = np.repeat(np.arange(1, 9), 2)[:, None] * reach * turns[np.arange(16) % 4]
        squares = np.cumsum(np.concatenate([[(0.3, 0.2)], steps]), axis=0)
        sets.append([squares + rng.uniform(8, 32, 2) for _ in range(4)])
    sets.append([rng.uniform(0, side, (2, 2)) for _ in range(20)])
    sets.append([rng.uniform(0, side, (12, 2))])
    shares = []
    for paths in sets:
        hazard = sum(hazards(path, x, y) for path in paths)
        length = sum(np.hypot(*np.diff(path, axis=0).T).sum() for path in paths)
        coverage = (width * length + len(paths) * laws.ENDS * width**2) / side**2
        limit = float(concave.most([Law()], np.array([coverage]))[0])
        np.testing.assert_allclose(limit, any_legs(np.array([coverage]))[0], atol=2e-5)
        shares.append(np.mean(-np.expm1(-hazard)) / limit)
    assert max(shares) <= 1
    assert max(shares) > 0.93  # it is not loose either


def test_what_a_leg_that_ends_adds() -> None:
    """min(H, h) of a straight leg over the plane, by brute force: 2 sqrt(h / pi) W L, and at most
    W^2 / 4 for its ends.
    """
    width = 2 * np.sqrt(np.pi)
    u = (np.arange(800) + 0.5) / 800
    far = 200.0
    for long in (0.5, 3.0, 20.0):
        y, dy = far * u**4, 4 * far * u**3 / 800
        x = np.concatenate([long / 2 * u, long / 2 + far * u**4])
        dx = np.concatenate([np.full(800, long / 2 / 800), 4 * far * u**3 / 800])
        hazard = hazards(np.array([(-long / 2, 0.0), (long / 2, 0.0)]), *np.meshgrid(x, y))
        for h in (0.3, 1.0):
            whole = 4 * float(dy @ np.minimum(hazard, h) @ dx)
            ends = whole - 2 * np.sqrt(h / np.pi) * width * long
            assert 0.3 < ends / (laws.ENDS * width**2) < 1.003


def test_a_cloud_that_drifts_as_one_is_as_hard_as_one_that_stays() -> None:
    still, moving = (
        found(1.0, Law("random"), drift, 2**12).value for drift in ((0.0, 0.0), (0.4, -0.3))
    )
    assert moving == pytest.approx(still, rel=0.03)
    assert moving > still * 0.995


def test_legs_against_the_drift_count_for_more() -> None:
    """A boat of 8 kn in a current of 1 kn: as good as one of 9 kn in still water, no more."""
    knot = NMI / HOUR
    fast = bound.bound(cloud(2**12, STD), [unit(9 * knot, 4, NMI, Law())], spec(), [None]).value
    slow = bound.bound(
        cloud(2**12, STD, drift=(0.6 * knot, 0.8 * knot)),
        [unit(8 * knot, 4, NMI, Law())],
        spec(),
        [None],
    )
    assert slow.value == pytest.approx(fast, rel=0.02)


def test_soral() -> None:
    """SORAL's test bed (Soza 1996): four areas, 40 hours at a sweep rate of one: POS 0.4493."""
    area, chance = np.array([28.0, 30, 14, 12]), np.array([0.1935, 0.2581, 0.2903, 0.2581])
    curve = concave.curve((Law("random"),))
    none = np.zeros((1, 4))
    field = allocate.Field(
        np.arange(4)[None, :], 4, none + 1, none, np.zeros(4), chance, np.ones((1, 1)), np.ones(1),
        (curve.value, curve.slope, curve.conjugate), concave.STEP,
    )  # fmt: skip
    budget = bound.Budget(
        np.array([0, 4]), np.full((1, 1), 40.0), np.array([40.0]), np.ones((4, 1), bool)
    )
    made = bound.ascend(field, budget, area)
    assert made.spread == pytest.approx(0.4493, abs=2e-3)
    assert 0.4493 - 1e-4 < made.value < 0.4493 + 2e-3
    assert made.effort.sum() <= 40 + 1e-6


def test_it_is_a_bound_at_any_effort() -> None:
    """At efforts drawn at random, however bad, the dual value is no less than the best that was
    found.
    """
    some = cloud(2**12, STD)
    units = [unit(30.0, 3, NMI, Law()), unit(60.0, 1, 2 * NMI, Law(), name="B")]
    best = bound.bound(some, units, spec(), [None])
    field, budget, area, _ = bound._field(record.sort(some), units, spec(), [None])
    rng = np.random.default_rng(1)
    for _ in range(20):
        raw = rng.exponential(size=best.effort.shape) ** 4
        effort = bound.project(raw * 1e4, np.ones(raw.shape), budget)
        assert np.all(np.add.reduceat(effort, budget.start[:-1]) <= budget.most + 1e-3)
        assert np.all(effort.sum(axis=0) <= budget.total * (1 + 1e-6))
        value, rest = field.spend(effort / area[:, None])
        gains = bound._best(field.gain() / area[:, None], budget)[1]
        assert rest + gains.sum() >= best.spread
        assert value <= best.value


def limit_of(curve: concave.Curve, c: np.ndarray) -> np.ndarray:
    """Return what the conjugate bounds at coverages c: min over slopes of b*(y) + y c."""
    y = curve.slope[0] * np.linspace(0, 1, len(curve.conjugate))
    return np.min(curve.conjugate + y * np.asarray(c)[..., None], axis=-1)


def test_mixed_laws_never_exceed_the_curve() -> None:
    """Any split of coverage over laws and sorties finds no more than the curve at its sum."""
    rng = np.random.default_rng(2)
    bumpy = Law("curve", ranges=(0.0, 900.0, 1000.0, 1400.0), chances=(0.2, 0.2, 0.9, 0.0))
    for used in (
        [Law()],
        [Law("m_beta", beta=0.6)],
        [*LAWS, bumpy],
        [Law("random"), Law("m_beta", beta=0.9)],
        [bumpy],
    ):
        curve = concave.curve(tuple(used))
        for _ in range(300):
            parts = rng.exponential(0.4, rng.integers(1, 5))
            miss = np.prod([1 - laws.pod(used[rng.integers(len(used))], c) for c in parts])
            # laws.pod averages a curve at 2,000 offsets of up to 40 W: 0.02 W, of which its kinks
            # notice a hundredth part
            rough = 1e-4 if bumpy in used else 1e-12
            assert 1 - miss <= limit_of(curve, parts.sum()) * (1 + rough)


def test_laws_whose_bound_is_known() -> None:
    c = np.linspace(0, 3, 61)
    for law in LAWS[1:]:
        np.testing.assert_allclose(limit_of(concave.curve((law,)), c), laws.pod(law, c), atol=2e-3)
    np.testing.assert_allclose(limit_of(concave.curve((Law(),)), c), any_legs(c), atol=2e-4)
    assert np.all(limit_of(concave.curve((Law(),)), c) >= any_legs(c) - 1e-7)


@pytest.mark.thorough
@pytest.mark.parametrize("wander", [0.05, 0.6])
def test_no_more_is_found_of_what_wanders_than_its_curve(wander: float) -> None:
    """Brownian motion past a sensor of inverse cube, by small steps: min(H, h) over the area swept,
    and 1 - e^-H, from below.
    """
    rng = np.random.default_rng(4)
    long, dt, aside = 30.0, 0.02, 3 + 4 * np.sqrt(wander * 30)
    side = np.array([long + 2 * aside, 2 * aside])
    at = rng.uniform(0, 1, (12_000, 2)) * side - aside
    hazard = np.zeros(len(at))
    for k in range(round(long / dt)):
        hazard += dt / (8 * np.pi * np.hypot(at[:, 0] - (k + 0.5) * dt, at[:, 1]) ** 3)
        at += np.sqrt(wander * dt) * rng.standard_normal(at.shape)
    per_area = np.prod(side) / long
    h = np.array([0.2, 1.0, 3.0])
    # A tenth more for where it begins: a circle gathers faster at first.
    seen = np.minimum(hazard[:, None], h).mean(axis=0) * per_area
    assert np.all(seen < 1.1 * concave.wandering(h, wander))
    assert np.all(seen > 0.5 * concave.wandering(h, wander))
    thin = concave.most([Law()], np.array([1e-3]), wander)[0] / 1e-3
    assert 0.5 * thin < -np.expm1(-hazard).mean() * per_area < thin


def test_unknown_sweep_width_lowers_the_bound_as_gamma_does() -> None:
    """1 - (1 + C / nu)^-nu for random search; two groups share evenly: shape 2 nu."""
    c = np.linspace(0, 3, 31)
    for shapes, nu in (((4.0,), 4.0), ((4.0, 3.0), 8.0)):
        curve = concave.curve((Law("random"),), shapes)
        np.testing.assert_allclose(limit_of(curve, c), 1 - (1 + c / nu) ** -nu, atol=2e-3)


def test_alive_is_worth_what_is_left_of_life(monkeypatch: pytest.MonkeyPatch) -> None:
    """One box, random search as fast as can be: sum of a(t) (e^-C(t-1) - e^-C(t)), a at each bin's
    begin.
    """
    monkeypatch.setattr(bound, "LEAST", 1e9)
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-1e4, 1e4, (2, 200))
    some = tracks(x, y, hours=4, bins=4, drift=(0.0, 0.0))
    life = Survival(2 * HOUR, 1.8)
    one = unit(np.ptp(x) * np.ptp(y) / (2 * HOUR), 4, 1.0, Law("random"))  # coverage 1 in two hours
    made = bound.bound(some, [one], spec(objective="alive"), [life])
    bins = binned.FEWEST
    left = np.exp(-2 / bins * np.arange(bins + 1))
    alive = life.alive(np.arange(bins) * 4 * HOUR / bins)
    assert made.value == pytest.approx(float(np.sum(alive * -np.diff(left))), abs=2e-3)


def test_a_unit_that_arrives_late_can_do_less() -> None:
    some = cloud(2**11, STD)
    whole = bound.bound(some, [unit(30.0, 4, NMI, Law())], spec(), [None]).value
    late = unit(30.0, 4, NMI, Law(), ready=spec().begin + np.timedelta64(2, "h"))
    half = bound.bound(some, [unit(30.0, 2, NMI, Law())], spec(), [None]).value
    assert bound.bound(some, [late], spec(), [None]).value == pytest.approx(half, abs=2e-3)
    assert half < whole
    never = unit(30.0, 4, NMI, Law(), ready=spec().until)
    assert bound.bound(some, [never], spec(), [None]).value == pytest.approx(0, abs=1e-4)


def test_where_it_tells_nothing_it_says_why() -> None:
    assert bound.silent(0.8, 5000, 0.01, 0.7, 0.7) == ""
    assert "only 900 effective particles" in bound.silent(0.8, 900, 0.01, 0.7, 0.7)
    assert "near 1" in bound.silent(0.999, 5000, 0.01, 0.7, 0.7)
    assert "sampling error is too large (0.12)" in bound.silent(0.8, 5000, 0.06, 0.7, 0.7)
    for seen, scored in ((0.81, 0.7), (0.7, 0.83)):
        assert "more than the estimate" in bound.silent(0.8, 5000, 0.01, seen, scored)
    # It speaks up to where these begin: as many particles, as high, as unsure, and a plan that is
    # all that was computed.
    assert bound.silent(0.8, 1000, 0.01, 0.7, 0.7) == ""
    assert bound.silent(0.995, 5000, 0.01, 0.7, 0.7) == ""
    assert bound.silent(0.8, 5000, 0.05, 0.7, 0.7) == ""
    assert bound.silent(0.8, 5000, 0.01, 0.8, 0.82) == ""
