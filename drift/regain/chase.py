"""The path that a case asks for: around the land there is, on the cloud that its detections leave."""

from collections.abc import Callable
from typing import Any

import numpy as np
import shapely

from drift.environment import coastline
from drift.environment.environment_spec import Coast
from drift.regain.record import Chased, Failed
from drift.tracker import holding, pursuit
from drift.tracker.pursuit import Closed, Pursuit
from drift.tracker.study import Study
from geo import notation, sphere
from geo.array import Array
from geo.box import Box
from geo.errors import UserError
from kernels import noise
from kernels.coast import DeviceCoast

Land = Callable[[Box], Any]  # returns the polygons of land in a box [deg]


def land() -> Land:
    """Return what returns the land that a vessel keeps off."""
    return coastline.lands(None, Coast("gshhg", "strand"))


def check(asked: Study, land: Land) -> None:
    """Raise UserError where a pursuit begins or ends on land."""
    chase = asked.pursuit
    if chase is None:
        return
    closed, wrong = closing(chase, land), []
    for what, place in (("the vessel begins", chase.start), ("the destination is", chase.to)):
        if place is not None:
            lon, lat = np.degrees(place)
            if closed(np.array([lon]), np.array([lat]), 0.0)[0]:
                wrong.append(
                    f"{asked.name}.toml: pursuit: {what} on land, at {notation.position(float(lon), float(lat))}"
                )
    if wrong:
        raise UserError(*wrong)


def chased(asked: Study, land: Land, coast: DeviceCoast | None) -> Chased | Failed | None:
    """Return the path that a case asks for, or why there is none; coast: on whose land no particle is."""
    chase = asked.pursuit
    if chase is None:
        return None
    try:
        found = pursuit.pursue(chase, holding.onward(asked, asked.seed, coast), closing(chase, land))
    except ValueError as error:  # the cloud may be lost, and land may lie between: the track is known all the same
        return Failed(str(error))
    other = holding.onward(asked, noise.seed_for(asked.seed, noise.Purpose.PURSUIT), coast)
    return Chased(found, pursuit.judged(chase, found.path, other))


def closing(chase: Pursuit, land: Land) -> Closed:
    """Return what says whether there is land in squares."""

    def closed(lon: Array, lat: Array, half: float) -> Array:
        lon = sphere.near_degrees(lon, float(np.degrees(chase.start[0])))
        high = np.degrees(1.05 * half / sphere.RADIUS)  # meridians converge: squares are a little turned
        wide = high / np.maximum(np.cos(np.radians(lat)), 0.01)
        reach = Box(
            float((lon - wide).min()), float((lat - high).min()), float((lon + wide).max()), float((lat + high).max())
        )
        shapes = shapely.STRtree(list(land(reach)))
        shut = np.zeros(lon.size, bool)
        for turn in (-360.0, 0.0, 360.0):
            squares = shapely.box(lon + turn - wide, lat - high, lon + turn + wide, lat + high).ravel()
            shut[shapes.query(squares, predicate="intersects")[0]] = True
        return shut.reshape(lon.shape)

    return closed
