"""A path that meets a cloud or avoids it, replanned as the cloud moves and shrinks.

At the end of each step the vessel looks: particles within its reach are met, and if it sees nothing
they are ruled out. Paths are found by A* on the cloud binned by cells
(drift.tracking.tracker.astar). The cost adds what a path meets step by step, so particles that stay
in reach count repeatedly. The path is therefore replanned with the remaining particles when the
likelihood of having seen nothing since the last plan falls below a threshold (Klaas, Southey and
Cheeseman 2005, Particle-based communication among game agents).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from scipy.spatial import cKDTree

from drift.tracking.tracker import astar, path
from drift.tracking.tracker.path import Path
from geo import notation, sphere
from geo.array import Array
from geo.notation import KNOT, NMI

# cells that the vessel covers in a step: over several steps any course is possible at >= 88 % speed
STRIDE = 4
MOST = 5_000_000  # most cells times steps

# a tracker's path -> positions at each step (K + 1, n, 3), weights (n,)
Forecast = Callable[[Path], tuple[Array, Array]]


class Barrier(Protocol):
    """Where a vessel cannot be."""

    def in_squares(self, lon: Array, lat: Array, half: float) -> Array:
        """Return whether squares touch the barrier, in their shape.

        Args:
            lon: of their centres [deg].
            lat: of their centres [deg].
            half: half their side [m].
        """

    def on_legs(self, begin: Array, ends: Array) -> Array:
        """Return whether great circles from a vector (3,) to others (m, 3) touch it, (m,)."""


@dataclass(frozen=True)
class Pursuit:
    """A requested pursuit."""

    aim: Literal["meet", "avoid"]
    start: tuple[float, float]  # (lon, lat) [rad]
    speed: float  # [m/s]
    reach: float  # [m] within which a particle is met
    begin: float  # [s]
    interval: float  # [s] of a step
    steps: int
    to: tuple[float, float] | None = None  # destination of a path that avoids [rad]
    # [s] of detour that is acceptable to avoid one meeting, by -log(1 - share met)
    worth: float = 3600.0
    threshold: float = 0.8  # likelihood of having seen nothing below which the path is replanned

    @property
    def times(self) -> Array:
        """Times of the looks [s], from the begin on, shape (steps + 1,)."""
        return self.begin + self.interval * np.arange(self.steps + 1)


@dataclass(frozen=True)
class Pursued:
    """A path and its result."""

    path: Path
    met: Array  # share of the cloud met by each of its looks, each particle counted once
    plans: tuple[int, ...]  # steps at which the path was planned
    # share of the cloud that the vessel could have within its reach at some look, without land
    near: float


class Trigger:
    """Klaas' trigger: likelihood of the observations since the last plan, and its threshold."""

    def __init__(self, threshold: float) -> None:
        """Start without observations."""
        self.threshold, self.likelihood = threshold, 1.0

    def observed(self, weight: float) -> bool:
        """Return True if it is time to replan, and reset the likelihood then.

        weight: sum of weights that an observation left, of 1 before.
        """
        self.likelihood *= weight
        if self.likelihood >= self.threshold:
            return False
        self.likelihood = 1.0
        return True


@dataclass(frozen=True)
class Grid:
    """Cells about the start: row and column 0 are the south-west corner."""

    lon: float  # [rad] of the middle
    lat: float
    size: float  # [m] of a cell
    half: int  # cells on either side of the middle

    @property
    def place(self) -> Array:
        """Unit vectors of the cells' centres, shape (side, side, 3)."""
        at = self.size * np.arange(-self.half, self.half + 1)
        east, north = np.meshgrid(at, at)
        return path.vector(*sphere.destination(self.lon, self.lat, east, north))

    def cell(self, lon: float, lat: float) -> astar.Cell | None:
        """Return the cell of a position [rad]; None if it is outside."""
        east, north = sphere.offset(self.lon, self.lat, lon, lat)
        row, column = (int(np.rint(float(v) / self.size)) + self.half for v in (north, east))
        inside = 0 <= row <= 2 * self.half and 0 <= column <= 2 * self.half
        return (row, column) if inside else None


def grid(asked: Pursuit) -> Grid:
    """Return the cells that the vessel can reach."""
    return Grid(*asked.start, asked.speed * asked.interval / STRIDE, STRIDE * asked.steps)


def mass(cells: Array, place: Array, weight: Array, reach: float) -> Array:
    """Return the weight of the particles within reach of each cell, shape (rows, columns).

    Args:
        cells: unit vectors, shape (rows, columns, 3).
        place: unit vectors of the particles, shape (n, 3).
        weight: of the particles, shape (n,).
        reach: [m].
    """
    chord = 2 * np.sin(reach / sphere.RADIUS / 2)
    near = cKDTree(cells.reshape(-1, 3)).sparse_distance_matrix(
        cKDTree(place), chord, output_type="coo_matrix"
    )
    total = np.bincount(
        near.row, weights=weight[near.col], minlength=cells.shape[0] * cells.shape[1]
    )
    return np.asarray(total).reshape(cells.shape[:2])


@dataclass(frozen=True)
class Chart:
    """Cells over which a vessel moves, and the moves allowed."""

    # unit vectors of its position in each cell (rows, columns, 3): the centre, or the destination
    place: Array
    closed: Array  # cells (rows, columns) that it does not cross
    # moves that leave and enter the cells of begin and destination
    gates: dict[astar.Cell, Array]
    here: astar.Cell
    goal: astar.Cell | None


def _charted(asked: Pursuit, barrier: Barrier | None) -> Chart:
    """Return the cells of a pursuit; those that touch the barrier are closed.

    Harbours are near land. From the cells of begin and destination, moves are allowed that do not
    touch the barrier and do not exceed the speed, even if these cells are closed.

    Args:
        asked: the pursuit.
        barrier: where the vessel cannot be; None: nowhere.
    """
    cells = grid(asked)
    place, here, size = cells.place, (cells.half, cells.half), cells.size / 2
    goal = None if asked.to is None else cells.cell(*asked.to)
    if asked.to is not None and goal != here:
        place[goal] = path.vector(*asked.to)
    closed = (
        np.zeros(place.shape[:2], bool)
        if barrier is None
        else barrier.in_squares(*path.degrees(place), size)
    )
    gates, moves = {}, astar.moves(STRIDE)
    for cell in (here,) if goal is None else (here, goal):
        to = moves + cell
        inside = ((to >= 0) & (to < place.shape[0])).all(axis=1)
        ends = place[tuple(to[inside].T)]
        free = path.arc(ends, place[cell]) * sphere.RADIUS <= asked.speed * asked.interval * (
            1 + 1e-4
        )
        if barrier is not None and closed[cell]:
            free &= ~barrier.on_legs(place[cell], ends)
        gates[cell] = np.zeros(len(moves), bool)
        gates[cell][inside] = free
        if gates[cell].sum() <= 1:  # it can only stay
            raise ValueError(_no_way(asked))
    if barrier is not None and asked.to is not None and goal == here:
        ends = path.vector(*asked.to)[None]
        if barrier.on_legs(place[here], ends)[0]:
            raise ValueError(_no_way(asked))
    return Chart(place, closed, gates, here, goal)


def _no_way(asked: Pursuit) -> str:
    """Return the message that there is no path."""
    return (
        f"there is no path on cells of {grid(asked).size / NMI:.2g} nmi, a quarter of a step (a shorter one has finer cells): "
        "land lies between, or it is too far for the time"
    )


def pursue(asked: Pursuit, forecast: Forecast, barrier: Barrier | None = None) -> Pursued:
    """Return a path and the share of the cloud that it meets.

    Args:
        asked: the pursuit.
        forecast: returns the positions of the same particles, in the same order, at `asked.times`
            if the tracker follows a path. It is called with each plan, because particles may seek
            or flee.
        barrier: where the vessel cannot be; None: nowhere.

    Raises:
        ValueError: one line: the request is invalid (`check`), no particle is left, or there is no
            path to the destination.
    """
    check(asked)
    chart = _charted(asked, barrier)
    here, goal = chart.here, chart.goal
    places, weight = forecast(path.standing(*asked.start, asked.begin, asked.times[-1]))
    if not weight.sum() > 0:
        raise ValueError("no track is held when it begins")
    initial = weight / weight.sum()
    left, trigger = initial, Trigger(asked.threshold)
    plan, plans = [here], []
    met: list[float] = []
    for step in range(asked.steps + 1):
        seen = path.arc(places[step], chart.place[plan[step]]) * sphere.RADIUS <= asked.reach
        met.append((met[-1] if met else 0.0) + left[seen].sum())
        before, left = left.sum(), np.where(seen, 0.0, left)
        some = left.sum() > 0 and step < asked.steps
        if some and (step == 0 or (plan[step] != goal and trigger.observed(left.sum() / before))):
            plan = [*plan[: step + 1], *_plan(asked, chart, places, left, plan[step], step)]
            plans.append(step)
            places, _ = forecast(_path(asked, chart, plan))
        if step == len(plan) - 1 or (left.sum() == 0 and goal is None):
            break
    radius = asked.speed * (asked.times - asked.begin) + asked.reach
    near = (path.arc(places, path.vector(*asked.start)) * sphere.RADIUS <= radius[:, None]).any(
        axis=0
    )
    return Pursued(
        _path(asked, chart, plan[: len(met)]),
        np.array(met),
        tuple(plans),
        float(initial[near].sum()),
    )


def _plan(
    asked: Pursuit, chart: Chart, places: Array, left: Array, here: astar.Cell, step: int
) -> list[astar.Cell]:
    """Return the cells of the best path after a step."""
    weight = left / left.sum()
    share = np.stack(
        [
            mass(chart.place, places[k], weight, asked.reach)
            for k in range(step + 1, asked.steps + 1)
        ]
    )
    if chart.goal is None:
        cost = share.max(axis=(1, 2), keepdims=True) - share
    else:
        cost = asked.interval - asked.worth * np.log1p(-np.minimum(share, 1 - 1e-12))
    try:
        return astar.cheapest(cost, STRIDE, here, chart.goal, chart.closed, chart.gates)[1:]
    except ValueError:
        raise ValueError(_no_way(asked)) from None


def _path(asked: Pursuit, chart: Chart, way: list[astar.Cell]) -> Path:
    """Return the path through cells; the last part to the destination is at the vessel's speed."""
    place, time = np.array([chart.place[cell] for cell in way]), asked.times[: len(way)]
    if way[-1] == chart.goal:
        if asked.to is not None and len(way) == 1:
            place, time = np.vstack([place, path.vector(*asked.to)]), asked.times[:2]
        away = float(path.arc(place[-2], place[-1])) * sphere.RADIUS
        time = np.append(time[:-1], time[-2] + max(away / asked.speed, 1.0))
    if len(place) == 1:
        return Path(asked.times[:2], np.repeat(place, 2, axis=0))
    return Path(time, place)


def judged(asked: Pursuit, found: Pursued, forecast: Forecast) -> Array:
    """Return the share of another cloud that a path meets by each of its looks.

    The path was not planned on that cloud. NaN if that cloud has lost the track.

    Args:
        asked: the pursuit.
        found: the path.
        forecast: of the other cloud, as in `pursue`.
    """
    places, weight = forecast(found.path)
    looks = found.path.place[: len(found.met)]
    if not weight.sum() > 0:
        return np.full(len(looks), np.nan)
    left = weight / weight.sum()
    met: list[float] = []
    for there, place in zip(places, looks, strict=False):
        seen = path.arc(there, place) * sphere.RADIUS <= asked.reach
        met.append((met[-1] if met else 0.0) + left[seen].sum())
        left = np.where(seen, 0.0, left)
    return np.array(met)


def check(asked: Pursuit) -> None:
    """Raise ValueError, one line, if a pursuit is invalid."""
    for name in ("speed", "reach", "interval", "worth"):
        if not getattr(asked, name) > 0:
            raise ValueError(f"{name} {getattr(asked, name):g} must be above 0")
    if asked.steps < 1:
        raise ValueError("it lasts less than a step")
    if not 0 <= asked.threshold <= 1:
        raise ValueError(f"threshold {asked.threshold:g} must be 0 to 1")
    if (asked.aim == "avoid") != (asked.to is not None):
        raise ValueError(
            "a path that avoids goes to a place: give `to`; one that meets has no destination: leave it out"
        )
    if asked.to is not None:
        away = float(path.arc(path.vector(*asked.start), path.vector(*asked.to))) * sphere.RADIUS
        lasting = asked.interval * asked.steps
        if away > asked.speed * lasting:
            raise ValueError(
                f"the destination is out of reach: {away / NMI:.1f} nmi from where it begins, which is {notation.format_duration(60 * np.ceil(away / asked.speed / 60))} "
                f"at {asked.speed / KNOT:.3g} kn, and its {asked.steps} steps last {notation.format_duration(lasting)}"
            )
    many = (2 * STRIDE * asked.steps + 1) ** 2 * asked.steps
    if many > MOST:
        raise ValueError(
            f"{asked.steps:.6g} steps make {many:.3g} cells and times; at most {MOST:,}: take longer steps, or a shorter time"
        )
