"""What the served folder holds: case files, which can be read and saved, and whole results of runs."""

import errno
import hashlib
import json
import math
import os
import re
import secrets
import stat
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from drift.apps.serve import names
from drift.products.files import hidden, manifest

LARGEST = 2**20  # [bytes] of a case: sixty times the largest that ships
LARGEST_SUMMARY = 2**26  # [bytes]
PATIENCE = 2.0  # [s] until another server has saved
MOST = 1000  # entries that are listed of each kind
TITLE = re.compile(r"""^title[ \t]*=[ \t]*(?:("(?:[^"\\\n]|\\.)*")|('[^'\n]*'))""", re.MULTILINE)
SUMMARY, REPORT = "summary.json", "report.html"
KINDS = {
    "patrols.txt": "patrols",
    "plan.txt": "plan",
    "origin.nc": "origin",
    "verify.csv": "verify",
}


class Conflict(Exception):
    """A case is not any more, or already, as the one who saves it believes."""


def digest(data: bytes) -> str:
    """Return what tells one state of a case from another."""
    return hashlib.sha256(data).hexdigest()


def read_case(folder: Path, name: str) -> tuple[str, str]:
    """Return a case's text and digest; raise OSError, or ValueError where it is no text in UTF-8."""
    data = names.contents(folder, name, largest=LARGEST)
    return data.decode("utf-8-sig"), digest(data)


def save(folder: Path, name: str, text: str, before: str | None) -> str:
    """Write a case, whole or not at all, and return its digest.

    before: its digest when it was read, None for one that must not be there yet. Raises Conflict,
    and writes nothing, where it is otherwise by now; OSError where another server saves in the
    folder and does not come to an end.
    """
    with hidden.alone(folder, PATIENCE) as free:  # else two servers may both find what they expect
        if not free:
            raise OSError(errno.EBUSY, "another program is writing to this folder; try again")
        return _written(folder, name, text.encode("utf-8"), before)


def _written(folder: Path, name: str, data: bytes, before: str | None) -> str:
    mode = 0o644
    if before is not None:
        try:
            if digest(names.contents(folder, name, largest=LARGEST)) != before:
                raise Conflict
            mode = stat.S_IMODE(os.stat(folder / name, follow_symlinks=False).st_mode)
        except FileNotFoundError:
            raise Conflict from None
    half = folder / f".{secrets.token_hex(8)}.part"
    try:
        with os.fdopen(
            os.open(half, os.O_WRONLY | os.O_CREAT | os.O_EXCL | names.LINKS, mode), "wb"
        ) as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if before is None:
            _appear(half, folder / name)
        else:
            # a link that was put there meanwhile is replaced, not followed
            os.replace(half, folder / name)
    finally:
        half.unlink(missing_ok=True)
    return digest(data)


def save_new(folder: Path, stem: str, text: str) -> str:
    """Write a case under the first free name and return that."""
    for k in range(1, MOST):
        with suppress(Conflict):
            name = f"{stem}.toml" if k == 1 else f"{stem}-{k}.toml"
            save(folder, name, text, None)
            return name
    raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))


def lay_beside(folder: Path, path: str, data: bytes) -> None:
    """Write "folder/name", unless it is there already; raise OSError where that folder is a link."""
    inner, name = path.split("/")
    with suppress(FileExistsError):
        os.mkdir(folder / inner)
    if not stat.S_ISDIR(os.lstat(folder / inner).st_mode):
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
    with suppress(Conflict):
        _written(folder / inner, name, data, None)


def _appear(half: Path, path: Path) -> None:
    """Give a new file its name, unless that is taken."""
    try:
        os.link(half, path)
    except FileExistsError:
        raise Conflict from None
    except OSError:  # a file system without links
        if os.path.lexists(path):
            raise Conflict from None
        os.replace(half, path)


def cases(folder: Path) -> list[dict[str, Any]]:
    """Return the case files of a folder: name, title, when changed [s since 1970]."""
    found = []
    for entry in _entries(folder):
        if names.case(entry.name) and entry.is_file(follow_symlinks=False):
            with suppress(OSError):
                status = entry.stat(follow_symlinks=False)
                title = _title(folder, entry.name, status.st_mtime_ns, status.st_size)
                found.append({"name": entry.name, "title": title, "changed": status.st_mtime})
    return sorted(found, key=lambda row: str(row["name"]).lower())


@lru_cache(4 * MOST)
def _title(folder: Path, name: str, changed: int, size: int) -> str:
    """Return a case's title, "" where no line gives one; the state of the file is part of the
    question.

    The whole text is parsed in processes of their own only: TOML that is made for it takes hours.
    """
    try:
        found = TITLE.search(read_case(folder, name)[0])
    except (OSError, ValueError):
        return ""
    if found is None:
        return ""
    try:
        return _words(json.loads(found[1]) if found[1] else found[2][1:-1])
    except ValueError:  # an escape that JSON does not have
        return _words(found[1][1:-1])


def runs(folder: Path) -> list[dict[str, Any]]:
    """Return the whole results in a folder, the newest first."""
    found = []
    for entry in _entries(folder):
        if names.plain(entry.name) and entry.is_dir(follow_symlinks=False):
            with suppress(OSError):
                status = os.stat(folder / entry.name / manifest.NAME, follow_symlinks=False)
                if (row := _run(folder, entry.name, status.st_mtime_ns)) and _whole(
                    folder / entry.name, row["sizes"]
                ):
                    found.append({key: value for key, value in row.items() if key != "sizes"})
    return sorted(found, key=lambda row: str(row["made"]), reverse=True)


@lru_cache(MOST)
def _run(folder: Path, name: str, changed: int) -> dict[str, Any] | None:
    """Return what the list says of a run, None where it is no result of ours."""
    listed = manifest.read_manifest(folder / name)
    if listed is None or SUMMARY not in listed.names:
        return None
    try:
        told = json.loads(names.contents(folder, name, SUMMARY, largest=LARGEST_SUMMARY))
        run, warnings = told.get("run", {}), told.get("warnings", [])
        seconds = told.get("wall_time_s", {})
        took = sum(float(part) for part in seconds.values()) if isinstance(seconds, dict) else None
        took = took if took is not None and math.isfinite(took) else None
    except (OSError, ValueError, OverflowError, RecursionError, AttributeError, TypeError):
        return None
    sizes = {entry.name: entry.size for entry in listed.files if names.plain(entry.name)}
    return {
        "name": name,
        "title": _words(told.get("title", "")),
        "kind": next((kind for file, kind in KINDS.items() if file in sizes), "forecast"),
        "start": _words(run.get("start", "")) if isinstance(run, dict) else "",
        "end": _words(run.get("end", "")) if isinstance(run, dict) else "",
        "took": took,
        "warnings": [_words(line) for line in warnings] if isinstance(warnings, list) else [],
        "made": _words(told.get("date_created", "")),
        "report": REPORT in sizes,
        "files": [
            {"name": file, "bytes": size} for file, size in sorted(sizes.items()) if file != REPORT
        ],
        "sizes": sizes,
    }


def _whole(place: Path, sizes: dict[str, int]) -> bool:
    """Whether all files of a run are there, in their sizes; their digests would take minutes."""
    for name, size in sizes.items():
        status = os.stat(place / name, follow_symlinks=False)
        if not stat.S_ISREG(status.st_mode) or status.st_size != size:
            return False
    return True


def _words(value: Any) -> str:
    """Return a text that a list may show: one line, not endless, and no half letters, which cannot
    be sent.
    """
    return " ".join(str(value).encode("utf-8", "replace").decode("utf-8").split())[:300]


def _entries(folder: Path) -> Iterator["os.DirEntry[str]"]:
    with os.scandir(folder) as entries:
        for _, entry in zip(range(MOST * 10), entries, strict=False):
            yield entry


def file_of_run(folder: Path, run: str, name: str) -> tuple[int, int]:
    """Return a handle and the size [bytes] of a file that the manifest of a run names; raise
    OSError for any other.
    """
    if not (names.plain(run) and names.plain(name)) or os.path.islink(folder / run):
        raise FileNotFoundError
    listed = manifest.read_manifest(folder / run)
    if listed is None or name not in listed.names:
        raise FileNotFoundError
    handle = names.open_inside(folder, run, name)
    return handle, os.fstat(handle).st_size
