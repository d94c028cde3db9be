"""Times and boxes of sweeps, written out as in the thesis' equations 0.23 to 0.26, with pyproj's
ranges and bearings.
"""

import numpy as np
import pytest
from pyproj import Geod

from drift.tracking.tracker import path, sweeps
from drift.tracking.tracker.records import Plan, Sensor
from geo import sphere
from kernels.tracking.clouds import DETECTED, MARK, SILENT

EARTH = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
NMI = 1852.0


def test_a_radar_that_is_on_five_minutes_of_twenty_sweeps_250_times_each() -> None:
    times = Plan(60.0, 1200.0, 300.0).sweeps(1.2, 3000.0)
    assert len(times) == 3 * 250
    np.testing.assert_allclose(times[250:253], [1260.0, 1261.2, 1262.4])
    assert times[249] == pytest.approx(60 + 249 * 1.2)
    assert times.max() < 2760


def test_always_on_is_from_the_start_to_before_the_end() -> None:
    np.testing.assert_allclose(Plan().sweeps(12.0, 61.0), [0, 12, 24, 36, 48, 60])


def test_boxes_are_about_the_true_range_and_bearing_and_end_at_the_reach() -> None:
    sensor = Sensor("esm", 60 * NMI, 0.8, np.radians(5.0), 1.2, hears=True)
    own, azimuth = (-179.9, 31.0), np.array([12.0, 171.0, 268.0, 300.0])
    far = np.array([7.0, 31.0, 45.0, 61.0]) * NMI
    lon, lat, _ = EARTH.fwd([own[0]] * 4, [own[1]] * 4, azimuth, far)
    tracker = path.standing(*np.radians(own), 0.0, 100.0)
    target = path.vector(np.radians(lon), np.radians(lat))
    heard = sweeps.of_sensor(sensor, np.arange(4.0), tracker, target)
    assert len(heard) == 3  # beyond its reach there is silence, which tells nothing
    np.testing.assert_allclose(np.degrees(heard.bearing) % 360, azimuth[:3])
    np.testing.assert_allclose(heard.near * sphere.RADIUS / NMI, [1.4, 6.2, 9.0])
    np.testing.assert_allclose(heard.far * sphere.RADIUS / NMI, [12.6, 55.8, 60.0])
    np.testing.assert_allclose(np.degrees(heard.half), 5.0)
    assert (heard.outcome == DETECTED).all()

    looks = sweeps.of_sensor(
        Sensor("eyes", 10 * NMI, 0.3, 0.03, 12.0), np.arange(4.0), tracker, target
    )
    assert looks.outcome.tolist() == [DETECTED, SILENT, SILENT, SILENT]
    np.testing.assert_allclose(looks.near[1:], 0.0)
    np.testing.assert_allclose(looks.far[1:] * sphere.RADIUS, 10 * NMI)
    np.testing.assert_allclose(looks.half[1:], np.pi)

    marked = sweeps.ordered([looks, heard, sweeps.marks(np.array([1.0, 2.5]), tracker)])
    assert marked.time.tolist() == [0, 0, 1, 1, 1, 2, 2, 2.5, 3]
    assert marked.outcome[[4, 7]].tolist() == [MARK, MARK]
    assert marked.far[0] < marked.far[1]  # those of one time in the order of the sensors
    assert marked.row[[4, 7]].tolist() == [0, 1]
    assert (np.delete(marked.row, [4, 7]) == -1).all()
    every = sweeps.ordered(
        [looks, heard, sweeps.marks(np.array([1.0, 2.5]), tracker)], every_detection=True
    )
    assert every.row.max() == 2 + 4 - 1


@pytest.mark.parametrize(("short", "times"), [(1.1, 5), (0.1, 3), (1.2, 3), (0.7, 7)])
def test_what_sensors_sweep_together_is_one_time(short: float, times: int) -> None:
    """Of multiples of an interval, whatever their binary digits: else the order of the file would
    not hold.
    """
    often, rarely = Plan(7.3).sweeps(short, 3600.0), Plan(7.3).sweeps(short * times, 3600.0)
    assert np.isin(rarely, often).all()
    np.testing.assert_allclose(np.diff(often), short, rtol=1e-5)
