"""Names that a request may use, and the files that they mean: those right inside the served folder,
and no others.

A name is checked by its letters, and a file is opened step by step without following a link, so
that neither a spelling nor a link, were it put there in between, leads out.
"""

import errno
import os
import re
import stat
from pathlib import Path

LONGEST = 100  # letters of a name
PLAIN = re.compile(r"\w[\w .+()-]*")  # no separator, no hidden file, no option of a command
RESERVED = re.compile(
    r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE
)  # devices of Windows, whatever their ending
LINKS = getattr(os, "O_NOFOLLOW", 0)


def plain(name: str) -> bool:
    """Whether a name is one of a file or a folder, and of nothing else, on every system."""
    return (
        len(name) <= LONGEST
        and bool(PLAIN.fullmatch(name))
        and ".." not in name
        and name[-1] not in " ."
        and not RESERVED.fullmatch(name)
    )


def case(name: str) -> bool:
    """Whether a name is one of a case file."""
    return plain(name) and name.endswith(".toml")


def open_inside(folder: Path, *parts: str) -> int:
    """Return a handle to read a file inside a folder; raise OSError where it is none, or a link is
    on the way.
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
    """Return the bytes of a file inside a folder; raise OSError as `opened` does, or where it is
    larger [bytes].
    """
    with os.fdopen(open_inside(folder, *parts), "rb") as file:
        data = file.read(largest + 1)
    if len(data) > largest:
        raise OSError(errno.EFBIG, f"it has more than {largest // 2**20} MiB")
    return data
