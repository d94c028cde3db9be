"""The particles at all output times, kept in a temporary file.

Memory holds one time, however many there are.
"""

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from types import TracebackType
from typing import overload

import numpy as np

from drift.motion.period import Period
from drift.motion.simulate import Moment
from drift.particles import ensemble as record
from drift.particles import weights
from drift.particles.ensemble import Ensemble, Layout
from drift.particles.snapshot import Snapshot
from geo.array import Array
from geo.errors import UserError

BYTES = 13  # a particle and time: two positions, its status, its weight


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
    """Snapshots of a run, read back one at a time; a context, which removes the file at its end."""

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
        self._times = []
        self._weighted: list[bool] = []
        self._layouts: list[Layout] = []
        # By time: whose offspring the particles are, among those of the time before and of the beginning.
        self.ancestors: list[Array | None] = []
        self._families: list[Array | None] = []
        for moment in moments:
            weight = np.zeros(ensemble.n, np.float32) if moment.log_weight is None else moment.log_weight
            for column, kind in (
                (moment.lon, np.int32),
                (moment.lat, np.int32),
                (moment.status, np.uint8),
                (weight, np.float32),
            ):
                self._keep(np.ascontiguousarray(column, kind))
            self._times.append(period.time(moment.elapsed))
            self._weighted.append(moment.log_weight is not None)
            self._layouts.append(moment.layout)
            self.ancestors.append(moment.ancestors)
            self._families.append(_descent(self._families[-1] if self._families else None, moment.ancestors))
        self._n, self._probability = ensemble.n, record.probability(ensemble)
        self._scenarios: dict[tuple[int, ...], Array] = {}  # the scenario of each slot, by the bounds of scenarios
        self._world = ensemble.world.to_numpy() if worlds else None

    def __enter__(self) -> "Spool":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def _keep(self, column: Array) -> None:
        """Append a column to the file; raise UserError where there is no room for it."""
        try:
            self._file.write(column.data)
            self._file.flush()
        except OSError as error:
            self._file.raw.close()  # what is left in the buffer would fail once more
            raise _refusal(f"{error.strerror}; all output times need {_size(self._need)}") from error

    def reweigh(self, ensemble: Ensemble) -> None:
        """Take the weights that an ensemble has now."""
        self._probability = record.probability(ensemble)

    def time(self, index: int) -> np.datetime64:
        """Return the time of a snapshot."""
        return self._times[index]

    def __len__(self) -> int:
        return len(self._times)

    @overload
    def __getitem__(self, index: int) -> Snapshot: ...
    @overload
    def __getitem__(self, index: slice) -> list[Snapshot]: ...
    def __getitem__(self, index: int | slice) -> Snapshot | list[Snapshot]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        at = range(len(self))[index]
        self._file.seek(at * self._n * BYTES)
        lon, lat = (np.frombuffer(self._file.read(4 * self._n), np.int32) for _ in range(2))
        status = np.frombuffer(self._file.read(self._n), np.uint8).astype(np.int32)
        probability, layout = self._probability, self._layouts[at]
        if self._weighted[at]:
            probability = weights.normalised(np.frombuffer(self._file.read(4 * self._n), np.float32), layout.blocks)
        if layout.bounds not in self._scenarios:
            self._scenarios = {layout.bounds: record.owners(layout.bounds)}  # those of one layout: it rarely changes
        own = self._scenarios[layout.bounds], self._families[at], self._world, layout.blocks
        return Snapshot(self._times[at], lon, lat, probability, status, *own)

    def __iter__(self) -> Iterator[Snapshot]:
        return (self[i] for i in range(len(self)))


def _descent(family: Array | None, ancestors: Array | None) -> Array | None:
    """Return from which particle of the beginning each descends; None: each descends from itself.

    family: the same at the time before; ancestors: at that time, of each.
    """
    if ancestors is None:
        return family
    return np.asarray(ancestors if family is None else family[ancestors], np.int32)
