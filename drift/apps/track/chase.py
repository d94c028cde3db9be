"""The pursuit path of a case: planned around land, on the cloud after the last detection."""

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

# parts of a leg: straight lines on the chart then differ by 0.2 m from a great circle of 20 nmi
# along 60 degrees of latitude
PARTS = 16

Land = Callable[[Box], Any]  # returns the polygons of land in a box [deg]


def land() -> Land:
    """Return the function that gives the land polygons that a vessel avoids."""
    return coastline.land_reader(None, Coast("gshhg", "strand"))


def check_pursuit(study: Study, land: Land) -> None:
    """Raise UserError if a pursuit starts or ends on land."""
    pursuit_spec = study.pursuit
    if pursuit_spec is None:
        return
    barrier, errors = land_about(pursuit_spec, land), []
    for what, place in (
        ("the vessel begins", pursuit_spec.start),
        ("the destination is", pursuit_spec.to),
    ):
        if place is not None:
            lon, lat = np.degrees(place)
            if barrier.in_squares(np.array([lon]), np.array([lat]), 0.0)[0]:
                errors.append(
                    f"{study.name}.toml: pursuit: {what} on land, at "
                    f"{notation.position(float(lon), float(lat))}"
                )
    if errors:
        raise UserError(*errors)


def plan_pursuit(study: Study, land: Land, coast: DeviceCoast | None) -> Chased | Failed | None:
    """Return the path that a case asks for, or why there is none.

    Args:
        study: the tracking case; without a pursuit the result is None.
        land: returns the land polygons [deg] in a box.
        coast: the coast that particles avoid; None: no coast.

    Returns:
        The path with its score on a second cloud, the failure, or None.
    """
    pursuit_spec = study.pursuit
    if pursuit_spec is None:
        return None
    try:
        found = pursuit.pursue(
            pursuit_spec, holding.onward(study, study.seed, coast), land_about(pursuit_spec, land)
        )
    except ValueError as error:
        # the cloud may be lost, or land may block the way: the track is still valid
        return Failed(str(error))
    check_cloud = holding.onward(study, noise.seed_for(study.seed, noise.Purpose.PURSUIT), coast)
    return Chased(found, pursuit.judged(pursuit_spec, found, check_cloud))


def land_about(pursuit_spec: Pursuit, land: Land) -> "Shore":
    """Return the land around the start of a pursuit."""
    return Shore(land, float(np.degrees(pursuit_spec.start[0])))


@dataclass(frozen=True)
class Shore:
    """The land that a vessel avoids: see `drift.tracking.tracker.pursuit.Barrier`."""

    land: Land
    about: float  # [deg] a longitude near the pursuit

    def in_squares(self, lon: Array, lat: Array, half: float) -> Array:
        """Return whether there is land in squares, given their centres [deg] and half side [m].

        The result has the shape of `lon`.
        """
        lon = sphere.near_degrees(lon, self.about)
        # meridians converge: the squares are slightly rotated
        high = np.degrees(1.05 * half / sphere.RADIUS)
        wide = high / np.maximum(np.cos(np.radians(lat)), 0.01)
        reach = Box(
            float((lon - wide).min()),
            float((lat - high).min()),
            float((lon + wide).max()),
            float((lat + high).max()),
        )
        return self._meets_land(
            lambda turn: shapely.box(lon + turn - wide, lat - high, lon + turn + wide, lat + high),
            reach,
            lon.shape,
        )

    def on_legs(self, begin: Array, ends: Array) -> Array:
        """Return whether there is land on great circles from a unit vector (3,) to others (m, 3).

        The result has shape (m,).
        """
        along = np.linspace(0.0, 1.0, PARTS + 1)[:, None]
        lon, lat = path.degrees(begin * (1 - along) + ends[:, None] * along)
        lon = sphere.near_degrees(lon, self.about)
        reach = Box(float(lon.min()), float(lat.min()), float(lon.max()), float(lat.max()))
        return self._meets_land(
            lambda turn: shapely.linestrings(np.stack([lon + turn, lat], axis=-1)),
            reach,
            (len(ends),),
        )

    def _meets_land(
        self, shapes: Callable[[float], Any], reach: Box, many: tuple[int, ...]
    ) -> Array:
        """Return which shapes meet land, for polygons at any whole turn of longitude."""
        polygons, found = np.array(list(self.land(reach)), dtype=object), np.zeros(many, bool)
        for turn in (-360.0, 0.0, 360.0):
            tree = shapely.STRtree(np.ravel(shapes(turn)))
            # shapely prepares the large polygons, not the squares
            found.flat[tree.query(polygons, predicate="intersects")[1]] = True
        return found
