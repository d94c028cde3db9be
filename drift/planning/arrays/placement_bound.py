"""An upper bound of what arrays can hear, wherever they are towed.

Time is cut into slots and the sea into cells. What an array misses in a slot is at least what it
would miss with the highest signal excess that it can have anywhere in a cell, on any heading, at
every moment. And what it misses in all slots is at least the product over slots: given the
fluctuation at the border of two slots, what happens before and after is independent, and both are
the likelier to be silent the quieter that value is (Chebyshev's inequality of monotone functions).
So -log of a miss is at most the sum of hazards h of the cells through which an array goes.

Ways from cell to cell at the ship's speed are then mixed: the sum over particles of w (1 - exp(-sum
y h)) is concave in the shares y, so that Frank and Wolfe's method (1956) bounds its maximum from
above at every step. What is relaxed, therefore: the array takes the best of its cell and of all
headings, turns at will, draws its fluctuation again at each slot, and may be shared out among ways.
Bound and plan are compared on the same particles.
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
SLOTS = (2, 4)  # numbers of slots that are tried; the lowest bound counts
STEPS = 60  # of Frank and Wolfe
PART = 4000.0  # [m] parts of a relative way
SMALL = 0.002  # gap at which it ends


@dataclass(frozen=True)
class Bound:
    """What no placement of these ships hears more than of some particles, and what a plan hears of
    the same.
    """

    value: float
    plan: float
    particles: int
    cell: float  # [m] side of a cell
    slots: int


def bound(seas: Sequence[Sea], tracks: Tracks, plan: Placement) -> Bound:
    """Return an upper bound for ships among particles, whose weights have the sum 1."""
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
    """Return the bound with so many slots, the side of its cells [m], and the number of slots."""
    first = np.unique(np.rint(np.linspace(0, some.bins, many + 1)).astype(int))
    arrays = [_Array.of(hearer, some, first) for hearer in hearers]
    # Each value of an unknown is a particle of its own, averaged for each array by itself: arrays
    # that share one miss together the oftener (Chebyshev's inequality), so that this bounds no
    # less.
    total, weight = [np.zeros((some.m, hearer.chances.size)) for hearer in hearers], some.weight
    best = math.inf
    for step in range(STEPS):
        missed = [np.exp(-h) @ hearer.chances for h, hearer in zip(total, hearers, strict=True)]
        whole = np.prod(missed, axis=0)
        value = float((1 - whole) @ weight)
        ways_to, gain = [], 0.0
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
            ways_to.append(to)
        best = min(best, value + gain)
        if gain < SMALL or step == STEPS - 1:
            break
        share = _line(total, ways_to, hearers, weight)
        total = [(1 - share) * h + share * to for h, to in zip(total, ways_to, strict=True)]
    return min(best, 1.0), max(array.side for array in arrays), len(first) - 1


def _line(
    total: Sequence[Array], to: Sequence[Array], hearers: Sequence[Hearer], weight: Array
) -> float:
    """Return how far to go from one mixture towards another, by golden section."""
    low, high, golden = 0.0, 1.0, (math.sqrt(5) - 1) / 2

    def heard_at(share: float) -> float:
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
    """The cells of one array, their hazards, and from which to which it can go."""

    hazard: Array  # float32 (slots, cells, m, factors)
    first: Array  # bool (cells,): where it may be in the first slot
    near: Array  # bool (cells, cells)
    side: float  # [m]

    @classmethod
    def of(cls, hearer: Hearer, some: Tracks, first: Array) -> "_Array":
        """Return them for slots that begin at these bins."""
        sea, lasting = hearer.sea, float(np.diff(some.time[first]).max())
        far = sea.tow.speed * lasting
        x, y, side = _cells(sea, some.time[-1] - some.time[0])
        lon, lat = sphere.destination(*sea.middle, x, y)
        within = side / math.sqrt(2) + far / 2  # from where it is in the middle of a slot
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
        """Return the cell of each slot of the way with the highest sum of slope times hazard."""
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
        """Return the sum of the hazards of a way's cells (m, factors)."""
        return np.asarray(self.hazard[np.arange(len(route)), route].sum(axis=0, dtype=np.float64))


STRETCH = 1.02  # by which distances in the plane may be too short, within 1,000 nmi of its middle


def _cells(sea: Sea, lasting: float) -> tuple[Array, Array, float]:
    """Return the middles (x, y) [m] of squares that hold all places where a ship can be, and their
    side [m].
    """

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
        held = shapely.intersects(reach, squares)
        if held.sum() <= CELLS:
            break
        side *= 1.05
    return x.ravel()[held], y.ravel()[held], side
