"""Time slices of a source for each step of a run, read ahead by a thread, a few in memory.

For a step [begin, end], two slices bracket the time. If a time of the source falls inside the step,
the fields at begin and end are interpolated first, so that the field is always linear in time
within a step. If a step begins before the first time or ends after the last, the first or last
slice is used for the uncovered part of that step.
"""

from bisect import bisect_left, bisect_right
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from geo import notation
from geo.array import Array
from geo.forcing.sources import Source
from geo.grids import fill as filling

# in units of the usual interval: a longer gap is a hole in the data and is not interpolated over
LONGEST_GAP = 3

Times = npt.NDArray[np.datetime64]
Key = int | float  # index of a slice, or a time [s] between two slices


def data_gaps(source: Source) -> list[tuple[np.datetime64, np.datetime64]]:
    """Return the (begin, end) of the holes in a source's data; none for a gapless source."""
    return [] if source.gapless else long_gaps(source.times)


def long_gaps(times: Times) -> list[tuple[np.datetime64, np.datetime64]]:
    """Return the (begin, end) of the gaps that are too long to be interpolated over."""
    if times.size < 2:
        return []
    steps = np.diff(times.astype("datetime64[s]"))
    wide = np.flatnonzero(steps.astype(np.int64) > LONGEST_GAP * np.median(steps.astype(np.int64)))
    return [(times[k], times[k + 1]) for k in wide]


def data_spans(source: Source) -> list[tuple[np.datetime64, np.datetime64]]:
    """Return the (begin, end) of the time spans with data, for a source that is not steady."""
    inner = [end for hole in data_gaps(source) for end in hole]
    ends = [source.times[0], *inner, source.times[-1]]
    return list(zip(ends[::2], ends[1::2], strict=True))


class Bracket(NamedTuple):
    """The slices before and after a step, and the weight of the later one at its two ends."""

    earlier: Key
    later: Key
    low: float
    high: float


class Slices:
    """The slices of one source, read ahead in a thread pool and filled toward the coast.

    Land nodes take the mean of their neighbours, up to `cells` deep (0: no filling); beyond that,
    the value of the nearest wet node within REACH.
    """

    def __init__(self, source: Source, cells: int, ahead: int, pool: ThreadPoolExecutor) -> None:
        self.source, self.cells, self.ahead, self._pool = source, cells, ahead, pool
        self.seconds = notation.epochs(source.times)
        steps = np.diff(self.seconds)
        # for short lists, searching in Python is faster than in NumPy
        self._nodes: list[int] = self.seconds.tolist()
        self._steps: list[int] = steps.tolist()
        self._usual_step = float(np.median(steps)) if steps.size else 0.0
        self._pending: dict[int, Future[Array]] = {}

    def bracket(self, low: int, high: int) -> Bracket | None:
        """Return the bracket of the step [low, high] [s since 1970]; None if there is no data."""
        nodes = self._nodes
        if not nodes:
            return Bracket(0, 0, 0.0, 0.0)
        if high <= nodes[0] or low >= nodes[-1] or len(nodes) < 2:
            return None
        if low < nodes[0] or high > nodes[-1]:
            return Bracket(float(low), float(high), 0.0, 1.0)
        i = min(bisect_right(nodes, low) - 1, len(nodes) - 2)
        j = max(bisect_left(nodes, high), i + 1)
        if not self.source.gapless and max(self._steps[i:j]) > LONGEST_GAP * self._usual_step:
            return None
        if j > i + 1:
            return Bracket(float(low), float(high), 0.0, 1.0)
        span = self._steps[i]
        return Bracket(i, j, (low - nodes[i]) / span, (high - nodes[i]) / span)

    def get(self, key: Key) -> Array:
        """Return the slice of a key, (nlat, nlon, 2) [m/s], and start reading the next one."""
        if isinstance(key, float):
            key = min(max(key, float(self.seconds[0])), float(self.seconds[-1]))
            i = min(int(np.searchsorted(self.seconds, key, "right")) - 1, self.seconds.size - 2)
            weight = np.float32((key - self.seconds[i]) / self._steps[i])
            return np.asarray((1 - weight) * self.get(i) + weight * self.get(i + 1))
        values = self._find_shared(key)
        if values is None:
            values = self._request(key).result()
        if self._find_shared(key + self.ahead) is None:
            self._request(key + self.ahead)
        for old in [k for k in self._pending if abs(k - key) > 1]:
            del self._pending[old]
        return values

    def _find_shared(self, index: int) -> Array | None:
        """Return a slice from the shared cache; None if it is absent."""
        shelf = self.source.shelf
        return None if shelf is None else shelf.find(self.cells, self._clamp_index(index))

    def _clamp_index(self, index: int) -> int:
        return min(max(index, 0), max(self.seconds.size, 1) - 1)

    def _request(self, index: int) -> Future[Array]:
        index = self._clamp_index(index)
        if index not in self._pending:
            self._pending[index] = self._pool.submit(self._read, index)
        return self._pending[index]

    def within(self, low: int, high: int) -> int:
        """Return the largest number of slices that a run between two times [s since 1970] reads."""
        first, last = np.searchsorted(self.seconds, (low, high))
        # one before the first time, one after the last, and one read ahead
        return max(min(int(last - first) + 3, self.seconds.size), 1)

    def _read(self, index: int) -> Array:
        shelf = self.source.shelf
        return (
            self._read_and_fill(index)
            if shelf is None
            else shelf.made(partial(self._read_and_fill, index), self.cells, index)
        )

    def _read_and_fill(self, index: int) -> Array:
        values, grid = self.source.read(index), self.source.grid
        if self.cells:
            bands, inside = filling.bands(grid), self.source.domain
            values = filling.fill(
                values, self.cells, grid.seamless, reach=filling.REACH, bands=bands, within=inside
            )
        return values
