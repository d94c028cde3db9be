"""Sums over the particles of a run that have the same bits for any number of shards.

A block is a run of consecutive slots of one scenario. Each block is summed separately, and the sums
of blocks are added in the order of their slots. A shard holds whole blocks and computes a
`Partial`. The merged partials of all shards therefore do not depend on the number of shards.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geo.array import Array

BLOCK = 4096  # slots
PART = 2**17  # slots processed at a time to limit memory
WORLDS = 32  # in a spill a block holds all particles of a class in this many whole worlds


@dataclass(frozen=True)
class Blocks:
    """How n particles are divided into k blocks."""

    n: int
    scenarios: int  # of the run
    first: Array  # (k,) first slot of each block
    scenario: Array  # (k,) to which it belongs
    number: Array  # (k,) number of its first slot in the whole run, ascending

    @cached_property
    def spans(self) -> list[slice]:
        """The slots of each block, (k,)."""
        return [slice(a, b) for a, b in itertools.pairwise([*self.first.tolist(), self.n])]

    @property
    def places(self) -> Array:
        """The number of every particle in the whole run, int64 (n,)."""
        return np.asarray(
            np.arange(self.n)
            + np.repeat(self.number - self.first, np.diff(self.first, append=self.n))
        )

    def some(self, begin: int, end: int) -> Blocks:
        """Return blocks `begin` to `end` - 1 with slots counted from the first of them."""
        edges = np.append(self.first, self.n)
        own = slice(begin, end)
        return Blocks(
            int(edges[end] - edges[begin]),
            self.scenarios,
            self.first[own] - edges[begin],
            self.scenario[own],
            self.number[own],
        )

    def cuts(self, most: int) -> Iterator[tuple[Blocks, tuple[int, int]]]:
        """Yield consecutive ranges of blocks of at most about `most` slots, and the slots [first,
        last) of each.
        """
        edges = np.append(self.first, self.n).tolist()
        for begin, end in self.spans_of(most):
            yield self.some(begin, end), (edges[begin], edges[end])

    def spans_of(self, most: int) -> list[tuple[int, int]]:
        """Return the ranges of `cuts` as block numbers [first, last)."""
        cuts = np.searchsorted(self.first, np.arange(0, self.n, most))
        return list(itertools.pairwise(np.unique([*cuts, len(self.first)]).tolist()))

    def partial(
        self, *values: Array, code: Array | None = None, many: int = 1, slots: Array | None = None
    ) -> Partial:
        """Return the sums of values by block and, within each block, by code.

        Args:
            values: finite values, (n,) each.
            code: codes from 0 to many - 1, (n,); None: one code.
            many: the number of codes.
            slots: the slots of the values and codes, ascending; None: all slots. Blocks without
                particles have sum 0.
        """
        k = self.first.size
        parts: list[Array]
        if slots is not None:
            block = np.repeat(np.arange(k), np.diff(self.first, append=self.n))[slots]
            cell = block if code is None else block * many + code
            parts = [np.bincount(cell, v, k * many).reshape(k, many) for v in values]
        elif code is None:
            parts = [
                np.add.reduceat(np.asarray(v, np.float64), self.first)[:, None] for v in values if k
            ]
        else:  # block by block: a block stays in the processor's cache
            parts = [
                np.array([np.bincount(code[own], v[own], many) for own in self.spans])
                for v in values
                if k
            ]
        if not k:
            parts = [np.empty((0, many))] * len(values)
        return Partial(self.scenarios, self.scenario, self.number, np.stack(parts, axis=-1))

    def total(self, values: Array, slots: Array | None = None) -> float:
        """Return the sum of values (n,) over all particles, or over some of them."""
        return float(self.partial(values, slots=slots).total[0, 0])

    def table(self, code: Array, many: int, *values: Array) -> Array:
        """Return the sums of values (n,) over all particles by code (n,), 0 to many - 1.

        The shape is (many,) for one column of values, and (values, many) for several.
        """
        sums = self.partial(*values, code=code, many=many).total.T
        return np.asarray(sums if len(values) > 1 else sums[0])

    def sum_by_group(self, group: Array, values: Array) -> Array:
        """Return the sums of values (n,) over all particles by group (n,), a non-negative integer.

        It is fast where groups occupy long runs of slots.
        """
        return np.bincount(*self.runs(group, values))

    def runs(self, group: Array, values: Array) -> tuple[Array, Array]:
        """Return the group and the sum of values of each run of equal groups within a block, (r,)
        each.
        """
        if not self.n:
            return np.empty(0, np.int64), np.empty(0)
        heads = np.ones(self.n, bool)
        heads[1:] = group[1:] != group[:-1]
        heads[self.first] = True
        begin = np.flatnonzero(heads)
        return group[begin], np.add.reduceat(np.asarray(values, np.float64), begin)

    def running(self, values: Array, whole: Partial | None = None) -> Array:
        """Return the cumulative sum of non-negative values (n,), including each particle; it never
        decreases.

        whole: the sums of all blocks of the run, where these blocks are only a part.
        """
        whole = whole or self.partial(values)
        begun = np.concatenate([[0.0], np.cumsum(whole.sums[:, 0, 0])])
        running = np.empty(self.n)
        for own, block in zip(self.spans, np.searchsorted(whole.number, self.number), strict=True):
            np.cumsum(values[own], out=running[own], dtype=np.float64)
            running[own] = np.minimum(running[own] + begun[block], begun[block + 1])
        return running


def cut_blocks(bounds: Sequence[int], numbers: Sequence[int], size: Sequence[int]) -> Blocks:
    """Return the blocks of an ensemble.

    Args:
        bounds: the first slot of each scenario and, last, n.
        numbers: the number in the whole run of each scenario's first slot, which begins a block.
        size: slots per block, by scenario.
    """
    firsts = [np.arange(a, b, m) for a, b, m in zip(bounds[:-1], bounds[1:], size, strict=True)]
    scenario = np.repeat(np.arange(len(firsts)), [len(own) for own in firsts])
    shift = np.asarray(numbers, np.int64) - np.asarray(bounds[:-1], np.int64)
    first = np.concatenate([*firsts, np.empty(0, np.int64)])
    return Blocks(bounds[-1], len(firsts), first, scenario, first + shift[scenario])


def sum_over_worlds(values: Array) -> Array:
    """Return the sum over worlds of per-world values (W, ...), summed in blocks of WORLDS
    worlds.
    """
    blocks = np.add.reduceat(values, np.arange(0, len(values), WORLDS), axis=0, dtype=np.float64)
    return np.asarray(np.add.accumulate(blocks, axis=0)[-1])


def whole(n: int) -> Blocks:
    """Return the blocks of n particles that belong to one scenario."""
    return cut_blocks((0, n), (0,), (BLOCK,))


def of_scenarios(scenario: Array) -> Blocks:
    """Return the blocks of particles from the scenario of each, int (n,) ascending."""
    bounds = np.searchsorted(scenario, np.arange(scenario.max(initial=0) + 2)).tolist()
    return cut_blocks(bounds, bounds[:-1], [BLOCK] * (len(bounds) - 1))


@dataclass(frozen=True)
class Partial:
    """Sums over some of a run's blocks, such as those of one shard."""

    scenarios: int
    scenario: Array  # (k,) of each block
    number: Array  # (k,) first slot in the whole run, ascending
    sums: Array  # (k, codes, values)

    @property
    def by_scenario(self) -> Array:
        """The sums of each scenario, (scenarios, codes, values)."""
        sums = np.zeros((self.scenarios, *self.sums.shape[1:]))
        # blocks of one scenario are contiguous
        begun = np.flatnonzero(np.diff(self.scenario, prepend=-1))
        if begun.size:
            sums[self.scenario[begun]] = np.add.reduceat(
                self.sums, begun, axis=0
            )  # sequential, in the order of the blocks
        return sums

    @property
    def total(self) -> Array:
        """The sums over all scenarios, (codes, values), added in the order of the scenarios."""
        return np.asarray(np.add.accumulate(self.by_scenario, axis=0)[-1])


def merge_partials(parts: Sequence[Partial]) -> Partial:
    """Return the sums of all parts (at least one); no block may occur in two of them."""
    if len(parts) == 1:
        return parts[0]
    number, scenario, sums = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("number", "scenario", "sums")
    )
    order = np.argsort(number, kind="stable")
    return replace(parts[0], scenario=scenario[order], number=number[order], sums=sums[order])
