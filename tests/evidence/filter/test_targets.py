"""Sorties and contacts on targets that steer, against NumPy by brute force."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from targets import HOUR, KNOT, NMI

from drift.case import file as case_file
from drift.case.record import Case
from drift.engine.motion import simulate
from drift.engine.particles import ensemble as record
from drift.engine.particles.ensemble import Ensemble
from drift.evidence.filter.filter import SearchFilter
from drift.evidence.filter.records import (
    NO_SENSORS,
    Barrier,
    Field,
    Law,
    Line,
    Presence,
    Sensors,
    Sortie,
    Watch,
)
from drift.pipeline import run_setup
from geo import sphere
from geo.array import Array
from geo.polyline import Area, Legs
from kernels.runtime import runtime

BEGIN = np.datetime64("2026-03-05T00:00:00")
HEAD = """
title = "targets"
start = "2026-03-05T00:00Z"
end = "+{hours} h"
particles = {n}
coast = {{ source = "none" }}
clock = {{ step = {step} }}
"""
BRIDGE = """
[[scenario]]
name = "smuggler"
vessel = { land = "ignore" }
[[scenario.phase]]
bridge = { k = "12 nmi/sqrt(h)", points = [
    { at = [-40.0, 30.0], time = "+0 h" }, { at = [-36.0, 31.0], time = "+40 h" } ] }
"""
BEND = """
[[scenario]]
name = "yacht"
vessel = { land = "ignore" }
[[scenario.phase]]
voyage = { waypoints = [[-40.0, 30.0], [-39.8, 30.05], [-39.75, 29.8]], speed = "9 kn" }
"""
K = 12 * NMI / 60


def at(hours: float) -> np.datetime64:
    return BEGIN + np.timedelta64(round(3600 * hours), "s")


def seconds(hours: float) -> float:
    return float(at(hours).astype("datetime64[s]").astype(np.int64))


def run(
    tmp_path: Path,
    text: str,
    sorties: tuple[Sortie, ...] = (),
    sensors: Sensors = NO_SENSORS,
    **head: Any,
) -> tuple[SearchFilter, Ensemble]:
    path = tmp_path / "case.toml"
    path.write_text(HEAD.format(**head) + text)
    runtime.start()
    case: Case = case_file.load(path)
    begin = run_setup.prepare(case, run_setup.open_for(case))
    search = SearchFilter(
        run_setup.ensemble_spec(case),
        sorties,
        (),
        case.resampling,
        begin.ensemble,
        begin.scene,
        sensors,
    )
    list(simulate.run(begin.ensemble, begin.scene, begin.clock, np.empty(0), search=search))
    begin.scene.forcing.close()
    return search, begin.ensemble


def leg(points: list[tuple[float, float]], speed: float, begin: float) -> tuple[Legs, float]:
    """Return legs through points (lon, lat) [deg] at a speed [kn] from an hour on, and the hour at
    which they end.
    """
    lon, lat = np.radians(np.array(points)).T
    far = np.append(0.0, np.cumsum(sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:])))
    time = far / (speed * KNOT)
    flown = Legs(
        tuple(seconds(begin) + time),
        *(tuple(np.degrees(x)) for x in (lon, lat)),
        (True,) * (lon.size - 1),
    )
    return flown, begin + float(np.ceil(time[-1])) / 3600


def pod(search: SearchFilter) -> float:
    return float(-np.expm1(search.updates.all[0].log_evidence[-1]))


def plane(lon: Any, lat: Any) -> Array:
    """Return (east, north) [m] of places [deg] in the tangent plane of the middle of these
    searches.
    """
    return np.stack(sphere.offset(*np.radians((-38.0, 30.5)), np.radians(lon), np.radians(lat)))


def wander(
    rng: np.random.Generator, n: int, begin: float, end: float, dt: float
) -> Iterator[Array]:
    """Yield places (2, n) [m] of bridges in the plane every dt [s] between hours of the 40 in which
    they lead from end to end.
    """
    ends = plane([-40.0, -36.0], [30.0, 31.0])
    share = begin / 40
    x = (
        ends[:, :1] * (1 - share)
        + ends[:, 1:] * share
        + rng.normal(size=(2, n)) * K * np.sqrt(share * (1 - share) * 40 * HOUR)
    )
    yield x
    for j in range(round((end - begin) * HOUR / dt)):
        left = (40 - begin) * HOUR - j * dt
        x = (
            x
            + (ends[:, 1:] - x) * dt / left
            + rng.normal(size=(2, n)) * K * np.sqrt(dt * (left - dt) / left)
        )
        yield x


def flies(flown: Legs, begin: float, end: float, dt: float) -> Array:
    """Return places (2, times) [m] in the plane of what flies legs, every dt [s] between hours."""
    time = seconds(begin) + np.arange(round((end - begin) * HOUR / dt) + 1) * dt
    return plane(*(np.interp(time, flown.time, x) for x in (flown.lon, flown.lat)))


def test_a_slow_leg_on_a_bridge(tmp_path: Path) -> None:
    """POD by inverse cube, at two steps: the hazard per time where the bridge is, by the leg's own
    velocity.
    """
    flown, end = leg([(-38.4, 30.25), (-38.15, 30.55)], 11, 19.3)
    sortie = Sortie("s", "", at(19.3), at(end), Law(), (4 * NMI,), legs=flown)
    n, paths, dt = 8_000, 6_000, 8.0
    rng = np.random.default_rng(6)
    sensor = flies(flown, 19.3, end, dt)
    velocity = np.gradient(sensor, dt, axis=1)
    hazard, own = np.zeros(paths), np.empty(0)
    for j, x in enumerate(wander(rng, paths, 19.3, end, dt)):
        if j == 0:  # the mean velocity of each target's leg
            own = (plane(-36.0, 31.0)[:, None] - x) / ((40 - 19.3) * HOUR)
        speed, far = np.hypot(*(velocity[:, j, None] - own)), np.hypot(*(x - sensor[:, j, None]))
        hazard += dt * speed * (4 * NMI) ** 2 / (4 * np.pi) / (2 * np.maximum(far, 1.0) ** 3)
    truth = 1 - np.exp(-hazard)
    error = np.hypot(truth.std() / np.sqrt(paths), truth.std() / np.sqrt(n))
    for step in (3600, 900):
        search, _ = run(tmp_path, BRIDGE, (sortie,), n=n, hours=24, step=step)
        assert abs(pod(search) - truth.mean()) < 3 * error


@pytest.mark.thorough
def test_a_watch_and_an_area_on_a_bridge(tmp_path: Path) -> None:
    """Time in a zone and in a box, at two steps of which one is longer than the whole watch."""
    place = (-38.2, 30.45)
    standing = Legs((seconds(18.5), seconds(22.0)), (place[0],) * 2, (place[1],) * 2, (True,))
    zone = Watch((5 * NMI,), (14 * NMI,), (0.9,))
    watch = Sortie("w", "", at(18.5), at(22.0), Law(), (0.0,), legs=standing, watch=zone)
    ring = ((-38.5, 30.3), (-37.9, 30.35), (-38.0, 30.7), (-38.45, 30.6))
    area = Sortie(
        "a",
        "",
        at(18.5),
        at(22.0),
        Law("random"),
        (1.0,),
        area=Area(*zip(*ring, strict=True)),
        coverage=(1.7,),
    )
    import shapely

    n, paths, dt = 8_000, 6_000, 60.0
    box = shapely.Polygon(plane(*np.transpose(ring)).T)
    shapely.prepare(box)
    share, inside, steps = np.zeros(paths), np.zeros(paths), round(3.5 * HOUR / dt)
    for a, b in pairwise(wander(np.random.default_rng(9), paths, 18.5, 22.0, dt)):
        middle = 0.5 * (a + b)
        far = np.hypot(*(middle - plane(*place)[:, None]))
        share += ((far > 5 * NMI) & (far < 14 * NMI)) / steps
        inside += shapely.contains_xy(box, *middle) / steps
    for sortie, truth in ((watch, 1 - 0.1**share), (area, 1 - np.exp(-1.7 * inside))):
        error = np.hypot(truth.std() / np.sqrt(paths), truth.std() / np.sqrt(n))
        for step in (21_600, 900):
            search, _ = run(tmp_path, BRIDGE, (sortie,), n=n, hours=24, step=step)
            assert abs(pod(search) - truth.mean()) < 3 * error


@pytest.mark.thorough
def test_definite_range_on_a_bridge(tmp_path: Path) -> None:
    """The first pass abeam on a leg counts: found if the target is within half the sweep width
    then.
    """
    flown, end = leg([(-38.4, 30.25), (-38.1, 30.6)], 14, 19.3)
    sortie = Sortie("s", "", at(19.3), at(end), Law("definite_range"), (8 * NMI,), legs=flown)
    n, paths, dt = 8_000, 6_000, 8.0
    sensor = flies(flown, 19.3, end, dt)
    course = (sensor[:, -1] - sensor[:, 0]) / np.linalg.norm(sensor[:, -1] - sensor[:, 0])
    passed, truth = np.zeros(paths, bool), np.zeros(paths)
    for (a, before), (b, after) in pairwise(
        zip(wander(np.random.default_rng(12), paths, 19.3, end, dt), sensor.T, strict=True)
    ):
        along, across = (
            course @ (a - before[:, None]),
            (course[1], -course[0]) @ (a - before[:, None]),
        )
        passes = ~passed & ((along > 0) != (course @ (b - after[:, None]) > 0))
        truth[passes] = np.abs(across[passes]) < 4 * NMI
        passed |= passes
    error = np.hypot(truth.std() / np.sqrt(paths), truth.std() / np.sqrt(n))
    for step in (3600, 900):
        search, _ = run(tmp_path, BRIDGE, (sortie,), n=n, hours=24, step=step)
        assert abs(pod(search) - truth.mean()) < 3 * error


@pytest.mark.parametrize("step", [7200, 600])
def test_a_leg_sees_the_bend_inside_a_step(tmp_path: Path, step: int) -> None:
    """A yacht that turns within the step: inverse cube along both of its legs, by quadrature of the
    hazard.
    """
    flown, end = leg([(-39.9, 30.045), (-39.7, 30.02)], 14, 0.9)
    sortie = Sortie("s", "", at(0.9), at(end), Law(), (1.1 * NMI,), legs=flown)
    search, ensemble = run(tmp_path, BEND, (sortie,), n=4, hours=4, step=step)
    time = np.arange(0.9 * HOUR, end * HOUR, 0.25)
    points = np.radians(np.array([(-40.0, 30.0), (-39.8, 30.05), (-39.75, 29.8)]))
    far = np.append(0.0, np.cumsum(sphere.distance(*points[:-1].T, *points[1:].T)))
    made = time * 9 * KNOT
    x, y = np.empty_like(time), np.empty_like(time)
    for k in (0, 1):
        own = (made >= far[k]) & (made <= far[k + 1])
        way = np.array(sphere.offset(*points[k], *points[k + 1]))
        x[own], y[own] = sphere.destination(
            *points[k], *(way[:, None] * (made[own] - far[k]) / (far[k + 1] - far[k]))
        )
    ends = np.radians((flown.lon, flown.lat))
    way = np.array(sphere.offset(*ends[:, 0], *ends[:, 1]))
    share = (time + seconds(0) - flown.time[0]) / (flown.time[1] - flown.time[0])
    sx, sy = sphere.destination(*ends[:, 0], *(way[:, None] * share))
    apart = np.array(sphere.offset(sx, sy, x, y))
    speed = np.linalg.norm(np.gradient(apart, 0.25, axis=1), axis=0)
    r = np.linalg.norm(apart, axis=0)
    hazard = (speed * (1.1 * NMI) ** 2 / (4 * np.pi) / (2 * r**3)).sum() * 0.25
    assert 0.2 < hazard < 3
    # The way inside the step is straight in binary angles where it is a great circle: at most 4 m
    # off in 16 km.
    assert pod(search) == pytest.approx(1 - np.exp(-hazard), rel=4e-3)
    assert record.probability(ensemble).sum() == pytest.approx(1)


FIGURE_4A = """
[[scenario]]
name = "paper"
vessel = {{ land = "ignore" }}
[[scenario.phase]]
bridge = {{ k = "{k} nmi/sqrt(h)", points = [
    {{ at = [-40.0, {south}], time = "+0 h" }}, {{ at = [-30.0, {north}], time = "+100 h" }} ] }}
"""


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("k", "exact", "hours", "n"),
    [(12, 5.576e-4, 4, 20_000), (24, 0.1537, 4, 8_000), (24, 0.1537, 1, 8_000)],
)
def test_equation_10_with_any_step(
    tmp_path: Path, k: int, exact: float, hours: int, n: int
) -> None:
    """A line 323 nmi from the departure and 167 nmi from the arrival of a bridge of 100 h, 25 and
    100 steps.

    Lattice points alone would find 0.09 and 0.12 of the 0.15: the line as if 0.5826 K sqrt(dt)
    farther away.
    """
    degree = sphere.RADIUS * np.pi / 180 / NMI  # [nmi]
    text = FIGURE_4A.format(k=k, south=-323 / degree, north=-167 / degree)
    lines = Sensors(lines=(Line("equator", ((-60.0, 0.0), (-10.0, 0.0))),))
    search, _ = run(tmp_path, text, sensors=lines, n=n, hours=100, step=hours * 3600)
    crossings = search.updates.crossings
    assert crossings is not None
    found = crossings.all[0].probability[-1]
    assert abs(found - exact) < 3 * np.sqrt(exact * (1 - exact) / n)


@pytest.mark.thorough
def test_presence_and_barriers_on_a_bridge(tmp_path: Path) -> None:
    """In a box throughout, never in a circle, past a barrier with a near end: against fine paths,
    at two steps.

    Paths that are looked at every dt miss touches; they are as likely as if edges were moved by
    0.5826 K sqrt(dt) (Siegmund 1985, Sequential Analysis, eq. 10.15).
    """
    import shapely

    n, paths, dt, begin, end = 8_000, 4_000, 15.0, 18.5, 21.25
    path = np.stack(list(wander(np.random.default_rng(31), paths, begin, end, dt)), axis=-1)
    moved = 0.5826 * K * np.sqrt(dt)
    place = (-38.2, 30.42)
    wide, high, turned = 66 * NMI, 50 * NMI, np.radians(20.0)
    x, y = path - plane(*place)[:, None, None]
    u, v = x * np.cos(turned) - y * np.sin(turned), x * np.sin(turned) + y * np.cos(turned)
    stayed = ((np.abs(u) < wide / 2 - moved) & (np.abs(v) < high / 2 - moved)).all(axis=1).mean()
    untouched = (np.hypot(x, y) > 14 * NMI + moved).all(axis=1).mean()
    line = shapely.LineString([plane(-38.6, 30.2), plane(-38.15, 30.5)]).buffer(moved)
    touched = shapely.intersects(line, shapely.linestrings(path.transpose(1, 2, 0))).mean()
    times = at(begin), at(end)
    sensors = {
        "box": Sensors(
            presences=(Presence("p", *times, Field(*place, 0, wide, high, turned), "throughout"),)
        ),
        "circle": Sensors(
            presences=(Presence("p", *times, Field(*place, radius=14 * NMI), "never"),)
        ),
        "barrier": Sensors(barriers=(Barrier("b", *times, ((-38.6, 30.2), (-38.15, 30.5)), 0.8),)),
    }
    truth = {"box": stayed, "circle": untouched, "barrier": 1 - 0.8 * touched}
    for name, expected in truth.items():
        error = np.sqrt(expected * (1 - expected)) * np.hypot(1 / np.sqrt(paths), 1 / np.sqrt(n))
        for step in (10_800, 900):
            search, _ = run(tmp_path, BRIDGE, sensors=sensors[name], n=n, hours=24, step=step)
            assert abs(np.exp(search.updates.all[0].log_evidence[-1]) - expected) < 3 * error, (
                name,
                step,
            )
