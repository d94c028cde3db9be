"""The store of a run's finished shards, from which a killed run resumes.

Each shard has a data file (.bin) and an index (.json). The index holds the positions of the
columns, the digest of the data and a seal that binds the index to its run; it is written last and
renamed in one step. A truncated or altered file is detected, and its shard is simulated again.
`drift.pipeline.shards.shelf` manages the folder.
"""

import contextlib
import hashlib
import json
import logging
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from drift.case.record import Case
from drift.engine.environment.environment import Environment
from drift.engine.motion import simulate
from drift.engine.motion.scene import Scene
from drift.engine.motion.spool import NoRoom, Noted, ShardFile, SnapshotIndex
from drift.engine.particles.ensemble import Layout
from geo.errors import UserError

ABOUT = "about.json"
NUMBER, BACKEND = "the number of shards", "the backend"  # in the fingerprint
INDICES = "shard-*.json"
# outputs of stretches, states at their ends, resampled particles
KINDS_OF_FILES = ("shard", "state", "drawn")
FORCING = "forcing"  # folder of regridded slices, made once, sampled by all shards
CHUNK = 2**24
# warnings go to standard error unless the calling program configures logging
LOG = logging.getLogger("drift")


class Task(Protocol):
    """A shard of a run, or a stretch of it, simulated by one process."""

    @property
    def case(self) -> Case:
        """The case of the run."""

    @property
    def opened(self) -> Case:
        """The case whose environment the run has: see drift.pipeline.run_options.Job."""

    @property
    def number(self) -> int:
        """Number of its shard."""

    @property
    def name(self) -> str:
        """Name of its file, without suffix."""

    @property
    def of(self) -> str:
        """Inputs that determine it, besides the fingerprint of the run."""

    def move(
        self, scene: Scene, where: Environment, tell: simulate.Progress | None, kept: "Work"
    ) -> ShardFile:
        """Return the shard's file: read if it is stored, else simulated and stored.

        Args:
            scene: forcing, motion models and coast.
            where: the environment.
            tell: called with the share done, 0 to 1.
            kept: the store of finished shards.
        """


@dataclass(frozen=True)
class Work:
    """The store of a run's finished shards."""

    folder: Path
    run: str  # digest of the run's fingerprint; files of other runs are ignored
    # files whose digests have been checked
    sound: set[str] = field(default_factory=set)

    def reel(self, name: str, n: int, fill: Callable[[ShardFile], None], of: str = "") -> ShardFile:
        """Return a file: read if it is stored, else filled and stored.

        Args:
            name: name of the file, without suffix.
            n: number of its particles.
            fill: writes the file's contents.
            of: inputs that determine it besides the fingerprint, such as the worlds of a renewal.
        """
        finished = self._read_valid(name, of)
        if finished is not None:
            return finished
        with self.also(name, n, of) as reel:
            fill(reel)
        return reel

    @contextlib.contextmanager
    def also(self, name: str, n: int, of: str = "") -> Iterator[ShardFile]:
        """Yield a new file to fill; store it if it is not empty. Arguments as in `reel`."""
        data = self._data(name)
        with self._disk_errors_as_user_errors(data):
            self._index(name).unlink(missing_ok=True)
            reel = ShardFile(data.open("w+b"), n)
        try:
            with contextlib.closing(reel):
                yield reel
                with self._disk_errors_as_user_errors(data):
                    reel.sync()
        except NoRoom as error:
            raise self._disk_error(data, str(error)) from error
        except BaseException:
            data.unlink(missing_ok=True)
            raise
        reel.file = data
        if reel.empty:
            data.unlink()
            return
        with self._disk_errors_as_user_errors(data):
            if _run_in(self.folder) != self.run:  # another run has taken over the folder
                raise Gone(name)
            index = {**_index(reel), "of": of, "bytes": _digest(data)}
            replace(self._index(name), json.dumps({**index, "seal": self._seal(name, index)}))
        self.sound.add(name)

    def read(self, name: str) -> ShardFile:
        """Return a stored file; raise Gone if it is missing or has been altered."""
        finished = self._read_valid(name, "")
        if finished is None:
            raise Gone(name)
        return finished

    def remove(self, name: str) -> None:
        """Delete a file that is no longer needed."""
        self.sound.discard(name)
        self._index(name).unlink(missing_ok=True)
        self._data(name).unlink(missing_ok=True)

    @contextlib.contextmanager
    def _disk_errors_as_user_errors(self, data: Path) -> Iterator[None]:
        """Turn a write error of the disk into a UserError."""
        try:
            yield
        except OSError as error:
            raise self._disk_error(data, error.strerror or str(error)) from error

    def _disk_error(self, data: Path, why: str) -> UserError:
        with contextlib.suppress(OSError):
            data.unlink()
        return UserError(
            f"{self.folder}: {why}; {self.kept}; free some space, or name another folder with --out"
        )

    @property
    def any_finished(self) -> bool:
        """Whether any shard is stored."""
        return any(True for _ in self.folder.glob(INDICES))

    @property
    def kept(self) -> str:
        """A message on how many shards are stored."""
        many = len(list(self.folder.glob(INDICES)))
        if not many:
            return "no shard is finished and kept there: the same command starts again"
        return f"{many:,} shards are finished and kept there: the same command resumes from them"

    def begin_anew(self) -> None:
        """Delete all stored shards, states and resampled particles, but not the forcing."""
        self.sound.clear()
        for kind in KINDS_OF_FILES:
            for path in self.folder.glob(f"{kind}-*"):
                path.unlink(missing_ok=True)  # a worker may be deleting what it did not finish

    def drop(self) -> None:
        """Delete the whole store of a run that cannot succeed."""
        self.begin_anew()
        shutil.rmtree(self.folder / FORCING, ignore_errors=True)
        (self.folder / ABOUT).unlink(missing_ok=True)

    def finished(self, name: str, of: str = "") -> bool:
        """Return whether a valid file is stored; `of` as in `reel`."""
        return self._read_valid(name, of) is not None

    def _data(self, name: str) -> Path:
        return self.folder / f"{name}.bin"

    def _index(self, name: str) -> Path:
        return self.folder / f"{name}.json"

    def _read_valid(self, name: str, of: str) -> ShardFile | None:
        """Return a stored file; None, with a warning if it is damaged, when there is no valid
        one."""
        data = self._data(name)
        try:
            index = json.loads(self._index(name).read_text(encoding="utf-8"))
            seal = index.pop("seal")
            if index["of"] != of:
                why = "belongs to other worlds"
            elif seal != self._seal(name, index):
                why = "has been altered, or belongs to another run"
            elif data.stat().st_size != index["size"]:
                why = "is truncated"
            elif name in self.sound or _digest(data) == index["bytes"]:
                self.sound.add(name)
                return _open_shard_file(data, index)
            else:
                why = "has been altered"
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            why = f"cannot be read ({error})"
        LOG.warning("%s of the previous run %s: it is simulated again", name, why)
        return None

    def _seal(self, name: str, index: Mapping[str, Any]) -> str:
        """Return the digest that binds an index to its run, its file name and its contents."""
        contents = json.dumps([self.run, name, index], sort_keys=True)
        return hashlib.blake2b(contents.encode(), digest_size=16).hexdigest()

    @property
    def forcing(self) -> Path | None:
        """The folder of the regridded forcing; None: the disk has no space for it."""
        folder = self.folder / FORCING
        return folder if folder.is_dir() else None


class Gone(Exception):
    """A stored file from which a shard must resume is missing."""


def run_of(fingerprint: Mapping[str, str]) -> str:
    """Return the digest of a run's fingerprint."""
    contents = json.dumps(dict(fingerprint), sort_keys=True)
    return hashlib.blake2b(contents.encode(), digest_size=16).hexdigest()


def mark_of(folder: Path) -> dict[str, Any] | None:
    """Return the fingerprint of the run whose shards a folder holds; None if there is none."""
    try:
        contents = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return contents if isinstance(contents, dict) else None


def _run_in(folder: Path) -> str:
    """Return the digest of the fingerprint of the run whose shards a folder holds."""
    return run_of(mark_of(folder) or {})


def replace(path: Path, text: str) -> None:
    """Write a file atomically, so that a power loss leaves the old or the new contents."""
    new = path.with_suffix(".new")
    with new.open("w", encoding="utf-8") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    os.replace(new, path)


def _digest(path: Path) -> str:
    total = hashlib.blake2b(digest_size=16)
    with path.open("rb") as stream:
        while chunk := stream.read(CHUNK):
            total.update(chunk)
    return total.hexdigest()


def _index(reel: ShardFile) -> dict[str, Any]:
    """Return the positions of a file's columns; the layout is the same at all its outputs."""
    layout = reel.taken[0].layout if reel.taken else None
    return {
        "n": reel.n,
        "size": reel.size,
        "layout": [layout.bounds, layout.numbers, layout.block] if layout else None,
        "times": [str(taken.time) for taken in reel.taken],
        "where": [taken.where for taken in reel.taken],
        "end": reel.end,
        "notes": reel.notes,
    }


def _open_shard_file(file: Path, index: Mapping[str, Any]) -> ShardFile:
    bounds, numbers, block = (tuple(part) for part in index["layout"] or ((), (), ()))
    layout = Layout(bounds, numbers, block)
    taken = [
        SnapshotIndex(np.datetime64(time), layout, where)
        for time, where in zip(index["times"], index["where"], strict=True)
    ]
    notes = {name: Noted(*noted) for name, noted in index["notes"].items()}
    return ShardFile(file, index["n"], taken, index["end"], notes)
