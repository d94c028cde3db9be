"""What a run in shards has finished: files, so that one that was killed goes on from there.

Each shard's outputs are a file; a second one, written last and moved to its name in one step, says
where its columns lie and what its bytes add up to, and is sealed to the run. A file that was cut
short or altered is found by that, and its shard is done again. The folder in which they lie:
drift.pipeline.shards.shelf.
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
# of stretches, of where they ended, of who was drawn again there
KINDS_OF_FILES = ("shard", "state", "drawn")
FORCING = "forcing"  # folder of slices, which all shards sample and one makes
CHUNK = 2**24
# warnings come to standard error unless a program sends them elsewhere
LOG = logging.getLogger("drift")


class Task(Protocol):
    """What one process does at a time of a run in shards."""

    @property
    def case(self) -> Case:
        """Whose run it is."""

    @property
    def number(self) -> int:
        """Number of its shard."""

    @property
    def name(self) -> str:
        """What its file is called."""

    @property
    def of(self) -> str:
        """What it follows from besides the fingerprint of the run."""

    def move(
        self, scene: Scene, where: Environment, tell: simulate.Progress | None, kept: "Work"
    ) -> ShardFile:
        """Return what the particles were like, moved unless that is kept; tell: takes the share
        that is done.
        """


@dataclass(frozen=True)
class Work:
    """What is finished of a run."""

    folder: Path
    run: str  # digest of the fingerprint of the run whose files count
    # files whose bytes are known to be as they were written
    sound: set[str] = field(default_factory=set)

    def reel(self, name: str, n: int, fill: Callable[[ShardFile], None], of: str = "") -> ShardFile:
        """Return the reel of a file, read where it is finished, else filled and kept; n: its
        particles.

        of: what it follows from besides the fingerprint, such as the worlds of a renewal.
        """
        finished = self._finished(name, of)
        if finished is not None:
            return finished
        with self.also(name, n, of) as reel:
            fill(reel)
        return reel

    @contextlib.contextmanager
    def also(self, name: str, n: int, of: str = "") -> Iterator[ShardFile]:
        """Give the reel of a file to fill, and keep it if anything is in it."""
        data = self._data(name)
        with self._room(data):
            self._index(name).unlink(missing_ok=True)
            reel = ShardFile(data.open("w+b"), n)
        try:
            with contextlib.closing(reel):
                yield reel
                with self._room(data):
                    reel.sync()
        except NoRoom as error:
            raise self._refusal(data, str(error)) from error
        except BaseException:
            data.unlink(missing_ok=True)
            raise
        reel.file = data
        if reel.empty:
            data.unlink()
            return
        with self._room(data):
            if run_in(self.folder) != self.run:  # another run has begun again there meanwhile
                raise Gone(name)
            index = {**_index(reel), "of": of, "bytes": _digest(data)}
            replace(self._index(name), json.dumps({**index, "seal": self._seal(name, index)}))
        self.sound.add(name)

    def read(self, name: str) -> ShardFile:
        """Return the reel of a file that was finished before; raise Gone where it is not there, or
        has been altered.
        """
        finished = self._finished(name, "")
        if finished is None:
            raise Gone(name)
        return finished

    def remove(self, name: str) -> None:
        """Take away a file of which nothing is needed any more."""
        self.sound.discard(name)
        self._index(name).unlink(missing_ok=True)
        self._data(name).unlink(missing_ok=True)

    @contextlib.contextmanager
    def _room(self, data: Path) -> Iterator[None]:
        """Refuse what the disk does not take."""
        try:
            yield
        except OSError as error:
            raise self._refusal(data, error.strerror or str(error)) from error

    def _refusal(self, data: Path, why: str) -> UserError:
        with contextlib.suppress(OSError):
            data.unlink()
        return UserError(
            f"{self.folder}: {why}; {self.kept}; free some space, or name another folder with --out"
        )

    @property
    def kept(self) -> str:
        """What is finished, in words."""
        many = len(list(self.folder.glob(INDICES)))
        return f"{many:,} shards are finished and kept there: the same command goes on from them"

    def begin_anew(self) -> None:
        """Take away all that is finished of what moves."""
        self.sound.clear()
        for kind in KINDS_OF_FILES:
            for path in self.folder.glob(f"{kind}-*"):
                path.unlink()

    def drop(self) -> None:
        """Take away all that is kept: nothing can come of it."""
        self.begin_anew()
        shutil.rmtree(self.folder / FORCING, ignore_errors=True)
        (self.folder / ABOUT).unlink(missing_ok=True)

    def finished(self, name: str, of: str = "") -> bool:
        """Return whether a file is there, whether or not it has been altered since; of: see `reel`."""
        try:
            return bool(json.loads(self._index(name).read_text(encoding="utf-8"))["of"] == of)
        except (OSError, ValueError, KeyError, TypeError):
            return False

    def _data(self, name: str) -> Path:
        return self.folder / f"{name}.bin"

    def _index(self, name: str) -> Path:
        return self.folder / f"{name}.json"

    def _finished(self, name: str, of: str) -> ShardFile | None:
        """Return the reel of a file that is finished;

        None where it is not, or has been altered since.
        """
        data = self._data(name)
        try:
            index = json.loads(self._index(name).read_text(encoding="utf-8"))
            seal = index.pop("seal")
            if index["of"] != of:
                why = "is of other worlds"
            elif seal != self._seal(name, index):
                why = "has been altered, or is of another run"
            elif data.stat().st_size != index["size"]:
                why = "has been cut short"
            elif name in self.sound or _digest(data) == index["bytes"]:
                self.sound.add(name)
                return _read(data, index)
            else:
                why = "has been altered"
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            why = f"cannot be read ({error})"
        LOG.warning("%s of the run before %s: it is done again", name, why)
        return None

    def _seal(self, name: str, index: Mapping[str, Any]) -> str:
        """Return what binds an index to its run, to its file's name and to its bytes."""
        told = json.dumps([self.run, name, index], sort_keys=True)
        return hashlib.blake2b(told.encode(), digest_size=16).hexdigest()

    @property
    def forcing(self) -> Path | None:
        """The folder of the forcing's slices; None: there is no room for them."""
        folder = self.folder / FORCING
        return folder if folder.is_dir() else None


class Gone(Exception):
    """A file from which a shard was to go on is not there any more."""


def run_of(fingerprint: Mapping[str, str]) -> str:
    """Return the digest of a run's fingerprint."""
    told = json.dumps(dict(fingerprint), sort_keys=True)
    return hashlib.blake2b(told.encode(), digest_size=16).hexdigest()


def mark_of(folder: Path) -> dict[str, Any] | None:
    """Return the fingerprint of the run whose files a folder keeps; None where there is none."""
    try:
        told = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return told if isinstance(told, dict) else None


def run_in(folder: Path) -> str:
    """Return the digest of the fingerprint of the run whose files a folder keeps; empty where there
    is none.
    """
    return run_of(mark_of(folder) or {})


def replace(path: Path, text: str) -> None:
    """Write a file whole or not at all, so that it outlasts a loss of power."""
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
    """Return where the columns of a reel lie; the layout is the same at all its moments."""
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


def _read(file: Path, index: Mapping[str, Any]) -> ShardFile:
    bounds, numbers, block = (tuple(part) for part in index["layout"] or ((), (), ()))
    layout = Layout(bounds, numbers, block)
    taken = [
        SnapshotIndex(np.datetime64(time), layout, where)
        for time, where in zip(index["times"], index["where"], strict=True)
    ]
    notes = {name: Noted(*noted) for name, noted in index["notes"].items()}
    return ShardFile(file, index["n"], taken, index["end"], notes)
