"""Targets that steer: laws, ways and times against NumPy and closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from scipy import stats
from targets import HOUR, KNOT, NMI, PERIOD, Fleet, triangle

from drift.engine.motion.steering.itinerary import (
    NONE,
    Abeam,
    Between,
    Course,
    InBox,
    InDisc,
    InRing,
    Itinerary,
    Loiter,
    Moment,
    Near,
    Part,
    Rate,
    Spread,
    WayPoint,
    Ways,
)
from drift.engine.particles.status import Status
from geo import sphere
from kernels.steering import steer
from kernels.steering.pieces import Room
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


def test_truncated_triangles_through_north() -> None:
    """Mean and variance of course and speed (TARGETS: 2, 5, 12 with r = 4 has mean 6.6), courses
    from 340 to 35.
    """
    course = Spread(np.radians(340), np.radians(395), np.radians(370), 2.5)
    speed = Spread(2.0, 12.0, 5.0, 4.0)
    n = 40_000
    fleet = Fleet(Itinerary((Course(course, speed),)), n, at=(179.9, 61.0))
    assert speed.mean == pytest.approx(6.6)
    rng = np.random.default_rng(11)
    for values, law in ((fleet["speed"], speed), (fleet["course"], course)):
        own = triangle(rng, law.low, law.mode, law.high, law.ratio, 400_000)
        assert abs(values.mean() - law.mean) < 4 * own.std() / np.sqrt(n)
        assert stats.ks_2samp(values, own).pvalue > 1e-4
    assert fleet["course"].min() < 2 * np.pi < fleet["course"].max()


def test_a_course_is_a_rhumb_line_at_any_step() -> None:
    """On the Mercator chart it is straight: longitude grows as the isometric latitude."""
    laws = Spread(np.radians(30), np.radians(70), np.radians(50)), Spread(3.0, 9.0, 4.0)
    fleets = [
        Fleet(Itinerary((Course(*laws),)), 500, at=(178.8, 55.5)).go(24 * HOUR, step)
        for step in (900, 14_400)
    ]
    for fleet in fleets:
        course, far = fleet["course"].astype(float), fleet["speed"] * 86_400.0
        lat0, lat = np.radians(55.5), np.radians(55.5) + far * np.cos(course) / sphere.RADIUS
        isometric = np.arctanh(np.sin(lat)) - np.arctanh(np.sin(lat0))
        lon = sphere.wrap(np.radians(178.8) + np.tan(course) * isometric)
        apart = sphere.distance(lon, lat, np.radians(fleet["lon"]), np.radians(fleet["lat"]))
        # Simpson's rule, and half a unit a step in both coordinates
        assert apart.max() < 2e-5 * far.max() + 96 * 0.02


def test_courses_change_at_exponential_times() -> None:
    """The number of courses in 40 h at a mean of 5 h is Poisson; the mean speed along is that of
    the law.
    """
    n, hours, mean = 20_000, 40, 5.0
    law = Course(Spread(0.0, 2 * np.pi, 1.0), Spread(4.0, 4.0, 4.0), change=mean * HOUR)
    fleet = Fleet(Itinerary((law,)), n, at=(20.0, 3.0)).go(hours * HOUR, 7200)
    east, north = sphere.offset(
        np.radians(20.0), np.radians(3.0), np.radians(fleet["lon"]), np.radians(fleet["lat"])
    )
    # A velocity jump process: E r^2 = 2 v^2 (mean t - mean^2 (1 - exp(-t / mean))) for directions
    # drawn again.
    t, m, v = hours * HOUR, mean * HOUR, 4.0
    expected = 2 * v * v * (m * t - m * m * (1 - np.exp(-t / m)))
    squared = east**2 + north**2
    assert abs(squared.mean() - expected) < 4 * squared.std() / np.sqrt(n)


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


def test_a_target_keeps_its_side_of_a_way() -> None:
    """By two legs along the equator, off it by a normal law: midway along both each is as far off,
    on the same side.
    """
    points = tuple(
        WayPoint(Abeam(np.radians(lon), 0.0, 5 * NMI, np.pi, "normal"), distance=far)
        for lon, far in ((20.0, 0.0), (21.0, 60 * NMI), (22.0, 60 * NMI))
    )
    ways = Ways(points, PERIOD.start, speed=Spread(5.0, 5.0, 5.0))
    fleet = Fleet(Itinerary((ways,), land="ignore"), 500)
    off = [fleet.go(hours * HOUR, 1800, before * HOUR)["lat"] for before, hours in ((0, 3), (3, 9))]
    assert np.std(off[0]) * 60 == pytest.approx(5, rel=0.1)
    np.testing.assert_allclose(off[1], off[0], atol=1e-5)


def test_places_and_times_of_a_track() -> None:
    """Ellipse, box, circle and polygon at offsets from a random start: moments at each (CAST)."""
    n = 20_000
    ring = np.radians(np.array([[-20.0, 40.0], [-18.0, 40.3], [-18.7, 41.5]]))
    places = (
        Near(np.radians(-30.0), np.radians(40.0), 30e3, 10e3, np.radians(35.0)),
        InBox(np.radians(-27.0), np.radians(40.5), 80e3, 30e3, np.radians(20.0)),
        InDisc(np.radians(-24.0), np.radians(41.0), 40e3),
        InRing(tuple(ring[:, 0]), tuple(ring[:, 1])),
    )
    after = Spread(0.0, 9 * HOUR, 2 * HOUR, 3.0)
    times = (
        NONE,
        Spread(30 * HOUR, 36 * HOUR, 31 * HOUR, 2.0),
        Moment(70 * HOUR, 2 * HOUR),
        Spread(*[100 * HOUR] * 3),
    )
    points = tuple(WayPoint(p, t) for p, t in zip(places, times, strict=True))
    fleet = Fleet(Itinerary((Ways(points, PERIOD.start, after),), land="ignore"), n)
    start = fleet["departure"].astype(float)
    rng = np.random.default_rng(2)
    assert stats.ks_2samp(start, triangle(rng, 0, 2 * HOUR, 9 * HOUR, 3.0, 200_000)).pvalue > 1e-4
    expected = {
        0: (30e3**2, 10e3**2, 35.0), 1: (80e3**2 / 12, 30e3**2 / 12, 20.0), 2: (40e3**2 / 4, 40e3**2 / 4, 0.0),
    }  # fmt: skip
    now = 0
    for k in range(4):
        lon, lat = (fleet["lon"], fleet["lat"]) if k == 0 else (fleet["to_lon"], fleet["to_lat"])
        if k == 3:
            x, y = _in_polygon(rng, ring, 200_000)
            assert stats.ks_2samp(lon, np.degrees(x)).pvalue > 1e-4
            assert stats.ks_2samp(lat, np.degrees(y)).pvalue > 1e-4
        else:
            east, north = sphere.offset(
                places[k].lon, places[k].lat, np.radians(lon), np.radians(lat)
            )
            major, minor, turn = expected[k]
            s, c = np.sin(np.radians(turn)), np.cos(np.radians(turn))
            along, across = east * s + north * c, east * c - north * s
            for x, variance in ((along, major), (across, minor)):
                kurtosis = 3.0 if k == 0 else 2.0  # at most
                assert abs(x.mean()) < 4 * np.sqrt(variance / n)
                assert abs(x.var() / variance - 1) < 4 * np.sqrt((kurtosis - 1) / n)
        if k == 1:
            after_start = fleet["to_time"] - start
            assert (
                stats.ks_2samp(after_start, triangle(rng, 30, 31, 36, 2.0, 200_000) * HOUR).pvalue
                > 1e-4
            )
        if k == 2:
            late = fleet["to_time"] - start - 70 * HOUR
            assert abs(late.mean()) < 4 * 2 * HOUR / np.sqrt(n)
            assert abs(late.std() / (2 * HOUR) - 1) < 4 / np.sqrt(2 * n)
        if k < 3:
            then = (20, 50, 95)[k] * HOUR
            fleet.go(then, HOUR, now)
            now = then
            assert (fleet["leg"] == k + 2).all()


def _in_polygon(
    rng: np.random.Generator, ring: np.ndarray, n: int
) -> tuple[np.ndarray, np.ndarray]:
    import shapely

    x = rng.uniform(ring[:, 0].min(), ring[:, 0].max(), n)
    y = np.arcsin(rng.uniform(np.sin(ring[:, 1].min()), np.sin(ring[:, 1].max()), n))
    inside = shapely.contains_xy(shapely.Polygon(ring), x, y)
    return x[inside], y[inside]


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


def test_times_in_order() -> None:
    """Independent normals of 3 h at 0, 6 and 14 h would be out of order in 11 % of draws; the speed
    limits hold too.
    """
    places = [at(0.0, 45.0), at(0.9, 45.2), at(2.1, 45.1)]
    points = tuple(
        WayPoint(p, Moment(h * HOUR, 3 * HOUR)) for p, h in zip(places, (0, 6, 14), strict=True)
    )
    fast = 12 * KNOT
    fleet = Fleet(Itinerary((Ways(points, PERIOD.start, fastest=fast),), land="ignore"), 20_000)
    times = [fleet["departure"].astype(float), fleet["to_time"].astype(float)]
    fleet.go(30 * HOUR, HOUR, -12 * HOUR)
    assert (fleet["status"] == Status.ARRIVED).all()
    times.append(fleet["status_since"].astype(float))
    far = [sphere.distance(a.lon, a.lat, b.lon, b.lat) for a, b in pairwise(places)]
    for k in (0, 1):
        assert (times[k + 1] - times[k] >= far[k] / fast - 1).all()
    # Given the time before it, a time is its normal law cut there: probabilities of the normal law
    # are uniform.
    for k, mean in ((0, 6), (1, 14)):
        u = stats.norm.cdf(times[k + 1], mean * HOUR, 3 * HOUR)
        low = stats.norm.cdf(times[k] + far[k] / fast, mean * HOUR, 3 * HOUR)
        ordinary = low < 0.9
        assert stats.kstest(((u - low) / (1 - low))[ordinary], "uniform").pvalue > 1e-4


def test_destinations_have_their_probabilities() -> None:
    n = 20_000
    last = (
        (reached(at(3.0, 44.0), 30.0), 0.2),
        (reached(at(-3.0, 44.0), 30.0), 0.5),
        (reached(at(0.0, 47.0), 30.0), 0.3),
    )
    points = (WayPoint(at(0.0, 45.0), NONE), reached(at(0.0, 45.5), 5.0))
    fleet = Fleet(
        Itinerary((Ways(points, PERIOD.start, destinations=last, k=K12),), land="ignore"), n
    )
    fleet.go(31 * HOUR, HOUR)
    for (point, probability), lon in zip(last, (3.0, -3.0, 0.0), strict=True):
        there = (
            np.abs(fleet["lon"] - lon) + np.abs(fleet["lat"] - np.degrees(point.place.lat)) < 1e-5
        )  # type: ignore[union-attr]
        assert abs(there.mean() - probability) < 4 * np.sqrt(probability * (1 - probability) / n)


@pytest.mark.thorough
def test_loitering_keeps_the_uniform_law() -> None:
    """Legs reflected at the edge of a polygon that is not convex: uniform in true area at any time
    (chi-squared).
    """
    import shapely

    corners = [(-12.0, 60.0), (-7.0, 60.4), (-7.5, 62.0), (-9.5, 61.0), (-11.8, 62.3)]
    ring = InRing(*(tuple(np.radians(x)) for x in np.array(corners).T))
    n = 12_000
    law = Loiter(ring, Spread(3.0, 8.0, 4.0, 2.0), 25e3)
    rng = np.random.default_rng(8)
    x, y = (np.degrees(a[:n]) for a in _in_polygon(rng, np.radians(corners), 5 * n))
    fleet = Fleet(Itinerary((law,)), n, at=(x, y)).go(60 * HOUR, 2 * HOUR)
    lon, lat = fleet["lon"], fleet["lat"]
    shape = shapely.Polygon(corners)
    assert shapely.contains_xy(shape.buffer(2e-4), lon, lat).all()
    uniform = _in_polygon(rng, np.radians(corners), 500_000)
    edges = np.linspace(-12, -7, 15), np.linspace(60, 62.3, 13)
    expected, *_ = np.histogram2d(*np.degrees(uniform), bins=edges)
    found, *_ = np.histogram2d(lon, lat, bins=edges)
    kept = expected > 20 * uniform[0].size / n
    expected = expected[kept] / expected.sum() * n
    chi2 = ((found[kept] - expected) ** 2 / expected / (1 + n / uniform[0].size)).sum()
    assert stats.chi2.sf(chi2, kept.sum() - 1) > 1e-3
    moved = sphere.distance(*np.radians((x, y, lon, lat)))
    assert moved.mean() > 60e3


def test_phases_follow_one_another() -> None:
    """A voyage by speed to a corner of a polygon's surroundings, loitering in it, then away on a
    course.
    """
    ring = InRing(
        *(tuple(np.radians(x)) for x in np.array([(10.0, 35.0), (11.0, 35.2), (10.6, 35.9)]).T)
    )
    begin, end = at(8.0, 34.0), at(9.6, 34.9)
    far = float(sphere.distance(begin.lon, begin.lat, end.lon, end.lat))
    voyage = Ways(
        (WayPoint(begin), WayPoint(end, distance=far)),
        PERIOD.start,
        Spread(0.0, 3600.0, 0.0),
        speed=Spread(4.0, 6.0, 5.0),
    )
    until = PERIOD.start + np.timedelta64(60, "h")
    away = Course(Spread(2.0, 2.0, 2.0), Spread(5.0, 5.0, 5.0), lasting=10 * HOUR)
    fleet = Fleet(
        Itinerary(
            (voyage, Loiter(ring, Spread(3.0, 3.0, 3.0), 15e3, until=until), away), land="ignore"
        ),
        2000,
    )
    assert (fleet["phase"] == 0).all()
    arrival = fleet["departure"] + far / fleet["speed"]
    fleet.go(40 * HOUR, HOUR)
    assert arrival.max() < 20 * HOUR
    assert (fleet["phase"] == 1).all()
    lon, lat = np.radians(fleet["lon"]), np.radians(fleet["lat"])
    fleet.go(65 * HOUR, HOUR, 40 * HOUR)
    assert (fleet["phase"] == 2).all()
    assert (fleet["course"] == 2.0).all()
    fleet.go(71 * HOUR, HOUR, 65 * HOUR)
    assert (fleet["status"] == Status.ARRIVED).all()
    assert (fleet["status_since"] == 70 * HOUR).all()
    assert sphere.distance(lon, lat, np.radians(10.5), np.radians(35.4)).max() < 80e3


@pytest.mark.parametrize("kind", ["between", "rate", "part"])
def test_distress(kind: str) -> None:
    """When it goes adrift: between two times but after departure, at a rate from there on, after a
    part of the way.
    """
    begin, end = at(8.0, 34.0), at(9.6, 34.9)
    far = float(sphere.distance(begin.lon, begin.lat, end.lon, end.lat))
    n, after = 20_000, Spread(0.0, 6 * HOUR, 2 * HOUR, 3.0)
    laws = {
        "between": Between(
            PERIOD.start + np.timedelta64(2, "h"), Spread(0.0, 10 * HOUR, 8 * HOUR, 4.0)
        ),
        "rate": Rate(1 / (9 * HOUR)),
        "part": Part(Spread(0.2, 0.9, 0.8, 5.0)),
    }
    points = WayPoint(begin), WayPoint(end, distance=far)
    ways = Ways(points, PERIOD.start, after, speed=Spread(4.0, 6.0, 5.0))
    fleet = Fleet(Itinerary((ways,), laws[kind], land="ignore"), n)
    departure, release, speed = (fleet[x].astype(float) for x in ("departure", "release", "speed"))
    rng = np.random.default_rng(4)
    if kind == "between":
        d = triangle(rng, 0, 2, 6, 3.0, 200_000) * HOUR
        t = 2 * HOUR + triangle(rng, 0, 8, 10, 4.0, 200_000) * HOUR
        # Given its departure the distress comes after it: weigh departures alike, draw the distress
        # again until it does.
        while (early := t < d).any():
            t[early] = 2 * HOUR + triangle(rng, 0, 8, 10, 4.0, int(early.sum())) * HOUR
        assert stats.ks_2samp(release, t).pvalue > 1e-4
    elif kind == "rate":
        assert stats.kstest((release - departure) / (9 * HOUR), "expon").pvalue > 1e-4
        assert abs(np.corrcoef(release - departure, departure)[0, 1]) < 4 / np.sqrt(n)
    else:
        part = (release - departure) * speed / far
        assert stats.ks_2samp(part, triangle(rng, 0.2, 0.8, 0.9, 5.0, 200_000)).pvalue > 1e-4
    fleet.go(3 * HOUR, HOUR)
    stopped = release <= 3 * HOUR
    made = sphere.distance(begin.lon, begin.lat, *np.radians((fleet["lon"], fleet["lat"])))
    expected = np.maximum(np.minimum(release, 3 * HOUR) - departure, 0) * speed
    np.testing.assert_allclose(made, expected, atol=2e-6 * far + 0.6 * speed.max())
    assert stopped.any() or kind == "part"


def test_copies_keep_what_is_settled_and_part_in_the_noise() -> None:
    """Resampled copies go to their ancestor's destination, at its speed; their bridges are their
    own.
    """
    last = ((reached(at(3.0, 44.0), 30.0), 0.5), (reached(at(-3.0, 44.0), 30.0), 0.5))
    points = (WayPoint(at(0.0, 45.0), NONE), reached(at(0.0, 45.5), 5.0))
    fleet = Fleet(
        Itinerary((Ways(points, PERIOD.start, destinations=last, k=K12),), land="ignore"), 64
    )
    fleet.go(3 * HOUR, HOUR)
    for column in fleet.columns.values():
        column.from_numpy(np.repeat(column.to_numpy()[7:8], 64))
    fleet.go(20 * HOUR, HOUR, 3 * HOUR)
    assert len(set(zip(fleet["lon"], fleet["lat"], strict=True))) == 64
    assert len(set(fleet["to_lon"])) == 1


def test_a_distress_that_would_be_before_the_departure_is_at_it() -> None:
    ways = Ways(
        (WayPoint(at(8.0, 34.0)), WayPoint(at(9.6, 34.9), distance=1.7e5)), PERIOD.start,
        Spread(2 * HOUR, 6 * HOUR, 3 * HOUR), speed=Spread(4.0, 6.0, 5.0),
    )  # fmt: skip
    fleet = Fleet(
        Itinerary((ways,), Between(PERIOD.start, Spread(0.0, HOUR, 1800.0)), land="ignore"), 200
    )
    np.testing.assert_array_equal(fleet["release"], fleet["departure"])


def test_pieces_beyond_the_room_are_asked_for_again() -> None:
    """Where a step makes half as many pieces more than there are slots, each target's still follow
    one another to its end.

    The number of courses taken in a step is Poisson, so that 0.5 a target come on top, less than
    the room again.
    """
    n, step = 2000, Step(0, 0, 2 * HOUR, 1)
    law = Course(Spread(0.0, 2 * np.pi, 1.0), Spread(4.0, 4.0, 4.0), change=4 * HOUR)
    fleet = Fleet(Itinerary((law,)), n, at=(20.0, 3.0))
    room = Room(n)
    steer.write_pieces(fleet.columns, fleet.slots, fleet.plan, fleet.seed, None, step, room)
    pack = {
        name: room.columns[f"piece_{name}"].to_numpy() for name in ("begin", "end", "next", "used")
    }
    more = pack["used"][0] - n
    assert abs(more - 0.5 * n) < 4 * np.sqrt(0.5 * n)
    slot = at = np.arange(n)
    made, pieces = np.zeros(n), 0
    while at.size:
        pieces += at.size
        made[slot] += pack["end"][at] - pack["begin"][at]
        on = pack["next"][at] >= 0
        at, slot = pack["next"][at][on], slot[on]
    assert pieces == n + more
    np.testing.assert_array_equal(made, step.duration)
