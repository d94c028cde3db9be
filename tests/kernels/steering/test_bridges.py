"""Brownian bridges of targets that steer: widths, ends and way points against NumPy and closed
forms.
"""

import numpy as np
import pytest
from targets import HOUR, NMI, PERIOD, Fleet

from drift.engine.motion.steering.itinerary import (
    NONE,
    Itinerary,
    Near,
    Spread,
    WayPoint,
    Ways,
)
from drift.engine.particles.status import Status
from geo import sphere
from kernels.step.advance import Step

K12 = 12 * NMI / 60  # [m/sqrt(s)] 12 nmi/sqrt(h)


def at(lon: float, lat: float) -> Near:
    return Near(np.radians(lon), np.radians(lat))


def reached(place: object, hours: float) -> WayPoint:
    return WayPoint(place, Spread(hours * HOUR, hours * HOUR, hours * HOUR))  # type: ignore[arg-type]


def bridge(k: float, *points: WayPoint) -> Itinerary:
    return Itinerary(
        (Ways((WayPoint(at(*BEGIN), NONE), *points), PERIOD.start, k=k),), land="ignore"
    )


BEGIN = (171.3, -37.2)


@pytest.mark.parametrize("steps", [25, 100, 500])
def test_a_bridge_in_the_plane(steps: int) -> None:
    """Equations 2 and 3 at five times, for any number of steps; ends 280 nmi apart across the
    antimeridian.
    """
    n, hours = 4_000, 50.0
    fleet = Fleet(bridge(K12, reached(at(177.0, -37.9), hours)), n)
    step, mean0 = int(hours * HOUR / steps), np.radians(BEGIN)
    way = np.array(sphere.offset(*mean0, np.radians(177.0), np.radians(-37.9)))
    before = 0.0
    for share in (0.2, 0.4, 0.52, 0.8, 0.96):
        fleet.go(share * hours * HOUR, step, before)
        before = share * hours * HOUR
        centre = sphere.destination(*mean0, *(share * way))
        east, north = sphere.offset(*centre, np.radians(fleet["lon"]), np.radians(fleet["lat"]))
        std = K12 * np.sqrt(share * (1 - share) * hours * HOUR)
        for x in (east, north):
            # metres: the ways' curvature within a cloud of 42 nmi
            assert abs(x.mean()) < 4 * std / np.sqrt(n) + 60.0
            assert abs(x.std() / std - 1) < 4 / np.sqrt(2 * n)
        assert abs(np.corrcoef(east, north)[0, 1]) < 4 / np.sqrt(n)
    fleet.go(hours * HOUR, step, before)
    assert (fleet["status"] == Status.ARRIVED).all()
    np.testing.assert_allclose(fleet["lon"], 177.0, atol=1e-6)
    np.testing.assert_allclose(fleet["lat"], -37.9, atol=1e-6)


def _sphere_bridge(
    rng: np.random.Generator, n: int, steps: int, k: float, hours: float, far: float
) -> tuple:
    """Return deviations along and across [m] midway of bridges `far` [rad] long, in three
    dimensions, in fine steps.

    Brownian motion on the sphere with a drift toward the end, the logarithm over the time that is
    left: a guided process whose law near the great circle is the bridge's.
    """
    x = np.zeros((n, 3))
    x[:, 0] = 1.0
    end = np.array([np.cos(far), np.sin(far), 0.0])
    dt, total = hours * HOUR / steps, hours * HOUR
    for j in range(steps // 2):
        left = total - j * dt
        cosine = np.clip(x @ end, -1, 1)
        tangent = end - cosine[:, None] * x
        tangent *= (np.arccos(cosine) / np.linalg.norm(tangent, axis=1))[:, None]
        noise = rng.normal(size=(n, 3)) * k * np.sqrt(dt) / sphere.RADIUS
        noise -= (noise * x).sum(axis=1)[:, None] * x
        # The variance that the bridge's own law has in a step: it shrinks as the end comes near.
        move = tangent * dt / left + noise * np.sqrt((left - dt) / left)
        angle = np.linalg.norm(move, axis=1)[:, None]
        x = np.cos(angle) * x + np.sinc(angle / np.pi) * move
    return np.arctan2(x[:, 1], x[:, 0]) * sphere.RADIUS, np.arcsin(x[:, 2]) * sphere.RADIUS


@pytest.mark.parametrize("steps", [2, 20, 200])
def test_a_bridge_of_six_thousand_miles(steps: int) -> None:
    """Midway across it deviates by 140 nmi (K 24 nmi/sqrt(h), 100 h), as a fine simulation in three
    dimensions does.
    """
    n, hours, far = 20_000, 100, np.radians(100.0)
    fleet = Fleet(
        Itinerary(
            (
                Ways(
                    (WayPoint(at(-60.0, 0.0), NONE), reached(at(40.0, 0.0), hours)),
                    PERIOD.start,
                    k=2 * K12,
                ),
            ),
            land="ignore",
        ),
        n,
    )
    fleet.go(hours * HOUR / 2, hours * HOUR // steps)
    across, along = (
        np.radians(fleet["lat"]) * sphere.RADIUS,
        np.radians(fleet["lon"] + 60.0) * sphere.RADIUS,
    )
    closed = 2 * K12 * np.sqrt(hours * HOUR * np.tan(far / 2) / (2 * far))
    assert abs(closed / NMI - 140.2) < 0.1
    assert abs(across.std() / closed - 1) < 4 / np.sqrt(2 * n)
    assert abs(along.std() / (K12 * np.sqrt(hours * HOUR)) - 1) < 4 / np.sqrt(2 * n)
    assert abs(along.mean() - far / 2 * sphere.RADIUS) < 4 * along.std() / np.sqrt(n) + 300.0
    if steps == 20:
        fine_along, fine_across = _sphere_bridge(
            np.random.default_rng(3), n, 400, 2 * K12, hours, far
        )
        assert abs(across.std() / fine_across.std() - 1) < 4 / np.sqrt(n)
        assert abs(along.std() / fine_along.std() - 1) < 4 / np.sqrt(n)


def test_way_points_inside_a_step_are_reached_in_it() -> None:
    """A right-angle turn within a step: positions inside it lie on both legs, not on the chord."""
    points = (reached(at(171.3, -36.9), 0.9), reached(at(171.8, -36.9), 2.1))
    fleet = Fleet(bridge(0.0, *points), 3)
    inside = fleet.within(Step(0, 0, 2 * HOUR, 1), [0, 1000, 3240, 5000, 7200])
    lon, lat = (np.array([place[k][0] for place in inside]) for k in (0, 1))
    share = (np.array([5000, 7200]) - 3240) / (1.2 * HOUR)
    np.testing.assert_allclose(lat[:3], -37.2 + 0.3 * np.array([0, 1000 / 3240, 1]), atol=2e-6)
    np.testing.assert_allclose(lon[:3], 171.3, atol=1e-6)
    east, north = sphere.offset(*np.radians((171.3, -36.9)), *np.radians((171.8, -36.9)))
    x, y = sphere.destination(*np.radians((171.3, -36.9)), share * east, share * north)
    np.testing.assert_allclose(np.radians(lon[3:]), x, atol=2e-8)
    np.testing.assert_allclose(np.radians(lat[3:]), y, atol=2e-8)
    assert fleet["lon"][0] == pytest.approx(lon[4], abs=1e-6)


def test_inside_a_step_a_bridge_is_as_wide_as_at_its_end() -> None:
    """At 0.3 of a long step the law is equation 3, given that the end was drawn first."""
    n, hours = 20_000, 50.0
    fleet = Fleet(bridge(K12, reached(at(177.0, -37.9), hours)), n)
    ((lon, lat),) = fleet.within(Step(4, 0, 40 * HOUR, 1), [15 * HOUR])
    way = np.array(sphere.offset(*np.radians(BEGIN), np.radians(177.0), np.radians(-37.9)))
    centre = sphere.destination(*np.radians(BEGIN), *(0.3 * way))
    east, north = sphere.offset(*centre, np.radians(lon), np.radians(lat))
    std = K12 * np.sqrt(0.3 * 0.7 * hours * HOUR)
    for x in (east, north):
        assert abs(x.std() / std - 1) < 4 / np.sqrt(2 * n)
    end = sphere.offset(*centre, np.radians(fleet["lon"]), np.radians(fleet["lat"]))
    # Cov(x(s), x(t)) = K^2 s (T - t) / T.
    assert np.corrcoef(east, end[0])[0, 1] == pytest.approx(
        np.sqrt(15 * 10 / (35 * 40)), abs=4 / np.sqrt(n)
    )


def test_a_second_time_inside_a_step_goes_on_from_the_first() -> None:
    """Between 15 and 17 h of one step a bridge of 50 h goes on its way, and strays by K sqrt(dt (1
    - dt / T)).
    """
    n, hours = 20_000, 50.0
    fleet = Fleet(bridge(K12, reached(at(177.0, -37.9), hours)), n)
    first, second = fleet.within(Step(4, 0, 40 * HOUR, 1), [15 * HOUR, 17 * HOUR], chained=True)
    moved = np.array(sphere.offset(*np.radians(first), *np.radians(second)))
    std = K12 * np.sqrt(2 * HOUR * (1 - 2 / hours))
    way = (
        np.array(sphere.offset(*np.radians(BEGIN), np.radians(177.0), np.radians(-37.9)))
        * 2
        / hours
    )
    for made, mean in zip(moved, way, strict=True):
        assert abs(made.std() / std - 1) < 4 / np.sqrt(2 * n)
        assert abs(made.mean() - mean) < 4 * std / np.sqrt(n) + 0.02 * np.hypot(
            *way
        )  # the way turns by 4 degrees in all


def test_correlated_ends() -> None:
    """Equations 5 to 9: ends with a full covariance of east and north at both."""
    n, hours = 40_000, 40.0
    # Deviations: departure d ~ N(0, D), arrival a = G d + e, e ~ N(0, E).
    d_major, d_minor, d_turn, e_major, e_minor, e_turn = (
        40e3,
        15e3,
        np.radians(25),
        30e3,
        20e3,
        np.radians(130),
    )
    follows = (0.6, -0.2, 0.3, 0.5)
    begin = Near(np.radians(BEGIN[0]), np.radians(1.2), d_major, d_minor, d_turn)
    end = Near(np.radians(175.0), np.radians(2.0), e_major, e_minor, e_turn, follows)
    whole = int(hours * HOUR)
    points = WayPoint(begin, NONE), WayPoint(end, Spread(whole, whole, whole))
    fleet = Fleet(Itinerary((Ways(points, PERIOD.start, k=K12),), land="ignore"), n)

    def covariance(major: float, minor: float, turn: float) -> np.ndarray:
        axes = np.array([[np.sin(turn), np.cos(turn)], [np.cos(turn), -np.sin(turn)]])
        return axes @ np.diag([major**2, minor**2]) @ axes.T

    d, e, g = (
        covariance(d_major, d_minor, d_turn),
        covariance(e_major, e_minor, e_turn),
        np.reshape(follows, (2, 2)),
    )
    way = np.array(sphere.offset(begin.lon, begin.lat, end.lon, end.lat))
    before = 0.0
    for share in (0.25, 0.75):
        fleet.go(share * whole, HOUR, before)
        before = share * whole
        centre = sphere.destination(begin.lon, begin.lat, *(share * way))
        x = np.array(sphere.offset(*centre, np.radians(fleet["lon"]), np.radians(fleet["lat"])))
        mix = (1 - share) * np.eye(2) + share * g
        expected = mix @ d @ mix.T + share**2 * e + K12**2 * share * (1 - share) * whole * np.eye(2)
        found = np.cov(x)
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)) + expected**2) / np.sqrt(n)
        assert (np.abs(found - expected) < 4 * scale).all()
