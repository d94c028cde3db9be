"""Towns and harbours on coasts, to name places in maps and tables; data/places.md has the sources.

A place on the shore is named after the nearest town on its own land mass. If there is none within
FARTHEST, the nearest town of all is used, with "across water" in the text. That remark is left out
for a town beyond the known land.
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

HARBOUR = 5.0  # factor by which a harbour outweighs a town of its size
BESIDE = 10_000.0  # [m] within which a place is "near" a town
FARTHEST = 100_000.0  # [m] within which a place is described by its distance to a town
ACROSS = "across water"
UNKNOWN = -9  # land mass of positions beyond the known land
APART = 0.08  # smallest distance between places that are shown, as a share of the box's size


@dataclass(frozen=True)
class Place:
    """A town or harbour [deg]."""

    name: str
    lon: float
    lat: float
    harbour: bool


@dataclass(frozen=True)
class Near:
    """The town or harbour that a place is named after."""

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


def places_in_box(box: Box, most: int = 12) -> list[Place]:
    """Return up to `most` important places in a box, harbours first, well apart from each other."""
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


def nearest_towns(lon: Array, lat: Array, land: LandMasses | None = None) -> list[Near]:
    """Return the town or harbour that each place is named after.

    Args:
        lon, lat: places [deg], shape (n,).
        land: land masses of towns and places; None: the nearest town names a place. Two pieces of
            land that reach the edge of its box may be connected, and count as one.

    Returns:
        The town of each place, in their order.
    """
    names, lons, lats, _, _ = _all()
    mass = np.full(len(names), UNKNOWN)
    reaching = frozenset[int]()
    if land is not None and len(land.polygons):
        reaching, known = (
            land_masses.masses_at_edge(land),
            land.box or Box(-180.0, -90.0, 180.0, 90.0),
        )
        inside = np.flatnonzero(
            (sphere.east_of_degrees(lons, known.west) <= known.east)
            & (lats >= known.south)
            & (lats <= known.north)
        )
        mass[inside] = land_masses.mass_of_places(land, lons[inside], lats[inside])
        own = land_masses.mass_of_places(land, np.asarray(lon), np.asarray(lat))
    else:
        own = np.full(len(lon), UNKNOWN)
    found = []
    for x, y, own_mass in zip(np.radians(lon), np.radians(lat), own, strict=True):
        distance = sphere.distance(x, y, np.radians(lons), np.radians(lats))
        on_own_mass = np.where((mass == own_mass) & (mass != UNKNOWN), distance, np.inf)
        k = int(np.argmin(on_own_mass))
        if not on_own_mass[k] <= FARTHEST:
            k = int(np.argmin(distance))
        across = (
            UNKNOWN not in (own_mass, mass[k])
            and own_mass != mass[k]
            and not {int(own_mass), int(mass[k])} <= reaching
        )
        found.append(
            Near(names[k], float(distance[k]), bool(across), float(lons[k]), float(lats[k]))
        )
    return found


def place_in_words(near: Near) -> str:
    """Describe a place by its town: "near X", "34 km from X", "near X, across water"; "" if far."""
    if near.away > FARTHEST:
        return ""
    distance = (
        f"near {near.name}"
        if near.away <= BESIDE
        else f"{near.away / 1000:.0f} km from {near.name}"
    )
    return f"{distance}, {ACROSS}" if near.across else distance
