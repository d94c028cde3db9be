"""Sub-areas of a plan as crews get them: names, corners, ways and expected detection."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drift.evidence.filter import patterns
from drift.evidence.filter import shapes as search_shapes
from drift.evidence.filter.detection import laws
from drift.forecast import likeliest
from drift.forecast.effective import Count
from drift.planning.search import manners
from drift.planning.search.records import Plan, Tasking
from geo import polyline, sphere
from geo.array import Array
from geo.notation import KNOT, NMI
from geo.polyline import Legs

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"


@dataclass(frozen=True)
class Waypoint:
    """A point of a unit's way [deg]."""

    name: str  # A-1 CSP, A-1 02, unique in the plan
    what: str  # base, way (by sea), csp, leg, turn (round what cuts a leg), off or home
    time: np.datetime64
    lon: float
    lat: float


def names(plan: Plan) -> list[str]:
    """Return the names of the taskings' sub-areas.

    They are A-1, A-2, ... in the first round, B-1, ... in the second.
    """
    names, count = [], dict[int, int]()
    for tasking in plan.taskings:
        count[tasking.round] = count.get(tasking.round, 0) + 1
        letters, rest = "", tasking.round
        while rest > 0:
            rest, letter = divmod(rest - 1, 26)
            letters = LETTERS[letter] + letters
        names.append(f"{letters}-{count[tasking.round]}")
    return names


def corners(tasking: Tasking) -> list[tuple[float, float]]:
    """Return the corners (lon, lat) [deg] of a sub-area, in order around it.

    The first is the one nearest to the commence search point.
    """
    area = patterns.rectangle(tasking.centre, tasking.length, tasking.width, tasking.orientation)
    corners = list(zip(area.lon, area.lat, strict=True))
    start = begin(tasking)
    apart = [float(sphere.distance(*np.radians(corner), *np.radians(start))) for corner in corners]
    k = int(np.argmin(apart)) if tasking.sortie.legs is not None else 0
    return corners[k:] + corners[:k]


def pattern(tasking: Tasking) -> str:
    """Return the name of a tasking's pattern, and the drift of its frame."""
    manner, words = tasking.manner, manners.PATTERNS[tasking.manner.pattern].words
    if not manner.moves:
        return words
    return (
        f"{words}, drifting {_drift(tasking) / KNOT:.1f} kn toward {degrees(_toward(tasking)):03d}T"
    )


def _drift(tasking: Tasking) -> float:
    """Return the speed [m/s] at which the frame of a tasking's pattern drifts."""
    return math.hypot(tasking.manner.east, tasking.manner.north)


def _toward(tasking: Tasking) -> float:
    """Return the direction [rad] of that drift, clockwise from north."""
    return math.atan2(tasking.manner.east, tasking.manner.north)


def begin(tasking: Tasking) -> tuple[float, float]:
    """Return the commence search point (lon, lat) [deg]; without legs, the centre."""
    legs = tasking.sortie.legs
    return tasking.centre if legs is None else (legs.lon[0], legs.lat[0])


def end(tasking: Tasking) -> tuple[float, float]:
    """Return the end of the search (lon, lat) [deg]; without legs, the centre."""
    legs = tasking.sortie.legs
    return tasking.centre if legs is None else (legs.lon[-1], legs.lat[-1])


def route(name: str, tasking: Tasking) -> list[Waypoint]:
    """Return a unit's way from its base over the ends of all legs to where it returns."""
    unit, legs = tasking.unit, tasking.sortie.legs
    way = [Waypoint(f"{name} BASE", "base", tasking.takeoff, *unit.base)]
    way += _turns(f"{name} OUT", unit.base, tasking.out, tasking.on_scene, unit.transit_speed)
    if legs is None:
        way.append(Waypoint(f"{name} CENTRE", "csp", tasking.on_scene, *tasking.centre))
    else:
        times = [np.datetime64(round(t), "s") for t in legs.time]
        way.append(Waypoint(f"{name} CSP", "csp", times[0], legs.lon[0], legs.lat[0]))
        last = len(times) - 1
        way += [
            Waypoint(
                f"{name} {k:02d}" if k < last else f"{name} END", _what(legs, k), times[k], x, y
            )
            for k, (x, y) in enumerate(zip(legs.lon, legs.lat, strict=True))
            if k > 0
        ]
    back = _turns(
        f"{name} BACK", unit.return_to, tasking.back[::-1], tasking.home, -unit.transit_speed
    )
    return [*way, *back[::-1], Waypoint(f"{name} HOME", "home", tasking.home, *unit.return_to)]


def _what(legs: Legs, k: int) -> str:
    """Return the kind of point k of the legs: off (last), leg (end of one) or turn (round land)."""
    if k == len(legs.lon) - 1:
        return "off"
    return "leg" if legs.searching[k - 1] or legs.searching[k] else "turn"


def _turns(
    name: str,
    port: tuple[float, float],
    way: Sequence[tuple[float, float]],
    time: np.datetime64,
    speed: float,
) -> list[Waypoint]:
    """Return the turning points of a way by sea between a port and the search.

    way: from the port. time: of arrival at the end of the way that is sailed. speed: negative on a
    way to the port. Points are numbered in the direction that is sailed.
    """
    inner = list(way[1:-1] if len(way) and _same(way[0], port) else way[:-1])
    points = []
    for k, place in enumerate(inner):
        rest = polyline.great_circle_length(list(way)[-(len(inner) - k) - 1 :])
        if speed < 0:  # the time is that of the port
            rest = polyline.great_circle_length([port, *list(way)[: len(way) - len(inner) + k]])
        number = k + 1 if speed > 0 else len(inner) - k
        passed = time - np.timedelta64(round(rest / abs(speed)), "s")
        points.append(Waypoint(f"{name} {number:02d}", "way", passed, *place))
    return points


def _same(a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Return True if two positions [deg] are less than a metre apart."""
    return float(sphere.distance(*np.radians(a), *np.radians(b))) < 1.0


def transits(tasking: Tasking) -> list[Array]:
    """Return the ways out and home as great circles, each (n, 2) of lon, lat [deg]."""
    unit = tasking.unit
    ways = (
        tasking.out or (unit.base, begin(tasking)),
        tasking.back or (end(tasking), unit.return_to),
    )
    return [search_shapes.curve(*zip(*way, strict=True)) for way in ways if way[0] != way[-1]]


def by_sea(tasking: Tasking) -> list[tuple[str, float, float]]:
    """Return name, length [m] and straight distance [m] of a boat's ways out and home."""
    unit = tasking.unit
    ways = (
        ("Way out", tasking.out, unit.base, begin(tasking)),
        ("Way home", tasking.back, unit.return_to, end(tasking)),
    )
    return [
        (name, polyline.great_circle_length(way), polyline.great_circle_length([port, place]))
        for name, way, port, place in ways
        if len(way) > 1
    ]


def round_length(tasking: Tasking) -> float:
    """Return the total length [m] of a tasking's ways round land between its legs."""
    legs = tasking.sortie.legs
    return (
        0.0
        if legs is None
        else float(polyline.lengths(legs)[~np.array(legs.searching, bool)].sum())
    )


def leg_length(tasking: Tasking) -> float:
    """Return the length [m] of a tasking's longest leg; 0 without legs."""
    legs = tasking.sortie.legs
    return (
        0.0 if legs is None else float(polyline.lengths(legs)[np.array(legs.searching, bool)].max())
    )


def track_length(tasking: Tasking) -> float:
    """Return the length [m] of track that searches.

    Without legs it is the time on scene times the search speed.
    """
    legs, sortie = tasking.sortie.legs, tasking.sortie
    if legs is None:
        return tasking.unit.search_speed * float(
            (sortie.end - sortie.start) / np.timedelta64(1, "s")
        )
    return float(polyline.lengths(legs)[np.array(legs.searching, bool)].sum())


def widths(tasking: Tasking, under_way: bool = False) -> Array:
    """Return the sweep width [m] by scenario, adrift or under way."""
    sortie = tasking.sortie
    return np.array(
        sortie.width_under_way if under_way and sortie.width_under_way else sortie.sweep_width
    )


def coverages(tasking: Tasking, under_way: bool = False) -> Array:
    """Return the coverage of the sub-area by scenario, W / S, as its crew would compute it.

    If legs are cut at the coast it is W times the searching track over the sea of the sub-area. For
    a sector search it is W times its track over the area of its circle.

    Args:
        tasking: with the sub-area.
        under_way: True: of objects under way; False: of objects adrift.
    """
    sortie = tasking.sortie
    if sortie.coverage:
        return np.array(
            sortie.coverage_under_way
            if under_way and sortie.coverage_under_way
            else sortie.coverage
        )
    width = widths(tasking, under_way)
    if tasking.manner.pattern == "sector":
        return np.asarray(width * track_length(tasking) / (math.pi * tasking.spacing**2))
    return tasking.swept * width / tasking.spacing if tasking.spacing > 0 else np.zeros(len(width))


def pods(tasking: Tasking, under_way: bool = False) -> Array:
    """Return the POD of the sub-area by scenario for an object that stays in it.

    It is averaged over the unknown part of the sweep width and over the sub-area; where legs are
    cut out it is 0. It omits detections from the ends of legs beyond their own strips, and is too
    low by that.

    Args:
        tasking: with the sub-area.
        under_way: True: of objects under way; False: of objects adrift.
    """
    factors, chances = laws.factors(tasking.sortie.shape)
    along = coverages(tasking, under_way) / tasking.swept
    return np.asarray(
        tasking.swept * laws.pod(tasking.sortie.law, np.outer(along, factors)) @ chances
    )


def degrees(angle: float) -> int:
    """Return a direction [rad] in whole degrees, 1 to 360 (north is 360)."""
    return round(math.degrees(angle) - 1) % 360 + 1


def summary_of_plan(plan: Plan) -> dict[str, Any]:
    """Return a plan's numbers for the summary, in degrees, nmi and kn."""
    return {
        "objective": plan.spec.objective,
        "begin": plan.spec.begin,
        "until": plan.spec.until,
        "value": plan.value,
        "pos": plan.pos,
        "pos_ashore": plan.pos_ashore,
        "ashore": plan.ashore,
        "pos_by_scenario": dict(
            zip(plan.scenarios, np.asarray(plan.by_scenario, float).tolist(), strict=True)
        ),
        "bound": plan.bound,
        "bound_error": None if plan.bound is None else plan.bound_error,
        "no_bound": plan.unbounded or None,
        "share_of_bound": plan.seen / plan.bound if plan.bound else None,
        "value_on_planning_particles": plan.seen,
        "optimism": plan.seen - plan.value,
        "effective_particles": {
            "made_on": _counted(plan.made_on),
            "scored_on": _counted(plan.scored_on),
        },
        "taskings": [
            _tasking(plan, name, tasking)
            for name, tasking in zip(names(plan), plan.taskings, strict=True)
        ],
        "alternatives": [
            {
                "name": other.name,
                "value": other.value,
                "difference": other.difference,
                "standard_error": other.standard_error,
                "keeps_separation": other.apart,
            }
            for other in plan.alternatives
        ],
    }


def _counted(count: Count | None) -> float | None:
    """Return an effective number, or None."""
    return None if count is None else count.number


def _tasking(plan: Plan, name: str, tasking: Tasking) -> dict[str, Any]:
    """Return a tasking's numbers for the summary."""
    return {
        "area": name,
        "unit": tasking.unit.name,
        "kind": tasking.unit.kind,
        "round": tasking.round,
        "pos": tasking.pos,
        "pos_ashore": tasking.pos_ashore,
        "takeoff": tasking.takeoff,
        "on_scene": tasking.on_scene,
        "off_scene": tasking.off_scene,
        "home": tasking.home,
        "waits": tasking.waits,
        "corners": [_place(*corner) for corner in corners(tasking)],
        "centre": _place(*tasking.centre),
        "commence_search_point": _place(*begin(tasking)),
        "length_nmi": tasking.length / NMI,
        "width_nmi": tasking.width / NMI,
        "orientation_deg": math.degrees(tasking.orientation) % 360,
        "pattern": tasking.manner.pattern,
        "drift_kn": _drift(tasking) / KNOT,
        "drift_toward_deg": math.degrees(_toward(tasking)) % 360,
        "creep_deg": math.degrees(tasking.creep) % 360,
        "spacing_nmi": tasking.spacing / NMI,
        "legs": tasking.legs,
        "leg_length_nmi": leg_length(tasking) / NMI,
        "track_nmi": track_length(tasking) / NMI,
        "legs_cut": list(tasking.cut),
        "swept": tasking.swept,
        "round_nmi": round_length(tasking) / NMI,
        "transit": [
            {"way": which, "by_sea_nmi": way / NMI, "straight_nmi": straight / NMI}
            for which, way, straight in by_sea(tasking)
        ],
        "search_speed_kn": tasking.unit.search_speed / KNOT,
        "altitude_ft": tasking.unit.altitude / 0.3048,
        "sweep_width_nmi": {
            k: w / NMI for k, w in zip(plan.scenarios, tasking.sortie.sweep_width, strict=True)
        },
        "pod": dict(zip(plan.scenarios, pods(tasking).tolist(), strict=True)),
        **(_under_way(plan, tasking) if tasking.sortie.width_under_way else {}),
    }


def _under_way(plan: Plan, tasking: Tasking) -> dict[str, Any]:
    """Return sweep widths and POD of objects under way."""
    return {
        "sweep_width_under_way_nmi": dict(
            zip(plan.scenarios, (widths(tasking, True) / NMI).tolist(), strict=True)
        ),
        "pod_under_way": dict(zip(plan.scenarios, pods(tasking, True).tolist(), strict=True)),
    }


def _place(lon: float, lat: float) -> dict[str, float]:
    """Return a position [deg] for the summary."""
    return {"lon": sphere.wrap_degrees(lon), "lat": lat}


def scenario_pos(plan: Plan) -> list[tuple[str, float]]:
    """Return the POS given each scenario.

    Of many scenarios these are the likeliest before the plan, and the mean of the others.
    """
    names, (pos,) = told(plan, np.asarray(plan.by_scenario, float))
    return list(zip(names, pos, strict=True))


def told(plan: Plan, *values: Array) -> tuple[list[str], list[list[float]]]:
    """Return names and values of the scenarios listed individually, and the mean of the others."""
    share = np.ones(len(plan.scenarios)) if plan.shares is None else plan.shares
    shown = likeliest.likeliest_scenarios(share)
    return shown.names(plan.scenarios), [
        shown.means(np.asarray(v, float), share).tolist() for v in values
    ]


def plan_numbers(plan: Plan) -> dict[str, Any]:
    """Return a plan for programs: positions and directions in degrees, the rest in SI units."""
    return {
        "objective": plan.spec.objective,
        "value": plan.value,
        "pos": plan.pos,
        "pos_ashore": plan.pos_ashore,
        "ashore": plan.ashore,
        "pos_by_scenario": dict(scenario_pos(plan)),
        "bound": plan.bound,
        "idle": plan.idle,
        "taskings": [
            {
                "area": name,
                "unit": tasking.unit.name,
                "round": tasking.round,
                "takeoff": tasking.takeoff,
                "on_scene": tasking.on_scene,
                "off_scene": tasking.off_scene,
                "home": tasking.home,
                "centre": {"lon_deg": tasking.centre[0], "lat_deg": tasking.centre[1]},
                "length_m": tasking.length,
                "width_m": tasking.width,
                "orientation_deg": np.degrees(tasking.orientation) % 360,
                "pattern": tasking.manner.pattern,
                "drift_m_s": _drift(tasking),
                "drift_toward_deg": np.degrees(_toward(tasking)) % 360,
                "creep_deg": np.degrees(tasking.creep) % 360,
                "spacing_m": tasking.spacing,
                "legs": tasking.legs,
                "pos": tasking.pos,
                "pos_ashore": tasking.pos_ashore,
            }
            for name, tasking in zip(names(plan), plan.taskings, strict=True)
        ],
    }
