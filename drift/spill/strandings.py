"""Stays of particles on the shore, noted during a run: when each came, to which edge, and when it left.

Where stranded particles stay for good, the ensemble's own columns hold all stays at the end. Where they refloat, the
columns are compared after every step. What has been noted goes into the file of the run, or of each of its shards.
"""

from dataclasses import dataclass, field

import numpy as np

from drift.motion.spool import Reel, Spool
from drift.particles.ensemble import Ensemble, Layout
from drift.particles.status import Status
from drift.spill.fates import FOREVER, Stays
from geo.array import Array

NOTE = "stays"


@dataclass
class Landings:
    """The record of an ensemble's stays; `watch` is called after every step if anything can refloat."""

    ensemble: Ensemble
    refloats: bool
    _ashore: Array = field(init=False)  # bool (n,), after the last step
    _ended: Array = field(init=False)
    _edge: Array = field(init=False)
    _rows: list[Array] = field(init=False, default_factory=list)  # (4, m): slot, edge, arrival, leave

    def __post_init__(self) -> None:
        """Begin with nothing ashore."""
        n = self.ensemble.n
        self._ashore, self._ended, self._edge = np.zeros(n, bool), np.zeros(n, np.int32), np.zeros(n, np.int32)

    def watch(self, elapsed: int) -> None:
        """Note the stays that ended in the step that began at `elapsed` [s after start]."""
        if not self.refloats:
            return
        ashore = self.ensemble.status.to_numpy() == Status.ASHORE
        ended, edge = self.ensemble.status_since.to_numpy(), self.ensemble.edge.to_numpy()
        gone = np.flatnonzero(self._ashore & (~ashore | (ended != self._ended)))
        leave = np.maximum(self._ended[gone] + 1, self.ensemble.moving_since.to_numpy()[gone])
        self._rows.append(np.stack([gone, self._edge[gone], self._ended[gone], leave]).astype(np.int32))
        self._ashore, self._ended, self._edge = ashore, ended, edge

    def note(self, reel: Reel) -> None:
        """Take down all stays at the end of the run."""
        there = np.flatnonzero(self.ensemble.status.to_numpy() == Status.ASHORE)
        ended, edge = self.ensemble.status_since.to_numpy()[there], self.ensemble.edge.to_numpy()[there]
        last = np.stack([there, edge, ended, np.full(there.size, FOREVER)])
        reel.note(NOTE, np.concatenate([*self._rows, last], axis=1).astype(np.int32).ravel())


def stays(spool: Spool, of_edge: Array) -> Stays:
    """Return all stays that have been taken down; of_edge: the segment of every shoreline edge, by number."""
    parts = [_numbered(layout, noted.reshape(4, -1)) for layout, noted in spool.noted(NOTE)]
    slot, edge, arrival, leave = np.concatenate(parts, axis=1)
    order = np.lexsort((arrival, slot))
    return Stays(slot[order], of_edge[edge[order]].astype(np.int32), arrival[order], leave[order])


def _numbered(layout: Layout, rows: Array) -> Array:
    """Return the rows of a shard with the numbers that its slots have in the whole run."""
    shift = np.array(layout.numbers) - np.array(layout.bounds[:-1])
    slot = rows[0] + shift[np.searchsorted(layout.bounds, rows[0], "right") - 1]
    return np.concatenate([slot.astype(np.int32)[None], rows[1:]])
