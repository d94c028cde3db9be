"""A sonar stands in water: one on land is refused."""

from collections.abc import Callable, Iterable

import numpy as np
import shapely

from drift.evidence.sensors.records import Sensor, Sonar
from geo import notation
from geo.array import Array
from geo.box import Box
from geo.errors import UserError

ROUND = 0.05  # [deg] about a sonar in which land is looked for


def refuse(sensors: Iterable[Sensor], lands: Callable[[Box], Array]) -> None:
    """Raise UserError, a line for each, for sonars that stand on land; lands: gives its polygons
    [deg] in a box.
    """
    wrong = []
    for sensor in sensors:
        if sensor.place is None or not isinstance(sensor.sees, Sonar):
            continue
        lon, lat = sensor.place
        polygons = lands(
            Box(lon - ROUND, max(lat - ROUND, -90.0), lon + ROUND, min(lat + ROUND, 90.0))
        )
        turns = np.array([-360.0, 0.0, 360.0])  # their longitudes may be written a turn away
        if any(
            shapely.contains_xy(polygon, lon + turns, np.full(3, lat)).any() for polygon in polygons
        ):
            wrong.append(
                f'sensor "{sensor.name}": it is a sonar and stands on land, at {notation.position(lon, lat)}; move at into '
                "the water"
            )
    if wrong:
        raise UserError(*wrong)
