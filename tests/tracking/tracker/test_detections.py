"""Detections as they were written down: their boxes, when silence counts, and the track that comes
of them.
"""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from pyproj import Geod

from drift.case.tracking import tracking
from drift.tracking.tracker import density, detections, holding, path
from drift.tracking.tracker.detections import Detections
from drift.tracking.tracker.following import Clouds, World
from drift.tracking.tracker.records import Plan, Sensor
from geo import sphere
from geo.notation import NMI
from kernels.tracking.clouds import DETECTED, SILENT

EARTH = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
LON, LAT = np.radians([-76.3, 14.2])
RADAR = Sensor("radar", 18 * NMI, 0.1, np.radians(1.5), 60.0, Plan(0.0, 1800.0, 600.0), grace=150.0)
EARS = Sensor("ears", 60 * NMI, 0.8, np.radians(5.0), 1.2, hears=True)
NAN = float("nan")


def found(*rows: tuple[float, int, float, float]) -> Detections:
    time, sensor, bearing, far = np.array(rows).T
    return Detections(time, sensor.astype(int), np.radians(bearing), far * NMI)


def test_a_detection_has_the_box_of_what_was_measured() -> None:
    way = path.standing(LON, LAT, 0.0, 3600.0)
    seen = found((40, 0, 33, 17.5), (50, 1, 300, NAN), (60, 0, NAN, 4))
    parts = detections.swept((RADAR, EARS), seen, way, 3600.0)
    whole = [part for part in parts if (part.outcome == DETECTED).all()]
    near, far, half = (
        np.concatenate([getattr(part, key) for part in whole]) for key in ("near", "far", "half")
    )
    np.testing.assert_allclose(near * sphere.RADIUS / NMI, [15.75, 3.6, 0])
    np.testing.assert_allclose(far * sphere.RADIUS / NMI, [18, 4.4, 60])  # at most the reach
    np.testing.assert_allclose(np.degrees(half), [1.5, 180, 5])


def test_silence_counts_while_a_sensor_is_on_and_known_and_not_near_its_detections() -> None:
    """On 0 to 10 and 30 to 40 min, every minute; known until 35 min; detected at 4 min 30 s, and
    heard, somewhere, at 8 min.
    """
    way = path.standing(LON, LAT, 0.0, 35 * 60.0)
    seen = found((270, 0, 33, 12), (480, 1, 20, NAN))
    parts = detections.swept((RADAR, EARS), seen, way, 3600.0)
    silent = [part for part in parts if len(part) and (part.outcome == SILENT).all()]
    (radar,) = silent
    # from 2.5 min off
    np.testing.assert_allclose(radar.time / 60, [0, 1, 2, 7, 8, 9, 30, 31, 32, 33, 34, 35])
    np.testing.assert_allclose(radar.far * sphere.RADIUS, RADAR.reach)


@pytest.mark.parametrize(("bearing", "far", "reach", "counts"), [
    # eyes saw it within the radar's reach, so that the radar's log is not whole
    (33, 9, 12, False),
    (33, 11.9, 12, False),
    (NAN, 9, 12, False),  # wherever the ring, it was within reach
    (33, 12.1, 12, True),  # it was beyond: nothing to say
    (33, NAN, 12, True),  # it was anywhere to 20 nmi: the radar's silence says that it was beyond
    (33, NAN, 20, False),  # it was within reach, wherever on the bearing
])  # fmt: skip
def test_silence_does_not_count_near_what_another_sensor_detected_within_reach(
    bearing: float, far: float, reach: float, counts: bool
) -> None:
    """The radar sweeps every minute of ten; eyes that reach 20 nmi detect something at 4 min 30 s;
    its grace is 2 min 30 s.
    """
    way = path.standing(LON, LAT, 0.0, 3600.0)
    radar = replace(RADAR, reach=reach * NMI)
    eyes = Sensor("eyes", 20 * NMI, 0.3, np.radians(1.5), 12.0, Plan(np.inf))
    times, none = detections.silences((radar, eyes), found((270, 1, bearing, far)), way, 600.0)
    np.testing.assert_allclose(
        times / 60, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9] if counts else [0, 1, 2, 7, 8, 9]
    )
    assert none.size == 0


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have one cloud of other random numbers in place of nine, where nothing is asked of them: they
    are most of the time.
    """
    monkeypatch.setattr(holding, "OTHERS", 1)


@pytest.mark.thorough
@pytest.mark.usefixtures("alone")
def test_a_track_follows_its_detections_and_its_areas_grow_in_silence() -> None:
    asked = tracking.load("lost_contact")
    seen = asked.target
    assert isinstance(seen, Detections)
    held = holding.hold(asked)
    assert (np.diff(held.time) >= 0).all()
    assert held.detected.sum() == len(seen.time)
    before = held.time < seen.time[0]
    assert np.isnan(held.place[before]).all()
    assert np.isfinite(held.place[~before]).all()
    assert held.lost == ()
    # Radar plots: the estimate lies within the box, so no farther from the plot than its corners.
    at = asked.tracker.at(seen.time)[0]
    lon, lat = np.array(path.degrees(held.place[held.detected]))
    own = np.array(path.degrees(at))
    azimuth, _, distance = EARTH.inv(own[0], own[1], lon, lat)
    radar = ~np.isnan(seen.range)
    assert (np.abs(distance[radar] / seen.range[radar] - 1) < 0.05).all()
    off = (azimuth - np.degrees(seen.bearing) + 180) % 360 - 180
    assert (np.abs(off[radar]) < 1.0).all()
    assert (np.abs(off[~radar]) < 5.0).all()
    clouds = [one.cloud for one in held.shown if one.cloud is not None and one.time >= 4200]
    spread = [path.arc(cloud.place, cloud.place.mean(axis=0)).std() for cloud in clouds]
    assert spread[0] < spread[1] < spread[2]


@pytest.mark.thorough
def test_a_track_is_lost_and_found_again() -> None:
    """Within reach of a radar that finds nothing no particle is left; a later detection begins
    again.
    """
    asked = tracking.load("lost_contact")
    seen = found((60, 1, 40, 6), (3000, 1, 20, 9))
    radar = replace(asked.sensors[0], reach=30 * NMI, on=Plan())
    eyes = Sensor("eyes", 30 * NMI, 0.3, np.radians(1.5), 7.0, Plan(3400.0))  # off until then
    way = path.standing(LON, LAT, 0.0, asked.end)
    method = asked.methods[0]
    for bulk in (0.1, 0.0):
        kind = replace(method, filling=replace(method.filling, bulk=bulk))
        held = holding.hold(
            replace(
                asked,
                target=seen,
                sensors=(eyes, radar),
                tracker=way,
                methods=(kind,),
                shown=(2000.0, 3000.0),
            )
        )
        assert [one.cloud is None for one in held.shown] == [True, False]
        assert [one.holding for one in held.shown] == [0, 9]
        # The first silence that counts, by sweeps of 2.4 s, 300 s after each detection
        assert [(loss.time, *loss.sensors) for loss in held.lost] == [
            (360.0, radar),
            (3300.0, radar),
        ]


def test_no_silence_counts_from_when_a_path_begins_that_no_log_tells_of() -> None:
    """The tracker's legs go on to the end; where it looks for the target from 7 minutes on it is
    elsewhere. Else silence counts from 450 s.
    """
    asked = tracking.load("lost_contact")
    assert asked.pursuit is not None
    radar = replace(RADAR, interval=10.0, on=Plan())
    given = replace(
        asked, target=found((300, 0, 70, 8)), sensors=(radar,), tracker=path.standing(LON, LAT, 0.0, 900.0), end=900.0,
        shown=(900.0,), logged=False,
    )  # fmt: skip
    chase = replace(asked.pursuit, begin=420.0, interval=120.0, steps=4)
    cases = (
        (None, False, [450.0]),
        (chase, False, []),
        (chase, True, [450.0]),
        (replace(chase, begin=460.0), False, [450.0]),
    )
    for pursuit, logged, lost in cases:
        held = holding.hold(replace(given, pursuit=pursuit, logged=logged))
        assert [loss.time for loss in held.lost] == lost
        assert (held.shown[0].cloud is None) == bool(lost)


@pytest.mark.thorough
def test_a_loss_is_told_where_a_detection_finds_the_target_before_any_figure() -> None:
    """Figures at the begin and the end alone; silence rules out all from 5 minutes after a plot,
    when no radar is off.
    """
    asked = tracking.load("lost_contact")
    seen = found((61, 0, 40, 6), (800, 0, 20, 9), (1600, 0, 20, 9))
    radar = replace(asked.sensors[0], reach=30 * NMI, interval=7.0, on=Plan())
    way = path.standing(LON, LAT, 0.0, 1700.0)
    held = holding.hold(
        replace(
            asked,
            target=seen,
            sensors=(radar,),
            tracker=way,
            every=1700.0,
            end=1700.0,
            shown=(1700.0,),
            pursuit=None,
        )
    )
    assert held.detected.sum() == 3
    assert np.isfinite(held.place[1:]).all()
    assert [loss.time for loss in held.lost] == [7 * np.ceil(361 / 7), 7 * np.ceil(1100 / 7)]


def test_the_mean_of_a_ring_lies_within_none_of_its_areas() -> None:
    """A range alone, of 8 nmi +- 10 %: the areas are a ring, and its mean is on the tracker; a
    bearing later it is not.
    """
    asked = tracking.load("lost_contact")
    seen = found((300, 0, NAN, 8), (600, 0, 70, 8.3))
    way = path.standing(LON, LAT, 0.0, 900.0)
    held = holding.hold(
        replace(
            asked,
            target=seen,
            sensors=(RADAR,),
            tracker=way,
            end=900.0,
            every=150.0,
            shown=(300.0,),
            pursuit=None,
        )
    )
    assert held.time.tolist() == [0.0, 150.0, 300.0, 450.0, 600.0, 750.0, 900.0]
    own = np.isfinite(held.place[:, 0])
    assert own.tolist() == [False, False, True, True, True, True, True]
    assert (path.arc(held.place[2:4], path.vector([LON], [LAT])) * sphere.RADIUS < 0.5 * NMI).all()
    assert np.isfinite(held.within).tolist() == [False, False, False, False, True, True, True]
    ring = held.areas[2][0.9].outline
    east, north = (ring.bounds[k + 2] - ring.bounds[k] for k in range(2))
    assert east * np.cos(LAT) * 60 / 2 == pytest.approx(8.8, rel=0.03)  # the farthest of the box
    assert north * 60 / 2 == pytest.approx(8.8, rel=0.03)


@pytest.mark.thorough
def test_other_clouds_say_how_far_areas_go_by_chance() -> None:
    """The least and the largest area are those of ten clouds, each followed alone by the random
    numbers of a run of its own.
    """
    asked = tracking.load("lost_contact")
    seen = found((300, 0, 70, 8), (1300, 0, 75, 9))
    way = path.standing(LON, LAT, 0.0, 1500.0)
    given = replace(
        asked,
        target=seen,
        sensors=(replace(RADAR, on=Plan(np.inf)),),
        tracker=way,
        end=1500.0,
        shown=(900.0, 1500.0),
        pursuit=None,
        size=300,
    )
    held = holding.hold(given)
    assert len(held.shown) == 2
    for one in held.shown:
        sizes, clouds = [], []
        for run in range(10):
            marks = np.array([one.time])
            told = detections.ordered(given.sensors, seen, way, marks, given.end)
            alone = Clouds([World(way, told)], given.methods, 300, given.seed, run=run).go(one.time)
            cloud = alone.particles(0, 0, one.time)
            clouds.append(cloud)
            sizes.append(density.areas(density.surface(cloud.place, cloud.weight), holding.SHARES))
        for share in holding.SHARES:
            each = [regions[share].area for regions in sizes]
            assert one.sizes[share] == pytest.approx((min(each), max(each)), rel=1e-9)
            assert held.areas[held.row(one.time)][share].area == pytest.approx(each[0], rel=1e-9)
            assert max(each) > 1.05 * min(each)
            outline = sizes[0][share].outline
            inside = [
                c.weight[shapely.contains_xy(outline, *path.degrees(c.place))].sum()
                for c in clouds[1:]
            ]
            assert one.within[share] == pytest.approx(np.mean(inside), rel=1e-9)
            assert abs(one.within[share] - share) < 0.15
        assert one.holding == holding.OTHERS == 9


@pytest.mark.thorough
@pytest.mark.usefixtures("alone")
def test_the_times_shown_do_not_change_the_track() -> None:
    asked = tracking.load("lost_contact", {"particles": "600"})
    one = holding.hold(replace(asked, shown=(asked.end,)))
    two = holding.hold(replace(asked, shown=(600.0, 2700.0, asked.end)))
    same = np.isin(two.time, one.time)
    assert same.sum() == len(one.time)
    for name in ("time", "place", "course", "speed", "count"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name)[same])
