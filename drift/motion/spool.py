"""The particles at all output times, kept in a temporary file.

Memory holds one time, or a part of it, however many there are.
"""

import itertools
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import NamedTuple, overload

import numpy as np

from drift.motion.period import Period
from drift.motion.simulate import Moment
from drift.particles import partials
from drift.particles.ensemble import Ensemble, Layout
from drift.particles.partials import Blocks
from drift.particles.snapshot import Snapshot
from geo.array import Array
from geo.errors import UserError

BYTES = 13  # a particle and time: two positions, its status, its weight
KINDS = {
    name: np.dtype(kind)
    for name, kind in (
        ("lon", np.int32), ("lat", np.int32), ("status", np.uint8), ("log_weight", np.float32),
        ("ancestors", np.int32), ("family", np.int32),
    )
}  # fmt: skip
PART = 2**17  # slots of a part: 13 MB while something is made of them


def _check_room(need: int) -> None:
    """Raise UserError where the temporary folder has less room than that [bytes]."""
    try:
        free = shutil.disk_usage(tempfile.gettempdir()).free
    except OSError as error:
        raise _refusal(error.strerror or str(error)) from error
    if need > free:
        raise _refusal(f"the particles at all output times need {_size(need)}, and it has room for {_size(free)}")


def _refusal(reason: str) -> UserError:
    folder = tempfile.tempdir or os.environ.get("TMPDIR", "")
    return UserError(
        f"temporary folder {folder}: {reason}; make room, name another folder in the environment variable TMPDIR, or "
        "ask for fewer particles or output times"
    )


def _size(count: int) -> str:
    return f"{count / 2**30:.1f} GiB" if count >= 2**30 else f"{count / 2**20:.1f} MiB"


class Spool(Sequence[Snapshot]):
    """Snapshots of a run, read back one at a time or part by part; a context, which removes the file at its end."""

    def __init__(
        self, period: Period, ensemble: Ensemble, moments: Iterable[Moment], outputs: int, *, worlds: bool = False
    ) -> None:
        """Take up the moments of a run as they come. Weights are theirs, or those that the ensemble has afterwards.

        outputs: the number of moments; worlds: whether particles share unknowns with others of their world.
        """
        self._need = ensemble.n * BYTES * outputs
        _check_room(self._need)
        try:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115 - closed by __exit__
        except OSError as error:
            raise _refusal(error.strerror or str(error)) from error
        self._n, self._end = ensemble.n, 0
        self._taken: list[_Taken] = []
        family: Array | None = None  # from which particle of the beginning each descends; None: from itself
        for moment in moments:
            columns = {"lon": moment.lon, "lat": moment.lat, "status": moment.status}
            if moment.log_weight is not None:
                columns["log_weight"] = moment.log_weight
            if moment.ancestors is not None:
                family = np.asarray(moment.ancestors if family is None else family[moment.ancestors], np.int32)
                columns |= {"ancestors": moment.ancestors, "family": family}
            where = {name: self._keep(np.ascontiguousarray(values, KINDS[name])) for name, values in columns.items()}
            if family is not None and moment.ancestors is None:
                where["family"] = self._taken[-1].where["family"]
            self._taken.append(_Taken(period.time(moment.elapsed), moment.layout, where))
        self._scale: dict[int, tuple[float, float]] = {}  # see _normal
        self.reweigh(ensemble)
        self._world = ensemble.world.to_numpy() if worlds else None

    def __enter__(self) -> "Spool":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def _keep(self, column: Array) -> int:
        """Append a column to the file, and return where it begins; raise UserError where there is no room for it."""
        begin = self._end
        try:
            self._file.write(column.data)
            self._file.flush()
        except OSError as error:
            self._file.raw.close()  # what is left in the buffer would fail once more
            raise _refusal(f"{error.strerror}; all output times need {_size(self._need)}") from error
        self._end += column.nbytes
        return begin

    def _read(self, taken: "_Taken", name: str, first: int, last: int) -> Array:
        """Return a column of some slots."""
        kind = KINDS[name]
        self._file.seek(taken.where[name] + first * kind.itemsize)
        return np.frombuffer(self._file.read((last - first) * kind.itemsize), kind)

    def reweigh(self, ensemble: Ensemble) -> None:
        """Take the weights that an ensemble has now, for all times that have none of their own."""
        self._log_weight = ensemble.log_weight.to_numpy()
        self._scale.clear()

    def time(self, index: int) -> np.datetime64:
        """Return the time of a snapshot."""
        return self._taken[index].time

    def __len__(self) -> int:
        return len(self._taken)

    @overload
    def __getitem__(self, index: int) -> Snapshot: ...
    @overload
    def __getitem__(self, index: slice) -> list[Snapshot]: ...
    def __getitem__(self, index: int | slice) -> Snapshot | list[Snapshot]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        at = range(len(self))[index]
        return self._some(at, 0, len(self._taken[at].layout.blocks.first))

    def __iter__(self) -> Iterator[Snapshot]:
        return (self[i] for i in range(len(self)))

    @property
    def n(self) -> int:
        """Number of particles."""
        return self._n

    @property
    def outputs(self) -> list["Taken"]:
        """All snapshots, to be read part by part."""
        return [Taken(self, at) for at in range(len(self))]

    def parts(self, at: int) -> Iterator[Snapshot]:
        """Return a snapshot in parts of some PART slots."""
        return (self._some(at, *span) for span in _spans(self._taken[at].layout.blocks))

    def _some(self, at: int, begin: int, end: int) -> Snapshot:
        """Return a range of blocks of a snapshot."""
        taken, blocks = self._taken[at], self._taken[at].layout.blocks
        own = blocks.some(begin, end)
        first = int(blocks.first[begin]) if own.n else 0
        slots = first, first + own.n
        lon, lat, status = (self._read(taken, name, *slots) for name in ("lon", "lat", "status"))
        scale, total = self._normal(at)
        probability = np.exp(self._logs(at, *slots).astype(np.float64) - scale) / total
        scenario = np.repeat(own.scenario.astype(np.int32), np.diff(own.first, append=own.n))
        family = self._read(taken, "family", *slots) if "family" in taken.where else None
        world = None if self._world is None else self._world[slice(*slots)]
        return Snapshot(taken.time, lon, lat, probability, status.astype(np.int32), scenario, family, world, own)

    def _logs(self, at: int, first: int, last: int) -> Array:
        """Return the log weights of some slots."""
        taken = self._taken[at]
        if "log_weight" in taken.where:
            return self._read(taken, "log_weight", first, last)
        return np.asarray(self._log_weight[first:last])

    def _normal(self, at: int) -> tuple[float, float]:
        """Return the largest log weight of a snapshot, and the sum of all weights in units of the largest."""
        blocks = self._taken[at].layout.blocks
        key = at if "log_weight" in self._taken[at].where else -1  # those of the ensemble are summed once
        if key not in self._scale:
            edges = np.append(blocks.first, self._n).tolist()
            slots = [((begin, end), edges[begin], edges[end]) for begin, end in _spans(blocks)]
            top = max(float(self._logs(at, *own).max()) for _, *own in slots)
            sums = [
                blocks.some(*span).partial(np.exp(self._logs(at, *own).astype(np.float64) - top))
                for span, *own in slots
            ]
            self._scale[key] = top, float(partials.merged(sums).total[0, 0])
        return self._scale[key]

    def follow(self, slots: Array) -> dict[str, Array]:
        """Return what particles were like at all times, as columns lon, lat, status and probability, (m, times).

        slots: of the last time, (m,). What was drawn anew is what its ancestors were before.
        """
        found: dict[str, list[Array]] = {name: [] for name in ("lon", "lat", "status", "probability")}
        for at in range(len(self) - 1, -1, -1):
            order = np.argsort(slots, kind="stable")
            columns: dict[str, list[Array]] = {name: [] for name in found}
            ancestors, first = [], 0
            for part in self.parts(at):
                own = slots[order[slice(*np.searchsorted(slots[order], (first, first + part.n)))]] - first
                for name, values in columns.items():
                    values.append(getattr(part, name)[own])
                if "ancestors" in self._taken[at].where:
                    ancestors.append(self._read(self._taken[at], "ancestors", first, first + part.n)[own])
                first += part.n
            back = np.argsort(order, kind="stable")
            for name, values in columns.items():
                found[name].append(np.concatenate(values)[back])
            slots = np.concatenate(ancestors)[back] if ancestors else slots
        return {name: np.stack(values[::-1], axis=1) for name, values in found.items()}


def _spans(blocks: Blocks) -> list[tuple[int, int]]:
    """Return ranges of blocks of some PART slots each."""
    cuts = np.searchsorted(blocks.first, np.arange(0, blocks.n, PART))
    return list(itertools.pairwise(np.unique([*cuts, len(blocks.first)]).tolist()))


class _Taken(NamedTuple):
    """A moment in the file."""

    time: np.datetime64
    layout: Layout
    where: dict[str, int]  # where each column begins


@dataclass(frozen=True)
class Taken:
    """A snapshot of a spool, to be read part by part: a drift.particles.snapshot.Output."""

    spool: Spool
    at: int

    @property
    def time(self) -> np.datetime64:
        """When it is, UTC."""
        return self.spool.time(self.at)

    @property
    def n(self) -> int:
        """Number of particles."""
        return self.spool.n

    def parts(self) -> Iterator[Snapshot]:
        """Return its parts."""
        return self.spool.parts(self.at)
