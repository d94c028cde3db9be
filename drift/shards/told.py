"""What is told of a run in shards, made from what was taken down of all of them, stretch after stretch.

It is made of whole columns, by what makes it of a run in one piece: so it has the same bits.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from drift import start
from drift.case.record import Case
from drift.motion.spool import Reel
from drift.particles.ensemble import Layout
from drift.particles.partials import Blocks
from drift.posterior.beliefs import Beliefs
from drift.posterior.quantity import Quantity, Values
from drift.search import account, crossings
from drift.search.account import Account, Event, Noted
from drift.search.crossings import Watched
from drift.search.filter import exposures
from drift.search.standing import Standing
from drift.search.updates import Updates
from drift.shards import stretch
from drift.start import Setup
from geo.array import Array


class _TakenDown:
    """Particles as they were at an event: a drift.posterior.source.Source."""

    def __init__(self, reels: Sequence[Reel], of: str, blocks: Blocks) -> None:
        self._reels, self._of, self.blocks = reels, of, blocks

    def values(self, quantity: Quantity) -> Values | None:
        """Return what they have of a quantity; None: none has it."""
        name = f"{self._of} {quantity.name}"
        if f"{name} values" not in self._reels[0].notes:
            return None
        return Values(together(self._reels, f"{name} values"), together(self._reels, f"{name} holds"))


class Told:
    """Updates and posteriors of a run in shards."""

    def __init__(self, case: Case, setup: Setup, reels: Sequence[Reel], layout: Layout, noted: Noted | None) -> None:
        """Take down what the particles of all shards are at the begin of the run; noted: is told of each update."""
        self._case, self._setup = case, setup
        self.beliefs: Beliefs | None = None
        self.begun: Standing | None = None
        log_weight = together(reels, "log_weight") if start.is_told(case) else None
        if log_weight is not None and start.is_believed(case):
            self.beliefs = Beliefs(setup.spec, log_weight, _TakenDown(reels, "begin", layout.blocks))
        self.account = Account(setup.spec, start.noting(self.beliefs, noted))
        if log_weight is not None:
            self.account.begin(log_weight, layout)
        if log_weight is not None and start.is_standing(case):
            self.begun = account.begun(setup.spec, log_weight, together(reels, "release"), layout)

    def take(self, reels: Sequence[Reel], layout: Layout) -> None:
        """Tell what took effect in a stretch; layout: of the whole run."""
        for number, event in enumerate(stretch.events(reels[0])):
            columns = {name: partial(together, reels, f"{number} {name}") for name in event.pop("columns")}
            if self.beliefs is not None:
                self.beliefs.source = _TakenDown(reels, str(number), layout.blocks)
            time = np.datetime64(event.pop("time"))
            self.account.take(Event(**event, time=time, layout=layout, columns=columns))

    def updates(self, reels: Sequence[Reel], layout: Layout) -> Updates | None:
        """Return all updates of a run whose last stretch is over; None: nothing was searched or seen."""
        case, spec = self._case, self._setup.spec
        if "unsearched" not in reels[0].notes:
            return None
        flown = exposures(spec, case.sorties, self._setup.scene)
        markers = [marker for sortie in flown for marker in sortie.markers]
        for number, marker in enumerate(markers):
            marker.go_on(reels[0].noted(f"marker {number}").reshape(-1, 3))
        lines = [
            Watched(line, *(together(reels, f"line {number} {name}") for name in ("stayed", "when")))
            for number, line in enumerate(case.sensors.lines)
        ]
        crossed = None
        if lines:
            end = np.concatenate([reel.read("log_weight", None, 0, reel.n) for reel in reels])
            crossed = crossings.build(spec, lines, end, layout.blocks)
        as_flown = [partial(sortie.as_flown, start=spec.period.epoch) for sortie in flown]
        return self.account.told(as_flown, crossed)


def together(reels: Sequence[Reel], name: str) -> Array:
    """Return a column of all particles (n,), as it was taken down of each shard."""
    return np.concatenate([reel.noted(name) for reel in reels])
