"""Summaries of updates: the effect of each sortie, contact and sensor on all particles of a run.

The filter (drift.evidence.filter.filter) passes on an event as it takes effect, with columns of all
particles, which are read in parts. In a run with shards, the shards have stored these columns. The
summary has the same bits for any number of shards.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.particles import partials, weights
from drift.engine.particles.columns import Columns
from drift.engine.particles.ensemble import Layout
from drift.engine.particles.partials import Blocks
from drift.engine.particles.weights import WeightSums
from drift.evidence.filter.crossings import Crossings
from drift.evidence.filter.records import Kind, Sortie
from drift.evidence.filter.standing import SearchStatus, search_status
from drift.evidence.filter.updates import Update, Updates
from geo.array import Array
from geo.errors import UserError

# Takes an update, and columns of all particles: log weights `before` and `after` it and, after any
# resampling, `lineage`, the initial particle from which each descends.
UpdateCallback = Callable[[Update, Columns], None]


@dataclass(frozen=True)
class Event:
    """An update as it takes effect, with columns of the particles at that time.

    Columns: `before` and `after`, log weights; `release` [s after start], and of objects whose state changes `law`, the survival time
    that counts from it (drift.engine.motion.changes); `lineage`, the initial
    particle from which each descends, only after resampling; `never`, the product over sorties of
    the share of time that none searched the particle, only after a sortie. A sortie adds
    `searched`, the share of its time that it searched the particle, and `there`, whether the
    particle was stranded.
    """

    name: str
    kind: Kind
    time: np.datetime64
    columns: Columns
    # log of the unit of the likelihood: a factor of the evidence that the weights leave out
    unit: float = 0.0
    middle: float = 0.0  # middle time of a sortie [s after start]
    certain: bool = True  # whether it is reported even if it sets no weight to zero


class Account:
    """All updates of a run, in the order in which they took effect."""

    def __init__(self, spec: EnsembleSpec, noted: UpdateCallback | None = None) -> None:
        """Set up an empty account; noted: callback for each update."""
        self.updates: list[Update] = []
        self._spec, self._noted = spec, noted
        self._prior = np.zeros(len(spec.scenarios))
        self._failure_probability = np.ones(len(spec.scenarios) + 1)  # product of 1 - POS so far
        self._lowest_ess = np.inf  # effective particles after any update

    def begin(self, columns: Columns) -> None:
        """Store the prior probability of each scenario, from the `log_weight` of the particles."""
        self._prior = _weighed(columns, "log_weight").scenarios

    def told(
        self, sorties: Sequence[Callable[[int], Sortie]], crossings: Crossings | None
    ) -> Updates:
        """Return all updates of the run.

        Args:
            sorties: functions that return each sortie as flown, given the number of the true
                scenario.
            crossings: of the lines of the case, if it has any.
        """
        last = self.updates[-1].posterior if self.updates else self._prior
        flown = tuple(
            sortie(int(np.argmax(last))) for sortie in sorties
        )  # drifting patterns follow their markers in the likeliest scenario
        names = tuple(scenario.name for scenario in self._spec.scenarios)
        return Updates(names, self._prior, tuple(self.updates), flown, crossings)

    def take(self, event: Event) -> None:
        """Record an update.

        Raises:
            UserError: no particle has any weight after it.
        """
        columns = event.columns
        if not event.certain and not _rules_out_particles(columns):
            return
        then, now = (_weighed(columns, name) for name in ("before", "after"))
        evidence = self._evidence(then, now, event)
        ess = _effective(columns, "after", now)
        self._lowest_ess = min(self._lowest_ess, ess)
        update = Update(
            event.name,
            event.kind,
            event.time,
            evidence,
            now.scenarios,
            _effective(columns, "before", then),
            ess,
            standing=search_status(
                event.time,
                columns.named("after", "log_weight"),
                self._lowest_ess,
                self._spec.period.duration,
            ),
            distinct=self.updates[-1].distinct if self.updates else 1.0,
        )
        if event.kind == "sortie":
            update = self._with_sortie_results(update, event, then.largest)
        self.updates.append(update)
        if self._noted is not None:
            self._noted(update, columns)

    def drawn_anew(self, log_weight: Array, lineage: Array, layout: Layout, many: int) -> None:
        """Record that particles were resampled after the last update.

        Args:
            log_weight: of the resampled particles, shape (n,).
            lineage: initial particle of each, shape (n,).
            layout: their slots by scenario.
            many: number of initial particles.
        """
        distinct = len(np.unique(lineage[log_weight > -np.inf])) / many
        ess = weights.sum_weights(log_weight, layout.blocks).ess
        self.updates[-1] = replace(self.updates[-1], ess_resampled=ess, distinct=distinct)

    def filled(self, log_weight: Array, layout: Layout) -> None:
        """Record that particles were repopulated after the last update, a contact.

        log_weight: of all particles, (n,).
        """
        ess = weights.sum_weights(log_weight, layout.blocks).ess
        self.updates[-1] = replace(self.updates[-1], ess_resampled=ess, filled="contact")

    def lost(self) -> None:
        """Record that the last update left too few particles, so that the track is lost."""
        self.updates[-1] = replace(self.updates[-1], filled="lost")

    def _with_sortie_results(self, update: Update, event: Event, top: float) -> Update:
        """Return a sortie's update with POC, POS and its parts; top: largest log weight before."""
        # POS of a scenario without weight is 0
        pos = np.nan_to_num(-np.expm1(update.log_evidence))
        self._failure_probability = self._failure_probability * (1 - pos)
        survival, sums = any(scenario.survival for scenario in self._spec.scenarios), []
        names = ("before", "after", "searched", "there", "release", "law")
        for blocks, before, after, searched, there, release, law in event.columns.parts(*names):
            weight = weights.relative(before, top)
            lost = weight - weights.relative(after, top)
            parts = [weight, np.maximum(weight * searched, lost), lost * there]
            if survival:
                parts.append(lost * self._alive(blocks, release, law, event.middle))
            sums.append(blocks.partial(*parts))
        merged = partials.merge_partials(sums)
        under, *over = np.concatenate([merged.by_scenario[:, 0], merged.total]).T
        poc, ashore, *alive = (
            np.divide(part, under, out=np.zeros(len(under)), where=under > 0) for part in over
        )
        return replace(
            update,
            poc=poc,
            pos=pos,
            ashore=ashore,
            alive=alive[0] if alive else None,
            cumulative=1 - self._failure_probability,
        )

    def _evidence(self, then: WeightSums, now: WeightSums, event: Event) -> Array:
        """Return the log of mean weight after over before, by scenario and of all.

        Raise UserError if the update contradicts every scenario.
        """
        log_ratio = now.log_sum - then.log_sum
        with np.errstate(invalid="ignore"):  # NaN for a scenario that had no weight before
            log_ratios = now.log_sums - then.log_sums
        if not np.isfinite(log_ratio):
            names = ", ".join(f'"{s.name}"' for s in self._spec.scenarios)
            raise UserError(
                f'{event.kind} "{event.name}" contradicts every scenario ({names}): after it no particle has any weight, '
                "and nothing can be said. Check its place, time and error, or allow for doubt: a POD or detection below 1, "
                "a belief below 1, false alarms, or a wider prior"
            )
        return np.array([*log_ratios, log_ratio]) + event.unit

    def _alive(self, blocks: Blocks, release: Array, law: Array | None, middle: float) -> Array:
        """Return the probability of being alive at the middle of a sortie, of each particle.

        It is 1 for scenarios without survival times.
        """
        alive = np.ones(blocks.n)
        for number, own in zip(blocks.scenario, blocks.spans, strict=True):
            for which, survival in enumerate(self._spec.scenarios[number].survivals):
                if survival is None:
                    continue
                held = True if law is None else law[own] == which
                alive[own] = np.where(held, survival.alive(middle - release[own]), alive[own])
        return alive


def _weighed(columns: Columns, name: str) -> WeightSums:
    """Return the sums of a column of log weights, merged over all blocks."""
    return weights.merge_weight_sums(
        [weights.sum_weights(log_weight, blocks) for blocks, log_weight in columns.parts(name)]
    )


def _rules_out_particles(columns: Columns) -> bool:
    """Return whether an update takes all of its weight from any particle."""
    parts = columns.parts("before", "after")
    return any(((before > -np.inf) & (after == -np.inf)).any() for _, before, after in parts)


def _effective(columns: Columns, name: str, own: WeightSums) -> float:
    """Return the effective sample size by a column of log weights, counting copies as one.

    See drift.forecast.effective.
    """
    if "lineage" not in columns:
        return own.ess
    runs = [
        blocks.runs(lineage, weights.relative(log_weight, own.largest))
        for blocks, lineage, log_weight in columns.parts("lineage", name)
    ]
    family, weight = (np.concatenate(column) for column in zip(*runs, strict=True))
    return weights.effective(np.bincount(family, weight))


def initial_status(spec: EnsembleSpec, columns: Columns) -> SearchStatus:
    """Return the status of a search before any update, from `log_weight` and `release`."""
    return search_status(
        spec.period.start, columns, _weighed(columns, "log_weight").ess, spec.period.duration
    )
