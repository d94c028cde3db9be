"""Record stays of particles on the shore during a run: arrival, edge and departure.

If stranded particles never move again, the ensemble's own columns hold all stays at the end. If
they can refloat, the columns are compared after every step. The stays are stored in the file of the
run, or of each of its shards.
"""

from dataclasses import dataclass, field

import numpy as np

from drift.engine.motion.spool import Portion, ShardFile
from drift.engine.particles.ensemble import Ensemble, Layout
from drift.engine.particles.status import Status
from drift.spills.worlds.fates import FOREVER, Stays
from geo.array import Array

NOTE = "stays"  # slot, edge, arrival and leave of each stay, by slot and arrival
BEGUN = "stays of blocks"  # first stay of each block of particles, then the number of all stays


@dataclass
class Landings:
    """The stays of an ensemble's particles; call `watch` after every step if any can refloat."""

    ensemble: Ensemble
    refloats: bool
    _ashore: Array = field(init=False)  # bool (n,), after the last step
    _ended: Array = field(init=False)
    _edge: Array = field(init=False)
    # (4, m): slot, edge, arrival, leave
    _rows: list[Array] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        """Start with no particle ashore."""
        n = self.ensemble.n
        self._ashore, self._ended, self._edge = (
            np.zeros(n, bool),
            np.zeros(n, np.int32),
            np.zeros(n, np.int32),
        )

    def watch(self, elapsed: int) -> None:
        """Record the stays that ended in the step that began at `elapsed` [s after start]."""
        if not self.refloats:
            return
        ashore = self.ensemble.status.to_numpy() == Status.ASHORE
        ended, edge = self.ensemble.status_since.to_numpy(), self.ensemble.edge.to_numpy()
        left_shore = np.flatnonzero(self._ashore & (~ashore | (ended != self._ended)))
        leave = np.maximum(
            self._ended[left_shore] + 1, self.ensemble.moving_since.to_numpy()[left_shore]
        )
        self._rows.append(
            np.stack([left_shore, self._edge[left_shore], self._ended[left_shore], leave]).astype(
                np.int32
            )
        )
        self._ashore, self._ended, self._edge = ashore, ended, edge

    def note(self, reel: ShardFile) -> None:
        """Write all stays into a file at the end of the run."""
        there = np.flatnonzero(self.ensemble.status.to_numpy() == Status.ASHORE)
        ended, edge = (
            self.ensemble.status_since.to_numpy()[there],
            self.ensemble.edge.to_numpy()[there],
        )
        last = np.stack([there, edge, ended, np.full(there.size, FOREVER)])
        rows = np.concatenate([*self._rows, last], axis=1).astype(np.int32)
        rows = rows[:, np.lexsort((rows[2], rows[0]))]
        reel.note(NOTE, rows.T.ravel())
        reel.note(BEGUN, np.searchsorted(rows[0], _block_bounds(self.ensemble.layout)))


def read_stays(portion: Portion, of_edge: Array) -> Stays:
    """Return the stays of a portion's particles, by their slots in it.

    Args:
        portion: some particles of a run's file.
        of_edge: segment of every shoreline edge.

    Returns:
        The stays, sorted by slot and arrival.
    """
    shard_file, first_stays, parts, offset = portion.reel, portion.reel.noted(BEGUN), [], 0
    for first, last, _ in portion.slots:
        a, b = first_stays[
            np.searchsorted(_block_bounds(shard_file.layout), (first, last))
        ].tolist()
        rows = shard_file.noted(NOTE, 4 * a, 4 * b).reshape(-1, 4).T
        parts.append(rows - np.array([[first - offset], [0], [0], [0]], np.int32))
        offset += last - first
    slot, edge, arrival, leave = np.concatenate(parts, axis=1)
    return Stays(slot, of_edge[edge].astype(np.int32), arrival, leave)


def _block_bounds(layout: Layout) -> Array:
    """Return the first slot of each block, followed by the number of slots."""
    return np.append(layout.blocks.first, layout.blocks.n)
