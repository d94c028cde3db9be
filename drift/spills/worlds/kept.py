"""Read the fates of a run's particles from its files, part by part."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from drift.engine.motion.spool import Portion, SnapshotStore
from drift.engine.particles.status import Status
from drift.spills.worlds import strandings
from drift.spills.worlds.fates import FOREVER, Adrift, Fates
from geo.array import Array


@dataclass(frozen=True)
class StoredFates:
    """A Source of fates (drift.spills.worlds.fates), readable as long as the run's files exist."""

    snapshots: SnapshotStore
    worlds: int
    counts: tuple[int, ...]  # particles of each class in a world
    of_edge: Array  # the segment of every shoreline edge
    at_sea: Mapping[int, int]  # index of the output at the time of each find at sea, by find

    def parts(self) -> Iterator[Fates]:
        """Yield the fates of consecutive ranges of worlds.

        A range has about drift.engine.motion.spool.PART particles, or one block of worlds.
        """
        return map(self._part, self.snapshots.portions())

    def _part(self, portion: Portion) -> Fates:
        (begin, end, number), count = portion.slots[0], self.counts[0]
        first, last = number // count, (number + end - begin) // count
        worlds = np.arange(first, last, dtype=np.int32)
        since, ending = (
            portion.read("status_since"),
            portion.read("status", len(self.snapshots) - 1),
        )
        over = np.isin(ending, (Status.SUNK, Status.LEFT, Status.OUTSIDE))
        adrift = {
            find: Adrift(
                *(portion.read(name, at).astype(np.int32) for name in ("lon", "lat", "status"))
            )
            for find, at in self.at_sea.items()
        }
        return Fates(
            worlds=self.worlds,
            world=np.concatenate([np.repeat(worlds, count) for count in self.counts]),
            kind=np.repeat(
                np.arange(len(self.counts), dtype=np.int32), np.multiply(self.counts, worlds.size)
            ),
            release=portion.read("release"),
            ended=np.where(over, since, FOREVER).astype(np.int32),
            ending=ending.astype(np.int32),
            stays=strandings.read_stays(portion, self.of_edge),
            adrift=adrift,
            some=(first, last),
        )
