"""Vessels that feel the current under way, against a fine integration in float64 from the same
begins.

dlat/dt = (way north + v) / R, dlon/dt = (way east + u) / (R cos lat), all at the place where the
vessel is; the way through the water is that of its dead reckoning: its compass course, or towards
its next way point from its dead-reckoned position.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from oracle import HOUR, KNOT, R
from scipy import stats

from drift.case import file as case_file
from drift.engine.motion import simulate
from drift.engine.particles.status import Status
from drift.pipeline import run_setup
from geo import sphere
from kernels.runtime import runtime

HEAD = """
title = "felt"
start = "2026-03-05T00:00Z"
duration = "{hours} h"
particles = {n}
coast = {{ source = "none" }}
clock = {{ step = {step} }}
uncertainty = {uncertainty}
[[current]]
{source}
[[scenario]]
name = "vessel"
vessel = {{ currents = "felt" }}
"""
COURSE = """
position = { at = [-40.0, 58.0], std = "15 nmi" }
[[scenario.phase]]
course = { course = 63, speed = "9 kn" }
"""
POINTS = [(-40.0, 57.0), (-37.9, 57.7), (-38.3, 58.9)]
VOYAGE = f"""
object = "water"
distress = {{ between = ["+11 h", "+19 h"] }}
[[scenario.phase]]
voyage = {{ waypoints = {[list(p) for p in POINTS]}, speed = ["9 kn", "12 kn"], departure = ["+1 h", "+3 h"] }}
"""
SHEARED = {
    "n": 150, "hours": 24, "step": 900, "uncertainty": '{ current = "none" }', "source": 'dataset = "sea"\nfill = 0',
}  # fmt: skip
Array = np.ndarray


def current(lon: Any, lat: Any, time: Any) -> tuple[Any, Any]:
    """Return (east, north) [m/s]: linear in longitude, in latitude and in time, as a grid's
    interpolation is. Degrees, seconds.
    """
    rising = 1 + time / (40 * HOUR)
    return (0.5 + 0.06 * (lat - 58)) * rising, (-0.4 + 0.05 * (lon + 39)) * rising


def sea() -> xr.Dataset:
    lon, lat, hour = np.linspace(-50, -28, 45), np.linspace(50, 66, 33), np.arange(0, 61, 1)
    u, v = current(lon[None, None, :], lat[None, :, None], hour[:, None, None] * HOUR)
    units = {"units": "m s-1"}
    shape = (hour.size, lat.size, lon.size)
    return xr.Dataset(
        {
            "u": (("time", "lat", "lon"), np.broadcast_to(u, shape), {"standard_name": "eastward_sea_water_velocity", **units}),
            "v": (("time", "lat", "lon"), np.broadcast_to(v, shape), {"standard_name": "northward_sea_water_velocity", **units}),
        },
        {
            "time": ("time", np.datetime64("2026-03-05T00:00", "ns") + hour * np.timedelta64(1, "h")),
            "lat": ("lat", lat, {"units": "degrees_north"}),
            "lon": ("lon", lon, {"units": "degrees_east"}),
        },
    )  # fmt: skip


def run(
    tmp_path: Path, text: str, times: list[int], **head: Any
) -> tuple[Any, list[Any], dict[str, Array]]:
    """Return the ensemble at the end, what it was at some times [s], and some of its columns as
    they were at birth.
    """
    path = tmp_path / "felt.toml"
    path.write_text(HEAD.format(**{**SHEARED, **head}) + text)
    runtime.start()
    case = case_file.load(path)
    begin = run_setup.prepare(
        case,
        run_setup.open_for(case, {"sea": sea()} if "sea" in head.get("source", "sea") else None),
    )
    names = ("lon", "lat", "departure", "release", "speed")
    born = {name: begin.ensemble.columns[name].to_numpy().copy() for name in names}
    moments = list(simulate.run(begin.ensemble, begin.scene, begin.clock, np.array(times)))
    begin.scene.forcing.close()
    return begin.ensemble, moments, born


def degrees(thing: Any) -> tuple[Array, Array]:
    return thing.lon * sphere.UNIT * 180 / np.pi, thing.lat * sphere.UNIT * 180 / np.pi


def apart(moment: Any, lon: Array, lat: Array) -> Array:
    """Return how far [m] particles are from places [deg]."""
    x, y = moment.lon * sphere.UNIT, moment.lat * sphere.UNIT
    return np.asarray(sphere.distance(x, y, np.radians(lon), np.radians(lat)))


def fine(
    lon: Array, lat: Array, through: Any, begin: Array, end: Any, dt: float = 300.0
) -> tuple[Array, Array]:
    """Integrate each vessel from its begin to its end [s] by the classical Runge-Kutta scheme;
    through(time): its way [m/s].
    """
    steps = max(int(np.ceil(np.max(end - begin) / dt)), 1)
    dt = np.maximum(end - begin, 0.0) / steps

    def slope(time: Array, x: Array, y: Array) -> tuple[Array, Array]:
        u, v = current(x, y, time)
        east, north = through(time)
        return np.degrees((east + u) / (R * np.cos(np.radians(y)))), np.degrees((north + v) / R)

    for k in range(steps):
        t = begin + k * dt
        a = slope(t, lon, lat)
        b = slope(t + dt / 2, lon + dt / 2 * a[0], lat + dt / 2 * a[1])
        c = slope(t + dt / 2, lon + dt / 2 * b[0], lat + dt / 2 * b[1])
        d = slope(t + dt, lon + dt * c[0], lat + dt * c[1])
        lon = lon + dt / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
        lat = lat + dt / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
    return lon, lat


@pytest.mark.thorough
def test_a_course_through_a_sheared_current_is_of_second_order(tmp_path: Path) -> None:
    """24 h at 9 kn at 58 N, set off by up to 40 nmi: under 10 m at an hour, 1 m at a quarter of
    one, and a quarter of the error with half the step.
    """
    way = 9 * KNOT * np.sin(np.radians(63)), 9 * KNOT * np.cos(np.radians(63))
    worst = []
    for step in (3600, 1800, 900):
        ensemble, (begun, ended), _ = run(tmp_path, COURSE, [0, 24 * HOUR], step=step)
        lon, lat = fine(*degrees(begun), lambda time: way, np.zeros(150), 24 * HOUR)
        worst.append(apart(ended, lon, lat).max())
        assert (ended.status == Status.UNDER_WAY).all()
    reckoned = np.degrees(ensemble.columns["set_lat"].to_numpy() * sphere.UNIT) * 60
    assert np.abs(reckoned).max() > 5  # the current matters: so many nautical miles
    assert worst[0] < 10
    assert worst[1] / worst[0] == pytest.approx(0.25, abs=0.07)
    assert worst[2] < 1


class Voyage:
    """The dead-reckoned positions of vessels, and how they go through the water; they pass way
    points at whole seconds.
    """

    def __init__(self, departure: Array, speed: Array) -> None:
        x, y = np.radians(np.array(POINTS)).T
        self.points = np.stack([np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y)], axis=1)
        self.angle = np.arccos((self.points[:-1] * self.points[1:]).sum(axis=1))
        lasting = np.round(self.angle[:, None] * R / speed)
        self.passes = departure + np.concatenate(
            [np.zeros_like(lasting[:1]), np.cumsum(lasting, axis=0)]
        )

    def through(self, time: Array, leg: int) -> tuple[Array, Array]:
        rate = self.angle[leg] / (self.passes[leg + 1] - self.passes[leg])
        share = (time - self.passes[leg]) * rate
        a, b, angle = self.points[leg], self.points[leg + 1], self.angle[leg]
        place = (np.sin(angle - share)[:, None] * a + np.sin(share)[:, None] * b) / np.sin(angle)
        way = (-np.cos(angle - share)[:, None] * a + np.cos(share)[:, None] * b) / np.sin(angle)
        lon, lat = np.arctan2(place[:, 1], place[:, 0]), np.arcsin(place[:, 2])
        east = way[:, 1] * np.cos(lon) - way[:, 0] * np.sin(lon)
        north = way[:, 2] * np.cos(lat) - (
            way[:, 0] * np.cos(lon) + way[:, 1] * np.sin(lon)
        ) * np.sin(lat)
        return rate * R * east, rate * R * north


@pytest.mark.thorough
def test_a_voyage_misses_its_way_points_and_goes_adrift_from_where_it_is(tmp_path: Path) -> None:
    """Places inside steps, round a bend, and after the distress, by a step of 10 min.

    Over the step with the bend a vessel keeps, for up to half of it, the wrong one of its two ways
    east when what its compass course makes of the latitude it is set to is computed; else the
    scheme errs by 0.3 m, its 10 m at an hour over 36.
    """
    times = [7 * HOUR + 1000, 10 * HOUR + 333, 18 * HOUR + 60, 24 * HOUR]
    _, moments, born = run(tmp_path, VOYAGE, times, step=600)
    departure, release = born["departure"].astype(float), born["release"].astype(float)
    way = Voyage(departure, born["speed"].astype(float))
    arrival = way.passes[2]
    lon, lat = np.full(150, POINTS[0][0]), np.full(150, POINTS[0][1])
    some = 0
    for moment in moments:
        stop = np.minimum(np.minimum(release, arrival), moment.elapsed)
        x, y, begin = lon, lat, departure
        for leg in (0, 1):
            end = np.maximum(np.minimum(stop, way.passes[leg + 1]), begin)
            x, y = fine(x, y, lambda time, leg=leg: way.through(time, leg), begin, end)
            begin = end
            if leg == 0:
                turned = way.through(end, 1)[0] - way.through(end, 0)[0]
                shrunk = 1 - np.cos(np.radians(y)) / np.cos(np.radians(POINTS[1][1]))
                bend = np.where(end == way.passes[1], 300 * np.abs(turned * shrunk), 0.0)
        adrift = (release < arrival) & (release <= moment.elapsed)
        ahead = np.where(adrift, moment.elapsed, stop)
        x, y = fine(x, y, lambda time: (0.0, 0.0), stop, ahead)
        off = apart(moment, x, y)
        assert (off < 1.05 * bend + 0.3).all()  # 3 % more by the current's shear until the end
        assert (moment.status == Status.ADRIFT).tolist() == adrift.tolist()
        some += adrift.sum()
    assert some > 100
    arrived = release > arrival
    assert arrived.sum() > 10
    ended = moments[-1].lon[arrived] * sphere.UNIT, moments[-1].lat[arrived] * sphere.UNIT
    # it missed its last way point
    assert sphere.distance(*ended, *np.radians(POINTS[-1])).min() > 5_000


@pytest.mark.parametrize("tail", [pytest.param("", marks=pytest.mark.thorough), ", tail = 4"])
def test_the_current_s_error_is_that_of_what_drifts(tmp_path: Path, tail: str) -> None:
    """Displacements by an Ornstein-Uhlenbeck error: variance 2 s^2 T (t - T (1 - exp(-t / T))), as
    of what is adrift; with a tail Student's.
    """
    n, std, memory, time = 4000, 0.2, 9 * HOUR, 24 * HOUR
    error = f'{{ current = {{ std = "{std} m/s", time = "9 h"{tail} }} }}'
    ends = []
    for uncertainty in ('{ current = "none" }', error):
        source = "constant = { east = 0.3, north = -0.2 }"
        _, (ended,), _ = run(
            tmp_path, COURSE, [time], n=n, uncertainty=uncertainty, step=3600, source=source
        )
        ends += [ended.lon * sphere.UNIT, ended.lat * sphere.UNIT]
    expected = 2 * std**2 * memory * (time - memory * (1 - np.exp(-time / memory)))
    both = sphere.offset(*ends)
    if tail:
        square = both[0] ** 2 + both[1] ** 2
        assert stats.kstest(1 - (1 + square / (2 * expected)) ** -2.0, "uniform").pvalue > 1e-3
        return
    for moved in both:
        assert moved.mean() == pytest.approx(0, abs=3 * np.sqrt(expected / n))
        assert moved.var() == pytest.approx(expected, rel=3 * np.sqrt(2 / n))


@pytest.mark.thorough
def test_sensors_see_it_where_it_is(tmp_path: Path) -> None:
    """In a uniform current a vessel that feels it goes as one does with the sum of both velocities,
    that makes it good.
    """
    flow, way = (
        np.array([0.62, -0.37]),
        9 * KNOT * np.array([np.sin(np.radians(63)), np.cos(np.radians(63))]),
    )
    over_ground = flow + way
    course, speed = np.degrees(np.arctan2(*over_ground)), np.hypot(*over_ground) / KNOT
    source = f"constant = {{ east = {flow[0]}, north = {flow[1]} }}"
    sensors = """
    sortie = [{ name = "leg", start = "+5 h", sweep_width = "3 nmi", speed = "20 kn", waypoints = [[-39.3, 57.7], [-37.6, 58.8], [-37.9, 57.9]] }]
    presence = [{ name = "field", start = "+3.3 h", end = "+8.2 h", at = [-38.4, 58.3], width = "9 nmi", height = "14 nmi", turned = 25, present = "never" }]
    barrier = [{ name = "line", start = "+2 h", end = "+13.5 h", points = [[-37.5, 58.0], [-37.2, 59.2]], detection = 0.7 }]
    """
    told = []
    for text in (
        COURSE,
        COURSE.replace("course = 63", f"course = {course:.7f}").replace(
            '"9 kn"', f'"{speed:.8f} kn"'
        ),
    ):
        path = tmp_path / "felt.toml"
        head = HEAD.format(**{**SHEARED, "n": 3000, "source": source, "step": 2700})
        if text != COURSE:
            head = head.replace('"felt" }', '"compensated" }')
        path.write_text(sensors + head + text)
        case = case_file.load(path)
        begin = run_setup.prepare(case, run_setup.open_for(case))
        search = run_setup.build_search_filter(case, begin, run_setup.beliefs(case, begin))
        list(simulate.run(begin.ensemble, begin.scene, begin.clock, np.empty(0), search=search))
        begin.scene.forcing.close()
        assert search is not None
        told.append([float(-np.expm1(update.log_evidence[-1])) for update in search.updates.all])
    assert min(told[0]) > 0.05
    assert max(told[0]) < 0.95
    assert told[0] == pytest.approx(told[1], rel=2e-3)


def test_what_the_current_sets_ashore_runs_aground(tmp_path: Path) -> None:
    """A voyage clear of land, along a coast onto which the current sets: it ends there, and not
    before it can have come there.
    """
    coast = tmp_path / "coast.geojson"
    ring = [[-42.0, 57.0], [-30.0, 57.0], [-30.0, 57.85], [-42.0, 57.85], [-42.0, 57.0]]
    land = {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    coast.write_text(json.dumps({"type": "FeatureCollection", "features": [land]}))
    text = HEAD.replace('{{ source = "none" }}', f'{{{{ source = "{coast}" }}}}')
    path = tmp_path / "felt.toml"
    eastward = COURSE.replace("15 nmi", "2 nmi").replace("course = 63", "course = 90")
    path.write_text(
        text.format(**{**SHEARED, "source": "constant = { east = 0.0, north = -0.4 }"}) + eastward
    )
    case = case_file.load(path)
    begin = run_setup.prepare(case, run_setup.open_for(case))
    begun, ended = simulate.run(begin.ensemble, begin.scene, begin.clock, np.array([0, 24 * HOUR]))
    begin.scene.forcing.close()
    lon, lat = degrees(begun)
    due = np.radians(lat - 57.85) * R / 0.4
    middle = np.radians((lat + 57.85) / 2)
    assert (ended.status == Status.AGROUND).all()
    assert (
        apart(
            ended, lon + np.degrees(9 * KNOT * due / (R * np.cos(middle))), np.full(150, 57.85)
        ).max()
        < 50
    )
    assert begin.ensemble.status_since.to_numpy() == pytest.approx(due, abs=5)
