"""Read small files that users write (cases, tracks, shorelines) completely.

A file is read only if reading is sure to end.
"""

import errno
import os
import stat
from pathlib import Path

from geo.files import fence

LARGEST = 64 * 2**20  # [bytes]


def read_small_file(path: Path, largest: int = LARGEST) -> bytes:
    """Return the bytes of a file.

    Args:
        path: of the file.
        largest: size limit [bytes].

    Raises:
        OSError: with a strerror for users; the file cannot be read, is too large, or is a pipe or
            device, from which reading might never end.
        UserError: the file may not be read (`geo.files.fence`).
    """
    fence.check(path)
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        fence.check_open(handle, path)
        status = os.fstat(handle)
        if stat.S_ISDIR(status.st_mode):
            raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "it is a pipe or a device, not a file")
        if status.st_size > largest:
            raise OSError(
                errno.EFBIG,
                f"it has {status.st_size / 2**20:,.0f} MiB; at most {largest // 2**20} are read",
            )
        with os.fdopen(os.dup(handle), "rb") as file:
            data = file.read(largest + 1)
    finally:
        os.close(handle)
    if len(data) > largest:  # it has grown since, as files in /proc may
        raise OSError(errno.EFBIG, f"it has more than {largest // 2**20} MiB")
    return data
