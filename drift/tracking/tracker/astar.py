"""The cheapest way through cells in time: A* (Hart, Nilsson and Raphael 1968), guided by the same
way as if nothing were closed.

A node is a cell at a step. From one step to the next it goes to any open cell within `stride`
cells, or stays, and not across closed ones. The guide is the cost to go where moves may cross what
is closed: no more than it is (admissible), and consistent, so that the first time a node is taken
its way is the cheapest. Where nothing is in the way A* takes the nodes of one cheapest way and no
others.
"""

import heapq
from collections.abc import Mapping, Sequence

import numpy as np
from scipy import ndimage

from geo.array import Array

Cell = tuple[int, int]  # row, column


def moves(stride: int) -> Array:
    """Return the moves of a step (m, 2), rows and columns: all that are no longer than `stride`
    cells.
    """
    side = np.arange(-stride, stride + 1)
    rows, columns = np.meshgrid(side, side, indexing="ij")
    near = rows**2 + columns**2 <= stride**2
    return np.stack([rows[near], columns[near]], axis=1)


def to_go(cost: Array, stride: int, goal: Cell | None) -> Array:
    """Return the least cost to go from each cell after each step, if nothing were closed; inf:
    there is no way.

    cost: of being in a cell at steps 1 to K (K, rows, columns), 0 or more; goal: where it ends at
    any step; without one it ends after step K. Shape (K + 1, rows, columns).
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
    """Return the cells of the cheapest way after each step, from the start on.

    cost, goal: as of `to_go`; closed: cells (rows, columns) that cannot be entered or crossed.
    gates: cells that are left by some moves alone, and entered by the same ones turned round, be
    they closed or not: which of `moves` (m,). Raises ValueError where there is no way.
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
    raise ValueError("there is no way: what is closed lies between, or it is too far for the time")


def _between(move: Array) -> Array:
    """Return the cells that a straight move touches between its ends (n, 2), relative to its begin:
    at a corner all that meet.
    """
    rows, columns = (max(abs(int(part)), 1) for part in move)
    parts = 2 * rows * columns  # so that every crossing of an edge is a point
    along = np.arange(1, parts)[:, None] / parts * move
    sides = (np.floor(along + 0.5), np.ceil(along - 0.5))
    touched = np.concatenate(
        [np.stack([a[:, 0], b[:, 1]], axis=1) for a in sides for b in sides]
    ).astype(int)
    ends = (touched == 0).all(axis=1) | (touched == move).all(axis=1)
    return np.unique(touched[~ends], axis=0)


def _blocked(closed: Array, cell: Cell, between: Array) -> bool:
    return bool(closed[tuple((between + cell).T)].any())


def _way(before: dict[tuple[int, Cell], Cell], step: int, cell: Cell) -> list[Cell]:
    way: list[Cell] = [cell]
    for k in range(step, 0, -1):
        way.append(before[k, way[-1]])
    return way[::-1]


def value(cost: Array, way: Sequence[Cell]) -> float:
    """Return what a way costs."""
    return float(sum(cost[k][cell] for k, cell in enumerate(way[1:])))
