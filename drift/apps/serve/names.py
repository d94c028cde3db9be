"""Check names in requests, and open the files that they refer to inside the served folder only.

A name is checked by its characters, and a file is opened step by step without following links, so
that neither a spelling nor a link created in the meantime can lead out of the folder.
"""

import errno
import os
import re
import stat
import unicodedata
from pathlib import Path

LONGEST = 100  # characters of a name
PLAIN = re.compile(r"\w[\w .+()-]*")  # no separator, no hidden file, no option of a command
RESERVED = re.compile(
    r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE
)  # device names of Windows, with any suffix
LINKS = getattr(os, "O_NOFOLLOW", 0)


def plain(name: str) -> bool:
    """Return True for a name that is a plain file or folder name on every system."""
    return (
        len(name) <= LONGEST
        and bool(PLAIN.fullmatch(name))
        and ".." not in name
        and name[-1] not in " ."
        and not RESERVED.fullmatch(name)
    )


def folded(name: str) -> str:
    """Return what two names share that some system takes for one: case and Unicode form."""
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())


def case(name: str) -> bool:
    """Return True for a name of a case file."""
    return plain(name) and name.endswith(".toml")


def open_inside(folder: Path, *parts: str) -> int:
    """Return a handle for reading a file inside a folder.

    Raises OSError if it is not a regular file, or its path contains a link.
    """
    if not all(map(plain, parts)):
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
    if os.open in os.supports_dir_fd:
        place = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            for part in parts[:-1]:
                inner = os.open(part, os.O_RDONLY | os.O_DIRECTORY | LINKS, dir_fd=place)
                os.close(place)
                place = inner
            handle = os.open(parts[-1], os.O_RDONLY | LINKS | os.O_NONBLOCK, dir_fd=place)
        finally:
            os.close(place)
    else:  # Windows
        path = folder.joinpath(*parts)
        if path.resolve() != path:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
    return handle


def contents(folder: Path, *parts: str, largest: int) -> bytes:
    """Return the bytes of a file inside a folder.

    Raises OSError as `open_inside` does, and for a file above `largest` [bytes].
    """
    with os.fdopen(open_inside(folder, *parts), "rb") as file:
        data = file.read(largest + 1)
    if len(data) > largest:
        raise OSError(errno.EFBIG, f"it has more than {largest // 2**20} MiB")
    return data
