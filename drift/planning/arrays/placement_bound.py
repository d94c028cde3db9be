"""An upper bound of the probability that towed arrays hear the target, over all placements.

Time is cut into slots and the sea into cells. In a slot, an array misses at least as much as it
would with the highest signal excess that it can have anywhere in its cell, on any heading, at every
moment. Over all slots it misses at least the product of the slots' misses: given the fluctuation at
the border of two slots, the times before and after it are independent, and both are likelier to be
silent the lower that value is (Chebyshev's inequality for monotone functions). So the negative
logarithm of a miss is at most the sum of the hazards h of the cells on the array's route.

Routes from cell to cell at the ship's speed are then mixed. The sum over particles of w (1 -
exp(-sum y h)) is concave in the shares y, so the method of Frank and Wolfe (1956) bounds its
maximum from above at every step. The bound therefore relaxes four things: the array takes the best
position and heading of its cell, turns at will, draws its fluctuation again in each slot, and may
be divided among routes. Bound and plan are compared on the same particles.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from drift.planning.arrays import heard, placement
from drift.planning.arrays.heard import Hearer
from drift.planning.arrays.placement import Placement
from drift.planning.arrays.ways import Sea
from drift.planning.search import planning_tracks
from drift.planning.search.planning_tracks import Tracks
from geo import sphere
from geo.array import Array
from kernels.planning import stations

PARTICLES = 400
CELLS = 500  # most cells of each array
SLOTS = (2, 4)  # numbers of slots that are tried; the lowest bound is used
STEPS = 60  # most steps of Frank and Wolfe's method
PART = 4000.0  # [m] part of the relative track with one value of signal excess
SMALL = 0.002  # duality gap at which the search ends


@dataclass(frozen=True)
class Bound:
    """The upper bound, and the value of the plan on the same particles."""

    value: float
    plan: float
    particles: int
    cell: float  # [m] side of a cell
    slots: int


def bound(seas: Sequence[Sea], tracks: Tracks, plan: Placement) -> Bound:
    """Return an upper bound of the probability that any placement of the ships hears the target.

    Args:
        seas: where and when each ship may tow.
        tracks: planning particles; their weights sum to 1.
        plan: the placement to compare.
    """
    some = planning_tracks.coarser(tracks, placement.BINS)
    some = some if some.m <= PARTICLES else planning_tracks.sample(some, PARTICLES)
    hearers = [heard.hearer(sea, some) for sea in seas]
    missed = [
        heard.missed(own, placed.way, placement.FINE)[0]
        for own, placed in zip(hearers, plan.placed, strict=True)
    ]
    own = float((1 - placement.together(hearers, missed)) @ some.weight)
    found = [_relaxed(hearers, some, many) for many in SLOTS if many <= some.bins]
    value, cell, slots = min(found)
    return Bound(max(value, own), own, some.m, cell, slots)


def _relaxed(hearers: Sequence[Hearer], some: Tracks, many: int) -> tuple[float, float, int]:
    """Return the bound for a number of slots, its cell size [m] and the slots used."""
    first = np.unique(np.rint(np.linspace(0, some.bins, many + 1)).astype(int))
    arrays = [_Array.of(hearer, some, first) for hearer in hearers]
    # Each array averages over its own unknown. Arrays that share an unknown miss together more
    # often than that (Chebyshev's inequality), so the result remains an upper bound.
    total, weight = [np.zeros((some.m, hearer.chances.size)) for hearer in hearers], some.weight
    best = math.inf
    for step in range(STEPS):
        missed = [np.exp(-h) @ hearer.chances for h, hearer in zip(total, hearers, strict=True)]
        all_miss = np.prod(missed, axis=0)
        value = float((1 - all_miss) @ weight)
        vertices, gain = [], 0.0
        for k, (array, hearer) in enumerate(zip(arrays, hearers, strict=True)):
            others = (
                np.prod([m for j, m in enumerate(missed) if j != k], axis=0)
                if len(missed) > 1
                else np.ones(some.m)
            )
            slope = (weight * others)[:, None] * np.exp(-total[k]) * hearer.chances
            route = array.best(slope)
            to = array.hazard_of(route)
            gain += float(np.sum(slope * (to - total[k])))
            vertices.append(to)
        best = min(best, value + gain)
        if gain < SMALL or step == STEPS - 1:
            break
        share = _line(total, vertices, hearers, weight)
        total = [(1 - share) * h + share * to for h, to in zip(total, vertices, strict=True)]
    return min(best, 1.0), max(array.side for array in arrays), len(first) - 1


def _line(
    total: Sequence[Array], to: Sequence[Array], hearers: Sequence[Hearer], weight: Array
) -> float:
    """Return the step from one mixture towards another, by golden-section search."""
    low, high, golden = 0.0, 1.0, (math.sqrt(5) - 1) / 2

    def heard_at(share: float) -> float:
        """Return the heard weight after a step."""
        parts = [
            np.exp(-((1 - share) * h + share * t)) @ own.chances
            for h, t, own in zip(total, to, hearers, strict=True)
        ]
        return float((1 - np.prod(parts, axis=0)) @ weight)

    for _ in range(24):
        a, b = high - golden * (high - low), low + golden * (high - low)
        if heard_at(a) < heard_at(b):
            low = a
        else:
            high = b
    return max(0.5 * (low + high), 1e-3)


@dataclass(frozen=True, eq=False)
class _Array:
    """Cells and hazards of one array, and which cells it can reach from which."""

    hazard: Array  # float32 (slots, cells, m, factors)
    first: Array  # bool (cells,): cells in which it may be in the first slot
    near: Array  # bool (cells, cells): whether it can go from one to the other
    side: float  # [m]

    @classmethod
    def of(cls, hearer: Hearer, some: Tracks, first: Array) -> "_Array":
        """Return the cells of an array for slots that begin at these bins."""
        sea, lasting = hearer.sea, float(np.diff(some.time[first]).max())
        far = sea.tow.speed * lasting
        x, y, side = _cells(sea, some.time[-1] - some.time[0])
        lon, lat = sphere.destination(*sea.middle, x, y)
        within = side / math.sqrt(2) + far / 2  # from its position in the middle of a slot
        excess = heard.excess_near(hearer, lon, lat, within + PART / 2)
        own = (
            hearer.swarm,
            hearer.tables,
            (sphere.to_binary(np.degrees(lon)), sphere.to_binary(np.degrees(lat))),
        )
        hazard = stations.best(*own, excess, first, PART)
        apart = np.hypot(x[:, None] - x, y[:, None] - y)

        begins = shapely.distance(sea.begins.shape, shapely.points(x, y)) <= within
        return cls(hazard, np.asarray(begins), apart <= (far + side * math.sqrt(2)) * STRETCH, side)

    def best(self, slope: Array) -> Array:
        """Return the route (cell of each slot) with the highest sum of slope times hazard."""
        slots, cells = self.hazard.shape[:2]
        gain = self.hazard.reshape(slots, cells, -1) @ slope.reshape(-1).astype(np.float32)
        value = np.where(self.first, gain[0].astype(np.float64), -math.inf)
        came = np.zeros((slots, cells), int)
        for slot in range(1, slots):
            reached = np.where(self.near, value[:, None], -math.inf)
            came[slot] = np.argmax(reached, axis=0)
            value = reached.max(axis=0) + gain[slot]
        route = [int(np.argmax(value))]
        for slot in range(slots - 1, 0, -1):
            route.append(int(came[slot, route[-1]]))
        return np.array(route[::-1])

    def hazard_of(self, route: Array) -> Array:
        """Return the sum of hazards along a route, shape (m, factors)."""
        return np.asarray(self.hazard[np.arange(len(route)), route].sum(axis=0, dtype=np.float64))


STRETCH = 1.02  # factor by which distances may be too short in the plane, up to 1,000 nmi


def _cells(sea: Sea, lasting: float) -> tuple[Array, Array, float]:
    """Return centres (x, y) [m] and side [m] of squares that cover the ship's reach."""

    reach = sea.begins.shape.buffer(sea.tow.speed * lasting * STRETCH)
    if sea.allowed is not None:
        lon, lat = sphere.destination(
            sea.allowed.lon, sea.allowed.lat, *np.array(sea.allowed.shape.exterior.coords).T
        )
        allowed = shapely.Polygon(np.column_stack(sphere.offset(*sea.middle, lon, lat)))
        reach = shapely.intersection(reach, allowed.buffer(2000.0))
    west, south, east, north = reach.bounds
    side = math.sqrt(reach.area / CELLS)
    for _ in range(40):
        nx, ny = max(math.ceil((east - west) / side), 1), max(math.ceil((north - south) / side), 1)
        x, y = np.meshgrid(
            west + (np.arange(nx) + 0.5) * side, south + (np.arange(ny) + 0.5) * side
        )
        squares = shapely.box(
            x.ravel() - side / 2, y.ravel() - side / 2, x.ravel() + side / 2, y.ravel() + side / 2
        )
        in_reach = shapely.intersects(reach, squares)
        if in_reach.sum() <= CELLS:
            break
        side *= 1.05
    return x.ravel()[in_reach], y.ravel()[in_reach], side
