"""Which stretches of coast each team can go to: over land from its base, and across water only
where it may.

Reach is measured along the shortest way over land (geo.coast.overland). A base on water begins at
the nearest land. A team without a base goes to any stretch, but all its patrols stay on one land
mass; two pieces of mainland that are one beyond the domain count as one.
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
    """Where a team can go."""

    team: Team
    stretches: tuple[int, ...]  # numbers, however long they are
    stays: bool = False  # all its patrols lie on one land mass, of which a plan chooses
    note: str = ""  # what was made of its base


@dataclass(frozen=True)
class Walkable:
    """Where the teams of a spill can go, and the land mass of each stretch."""

    teams: tuple[Access, ...]
    mass: Array  # (n,) SEVERAL: it lies on several

    def of(self, team: Team) -> Access:
        """Return where a team can go."""
        return next(access for access in self.teams if access.team is team)


def of_teams(
    teams: Sequence[Team], segments: Segments, land_in: LandIn, whole: Callable[[], Array]
) -> Walkable:
    """Return where teams can go.

    land_in: returns the land polygons [deg] of a box. whole: returns those of the whole source of
    the coast; it is asked only if it matters. Raises UserError for a base without land within its
    reach, and for a named stretch that lies on several land masses.
    """
    assert segments.land is not None
    assert segments.mass is not None
    mass = segments.mass
    if any(team.base is None and not team.crosses_water for team in teams):
        joined = land_masses.of_whole(segments.land, whole)
        number = np.full(segments.land.mass.max(initial=0) + 1, SEVERAL)
        number[segments.land.mass] = joined.mass
        mass = np.where(mass == SEVERAL, SEVERAL, number[mass])
    return Walkable(tuple(_of_team(team, segments, mass, land_in) for team in teams), mass)


def _of_team(team: Team, segments: Segments, mass: Array, land_in: LandIn) -> Access:
    place = f'patrol_unit "{team.name}"'
    if team.base is not None:
        return _within_reach(team, team.base, segments, mass, land_in)
    if not team.stretches:
        every = np.flatnonzero(team.crosses_water | (mass != SEVERAL))
        return Access(team, tuple(every.tolist()), not team.crosses_water)
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
    """Return where a team with a base can go."""
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
    # From the nearest land the straight distance may be longer.
    candidates = np.flatnonzero((straight <= team.reach + away) & (mass != SEVERAL))
    spots = [(float(segments.lon[s]), float(segments.lat[s])) for s in candidates]
    way = overland.overland_distances(land, (x, y), spots, team.reach)
    found = tuple(candidates[np.isfinite(way)].tolist())
    if not found and near.size:
        raise UserError(
            f"{place}: no stretch within {_km(team.reach)} of its base can be reached over land within that distance; give the "
            "team crosses_water = true, a base on the land of the stretches or a greater reach, or add the bridge between "
            "the two to spill.bridges"
        )
    return Access(team, found, note=note)


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
    return (
        box.south <= lat <= box.north and float(sphere.east_of_degrees(lon, box.west)) <= box.east
    )


def _km(metres: float) -> str:
    return f"{metres / 1000:.3g} km"
