"""Digests of input files, which identify the inputs of a run whatever the files are called.

A separate thread computes them during the run, once per file and process as long as the file does
not change.
"""

import hashlib
import os
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from pathlib import Path

from geo.files import fence

CHUNK = 2**22  # [bytes]

Key = tuple[tuple[str, int, int], ...]  # path, size and modification time of each file

_digests: dict[Key, "Future[str]"] = {}
_guard = threading.Lock()


def start(paths: Iterable[str]) -> None:
    """Start computing the digests of files and of folders such as Zarr stores; return at once."""
    new: list[tuple[str, Future[str]]] = []
    with _guard:
        for path in paths:
            key = _state_key(path)
            if key is not None and key not in _digests:
                _digests[key] = Future()
                new.append((path, _digests[key]))
    if new:  # a daemon thread, so that the process can end before it
        threading.Thread(target=_compute_digests, args=(new,), name="digest", daemon=True).start()


def digest_of(path: str) -> str:
    """Return "sha256:..." of the bytes of a file or a folder of files, when it is computed.

    Raises OSError if it cannot be read.
    """
    start([path])
    key = _state_key(path)
    if key is None:
        raise FileNotFoundError(path)
    return _digests[key].result()


def size(path: str) -> int:
    """Return the size of a file or a folder of files [bytes]."""
    return sum(os.path.getsize(file) for file in _files_below(path))


def _state_key(path: str) -> Key | None:
    """Return a key for the present state of a file or folder; None if it cannot be read."""
    try:
        stats = [(file, os.stat(file)) for file in _files_below(path)]
    except (OSError, ValueError):
        return None
    return tuple(
        (os.path.abspath(file), status.st_size, status.st_mtime_ns) for file, status in stats
    )


def _compute_digests(promised: list[tuple[str, "Future[str]"]]) -> None:
    """Compute the digest of each path and set it, or the error, as the result of its future."""
    for path, answer in promised:
        try:
            answer.set_result(_digest(path))
        except BaseException as error:
            answer.set_exception(error)


def _files_below(path: str) -> Iterator[str]:
    """Yield the path itself if it is a file, or all files below it if it is a folder."""
    if not os.path.isdir(path):
        yield path
        return
    yield from sorted(str(file) for file in Path(path).rglob("*") if file.is_file())


def _digest(path: str) -> str:
    fence.check_store(path)
    total = hashlib.sha256()
    for file in _files_below(path):
        if file != path:
            total.update(f"{os.path.relpath(file, path)}\n{os.path.getsize(file)}\n".encode())
        with open(file, "rb") as stream:
            while chunk := stream.read(CHUNK):
                total.update(chunk)
    return f"sha256:{total.hexdigest()}"
