"""The path that a case asks for: around the land there is, on the cloud that its detections leave."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from drift.apps.track.record import Chased, Failed
from drift.engine.environment import coastline
from drift.engine.environment.environment_spec import Coast
from drift.tracking.tracker import holding, path, pursuit
from drift.tracking.tracker.pursuit import Pursuit
from drift.tracking.tracker.study import Study
from geo import notation, sphere
from geo.array import Array
from geo.box import Box
from geo.errors import UserError
from kernels.maths import noise
from kernels.step.coast import DeviceCoast

# of a leg: straight lines on the chart in its place are 0.2 m off for 20 nmi along 60 degrees of
# latitude
PARTS = 16

Land = Callable[[Box], Any]  # returns the polygons of land in a box [deg]


def land() -> Land:
    """Return what returns the land that a vessel keeps off."""
    return coastline.lands(None, Coast("gshhg", "strand"))


def check(asked: Study, land: Land) -> None:
    """Raise UserError where a pursuit begins or ends on land."""
    chase = asked.pursuit
    if chase is None:
        return
    shore, wrong = land_about(chase, land), []
    for what, place in (("the vessel begins", chase.start), ("the destination is", chase.to)):
        if place is not None:
            lon, lat = np.degrees(place)
            if shore.in_squares(np.array([lon]), np.array([lat]), 0.0)[0]:
                wrong.append(
                    f"{asked.name}.toml: pursuit: {what} on land, at {notation.position(float(lon), float(lat))}"
                )
    if wrong:
        raise UserError(*wrong)


def chased(asked: Study, land: Land, coast: DeviceCoast | None) -> Chased | Failed | None:
    """Return the path that a case asks for, or why there is none; coast: on whose land no particle
    is.
    """
    chase = asked.pursuit
    if chase is None:
        return None
    try:
        found = pursuit.pursue(
            chase, holding.onward(asked, asked.seed, coast), land_about(chase, land)
        )
    except ValueError as error:
        # the cloud may be lost, and land may lie between: the track is known all the same
        return Failed(str(error))
    other = holding.onward(asked, noise.seed_for(asked.seed, noise.Purpose.PURSUIT), coast)
    return Chased(found, pursuit.judged(chase, found, other))


def land_about(chase: Pursuit, land: Land) -> "Shore":
    """Return the land about where a pursuit begins."""
    return Shore(land, float(np.degrees(chase.start[0])))


@dataclass(frozen=True)
class Shore:
    """The land that a vessel keeps off: see `drift.tracking.tracker.pursuit.Barrier`."""

    land: Land
    about: float  # [deg] a longitude of where it is

    def in_squares(self, lon: Array, lat: Array, half: float) -> Array:
        """Return whether there is land in squares, by their middles [deg] and half their side [m];
        in their shape.
        """
        lon = sphere.near_degrees(lon, self.about)
        # meridians converge: squares are a little turned
        high = np.degrees(1.05 * half / sphere.RADIUS)
        wide = high / np.maximum(np.cos(np.radians(lat)), 0.01)
        reach = Box(
            float((lon - wide).min()),
            float((lat - high).min()),
            float((lon + wide).max()),
            float((lat + high).max()),
        )
        return self._met(
            lambda turn: shapely.box(lon + turn - wide, lat - high, lon + turn + wide, lat + high),
            reach,
            lon.shape,
        )

    def on_legs(self, begin: Array, ends: Array) -> Array:
        """Return whether there is land on great circles from a unit vector (3,) to others (m, 3);
        (m,).
        """
        along = np.linspace(0.0, 1.0, PARTS + 1)[:, None]
        lon, lat = path.degrees(begin * (1 - along) + ends[:, None] * along)
        lon = sphere.near_degrees(lon, self.about)
        reach = Box(float(lon.min()), float(lat.min()), float(lon.max()), float(lat.max()))
        return self._met(
            lambda turn: shapely.linestrings(np.stack([lon + turn, lat], axis=-1)),
            reach,
            (len(ends),),
        )

    def _met(self, shapes: Callable[[float], Any], reach: Box, many: tuple[int, ...]) -> Array:
        """Return which shapes meet land, wherever its polygons lie by whole turns."""
        polygons, found = np.array(list(self.land(reach)), dtype=object), np.zeros(many, bool)
        for turn in (-360.0, 0.0, 360.0):
            tree = shapely.STRtree(np.ravel(shapes(turn)))
            # continents are prepared, not squares
            found.flat[tree.query(polygons, predicate="intersects")[1]] = True
        return found
