"""Targets that steer along courses and tracks: laws, paths and times against NumPy and closed
forms.
"""

import numpy as np
import pytest
from scipy import stats
from targets import HOUR, NMI, PERIOD, Fleet, triangle

from drift.engine.motion.steering.itinerary import (
    NONE,
    Abeam,
    Course,
    InBox,
    InDisc,
    InRing,
    Itinerary,
    Loiter,
    Moment,
    Near,
    Spread,
    WayPoint,
    Ways,
)
from geo import sphere

K12 = 12 * NMI / 60  # [m/sqrt(s)] 12 nmi/sqrt(h)


def at(lon: float, lat: float) -> Near:
    return Near(np.radians(lon), np.radians(lat))


def reached(place: object, hours: float) -> WayPoint:
    return WayPoint(place, Spread(hours * HOUR, hours * HOUR, hours * HOUR))  # type: ignore[arg-type]


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
