"""Beliefs: taken down of the particles of a run before the first and after each update."""

import numpy as np

from drift.motion import settled
from drift.motion.ensemble_spec import EnsembleSpec
from drift.motion.settled import Settled
from drift.motion.steer import Steering
from drift.particles import weights
from drift.particles.ensemble import Ensemble
from drift.posterior import marginal
from drift.posterior.marginal import TURN, Laid, Marginal, Weighted
from drift.posterior.quantities import QUANTITIES
from drift.posterior.quantity import Drawn, Quantity
from drift.posterior.records import Posteriors, Stage, Told
from geo.array import Array


class Beliefs:
    """What is believed of the quantities of a run; `note` takes it down."""

    def __init__(self, spec: EnsembleSpec, ensemble: Ensemble, steering: Steering | None) -> None:
        """Take down the prior of an ensemble that has just been drawn from `spec`."""
        self._spec, self._ensemble, self._steering = spec, ensemble, steering
        self._scenario = ensemble.scenario.to_numpy().astype(np.int64)
        self._birth: Array | None = None
        self._settled: Settled | None = None
        self._laid: dict[str, Laid] = {}
        self._stages: list[Stage] = []
        log_weight = ensemble.log_weight.to_numpy()
        drawn, self._told = self._drawn(), []
        for quantity in QUANTITIES:
            told = _told(quantity, drawn, log_weight > -np.inf)
            if told is not None:
                self._told.append(told)
        self.note("before the first update", "prior", spec.period.start, log_weight)

    def note(self, name: str, kind: str, time: np.datetime64, log_weight: Array, lineage: Array | None = None) -> None:
        """Take down what is believed by log weights (n,) after an update; lineage: see search.filter.Noted."""
        if not self._told:
            return
        drawn = self._drawn()
        own = marginal.weighted(weights.relative(log_weight), self._ensemble.blocks, lineage)
        told = tuple(self._marginal(told, drawn, own) for told in self._told)
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

    def _drawn(self) -> Drawn:
        """Return the particles as they are now; what is settled at birth is asked for again if births have changed."""
        if self._steering is not None:
            birth = self._ensemble.own["birth"].to_numpy()
            if self._birth is None or not np.array_equal(birth, self._birth):
                self._birth, self._settled = birth.copy(), settled.read(self._ensemble, self._steering)
        return Drawn(self._spec, self._ensemble, self._scenario, self._settled)

    def _marginal(self, told: Told, drawn: Drawn, own: Weighted) -> Marginal:
        found = told.quantity.of(drawn)
        assert found is not None
        if told.quantity.kind == "category":
            return marginal.of_category(own, found.values, found.holds, len(told.labels))
        circular, name = told.quantity.kind == "circular", told.quantity.name
        laid = self._laid.get(name)
        if laid is None or not np.array_equal(laid.values, found.values):  # they have been drawn anew
            laid = marginal.angles(found.values) if circular else marginal.numbers(found.values, told.low, told.high)
            self._laid[name] = laid
        return (marginal.of_angle if circular else marginal.of_number)(own, laid, found.holds)


def _told(quantity: Quantity, drawn: Drawn, alive: Array) -> Told | None:
    """Return a quantity as it is in a run; None where no two of the particles that are alive differ in it."""
    found = quantity.of(drawn)
    if found is None or not (holds := found.holds & alive).any():
        return None
    values = found.values[holds].astype(np.float64)
    low, high = float(values.min()), float(values.max())
    if low == high:
        return None
    if quantity.kind == "circular":
        low, high = 0.0, TURN
    return Told(quantity, low, high, quantity.labels(drawn.spec) if quantity.labels else ())
