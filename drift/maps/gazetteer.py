"""Names of towns and harbours on coasts, for whoever reads a map; data/places.md says where they come from."""

import csv
from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np

from geo import sphere
from geo.array import Array
from geo.box import Box

HARBOUR = 5.0  # factor by which a harbour counts for more than a town of its size
BESIDE = 10_000.0  # [m] within which a place is near a town
FARTHEST = 100_000.0  # [m] within which it is told by how far it is from one
APART = 0.08  # of the box's size: places that are shown are at least so far from each other


@dataclass(frozen=True)
class Place:
    """A town or harbour [deg]."""

    name: str
    lon: float
    lat: float
    harbour: bool


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
        if all(np.hypot((x[k] - x[other]) * narrow, lat[k] - lat[other]) >= apart for other in chosen):
            chosen.append(int(k))
        if len(chosen) == most:
            break
    return [Place(names[k], float(x[k]), float(lat[k]), bool(harbour[k])) for k in chosen]


def nearest(lon: Array, lat: Array) -> list[tuple[str, float]]:
    """Return the name of the town or harbour nearest to each place [deg], and how far it is [m]."""
    names, lons, lats, _, _ = _all()
    found = []
    for x, y in zip(np.radians(lon), np.radians(lat), strict=True):
        distance = sphere.distance(x, y, np.radians(lons), np.radians(lats))
        k = int(np.argmin(distance))
        found.append((names[k], float(distance[k])))
    return found


def words(name: str, away: float) -> str:
    """Return where a place is that lies so far [m] from a town: "near X", "34 km from X"; far away ""."""
    if away > FARTHEST:
        return ""
    return f"near {name}" if away <= BESIDE else f"{away / 1000:.0f} km from {name}"
