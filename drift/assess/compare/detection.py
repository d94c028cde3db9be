"""What each sortie of a run was worth, and the influence of every unit on it."""

from dataclasses import dataclass, field

import numpy as np

from drift.assess.compare.figures import Figures
from drift.assess.compare.units import Figure, Units
from drift.engine.particles import weights
from drift.engine.particles.columns import Columns
from drift.evidence.filter.updates import Update
from drift.planning.search.records import Plan


@dataclass
class Log:
    """Sorties of a run as they take effect: log probability that they fail, and each unit's
    influence on it.
    """

    units: Units
    found: dict[str, Figure] = field(default_factory=dict)

    def note(self, update: Update, columns: Columns) -> None:
        """Take a sortie down, by what drift.evidence.filter.account.Noted is given."""
        if update.kind != "sortie":
            return
        unit = columns.whole("lineage") if "lineage" in columns else np.arange(columns.blocks.n)
        failed, flown = (
            np.bincount(unit, weights.shares(columns.whole(name)), self.units.size)
            for name in ("after", "before")
        )
        self.found[update.name] = Figure(float(update.log_evidence[-1]), failed - flown)

    def figures(self, names: tuple[str, ...]) -> Figures:
        """Return the POS of some sorties, and of all that were flown; of none where there are none."""
        found: Figures = {("POS", name, "1"): _pos([self.found[name]]) for name in names}
        if self.found:
            found["cumulative POS", "all", "1"] = _pos(list(self.found.values()))
        return found


def of_plan(log: Log, plan: Plan) -> Figures:
    """Return the POS of a plan, by the log of the run in which it was executed and found nothing."""
    return {
        ("POS of the next plan", "all", "1"): _pos(
            [log.found[tasking.sortie.name] for tasking in plan.taskings]
        )
    }


def _pos(sorties: list[Figure]) -> Figure:
    """Return the probability that any of some sorties finds the object: 1 - product of those that
    they fail.
    """
    fail = float(np.exp(sum(figure.value for figure in sorties)))
    return Figure(1 - fail, -fail * np.sum([figure.influence for figure in sorties], axis=0))
