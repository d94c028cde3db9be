"""Small files that users write: cases, tracks, shorelines. Read whole, once it is sure that reading comes to an end."""

import errno
import os
import stat
from pathlib import Path

LARGEST = 64 * 2**20  # [bytes]


def contents(path: Path, largest: int = LARGEST) -> bytes:
    """Return the bytes of a file.

    Raises OSError, its strerror in words for users, for what cannot be read, for a pipe or a device, which might wait or
    go on for ever, and for more than `largest` bytes.
    """
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        found = os.fstat(handle)
        if stat.S_ISDIR(found.st_mode):
            raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
        if not stat.S_ISREG(found.st_mode):
            raise OSError(errno.EINVAL, "it is a pipe or a device, not a file")
        if found.st_size > largest:
            raise OSError(errno.EFBIG, f"it has {found.st_size / 2**20:,.0f} MiB; at most {largest // 2**20} are read")
        with os.fdopen(os.dup(handle), "rb") as file:
            data = file.read(largest + 1)
    finally:
        os.close(handle)
    if len(data) > largest:  # it grows, as files of /proc may
        raise OSError(errno.EFBIG, f"it has more than {largest // 2**20} MiB")
    return data
