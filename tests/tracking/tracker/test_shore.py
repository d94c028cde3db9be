"""Clouds that keep off the land: draws and ways against Shapely on the polygons of the coast, in
the Strait of Gibraltar.
"""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely
from pyproj import Geod
from scipy import stats

from drift.case.tracking import tracking
from drift.tracking.tracker import density, following, path, shore, sweeps
from drift.tracking.tracker.following import Clouds, World
from drift.tracking.tracker.records import Behaviour, Filling, Tracker
from drift.tracking.tracker.shore import Shoreline
from drift.tracking.tracker.study import Study
from geo import sphere
from geo.box import Box
from geo.coast import edges
from geo.coast import shore as land_of
from kernels.step import coast as device_coast
from kernels.tracking.clouds import DETECTED, MARK, SILENT

EARTH = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
NMI, KNOT = 1852.0, 1852 / 3600
BOX = Box(-6.6, 35.2, -4.4, 36.7)
PLACE = (-5.62, 35.98)  # midway in the strait
FASTEST = 45 * KNOT
ACTS = (180.0, 900.0)
KEEPS = Tracker("keeps", Behaviour(FASTEST), Filling())
CHANGES = Tracker("changes", Behaviour(FASTEST, change=0.5, acts=ACTS), Filling())
FLEES = Tracker("flees", Behaviour(FASTEST, change=0.2, hide=0.4, acts=ACTS), Filling())
WAY = path.of_legs(*np.radians(PLACE), [path.Leg(math.radians(97), 18 * KNOT, 7200.0)])


@cache
def coast() -> Shoreline:
    built = edges.build_coast(land_of.read_land("gshhg", BOX), BOX)
    return Shoreline(built, device_coast.upload(built))


@cache
def land() -> shapely.Geometry:
    whole = shapely.union_all(list(coast().coast.polygons))
    shapely.prepare(whole)
    return whole


def told(
    *parts: tuple[float, float, float, float, float], marks: tuple[float, ...] = (), silent: tuple[float, float] | None = None,
    at: tuple[float, float] = PLACE,
) -> World:  # fmt: skip
    """Return detections from a place, (time, bearing, half [deg], near, far [nmi]), marks [s], and
    a sweep, (time, reach), that found nothing.
    """
    rows = [(*part, DETECTED) for part in parts] + [
        (time, 0.0, 0.0, 0.0, 0.0, MARK) for time in marks
    ]
    rows += [(silent[0], 0.0, 180.0, 0.0, silent[1], SILENT)] if silent else []
    time, bearing, half, near, far, kind = np.array(rows).T
    columns = sweeps.Sweeps(
        time, np.tile(path.vector(*np.radians(at)), (len(rows), 1)), np.radians(bearing), np.radians(half),
        near * NMI / sphere.RADIUS, far * NMI / sphere.RADIUS, kind.astype(np.int32), np.full(len(rows), -1, np.int32),
    )  # fmt: skip
    return World(WAY, sweeps.ordered([columns]))


def places(batch: Clouds, way: int, time: float) -> tuple[np.ndarray, np.ndarray]:
    return path.degrees(batch.particles(way, 0, time).place)


def test_what_is_drawn_from_a_box_is_in_its_water() -> None:
    """Uniform in range and bearing, but for the land: against draws that Shapely sorts out."""
    n = 20_000
    found = places(
        Clouds([told((60.0, 290.0, 70.0, 1.0, 21.0))], [KEEPS], n, 5, shore=coast().device).go(),
        0,
        60.0,
    )
    rng = np.random.default_rng(2)
    bearing, far = rng.uniform(220, 360, 8 * n), rng.uniform(1, 21, 8 * n)
    lon, lat, _ = EARTH.fwd(np.full(8 * n, PLACE[0]), np.full(8 * n, PLACE[1]), bearing, far * NMI)
    wet = ~shapely.contains_xy(land(), lon, lat)
    assert 0.3 < wet.mean() < 0.7
    assert len(found[0]) == n
    assert not shapely.contains_xy(land(), *found).any()
    ahead, _, apart = EARTH.inv(np.full(n, PLACE[0]), np.full(n, PLACE[1]), *found)
    for ours, theirs in (
        (ahead % 360, bearing[wet]),
        (apart / NMI, far[wet]),
        (ahead % 360 + 3 * apart / NMI, (bearing + 3 * far)[wet]),
    ):
        assert stats.ks_2samp(ours, theirs).pvalue > 1e-3


def test_a_box_on_land_places_nobody_and_loses_the_track() -> None:
    world = told((60.0, 0.0, 20.0, 12.0, 15.0), (600.0, 275.0, 10.0, 2.0, 6.0))
    batch = Clouds([world], [KEEPS], 500, 5, shore=coast().device)
    assert len(batch.go(60.0).particles(0, 0, 60.0).weight) == 0
    assert len(batch.go(600.0).particles(0, 0, 600.0).weight) == 500


@pytest.mark.thorough
@pytest.mark.parametrize("way", [0, 1, 2], ids=["keeps", "changes", "flees"])
def test_no_particle_crosses_land(way: int) -> None:
    """Looked at every 20 s for two hours: no place and no way between two is on land, but for the
    turns at the shore between.

    A way between two looks may cut a cape round which a particle went: it turned in between, so
    that it has another course then. Courses of those that did not turn lie on one great circle, and
    none of these crosses land.
    """
    times = np.arange(60.0, 7260.0, 20.0)
    law = [KEEPS, CHANGES, FLEES][way]
    batch = Clouds(
        [told((60.0, 300.0, 60.0, 0.5, 12.0), marks=tuple(times))],
        [law],
        300,
        11,
        shore=coast().device,
    )
    before, turned, crossed, moved = None, 0, 0, []
    # 0.2 m: places are of whole units of 9 mm, great circles bulge 3 cm off their chords
    inner = land().buffer(-2e-6)
    shapely.prepare(inner)
    for time in times:
        now = batch.go(time).particles(0, 0, time)
        lon, lat = path.degrees(now.place)
        assert not shapely.contains_xy(inner, lon, lat).any()
        if before is not None:
            same = np.abs(np.sum(np.cross(before.place, before.velocity) * np.cross(now.place, now.velocity), axis=1)
                          / np.linalg.norm(before.velocity, axis=1) / np.linalg.norm(now.velocity, axis=1) - 1) < 1e-12  # fmt: skip
            ends = np.array(path.degrees(before.place)).T, np.array([lon, lat]).T
            ways = shapely.linestrings(np.stack(ends, axis=1)[same])
            crossed += shapely.intersects(inner, ways).sum()
            turned += (~same).sum()
            far = EARTH.inv(*ends[0].T, lon, lat)[2] / 20.0
            moved.append((far, np.linalg.norm(before.velocity, axis=1) * sphere.RADIUS, same))
        before = now
    assert crossed == 0
    assert turned > 300  # at the shore, or by its acts
    if way == 0:  # speeds stay, whatever the turns
        rate = np.array([speed for _, speed, _ in moved])
        np.testing.assert_allclose(rate, rate[:1].repeat(len(rate), axis=0), rtol=1e-9)
        assert (np.array([far <= speed * (1 + 1e-9) for far, speed, _ in moved])).all()


def test_duplicates_keep_off_the_land_too() -> None:
    """What a sweep that finds nothing leaves is copied; the copies were not looked ahead for
    farther than their originals.
    """
    times = tuple(np.arange(620.0, 4000.0, 20.0))
    world = told((60.0, 270.0, 40.0, 0.5, 6.0), marks=times, silent=(600.0, 4.0))
    batch = Clouds([world], [KEEPS], 300, 8, shore=coast().device)
    assert len(batch.go(599.0).particles(0, 0, 599.0).weight) == 300
    left = batch.go(600.0).particles(0, 0, 600.0).place
    assert len(left) == 300
    assert len(np.unique(left, axis=0)) < 225  # the others are copies
    inner = land().buffer(-2e-6)
    for time in times:
        assert not shapely.contains_xy(inner, *places(batch.go(time), 0, time)).any()


def test_far_north_parallels_are_short() -> None:
    """Off Spitsbergen, where a degree of longitude is a fifth of one of latitude, nobody comes
    ashore on Prins Karls Forland.
    """
    box = Box(2.0, 76.5, 25.0, 80.5)
    built = edges.build_coast(land_of.read_land("gshhg", box), box)
    # 0.2 m of a parallel
    inner = shapely.union_all([shape.buffer(-1e-5) for shape in built.polygons])
    times = tuple(np.arange(80.0, 6000.0, 20.0))
    world = told((60.0, 90.0, 60.0, 0.5, 9.0), marks=times, at=(8.9, 78.4))
    batch, met = Clouds([world], [KEEPS], 800, 8, shore=device_coast.upload(built)), 0
    before = batch.go(60.0).particles(0, 0, 60.0)
    for time in times:
        now = batch.go(time).particles(0, 0, time)
        assert not shapely.contains_xy(inner, *path.degrees(now.place)).any()
        met += (
            np.linalg.norm(
                np.cross(now.place, now.velocity) - np.cross(before.place, before.velocity), axis=1
            )
            > 1e-9
        ).sum()
        before = now
    assert met > 100  # turned


@pytest.mark.thorough
def test_open_sea_changes_no_bit() -> None:
    """Where nothing comes to a shore, all is as without one."""
    at = replace(KEEPS, behaviour=Behaviour(2 * KNOT, change=0.5, acts=ACTS))
    parts = ((60.0, 200.0, 60.0, 0.8, 2.0), (900.0, 200.0, 20.0, 0.8, 2.0))
    world = told(*parts, marks=(300.0, 1200.0))
    found = []
    for shoreline in (None, coast().device):
        batch = Clouds([world], [at], 800, 3, shore=shoreline).go()
        found.append(batch.particles(0, 0, 1200.0))
    for name in ("place", "velocity", "weight", "mode"):
        np.testing.assert_array_equal(getattr(found[0], name), getattr(found[1], name))


def test_times_that_are_shown_change_no_turn() -> None:
    """At 45 knots for two hours among two shores, with one mark and with 959, particles end at the
    same bits.
    """
    box = (60.0, 300.0, 60.0, 0.5, 12.0)
    worlds = [told(box, marks=marks) for marks in ((7260.0,), tuple(np.arange(75.0, 7260.1, 7.5)))]
    clouds = [Clouds([world], [FLEES], 400, 2, shore=coast().device).go() for world in worlds]
    one, two = (batch.particles(0, 0, 7260.0) for batch in clouds)
    for name in ("place", "velocity", "mode"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_areas_leave_the_land_out() -> None:
    """The middles of all cells that have anything are in water, by Shapely, and there as dense as
    without land.

    The outlines hold their shares of another cloud that keeps off: half of a cell along the shore
    is all that is lost of it.
    """
    place = [
        Clouds(
            [told((60.0, 290.0, 70.0, 1.0, 21.0))], [KEEPS], 2000, seed, shore=coast().device
        ).go()
        for seed in (5, 6)
    ]
    cloud, other = (batch.particles(0, 0, 60.0) for batch in place)
    with_land = density.surface(cloud.place, cloud.weight)
    without = density.surface(cloud.place, cloud.weight, coast().dry)
    lon, lat = (np.degrees(v) for v in without.grid.places(*np.meshgrid(*without.grid.middles())))
    dry = shapely.contains_xy(land(), lon, lat)
    assert (without.height[dry] == 0).all()
    np.testing.assert_array_equal(without.height[~dry], with_land.height[~dry])
    mass = with_land.height * with_land.grid.areas()
    assert 0.05 < mass[dry].sum() < 0.5
    for region in density.areas(without, (0.5, 0.9)).values():
        assert not shapely.contains_xy(region.outline, lon[dry], lat[dry]).any()
    lon, lat = path.degrees(other.place)
    for share, region in density.areas(without, (0.5, 0.9)).items():
        held = shapely.contains_xy(region.outline, lon, lat).mean()
        assert held == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) * 2 / 2000))


def test_the_coast_of_a_case_is_all_that_its_particles_may_come_to() -> None:
    """By pyproj: as far as the sensors reach and the fastest go, in all directions from all places
    of the tracker, across 180 degrees.
    """
    asked = tracking.load("lost_contact")
    way = path.of_legs(
        math.radians(179.2), math.radians(-16.4), [path.Leg(math.radians(80), 20 * KNOT, asked.end)]
    )
    case = replace(asked, tracker=way)
    assert isinstance(case, Study)
    box = shore.within_reach(case)
    assert isinstance(case.target, type(asked.target))
    far = 60 * NMI + 32 * KNOT * (asked.end - float(case.target.time[0]))  # type: ignore[union-attr]
    assert max(sensor.reach for sensor in case.sensors) == pytest.approx(60 * NMI)
    lon, lat = path.degrees(way.place)
    for course in range(0, 360, 5):
        x, y, _ = EARTH.fwd(lon, lat, np.full(lon.size, course), np.full(lon.size, far))
        assert ((x - box.west) % 360 <= box.east - box.west).all()
        assert ((y >= box.south) & (y <= box.north)).all()
    found = shore.of_study(case)
    assert found is not None
    # Viti Levu
    assert found.dry(np.radians([178.0, -179.5]), np.radians([-17.8, -17.0])).tolist() == [
        True,
        False,
    ]
    assert shore.of_study(replace(case, minds_land=False)) is None


def test_a_target_that_acts_keeps_off_the_land_too() -> None:
    begin = path.of_legs(*np.radians(PLACE), [path.Leg(math.radians(262), 20 * KNOT, 7200.0)])
    inner, moments, ashore = land().buffer(-2e-6), np.arange(20.0, 7200.0, 20.0), []
    for shoreline in (coast().device, None):
        ways = following.wanders(begin, FLEES.behaviour, WAY, moments, 40, 4, shoreline)
        lon, lat = path.degrees(np.concatenate([way.at(moments)[0] for way in ways]))
        ashore.append(shapely.contains_xy(inner, lon, lat).any())
    assert ashore == [False, True]
