"""The folder in which a run keeps what it has finished, so that one that was killed goes on from there.

It lies beside the results and goes when these stand. Each shard's outputs are a file; a second one, written last and
moved to its name in one step, says where its columns lie and what its bytes add up to. A file that was cut short or
altered is found by that, and its shard is done again. All stands under a fingerprint of the case, the versions, the
forcing and the processor's arithmetic: where that has changed, nothing of it is used.
"""

import contextlib
import hashlib
import json
import logging
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from io import BufferedRandom
from pathlib import Path
from typing import Any

import numpy as np

from drift.motion.spool import BYTES, BYTES_END, NoRoom, Noted, Reel, Taken
from drift.output import hidden
from drift.particles.ensemble import Layout
from geo.errors import UserError

SUFFIX = ".unfinished"
ABOUT = "about.json"
NUMBER = "the number of shards"  # in the fingerprint
INDICES = "shard-*.json"
FORCING = "forcing"  # folder of slices, which all shards sample and one makes
CHUNK = 2**24
LOG = logging.getLogger("drift")  # warnings come to standard error unless a program sends them elsewhere


@dataclass
class Work:
    """What is finished of a run; files: closes what has been opened."""

    folder: Path
    files: contextlib.ExitStack

    def reel(self, number: int, n: int, fill: Callable[[Reel], None]) -> Reel:
        """Return the reel of a shard, read where it is finished, else filled and kept; n: its particles."""
        finished = self._finished(number)
        if finished is not None:
            return finished
        data = self.folder / f"shard-{number:05}.bin"
        with self._room(data):
            reel = Reel(self.files.enter_context(data.open("w+b")), n)
        try:
            fill(reel)
        except NoRoom as error:
            raise self._refusal(data, str(error)) from error
        with self._room(data):
            os.fsync(reel.file.fileno())
            _replace(self._index(number), json.dumps({**_index(reel), "digest": _digest(data)}))
        return reel

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
        return UserError(f"{self.folder}: {why}; {self.kept}; make room, or name another folder with --out")

    @property
    def kept(self) -> str:
        """What is finished, in words."""
        many = len(list(self.folder.glob(INDICES)))
        return f"{many:,} shards are finished and kept there: the same command goes on from them"

    def drop(self) -> None:
        """Take away all that is kept: nothing can come of it."""
        _empty(self.folder)

    def finished(self, number: int) -> bool:
        """Return whether a shard is there, whether or not it has been altered since."""
        return self._index(number).exists()

    def _index(self, number: int) -> Path:
        return self.folder / f"shard-{number:05}.json"

    def _finished(self, number: int) -> Reel | None:
        """Return the reel of a shard that is finished; None where it is not, or has been altered since."""
        data = self.folder / f"shard-{number:05}.bin"
        try:
            index = json.loads(self._index(number).read_text(encoding="utf-8"))
            if _digest(data) == index["digest"]:
                return _read(self.files.enter_context(data.open("r+b")), index)
            why = "has been altered"
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            why = f"cannot be read ({error})"
        LOG.warning("shard %d of the run before %s: it is done again", number, why)
        return None

    @property
    def forcing(self) -> Path | None:
        """The folder of the forcing's slices; None: there is no room for them."""
        folder = self.folder / FORCING
        return folder if folder.is_dir() else None


@contextlib.contextmanager
def opened(out: Path | None, fingerprint: Mapping[str, str], need: int, slices: int = 0) -> Iterator[Work]:
    """Give the work of a run that writes to `out`, as far as it is finished; None: it is not kept.

    fingerprint: of all that decides on the results, by what it is of; need: [bytes] of all shards; slices: [bytes] of the
    forcing's, which are kept if there is room for them too. It stays until `clear`. Raises UserError where another run is at work on it, or there is no room.
    """
    with contextlib.ExitStack() as stack:
        if out is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="drift-")))
            work = Work(folder, stack)
        else:
            folder = _of(out)
            work = Work(folder, stack)
            try:
                folder.mkdir(parents=True, exist_ok=True)
                if not stack.enter_context(hidden.alone(folder, 0.0)):
                    raise UserError(
                        f"{out}: another run is at work on it ({folder}); wait for it, or name another folder with --out"
                    )
                _take_up(work, fingerprint)
            except OSError as error:
                raise UserError(f"{folder}: {error.strerror or error}; name another folder with --out") from error
        have = sum(path.stat().st_size for path in folder.glob("shard-*.bin"))
        room = shutil.disk_usage(folder).free
        if need - have > room:
            raise UserError(
                f"{folder}: the particles at all output times need {need / 2**30:.1f} GiB, and it has room for "
                f"{(room + have) / 2**30:.1f} GiB; make room, name another folder with --out, or ask for fewer particles or outputs"
            )
        _make_room(folder / FORCING, slices, room + have - need)
        yield work


def _make_room(folder: Path, need: int, room: int) -> None:
    """Make the folder of the forcing's slices, if there is room for them [bytes]; say so where there is none."""
    have = sum(path.stat().st_size for path in folder.glob("*"))
    if need <= room + have:
        folder.mkdir(exist_ok=True)
        return
    shutil.rmtree(folder, ignore_errors=True)
    LOG.warning(
        "%s: no room for the forcing as it is sampled (%.1f GiB): each shard reads and regrids it anew",
        folder.parent,
        need / 2**30,
    )


def begun(out: Path | None) -> int | None:
    """Return into how many shards an unfinished run was cut; None where there is none."""
    if out is None:
        return None
    try:
        return int(json.loads((_of(out) / ABOUT).read_text(encoding="utf-8"))[NUMBER])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def clear(out: Path) -> None:
    """Take away what is kept of a run whose results stand."""
    folder = _of(out)
    if folder.exists():
        with hidden.alone(folder, 0.0) as free:
            if free:
                shutil.rmtree(folder, ignore_errors=True)


def _of(out: Path) -> Path:
    """Return the folder beside that of the results."""
    return out.parent / f".{out.name}{SUFFIX}"


def _take_up(work: Work, fingerprint: Mapping[str, str]) -> None:
    """Use what a run before has finished, if it was the same; else say what has changed, and begin anew."""
    about = work.folder / ABOUT
    try:
        before = json.loads(about.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        before = None
    if before == dict(fingerprint):
        many = len(list(work.folder.glob(INDICES)))
        if many:
            LOG.warning("%d shards of this run were finished before: it goes on from there", many)
        return
    if isinstance(before, dict):
        changed = [name for name in {**before, **fingerprint} if before.get(name) != fingerprint.get(name)]
        LOG.warning("an unfinished run is there, but %s changed since: it begins anew", " and ".join(changed))
    _empty(work.folder)
    _replace(about, json.dumps(dict(fingerprint)))


def _empty(folder: Path) -> None:
    """Take away what a run keeps, and nothing else."""
    for path in (*folder.glob("shard-*"), folder / ABOUT):
        path.unlink(missing_ok=True)
    shutil.rmtree(folder / FORCING, ignore_errors=True)


def need(particles: int, outputs: int) -> int:
    """Return how many bytes the files of a run's shards take."""
    return particles * (BYTES * outputs + BYTES_END)


def _replace(path: Path, text: str) -> None:
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


def _index(reel: Reel) -> dict[str, Any]:
    """Return where the columns of a reel lie; the layout is that of the first moment, for nothing is drawn anew."""
    layout = reel.taken[0].layout
    return {
        "n": reel.n,
        "layout": [layout.bounds, layout.numbers, layout.block],
        "times": [str(taken.time) for taken in reel.taken],
        "where": [taken.where for taken in reel.taken],
        "end": reel.end,
        "notes": reel.notes,
    }


def _read(file: BufferedRandom, index: Mapping[str, Any]) -> Reel:
    bounds, numbers, block = (tuple(part) for part in index["layout"])
    layout = Layout(bounds, numbers, block)
    taken = [
        Taken(np.datetime64(time), layout, where) for time, where in zip(index["times"], index["where"], strict=True)
    ]
    notes = {name: Noted(*noted) for name, noted in index["notes"].items()}
    return Reel(file, index["n"], taken, index["end"], notes)
