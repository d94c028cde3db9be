"""Effort of the days ahead: against closed forms, a brute-force Monte Carlo and another optimiser."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy import optimize, stats

from drift.engine.motion.scenario import Survival
from drift.engine.particles.status import Status
from drift.evidence.suspend import decision, further

PAINTS = False  # but for one test
HOUR = 3600.0


def uniform(coverage: float, cells: int = 50) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.full((1, cells), 1 / cells), np.array([coverage * cells * 3.0]), np.full(cells, 3.0)


def test_found_alive_in_a_uniform_density_is_the_closed_form() -> None:
    """Exponential survival: the integral of c exp(-c t) exp(-m (t + t0)); random search leaves
    exp(-c t).
    """
    c, m, t0, count = 0.7, 0.9, 0.4, 3
    moments = np.append((np.arange(further.STEPS) + 0.5) / further.STEPS, 1.0)
    alive = np.exp(-m * (t0 + np.arange(count)[:, None] + moments))[..., None]
    until = np.datetime64("2026-06-01") + np.arange(1, count + 1)
    found = further.days(*uniform(c), alive, 1000.0, until)
    for day, one in enumerate(found, 1):
        assert one.pos == pytest.approx(1 - np.exp(-c * day), abs=1e-9)
        exact = np.exp(-m * t0) * c / (c + m) * -np.expm1(-(c + m) * day)
        # The middle of each part instead of its mean: at most (c + m)^2 / 24 of a part's square, of
        # the whole
        assert one.alive == pytest.approx(exact, rel=(c + m) ** 2 / 24 / further.STEPS**2)
        assert one.waiting == pytest.approx(np.exp(-c * day - m * (t0 + day)), abs=1e-9)
        # all cells alike: which one it is in changes nothing
        assert one.pos_error == pytest.approx(0.0, abs=1e-6)


def test_alive_and_found_is_that_of_a_brute_force_monte_carlo() -> None:
    """Lognormal survival, unknown release, days of random search over a uniform area: objects drawn
    one by one.
    """
    rng, n, c, days = np.random.default_rng(5), 400_000, 0.8, 4
    release = rng.uniform(0, 10, n)  # [h]
    death = release + 22 * 1.9 ** rng.standard_normal(n)
    now = 18.0
    found = now + 24 * rng.exponential(1 / c, n)
    life = Survival(22 * HOUR, 1.9)
    ages = [
        now + 24 * (d + u)
        for d in range(days)
        for u in [*(np.arange(further.STEPS) + 0.5) / further.STEPS, 1.0]
    ]
    bins = (np.arange(200) + 0.5) / 20
    alive = np.array([life.alive((age - bins) * HOUR).mean() for age in ages]).reshape(
        days, further.STEPS + 1, 1
    )
    until = np.datetime64("2026-06-01") + np.arange(1, days + 1)
    for d, one in enumerate(further.days(*uniform(c), alive, 1000.0, until), 1):
        for value, hit in (
            (one.pos, found <= now + 24 * d),
            (one.alive, (found <= now + 24 * d) & (death > found)),
            (one.waiting, (found > now + 24 * d) & (death > now + 24 * d)),
        ):
            share = hit.mean()
            assert (
                abs(value - share) <= 3 * np.sqrt(share * (1 - share) / n) + 2e-4 * share
            )  # parts of an hour: 1 / 24^3


def test_effort_over_a_circular_normal_is_koopmans_optimum() -> None:
    """1 - (1 + u) exp(-u), u = sqrt(Z / (pi s^2)) (Koopman 1980, ch. 3); cells lose second order in
    their side.
    """
    u, gaps = 1.3, []
    for count in (32, 64):
        edges = np.linspace(-6, 6, count + 1)
        line = np.diff(stats.norm.cdf(edges))
        mass, side = np.outer(line, line).ravel()[None], 12 / count
        cells = np.full(count**2, side**2)
        swept = np.array([np.pi * u**2])
        share = further.spread(mass, swept, cells)
        assert share.sum() == pytest.approx(1.0, abs=1e-12)
        gaps.append(
            1 - (1 + u) * np.exp(-u) - float((mass * -np.expm1(-swept / cells * share)).sum())
        )
    assert gaps[0] > 3 * gaps[1] > 0
    # nothing is left once extrapolated
    assert abs(gaps[1] - (gaps[0] - gaps[1]) / 3) < 0.1 * gaps[0]


def test_what_steers_or_has_stopped_is_on_the_map() -> None:
    """Of an account only what is outside, has left, sank or is not released is not."""
    chances = {status.name.lower(): 0.02 * (status + 1) for status in Status}
    data = xr.Dataset(
        {"status_probability": (("time", "status"), [list(chances.values())])},
        {"status": list(chances)},
    )
    gone = sum(chances[name] for name in ("outside", "left", "sunk", "pending"))
    assert decision.off_map(data) == pytest.approx(gone)


def test_effort_over_two_stories_is_that_of_another_optimiser() -> None:
    rng = np.random.default_rng(2)
    mass = rng.uniform(0, 1, (2, 5))
    mass /= mass.sum() * 1.1  # a part is on no map
    swept, cells = np.array([4.0, 1.5]), rng.uniform(1, 3, 5)

    def left(share: np.ndarray) -> float:
        return float((mass * np.exp(-swept[:, None] / cells * share)).sum())

    best = optimize.minimize(
        left,
        np.full(5, 0.2),
        bounds=[(0, 1)] * 5,
        constraints={"type": "eq", "fun": lambda x: x.sum() - 1},
        tol=1e-12,
    )
    assert best.success
    assert left(further.spread(mass, swept, cells)) <= best.fun + 1e-9


def test_a_plan_of_two_sorties_saves_by_the_second_only_who_the_first_missed() -> None:
    """0.6 found, 0.5 of them alive; of the 0.4 left 0.5, 0.2 of these alive: 0.3 + 0.4 * 0.1."""
    updates = [
        SimpleNamespace(
            name=name, pos=np.array([pos, pos]), alive=np.array([alive, alive]), standing=None
        )
        for name, pos, alive in (("a", 0.6, 0.3), ("b", 0.5, 0.1))
    ]
    standing: Any = SimpleNamespace(effective=100.0)
    plan = further.Planned(frozenset("ab"), np.datetime64("2026-06-16"))
    (only,), _ = further.by_plan(standing, plan, updates, [None], np.datetime64("2026-06-16"))  # type: ignore[list-item, arg-type]
    assert (only.pos, only.alive) == (pytest.approx(0.8), pytest.approx(0.34))
