"""Update summaries and posteriors of a run in shards, built from the columns that the shards
stored.

The columns are read part by part by the functions that serve a run in one piece, so the results are
the same to the bit.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from drift.case.record import Case
from drift.engine.motion.spool import ShardFile
from drift.engine.particles.columns import Columns
from drift.engine.particles.ensemble import Layout
from drift.engine.particles.partials import Blocks
from drift.evidence.filter import account, crossings
from drift.evidence.filter.account import Account, Event, UpdateCallback
from drift.evidence.filter.filter import create_exposures
from drift.evidence.filter.standing import SearchStatus
from drift.evidence.filter.updates import Updates
from drift.evidence.posterior.beliefs import Beliefs
from drift.evidence.posterior.quantity import Quantity, Values
from drift.pipeline import run_setup
from drift.pipeline.run_setup import Setup
from drift.pipeline.shards import stretch
from geo.array import Array


class _StoredParticles:
    """Stored quantities of all particles at an event: a drift.evidence.posterior.source.Source."""

    def __init__(self, reels: Sequence[ShardFile], of: str, blocks: Blocks) -> None:
        self._reels, self._of, self._blocks = reels, of, blocks

    def columns(self, quantity: Quantity, time: np.datetime64 | None) -> Columns | None:
        """Return the columns of a quantity; None if it was not stored."""
        own = [f"{self._of} {quantity.name} {name}" for name in Values._fields]
        if own[0] not in self._reels[0].notes:
            return None
        return columns(self._reels, self._blocks, dict(zip(Values._fields, own, strict=True)))


class ShardedAccount:
    """Updates and posteriors of a run in shards."""

    def __init__(
        self,
        case: Case,
        setup: Setup,
        reels: Sequence[ShardFile],
        layout: Layout,
        noted: UpdateCallback | None,
    ) -> None:
        """Read the state of all shards at the start of the run.

        Args:
            case: the case of the run.
            setup: its scene, clock and priors.
            reels: the files of the first stretch of all shards.
            layout: the particles of the whole run.
            noted: called after each update.
        """
        self._case, self._setup = case, setup
        self.beliefs: Beliefs | None = None
        self.begun: SearchStatus | None = None
        begin = (
            columns(reels, layout.blocks, ("log_weight", "release"))
            if run_setup.needs_whole_ensemble(case)
            else None
        )
        if begin is not None and run_setup.reports_posteriors(case):
            self.beliefs = Beliefs(
                setup.spec, begin, _StoredParticles(reels, "begin", layout.blocks)
            )
        self.account = Account(setup.spec, run_setup.combined_update_callback(self.beliefs, noted))
        if begin is not None:
            self.account.begin(begin)
        if begin is not None and run_setup.reports_search_status(case):
            self.begun = account.initial_status(setup.spec, begin)

    def take(self, reels: Sequence[ShardFile], layout: Layout) -> None:
        """Add the updates of a stretch; `layout` is that of the whole run."""
        for number, event in enumerate(stretch.events(reels[0])):
            if self.beliefs is not None:
                self.beliefs.source = _StoredParticles(reels, str(number), layout.blocks)
            own = columns(
                reels, layout.blocks, {name: f"{number} {name}" for name in event["columns"]}
            )
            self.account.take(
                Event(**{**event, "time": np.datetime64(event["time"]), "columns": own})
            )

    def updates(self, reels: Sequence[ShardFile], layout: Layout) -> Updates | None:
        """Return all updates of a completed run; None without search and observation."""
        case, spec = self._case, self._setup.spec
        if "unsearched" not in reels[0].notes:
            return None
        flown = create_exposures(spec, case.sorties, self._setup.scene)
        markers = [marker for sortie in flown for marker in sortie.markers]
        for number, marker in enumerate(markers):
            marker.go_on(reels[0].noted(f"marker {number}").reshape(-1, 3))
        crossed = None
        if case.sensors.lines:
            names = [name for name in reels[0].notes if name.startswith("line ")]
            seen = columns(reels, layout.blocks, names) | _at_end(reels, layout.blocks)
            crossed = crossings.build_crossings(spec, case.sensors.lines, seen)
        as_flown = [partial(sortie.as_flown, start=spec.period.epoch) for sortie in flown]
        return self.account.told(as_flown, crossed)


def columns(
    reels: Sequence[ShardFile], blocks: Blocks, names: Mapping[str, str] | Sequence[str]
) -> Columns:
    """Return columns of all particles of a run, read from the shards' files when needed.

    Args:
        reels: the files of all shards, in order.
        blocks: the blocks of all particles.
        names: names of the columns, or a mapping of their names to those in the files.
    """
    own, edges = (
        names if isinstance(names, Mapping) else {name: name for name in names},
        _shard_bounds(reels),
    )
    reads = {name: partial(ShardFile.noted, name=noted) for name, noted in own.items()}
    return Columns(
        blocks, {name: partial(_read_slots, reels, edges, read) for name, read in reads.items()}
    )


def _at_end(reels: Sequence[ShardFile], blocks: Blocks) -> Columns:
    """Return the `log_weight` of all particles at the end of the run."""
    read = partial(ShardFile.read, name="log_weight", at=None)
    return Columns(blocks, {"log_weight": partial(_read_slots, reels, _shard_bounds(reels), read)})


def join_column(reels: Sequence[ShardFile], name: str) -> Array:
    """Return a column of all particles, shape (n,), joined from the shards' files."""
    return np.concatenate([reel.noted(name) for reel in reels])


def _shard_bounds(reels: Sequence[ShardFile]) -> Array:
    """Return the first slot of each shard in the run, then the total number of slots."""
    return np.cumsum([0, *(reel.n for reel in reels)])


def _read_slots(
    reels: Sequence[ShardFile], edges: Array, read: Callable[..., Array], first: int, last: int
) -> Array:
    """Return a column at the slots first <= slot < last; `read` reads slots of one shard's file."""
    begin, end = (np.searchsorted(edges, (first, last - 1), side="right") - 1).tolist()
    found = [
        read(
            reels[k],
            first=max(first - int(edges[k]), 0),
            last=min(last - int(edges[k]), reels[k].n),
        )
        for k in range(begin, end + 1)
    ]
    return found[0] if len(found) == 1 else np.concatenate(found)
