"""Ways of trackers and targets against pyproj's geodesics on the sphere."""

import numpy as np
from pyproj import Geod

from drift.tracking.tracker import path
from drift.tracking.tracker.path import Leg
from geo import sphere

EARTH = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
KNOT, HOUR = 1852 / 3600, 3600.0


def test_great_circles_between_way_points_across_the_antimeridian() -> None:
    lon, lat = [179.2, -179.1, -178.4], [-41.3, -40.2, -41.9]
    way = path.through([100.0, 7300.0, 12_000.0], np.radians(lon), np.radians(lat))
    for begin, end, first in ((100.0, 7300.0, 0), (7300.0, 12_000.0, 1)):
        share = np.array([0.13, 0.5, 0.91])
        places, velocity = way.at(begin + share * (end - begin))
        azimuth, _, far = EARTH.inv(lon[first], lat[first], lon[first + 1], lat[first + 1])
        to_lon, to_lat, back = EARTH.fwd(
            [lon[first]] * 3, [lat[first]] * 3, [azimuth] * 3, share * far
        )
        np.testing.assert_allclose(path.degrees(places), [to_lon, to_lat], atol=1e-10)
        course = np.degrees(path.course(places, velocity))
        np.testing.assert_allclose((course - back) % 360, 180, atol=1e-6)
        np.testing.assert_allclose(
            np.linalg.norm(velocity, axis=1) * sphere.RADIUS, far / (end - begin)
        )


def test_legs_keep_their_course_and_speed() -> None:
    """Between any two of its places a second apart the azimuth is the leg's; so it comes 17 kn
    times 3 h far.
    """
    legs = [Leg(np.radians(271.0), 17 * KNOT, 3 * HOUR), Leg(np.radians(33.0), 9 * KNOT, 2 * HOUR)]
    way = path.of_legs(np.radians(-179.6), np.radians(52.0), legs)
    for begin, leg in ((0.0, legs[0]), (3 * HOUR, legs[1])):
        time = begin + np.linspace(0.02, 0.98, 25) * leg.lasting
        lon, lat = path.degrees(way.at(time)[0])
        to_lon, to_lat = path.degrees(way.at(time + 1.0)[0])
        azimuth, _, far = EARTH.inv(lon, lat, to_lon, to_lat)
        # A great circle of 5 km turns by 5 km / R tan 52 degrees from end to end, half of it on
        # either side.
        slack = np.degrees(path.LONGEST / sphere.RADIUS * np.tan(np.radians(52.2)) / 2)
        assert np.abs((azimuth - np.degrees(leg.course) + 180) % 360 - 180).max() < slack + 1e-6
        np.testing.assert_allclose(far, leg.speed, rtol=1e-6)
    after = way.at([way.time[-1] + 500.0])
    np.testing.assert_allclose(after[0][0], way.place[-1], atol=1e-15)
    assert not after[1].any()
