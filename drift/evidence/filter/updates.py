"""What each sortie, contact and sensor did to the probability: the record behind tables, pictures
and the debrief.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from drift.evidence.filter.crossings import Crossings
from drift.evidence.filter.records import Kind, Sortie
from drift.evidence.filter.standing import Standing
from drift.forecast import likeliest
from drift.forecast.likeliest import Shown
from geo.array import Array


@dataclass(frozen=True)
class Update:
    """One sortie, contact or word of a sensor, when it took effect.

    Arrays, unless they say otherwise, have shape (scenarios + 1,): each scenario, then all
    together.
    """

    name: str
    kind: Kind
    time: np.datetime64
    # log probability (density) of the sortie's failure, or of what was told, given all before
    log_evidence: Array
    posterior: Array  # (scenarios,) probability of each scenario afterwards
    ess_before: float
    ess_after: float
    poc: Array | None = None  # probability that the object was where the sortie searched
    # 1 - exp(log_evidence): probability that it would have found the object
    pos: Array | None = None
    # part of pos that is of what lies ashore, or has run aground, at its end
    ashore: Array | None = None
    # probability that it would have found the object alive; only with survival times
    alive: Array | None = None
    cumulative: Array | None = None  # 1 - product of (1 - pos) over the sorties so far
    ess_resampled: float | None = None  # after particles were drawn again, if they were
    standing: Standing | None = None  # how the search stands then
    # "contact": particles were placed again where it may have been; "lost": it left too few for a
    # track; "": neither
    filled: Literal["", "contact", "lost"] = ""
    # share of the original particles that still have descendants, after this update
    distinct: float = 1.0

    @property
    def resampled(self) -> bool:
        """Whether particles were drawn again after it."""
        return self.ess_resampled is not None

    @property
    def left(self) -> float:
        """How many particles count from it on: copies add nothing, but what is placed again does."""
        return (
            self.ess_after
            if self.ess_resampled is None or self.filled != "contact"
            else self.ess_resampled
        )

    @property
    def pod(self) -> Array | None:
        """Probability of detection, given that the object was where the sortie searched: POS / POC."""
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
        """Log probability (density) of everything that was seen."""
        return float(sum(update.log_evidence[-1] for update in self.all))


def shown_of(updates: Updates) -> Shown:
    """Return which scenarios are shown: those that were the likeliest at any time."""
    return likeliest.likeliest_scenarios(
        [updates.prior, *(update.posterior for update in updates.all)]
    )


def together(updates: Updates) -> Updates:
    """Return the same with the likeliest scenarios and all others as one, where there are many."""
    shown = shown_of(updates)
    if not shown.rest:
        return updates
    every: list[Update] = []
    before, missed = np.asarray(updates.prior, float), np.ones(shown.size + 1)
    for update in updates.all:
        # nothing is known of what had no weight
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
    """Return means by scenario, then of all (scenarios + 1,), as those that are shown have them,
    (size + 1,).
    """
    return np.append(shown.means(np.nan_to_num(values[:-1]), weight), values[-1])
