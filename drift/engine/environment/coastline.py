"""The coast of a run: all shoreline within reach of its domain.

Near reported positions, which must not lie on land, the coast keeps its full detail.
"""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import astuple

import numpy as np

from drift.engine.environment import sailable
from drift.engine.environment.environment_spec import Coast
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.models import by_name as models
from geo import notation, sphere
from geo.array import Array
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast import shore
from geo.coast.shore import Shore
from geo.errors import UserError
from geo.forcing.sources import Source

MARGIN = 0.25  # [deg] more than a step
LATTICE = 5.0  # [deg] to which boxes of land beyond the coast are rounded outward
OUTWARD = (math.floor, math.floor, math.ceil, math.ceil)
NEAR = 1.0  # [deg] around a reported position in which the coast has full detail


def coast_box(spec: EnsembleSpec, box: Box, sources: Sequence[Source]) -> Box:
    """Return the box of coast needed for a domain: where its sources have a current, and a margin.

    It is the whole domain if a scenario's objects move without a current. sources: those that are
    not only added to others.
    """
    reached = _clip_to_currents(box, sources) if models.forced(spec.scenarios) else box
    # A particle's last step may end outside the domain.
    return reached.grown(MARGIN / np.cos(np.radians(min(abs(box.north), 80))), MARGIN)


def open_coast(
    spec: EnsembleSpec,
    asked: Coast,
    box: Box,
    seen: Callable[[Shore], Shore] | None,
    shared: tuple[Shore, shoreline.Coast | None] | None,
) -> tuple[Shore, shoreline.Coast | None]:
    """Return the land in a box and its coast; the coast is None if there is none.

    Args:
        spec: of the ensemble.
        asked: the coast that the case asks for.
        box: of the coast.
        seen: selects the detail of the land that is needed; None: all of it.
        shared: land and coast built by other runs; None: build them.

    Raises:
        UserError: for a reported position on land, and for lanes, voyages and areas of patrol that
            touch land.
    """
    if shared:
        whole, coast = shared
        own = whole
    else:
        whole = shore.read_land(asked.source, box, asked.lakes)
        own = seen(whole) if seen and not spec.release else whole
        coast = shoreline.build_coast(own, box) if own.polygons.size else None
    _check_ways(spec, asked, box, whole, coast if own is whole else None)
    if coast is not None:
        for scenario in spec.scenarios:
            label = "[spill]" if spec.release else f'scenario "{scenario.name}"'
            at = scenario.prior.reported if scenario.prior else None
            if at:
                _check_water(label, *at, coast if own is whole else _full_coast_around(*at, whole))
    return own, coast


def land_reader(coast: shoreline.Coast | None, asked: Coast) -> Callable[[Box], Array]:
    """Return a function that returns the land polygons [deg] of a run in a box.

    They are those of its coast. If the box reaches beyond it they are read again, once for boxes
    that are nearly the same.
    """

    @functools.cache
    def read(box: Box) -> Array:
        return shore.read_land(asked.source, box, asked.lakes).polygons

    def land(box: Box) -> Array:
        if coast is not None and shoreline.covers(coast, box):
            return coast.polygons
        west, south, east, north = (
            f(v / LATTICE) * LATTICE for f, v in zip(OUTWARD, astuple(box), strict=True)
        )
        return read(Box(west, south, east, north))

    return land


def _clip_to_currents(box: Box, sources: Sequence[Source]) -> Box:
    """Return the part of a box for which there is a current; no coast is needed elsewhere."""
    extents = [source.grid.box for source in sources if source.quantity == "current"]
    if box.east - box.west > 180 or any(extent.east - extent.west >= 360 for extent in extents):
        return box
    south, north = (
        max(box.south, min(e.south for e in extents)),
        min(box.north, max(e.north for e in extents)),
    )
    if south >= north:
        return box
    # Longitudes relative to the box's west: extents may be written a turn away.
    begins = [sphere.wrap_degrees(e.west - box.west) for e in extents]
    ends = [begin + e.east - e.west for begin, e in zip(begins, extents, strict=True)]
    west, east = max(0.0, min(begins)), min(box.east - box.west, max(ends))
    if west >= east:
        return box
    start = sphere.wrap_degrees(box.west + west)
    return Box(start, south, start + east - west, north)


def _full_coast_around(lon: float, lat: float, land: Shore) -> shoreline.Coast:
    """Return the coast in full detail around a reported position [deg]."""
    west = sphere.wrap_degrees(lon - NEAR)
    south, north = max(lat - NEAR, -90.0), min(lat + NEAR, 90.0)
    box = Box(west, south, west + 2 * NEAR, north)
    cut = box.grown(MARGIN, MARGIN)
    return shoreline.build_coast(Shore(shore.clip(land.polygons, cut), land.source, box=cut), box)


def _check_ways(
    spec: EnsembleSpec, asked: Coast, box: Box, whole: Shore, coast: shoreline.Coast | None
) -> None:
    """Raise UserError for itineraries over land.

    whole: the land in the box; coast: in full detail, None where it is not built.
    """
    need = sailable.box(spec.scenarios)
    if need is None:
        return
    inside = box.south <= need.south and need.north <= box.north
    inside &= (
        sphere.wrap_degrees(need.west - box.west) % 360 + need.east - need.west
        <= box.east - box.west
    )
    if not inside:  # the domain or the sources are smaller than the itineraries
        whole, coast = shore.read_land(asked.source, need, asked.lakes), None
    if coast is None and whole.polygons.size:
        coast = shoreline.build_coast(whole, box if inside else need)
    if coast is not None:
        sailable.refuse(spec.scenarios, coast)


def _check_water(label: str, lon: float, lat: float, coast: shoreline.Coast) -> None:
    """Raise UserError for a reported position [deg] on land."""
    if not shoreline.is_land(coast, sphere.to_binary(lon), sphere.to_binary(lat)).any():
        return
    water = shoreline.nearest_water(coast, lon, lat)
    hint = (
        f"the nearest water is {water[2] / 1852:.1f} nmi away, at {notation.position(*water[:2])}"
        if water
        else "no water near"
    )
    raise UserError(
        f"{label}.position.at: {notation.stated_position(lon, lat)} lies on land; {hint}. Move it, or give an area"
    )
