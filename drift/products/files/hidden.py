"""Hidden folders in which runs prepare their results, and whether the owner of each is alive.

The owner holds a lock on a file in its folder, which the kernel releases when the owner dies in
whatever way. Where file locks are unreliable, as between the machines of some network file systems,
the folder's name contains the owner's machine and process. A folder whose owner cannot be checked
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
except ImportError:  # Windows: the owner is only known by name
    fcntl = None  # type: ignore[assignment]

PREFIX = ".drift-partial-"
UNFINISHED = (
    # suffix of the folder in which a run keeps its work; as a name, that inside of the results
    ".unfinished"
)
LOCK = "lock"
# [s] without a change after which a folder counts as abandoned if its owner cannot be checked
STALE = 86_400
ATTEMPTS = 10


def make_hidden_folder(ground: Path) -> tuple[Path, int]:
    """Create a hidden folder in another one; return it with the open lock of its owner."""
    for _ in range(ATTEMPTS):
        folder = Path(tempfile.mkdtemp(prefix=f"{PREFIX}{'-'.join(_owner_names())}-", dir=ground))
        lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        # Another run may have removed the folder as abandoned just before the lock was held.
        if _try_lock(lock) is not False and (folder / LOCK).exists():
            return folder, lock
        os.close(lock)
    raise OSError(f"no folder can be made in {ground}")


def remove(folder: Path) -> None:
    """Remove a hidden folder as far as possible."""
    shutil.rmtree(folder, ignore_errors=True)


def hidden_folders_in(ground: Path) -> list[Path]:
    """Return the hidden folders in a folder, sorted by name."""
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
def lock_if_abandoned(folder: Path) -> Iterator[bool]:
    """Lock a hidden folder unless a living process owns it; yield whether it is locked."""
    lock: int | None = None
    try:
        with contextlib.suppress(OSError):  # no lock file yet, already gone, or another user's
            lock = os.open(folder / LOCK, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
        yield _is_abandoned(folder, None if lock is None else _try_lock(lock))
    finally:
        if lock is not None:
            os.close(lock)


def _is_abandoned(folder: Path, locked: bool | None) -> bool:
    """Return True if the owner of a folder is known to be dead.

    locked: whether we could lock its file; None if the file system has no locks.
    """
    if locked is False:
        return False
    host, kernel, space, process = _owner_names()
    owner = folder.name[len(PREFIX) :].split("-")
    if locked and (owner[:1] == [host] or owner[1:2] == [kernel]):
        return True  # this machine's kernel gave the lock, so the owner had released it
    if (
        os.name == "posix"
        and owner[:3] == [host, kernel, space]
        and len(owner) > 3
        and owner[3].isdecimal()
    ):
        return owner[3] != process and not _is_running(int(owner[3]))
    return not _changed_recently(folder)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        pass  # it belongs to another user
    return True


def _changed_recently(folder: Path) -> bool:
    """Return True if anything in a folder changed within the last day."""
    newest = 0.0
    with contextlib.suppress(OSError):
        newest = folder.stat().st_mtime
        for path in folder.rglob("*"):
            newest = max(newest, path.lstat().st_mtime)
    return time.time() - newest < STALE


def _try_lock(lock: int) -> bool | None:
    """Try to lock an open file.

    Returns False if another process has locked it, None if the file system has no locks.
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


def _owner_names() -> tuple[str, str, str, str]:
    """Return short names of this machine, kernel boot, process namespace, and process."""
    host, kernel, space = socket.gethostname(), "", ""
    with contextlib.suppress(OSError):
        kernel = Path("/proc/sys/kernel/random/boot_id").read_text()
        space = str(os.stat("/proc/self/ns/pid").st_ino)
    names = (host, kernel or host, f"{kernel or host} {space}")
    first, second, third = (hashlib.sha256(name.encode()).hexdigest()[:8] for name in names)
    return first, second, third, str(os.getpid())


@contextmanager
def folder_lock(folder: Path, patience: float, *, shared: bool = False) -> Iterator[bool]:
    """Lock a folder against other processes of drift, or share it.

    A file system without locks grants it at once.

    Args:
        folder: the folder.
        patience: longest wait [s].
        shared: whether others may share it.

    Returns:
        A context manager that yields whether it was locked in time.
    """
    if fcntl is None:
        yield True
        return
    lock = os.open(folder, os.O_RDONLY)
    try:
        yield _wait_for_lock(lock, fcntl.LOCK_SH if shared else fcntl.LOCK_EX, patience)
    finally:
        os.close(lock)


def _wait_for_lock(lock: int, kind: int, patience: float) -> bool:
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
