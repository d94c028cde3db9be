"""Snapshots of all output times, stored in files, one per shard.

Memory holds one snapshot or a part of it, however many there are.
"""

import contextlib
import errno
import itertools
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from io import BufferedRandom
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, overload

import numpy as np

from drift.engine.motion import changes
from drift.engine.motion.period import Period
from drift.engine.motion.simulate import Moment
from drift.engine.particles import members, partials
from drift.engine.particles.ensemble import Ensemble, Layout, Slots
from drift.engine.particles.partials import PART, Blocks, Partial
from drift.engine.particles.snapshot import Deal, Snapshot, answer_here
from drift.products.files import temporary
from geo import notation
from geo.array import Array
from geo.errors import UserError

BYTES = 13  # per particle and time: lon, lat, status, weight
BYTES_END = 24  # per particle at the end of the run
KINDS = {
    name: np.dtype(kind)
    for name, kind in (
        ("lon", np.int32),
        ("lat", np.int32),
        ("status", np.uint8),
        ("log_weight", np.float32),
        ("ancestors", np.int32),
        ("family", np.int32),
        ("world", np.int32),
        ("release", np.int32),
        ("status_since", np.int32),
        ("edge", np.int32),
        ("member", np.int32),
        (changes.STATE, np.float32),
    )
}
# columns of an ensemble that are stored at the end of the run
END = ("log_weight", "release", "status_since", "edge", "world")


def _storage_error(reason: str, folder: Path | None = None) -> UserError:
    if folder is None:
        return temporary.temporary_folder_error(reason)
    return UserError(f"{folder}: {reason}; free some space, or name another folder with --out")


class NoRoom(Exception):
    """The file of a shard cannot be written; holds the reason.

    Errors of the motion itself are raised unchanged.
    """


class Noted(NamedTuple):
    """Where a named array lies in a shard's file."""

    begin: int
    kind: str  # NumPy's dtype string
    size: int


class SnapshotIndex(NamedTuple):
    """Where a snapshot lies in a shard's file."""

    time: np.datetime64
    layout: Layout
    where: dict[str, int]  # where each column begins


@dataclass
class ShardFile:
    """A file with the states of a shard's particles (whole blocks) at all output times."""

    # an open file, or its path: a run may have more files than a process may hold open
    file: BufferedRandom | Path
    n: int
    taken: list[SnapshotIndex] = field(default_factory=list)
    end: dict[str, int] = field(
        default_factory=dict
    )  # offsets of the columns at the end of the run
    notes: dict[str, Noted] = field(default_factory=dict)  # further arrays of the run, by name
    # a file of log weights computed after the run, and the offset of this shard's in it
    later: "tuple[ShardFile, int] | None" = None
    size: int = 0  # [bytes] stored

    def record(self, period: Period, moments: Iterable[Moment]) -> None:
        """Store the moments of a run as they are computed."""
        for moment in moments:
            columns = {"lon": moment.lon, "lat": moment.lat, "status": moment.status}
            if moment.log_weight is not None:
                columns["log_weight"] = moment.log_weight
            if moment.ancestors is not None:
                columns["ancestors"] = moment.ancestors
            before = self.taken[-1].where if self.taken else {}
            if moment.lineage is not None and (
                moment.ancestors is not None or "family" not in before
            ):
                columns["family"] = moment.lineage
            where = {name: self._keep(name, values) for name, values in columns.items()}
            if moment.lineage is not None and "family" not in where:
                where["family"] = before["family"]
            self.taken.append(SnapshotIndex(period.time(moment.elapsed), moment.layout, where))

    def record_end(self, ensemble: Ensemble, end: int) -> None:
        """Store an ensemble's columns at the end of the run [s after start].

        They are those at the end of its last step, which may be later; the state is that at `end`.
        """
        for name in (*END, *({members.COLUMN.name} & {*ensemble.own})):
            self.end[name] = self._keep(name, ensemble.columns[name].to_numpy())
        if changes.STATE in ensemble.own:
            self.end[changes.STATE] = self._keep(changes.STATE, changes.state_at(ensemble, end))

    @property
    def empty(self) -> bool:
        """Whether nothing is stored."""
        return self.size == 0

    def note(self, name: str, values: Array) -> None:
        """Store a one-dimensional array of any type under a name."""
        self.notes[name] = Noted(
            self._append(np.ascontiguousarray(values)), values.dtype.str, values.size
        )

    def noted(self, name: str, first: int = 0, last: int | None = None) -> Array:
        """Return an array stored under a name, or the slice [first, last) of it."""
        noted = self.notes[name]
        kind, last = np.dtype(noted.kind), noted.size if last is None else last
        return np.frombuffer(
            self._bytes(noted.begin + first * kind.itemsize, (last - first) * kind.itemsize), kind
        )

    def _keep(self, name: str, values: Array) -> int:
        """Append a column to the file and return its offset [bytes]."""
        return self._append(np.ascontiguousarray(values, KINDS[name]))

    def _bytes(self, begin: int, size: int) -> bytes:
        if isinstance(self.file, Path):
            with self.file.open("rb") as file:
                file.seek(begin)
                data = file.read(size)
            if len(data) < size:
                raise OSError(errno.EIO, "truncated", str(self.file))
            return data
        self.file.seek(begin)
        return self.file.read(size)

    def sync(self) -> None:
        """Flush the file to disk."""
        assert not isinstance(self.file, Path)
        os.fsync(self.file.fileno())

    def close(self) -> None:
        """Close its file, if it is open."""
        if not isinstance(self.file, Path):
            self.file.close()

    def _append(self, column: Array) -> int:
        begin = self.size
        self.put(begin, column)
        self.size += column.nbytes
        return begin

    def put(self, begin: int, column: Array) -> None:
        """Write a column into the file at an offset [bytes]."""
        assert not isinstance(self.file, Path)
        try:
            self.file.seek(begin)
            self.file.write(column.data)
            self.file.flush()
        except OSError as error:
            self.file.raw.close()  # flushing the rest of the buffer would fail again
            raise NoRoom(error.strerror or str(error)) from error

    def read(self, name: str, at: int | None, first: int, last: int) -> Array:
        """Return a column of the slots [first, last) at a moment, or at the end of the run (at =
        None).
        """
        kind, file, begin = (
            KINDS[name],
            self,
            (self.end if at is None else self.taken[at].where)[name],
        )
        if at is None and name == "log_weight" and self.later is not None:
            file, begin = self.later
        return np.frombuffer(
            file._bytes(begin + first * kind.itemsize, (last - first) * kind.itemsize), kind
        )

    def logs(self, at: int, first: int, last: int) -> Array:
        """Return the log weights of some slots at a moment: those stored for it, or those of the
        end.
        """
        return self.read(
            "log_weight", at if "log_weight" in self.taken[at].where else None, first, last
        )

    @property
    def layout(self) -> Layout:
        """The layout of the slots at the end of the run."""
        return self.taken[-1].layout

    def spans(self, at: int) -> list[tuple[int, int]]:
        """Return ranges of blocks of about PART slots each."""
        return self.taken[at].layout.blocks.spans_of(PART)

    def slots(self, at: int, span: tuple[int, int]) -> tuple[int, int]:
        """Return the slots [first, last) of a range of blocks."""
        edges = np.append(self.taken[at].layout.blocks.first, self.n)
        return int(edges[span[0]]), int(edges[span[1]])


@dataclass(frozen=True)
class Portion:
    """Some particles of a shard's file: a range of blocks of each scenario."""

    reel: ShardFile
    slots: tuple[Slots, ...]

    def read(self, name: str, at: int | None = None) -> Array:
        """Return a column at a moment, or at the end of the run (at = None)."""
        return np.concatenate(
            [self.reel.read(name, at, first, last) for first, last, _ in self.slots]
        )


@contextlib.contextmanager
def scratch(folder: Path | None) -> Iterator[ShardFile]:
    """Yield a temporary file for data about a run's particles; folder None: in the temporary
    folder.
    """
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            yield ShardFile(file, 0)
    except NoRoom as error:
        raise _storage_error(str(error), folder) from error


class SnapshotStore(Sequence[Snapshot]):
    """Snapshots of a run, read back one at a time or part by part; a context manager that closes
    its files.
    """

    def __init__(
        self,
        stretches: Sequence[Sequence[ShardFile]],
        *,
        worlds: bool = False,
        deal: Deal = answer_here,
    ) -> None:
        """Combine the files of all shards, stretch after stretch of the run.

        All moments of a shard's file lie in one stretch. worlds: whether particles share unknowns
        with others of their world. deal: reads particles for products.
        """
        self.deal = deal
        self._stretches, self._worlds = [list(reels) for reels in stretches], worlds
        self._moments = [
            (reels, at) for reels in self._stretches for at in range(len(reels[0].taken))
        ]
        self._scale: dict[int, tuple[float, float]] = {}  # see _normalisation
        self._open = contextlib.ExitStack()  # files besides those of the shards

    @classmethod
    def of_run(
        cls,
        period: Period,
        ensemble: Ensemble,
        moments: Iterable[Moment],
        outputs: int,
        *,
        worlds: bool = False,
        more: Callable[[ShardFile], None] | None = None,
    ) -> "SnapshotStore":
        """Store the moments of a run as they are computed, in a temporary file that is removed on
        close.

        Args:
            period: of the run.
            ensemble: of the run; its final weights apply to moments without their own.
            moments: of the run, in order.
            outputs: the number of moments.
            worlds: whether particles share unknowns with others of their world.
            more: stores further data at the end of the run.
        """
        need = ensemble.n * BYTES * outputs
        temporary.check_room(need, "the particles at all output times")
        try:
            file = tempfile.TemporaryFile()  # noqa: SIM115 - closed by __exit__
        except OSError as error:
            raise _storage_error(error.strerror or str(error)) from error
        reel = ShardFile(file, ensemble.n)
        try:
            reel.record(period, moments)
            reel.record_end(ensemble, period.duration)
            if more:
                more(reel)
        except NoRoom as error:
            raise _storage_error(
                f"{error}; all output times need {notation.format_bytes(need)}"
            ) from error
        except BaseException:
            file.close()
            raise
        return cls([[reel]], worlds=worlds)

    def __enter__(self) -> "SnapshotStore":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for reel in itertools.chain(*self._stretches):
            reel.close()
        self._open.__exit__(kind, error, trace)

    @property
    def folder(self) -> Path | None:
        """The folder of its files; None: the temporary folder."""
        file = self._stretches[-1][0].file
        return file.parent if isinstance(file, Path) else None

    def portions(self) -> Iterator[Portion]:
        """Yield all particles in portions of about PART slots, or of one block per scenario if that
        is more.
        """
        for reel in self._stretches[-1]:
            scenarios = list(zip(reel.layout.slots, reel.layout.block, strict=True))
            blocks = max(-(-(last - first) // size) for (first, last, _), size in scenarios)
            step = max(PART // sum(reel.layout.block), 1)
            for begin in range(0, blocks, step):
                ranges = (
                    (
                        min(first + begin * size, last),
                        min(first + (begin + step) * size, last),
                        number + begin * size,
                    )
                    for (first, last, number), size in scenarios
                )
                yield Portion(reel, tuple(Slots(*own) for own in ranges))

    def reweigh(self, log_weights: Iterable[Array]) -> None:
        """Take log weights for all times that have none of their own: those of each portion, in
        their order.
        """
        kind, begin = KINDS["log_weight"], 0
        file = self._open.enter_context(scratch(self.folder))
        for reel in self._stretches[-1]:
            reel.later = file, begin
            begin += reel.n * kind.itemsize
        for portion, log_weight in zip(self.portions(), log_weights, strict=True):
            assert portion.reel.later is not None
            ahead = 0
            for first, last, _ in portion.slots:
                column = np.ascontiguousarray(log_weight[ahead : ahead + last - first], kind)
                file.put(portion.reel.later[1] + first * kind.itemsize, column)
                ahead += last - first
        self._scale.clear()

    def noted(self, name: str) -> list[tuple[Layout, Array]]:
        """Return what each shard stored under a name, with the shard's slots."""
        return [(reel.layout, reel.noted(name)) for reel in self._stretches[-1]]

    def time(self, index: int) -> np.datetime64:
        """Return the time of a snapshot."""
        reels, at = self._moments[index]
        return reels[0].taken[at].time

    def __len__(self) -> int:
        return len(self._moments)

    @overload
    def __getitem__(self, index: int) -> Snapshot: ...
    @overload
    def __getitem__(self, index: slice) -> list[Snapshot]: ...
    def __getitem__(self, index: int | slice) -> Snapshot | list[Snapshot]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        (reel,), at = self._moments[index]
        return self._some(
            reel, range(len(self))[index], (0, len(reel.taken[at].layout.blocks.first))
        )

    def __iter__(self) -> Iterator[Snapshot]:
        return (self[i] for i in range(len(self)))

    @property
    def n(self) -> int:
        """Number of particles."""
        return sum(reel.n for reel in self._stretches[-1])

    @property
    def outputs(self) -> list["AtTime"]:
        """All snapshots, to be read part by part."""
        return [AtTime(self, at) for at in range(len(self))]

    def shards(self, at: int) -> int:
        """Return the number of shards of snapshot `at`; it may change with resampling."""
        return len(self._moments[at][0])

    def some(self, at: int, first: int, last: int) -> "AtTime":
        """Return snapshot `at` of the shards first <= shard < last, for another process.

        It keeps the scale of all shards: see `normalise`.
        """
        reels, own = self._moments[at]
        gone = set() if at == len(self) - 1 else {members.COLUMN.name}  # see _some
        files = []
        for reel in reels[first:last]:
            assert isinstance(reel.file, Path)
            assert reel.later is None
            end = {name: begin for name, begin in reel.end.items() if name not in gone}
            path = reel.file.absolute()
            files.append(replace(reel, file=path, taken=[reel.taken[own]], end=end, notes={}))
        store = SnapshotStore([files], worlds=self._worlds)
        key = self._key(at)
        if key in self._scale:
            store._scale[min(key, 0)] = self._scale[key]
        return AtTime(store, 0)

    def parts(self, at: int) -> Iterator[Snapshot]:
        """Return a snapshot in parts of about PART slots."""
        reels, own = self._moments[at]
        return (self._some(reel, at, span) for reel in reels for span in reel.spans(own))

    def _some(self, reel: ShardFile, number: int, span: tuple[int, int]) -> Snapshot:
        """Return a range of blocks of snapshot `number` from a shard's file."""
        at = self._moments[number][1]
        taken = reel.taken[at]
        own, slots = taken.layout.blocks.some(*span), reel.slots(at, span)
        lon, lat, status = (reel.read(name, at, *slots) for name in ("lon", "lat", "status"))
        scale, total = self._normalisation(number)
        probability = np.exp(reel.logs(at, *slots).astype(np.float64) - scale) / total
        scenario = np.repeat(own.scenario.astype(np.int32), np.diff(own.first, append=own.n))
        family = reel.read("family", at, *slots) if "family" in taken.where else None
        world = reel.read("world", None, *slots) if self._worlds else None
        # The member is stored only for the end: before resampling a slot may have had another.
        member = (
            reel.read("member", None, *slots)
            if "member" in reel.end and number == len(self) - 1
            else None
        )
        return Snapshot(
            taken.time,
            lon,
            lat,
            probability,
            status.astype(np.int32),
            scenario,
            family,
            world,
            member,
            own,
        )

    def _normalisation(self, at: int) -> tuple[float, float]:
        """Return a snapshot's largest log weight, and the sum of its weights in units of the
        largest.
        """
        self.normalise([at], answer_here)
        return self._scale[self._key(at)]

    def _key(self, at: int) -> int:
        """Return the number of a snapshot in _scale; -1 for all that have the end's weights."""
        reels, own = self._moments[at]
        return at if "log_weight" in reels[0].taken[own].where else -1

    def normalise(self, numbers: Sequence[int], deal: Deal) -> None:
        """Compute the scales of some snapshots' weights; those of the end are summed once."""
        keys = {self._key(at): at for at in numbers if self._key(at) not in self._scale}
        outputs = [AtTime(self, at) for at in keys.values()]
        if not outputs:
            return
        tops = [max(parts) for parts in deal(outputs, [largest_log_weight] * len(outputs))]
        sums = deal(outputs, [partial(sum_weights_of, top=top) for top in tops])
        for key, top, parts in zip(keys, tops, sums, strict=True):
            self._scale[key] = top, float(partials.merge_partials(parts).total[0, 0])

    def spans_of(self, at: int) -> Iterator[tuple[Blocks, Array]]:
        """Yield the blocks and the log weights of a snapshot, of about PART slots each."""
        reels, own = self._moments[at]
        for reel in reels:
            for span in reel.spans(own):
                blocks = reel.taken[own].layout.blocks.some(*span)
                yield blocks, reel.logs(own, *reel.slots(own, span))

    def follow(self, slots: Array) -> dict[str, Array]:
        """Return particle histories as columns lon, lat, status, scenario and probability, (m,
        times).

        slots: numbers at the last time, (m,). A resampled particle has the history of its
        ancestors.
        """
        found: dict[str, list[Array]] = {
            name: [] for name in ("lon", "lat", "status", "scenario", "probability")
        }
        for number in range(len(self) - 1, -1, -1):
            own = {
                name: np.empty(len(slots), np.float64 if name == "probability" else np.int32)
                for name in found
            }
            before, (reels, at) = slots.copy(), self._moments[number]
            for reel in reels:
                blocks = reel.taken[at].layout.blocks
                wanted = _match_slots(blocks, slots)[0]
                # only blocks that hold requested particles are read
                for block in np.unique(np.searchsorted(blocks.first, wanted, "right") - 1).tolist():
                    span = block, block + 1
                    part = self._some(reel, number, span)
                    here, which = _match_slots(part.blocks, slots)
                    for name, values in own.items():
                        values[which] = getattr(part, name)[here]
                    if "ancestors" in reel.taken[at].where:
                        before[which] = reel.read("ancestors", at, *reel.slots(at, span))[here]
            for name, values in own.items():
                found[name].append(values)
            slots = before
        return {name: np.stack(values[::-1], axis=1) for name, values in found.items()}

    def at_end(self, names: Sequence[str], slots: Array) -> tuple[Array, ...]:
        """Return columns of the ensemble at the end of the run, (m,) each; slots: particle numbers,
        (m,).
        """
        columns = tuple(np.empty(len(slots), KINDS[name]) for name in names)
        for reel in self._stretches[-1]:
            here, which = _match_slots(reel.taken[-1].layout.blocks, slots)
            for begin in np.unique(here // PART * PART).tolist():
                own = (here >= begin) & (here < begin + PART)
                first, last = int(here[own].min()), int(here[own].max()) + 1
                for name, column in zip(names, columns, strict=True):
                    column[which[own]] = reel.read(name, None, first, last)[here[own] - first]
        return columns


def largest_log_weight(output: "AtTime") -> float:
    """Return the largest log weight of a snapshot's particles."""
    return max(float(logs.max()) for _, logs in output.spool.spans_of(output.at))


def sum_weights_of(output: "AtTime", top: float) -> Partial:
    """Return the summed weights of a snapshot's particles by block, in units of exp(top)."""
    return partials.merge_partials(
        [
            blocks.partial(np.exp(logs.astype(np.float64) - top))
            for blocks, logs in output.spool.spans_of(output.at)
        ]
    )


def _match_slots(blocks: Blocks, slots: Array) -> tuple[Array, Array]:
    """Return which particles of some blocks are requested, and their positions in the request.

    slots: the requested particle numbers.
    """
    block = np.searchsorted(blocks.number, slots, "right") - 1
    inside = slots - blocks.number[block]
    which = np.flatnonzero((block >= 0) & (inside < np.diff(blocks.first, append=blocks.n)[block]))
    return (blocks.first[block] + inside)[which], which


@dataclass(frozen=True)
class AtTime:
    """One snapshot of a store, read part by part: a drift.engine.particles.snapshot.Output."""

    spool: SnapshotStore
    at: int

    @property
    def time(self) -> np.datetime64:
        """Time of the snapshot, UTC."""
        return self.spool.time(self.at)

    @property
    def n(self) -> int:
        """Number of particles."""
        return self.spool.n

    def parts(self) -> Iterator[Snapshot]:
        """Return the parts of the snapshot."""
        return self.spool.parts(self.at)
