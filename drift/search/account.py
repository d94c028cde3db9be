"""What is told of each sortie, contact and word of a sensor, made from what it did to all particles of a run.

The filter (drift.search.filter) hands over an event as it takes effect, with columns of all particles. Where the run is
in shards these were taken down and put together; so what is told has the same bits for any number of them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drift.motion.ensemble_spec import EnsembleSpec
from drift.particles import weights
from drift.particles.ensemble import Layout
from drift.particles.weights import Weighed
from drift.search.crossings import Crossings
from drift.search.records import Kind, Sortie
from drift.search.standing import Standing, standing
from drift.search.updates import Update, Updates
from geo.array import Array
from geo.errors import UserError

# Takes an update, the log weights (n,) before and after it, and the particle of the begin from which each descends
# (n,); None: itself.
Noted = Callable[[Update, Array, Array, Array | None], None]


@dataclass(frozen=True)
class Event:
    """Something that took effect, and columns (n,) of the particles that are here, each made when it is asked for.

    before, after: log weights. release [s after start]. lineage: the particle of the begin from which each descends, where
    any has been drawn anew. never: share of the time that no sortie searched it. Of a sortie also searched: the same share of
    this one; there: whether it lay ashore, or had run aground.
    """

    name: str
    kind: Kind
    time: np.datetime64
    layout: Layout
    columns: Mapping[str, Callable[[], Array]]
    unit: float = 0.0  # log of what `after` is in units of: it belongs to the evidence, and not to the weights
    middle: float = 0.0  # of a sortie [s after start]
    certain: bool = True  # whether it is told even if it says nothing new

    def column(self, name: str) -> Array | None:
        """Return a column; None where there is none."""
        made = self.columns.get(name)
        return None if made is None else made()

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]()


class Account:
    """All updates of a run, in the order in which they took effect."""

    def __init__(self, spec: EnsembleSpec, noted: Noted | None = None) -> None:
        """Make ready; noted: is told of each update."""
        self.updates: list[Update] = []
        self._spec, self._noted = spec, noted
        self._prior = np.zeros(len(spec.scenarios))
        self._missed = np.ones(len(spec.scenarios) + 1)  # product of 1 - POS so far
        self._least = np.inf  # effective particles after any update

    def begin(self, log_weight: Array, layout: Layout) -> None:
        """Take down the prior, by log weights (n,)."""
        self._prior = weights.weighed(log_weight, layout.blocks).scenarios

    def told(self, sorties: Sequence[Callable[[int], Sortie]], crossings: Crossings | None) -> Updates:
        """Return what has happened; sorties: each as it was flown, if a scenario, by number, is true."""
        last = self.updates[-1].posterior if self.updates else self._prior
        flown = tuple(
            sortie(int(np.argmax(last))) for sortie in sorties
        )  # they drift with their markers in the likeliest
        names = tuple(scenario.name for scenario in self._spec.scenarios)
        return Updates(names, self._prior, tuple(self.updates), flown, crossings)

    def take(self, event: Event) -> None:
        """Take an update down. Raises UserError where it leaves no particle any weight."""
        before, after = event["before"], event["after"]
        if not (event.certain or ((before > -np.inf) & (after == -np.inf)).any()):
            return
        blocks, lineage, never = event.layout.blocks, event.column("lineage"), event.column("never")
        then, now = weights.weighed(before, blocks), weights.weighed(after, blocks)
        evidence = self._evidence(then, now, event)

        def effective(log_weight: Array, weighed: Weighed) -> float:
            """Return the effective number of particles, copies as one (drift.forecast.effective)."""
            if lineage is None:
                return weighed.ess
            return weights.effective(blocks.grouped(lineage, weights.relative(log_weight)))

        ess = effective(after, now)
        self._least = min(self._least, ess)
        update = Update(
            event.name, event.kind, event.time, evidence, now.scenarios, effective(before, then), ess,
            standing=standing(event.time, event["release"], blocks, after, never, self._least, self._spec.period.duration),
            distinct=self.updates[-1].distinct if self.updates else 1.0,
        )  # fmt: skip
        if event.kind == "sortie":
            update = self._found(update, event, before, after)
        self.updates.append(update)
        if self._noted is not None:
            self._noted(update, before, after, lineage)

    def drawn_anew(self, log_weight: Array, lineage: Array, layout: Layout, many: int) -> None:
        """Take down that particles were drawn anew after the last update: their log weights and lineage (n,).

        many: of them at first.
        """
        distinct = len(np.unique(lineage[log_weight > -np.inf])) / many
        ess = weights.weighed(log_weight, layout.blocks).ess
        self.updates[-1] = replace(self.updates[-1], ess_resampled=ess, distinct=distinct)

    def _found(self, update: Update, event: Event, before: Array, after: Array) -> Update:
        """Return an update with what is told of a sortie that found nothing."""
        pos = np.nan_to_num(-np.expm1(update.log_evidence))  # a scenario that had no weight finds nothing
        self._missed = self._missed * (1 - pos)
        weight, alive = weights.relative(before), None
        lost = weight - weights.relative(after, before)
        if any(scenario.survival for scenario in self._spec.scenarios):
            alive = self._mean(event, lost * self._alive(event), weight)
        return replace(
            update,
            poc=self._mean(event, np.maximum(weight * event["searched"], lost), weight),
            pos=pos,
            ashore=self._mean(event, lost * event["there"], weight),
            alive=alive,
            cumulative=1 - self._missed,
        )

    def _evidence(self, then: Weighed, now: Weighed, event: Event) -> Array:
        """Return the log of mean weight after over before, by scenario and of all; refuse what no scenario allows."""
        whole = now.log_sum - then.log_sum
        with np.errstate(invalid="ignore"):  # NaN for a scenario that had no weight before
            sums = now.log_sums - then.log_sums
        if not np.isfinite(whole):
            names = ", ".join(f'"{s.name}"' for s in self._spec.scenarios)
            raise UserError(
                f'{event.kind} "{event.name}" contradicts every scenario ({names}): after it no particle has any weight, '
                "and nothing can be said. Check its place, time and error, or allow for doubt: a POD or detection below 1, "
                "a belief below 1, false alarms, or a wider prior"
            )
        return np.array([*sums, whole]) + event.unit

    def _mean(self, event: Event, part: Array, weight: Array) -> Array:
        """Return a part of the weight as a share, by scenario and of all; 0 where there is no weight."""
        sums = event.layout.blocks.partial(part, weight)
        over, under = np.concatenate([sums.by_scenario[:, 0], sums.total]).T
        return np.asarray(np.divide(over, under, out=np.zeros(len(under)), where=under > 0))

    def _alive(self, event: Event) -> Array:
        """Return each particle's chance of being alive in the middle of a sortie; 1 without survival times."""
        release, bounds = event["release"], event.layout.bounds
        alive = np.ones(len(release))
        for scenario, a, b in zip(self._spec.scenarios, bounds[:-1], bounds[1:], strict=True):
            if scenario.survival:
                alive[a:b] = scenario.survival.alive(event.middle - release[a:b])
        return alive


def begun(spec: EnsembleSpec, log_weight: Array, release: Array, layout: Layout) -> Standing:
    """Return how a search stands before any sortie or contact."""
    ess = weights.weighed(log_weight, layout.blocks).ess
    return standing(spec.period.start, release, layout.blocks, log_weight, None, ess, spec.period.duration)
