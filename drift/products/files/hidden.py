"""Hidden folders in which runs make their results: whose each is, and whether its owner lives.

The owner holds a lock on a file in its folder, which the kernel gives back at the owner's death,
however it died. Where a file system's locks say nothing, as between the machines of some networks,
the owner's machine and process stand in the folder's name; a folder whose owner cannot be asked
counts as owned until nothing has changed in it for a day.
"""

import contextlib
import hashlib
import os
import shutil
import socket
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: the owner is known by name alone
    fcntl = None  # type: ignore[assignment]

PREFIX = ".drift-partial-"
UNFINISHED = (
    # how the name of a folder ends in which a run keeps its work; in that of the results its name
    ".unfinished"
)
LOCK = "lock"
# [s]; a folder whose owner cannot be asked counts as abandoned after so long without a change
STALE = 86_400
ATTEMPTS = 10


def make(ground: Path) -> tuple[Path, int]:
    """Return a new hidden folder in another, and the open lock by which it is owned."""
    for _ in range(ATTEMPTS):
        folder = Path(tempfile.mkdtemp(prefix=f"{PREFIX}{'-'.join(_self())}-", dir=ground))
        lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        # Another run may have taken the folder for a dead one's in the moment before the lock was
        # held.
        if _locked(lock) is not False and (folder / LOCK).exists():
            return folder, lock
        os.close(lock)
    raise OSError(f"no folder can be made in {ground}")


def remove(folder: Path) -> None:
    """Take away a hidden folder as far as that is possible."""
    shutil.rmtree(folder, ignore_errors=True)


def within(ground: Path) -> list[Path]:
    """Return the hidden folders in a folder, by name."""
    try:
        with os.scandir(ground) as entries:
            names = sorted(
                entry.name
                for entry in entries
                if entry.name.startswith(PREFIX) and entry.is_dir(follow_symlinks=False)
            )
    except OSError:
        return []
    return [ground / name for name in names]


@contextmanager
def taken(folder: Path) -> Iterator[bool]:
    """Hold a hidden folder that no living process owns; gives whether it is held."""
    lock: int | None = None
    try:
        with contextlib.suppress(OSError):  # it has none yet, is gone, or belongs to another user
            lock = os.open(folder / LOCK, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
        yield _dead(folder, None if lock is None else _locked(lock))
    finally:
        if lock is not None:
            os.close(lock)


def _dead(folder: Path, locked: bool | None) -> bool:
    """Whether the owner of a folder is known to be dead.

    locked: whether its lock could be had; None if that says nothing.
    """
    if locked is False:
        return False
    host, kernel, space, process = _self()
    owner = folder.name[len(PREFIX) :].split("-")
    if locked and (owner[:1] == [host] or owner[1:2] == [kernel]):
        return True  # the lock was given by this machine's kernel
    if (
        os.name == "posix"
        and owner[:3] == [host, kernel, space]
        and len(owner) > 3
        and owner[3].isdecimal()
    ):
        return owner[3] != process and not _runs(int(owner[3]))
    return not _changed(folder)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        pass  # it is another user's
    return True


def _changed(folder: Path) -> bool:
    """Whether anything in a folder is younger than a day."""
    newest = 0.0
    with contextlib.suppress(OSError):
        newest = folder.stat().st_mtime
        for path in folder.rglob("*"):
            newest = max(newest, path.lstat().st_mtime)
    return time.time() - newest < STALE


def _locked(lock: int) -> bool | None:
    """Lock an open file at once;

    False where another process has it, None where the file system knows no locks.
    """
    if fcntl is None:
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def _self() -> tuple[str, str, str, str]:
    """Return short names of this machine, its running kernel, its space of process numbers, and the
    process.
    """
    host, kernel, space = socket.gethostname(), "", ""
    with contextlib.suppress(OSError):
        kernel = Path("/proc/sys/kernel/random/boot_id").read_text()
        space = str(os.stat("/proc/self/ns/pid").st_ino)
    names = (host, kernel or host, f"{kernel or host} {space}")
    first, second, third = (hashlib.sha256(name.encode()).hexdigest()[:8] for name in names)
    return first, second, third, str(os.getpid())


@contextmanager
def alone(folder: Path, patience: float, *, shared: bool = False) -> Iterator[bool]:
    """Hold a folder against other processes of ours, or share it; gives whether it came free in
    time [s].

    A file system without locks on folders gives it at once.
    """
    if fcntl is None:
        yield True
        return
    lock = os.open(folder, os.O_RDONLY)
    try:
        yield _waited(lock, fcntl.LOCK_SH if shared else fcntl.LOCK_EX, patience)
    finally:
        os.close(lock)


def _waited(lock: int, kind: int, patience: float) -> bool:
    until = time.monotonic() + patience
    while True:
        try:
            fcntl.flock(lock, kind | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > until:
                return False
            time.sleep(0.02)
        except OSError:
            return True
        else:
            return True
