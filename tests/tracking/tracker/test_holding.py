"""What is told of a cloud held by detections, in closed form."""

from types import SimpleNamespace

import numpy as np
import pytest

from drift.tracking.tracker import holding, path
from drift.tracking.tracker.following import Particles
from geo import sphere


def cloud(course: np.ndarray, speed: np.ndarray, weight: np.ndarray) -> Particles:
    """Return particles at 17.3 E, 53.4 N with courses [rad] and speeds [m/s]."""
    lon, lat = np.radians([17.3, 53.4])
    place = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    north = np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    way = np.sin(course)[:, None] * east + np.cos(course)[:, None] * north
    rate = speed[:, None] / sphere.RADIUS
    return Particles(
        np.tile(place, (course.size, 1)),
        rate * way,
        weight / weight.sum(),
        np.zeros(course.size, int),
    )


@pytest.mark.parametrize("ahead", [21.0, 163.0, 358.0])
def test_spreads_of_courses_and_speeds_count_particles_by_their_weights(ahead: float) -> None:
    """About the course of the mean velocity, also where courses lie on both sides of north or
    south.
    """
    random = np.random.default_rng(12)
    course = np.radians(ahead) + random.normal(0.2, 0.5, 300) * random.choice([0.4, 1.6], 300)
    speed, weight = random.uniform(1.0, 9.0, 300), random.exponential(1.0, 300) ** 2
    # those on one side count more
    weight *= np.where(np.sin(course - np.radians(ahead)) > 0, 4.0, 1.0)
    off, slower = holding._spread(cloud(course, speed, weight))
    w = weight / weight.sum()
    mean = np.angle(np.sum(w * speed * np.exp(1j * course)))
    apart = np.angle(np.exp(1j * (course - mean)))
    assert off == pytest.approx(np.sqrt(np.average(apart**2, weights=w)), rel=1e-6)
    assert slower == pytest.approx(np.sqrt(np.cov(speed, aweights=w, ddof=0)), rel=1e-9)


def test_no_particles_have_no_spread() -> None:
    nothing = Particles(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, int))
    assert np.isnan(holding._spread(nothing)).all()


def test_what_is_shown_where_nothing_is_asked_for() -> None:
    """The last detection, the end, and the middle between; where they are one it is shown once."""
    for last, expected in ((3100.0, (3100.0, 5150.0, 7200.0)), (7200.0, (7200.0,))):
        seen = SimpleNamespace(time=np.array([100.0, last]))
        assert holding._usual(SimpleNamespace(end=7200.0), seen) == expected


@pytest.mark.parametrize(
    ("begin", "logged", "until"),
    [
        (None, False, 7200.0),
        (1500.0, False, 1500.0),
        (1500.0, True, 7200.0),
        (9000.0, False, 7200.0),
    ],
)
def test_silence_counts_until_a_pursuit_begins_unless_a_log_says_where_the_tracker_was(
    begin: float | None, logged: bool, until: float
) -> None:
    chase = None if begin is None else SimpleNamespace(begin=begin)
    asked = SimpleNamespace(end=7200.0, pursuit=chase, logged=logged)
    assert holding._silent_until(asked) == pytest.approx(until, abs=1e-5)


@pytest.mark.parametrize(("metres", "own"), [(0.0, True), (0.7, True), (1.4, False), (9e3, False)])
def test_who_begins_where_the_tracker_is_then_is_the_tracker(metres: float, own: bool) -> None:
    way = path.of_legs(*np.radians([17.3, 53.4]), [path.Leg(0.7, 6.0, 5000.0)])
    there = np.radians(path.degrees(way.at([1700.0])[0])).ravel()
    start = tuple(float(v) for v in sphere.destination(*there, 0.6 * metres, 0.8 * metres))
    assert (
        holding.pursues(
            SimpleNamespace(tracker=way, pursuit=SimpleNamespace(begin=1700.0, start=start))
        )
        == own
    )
    assert not holding.pursues(SimpleNamespace(tracker=way, pursuit=None))
