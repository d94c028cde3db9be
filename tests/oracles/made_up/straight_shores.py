"""Straight and jagged shores, and particles that drift toward them."""

import numpy as np
import shapely

from drift.engine.motion import simulate
from drift.engine.motion.clock import Clock
from drift.engine.motion.forcing import Forcing, Sources
from drift.engine.motion.models.drift import COLUMNS, DRIFT
from drift.engine.motion.models.model import Motion
from drift.engine.motion.scene import Scene
from drift.engine.particles import ensemble as record
from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.shore import Shore
from geo.forcing import sources
from kernels.step import advance as kernel
from kernels.step import coast as device_coast

EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
T0 = 1_795_000_000 // 3600 * 3600
METRE = 1 / np.radians(1) / sphere.RADIUS  # [deg] on the equator


def land(*polygons: shapely.Polygon, lat: float = 0.0) -> shoreline.Coast:
    box = Box(-1.5, lat - 1.5, 1.5, lat + 1.5)
    return shoreline.build_coast(
        Shore(np.array(polygons, object), "test", (), box), Box(-1.2, lat - 1.2, 1.2, lat + 1.2)
    )


def jagged(edge: float) -> shapely.Polygon:
    """Land east of lon 0, its straight shore in many edges of uneven length, numbered at random by
    the polygon's start.
    """
    lat = np.concatenate(
        [[-1.4], np.arange(-1.0, 1.0, edge) + 0.3 * edge * np.sin(np.arange(int(2 / edge))), [1.4]]
    )
    return shapely.Polygon([(1.4, 1.4), (1.4, -1.4), *[(0.0, y) for y in lat]])


def drift_on(
    shore: shoreline.Coast | None,
    current: tuple[float, float],
    n: int,
    start: tuple[float, float],
    duration: int,
    step: int,
    outputs: list[int] | None = None,
    physics: kernel.Physics = kernel.Physics(),  # noqa: B008 - immutable
    prepare=None,
    direction: int = 1,
    **place,
):
    """Return the ensemble and its moments after drifting in a uniform current [m/s] from (lon, lat)
    [deg].
    """
    ensemble = record.empty(3, (0, n), COLUMNS)
    ensemble.lon.fill(int(sphere.to_binary(start[0])))
    ensemble.lat.fill(int(sphere.to_binary(start[1])))
    if prepare:
        prepare(ensemble)
    device = device_coast.upload(shore) if shore else None
    source = sources.constant_field("current", *current)
    scene = Scene(
        Forcing([Sources({"current": (source,)})], direction),
        (Motion(DRIFT, physics),),
        kernel.Surroundings(EVERYWHERE, device, **place),
    )
    moments = list(
        simulate.run(
            ensemble, scene, Clock(T0, duration, direction, step), np.array(outputs or [duration])
        )
    )
    scene.forcing.close()
    return ensemble, moments
