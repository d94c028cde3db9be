"""Check that sonars are in water."""

from collections.abc import Callable, Iterable

import numpy as np
import shapely

from drift.evidence.sensors.records import Sensor, Sonar
from geo import notation
from geo.array import Array
from geo.box import Box
from geo.errors import UserError

ROUND = 0.05  # [deg] half size of the box about a sonar whose land is read


def check_sonars_in_water(sensors: Iterable[Sensor], lands: Callable[[Box], Array]) -> None:
    """Reject sonars whose position is on land.

    Args:
        sensors: of the case.
        lands: returns the polygons of land [deg] in a box.

    Raises:
        UserError: with one line per sonar on land.
    """
    wrong = []
    for sensor in sensors:
        if sensor.place is None or not isinstance(sensor.sees, Sonar):
            continue
        lon, lat = sensor.place
        polygons = lands(
            Box(lon - ROUND, max(lat - ROUND, -90.0), lon + ROUND, min(lat + ROUND, 90.0))
        )
        turns = np.array([-360.0, 0.0, 360.0])  # the polygons may use other longitudes
        if any(
            shapely.contains_xy(polygon, lon + turns, np.full(3, lat)).any() for polygon in polygons
        ):
            wrong.append(
                f'sensor "{sensor.name}": it is a sonar and stands on land, at {notation.position(lon, lat)}; move at into '
                "the water"
            )
    if wrong:
        raise UserError(*wrong)
