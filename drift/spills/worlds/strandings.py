"""Stays of particles on the shore, noted during a run: when each came, to which edge, and when it
left.

Where stranded particles stay for good, the ensemble's own columns hold all stays at the end. Where
they refloat, the columns are compared after every step. What has been noted goes into the file of
the run, or of each of its shards.
"""

from dataclasses import dataclass, field

import numpy as np

from drift.engine.motion.spool import Portion, ShardFile
from drift.engine.particles.ensemble import Ensemble, Layout
from drift.engine.particles.status import Status
from drift.spills.worlds.fates import FOREVER, Stays
from geo.array import Array

NOTE = "stays"  # slot, edge, arrival and leave of each, by slot and arrival
BEGUN = "stays of blocks"  # the first of each block of particles, and the number of all


@dataclass
class Landings:
    """The record of an ensemble's stays;

    `watch` is called after every step if anything can refloat.
    """

    ensemble: Ensemble
    refloats: bool
    _ashore: Array = field(init=False)  # bool (n,), after the last step
    _ended: Array = field(init=False)
    _edge: Array = field(init=False)
    # (4, m): slot, edge, arrival, leave
    _rows: list[Array] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        """Begin with nothing ashore."""
        n = self.ensemble.n
        self._ashore, self._ended, self._edge = (
            np.zeros(n, bool),
            np.zeros(n, np.int32),
            np.zeros(n, np.int32),
        )

    def watch(self, elapsed: int) -> None:
        """Note the stays that ended in the step that began at `elapsed` [s after start]."""
        if not self.refloats:
            return
        ashore = self.ensemble.status.to_numpy() == Status.ASHORE
        ended, edge = self.ensemble.status_since.to_numpy(), self.ensemble.edge.to_numpy()
        gone = np.flatnonzero(self._ashore & (~ashore | (ended != self._ended)))
        leave = np.maximum(self._ended[gone] + 1, self.ensemble.moving_since.to_numpy()[gone])
        self._rows.append(
            np.stack([gone, self._edge[gone], self._ended[gone], leave]).astype(np.int32)
        )
        self._ashore, self._ended, self._edge = ashore, ended, edge

    def note(self, reel: ShardFile) -> None:
        """Take down all stays at the end of the run."""
        there = np.flatnonzero(self.ensemble.status.to_numpy() == Status.ASHORE)
        ended, edge = (
            self.ensemble.status_since.to_numpy()[there],
            self.ensemble.edge.to_numpy()[there],
        )
        last = np.stack([there, edge, ended, np.full(there.size, FOREVER)])
        rows = np.concatenate([*self._rows, last], axis=1).astype(np.int32)
        rows = rows[:, np.lexsort((rows[2], rows[0]))]
        reel.note(NOTE, rows.T.ravel())
        reel.note(BEGUN, np.searchsorted(rows[0], _edges(self.ensemble.layout)))


def stays(portion: Portion, of_edge: Array) -> Stays:
    """Return the stays of some particles, by their slots among them; of_edge: the segment of every
    shoreline edge.
    """
    reel, begun, parts, ahead = portion.reel, portion.reel.noted(BEGUN), [], 0
    for first, last, _ in portion.slots:
        a, b = begun[np.searchsorted(_edges(reel.layout), (first, last))].tolist()
        rows = reel.noted(NOTE, 4 * a, 4 * b).reshape(-1, 4).T
        parts.append(rows - np.array([[first - ahead], [0], [0], [0]], np.int32))
        ahead += last - first
    slot, edge, arrival, leave = np.concatenate(parts, axis=1)
    return Stays(slot, of_edge[edge].astype(np.int32), arrival, leave)


def _edges(layout: Layout) -> Array:
    """Return the first slot of each block and, last, the number of slots."""
    return np.append(layout.blocks.first, layout.blocks.n)
