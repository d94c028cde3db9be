"""The POS of each sortie of a run, and the influence of each sampling unit on it."""

from dataclasses import dataclass, field

import numpy as np

from drift.assess.compare.figures import Figures
from drift.assess.compare.units import Figure, SamplingUnits
from drift.engine.particles import weights
from drift.engine.particles.columns import Columns
from drift.evidence.filter.updates import Update
from drift.planning.search.records import Plan


@dataclass
class SortieLog:
    """The sorties of a run: log probability that each fails, and each unit's influence on it."""

    units: SamplingUnits
    found: dict[str, Figure] = field(default_factory=dict)

    def note(self, update: Update, columns: Columns) -> None:
        """Record a sortie; this is the update callback of drift.evidence.filter.account."""
        if update.kind != "sortie":
            return
        unit = columns.whole("lineage") if "lineage" in columns else np.arange(columns.blocks.n)
        failed, flown = (
            np.bincount(unit, weights.shares(columns.whole(name)), self.units.size)
            for name in ("after", "before")
        )
        self.found[update.name] = Figure(float(update.log_evidence[-1]), failed - flown)

    def figures(self, names: tuple[str, ...]) -> Figures:
        """Return the POS of the named sorties, and the cumulative POS of all sorties of the run."""
        found: Figures = {("POS", name, "1"): _pos([self.found[name]]) for name in names}
        if self.found:
            found["cumulative POS", "all", "1"] = _pos(list(self.found.values()))
        return found


def pos_of_plan(log: SortieLog, plan: Plan) -> Figures:
    """Return the POS of a plan, from the log of the run that executed it without success."""
    return {
        ("POS of the next plan", "all", "1"): _pos(
            [log.found[tasking.sortie.name] for tasking in plan.taskings]
        )
    }


def _pos(sorties: list[Figure]) -> Figure:
    """Return the probability that any of the sorties detects the object: 1 - product of misses."""
    fail = float(np.exp(sum(figure.value for figure in sorties)))
    return Figure(1 - fail, -fail * np.sum([figure.influence for figure in sorties], axis=0))
