"""Detections as they were written down: their boxes, when silence counts, and the track that comes of them."""

from dataclasses import replace

import numpy as np
from pyproj import Geod

from drift.case import tracking
from drift.tracker import detections, holding, path
from drift.tracker.detections import Detections
from drift.tracker.records import Plan, Sensor
from geo import sphere
from geo.notation import NMI
from kernels.clouds import DETECTED, SILENT

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
    near, far, half = (np.concatenate([getattr(part, key) for part in whole]) for key in ("near", "far", "half"))
    np.testing.assert_allclose(near * sphere.RADIUS / NMI, [15.75, 3.6, 0])
    np.testing.assert_allclose(far * sphere.RADIUS / NMI, [18, 4.4, 60])  # at most the reach
    np.testing.assert_allclose(np.degrees(half), [1.5, 180, 5])


def test_silence_counts_while_a_sensor_is_on_and_known_and_not_near_its_detections() -> None:
    """On 0 to 10 and 30 to 40 min, every minute; known until 35 min; detected at 4 min 30 s and by another at 8 min."""
    way = path.standing(LON, LAT, 0.0, 35 * 60.0)
    seen = found((270, 0, 33, 12), (480, 1, 20, NAN))
    parts = detections.swept((RADAR, EARS), seen, way, 3600.0)
    silent = [part for part in parts if len(part) and (part.outcome == SILENT).all()]
    (radar,) = silent
    np.testing.assert_allclose(radar.time / 60, [0, 1, 2, 7, 8, 9, 30, 31, 32, 33, 34, 35])  # from 2.5 min off
    np.testing.assert_allclose(radar.far * sphere.RADIUS, RADAR.reach)


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
    spread = [path.arc(c.place, c.place.mean(axis=0)).std() for t, c in held.clouds if c is not None and t >= 4200]
    assert spread[0] < spread[1] < spread[2]


def test_a_track_is_lost_and_found_again() -> None:
    """Within reach of a radar that finds nothing no particle is left; a later detection begins anew."""
    asked = tracking.load("lost_contact")
    seen = found((60, 0, 40, 6), (3000, 0, 20, 9))
    radar = replace(asked.sensors[0], reach=30 * NMI, on=Plan())
    way = path.standing(LON, LAT, 0.0, asked.end)
    method = asked.methods[0]
    for bulk in (0.1, 0.0):
        kind = replace(method, filling=replace(method.filling, bulk=bulk))
        held = holding.hold(
            replace(asked, target=seen, sensors=(radar,), tracker=way, methods=(kind,), shown=(2000.0, 3000.0))
        )
        assert [cloud is None for _, cloud in held.clouds] == [True, False]
        # The first silence that counts, by sweeps of 2.4 s, 300 s after each detection
        assert held.lost == (360.0, 3300.0)


def test_a_loss_is_told_where_a_detection_finds_the_target_before_any_figure() -> None:
    """Figures at the begin and the end alone; silence rules out all from 5 minutes after a plot, when no radar is off."""
    asked = tracking.load("lost_contact")
    seen = found((61, 0, 40, 6), (800, 0, 20, 9), (1600, 0, 20, 9))
    radar = replace(asked.sensors[0], reach=30 * NMI, interval=7.0, on=Plan())
    way = path.standing(LON, LAT, 0.0, 1700.0)
    held = holding.hold(
        replace(
            asked, target=seen, sensors=(radar,), tracker=way, every=1700.0, end=1700.0, shown=(1700.0,), pursuit=None
        )
    )
    assert held.detected.sum() == 3
    assert np.isfinite(held.place[1:]).all()
    assert held.lost == (7 * np.ceil(361 / 7), 7 * np.ceil(1100 / 7))


def test_the_times_shown_do_not_change_the_track() -> None:
    asked = tracking.load("lost_contact")
    one = holding.hold(replace(asked, shown=(asked.end,)))
    two = holding.hold(replace(asked, shown=(600.0, 2700.0, asked.end)))
    for name in ("time", "place", "course", "speed", "count"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
