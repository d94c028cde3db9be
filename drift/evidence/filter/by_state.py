"""A sortie over objects whose state changes: an exposure for each state.

A capsized raft is harder to see than a floating one. Each state has its own sweep widths, and an
exposure that only particles in that state gain. Within a step, a particle counts as in the state in
which it is midway. Changes come at any time within steps, so that the error of the mean is of second
order in the step.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from drift.engine.motion import changes
from drift.engine.motion.forcing import Forcing
from drift.engine.motion.scenario import Scenario
from drift.engine.motion.scene import Begin
from drift.engine.motion.steering.steer import Helm
from drift.engine.particles.ensemble import Ensemble
from drift.evidence.filter.exposure import Exposed, SortieExposure
from drift.evidence.filter.markers import Marker
from drift.evidence.filter.records import Sortie
from geo.array import Array
from kernels.runtime import runtime
from kernels.step.advance import Step


def sorties(sortie: Sortie) -> list[Sortie]:
    """Return a sortie as objects in each state meet it: its sweep widths and coverages."""
    after = [
        replace(sortie, sweep_width=widths, coverage=coverage)
        for widths, coverage in sortie.changed
    ]
    return [sortie, *after]


class SortieByState:
    """One sortie in one run, with the interface of drift.evidence.filter.exposure.SortieExposure."""

    def __init__(self, parts: Sequence[SortieExposure], scenarios: Sequence[Scenario]) -> None:
        """Set up a sortie from its exposures, one for each number of a state."""
        self._parts, self._scenarios = tuple(parts), scenarios
        first = self._parts[0]
        self.sortie, self.begin, self.end = first.sortie, first.begin, first.end
        self.chances, self.key, self.as_flown = first.chances, first.key, first.as_flown
        self.growth = first.growth  # states differ in sweep width and coverage alone
        self._exposed_until = self.begin

    @property
    def exposed(self) -> tuple[Exposed | None, ...]:
        """The exposure to each part so far."""
        return tuple(part.exposed for part in self._parts)

    @exposed.setter
    def exposed(self, none: None) -> None:
        for part in self._parts:
            part.exposed = none

    @property
    def markers(self) -> list[Marker]:
        """Its markers without known tracks: those of the first state, which all states share."""
        return self._parts[0].markers

    def drift(self, forcing: Forcing, elapsed: int, duration: int) -> None:
        """Move the markers of all parts over a step; the forcing must be set for the step."""
        for part in self._parts:
            part.drift(forcing, elapsed, duration)

    def expose(
        self,
        ensemble: Ensemble,
        begin: Begin,
        helm: Helm | None,
        step: Step,
        until: int,
        keep: bool = True,
    ) -> list[Exposed]:
        """Return the exposure of each particle in each state: see SortieExposure.expose."""
        first, last = max(self._exposed_until, step.elapsed, self.begin), min(until, self.end)
        if keep:
            self._exposed_until = max(last, self._exposed_until)
        middle = 0.5 * (first + last)
        state = changes.state_at(ensemble, middle, afloat=self._scenarios)
        return [
            part.expose(ensemble, begin, helm, step, until, keep, state == number)
            for number, part in enumerate(self._parts)
        ]

    @property
    def columns(self) -> dict[str, Any]:
        """The columns of its exposures by name and number of the state."""
        return {
            f"{name}_{number}": column
            for number, part in enumerate(self._parts)
            for name, column in part.columns.items()
        }

    def ready(self, n: int) -> list[Exposed]:
        """Return its exposures of n particles; create empty columns on the first call."""
        return [part.ready(n) for part in self._parts]

    def fail(
        self,
        ensemble: Ensemble,
        exposed: Sequence[Exposed],
        shared: Any | None,
        log_weight: Any,
        keep: bool,
        growth: Array | None,
    ) -> None:
        """Multiply weights by the probability that it has missed each particle in all its states.

        The arguments are those of `drift.evidence.filter.exposure.SortieExposure.fail`.
        """
        several = len(self.chances)
        if several > 1 and not keep:  # its parts share the unknown
            n = ensemble.n * (several if growth is None else 1)
            shared = runtime.empty(n) if shared is None else runtime.copy(shared)
        for part, own in zip(self._parts, exposed, strict=True):
            part.fail(ensemble, own, shared, log_weight, keep=True, growth=growth)

    def searched(self) -> Array:
        """Return the share of the sortie's time that each particle was in its area, float64 (n,)."""
        every = sum(part.searched() for part in self._parts)
        return np.minimum(np.asarray(every, np.float64), 1.0)
