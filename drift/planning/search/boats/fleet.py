"""The boats of a plan on the coast of its case: their ways by sea, and that none of these lies on
land.
"""

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

PLACES = 4_000  # positions of particles by which it is judged where a boat may have to search


@dataclass(frozen=True)
class Fleet:
    """Boats near land, and the units that can be sent."""

    courses: dict[str, Course]  # of boats near land, by name
    units: tuple[Unit, ...]  # that can be sent
    said: tuple[str, ...]  # what a coordinator must know of boats
    land: Callable[[Box], Array]  # polygons in a box [deg]


def prepare(case: Case, where: Environment, tracks: Tracks) -> Fleet:
    """Return the boats of a case, with their ways to wherever its particles are in the time of the
    plan.
    """
    land = partial(shown, case, where)
    ways: dict[str, Course] = {}
    said, units = [], []
    for unit in case.units:
        places = (
            _places(unit, case.plan, tracks)
            if unit.afloat and case.coast.source != "none"
            else np.empty((0, 2))
        )
        if len(places):
            try:
                course, words = courses.prepare(unit, land, places, _shoals(case, unit))
            except ValueError as error:
                said.append(f"{unit.name} is not sent: {error}.")
                continue
            if course is not None:
                ways[unit.name] = course
            if words:
                said.append(f"{unit.name} {words}")
        units.append(unit)
    return Fleet(ways, tuple(units), tuple(said), land)


def _shoals(case: Case, unit: Unit) -> Callable[[Box], Array] | None:
    """Return a function that tells where it is too shallow for a boat, None if that does not
    matter.
    """
    if case.depth is None or unit.draught == 0:
        return None
    return partial(_shallow, case.depth, unit.draught)


def _shallow(source: Depth, draught: float, box: Box) -> Array:
    return depth.shoals(source, box, draught)


def _places(unit: Unit, spec: PlanSpec, tracks: Tracks) -> Array:
    """Return positions (n, 2) [deg] of particles that a boat could reach by the plan's end on a
    straight way.
    """
    some = planning_tracks.coarser(tracks, 6)
    lon, lat = (v[:, some.weight > 0].ravel() * sphere.UNIT for v in (some.lon, some.lat))
    far = sphere.distance(math.radians(unit.base[0]), math.radians(unit.base[1]), lon, lat)
    time = notation.epoch(spec.until) - max(notation.epoch(spec.begin), notation.epoch(unit.ready))
    near = np.flatnonzero(far < unit.transit_speed * time)
    near = near[:: max(len(near) // PLACES, 1)]
    return np.degrees(np.column_stack([lon[near], lat[near]]))


def shown(case: Case, where: Environment, box: Box) -> Array:
    """Return the land of a case in a box: that of the run, or read again if the box reaches beyond
    it.
    """
    return coastline.land_reader(where.coast, case.coast)(box)


def checked(fleet: Fleet, taskings: Sequence[Tasking]) -> tuple[tuple[Tasking, ...], Fleet]:
    """Return the taskings of which no way by sea lies on land, and the fleet with words on the
    others.

    The check is Shapely's, on the coast in full.
    """
    kept = []
    for tasking in taskings:
        course = fleet.courses.get(tasking.unit.name)
        dry = 0.0
        if course is not None:
            polygons = fleet.land(course.box)
            legs = tasking.sortie.legs
            ways = (
                [tasking.out, tasking.back]
                if legs is None
                else [tasking.out, tuple(zip(legs.lon, legs.lat, strict=True)), tasking.back]
            )
            dry = sum(courses.on_land(polygons, *np.array(way).T) for way in ways if len(way) > 1)
        if dry == 0:
            kept.append(tasking)
        else:
            words = f"{tasking.unit.name} is not sent: {dry:.1f} m of the way that was found for it lie on land."
            fleet = replace(fleet, said=(*fleet.said, words))
    return tuple(kept), fleet
