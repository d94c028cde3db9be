"""Beliefs: taken down of the particles of a run before the first and after each update."""

import numpy as np

from drift.motion.ensemble_spec import EnsembleSpec
from drift.particles import weights
from drift.posterior import marginal
from drift.posterior.marginal import TURN, Laid, Marginal, Weighted
from drift.posterior.quantities import QUANTITIES
from drift.posterior.quantity import Quantity, Values
from drift.posterior.records import Posteriors, Stage, Told
from drift.posterior.source import Source
from geo.array import Array


class Beliefs:
    """What is believed of the quantities of a run; `note` takes it down."""

    def __init__(self, spec: EnsembleSpec, log_weight: Array, source: Source) -> None:
        """Take down the prior of particles that have just been drawn from `spec`, by log weights (n,)."""
        self._spec, self.source = spec, source
        self._laid: dict[str, Laid] = {}
        self._stages: list[Stage] = []
        told = (_told(quantity, source.values(quantity), log_weight > -np.inf, spec) for quantity in QUANTITIES)
        self._told = [one for one in told if one is not None]
        self.note("before the first update", "prior", spec.period.start, log_weight)

    def note(self, name: str, kind: str, time: np.datetime64, log_weight: Array, lineage: Array | None = None) -> None:
        """Take down what is believed by log weights (n,) after an update; lineage: see search.filter.Noted."""
        if not self._told:
            return
        own = marginal.weighted(weights.relative(log_weight), self.source.blocks, lineage)
        told = tuple(self._marginal(told, own) for told in self._told)
        ess = float(own.ess[-1])
        scenarios = own.total[:-1] / own.total[-1]
        self._stages.append(Stage(len(self._stages), name, kind, time, ess, scenarios, told))

    @property
    def posteriors(self) -> Posteriors | None:
        """All that has been taken down; None: no two particles differ in any quantity."""
        if not self._told:
            return None
        names = tuple(scenario.name for scenario in self._spec.scenarios)
        return Posteriors(names, self._spec.period, tuple(self._told), tuple(self._stages))

    def _marginal(self, told: Told, own: Weighted) -> Marginal:
        found = self.source.values(told.quantity)
        assert found is not None
        if told.quantity.kind == "category":
            return marginal.of_category(own, found.values, found.holds, len(told.labels))
        circular, name = told.quantity.kind == "circular", told.quantity.name
        laid = self._laid.get(name)
        if laid is None or not np.array_equal(laid.values, found.values):  # they have been drawn anew
            laid = marginal.angles(found.values) if circular else marginal.numbers(found.values, told.low, told.high)
            self._laid[name] = laid
        return (marginal.of_angle if circular else marginal.of_number)(own, laid, found.holds)


def _told(quantity: Quantity, found: Values | None, alive: Array, spec: EnsembleSpec) -> Told | None:
    """Return a quantity as it is in a run; None where no two of the particles that are alive differ in it."""
    if found is None or not (holds := found.holds & alive).any():
        return None
    values = found.values[holds].astype(np.float64)
    low, high = float(values.min()), float(values.max())
    if low == high:
        return None
    if quantity.kind == "circular":
        low, high = 0.0, TURN
    return Told(quantity, low, high, quantity.labels(spec) if quantity.labels else ())
