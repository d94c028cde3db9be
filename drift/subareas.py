"""The sub-areas of a plan as crews are given them: names, corners, the way of each unit, what it is expected to find."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from drift import detection, passage, patterns, search_shapes
from drift.effective import Count
from drift.tables import NMI
from drift.tasking import Plan, Tasking
from geo import sphere

Array = npt.NDArray[Any]

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
KNOT = NMI / 3600


@dataclass(frozen=True)
class Waypoint:
    """A point of a unit's way [deg]; what: base, csp, leg, off or home."""

    name: str  # A-1 CSP, A-1 02, unique in the plan
    what: str
    time: np.datetime64
    lon: float
    lat: float


def names(plan: Plan) -> list[str]:
    """Return the name of each tasking's sub-area: A-1, A-2, ... in the first round, B-1, ... in the second."""
    found, count = [], dict[int, int]()
    for tasking in plan.taskings:
        count[tasking.round] = count.get(tasking.round, 0) + 1
        letters, rest = "", tasking.round
        while rest > 0:
            rest, letter = divmod(rest - 1, 26)
            letters = LETTERS[letter] + letters
        found.append(f"{letters}-{count[tasking.round]}")
    return found


def corners(tasking: Tasking) -> list[tuple[float, float]]:
    """Return the corners (lon, lat) [deg] of a sub-area, in order round it, the one nearest to its first leg first."""
    area = patterns.rectangle(tasking.centre, tasking.length, tasking.width, tasking.orientation)
    found = list(zip(area.lon, area.lat, strict=True))
    start = begin(tasking)
    apart = [float(sphere.distance(*np.radians(corner), *np.radians(start))) for corner in found]
    k = int(np.argmin(apart)) if tasking.sortie.legs is not None else 0
    return found[k:] + found[:k]


def begin(tasking: Tasking) -> tuple[float, float]:
    """Return the commence search point (lon, lat) [deg]; of a search without legs the centre."""
    legs = tasking.sortie.legs
    return tasking.centre if legs is None else (legs.lon[0], legs.lat[0])


def end(tasking: Tasking) -> tuple[float, float]:
    """Return where the search ends (lon, lat) [deg]; of a search without legs the centre."""
    legs = tasking.sortie.legs
    return tasking.centre if legs is None else (legs.lon[-1], legs.lat[-1])


def route(name: str, tasking: Tasking) -> list[Waypoint]:
    """Return a unit's way from its base over all ends of legs to where it returns."""
    unit, legs = tasking.unit, tasking.sortie.legs
    way = [Waypoint(f"{name} BASE", "base", tasking.takeoff, *unit.base)]
    if legs is None:
        way.append(Waypoint(f"{name} CENTRE", "csp", tasking.on_scene, *tasking.centre))
    else:
        times = [np.datetime64(round(t), "s") for t in legs.time]
        way.append(Waypoint(f"{name} CSP", "csp", times[0], legs.lon[0], legs.lat[0]))
        last = len(times) - 1
        way += [
            Waypoint(f"{name} {k:02d}" if k < last else f"{name} END", "leg" if k < last else "off", times[k], x, y)
            for k, (x, y) in enumerate(zip(legs.lon, legs.lat, strict=True))
            if k > 0
        ]
    return [*way, Waypoint(f"{name} HOME", "home", tasking.home, *unit.return_to)]


def transits(tasking: Tasking) -> list[Array]:
    """Return the ways out and home as great circles, each (n, 2) of lon, lat [deg]."""
    ways = ((tasking.unit.base, begin(tasking)), (end(tasking), tasking.unit.return_to))
    return [search_shapes.curve(*zip(*way, strict=True)) for way in ways if way[0] != way[1]]


def leg_length(tasking: Tasking) -> float:
    """Return the length [m] of its longest leg; 0 without legs."""
    legs = tasking.sortie.legs
    return 0.0 if legs is None else float(passage.lengths(legs).max())


def track_length(tasking: Tasking) -> float:
    """Return the length [m] of track that it searches; without legs that of its time on scene at search speed."""
    legs, sortie = tasking.sortie.legs, tasking.sortie
    if legs is None:
        return tasking.unit.search_speed * float((sortie.end - sortie.start) / np.timedelta64(1, "s"))
    return float(passage.lengths(legs)[np.array(legs.searching, bool)].sum())


def coverages(tasking: Tasking) -> Array:
    """Return the coverage of the sub-area by scenario, W / S: what its crews would reckon."""
    sortie = tasking.sortie
    if sortie.coverage:
        return np.array(sortie.coverage)
    return np.array(sortie.sweep_width) / tasking.spacing if tasking.spacing > 0 else np.zeros(len(sortie.sweep_width))


def pods(tasking: Tasking) -> Array:
    """Return the POD of the sub-area by scenario for an object that stays in it, averaged over what is unknown of W."""
    factors, chances = detection.factors(tasking.sortie.shape)
    return np.asarray(detection.pod(tasking.sortie.law, np.outer(coverages(tasking), factors)) @ chances)


def degrees(angle: float) -> int:
    """Return a direction [rad] in whole degrees, 1 to 360: north is 360, as crews say it."""
    return round(math.degrees(angle) - 1) % 360 + 1


def numbers(plan: Plan) -> dict[str, Any]:
    """Return a plan's numbers for the summary; angles in degrees, lengths in nmi, speeds in kn."""
    return {
        "objective": plan.spec.objective,
        "begin": plan.spec.begin,
        "until": plan.spec.until,
        "value": plan.value,
        "pos": plan.pos,
        "pos_by_scenario": dict(zip(plan.scenarios, np.asarray(plan.by_scenario, float).tolist(), strict=True)),
        "bound": plan.bound,
        "bound_error": None if plan.bound is None else plan.bound_error,
        "no_bound": plan.unbounded or None,
        "share_of_bound": plan.seen / plan.bound if plan.bound else None,
        "value_on_planning_particles": plan.seen,
        "optimism": plan.seen - plan.value,
        "effective_particles": {"made_on": _counted(plan.made_on), "scored_on": _counted(plan.scored_on)},
        "taskings": [_tasking(plan, name, one) for name, one in zip(names(plan), plan.taskings, strict=True)],
        "alternatives": [
            {
                "name": other.name,
                "value": other.value,
                "difference": other.difference,
                "standard_error": other.standard_error,
            }
            for other in plan.alternatives
        ],
    }


def _counted(count: Count | None) -> float | None:
    return None if count is None else count.number


def _tasking(plan: Plan, name: str, one: Tasking) -> dict[str, Any]:
    return {
        "area": name,
        "unit": one.unit.name,
        "kind": one.unit.kind,
        "round": one.round,
        "pos": one.pos,
        "takeoff": one.takeoff,
        "on_scene": one.on_scene,
        "off_scene": one.off_scene,
        "home": one.home,
        "corners": [_place(*corner) for corner in corners(one)],
        "centre": _place(*one.centre),
        "commence_search_point": _place(*begin(one)),
        "length_nmi": one.length / NMI,
        "width_nmi": one.width / NMI,
        "orientation_deg": math.degrees(one.orientation) % 360,
        "creep_deg": math.degrees(one.creep) % 360,
        "spacing_nmi": one.spacing / NMI,
        "legs": one.legs,
        "leg_length_nmi": leg_length(one) / NMI,
        "track_nmi": track_length(one) / NMI,
        "search_speed_kn": one.unit.search_speed / KNOT,
        "altitude_ft": one.unit.altitude / 0.3048,
        "sweep_width_nmi": {k: w / NMI for k, w in zip(plan.scenarios, one.sortie.sweep_width, strict=True)},
        "pod": dict(zip(plan.scenarios, pods(one).tolist(), strict=True)),
    }


def _place(lon: float, lat: float) -> dict[str, float]:
    return {"lon": (lon + 180) % 360 - 180, "lat": lat}
