"""Where all particles of a run meet: what the filter asks of them together.

That is how likely a doubtful contact is, and whether so few of them count that they are drawn
again. A run in one piece has its particles here (`Alone`); a shard of a run stops where it has to
ask (drift.pipeline.shards.stretch).
"""

from typing import NamedTuple, Protocol

import numpy as np

from drift.engine.particles import resample, weights
from drift.engine.particles.ensemble import Layout
from drift.engine.particles.weights import Weighed
from drift.evidence.filter.account import Account, Event
from drift.evidence.filter.records import Resampling
from geo.array import Array


class Drawn(NamedTuple):
    """Particles that have been drawn again, by slots of the whole run."""

    ancestors: Array  # int64 (n,) slot of each one's ancestor
    log_weight: Array  # float32 (n,)
    spare: Array  # bool (n,): nobody is there
    layout: Layout


class Meeting(Protocol):
    """Of the particles that are here with all others of the run."""

    def begin(self, elapsed: int, until: int) -> None:
        """Take note that a step is about to be made [s after start]."""

    def take(self, event: Event) -> None:
        """Take down what took effect."""

    def mean(self, contact: int, before: Weighed, after: Weighed) -> float:
        """Return the log of the mean likelihood of a contact, by the weights before and after it
        that are here.
        """

    def anew(self, log_weight: Array, layout: Layout) -> Drawn | None:
        """Return the particles drawn again at the end of a step in which something took effect;

        None: they need not be.
        """


def log_mean(before: Weighed, after: Weighed) -> float:
    """Return the log of the mean likelihood by all weights before and after it; -inf: it is
    impossible.
    """
    return after.log_sum - before.log_sum


class Redrawing:
    """When and how all particles of a run are drawn again."""

    def __init__(self, seed: int, rule: Resampling, target: list[int]) -> None:
        """Make ready; target: how many particles each scenario aims at."""
        self._seed, self._rule, self.target = seed, rule, target

    def anew(self, log_weight: Array, layout: Layout, events: int) -> Drawn | None:
        """Return the particles drawn again by their log weights (n,) after so many events;

        None: they need not be.
        """
        scenarios = list(zip(layout.bounds[:-1], layout.bounds[1:], strict=True))
        left = self._left(log_weight, layout)
        if left >= self._rule.below * sum(self.target) or self.lost(log_weight, layout):
            return None
        seeds = self._seed, events
        if self._rule.across:
            ancestors, new, bounds = resample.across(
                log_weight, scenarios, layout.bounds[-1], seeds
            )
            return Drawn(
                ancestors, new, np.zeros(len(new), bool), Layout(bounds, bounds[:-1], layout.block)
            )
        return Drawn(
            *resample.offspring(log_weight, scenarios, self.target, self._rule.method, seeds),
            layout,
        )

    def lost(self, log_weight: Array, layout: Layout) -> bool:
        """Return whether so few particles are left that the track is lost: nothing is made of them
        until a contact is.
        """
        return self._rule.fills and self._left(log_weight, layout) < self._rule.bulk * sum(
            self.target
        )

    def _left(self, log_weight: Array, layout: Layout) -> float:
        """Return how many particles count, as the method counts them."""
        if not resample.METHODS[self._rule.method].keeps:
            return weights.weighed(log_weight, layout.blocks).ess
        weight = weights.relative(log_weight)
        scenarios = zip(layout.bounds[:-1], layout.bounds[1:], strict=True)
        return sum(
            float(resample.survivors(weight[first:last]).sum())
            for first, last in scenarios
            if last > first
        )


class Alone:
    """All particles of a run are here."""

    def __init__(self, account: Account, redrawing: Redrawing) -> None:
        """Make ready."""
        self.account, self._redrawing = account, redrawing
        self._events = 0  # after which it was asked last

    def begin(self, elapsed: int, until: int) -> None:
        """Nothing is to be done."""

    def take(self, event: Event) -> None:
        """Tell what took effect."""
        self.account.take(event)

    def mean(self, contact: int, before: Weighed, after: Weighed) -> float:
        """Return the log of the mean likelihood of a contact."""
        return log_mean(before, after)

    def anew(self, log_weight: Array, layout: Layout) -> Drawn | None:
        """Return the particles drawn again; None: they need not be."""
        events = len(self.account.updates)
        if events == self._events:
            return None
        self._events = events
        if self._redrawing.lost(log_weight, layout):
            self.account.lost()
        return self._redrawing.anew(log_weight, layout, events)

    def drawn(self, log_weight: Array, lineage: Array, layout: Layout) -> None:
        """Take down that particles were drawn anew: their log weights and lineage (n,)."""
        self.account.drawn_anew(log_weight, lineage, layout, sum(self._redrawing.target))
