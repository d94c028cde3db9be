"""Sub-areas that a coordinator moves by hand, and their POS on the particles of the case.

The particles are those on which the plan was scored. They are followed once through the plan's
period, and kept; each move then costs one launch per sub-area. Between its times a particle goes
straight, as while a plan is made, so a POS differs from that of a run by less than 0.01. What
earlier sorties of the case tell of an unknown factor of the sweep width is not used.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drift.case.record import Case
from drift.evidence.filter import patterns
from drift.evidence.filter.detection import laws
from drift.evidence.filter.records import PlanSpec, Sortie, Unit
from drift.pipeline.run_options import Job
from drift.planning.search import follow, joint, optimiser, rectangle
from drift.planning.search import planning_tracks as record
from drift.planning.search.boats import availability, courses, fleet
from drift.planning.search.planning_tracks import Plane
from geo import notation, polyline, sphere
from geo.array import Array
from geo.box import Box
from geo.polyline import Area, Legs, LonLat
from kernels.planning import rectangles, sweeps
from kernels.planning.rectangles import Swarm

MOST = 200_000  # particles that are kept
FITS = 1.0  # [s] by which a search may be too long for the time that is left


@dataclass(frozen=True)
class SubArea:
    """A sub-area of a plan: its sortie, and the rectangle that is moved."""

    sortie: Sortie
    unit: str  # name of the unit
    centre: LonLat  # [deg]
    orientation: float  # [rad] of its length, clockwise from north
    length: float  # [m]
    width: float  # [m]
    takeoff: float = math.nan  # [s since 1970] as planned
    round: int = 1
    notes: tuple[str, ...] = ()  # what a coordinator should know of it


@dataclass(frozen=True, eq=False)
class Particles:
    """The particles of a case during its plan, in the layout of kernels."""

    plane: Plane
    zero: float  # [s since 1970] that their times are counted from
    swarm: Swarm
    weight: Array  # (m,), with the sum 1
    scenarios: int
    land: Callable[[Box], Array]  # polygons in a box [deg]


@dataclass(frozen=True)
class Pos:
    """Probability of success of sub-areas, searched one after the other."""

    each: tuple[float, ...]  # given that those before it have failed
    total: float
    by_scenario: tuple[float, ...]  # given that scenario; NaN if it is impossible


def particles_of(job: Job) -> Particles:
    """Return the particles of a job's case during its plan, given all that is known before it."""
    case, where = replace(job.case, particles=min(job.case.particles, MOST)), job.where
    tracks = follow.follow(case, where, own=True)
    plane = record.plane(tracks)
    survival = [scenario.survival for scenario in case.scenarios]
    swarm = optimiser.swarm_of(tracks, replace(case.plan, objective="pos"), survival, plane)
    land = _no_land if where.coast is None else (lambda box: fleet.shown(case, where, box))
    zero = float(tracks.time[0])
    return Particles(plane, zero, swarm, tracks.weight, len(case.scenarios), land)


def _no_land(box: Box) -> Array:
    return np.empty(0, object)


def pos(particles: Particles, areas: Sequence[SubArea]) -> Pos:
    """Return the POS of sub-areas, each given the failure of those before it.

    Args:
        particles: of the case.
        areas: in the order of their search.
    """
    sorties = [area.sortie for area in areas]
    factor, node_weight = joint.nodes(sorties)
    missed = np.broadcast_to(node_weight, (len(particles.weight), len(node_weight))).copy()
    left = [particles.weight]
    for area, own in zip(areas, factor, strict=True):
        missed *= 1 - _chance(particles, area, own)
        left.append(particles.weight * missed.sum(axis=1))
    sums = [float(weight.sum()) for weight in left]
    pairs = itertools.pairwise(sums)
    each = [1 - after / before if before > 0 else 0.0 for before, after in pairs]
    scenario, count = particles.swarm.scenario, particles.scenarios
    before, after = (np.bincount(scenario, one, count) for one in (left[0], left[-1]))
    with np.errstate(invalid="ignore"):
        given = 1 - after / before
    return Pos(tuple(each), 1 - sums[-1] / sums[0], tuple(given.tolist()))


def _chance(particles: Particles, area: SubArea, factor: Array) -> Array:
    """Return the probability that a sub-area's search detects each particle, (m, nodes)."""
    sortie = area.sortie
    width = np.array([sortie.sweep_width, sortie.width_under_way or sortie.sweep_width])
    if sortie.legs is not None:
        table = None
        if laws.formulas_of(sortie.law).detects == "abeam":
            table = np.column_stack(laws.range_curve(sortie.law)).ravel()
        path = _path(particles, sortie.legs)
        return np.asarray(sweeps.found(particles.swarm, table, path, width, factor)[0], np.float64)
    begin, end = (float(notation.epoch(time)) for time in (sortie.start, sortie.end))
    x, y = particles.plane.flat(*np.radians(area.centre))
    turn = area.orientation
    row = np.array(
        [[x, y, math.sin(turn), math.cos(turn), area.length, area.width, begin - particles.zero]]
    )
    row = np.column_stack([row, [[end - begin, 1.0]]])
    coverage = np.array([sortie.coverage, sortie.coverage_under_way or sortie.coverage])
    curve = laws.pod(
        sortie.law, np.arange(round(rectangle.MOST / rectangle.STEP) + 1) * rectangle.STEP
    )
    found = rectangles.found(particles.swarm, True, row, coverage, factor, rectangle.STEP, curve)[0]
    return np.asarray(found, np.float64)


def _path(particles: Particles, legs: Legs) -> Array:
    """Return legs as nodes (time, x, y, whether the leg to the next node searches)."""
    x, y = particles.plane.flat(np.radians(legs.lon), np.radians(legs.lat))
    return np.column_stack([np.array(legs.time) - particles.zero, x, y, [*legs.searching, False]])


def moved(
    area: SubArea, centre: LonLat, orientation: float, unit: Unit | None, spec: PlanSpec
) -> SubArea:
    """Return a sub-area at another place, with the time at which its unit can search there.

    The unit begins as planned, or later if it cannot be there in time. Legs for which no time is
    left are cut.

    Args:
        area: as planned.
        centre: of the sub-area (lon, lat) [deg].
        orientation: of its length, clockwise from north [rad].
        unit: that searches it; None: it is not known, and all times stay.
        spec: of the plan.
    """
    sortie, notes = area.sortie, list[str]()
    begin = float(notation.epoch(sortie.start))
    legs = sortie.legs
    place, shift, share = centre, 0, 1.0
    if legs is not None:
        lon, lat = _placed(area, legs.lon, legs.lat, centre, orientation)
        place = (float(lon[0]), float(lat[0]))
    duration = float(notation.epoch(sortie.end)) - begin
    if unit is not None:
        possible, room = _slot(area, unit, spec, place, begin)
        shift = max(math.ceil(possible - begin), 0)
        share = min(1.0, room / duration) if room < duration - FITS else 1.0
        if shift:
            later = notation.format_dtg(sortie.start + np.timedelta64(shift, "s"))
            notes.append(f"{unit.name} cannot be there before {later}")
        if share < 1:
            notes.append(
                f"only {room / 3600:.1f} of {duration / 3600:.1f} h of search are left there: "
                f"the last {notation.percent(1 - share)} of its legs are left out"
            )
    if legs is not None and share > 0:
        time = np.array(legs.time) + shift
        legs = polyline.legs_through(time, lon, lat, legs.searching)
        legs = polyline.legs_between(legs, time[0], time[0] + share * (time[-1] - time[0]))
    assert sortie.area is not None
    ring = _placed(area, sortie.area.lon, sortie.area.lat, centre, orientation)
    start = sortie.start + np.timedelta64(shift, "s")
    sortie = replace(
        sortie,
        start=start,
        end=start + np.timedelta64(math.ceil(share * duration), "s"),
        legs=legs,
        area=Area(tuple(ring[0].tolist()), tuple(ring[1].tolist())),
        completed=share,
        coverage=tuple(share * one for one in sortie.coverage),
        coverage_under_way=tuple(share * one for one in sortie.coverage_under_way),
        sweep_width=sortie.sweep_width if share > 0 else tuple(0.0 for _ in sortie.sweep_width),
    )
    return replace(area, sortie=sortie, centre=centre, orientation=orientation, notes=tuple(notes))


def _placed(
    area: SubArea, lon: Sequence[float], lat: Sequence[float], centre: LonLat, orientation: float
) -> tuple[Array, Array]:
    """Return positions [deg] of a sub-area that keep their place in it as it moves and turns."""
    x, y = np.radians(area.centre)
    east, north = sphere.offset(x, y, np.radians(lon), np.radians(lat))
    sin, cos = math.sin(area.orientation), math.cos(area.orientation)
    along, across = east * sin + north * cos, east * cos - north * sin
    return patterns.points_along(centre, orientation, along, across)


def _slot(
    area: SubArea, unit: Unit, spec: PlanSpec, place: LonLat, begin: float
) -> tuple[float, float]:
    """Return when a unit can begin to search at a place, and for how long [s].

    begin: as planned [s since 1970]; it does not search earlier.
    """
    after = area.takeoff if area.round > 1 else None
    available = availability.of_unit(unit, spec, tuple(np.radians(area.centre)), after)
    # a boat's way round land is at least as long as planned, if it was planned so
    start, room = available.slot(max(begin, float(available.arrival(*np.radians(place)))))
    return float(start), float(room)


def on_land(particles: Particles, area: SubArea) -> float:
    """Return the length [m] of a sub-area's legs that lies on land."""
    legs = area.sortie.legs
    if legs is None:
        return 0.0
    box = Box(min(legs.lon) - 0.1, min(legs.lat) - 0.1, max(legs.lon) + 0.1, max(legs.lat) + 0.1)
    return courses.on_land(particles.land(box), np.array(legs.lon), np.array(legs.lat))


def case_of_unit(case: Case, name: str) -> Unit | None:
    """Return a unit of a case by name."""
    return next((unit for unit in case.units if unit.name == name), None)
