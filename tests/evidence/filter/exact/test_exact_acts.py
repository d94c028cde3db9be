"""Scenarios of a boat that keeps on, flees from a patrol or seeks it, weighed by two contacts:
against NumPy and pyproj by brute force.
"""

from pathlib import Path

import numpy as np
import pytest
from pyproj import Geod

import drift
from geo import sphere

GLOBE = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
KNOT, NMI = 1852 / 3600, 1852.0
BOAT, PATROL, STD = (-179.87, 51.24), (179.85, 51.12), 1300.0
FASTEST, BETWEEN = 32 * KNOT, (180.0, 900.0)
LEGS = ((64.0, 14 * KNOT, 2400.0), (331.0, 18 * KNOT, 4800.0))  # course, speed, how long
CONTACTS = (  # [s], from, bearing, wedge [deg], near, far [nmi]
    (2700, (-179.9, 51.2), 292.0, 70.0, 2.0, 13.0),
    (5400, (-179.97, 51.4), 250.0, 130.0, 3.0, 30.0),
)
CASE = f"""
title = "Three ways to go on"
start = "2026-03-05T00:07Z"
duration = "2 h"
particles = 60000
seed = 12
clock.step = STEP
output.times = ["+46 min"]
coast.source = "none"
[tracker.patrol]
at = {list(PATROL)}
legs = [{{ course = 64, speed = "14 kn", lasting = "40 min" }}, {{ course = 331, speed = "18 kn" }}]
[[scenario]]
name = "keeps on"
weight = 2
position = {{ at = {list(BOAT)}, std = "{STD} m" }}
[[scenario.phase]]
course = {{ course = [230, 290], speed = ["12 kn", "25 kn"] }}
[[scenario]]
name = "flees"
weight = 1.5
position = {{ at = {list(BOAT)}, std = "{STD} m" }}
[[scenario.phase]]
behaviour = {{ course = [230, 290], speed = ["12 kn", "25 kn"], fastest = "32 kn", acts = ["3 min", "15 min"], change = 0.2, hide = 0.3, spread = 40, tracker = "patrol" }}
[[scenario]]
name = "seeks"
position = {{ at = {list(BOAT)}, std = "{STD} m" }}
[[scenario.phase]]
behaviour = {{ fastest = "32 kn", acts = ["3 min", "15 min"], change = 0.25, seek = 0.35, leave = 0.1, tracker = "patrol" }}
""" + "".join(
    f'[[contact]]\nname = "{k}"\ntime = "+{time // 60} min"\n'
    f'bearing = {{ from = {list(place)}, bearing = {toward}, wedge = "{wedge} deg", near = "{near} nmi", far = "{far} nmi" }}\n'
    for k, (time, place, toward, wedge, near, far) in enumerate(CONTACTS)
)
PRIOR = np.array([2.0, 1.5, 1.0]) / 4.5
N = 20_000


def patrol(time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (lon, lat) [deg], course [deg] and speed [m/s] of the patrol: its courses change by
    under 0.02 degrees in 12 nmi.
    """
    course, speed, lasting = LEGS[0]
    one = GLOBE.fwd(
        np.full(time.size, PATROL[0]),
        np.full(time.size, PATROL[1]),
        np.full(time.size, course),
        speed * np.minimum(time, lasting),
    )
    later = time > lasting
    two = GLOBE.fwd(
        one[0], one[1], np.full(time.size, LEGS[1][0]), LEGS[1][1] * np.maximum(time - lasting, 0)
    )
    return two[0], two[1], np.where(later, LEGS[1][0], course), np.where(later, LEGS[1][1], speed)


def seen(lon: np.ndarray, lat: np.ndarray, contact: tuple) -> np.ndarray:
    """Return whether places are in the box of a contact."""
    _, (x, y), toward, wedge, near, far = contact
    ahead, _, apart = GLOBE.inv(np.full(lon.size, x), np.full(lon.size, y), lon, lat)
    off = np.abs((ahead - toward + 180) % 360 - 180)
    return (off <= wedge / 2) & (apart >= near * NMI) & (apart <= far * NMI)


def moved(rng: np.random.Generator, story: str) -> tuple[np.ndarray, np.ndarray]:
    """Return whether each boat is in the box of the first contact, and of the second, each boat by
    itself.
    """
    n = N
    lon, lat, _ = GLOBE.fwd(
        np.full(n, BOAT[0]),
        np.full(n, BOAT[1]),
        rng.uniform(0, 360, n),
        STD * np.sqrt(2 * rng.exponential(size=n)),
    )
    fresh = story == "seeks"
    course = rng.uniform(0, 360, n) if fresh else rng.uniform(230, 290, n)
    speed = rng.uniform(0, FASTEST, n) if fresh else rng.uniform(12 * KNOT, 25 * KNOT, n)
    change, react, leave, spread = {
        "keeps on": (0, 0, 0, 0),
        "flees": (0.2, 0.3, 0, 40),
        "seeks": (0.25, 0.35, 0.1, 0),
    }[story]
    time, due, about = np.zeros(n), rng.uniform(*BETWEEN, n), np.zeros(n, bool)
    if story == "keeps on":
        due[:] = np.inf
    boxes = []
    for contact in CONTACTS:
        until = float(contact[0])
        while (time < until).any():
            to = np.minimum(due, until)
            lon, lat, _ = GLOBE.fwd(lon, lat, course, speed * (to - time))
            time = to
            acts = due <= time
            u = rng.random(n)
            left = acts & about & (u < leave)
            starts = acts & ~about & (u > 1 - react)
            turns = acts & ~about & (u < change)
            about = (about & ~left) | starts
            course = np.where(turns, rng.uniform(0, 360, n), course)
            speed = np.where(turns, rng.uniform(0, FASTEST, n), speed)
            x, y, toward, pace = patrol(time)
            ahead, back, _ = GLOBE.inv(lon, lat, x, y)
            if story == "flees":
                react_course = ahead + 180 + spread * rng.uniform(-1, 1, n)
            else:
                across = pace * np.sin(np.radians(toward - back - 180)) / speed
                away = pace * np.cos(np.radians(toward - back - 180)) / speed
                meets = (np.abs(across) < 1) & (np.sqrt(np.maximum(1 - across**2, 0)) > away)
                react_course = ahead + np.where(
                    meets, np.degrees(np.arcsin(np.clip(across, -1, 1))), 0
                )
            course = np.where(acts & about, react_course, course)
            due = np.where(acts, time + rng.uniform(*BETWEEN, n), due)
        boxes.append(seen(lon, lat, contact))
    return boxes[0], boxes[1]


@pytest.fixture(scope="module")
def boxes() -> list[tuple[np.ndarray, np.ndarray]]:
    """Who is in the boxes, by scenarios."""
    rng = np.random.default_rng(3)
    return [moved(rng, story) for story in ("keeps on", "flees", "seeks")]


@pytest.mark.thorough
@pytest.mark.parametrize("step", [pytest.param(120, marks=pytest.mark.thorough), 1800])
def test_stories_are_weighed_as_brute_force_weighs_them(
    step: int, boxes: list[tuple[np.ndarray, np.ndarray]], tmp_path: Path
) -> None:
    """The probability of each scenario after each contact, within four standard errors of both
    simulations.
    """
    path = tmp_path / "case.toml"
    path.write_text(CASE.replace("STEP", str(step)))
    result = drift.run(drift.load(path))
    ours = np.array([update.posterior for update in result.updates.all])
    assert len(ours) == 2
    for row, got in enumerate(ours):
        chance = np.array([(first & (second | (row == 0))).mean() for first, second in boxes])
        expected = PRIOR * chance / (PRIOR @ chance)
        # of the logarithm of each, relative
        variance = (1 - chance) / chance * (1 / N + 1 / (60_000 * PRIOR))
        error = expected * np.sqrt((1 - expected) ** 2 * variance + np.array([
            sum(expected[j] ** 2 * variance[j] for j in range(3) if j != i) for i in range(3)
        ]))  # fmt: skip
        assert (np.abs(got - expected) < 4 * error).all(), (got, expected, error)
        print(error)
        assert (error < 0.012).all()
