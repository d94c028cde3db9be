"""Recording of marginal posteriors of a run: before the first update and after each."""

import numpy as np

from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.steering import family
from drift.engine.particles.columns import Columns
from drift.evidence.posterior import marginal
from drift.evidence.posterior.marginal import TURN, Marginal
from drift.evidence.posterior.quantities import QUANTITIES, of_axis
from drift.evidence.posterior.quantity import Quantity
from drift.evidence.posterior.records import Posteriors, RangedQuantity, Stage
from drift.evidence.posterior.source import Source


class Beliefs:
    """The marginal posteriors of a run; `note` records one stage."""

    def __init__(self, spec: EnsembleSpec, columns: Columns, source: Source) -> None:
        """Record the prior of particles that have just been drawn.

        Args:
            spec: what the particles were drawn from.
            columns: with their `log_weight`.
            source: their quantities.
        """
        self._spec, self.source = spec, source
        self._stages: list[Stage] = []
        told = (
            _told(quantity, source.columns(quantity, None), columns, spec)
            for quantity in QUANTITIES
        )
        self._told = [one for one in told if one is not None]
        self._own = {
            quantity.name: np.arange(len(spec.scenarios))
            for quantity in QUANTITIES
            if quantity.by_scenario
        }
        for place, own in enumerate(
            family.axes_of_scenarios([scenario.family for scenario in spec.scenarios]), 1
        ):
            # otherwise only one scenario has any weight
            if self._told and self._told[0].quantity.by_scenario:
                quantity = of_axis(own.axis)
                self._told.insert(place, RangedQuantity(quantity, 0.0, 0.0, own.axis.labels))
                self._own[quantity.name] = own.number
        self.note("before the first update", "prior", spec.period.start, columns)

    def note(self, name: str, kind: str, time: np.datetime64, columns: Columns) -> None:
        """Record the marginals after an update.

        Args:
            name: of the update.
            kind: of the update.
            time: of the update.
            columns: `log_weight` and, after resampling, `lineage`; see filter.account.Noted.
        """
        if not self._told:
            return
        own = marginal.weighted(columns)
        told = tuple(self._marginal_of(told, own, time) for told in self._told)
        scenarios = own.total[:-1] / own.total[-1]
        self._stages.append(
            Stage(len(self._stages), name, kind, time, float(own.ess[-1]), scenarios, told)
        )

    @property
    def posteriors(self) -> Posteriors | None:
        """All recorded stages; None if all particles are equal in every quantity."""
        if not self._told:
            return None
        names = tuple(scenario.name for scenario in self._spec.scenarios)
        families = tuple(scenario.family for scenario in self._spec.scenarios)
        return Posteriors(
            names, self._spec.period, tuple(self._told), tuple(self._stages), families
        )

    def _marginal_of(
        self, told: RangedQuantity, own: marginal.Weighted, time: np.datetime64
    ) -> Marginal:
        if told.quantity.by_scenario:
            return marginal.of_scenarios(own, self._own[told.quantity.name], len(told.labels))
        found = self.source.columns(told.quantity, time)
        assert found is not None
        if told.quantity.kind == "category":
            return marginal.of_category(own, found, len(told.labels))
        if told.quantity.kind == "circular":
            return marginal.of_angle(own, found)
        return marginal.of_number(own, found, told.low, told.high)


def _told(
    quantity: Quantity, found: Columns | None, columns: Columns, spec: EnsembleSpec
) -> RangedQuantity | None:
    """Return a quantity with its range in a run.

    Return None if all particles with weight have the same value for good.
    """
    ends = []
    for _, values, holds, log_weight in (
        (found | columns).parts("values", "holds", "log_weight") if found else ()
    ):
        own = values[holds & (log_weight > -np.inf)].astype(np.float64)
        ends += [own.min(), own.max()] if own.size else []
    if not ends or (min(ends) == max(ends) and not quantity.later):
        return None
    low, high = (0.0, TURN) if quantity.kind == "circular" else (float(min(ends)), float(max(ends)))
    return RangedQuantity(quantity, low, high, quantity.labels(spec) if quantity.labels else ())
