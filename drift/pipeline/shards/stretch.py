"""A stretch of a shard's run: until its particles have to meet those of all others, or the run is
over.

They meet where a doubtful contact asks how likely it was by all particles, and after a step in
which something took effect if particles may be drawn again. There a shard stops. Before a contact
it leaves its state as it was at the begin of the step, which is made again once the answer is
known; nothing of that step counts until then.

What took effect is taken down in the shard's reel, with all columns from which it is told later
(drift.pipeline.shards.told).
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.spool import ShardFile
from drift.engine.particles.ensemble import Layout
from drift.engine.particles.partials import Blocks, Partial
from drift.engine.particles.weights import Weighed
from drift.evidence.filter import crossings
from drift.evidence.filter.account import Event
from drift.evidence.filter.filter import SearchFilter
from drift.evidence.filter.meeting import Drawn
from drift.evidence.filter.records import Contact
from drift.evidence.posterior.quantities import QUANTITIES
from drift.evidence.posterior.source import Particles
from geo.array import Array

EVENTS, RESULT = "events", "result"  # notes: what took effect, and why a stretch ended


class Result(NamedTuple):
    """Why and when a stretch of a shard ended."""

    # [s after start] at which the next goes on; None: from the run's start
    since: int | None = None
    contact: int | None = None  # number of the contact whose mean likelihood it has to know
    anew: bool = False  # whether particles may have to be drawn anew

    @property
    def over(self) -> bool:
        """Whether the run is over."""
        return self.contact is None and not self.anew


class Stop(Exception):
    """A shard has to meet the others."""


class Stretch:
    """One stretch of a shard: a drift.evidence.filter.meeting.Meeting that stops where it does not
    know.
    """

    def __init__(
        self,
        reel: ShardFile,
        state: ShardFile,
        contacts: Sequence[tuple[int, Contact]],
        known: Mapping[int, float],
        since: int | None,
        read: Particles | None,
    ) -> None:
        """Make ready.

        reel: takes what happens; state: what particles are like at the end. contacts: with their
        times [s after start]; known: log mean likelihoods of doubtful ones, by number. since: when
        it begins; read: where quantities of posteriors are read.
        """
        self._reel, self._state, self._read, self._known = reel, state, read, known
        self._doubts = [
            time
            for number, (time, contact) in enumerate(contacts)
            if contact.belief < 1 and contact.false_density == 0 and number not in known
        ]
        self.search: SearchFilter | None = None
        self.since, self._until = since, since or 0
        self._events: list[dict[str, object]] = []
        self._mark = 0, 0  # events and moments that count, whatever comes of the present step

    def drawn(self, log_weight: Array, release: Array) -> None:
        """Take down what particles are at the begin of the run."""
        self._reel.note("log_weight", log_weight)
        self._reel.note("release", release)
        self._values("begin")

    def begin(self, elapsed: int, until: int) -> None:
        """Take note that a step is about to be made; keep the state where it will not be known how
        it goes on.
        """
        self._until = until
        if (
            elapsed > 0
            and elapsed != self.since
            and any(elapsed < time <= until for time in self._doubts)
        ):
            self._mark = len(self._events), len(self._reel.taken)
            self._keep(elapsed)

    def take(self, event: Event) -> None:
        """Take down an event."""
        number = len(self._events)
        for name in event.columns.read:
            self._reel.note(f"{number} {name}", event.columns.whole(name))
        self._values(str(number))
        told = {
            "name": event.name,
            "kind": event.kind,
            "time": str(event.time),
            "columns": list(event.columns.read),
        }
        self._events.append(
            {**told, "unit": event.unit, "middle": event.middle, "certain": event.certain}
        )

    def mean(self, contact: int, before: Weighed, after: Weighed) -> float:
        """Return the log of the mean likelihood of a contact, or stop to ask for it."""
        if contact in self._known:
            return self._known[contact]
        many, moments = self._mark
        del self._events[many:], self._reel.taken[moments:]
        for name, weighed in (("before", before), ("after", after)):
            self._reel.note(f"{name} top", weighed.top)
            self._reel.note(f"{name} sums", weighed.part.sums.ravel())
        self.ended(Result(self.since, contact=contact))
        raise Stop

    def anew(self, log_weight: Array, layout: Layout) -> Drawn | None:
        """Stop to ask whether particles are drawn again."""
        self._keep(self._until)
        self.ended(Result(self.since, anew=True))
        raise Stop

    def over(self) -> None:
        """Record the end-of-run summary."""
        if self.search is not None:
            self._reel.note("unsearched", self.search.unsearched.whole("unsearched"))
            for name, column in crossings.columns_of(self.search.watched).items():
                self._reel.note(name, column)
            for number, marker in enumerate(self.search.markers):
                self._reel.note(f"marker {number}", marker.way.ravel())
        self.ended(Result(self.since))

    def ended(self, result: Result) -> None:
        """Take down all that happened, and why the stretch ended."""
        self._reel.note(EVENTS, _text(self._events))
        self._reel.note(RESULT, _text(result._asdict()))

    def _keep(self, time: int) -> None:
        """Keep the state of all particles at a time at which a step begins."""
        assert self.search is not None
        for name, column in self.search.columns.items():
            self._state.note(name, column.to_numpy())
        for number, marker in enumerate(self.search.markers):
            self._state.note(f"marker {number}", marker.way.ravel())
        self.since = time

    def _values(self, of: str) -> None:
        """Take down what particles have of the quantities of which posteriors are told."""
        for quantity in QUANTITIES:
            found = self._read.columns(quantity) if self._read else None
            if found is not None:
                for name in found.read:
                    self._reel.note(f"{of} {quantity.name} {name}", found.whole(name))


def events(reel: ShardFile) -> list[dict[str, Any]]:
    """Return what took effect in a stretch."""
    return list(_read(reel, EVENTS))


def result(reel: ShardFile) -> Result:
    """Return why a stretch ended."""
    return Result(**_read(reel, RESULT))


def weighed(reel: ShardFile, name: str, blocks: Blocks) -> Weighed:
    """Return the weights before or after a contact of the particles of a shard."""
    sums = reel.noted(f"{name} sums").reshape(-1, 1, 2)
    return Weighed(
        reel.noted(f"{name} top"), Partial(blocks.scenarios, blocks.scenario, blocks.number, sums)
    )


def contacts_of(spec: EnsembleSpec, contacts: Sequence[Contact]) -> list[tuple[int, Contact]]:
    """Return contacts with their times [s after start]."""
    return [(spec.period.elapsed(contact.time), contact) for contact in contacts]


def _text(values: object) -> Array:
    return np.frombuffer(json.dumps(values).encode(), np.uint8)


def _read(reel: ShardFile, name: str) -> Any:
    return json.loads(reel.noted(name).tobytes())
