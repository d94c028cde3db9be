"""Which stretches of coast each team can reach: over land, and across water only if allowed.

Reach is measured along the shortest path over land (geo.coast.overland). A base on water is moved
to the nearest land. A team without a base can go to any stretch, but all its patrols stay on one
land mass. Two pieces of mainland that join outside the domain count as one land mass.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drift.spills.worlds import evidence
from drift.spills.worlds.records import Team
from geo import notation, sphere
from geo.array import Array
from geo.box import Box
from geo.coast import land_masses, overland
from geo.coast.land_masses import SEVERAL, LandMasses
from geo.coast.segments import Segments
from geo.errors import UserError

LandIn = Callable[[Box], Array]


@dataclass(frozen=True)
class Access:
    """The stretches that a team can reach."""

    team: Team
    stretches: tuple[int, ...]  # indices, whatever the length of the stretch
    stays: bool = False  # all its patrols lie on one land mass, chosen by the plan
    note: str = ""  # where the base was moved to, if it lies on water


@dataclass(frozen=True)
class Walkable:
    """The reachable stretches of all teams, and the land mass of each stretch."""

    teams: tuple[Access, ...]
    mass: Array  # (n,) index of the land mass; SEVERAL: it lies on several

    def of(self, team: Team) -> Access:
        """Return the reachable stretches of a team."""
        return next(access for access in self.teams if access.team is team)


def of_teams(
    teams: Sequence[Team], segments: Segments, land_in: LandIn, read_whole_land: Callable[[], Array]
) -> Walkable:
    """Return the reachable stretches of all teams.

    Args:
        teams: of the spill.
        segments: the stretches of coast.
        land_in: returns the land polygons [deg] of a box.
        read_whole_land: returns the land polygons of the whole coast data set; called only if needed.

    Raises:
        UserError: a base has no land within its reach, or a named stretch lies on several land
            masses.
    """
    assert segments.land is not None
    assert segments.mass is not None
    mass = segments.mass
    if any(team.base is None and not team.crosses_water for team in teams):
        joined = land_masses.of_whole(segments.land, read_whole_land)
        number = np.full(segments.land.mass.max(initial=0) + 1, SEVERAL)
        number[segments.land.mass] = joined.mass
        mass = np.where(mass == SEVERAL, SEVERAL, number[mass])
    return Walkable(tuple(_of_team(team, segments, mass, land_in) for team in teams), mass)


def _of_team(team: Team, segments: Segments, mass: Array, land_in: LandIn) -> Access:
    """Return the reachable stretches of one team."""
    place = f'patrol_unit "{team.name}"'
    if team.base is not None:
        return _within_reach(team, team.base, segments, mass, land_in)
    if not team.stretches:
        permitted = np.flatnonzero(team.crosses_water | (mass != SEVERAL))
        return Access(team, tuple(permitted.tolist()), not team.crosses_water)
    named = tuple(
        evidence.stretch_by_name(name, place, segments) for name in dict.fromkeys(team.stretches)
    )
    for s in named:
        if mass[s] == SEVERAL and not team.crosses_water:
            raise UserError(
                f'{place}: stretch "{segments.name[s]}" lies on several land masses, none with '
                f"{100 * land_masses.MOST:g} % of its shore; give the team crosses_water = true, or cut the stretch "
                "shorter"
            )
    return Access(team, named, not team.crosses_water)


def _within_reach(
    team: Team, base: tuple[float, float], segments: Segments, mass: Array, land_in: LandIn
) -> Access:
    """Return the reachable stretches of a team with a base."""
    place = f'patrol_unit "{team.name}"'
    lon, lat = np.radians(base)
    straight = sphere.distance(lon, lat, np.radians(segments.lon), np.radians(segments.lat))
    near = np.flatnonzero(straight <= team.reach)
    if team.crosses_water:
        return Access(team, tuple(near.tolist()))
    land = _about(base, team.reach, segments, land_in)
    if not len(land.polygons):
        raise UserError(
            f"{place}: no land lies within its reach of {_km(team.reach)} from its base; {_REMEDY}"
        )
    _, x, y, away = land_masses.nearest_land(land, *base)
    if away > team.reach:
        raise UserError(
            f"{place}: no land lies within its reach of {_km(team.reach)} from its base; the nearest is {_km(away)} "
            f"off, at {notation.position(x, y)}; {_REMEDY}"
        )
    note = ""
    if away > 0:
        note = (
            f"the base of {team.name}, {notation.position(*base)}, lies on water: the team starts at the nearest land, "
            f"{_km(away)} off, at {notation.position(x, y)}"
        )
    # The base was moved by `away`, so the straight distance may exceed the reach by as much.
    candidates = np.flatnonzero((straight <= team.reach + away) & (mass != SEVERAL))
    spots = [(float(segments.lon[s]), float(segments.lat[s])) for s in candidates]
    overland_distance = overland.overland_distances(land, (x, y), spots, team.reach)
    reachable = tuple(candidates[np.isfinite(overland_distance)].tolist())
    if not reachable and near.size:
        raise UserError(
            f"{place}: no stretch within {_km(team.reach)} of its base can be reached over land within that distance; give the "
            "team crosses_water = true, a base on the land of the stretches or a greater reach, or add the bridge between "
            "the two to spill.bridges"
        )
    return Access(team, reachable, note=note)


_REMEDY = "give a greater reach, or move the base"


def _about(
    base: tuple[float, float], reach: float, segments: Segments, land_in: LandIn
) -> LandMasses:
    """Return the land within reach of a base, with its bridges."""
    height = float(np.degrees(reach / sphere.RADIUS))
    width = height / max(float(np.cos(np.radians(min(abs(base[1]) + height, 89.0)))), 0.02)
    west = float(sphere.wrap_degrees(base[0] - width))
    box = Box(
        west,
        max(base[1] - height, -90.0),
        west + min(2 * width, 360.0),
        min(base[1] + height, 90.0),
    )
    assert segments.land is not None
    near = [ends for ends in segments.land.bridges if all(_holds(box, *end) for end in ends)]
    land = land_masses.build_land_masses(land_in(box), near)
    return replace(land, bridges=tuple(near))


def _holds(box: Box, lon: float, lat: float) -> bool:
    """Return True if the box contains a position [deg]."""
    return (
        box.south <= lat <= box.north and float(sphere.east_of_degrees(lon, box.west)) <= box.east
    )


def _km(metres: float) -> str:
    """Return a distance in km as text."""
    return f"{metres / 1000:.3g} km"
