"""The log of the desk: who did what. It only grows, and the page shows its end.

Jobs can write into the folder, so also into the log: Landlock allows folders, and cannot leave out
one file of them. So the server remembers the state of the file after each of its own lines, and an
entry says if another program has changed it since. The time of change is that of the inode, which
no program can set.
"""

import errno
import json
import os
import stat
import time
from collections import deque
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from drift.apps.serve import names

NAME = "desk_log.jsonl"
SHOWN = 100  # last lines that the page shows
END = 2**16  # [bytes] of the file that are read for them
KEPT = 100  # entries of this start that pages can still learn of
BINARY = getattr(os, "O_BINARY", 0)  # Windows


@dataclass(frozen=True)
class Entry:
    """What a user did, as a line of the log has it; time in UTC."""

    time: str
    user: str
    action: str  # entered, saved, copied, or: started, cancelled, finished, failed with a command
    case: str | None = None
    digest: str | None = None  # of a saved case
    result: str | None = None  # folder of a result; of a webhook what went wrong


State = tuple[int, int, int]  # inode, size [bytes] and time of change of its inode [ns]
FOREIGN = f"noticed that another program has changed {NAME}"


class DeskLog:
    """The log of a served folder; an entry that cannot be written does not stop the work."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._recent: deque[tuple[int, Entry]] = deque(maxlen=KEPT)
        self._state: State | None = None  # of the file after our last line
        self.last = 0  # number of the newest entry of this start
        self.trouble = ""

    def add(self, user: str, action: str, **values: str | None) -> None:
        """Add an entry; values: its case, digest and result."""
        self._notice()
        self._add(user, action, **values)

    def _notice(self) -> None:
        """Add an entry if another program has changed the file since our last line."""
        if self._state is not None and _state(self._folder / NAME) != self._state:
            self._state = None  # else a file that cannot be written is noticed again and again
            self._add("drift", FOREIGN)

    def _add(self, user: str, action: str, **values: str | None) -> None:
        now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        entry = Entry(now, user, action, **values)
        self.last += 1
        self._recent.append((self.last, entry))
        try:
            self._write(json.dumps(asdict(entry)).encode() + b"\n")
            self.trouble = ""
        except OSError as error:
            self.trouble = f"{NAME} cannot be written: {error.strerror}"

    def since(self, number: int) -> list[dict[str, Any]]:
        """Return the entries of this start after a number, as far as they are kept."""
        return [{"number": own, **asdict(entry)} for own, entry in self._recent if own > number]

    def end(self) -> list[dict[str, Any]]:
        """Return the last lines of the file, the newest first.

        Raises OSError if the file cannot be read.
        """
        self._notice()
        try:
            handle = names.open_inside(self._folder, NAME)
        except FileNotFoundError:
            return []
        with os.fdopen(handle, "rb") as file:
            begin = max(0, os.fstat(handle).st_size - END)
            file.seek(begin)
            lines = file.read(END).split(b"\n")[1 if begin else 0 :]
        found = [entry for line in lines if (entry := _parsed(line)) is not None]
        return found[: -SHOWN - 1 : -1]

    def _write(self, line: bytes) -> None:
        """Append a line in one piece; a line that broke off before it stays one of its own."""
        flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | names.LINKS | BINARY
        handle = os.open(self._folder / NAME, flags | getattr(os, "O_NONBLOCK", 0), 0o600)
        try:
            status = os.fstat(handle)
            if not stat.S_ISREG(status.st_mode):
                raise OSError(errno.EINVAL, "it is not a file")
            if status.st_size:
                os.lseek(handle, -1, os.SEEK_END)
                if os.read(handle, 1) != b"\n":
                    line = b"\n" + line
            if os.write(handle, line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            self._state = _state(handle)
        finally:
            os.close(handle)


def _state(place: Path | int) -> State | None:
    """Return the state of a file, given its path or a handle; None if there is none."""
    try:
        status = os.stat(place)
    except OSError:
        return None
    return status.st_ino, status.st_size, status.st_ctime_ns


def _parsed(line: bytes) -> dict[str, Any] | None:
    """Return an entry of the file as text; None if the line is not one."""
    try:
        content = json.loads(line)
        entry = Entry(**content)
    except (ValueError, TypeError, RecursionError):
        return None
    if not all(isinstance(value, str | None) for value in content.values()):
        return None
    return asdict(entry)
