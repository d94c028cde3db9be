"""Effects of each sortie, contact and sensor: the data behind tables, pictures and debrief."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from drift.evidence.filter.crossings import Crossings
from drift.evidence.filter.records import Kind, Sortie
from drift.evidence.filter.standing import SearchStatus
from drift.forecast import likeliest
from drift.forecast.likeliest import Shown
from geo.array import Array


@dataclass(frozen=True)
class Update:
    """The effect of one sortie, contact or sensor report.

    Unless stated otherwise, arrays have shape (scenarios + 1,): each scenario, then all together.
    """

    name: str
    kind: Kind
    time: np.datetime64
    # log probability (density) of the failure or report, given all earlier evidence
    log_evidence: Array
    posterior: Array  # (scenarios,) probability of each scenario afterwards
    ess_before: float
    ess_after: float
    poc: Array | None = None  # probability that the object was in the searched area
    # 1 - exp(log_evidence): probability that the sortie would have found the object
    pos: Array | None = None
    # part of pos from particles that are stranded or aground at the end of the sortie
    ashore: Array | None = None
    # probability that it would have found the object alive; only with survival times
    alive: Array | None = None
    cumulative: Array | None = None  # 1 - product of (1 - pos) over the sorties so far
    ess_resampled: float | None = None  # after resampling, if there was any
    standing: SearchStatus | None = None  # status of the search after the update
    # "contact": particles were repopulated from the contact; "lost": too few are left for a track;
    # "": neither
    filled: Literal["", "contact", "lost"] = ""
    # share of the original particles that still have descendants, after this update
    distinct: float = 1.0

    @property
    def resampled(self) -> bool:
        """Whether particles were resampled after it."""
        return self.ess_resampled is not None

    @property
    def left(self) -> float:
        """Effective particles from it on: resampling adds none, but repopulation does."""
        return (
            self.ess_after
            if self.ess_resampled is None or self.filled != "contact"
            else self.ess_resampled
        )

    @property
    def pod(self) -> Array | None:
        """Probability of detection, given that the object was in the searched area: POS / POC."""
        if self.pos is None or self.poc is None:
            return None
        return np.divide(self.pos, self.poc, out=np.zeros_like(self.pos), where=self.poc > 0)


@dataclass(frozen=True)
class Updates:
    """All updates of a run, in the order in which they took effect."""

    scenarios: tuple[str, ...]
    prior: Array  # (scenarios,) probability of each scenario before the first
    all: tuple[Update, ...]
    sorties: tuple[Sortie, ...] = ()  # the sorties as they were flown
    crossings: Crossings | None = None  # of the lines that were asked for

    @property
    def log_evidence(self) -> float:
        """Log probability (density) of all observations."""
        return float(sum(update.log_evidence[-1] for update in self.all))


def displayed_scenarios_of(updates: Updates) -> Shown:
    """Return which scenarios are shown: those that were the likeliest at any time."""
    return likeliest.likeliest_scenarios(
        [updates.prior, *(update.posterior for update in updates.all)]
    )


def merge_unlikely_scenarios(updates: Updates) -> Updates:
    """Return the updates with the likeliest scenarios alone and all others merged into one.

    With few scenarios, the updates are unchanged.
    """
    shown = displayed_scenarios_of(updates)
    if not shown.rest:
        return updates
    every: list[Update] = []
    before, missed = np.asarray(updates.prior, float), np.ones(shown.size + 1)
    for update in updates.all:
        # a scenario without weight has undefined evidence
        with np.errstate(divide="ignore", invalid="ignore"):
            evidence = np.log(_with_all(shown, np.exp(update.log_evidence), before))
        poc, pos, ashore, alive = (
            None if values is None else _with_all(shown, values, before)
            for values in (update.poc, update.pos, update.ashore, update.alive)
        )
        if pos is not None:
            missed = missed * (1 - pos)
        every.append(
            replace(
                update,
                log_evidence=np.append(evidence[:-1], update.log_evidence[-1]),
                poc=poc,
                pos=pos,
                ashore=ashore,
                alive=alive,
                posterior=shown.sums(np.asarray(update.posterior, float)),
                cumulative=None if update.cumulative is None else 1 - missed,
            )
        )
        before = np.asarray(update.posterior, float)
    names = tuple(shown.names(updates.scenarios))
    return replace(
        updates,
        scenarios=names,
        prior=shown.sums(np.asarray(updates.prior, float)),
        all=tuple(every),
    )


def _with_all(shown: Shown, values: Array, weight: Array) -> Array:
    """Return values of the shown scenarios (size + 1,) from those of all (scenarios + 1,).

    Merged scenarios get the mean by weight. The last value is that of all together.
    """
    return np.append(shown.means(np.nan_to_num(values[:-1]), weight), values[-1])
