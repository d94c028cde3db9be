"""A stretch of a shard's run: up to the next reduction across all shards, or the end of the run.

Two things need a reduction: the mean likelihood of a doubtful contact (its evidence), and
resampling, which is considered after each step with an update. The shard stops there. Before a
doubtful contact it stores its state at the start of the step; the step is repeated once the mean
likelihood is known, and its events are discarded until then.

Each update is stored in the shard's file with the columns from which `drift.pipeline.shards.told`
later builds the update's summary.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.spool import ShardFile
from drift.engine.particles.ensemble import Layout
from drift.engine.particles.partials import Blocks, Partial
from drift.engine.particles.weights import WeightSums
from drift.evidence.filter import crossings
from drift.evidence.filter.account import Event
from drift.evidence.filter.filter import SearchFilter
from drift.evidence.filter.meeting import Resampled
from drift.evidence.filter.records import Contact
from drift.evidence.posterior.quantities import QUANTITIES
from drift.evidence.posterior.source import Particles
from geo.array import Array

EVENTS, RESULT = "events", "result"  # stored columns: the updates, and why the stretch ended


class Result(NamedTuple):
    """Why and when a stretch of a shard ended."""

    # [s after start] at which the next stretch resumes; None: at the run's start
    since: int | None = None
    contact: int | None = None  # number of the contact whose mean likelihood is needed
    anew: bool = False  # whether resampling is to be considered

    @property
    def over(self) -> bool:
        """Whether the run is complete."""
        return self.contact is None and not self.anew


class Stop(Exception):
    """A shard needs a reduction across all shards."""


class Stretch:
    """One stretch of a shard: a `Meeting` (drift.evidence.filter.meeting) that stops when it needs
    the other shards.
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
        """Start a stretch.

        Args:
            reel: file of the shard's outputs and updates.
            state: file of the particles' state at the end of the stretch.
            contacts: the contacts with their times [s after start].
            known: log mean likelihoods of doubtful contacts, by number.
            since: start of the stretch [s after start]; None: the run's start.
            read: source of the quantities whose posteriors are reported; None: none is reported.
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
        self._mark = 0, 0  # numbers of events and outputs before the present step

    def drawn(self, log_weight: Array, release: Array) -> None:
        """Store the weights, release times and reported quantities at the start of the run."""
        self._reel.note("log_weight", log_weight)
        self._reel.note("release", release)
        self._values("begin", None)

    def begin(self, elapsed: int, until: int) -> None:
        """Record the start of a step; store the state if a doubtful contact falls into the step."""
        self._until = until
        if (
            elapsed > 0
            and elapsed != self.since
            and any(elapsed < time <= until for time in self._doubts)
        ):
            self._mark = len(self._events), len(self._reel.taken)
            self._keep(elapsed)

    def take(self, event: Event) -> None:
        """Store an update with its columns."""
        number = len(self._events)
        for name in event.columns.read:
            self._reel.note(f"{number} {name}", event.columns.whole(name))
        self._values(str(number), event.time)
        header = {
            "name": event.name,
            "kind": event.kind,
            "time": str(event.time),
            "columns": list(event.columns.read),
        }
        self._events.append(
            {**header, "unit": event.unit, "middle": event.middle, "certain": event.certain}
        )

    def mean(self, contact: int, before: WeightSums, after: WeightSums) -> float:
        """Return the log mean likelihood of a contact, or stop the shard if it is not yet known."""
        if contact in self._known:
            return self._known[contact]
        many, moments = self._mark
        del self._events[many:], self._reel.taken[moments:]
        for name, weighed in (("before", before), ("after", after)):
            self._reel.note(f"{name} top", weighed.top)
            self._reel.note(f"{name} sums", weighed.part.sums.ravel())
        self.ended(Result(self.since, contact=contact))
        raise Stop

    def anew(self, log_weight: Array, layout: Layout) -> Resampled | None:
        """Stop the shard, so that resampling is considered across all shards."""
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
        """Store all updates, and why the stretch ended."""
        self._reel.note(EVENTS, _text(self._events))
        self._reel.note(RESULT, _text(result._asdict()))

    def _keep(self, time: int) -> None:
        """Store the state of all particles at the start of a step [s after start]."""
        assert self.search is not None
        for name, column in self.search.state():
            self._state.note(name, column)
        for number, marker in enumerate(self.search.markers):
            self._state.note(f"marker {number}", marker.way.ravel())
        self.since = time

    def _values(self, of: str, time: np.datetime64 | None) -> None:
        """Store the quantities whose posteriors are reported, at a time; None: at the start.

        The column names begin with `of`.
        """
        for quantity in QUANTITIES:
            found = self._read.columns(quantity, time) if self._read else None
            if found is not None:
                for name in found.read:
                    self._reel.note(f"{of} {quantity.name} {name}", found.whole(name))


def events(reel: ShardFile) -> list[dict[str, Any]]:
    """Return the updates stored in a stretch's file."""
    return list(_read(reel, EVENTS))


def result(reel: ShardFile) -> Result:
    """Return the stored result of a stretch: why and when it ended."""
    return Result(**_read(reel, RESULT))


def weighed(reel: ShardFile, name: str, blocks: Blocks) -> WeightSums:
    """Return the stored weights of a shard's particles before or after a contact.

    Args:
        reel: the file of the stretch.
        name: "before" or "after".
        blocks: the blocks of the shard's particles.
    """
    sums = reel.noted(f"{name} sums").reshape(-1, 1, 2)
    return WeightSums(
        reel.noted(f"{name} top"), Partial(blocks.scenarios, blocks.scenario, blocks.number, sums)
    )


def contacts_of(spec: EnsembleSpec, contacts: Sequence[Contact]) -> list[tuple[int, Contact]]:
    """Return the contacts, each with its time [s after start]."""
    return [(spec.period.elapsed(contact.time), contact) for contact in contacts]


def _text(values: object) -> Array:
    return np.frombuffer(json.dumps(values).encode(), np.uint8)


def _read(reel: ShardFile, name: str) -> Any:
    return json.loads(reel.noted(name).tobytes())
