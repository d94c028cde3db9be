"""The coast that a cloud's particles avoid, as far as they can come."""

from dataclasses import dataclass

import numpy as np

from drift.engine.environment.coastline import MARGIN
from drift.tracking.tracker.detections import Detections
from drift.tracking.tracker.study import Scene, Study
from geo import sphere
from geo.array import Array
from geo.box import Box
from geo.coast import edges, shore
from kernels.step import coast as device_coast
from kernels.step.coast import DeviceCoast

FARTHEST = 85.0  # [deg] latitude beyond which the box spans all longitudes


@dataclass(frozen=True)
class Shoreline:
    """A coast in host memory and on the device."""

    coast: edges.Coast
    device: DeviceCoast

    def dry(self, lon: Array, lat: Array) -> Array:
        """Return whether positions [rad] are on land."""
        return np.asarray(
            edges.is_land(self.coast, *(sphere.to_binary(np.degrees(x)) for x in (lon, lat)))
        )


def of_study(asked: Study) -> Shoreline | None:
    """Return the coast of a tracking case.

    None if there is none within reach, or if particles ignore land. Taichi must have been started.
    """
    if not asked.minds_land:
        return None
    box = within_reach(asked)
    land = shore.read_land("gshhg", box)
    if not land.polygons.size:
        return None
    built = edges.build_coast(land, box)
    return Shoreline(built, device_coast.upload(built))


def within_reach(asked: Study) -> Box:
    """Return a box that no particle leaves, and no acting target."""
    laws = [method.behaviour for method in asked.methods]
    places, lasting = asked.tracker.place, asked.end
    if isinstance(asked.target, Scene):
        places = np.vstack([places, asked.target.way.place])
        laws += [asked.target.acts] if asked.target.acts is not None else []
    else:
        assert isinstance(asked.target, Detections)
        lasting -= float(asked.target.time[0])
    far = max(sensor.reach for sensor in asked.sensors) + max(law.fastest for law in laws) * lasting
    high = float(np.degrees(far / sphere.RADIUS)) + MARGIN
    lon = np.degrees(np.unwrap(np.arctan2(places[:, 1], places[:, 0])))
    lat = np.degrees(np.arcsin(np.clip(places[:, 2], -1.0, 1.0)))
    poleward = float(np.abs(lat).max()) + high
    wide = 360.0 if poleward > FARTHEST else high / float(np.cos(np.radians(poleward)))
    west = sphere.wrap_degrees(float(lon.min()))
    return Box(west, float(lat.min()), west + float(np.ptp(lon)), float(lat.max())).grown(
        wide, high
    )
