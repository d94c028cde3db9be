"""Disk cache of slices, shared by all processes that see a folder: one makes a slice, all read it.

Each slice is a file, written under another name and renamed when it is complete. It ends with its
shape and a digest of its bytes; a process that first opens a damaged file detects that and makes
the slice again. Files are mapped into memory, so that the processes of one machine share the pages.
"""

import contextlib
import hashlib
import os
import struct
import time
import uuid
from collections.abc import Callable, Hashable, Iterator
from pathlib import Path

import numpy as np

from geo import waiting
from geo.array import Array

try:
    import fcntl
except ImportError:  # Windows: two processes may both make a slice, bitwise equal
    fcntl = None  # type: ignore[assignment]

DIGEST = 16  # [bytes]
SHAPE = struct.Struct("<3q")
SUFFIX = ".slice"
POLL = 0.02  # [s]


class Stored:
    """Finished slices in a folder, float32 (nlat, nlon, 2)."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._valid: set[str] = set()  # slices whose digest this process has checked

    def get(self, key: Hashable, make: Callable[[], Array]) -> Array:
        """Return the slice of a key; if it is absent, only one process makes it."""
        name = hashlib.sha256(repr(key).encode()).hexdigest()[:32]
        found = self._read(name)
        if found is not None:
            return found
        with _exclusive(self.folder / f"{name}.lock"):
            found = self._read(name)
            if found is not None:
                return found
            values = make()
            self._write(name, values)
        return values

    def _read(self, name: str) -> Array | None:
        """Return a slice; None if it is absent or damaged."""
        try:
            # copy on write: a device may copy an argument back, which must not change the file
            mapped = np.memmap(self.folder / f"{name}{SUFFIX}", np.uint8, "c")
            body, shape, digest = np.split(mapped, (-DIGEST - SHAPE.size, -DIGEST))
            if name not in self._valid and _digest(name, body, shape.tobytes()) != digest.tobytes():
                return None
            values = np.asarray(body).view(np.float32).reshape(SHAPE.unpack(shape.tobytes()))
        except (OSError, ValueError, struct.error):  # the file is absent, empty or too short
            return None
        self._valid.add(name)
        return values

    def _write(self, name: str, values: Array) -> None:
        """Write a slice; a full or failing disk is ignored."""
        new = self.folder / f"{name}-{uuid.uuid4().hex}.new"
        body, shape = (
            np.ascontiguousarray(values, np.float32).reshape(-1).view(np.uint8),
            SHAPE.pack(*values.shape),
        )
        try:
            with new.open("wb") as stream:
                stream.write(body.data)
                stream.write(shape + _digest(name, body, shape))
            os.replace(new, self.folder / f"{name}{SUFFIX}")
        except OSError:
            with contextlib.suppress(OSError):
                new.unlink(missing_ok=True)


def _digest(name: str, body: Array, shape: bytes) -> bytes:
    total = hashlib.blake2b(name.encode(), digest_size=DIGEST)
    total.update(body.data)
    total.update(shape)
    return total.digest()


@contextlib.contextmanager
def _exclusive(path: Path) -> Iterator[None]:
    """Hold a lock file, which the system releases if the process ends.

    On systems without locks, continue without.
    """
    lock = None
    try:
        with contextlib.suppress(OSError):
            lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        while lock is not None and not _try_lock(lock):
            waiting.check_wait()
            time.sleep(POLL)
        yield
    finally:
        if lock is not None:
            os.close(lock)


def _try_lock(lock: int) -> bool:
    """Try to lock an open file; return False if another process has the lock."""
    try:
        if fcntl is not None:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass  # a file system without locks
    return True
