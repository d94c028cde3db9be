"""Sonars on land are refused; what else stands there is not."""

import numpy as np
import pytest
import shapely

from drift.evidence.sensors import in_water, line_array, noise, spreading
from drift.evidence.sensors.records import Levels, PodGrid, Sensor, Sonar
from geo.errors import UserError


def sonar(place):
    """Return a sonar at a place."""
    own = Sonar(
        Levels(np.zeros(1), np.full((1, 1), 140.0, np.float32)), spreading.losses(1e5), noise.constant(70.0),
        line_array.of_table([[0, 3.0]]), 0.0, 6.0, 1 / 3600,
    )  # fmt: skip
    return Sensor("array", own, place)


def island(west):
    """Return what gives an island of a degree with a lake in it."""
    lake = shapely.box(west + 0.4, 10.4, west + 0.6, 10.6)
    return lambda box: np.array([shapely.difference(shapely.box(west, 10.0, west + 1, 11.0), lake)])


@pytest.mark.parametrize("west", [-70.0, 179.5, -180.5, 359.0 - 70])
def test_on_land_and_in_the_water(west):
    def at(dlon, lat):
        return sonar(((west + dlon + 180) % 360 - 180, lat))

    with pytest.raises(UserError, match='sensor "array": it is a sonar and stands on land'):
        in_water.check_sonars_in_water([at(0.2, 10.3)], island(west))
    in_water.check_sonars_in_water(
        [at(0.5, 10.5), at(-0.1, 10.3), at(0.2, 11.2), sonar(None)], island(west)
    )


def test_a_radar_may_stand_on_land():
    pod = PodGrid(
        np.full((1, 1, 2), 0.5, np.float32),
        np.empty(0, "datetime64[s]"),
        bearing=np.zeros(1),
        range=np.array([0.0, 1e4]),
    )
    in_water.check_sonars_in_water([Sensor("radar", pod, (-69.8, 10.3))], island(-70.0))
