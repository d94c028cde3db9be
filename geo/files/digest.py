"""Digests of input files: what exactly went into a run, whatever the files were called.

They are made by a thread of their own while the run goes on, each file once in a process as long as it does not change.
"""

import hashlib
import os
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from pathlib import Path

CHUNK = 2**22  # [bytes]

Key = tuple[tuple[str, int, int], ...]  # path, size and time of change of each file

_known: dict[Key, "Future[str]"] = {}
_guard = threading.Lock()


def start(paths: Iterable[str]) -> None:
    """Begin to digest files, and folders such as Zarr stores, and return at once."""
    new: list[tuple[str, Future[str]]] = []
    with _guard:
        for path in paths:
            key = _key(path)
            if key is not None and key not in _known:
                _known[key] = Future()
                new.append((path, _known[key]))
    if new:  # a daemon: nobody waits for it at the end of the process
        threading.Thread(target=_work, args=(new,), name="digest", daemon=True).start()


def of(path: str) -> str:
    """Return "sha256:..." of all that a file, or a folder of files, holds; raise OSError where it can't be read."""
    start([path])
    key = _key(path)
    if key is None:
        raise FileNotFoundError(path)
    return _known[key].result()


def size(path: str) -> int:
    """Return how many bytes a file, or a folder of files, holds."""
    return sum(os.path.getsize(file) for file in _files(path))


def _key(path: str) -> Key | None:
    try:
        seen = [(file, os.stat(file)) for file in _files(path)]
    except (OSError, ValueError):
        return None
    return tuple((os.path.abspath(file), one.st_size, one.st_mtime_ns) for file, one in seen)


def _work(wanted: list[tuple[str, "Future[str]"]]) -> None:
    for path, answer in wanted:
        try:
            answer.set_result(_digest(path))
        except BaseException as error:
            answer.set_exception(error)


def _files(path: str) -> Iterator[str]:
    if not os.path.isdir(path):
        yield path
        return
    yield from sorted(str(file) for file in Path(path).rglob("*") if file.is_file())


def _digest(path: str) -> str:
    total = hashlib.sha256()
    for file in _files(path):
        if file != path:
            total.update(f"{os.path.relpath(file, path)}\n{os.path.getsize(file)}\n".encode())
        with open(file, "rb") as stream:
            while chunk := stream.read(CHUNK):
                total.update(chunk)
    return f"sha256:{total.hexdigest()}"
