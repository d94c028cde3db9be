"""The upper bound against optimal search theory: closed forms, water-filling, and plans that it must not fall below."""

import numpy as np
import pytest
from plans import HOUR, NMI, cloud, spec, speed_for, tracks, unit
from scipy import integrate, optimize

from drift import bound, concave, detection
from drift.quadtree import Quadtree
from drift.sortie import Law, Survival
from kernels import allocate

STD = 5 * NMI
LAWS = [Law(), Law("random"), Law("definite_range"), Law("m_beta", beta=0.7)]


def found(u: float, law: Law, drift: tuple[float, float] = (0.0, 0.0), m: int = 2**15) -> bound.Bound:
    some = cloud(m, STD, drift=drift)
    return bound.bound(some, [unit(speed_for(u, STD, 4, NMI), 4, NMI, law)], spec(), [None])


@pytest.mark.parametrize(("u", "optimum"), [(1.0, 1 - 2 * np.exp(-1)), (2.0, 1 - 3 * np.exp(-2))])
def test_random_search_of_a_circular_normal(u: float, optimum: float) -> None:
    """Koopman 1957: 1 - (1 + u) e^-u."""
    assert found(u, Law("random")).value == pytest.approx(optimum, rel=0.01)


def filled(u: float, law: Law) -> float:
    """Water-filling: b'(C(r)) rho(r) = price wherever C > 0; radii in units of the standard deviation."""
    grid = np.linspace(0, 6, 6001)
    slope = np.gradient(detection.pod(law, grid), grid)
    radius = np.linspace(0, 5, 2001)
    rho = np.exp(-(radius**2) / 2) / (2 * np.pi)

    def coverage(price: float) -> np.ndarray:
        return np.interp(-price / rho, -slope, grid, left=0.0)

    def effort(price: float) -> float:
        return float(integrate.trapezoid(2 * np.pi * radius * coverage(price), radius))

    price = optimize.brentq(lambda p: effort(p) - np.pi * u * u, 1e-7, 1 / (2 * np.pi))
    return float(integrate.trapezoid(2 * np.pi * radius * rho * detection.pod(law, coverage(price)), radius))


@pytest.mark.parametrize("u", [1.0, 2.0])
def test_inverse_cube_of_a_circular_normal(u: float) -> None:
    assert found(u, Law()).value == pytest.approx(filled(u, Law()), rel=0.01)


def test_a_bound_of_random_search_does_not_bound_inverse_cube() -> None:
    """One square by inverse cube finds 0.315 where the best random search finds 0.264 (SEARCH.md)."""
    assert found(1.0, Law("random")).value < 0.27
    assert found(1.0, Law()).value > 0.315


def test_definite_range_of_a_circular_normal() -> None:
    """A disc searched once: 1 - exp(-u^2 / 2). Its kink leaves the bound looser, and the edge of the disc cuts cells."""
    for u in (1.0, 2.0):
        assert 0.99 < found(u, Law("definite_range")).value / (1 - np.exp(-u * u / 2)) < 1.025


def test_a_cloud_that_drifts_as_one_is_as_hard_as_one_that_stays() -> None:
    still, moving = found(1.0, Law("random")).value, found(1.0, Law("random"), drift=(0.4, -0.3)).value
    assert moving == pytest.approx(still, rel=0.03)
    assert moving > still * 0.995


def test_soral() -> None:
    """SORAL's test bed (Soza 1996): four areas, 40 hours at a sweep rate of one: POS 0.4493."""
    area, chance = np.array([28.0, 30, 14, 12]), np.array([0.1935, 0.2581, 0.2903, 0.2581])
    curve = concave.curve([Law("random")])
    one = np.zeros((1, 4))
    field = allocate.Field(
        np.arange(4)[None, :], 4, one + 1, one, np.zeros(4), chance, np.ones((1, 1)), np.ones(1),
        (curve.value, curve.slope, curve.conjugate), concave.STEP,
    )  # fmt: skip
    budget = bound.Budget(np.array([0, 4]), np.full((1, 1), 40.0), np.array([40.0]), np.ones((4, 1), bool))
    cells = Areas(area)
    made = bound.ascend(field, budget, cells)
    assert made.spread == pytest.approx(0.4493, abs=2e-3)
    assert 0.4493 - 1e-4 < made.value < 0.4493 + 2e-3
    assert made.effort.sum() <= 40 + 1e-6


class Areas(Quadtree):
    """Cells of given areas."""

    def __init__(self, area: np.ndarray) -> None:
        object.__setattr__(self, "_area", area)

    @property
    def area(self) -> np.ndarray:
        return self._area  # type: ignore[attr-defined,no-any-return]


def test_it_is_a_bound_at_any_effort() -> None:
    """At efforts drawn at random, however bad, the dual value is no less than the best that was found."""
    some = cloud(2**12, STD)
    units = [unit(30.0, 3, NMI, Law()), unit(60.0, 1, 2 * NMI, Law(), name="B")]
    best = bound.bound(some, units, spec(), [None])
    field, budget = bound._field(some, units, spec(), [None], best.cells)
    rng = np.random.default_rng(1)
    for _ in range(20):
        raw = rng.exponential(size=best.effort.shape) ** 4
        effort = bound.project(raw * 1e4, np.ones(raw.shape), budget)
        assert np.all(np.add.reduceat(effort, budget.start[:-1]) <= budget.most + 1e-3)
        assert np.all(effort.sum(axis=0) <= budget.total * (1 + 1e-6))
        value, rest = field.spend(effort / best.cells.area[:, None])
        gains = bound._best(field.gain() / best.cells.area[:, None], budget)[1]
        assert rest + gains.sum() >= best.spread
        assert value <= best.value


def test_mixed_laws_never_exceed_the_curve() -> None:
    """Any split of coverage over laws and sorties finds no more than the curve at its sum."""
    rng = np.random.default_rng(2)
    bumpy = Law("curve", ranges=(0.0, 900.0, 1000.0, 1400.0), chances=(0.2, 0.2, 0.9, 0.0))
    for laws in ([Law()], [Law("m_beta", beta=0.6)], [*LAWS, bumpy], [Law("random"), Law("m_beta", beta=0.9)]):
        curve = concave.curve(laws)
        grid = np.arange(len(curve.value)) * concave.STEP
        for _ in range(300):
            parts = rng.exponential(0.4, rng.integers(1, 5))
            miss = np.prod([1 - detection.pod(laws[rng.integers(len(laws))], c) for c in parts])
            limit = np.min(curve.conjugate + curve.slope[0] * np.linspace(0, 1, len(grid)) * parts.sum())
            assert 1 - miss <= limit + 5e-3


def test_one_law_is_its_own_bound() -> None:
    c = np.linspace(0, 3, 61)
    for law in LAWS:
        curve = concave.curve([law])
        y = curve.slope[0] * np.linspace(0, 1, len(curve.conjugate))
        limit = np.min(curve.conjugate + y * c[:, None], axis=1)
        np.testing.assert_allclose(limit, detection.pod(law, c), atol=2e-3)


def test_unknown_sweep_width_lowers_the_bound_as_gamma_does() -> None:
    """1 - (1 + C / nu)^-nu for random search; two groups share evenly: shape 2 nu."""
    c = np.linspace(0, 3, 31)
    for shapes, nu in (((4.0,), 4.0), ((4.0, 3.0), 8.0)):
        curve = concave.curve([Law("random")], shapes)
        y = curve.slope[0] * np.linspace(0, 1, len(curve.conjugate))
        limit = np.min(curve.conjugate + y * c[:, None], axis=1)
        np.testing.assert_allclose(limit, 1 - (1 + c / nu) ** -nu, atol=2e-3)


def test_alive_is_worth_what_is_left_of_life() -> None:
    """One cell, random search as fast as can be: sum of a(t) (e^-C(t-1) - e^-C(t)), a at each bin's begin."""
    rng = np.random.default_rng(0)
    some = tracks(*rng.uniform(-1, 1, (2, 200)), hours=4, bins=4, drift=(0.0, 0.0))
    # The square that is divided is half as large again as what the points span.
    life = Survival(2 * HOUR, 1.8)
    x, y = bound._middles(some, bound.record.plane(some))
    side = bound.quadtree.grow(x, y, some.weight, 1e9).side
    one = unit(side**2 / (2 * HOUR), 4, 1.0, Law("random"))  # coverage 1 in two hours
    made = bound.bound(some, [one], spec(objective="alive"), [life])
    left = np.exp(-0.5 * np.arange(5))
    alive = life.alive(np.arange(4) * HOUR)
    assert made.value == pytest.approx(float(np.sum(alive * -np.diff(left))), abs=2e-3)


def test_a_unit_that_arrives_late_can_do_less() -> None:
    some = cloud(2**12, STD)
    whole = bound.bound(some, [unit(30.0, 4, NMI, Law())], spec(), [None]).value
    late = unit(30.0, 4, NMI, Law(), ready=spec().begin + np.timedelta64(2, "h"))
    half = bound.bound(some, [unit(30.0, 2, NMI, Law())], spec(), [None]).value
    assert bound.bound(some, [late], spec(), [None]).value == pytest.approx(half, abs=2e-3)
    assert half < whole
    never = unit(30.0, 4, NMI, Law(), ready=spec().until)
    assert bound.bound(some, [never], spec(), [None]).value == pytest.approx(0, abs=1e-4)
