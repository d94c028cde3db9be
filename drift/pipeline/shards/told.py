"""What is told of a run in shards, made from what was taken down of all of them, stretch after
stretch.

It is made part by part, by what makes it of a run in one piece: so it has the same bits.
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
from drift.evidence.filter.account import Account, Event, Noted
from drift.evidence.filter.filter import exposures
from drift.evidence.filter.standing import Standing
from drift.evidence.filter.updates import Updates
from drift.evidence.posterior.beliefs import Beliefs
from drift.evidence.posterior.quantity import Quantity, Values
from drift.pipeline import run_setup
from drift.pipeline.run_setup import Setup
from drift.pipeline.shards import stretch
from geo.array import Array


class _TakenDown:
    """Particles as they were at an event: a drift.evidence.posterior.source.Source."""

    def __init__(self, reels: Sequence[ShardFile], of: str, blocks: Blocks) -> None:
        self._reels, self._of, self._blocks = reels, of, blocks

    def columns(self, quantity: Quantity) -> Columns | None:
        """Return what they have of a quantity; None: none has it."""
        own = [f"{self._of} {quantity.name} {name}" for name in Values._fields]
        if own[0] not in self._reels[0].notes:
            return None
        return columns(self._reels, self._blocks, dict(zip(Values._fields, own, strict=True)))


class Told:
    """Updates and posteriors of a run in shards."""

    def __init__(
        self,
        case: Case,
        setup: Setup,
        reels: Sequence[ShardFile],
        layout: Layout,
        noted: Noted | None,
    ) -> None:
        """Take down what the particles of all shards are at the begin of the run; noted: is told of
        each update.
        """
        self._case, self._setup = case, setup
        self.beliefs: Beliefs | None = None
        self.begun: Standing | None = None
        begin = (
            columns(reels, layout.blocks, ("log_weight", "release"))
            if run_setup.is_told(case)
            else None
        )
        if begin is not None and run_setup.is_believed(case):
            self.beliefs = Beliefs(setup.spec, begin, _TakenDown(reels, "begin", layout.blocks))
        self.account = Account(setup.spec, run_setup.noting(self.beliefs, noted))
        if begin is not None:
            self.account.begin(begin)
        if begin is not None and run_setup.is_standing(case):
            self.begun = account.begun(setup.spec, begin)

    def take(self, reels: Sequence[ShardFile], layout: Layout) -> None:
        """Tell what took effect in a stretch; layout: of the whole run."""
        for number, event in enumerate(stretch.events(reels[0])):
            if self.beliefs is not None:
                self.beliefs.source = _TakenDown(reels, str(number), layout.blocks)
            own = columns(
                reels, layout.blocks, {name: f"{number} {name}" for name in event["columns"]}
            )
            self.account.take(
                Event(**{**event, "time": np.datetime64(event["time"]), "columns": own})
            )

    def updates(self, reels: Sequence[ShardFile], layout: Layout) -> Updates | None:
        """Return all updates of a run whose last stretch is over;

        None: nothing was searched or seen.
        """
        case, spec = self._case, self._setup.spec
        if "unsearched" not in reels[0].notes:
            return None
        flown = exposures(spec, case.sorties, self._setup.scene)
        markers = [marker for sortie in flown for marker in sortie.markers]
        for number, marker in enumerate(markers):
            marker.go_on(reels[0].noted(f"marker {number}").reshape(-1, 3))
        crossed = None
        if case.sensors.lines:
            names = [name for name in reels[0].notes if name.startswith("line ")]
            seen = columns(reels, layout.blocks, names) | at_end(reels, layout.blocks)
            crossed = crossings.build_crossings(spec, case.sensors.lines, seen)
        as_flown = [partial(sortie.as_flown, start=spec.period.epoch) for sortie in flown]
        return self.account.told(as_flown, crossed)


def columns(
    reels: Sequence[ShardFile], blocks: Blocks, names: Mapping[str, str] | Sequence[str]
) -> Columns:
    """Return columns of all particles, as they were taken down of each shard; names: under which,
    by their own.
    """
    own, edges = (
        names if isinstance(names, Mapping) else {name: name for name in names},
        _edges(reels),
    )
    reads = {name: partial(ShardFile.noted, name=noted) for name, noted in own.items()}
    return Columns(
        blocks, {name: partial(_some, reels, edges, read) for name, read in reads.items()}
    )


def at_end(reels: Sequence[ShardFile], blocks: Blocks) -> Columns:
    """Return the `log_weight` of all particles at the end of the run."""
    read = partial(ShardFile.read, name="log_weight", at=None)
    return Columns(blocks, {"log_weight": partial(_some, reels, _edges(reels), read)})


def together(reels: Sequence[ShardFile], name: str) -> Array:
    """Return a column of all particles (n,), as it was taken down of each shard."""
    return np.concatenate([reel.noted(name) for reel in reels])


def _edges(reels: Sequence[ShardFile]) -> Array:
    """Return the first slot of each shard in the run and, last, the number of all."""
    return np.cumsum([0, *(reel.n for reel in reels)])


def _some(
    reels: Sequence[ShardFile], edges: Array, read: Callable[..., Array], first: int, last: int
) -> Array:
    """Return a column of some slots of the run, whose shards come one after another; read: gives it
    of slots of a reel.
    """
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
