"""The cheapest path through a cloud: A* against SciPy's Dijkstra, and the moves that it chooses
from.
"""

import itertools

import numpy as np
import pytest
import shapely
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from drift.tracking.tracker import astar, pursuit
from geo.array import Array


def crosses(closed: Array, a: tuple[int, int], b: tuple[int, int]) -> bool:
    """Return whether the line between the middles of two cells touches a closed cell."""
    i, j = np.nonzero(closed)
    line = shapely.LineString([a, b]) if a != b else shapely.Point(a)
    return bool(shapely.intersects(shapely.box(i - 0.5, j - 0.5, i + 0.5, j + 0.5), line).any())


Cell = tuple[int, int]


def free(closed: Array, gates: dict[Cell, Array], a: Cell, b: Cell) -> bool:
    """Return whether one may move from a cell to another: by its gates, and what is between."""
    ways, open_ = [tuple(move) for move in astar.moves(2)], closed.copy()
    for here, there in ((a, b), (b, a)):
        if here in gates:
            open_[here] = not gates[here][ways.index(tuple(np.subtract(there, here)))]
    return not open_[a] and not crosses(open_, a, b)


def oracle(
    cost: Array, start: Cell, goal: Cell | None, closed: Array, gates: dict[Cell, Array]
) -> Array:
    """Return the least costs to go from every node, by Dijkstra over all nodes of the graph turned
    round, (K + 1, rows, columns).
    """
    steps, rows, columns = cost.shape
    number = np.arange((steps + 1) * rows * columns).reshape(steps + 1, rows, columns)
    cells = list(np.ndindex(rows, columns))
    near = [
        (a, b)
        for a, b in itertools.product(cells, cells)
        if (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 <= 4
    ]
    moves = [(a, b) for a, b in near if free(closed, gates, a, b)]  # the same in each step
    heads, tails, costs = [], [], []
    for k in range(steps):
        for a, b in moves:
            (
                heads.append(number[k][a]),
                tails.append(number[k + 1][b]),
                costs.append(cost[k][b] + 1e-15),
            )
    last = number.size
    ends = number[-1].ravel() if goal is None else number[:, goal[0], goal[1]]
    heads, tails, costs = (
        [*heads, *ends],
        [*tails, *[last] * len(ends)],
        [*costs, *[1e-15] * len(ends)],
    )
    graph = coo_matrix((costs, (tails, heads)), shape=(last + 1, last + 1)).tocsr()
    return dijkstra(graph, indices=last)[:-1].reshape(steps + 1, rows, columns)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("to", [None, (6, 5)])
def test_the_way_is_the_cheapest_and_its_guide_never_too_dear(seed: int, to: Cell | None) -> None:
    """Of every other seed begin and destination are closed, but for some moves."""
    rng = np.random.default_rng(seed)
    cost = rng.exponential(1.0, (5, 8, 7)) ** 2
    closed = rng.random((8, 7)) < (0.25, 0.4)[seed % 2]
    start, gates, ends = (1, 2), {}, [(1, 2)] if to is None else [(1, 2), to]
    for cell in ends:
        closed[cell] = seed % 4 > 1
        if seed % 4 > 0:
            gates[cell] = rng.random(len(astar.moves(2))) < 0.6
    exact = oracle(cost, start, to, closed, gates)
    shut = closed.copy()
    shut[tuple(np.transpose(ends))] = False
    guide = astar.to_go(np.where(shut, np.inf, cost), 2, to)
    open_ = np.broadcast_to(~shut, guide.shape)
    assert (guide[open_] <= exact[open_] + 1e-9).all()
    if not np.isfinite(exact[0][start]):
        with pytest.raises(ValueError, match="there is no path"):
            astar.cheapest(cost, 2, start, to, closed, gates)
        return
    way = astar.cheapest(cost, 2, start, to, closed, gates)
    assert way[0] == start
    assert to is None or way[-1] == to
    assert all(free(closed, gates, a, b) for a, b in itertools.pairwise(way))
    assert all((np.subtract(a, b) ** 2).sum() <= 4 for a, b in itertools.pairwise(way))
    assert astar.value(cost, way) == pytest.approx(exact[0][start], abs=1e-9)


def test_moves_make_most_of_the_speed_in_every_direction() -> None:
    """What several moves come to lies within the hull of one, whose nearest edge goes through (3,
    2) and (2, 3): 5 / sqrt(2) of 4 cells.
    """
    hull = shapely.MultiPoint(astar.moves(pursuit.STRIDE)).convex_hull
    assert hull.exterior.distance(shapely.Point(0, 0)) / pursuit.STRIDE == pytest.approx(
        5 / np.sqrt(2) / 4
    )
    assert np.hypot(*astar.moves(pursuit.STRIDE).T).max() == pursuit.STRIDE
