"""Courses that change, and a contact of which course and speed were seen, against draws in float64
that share no code with ours.

Rhumb lines by Mercator's isometric latitude, great circles by vectors. Tolerances are three
standard errors of the difference: the variance of one draw (delta method, from the brute force's
draws) over the number of its draws plus that over the number of the run's.
"""

import numpy as np
import pytest
from courses import HOUR, MILE, NMI, out_of, plane, rhumb, triangle

import drift

DRAWS = 150_000


def agree(found, weights, values, particles, what):
    mean = (weights * values).sum() / weights.sum()
    variance = np.mean((weights * (values - mean)) ** 2) / np.mean(weights) ** 2
    error = np.sqrt(variance / DRAWS + variance / particles)
    assert abs(found - mean) < 3 * error, (what, found, mean, error)


PARTICLES = 100_000
FIX, SPREAD, LATE = (178.0, 70.5), 6.0, 2.0  # it crosses 180 in high latitudes
COURSE, SPEED, CHANGE = (330.0, 40.0, 120.0, 5.0), (4.0, 7.0, 13.0, 4.0), 3.0
TIMES = (5.0, 12.0, 30.0)
CHANGES = f"""
title = "Changes"
start = "1972-10-12T06:00Z"
duration = "30 h"
particles = {PARTICLES}
seed = 31
clock.step = "1 h"
output.times = {[f"+{t} h" for t in TIMES]}
output.trajectories = {PARTICLES}
coast.source = "none"
[[scenario]]
name = "submarine"
position = {{ at = {list(FIX)}, std = "{SPREAD} nmi", time = "+0 h", until = "+{LATE} h" }}
[[scenario.phase]]
course.course = {{ low = {COURSE[0]}, best = {COURSE[1]}, high = {COURSE[2]}, ratio = {COURSE[3]} }}
course.speed = {{ low = "{SPEED[0]} kn", best = "{SPEED[1]} kn", high = "{SPEED[2]} kn", ratio = {SPEED[3]} }}
course.change = "{CHANGE} h"
"""


@pytest.mark.thorough
def test_places_under_changes_of_course(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(CHANGES)
    tracks = drift.run(drift.load(path)).trajectories
    rng = np.random.default_rng(5)
    lon, lat = out_of(SPREAD * rng.standard_normal((DRAWS, 2)), FIX)
    time, one = rng.uniform(0, LATE, DRAWS), np.ones(DRAWS)

    def anew():
        turned = triangle(rng, (COURSE[0] - 360, *COURSE[1:]), DRAWS)
        return turned, triangle(rng, SPEED, DRAWS), time + rng.exponential(CHANGE, DRAWS)

    course, speed, until = anew()
    for stop in TIMES:
        while (time < stop).any():
            lasting = np.maximum(np.minimum(until, stop) - time, 0)
            lon, lat = rhumb(lon, lat, course, speed * lasting)
            time = time + lasting
            done = time >= until
            course, speed, until = (
                np.where(done, new, old)
                for new, old in zip(anew(), (course, speed, until), strict=True)
            )
        column = np.searchsorted(
            tracks.time, tracks.time[0] + np.timedelta64(round(stop * HOUR), "s")
        )
        ours = plane(*(x[:, column] * (360 / 2**32) for x in (tracks.lon, tracks.lat)), FIX)
        theirs = plane(lon, lat, FIX)
        own, middle = tracks.weight[:, column], theirs.mean(axis=0)
        for k in range(2):
            for power in (1, 2, 3):
                there = (theirs[:, k] - middle[k]) ** power
                agree(
                    own @ (ours[:, k] - middle[k]) ** power, one, there, PARTICLES, (stop, k, power)
                )
            for at in np.quantile(theirs[:, k], [0.02, 0.2, 0.5, 0.8, 0.98]):
                agree(own @ (ours[:, k] < at), one, theirs[:, k] < at, PARTICLES, (stop, k, at))
        both = [np.prod(x - middle, axis=-1) for x in (ours, theirs)]
        agree(own @ both[0], one, both[1], PARTICLES, (stop, "both"))


STORIES = {"by course": 0.4, "on a voyage": 0.35, "adrift": 0.25}
MANY = {name: round(PARTICLES * share) for name, share in STORIES.items()}
BEGIN, PORTS, WRECK = (-20.0, 50.0), ((-21.5, 49.8), (-17.0, 50.6)), (-19.4, 50.25)
OWN, CROSS, ROUND = (7.0, 9.0), 4.0, 10.0  # [nmi] spreads of the three
COURSES, SPEEDS, VOYAGE = (50.0, 85.0, 140.0, 3.0), (3.0, 6.0, 12.0, 2.0), (5.0, 7.0, 11.0, 3.0)
CURRENT = (0.8, 80.0)  # [kn] toward
SEEN, AT, BELIEF = 9.0, (-18.9, 50.15), 0.7
# place [nmi]; course [deg] and speed [kn], each with its error
ERRORS = (8.0, (88.0, 15.0), (6.5, 1.5))
CONTACT = f"""
title = "A contact"
start = "1972-10-12T06:00Z"
duration = "10 h"
particles = {PARTICLES}
seed = 32
clock.step = "30 min"
coast.source = "none"
uncertainty = "none"
[[current]]
constant = {{ speed = "{CURRENT[0]} kn", toward = {CURRENT[1]} }}
[[scenario]]
name = "by course"
weight = {STORIES["by course"]}
position = {{ at = {list(BEGIN)}, std = ["{OWN[0]} nmi", "{OWN[1]} nmi"], orientation = 0 }}
[[scenario.phase]]
course.course = {{ low = {COURSES[0]}, best = {COURSES[1]}, high = {COURSES[2]}, ratio = {COURSES[3]} }}
course.speed = {{ low = "{SPEEDS[0]} kn", best = "{SPEEDS[1]} kn", high = "{SPEEDS[2]} kn", ratio = {SPEEDS[3]} }}
[[scenario]]
name = "on a voyage"
weight = {STORIES["on a voyage"]}
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = {[list(at) for at in PORTS]}
departure = ["+0 h", "+4 h"]
speed = {{ low = "{VOYAGE[0]} kn", best = "{VOYAGE[1]} kn", high = "{VOYAGE[2]} kn", ratio = {VOYAGE[3]} }}
cross_track = "{CROSS} nmi"
[[scenario]]
name = "adrift"
weight = {STORIES["adrift"]}
object = "water"
position = {{ at = {list(WRECK)}, std = "{ROUND} nmi" }}
[[contact]]
name = "radar"
time = "+{SEEN} h"
belief = {BELIEF}
position = {{ at = {list(AT)}, std = "{ERRORS[0]} nmi" }}
course = {{ value = {ERRORS[1][0]}, std = "{ERRORS[1][1]} deg" }}
speed = {{ value = "{ERRORS[2][0]} kn", std = "{ERRORS[2][1]} kn" }}
"""


def great_circle(start, end, far):
    """Return the place and course [deg] after a way [nmi] along great circles from starts to ends
    [deg], (n, 2) each.
    """
    a, b = (np.radians(x) for x in (start, end))
    turn = b[:, 0] - a[:, 0]
    first = np.arctan2(
        np.sin(turn) * np.cos(b[:, 1]),
        np.cos(a[:, 1]) * np.sin(b[:, 1]) - np.sin(a[:, 1]) * np.cos(b[:, 1]) * np.cos(turn),
    )
    arc = far * MILE
    lat = np.arcsin(np.sin(a[:, 1]) * np.cos(arc) + np.cos(a[:, 1]) * np.sin(arc) * np.cos(first))
    lon = a[:, 0] + np.arctan2(
        np.sin(first) * np.sin(arc) * np.cos(a[:, 1]), np.cos(arc) - np.sin(a[:, 1]) * np.sin(lat)
    )
    # Clairaut: sin(course) cos(lat) is constant; its cosine from the derivative of sin(lat)
    course = np.arctan2(
        np.sin(first) * np.cos(a[:, 1]),
        np.cos(a[:, 1]) * np.cos(first) * np.cos(arc) - np.sin(a[:, 1]) * np.sin(arc),
    )
    return np.degrees(lon), np.degrees(lat), np.degrees(course)


def likelihood(lon, lat, course, speed):
    """Return the density of the contact, per m2, rad and m/s."""
    off = np.linalg.norm(plane(lon, lat, AT), axis=-1)
    (aim, wide), (fast, spread) = ERRORS[1], ERRORS[2]
    turned = (course - aim + 180) % 360 - 180
    squares = (off / ERRORS[0]) ** 2 + (turned / wide) ** 2 + ((speed - fast) / spread) ** 2
    scale = (2 * np.pi) ** 2 * (ERRORS[0] * NMI) ** 2 * np.radians(wide) * spread * NMI / HOUR
    return np.exp(-squares / 2) / scale


@pytest.mark.thorough
def test_contact_with_course_and_speed(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(CONTACT)
    result = drift.run(drift.load(path))
    rng = np.random.default_rng(6)
    lon, lat = out_of(np.array(OWN[::-1]) * rng.standard_normal((DRAWS, 2)), BEGIN)
    course, speed = triangle(rng, COURSES, DRAWS), triangle(rng, SPEEDS, DRAWS)
    seen = [likelihood(*rhumb(lon, lat, course, speed * SEEN), course, speed)]
    drawn = {"by course": {"course": course, "speed": speed}}
    off, left, fast = (
        CROSS * rng.standard_normal(DRAWS),
        rng.uniform(0, 4, DRAWS),
        triangle(rng, VOYAGE, DRAWS),
    )
    ends = np.array([PORTS[0]]), np.array([PORTS[1]])
    length = np.linalg.norm(plane(*ends[1][0], PORTS[0]))
    ahead = [great_circle(*ends, np.array([far]))[2][0] for far in (0, length)]
    passed = []
    for port, bearing in zip(PORTS, ahead, strict=True):
        right = np.radians(bearing + 90)
        passed.append(
            np.stack(out_of(off[:, None] * np.array([np.sin(right), np.cos(right)]), port), axis=-1)
        )
    # Each keeps its share of the way, though its own great circle is a little shorter or longer
    # than the middle one.
    own = np.linalg.norm(
        [plane(*passed[1][k], passed[0][k]) for k in range(0, DRAWS, 1000)], axis=-1
    )
    assert np.all(np.abs(own / length - 1) < 1e-4)
    seen.append(likelihood(*great_circle(*passed, (SEEN - left) * fast), fast))
    drawn["on a voyage"] = {"departure": left, "speed": fast}
    lon, lat = out_of(ROUND * rng.standard_normal((DRAWS, 2)), WRECK)
    seen.append(likelihood(*rhumb(lon, lat, CURRENT[1], CURRENT[0] * SEEN), CURRENT[1], CURRENT[0]))

    share = np.array(list(STORIES.values()))
    mean = np.array([own.mean() for own in seen])
    total = share @ mean
    error = np.array([own.std() for own in seen]) * np.sqrt(1 / DRAWS + 1 / (PARTICLES * share))
    (update,) = result.updates.all
    relative = np.sqrt(np.sum((share * error) ** 2)) / total
    assert update.log_evidence[-1] == pytest.approx(np.log(total), abs=3 * relative)
    expected = share * (BELIEF * mean / total + 1 - BELIEF)
    for k in range(3):
        # d posterior_k / d mean_j = share_k BELIEF (delta_jk - mean_k share_j / total) / total
        slope = share[k] * BELIEF * ((np.arange(3) == k) - mean[k] * share / total) / total
        assert abs(update.posterior[k] - expected[k]) < 3 * np.sqrt(np.sum((slope * error) ** 2)), (
            k,
            update.posterior,
        )
    of = {told.quantity.name: k for k, told in enumerate(result.posteriors.told)}
    scale = {"course": np.radians(1), "speed": NMI / HOUR, "departure": HOUR}
    for k, (name, columns) in enumerate(drawn.items()):
        weights = BELIEF * seen[k] / total + 1 - BELIEF
        for quantity, values in columns.items():
            found = result.posteriors.stages[1].marginals[of[quantity]]
            for level, at in zip(
                (0.05, 0.25, 0.5, 0.75, 0.95), found.quantiles[k] / scale[quantity], strict=True
            ):
                agree(level, weights, values <= at, MANY[name], (name, quantity, level))
