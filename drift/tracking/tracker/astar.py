"""Cheapest path through cells in time: A* (Hart, Nilsson and Raphael 1968).

A node is a cell at a step. From one step to the next a path moves to any open cell within `stride`
cells, or stays; it may not cross closed ones. The heuristic is the cost to go if moves may cross
closed cells. It never exceeds the true cost (admissible) and is consistent, so the first path to a
node is its cheapest. Without closed cells A* expands only the nodes of one cheapest path.
"""

import heapq
from collections.abc import Mapping, Sequence

import numpy as np
from scipy import ndimage

from geo.array import Array

Cell = tuple[int, int]  # row, column


def moves(stride: int) -> Array:
    """Return the moves of a step (m, 2), rows and columns, no longer than `stride` cells."""
    side = np.arange(-stride, stride + 1)
    rows, columns = np.meshgrid(side, side, indexing="ij")
    near = rows**2 + columns**2 <= stride**2
    return np.stack([rows[near], columns[near]], axis=1)


def to_go(cost: Array, stride: int, goal: Cell | None) -> Array:
    """Return the least cost to go from each cell after each step, ignoring closed cells.

    Args:
        cost: of being in a cell at steps 1 to K, at least 0, shape (K, rows, columns).
        stride: longest move [cells].
        goal: where the path ends at any step; None: it ends after step K.

    Returns:
        Shape (K + 1, rows, columns); inf: no path.
    """
    around = np.zeros((2 * stride + 1,) * 2, bool)
    around[tuple((moves(stride) + stride).T)] = True
    found = np.full((len(cost) + 1, *cost.shape[1:]), np.inf if goal is not None else 0.0)
    for step in range(len(cost), 0, -1):
        if goal is not None:
            found[step][goal] = 0.0
        onward = cost[step - 1] + found[step]
        found[step - 1] = ndimage.minimum_filter(
            onward, footprint=around, mode="constant", cval=np.inf
        )
    if goal is not None:
        found[0][goal] = 0.0
    return found


def cheapest(
    cost: Array,
    stride: int,
    start: Cell,
    goal: Cell | None,
    closed: Array,
    gates: Mapping[Cell, Array] | None = None,
) -> list[Cell]:
    """Return the cells of the cheapest path after each step, from the start on.

    Args:
        cost: as in `to_go`.
        stride: longest move [cells].
        start: first cell.
        goal: as in `to_go`.
        closed: cells that cannot be entered or crossed, bool (rows, columns).
        gates: cells that allow only some moves, closed or not: which of `moves` may leave them,
            (m,). The same moves reversed may enter them.

    Raises:
        ValueError: there is no path.
    """
    gates = {} if gates is None else gates
    shut = closed.copy()
    for cell in gates:
        shut[cell] = False
    guide = to_go(np.where(shut, np.inf, cost), stride, goal)
    steps = moves(stride)
    crossed = [_between(move) for move in steps]
    shape = np.array(closed.shape)
    paid: dict[tuple[int, Cell], float] = {(0, start): 0.0}
    before: dict[tuple[int, Cell], Cell] = {}
    waiting = [(guide[0][start], 0, start)]
    taken: set[tuple[int, Cell]] = set()
    while waiting:
        expected, step, cell = heapq.heappop(waiting)
        if (step, cell) in taken:
            continue
        if not np.isfinite(expected):
            break
        taken.add((step, cell))
        if cell == goal or (goal is None and step == len(cost)):
            return _way(before, step, cell)
        if step == len(cost):
            continue
        to = steps + cell
        inside = ((to >= 0) & (to < shape)).all(axis=1)
        for k in np.flatnonzero(inside):
            there = (int(to[k, 0]), int(to[k, 1]))
            left = guide[step + 1][there]
            if shut[there] or not np.isfinite(left) or _blocked(closed, cell, crossed[k]):
                continue
            if (cell in gates and not gates[cell][k]) or (
                there in gates and not gates[there][-1 - k]
            ):
                continue
            total = paid[step, cell] + cost[step][there]
            if total < paid.get((step + 1, there), np.inf):
                paid[step + 1, there] = total
                before[step + 1, there] = cell
                heapq.heappush(waiting, (total + left, step + 1, there))
    raise ValueError("there is no path: closed cells lie between, or it is too far for the time")


def _between(move: Array) -> Array:
    """Return the cells that a straight move touches between its ends (n, 2), from its begin.

    At a corner that is all cells that meet there.
    """
    rows, columns = (max(abs(int(part)), 1) for part in move)
    parts = 2 * rows * columns  # so that every edge crossing is one of the points
    along = np.arange(1, parts)[:, None] / parts * move
    sides = (np.floor(along + 0.5), np.ceil(along - 0.5))
    touched = np.concatenate(
        [np.stack([a[:, 0], b[:, 1]], axis=1) for a in sides for b in sides]
    ).astype(int)
    ends = (touched == 0).all(axis=1) | (touched == move).all(axis=1)
    return np.unique(touched[~ends], axis=0)


def _blocked(closed: Array, cell: Cell, between: Array) -> bool:
    """Return True if a move from a cell crosses a closed one."""
    return bool(closed[tuple((between + cell).T)].any())


def _way(before: dict[tuple[int, Cell], Cell], step: int, cell: Cell) -> list[Cell]:
    """Return the cells from the start to a cell."""
    way: list[Cell] = [cell]
    for k in range(step, 0, -1):
        way.append(before[k, way[-1]])
    return way[::-1]


def value(cost: Array, way: Sequence[Cell]) -> float:
    """Return the cost of a path."""
    return float(sum(cost[k][cell] for k, cell in enumerate(way[1:])))
