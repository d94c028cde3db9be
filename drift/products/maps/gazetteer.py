"""Names of towns and harbours on coasts, for maps and tables; data/places.md gives their sources.

A place on the shore is named by the nearest town on its own land mass. Where there is none within
FARTHEST, the nearest town of all names it, and the name says "across water". Of a town beyond the
land that is known nothing is said of water.
"""

import csv
import math
from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np

from geo import sphere
from geo.array import Array
from geo.box import Box
from geo.coast import land_masses
from geo.coast.land_masses import LandMasses

HARBOUR = 5.0  # factor by which a harbour counts for more than a town of its size
BESIDE = 10_000.0  # [m] within which a place is near a town
FARTHEST = 100_000.0  # [m] within which it is told by how far it is from one
ACROSS = "across water"
UNKNOWN = -9  # land mass of what lies beyond the land that is known
APART = 0.08  # of the box's size: places that are shown are at least so far from each other


@dataclass(frozen=True)
class Place:
    """A town or harbour [deg]."""

    name: str
    lon: float
    lat: float
    harbour: bool


@dataclass(frozen=True)
class Near:
    """The town or harbour by which a place is named."""

    name: str
    away: float  # [m]
    across: bool = False  # it lies on another land mass
    lon: float = math.nan  # [deg]
    lat: float = math.nan


@cache
def _all() -> tuple[list[str], Array, Array, Array, Array]:
    text = resources.files("drift.data").joinpath("places.csv").read_text(encoding="utf-8")
    rows = list(csv.reader(text.splitlines()))[1:]
    lon, lat, people, harbour = np.array([row[1:] for row in rows], float).T
    return [row[0] for row in rows], lon, lat, people, harbour > 0


def around(box: Box, most: int = 12) -> list[Place]:
    """Return the places of a box that matter most, harbours first, well apart from each other."""
    names, lon, lat, people, harbour = _all()
    x = sphere.east_of_degrees(lon, box.west)
    inside = np.flatnonzero((x <= box.east) & (lat >= box.south) & (lat <= box.north))
    rank = (people + 100) * np.where(harbour, HARBOUR, 1.0)
    narrow = np.cos(np.radians((box.south + box.north) / 2))
    apart = APART * max(box.north - box.south, (box.east - box.west) * narrow)
    chosen: list[int] = []
    for k in inside[np.argsort(-rank[inside], kind="stable")]:
        if all(
            np.hypot((x[k] - x[other]) * narrow, lat[k] - lat[other]) >= apart for other in chosen
        ):
            chosen.append(int(k))
        if len(chosen) == most:
            break
    return [Place(names[k], float(x[k]), float(lat[k]), bool(harbour[k])) for k in chosen]


def nearest(lon: Array, lat: Array, land: LandMasses | None = None) -> list[Near]:
    """Return the town or harbour by which each place [deg] is named.

    land: what towns and places lie on; without it the nearest town names a place. Of two pieces of
    land that the edge of its box cuts it is not known whether they are one.
    """
    names, lons, lats, _, _ = _all()
    mass = np.full(len(names), UNKNOWN)
    reaching = frozenset[int]()
    if land is not None and len(land.polygons):
        reaching, known = (
            land_masses.reaching_the_edge(land),
            land.box or Box(-180.0, -90.0, 180.0, 90.0),
        )
        inside = np.flatnonzero(
            (sphere.east_of_degrees(lons, known.west) <= known.east)
            & (lats >= known.south)
            & (lats <= known.north)
        )
        mass[inside] = land_masses.of_places(land, lons[inside], lats[inside])
        own = land_masses.of_places(land, np.asarray(lon), np.asarray(lat))
    else:
        own = np.full(len(lon), UNKNOWN)
    found = []
    for x, y, here in zip(np.radians(lon), np.radians(lat), own, strict=True):
        distance = sphere.distance(x, y, np.radians(lons), np.radians(lats))
        same = np.where((mass == here) & (mass != UNKNOWN), distance, np.inf)
        k = int(np.argmin(same))
        if not same[k] <= FARTHEST:
            k = int(np.argmin(distance))
        across = (
            UNKNOWN not in (here, mass[k])
            and here != mass[k]
            and not {int(here), int(mass[k])} <= reaching
        )
        found.append(
            Near(names[k], float(distance[k]), bool(across), float(lons[k]), float(lats[k]))
        )
    return found


def place_in_words(near: Near) -> str:
    """Return where a place is by its town: "near X", "34 km from X", "near X, across water"; far
    away "".
    """
    if near.away > FARTHEST:
        return ""
    told = (
        f"near {near.name}"
        if near.away <= BESIDE
        else f"{near.away / 1000:.0f} km from {near.name}"
    )
    return f"{told}, {ACROSS}" if near.across else told
