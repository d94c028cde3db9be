"""The winds and currents of a run on the device, kept up to date with the clock.

Each scenario has its own range of tiles. Sources of a quantity are in order of priority. A particle
uses the first source with a value at its position; failing that, the first source with a value
after filling missing cells near the coast. With several sources each therefore has two tiles.
Sources that are added to the others are filled separately, and each must have a value at the
position: a sum with a missing term is missing.
"""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from threading import Event
from typing import Any

from geo import waiting
from geo.forcing.quantity import QUANTITIES
from geo.forcing.reading.stream import Bracket, Key, Slices
from geo.forcing.sources import Source
from kernels.step.sample import Ranges, Tiles


@dataclass(frozen=True)
class Sources:
    """The sources of one scenario by quantity, in order of priority."""

    by_quantity: Mapping[str, tuple[Source, ...]]
    # How deep each is filled [cells], by quantity and name.
    cells: Mapping[tuple[str, str], int] = field(default_factory=dict)
    # Quantity and name of sources that are added to the rest, instead of taking part by priority.
    added: frozenset[tuple[str, str]] = frozenset()

    def of(self, quantity: str) -> tuple[Source, ...]:
        """Return the sources of a quantity."""
        return self.by_quantity.get(quantity, ())

    def terms(self, quantity: str) -> list[tuple[Source, ...]]:
        """Return the terms of a quantity's sum: the sources by priority as one term, then each
        added source.
        """
        sources = self.of(quantity)
        extra: list[tuple[Source, ...]] = [
            (source,) for source in sources if (quantity, source.name) in self.added
        ]
        base = tuple(source for source in sources if (quantity, source.name) not in self.added)
        return [base, *extra] if base else extra


@dataclass(frozen=True)
class Term:
    """One term of a quantity's sum on the device: the names of its sources, and its tiles."""

    names: tuple[str, ...]
    first: int
    last: int


def _leave_if_closed(closed: Event) -> None:
    """Raise `waiting.Left` if the forcing has been closed; the read-ahead thread calls it while it
    waits.

    It is not a method of Forcing, because a reference to it would form a cycle that keeps files
    open.
    """
    if closed.is_set():
        raise waiting.WaitInterrupted


class Forcing:
    """Tiles of all scenarios, by quantity.

    `ranges[s]` holds the first and last tile of each quantity of scenario s. terms: of scenario s
    and a quantity, in the order of their tiles.
    """

    def __init__(self, scenarios: list[Sources], direction: int) -> None:
        self._closed = Event()
        self._pool = ThreadPoolExecutor(
            1, "read-ahead", waiting.set_wait_check, (partial(_leave_if_closed, self._closed),)
        )
        self._slices: list[tuple[Slices, ...]] = []  # of each tile, by member
        self.ranges: list[Ranges] = []
        self.terms: list[dict[str, list[Term]]] = []
        self._direction = direction
        by_sources: dict[Any, list[Term]] = {}  # scenarios that see the same sources share tiles
        shared: dict[Any, tuple[Slices, ...]] = {}
        ends: list[int] = []
        for scenario in scenarios:
            ranges: dict[str, tuple[int, int]] = {}
            self.terms.append({})
            for quantity in QUANTITIES:
                terms = scenario.terms(quantity)
                name = (quantity, *(tuple(id(s) for s in sources) for sources in terms))
                if name not in by_sources:
                    by_sources[name] = []
                    for sources in terms:
                        first = len(self._slices)
                        raw = [(s, 0) for s in sources] if len(sources) > 1 else []
                        for source, cells in raw + [
                            (s, scenario.cells.get((quantity, s.name), 0)) for s in sources
                        ]:
                            key = (id(source), cells)
                            if key not in shared:
                                shared[key] = tuple(
                                    Slices(member, cells, direction, self._pool)
                                    for member in source.members
                                )
                            self._slices.append(shared[key])
                        last = len(self._slices)
                        ends += [last] * (last - first)
                        by_sources[name].append(Term(tuple(s.name for s in sources), first, last))
                tiled = by_sources[name]
                ranges[quantity] = (tiled[0].first, tiled[-1].last) if tiled else (0, 0)
                self.terms[-1][quantity] = tiled
            self.ranges.append(ranges)
        self.tiles = Tiles(
            [s[0].source.grid for s in self._slices], ends, [len(s) for s in self._slices]
        )
        self._held: list[tuple[Key, Key] | None] = [None] * len(self._slices)
        self.movers: dict[tuple[int, int, int], tuple[Any, Any]] = {}  # see scene.Scene

    def members(self, scenario: int, quantity: str) -> int:
        """Return the number of ensemble members of a scenario's quantity; 1 without an ensemble."""
        return max(
            (len(self._slices[tile]) for tile in range(*self.ranges[scenario][quantity])), default=1
        )

    def set(self, low: int, high: int, count: int = 1) -> None:
        """Load the forcing of a step, and of the steps after it, into the tiles.

        Args:
            low: when the step begins [s since 1970], in calendar time.
            high: when it ends.
            count: number of steps of the same length; all must use the slices of the first: see
                `same_slices`.
        """
        forth = self._direction * (high - low)
        steps = [
            [s[0].bracket(low + k * forth, high + k * forth) for s in self._slices]
            for k in range(count)
        ]
        for tile, (slices, bracket) in enumerate(zip(self._slices, steps[0], strict=True)):
            if bracket is not None:
                self._load(tile, slices, bracket)
        self.tiles.blend(*([self._weights(bracket) for bracket in brackets] for brackets in steps))

    def _weights(self, bracket: Bracket | None) -> tuple[float, float] | None:
        """Return the weights of the later slice at the begin and the end of a step; None without a
        slice.
        """
        if bracket is None:
            return None
        return (bracket.low, bracket.high) if self._direction > 0 else (bracket.high, bracket.low)

    def same_slices(self, one: tuple[int, int], other: tuple[int, int]) -> bool:
        """Return whether two steps, each (low, high) [s since 1970], lie between the same slices of
        all sources.
        """
        # members have the same times
        both = ((s[0].bracket(*one), s[0].bracket(*other)) for s in self._slices)
        return all((a and (a.earlier, a.later)) == (b and (b.earlier, b.later)) for a, b in both)

    def _load(self, tile: int, members: tuple[Slices, ...], bracket: Bracket) -> None:
        """Load a source's slices into a tile."""
        wanted, held = (bracket.earlier, bracket.later), self._held[tile]
        if wanted == held:
            return
        follows = held is not None and held[1] == wanted[0]
        for member, slices in enumerate(members):
            if not follows:
                self.tiles.place(tile, slices.get(wanted[0]), later=False, member=member)
            self.tiles.place(tile, slices.get(wanted[1]), later=True, shift=follows, member=member)
        self._held[tile] = wanted

    def size(self, low: int, high: int) -> int:
        """Return the upper limit of the bytes of all slices in a period [s since 1970], once
        regridded.
        """
        every = {
            id(s): (s, grid)
            for of, grid in zip(self._slices, self.tiles.grids, strict=True)
            for s in of
        }.values()
        return sum(s.within(low, high) * 8 * grid.nlon * grid.nlat for s, grid in every)

    def close(self) -> None:
        """Stop reading ahead without waiting for a server; a slice being read from a file is
        completed.
        """
        self._closed.set()
        self.movers.clear()
        self._pool.shutdown(wait=True, cancel_futures=True)
