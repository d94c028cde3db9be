"""The boats of a plan: their ways by sea, and a check that no way crosses land."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from drift.case.record import Case, Depth
from drift.engine.environment import coastline
from drift.engine.environment.environment import Environment
from drift.evidence.filter.records import PlanSpec, Unit
from drift.planning.search import planning_tracks
from drift.planning.search.boats import courses, depth
from drift.planning.search.boats.courses import Course
from drift.planning.search.planning_tracks import Tracks
from drift.planning.search.records import Tasking
from geo import notation, sphere
from geo.array import Array
from geo.box import Box

PLACES = 4_000  # most particle positions that define the region of a boat's search


@dataclass(frozen=True)
class Fleet:
    """Boats near land, and the units that can be sent."""

    courses: dict[str, Course]  # of boats near land, by name
    units: tuple[Unit, ...]  # that can be sent
    said: tuple[str, ...]  # remarks on boats for the coordinator
    land: Callable[[Box], Array]  # polygons in a box [deg]


def prepare(case: Case, where: Environment, tracks: Tracks) -> Fleet:
    """Return the boats of a case with their courses in the region of its particles.

    Args:
        case: with the units.
        where: environment of the run, with the coast.
        tracks: planning particles.
    """
    land = partial(shown, case, where)
    ways: dict[str, Course] = {}
    remarks, units = [], []
    for unit in case.units:
        places = (
            _places(unit, case.plan, tracks)
            if unit.afloat and case.coast.source != "none"
            else np.empty((0, 2))
        )
        if len(places):
            try:
                course, remark = courses.prepare(unit, land, places, _shoals(case, unit))
            except ValueError as error:
                remarks.append(f"{unit.name} is not sent: {error}.")
                continue
            if course is not None:
                ways[unit.name] = course
            if remark:
                remarks.append(f"{unit.name} {remark}")
        units.append(unit)
    return Fleet(ways, tuple(units), tuple(remarks), land)


def _shoals(case: Case, unit: Unit) -> Callable[[Box], Array] | None:
    """Return a function that returns water too shallow for a boat; None if all is deep enough."""
    if case.depth is None or unit.draught == 0:
        return None
    return partial(_shallow, case.depth, unit.draught)


def _shallow(source: Depth, draught: float, box: Box) -> Array:
    """Return polygons [deg] of water that is shallower than a draught [m]."""
    return depth.shoals(source, box, draught)


def _places(unit: Unit, spec: PlanSpec, tracks: Tracks) -> Array:
    """Return particle positions (n, 2) [deg] that a boat could reach before the plan's end."""
    coarse = planning_tracks.coarser(tracks, 6)
    lon, lat = (v[:, coarse.weight > 0].ravel() * sphere.UNIT for v in (coarse.lon, coarse.lat))
    distance = sphere.distance(math.radians(unit.base[0]), math.radians(unit.base[1]), lon, lat)
    time = notation.epoch(spec.until) - max(notation.epoch(spec.begin), notation.epoch(unit.ready))
    near = np.flatnonzero(distance < unit.transit_speed * time)
    near = near[:: max(len(near) // PLACES, 1)]
    return np.degrees(np.column_stack([lon[near], lat[near]]))


def shown(case: Case, where: Environment, box: Box) -> Array:
    """Return the land polygons in a box.

    They come from the run's coast, or are read again if the box reaches beyond it.
    """
    return coastline.land_reader(where.coast, case.coast)(box)


def checked(fleet: Fleet, taskings: Sequence[Tasking]) -> tuple[tuple[Tasking, ...], Fleet]:
    """Return the taskings whose ways by sea do not cross land, and the updated fleet.

    The fleet gets a remark on each rejected tasking. The check uses Shapely on the full coast.
    """
    kept = []
    for tasking in taskings:
        course = fleet.courses.get(tasking.unit.name)
        length_on_land = 0.0
        if course is not None:
            polygons = fleet.land(course.box)
            legs = tasking.sortie.legs
            ways = (
                [tasking.out, tasking.back]
                if legs is None
                else [tasking.out, tuple(zip(legs.lon, legs.lat, strict=True)), tasking.back]
            )
            length_on_land = sum(
                courses.on_land(polygons, *np.array(way).T) for way in ways if len(way) > 1
            )
        if length_on_land == 0:
            kept.append(tasking)
        else:
            remark = f"{tasking.unit.name} is not sent: {length_on_land:.1f} m of its computed way lie on land."
            fleet = replace(fleet, said=(*fleet.said, remark))
    return tuple(kept), fleet
