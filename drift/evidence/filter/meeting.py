"""Reductions over all particles of a run, as the filter needs them.

There are two: the mean likelihood of a doubtful contact, and the decision to resample. A run in one
piece computes them at once (`Alone`). A shard of a run stops where it needs one
(drift.pipeline.shards.stretch).
"""

from typing import NamedTuple, Protocol

import numpy as np

from drift.engine.particles import resample, weights
from drift.engine.particles.ensemble import Layout
from drift.engine.particles.weights import WeightSums
from drift.evidence.filter.account import Account, Event
from drift.evidence.filter.records import Resampling
from geo.array import Array


class Resampled(NamedTuple):
    """Resampled particles, by slots of the whole run."""

    ancestors: Array  # int64 (n,) slot of each one's ancestor
    log_weight: Array  # float32 (n,)
    spare: Array  # bool (n,): the slot is empty
    layout: Layout


class Reduction(Protocol):
    """Reductions over the particles of this shard and of all others of the run."""

    def begin(self, elapsed: int, until: int) -> None:
        """Register a step that is about to be made [s after start]."""

    def take(self, event: Event) -> None:
        """Record an update."""

    def mean(self, contact: int, before: WeightSums, after: WeightSums) -> float:
        """Return the log of the mean likelihood of a contact over the whole run.

        Args:
            contact: number of the contact in the case.
            before: weights of this shard before the contact.
            after: weights of this shard times the likelihood.
        """

    def anew(self, log_weight: Array, layout: Layout) -> Resampled | None:
        """Return the resampled particles at the end of a step with updates; None: no resampling."""


def log_mean_likelihood(before: WeightSums, after: WeightSums) -> float:
    """Return the log of the mean likelihood from the weights before and after; -inf: impossible."""
    return after.log_sum - before.log_sum


class ResamplingRule:
    """When and how all particles of a run are resampled."""

    def __init__(self, seed: int, rule: Resampling, target: list[int]) -> None:
        """Set up resampling; target: number of particles of each scenario."""
        self._seed, self._rule, self.target = seed, rule, target

    def anew(self, log_weight: Array, layout: Layout, events: int) -> Resampled | None:
        """Return the resampled particles; None if enough are effective, or the track is lost.

        Args:
            log_weight: of all particles, shape (n,).
            layout: their slots by scenario.
            events: number of updates so far, which seeds the draw.
        """
        scenarios = list(zip(layout.bounds[:-1], layout.bounds[1:], strict=True))
        left = self._left(log_weight, layout)
        if left >= self._rule.below * sum(self.target) or self.lost(log_weight, layout):
            return None
        seeds = self._seed, events
        if self._rule.across:
            ancestors, new, bounds = resample.resample_across_scenarios(
                log_weight, scenarios, layout.bounds[-1], seeds
            )
            return Resampled(
                ancestors, new, np.zeros(len(new), bool), Layout(bounds, bounds[:-1], layout.block)
            )
        return Resampled(
            *resample.offspring(log_weight, scenarios, self.target, self._rule.method, seeds),
            layout,
        )

    def lost(self, log_weight: Array, layout: Layout) -> bool:
        """Return whether so few particles are left that the track is lost.

        There is then no resampling until a contact repopulates.
        """
        return self._rule.fills and self._left(log_weight, layout) < self._rule.bulk * sum(
            self.target
        )

    def _left(self, log_weight: Array, layout: Layout) -> float:
        """Return the number of effective particles or survivors, as the method counts them."""
        if not resample.METHODS[self._rule.method].keeps:
            return weights.sum_weights(log_weight, layout.blocks).ess
        weight = weights.relative(log_weight)
        scenarios = zip(layout.bounds[:-1], layout.bounds[1:], strict=True)
        return sum(
            float(resample.survivors(weight[first:last]).sum())
            for first, last in scenarios
            if last > first
        )


class LocalReduction:
    """Reductions of a run in one piece: all particles are here."""

    def __init__(self, account: Account, redrawing: ResamplingRule) -> None:
        """Set up with the account of the run and its resampling rule."""
        self.account, self._redrawing = account, redrawing
        self._events = 0  # number of updates at the last decision to resample

    def begin(self, elapsed: int, until: int) -> None:
        """Do nothing: only shards need to know of a step."""

    def take(self, event: Event) -> None:
        """Record an update."""
        self.account.take(event)

    def mean(self, contact: int, before: WeightSums, after: WeightSums) -> float:
        """Return the log of the mean likelihood of a contact."""
        return log_mean_likelihood(before, after)

    def anew(self, log_weight: Array, layout: Layout) -> Resampled | None:
        """Return the resampled particles; None: no resampling."""
        events = len(self.account.updates)
        if events == self._events:
            return None
        self._events = events
        if self._redrawing.lost(log_weight, layout):
            self.account.lost()
        return self._redrawing.anew(log_weight, layout, events)

    def drawn(self, log_weight: Array, lineage: Array, layout: Layout) -> None:
        """Record a resampling: log weights and lineage (n,)."""
        self.account.drawn_anew(log_weight, lineage, layout, sum(self._redrawing.target))
