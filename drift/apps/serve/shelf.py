"""The served folder: case files, which can be read and saved, and complete results of runs."""

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

LARGEST = 2**20  # [bytes] most of a case: sixty times the largest that ships
LARGEST_SUMMARY = 2**26  # [bytes]
PATIENCE = 2.0  # [s] to wait for another server that is saving
MOST = 1000  # entries of each kind that are listed
TITLE = re.compile(r"""^title[ \t]*=[ \t]*(?:("(?:[^"\\\n]|\\.)*")|('[^'\n]*'))""", re.MULTILINE)
SUMMARY, REPORT = "summary.json", "report.html"
KINDS = {
    "patrols.txt": "patrols",
    "plan.txt": "plan",
    "origin.nc": "origin",
    "verify.csv": "verify",
}


class Conflict(Exception):
    """The case file on disk is not in the state that the client expects."""


def digest(data: bytes) -> str:
    """Return the digest that identifies the state of a case file."""
    return hashlib.sha256(data).hexdigest()


def read_case(folder: Path, name: str) -> tuple[str, str]:
    """Return a case's text and digest; raise OSError, or ValueError if it is not UTF-8 text."""
    data = names.contents(folder, name, largest=LARGEST)
    return data.decode("utf-8-sig"), digest(data)


def save(folder: Path, name: str, text: str, before: str | None) -> str:
    """Write a case completely or not at all, and return its digest.

    before: the digest when it was read; None for a case that must not exist yet. Raises Conflict if
    the file has changed since then, and OSError if another server keeps the folder locked.
    """
    return save_bytes(folder, name, text.encode("utf-8"), before)


def save_bytes(folder: Path, name: str, data: bytes, before: str | None) -> str:
    """Write a file as `save` does."""
    with hidden.folder_lock(folder, PATIENCE) as free:  # else two servers may both pass the check
        if not free:
            raise OSError(errno.EBUSY, "another program is writing to this folder; try again")
        if before is None and any(
            names.folded(entry.name) == names.folded(name) for entry in entries(folder)
        ):
            raise Conflict  # or it overwrites the other where the folder is copied to
        return _write_case(folder, name, data, before)


def _write_case(folder: Path, name: str, data: bytes, before: str | None) -> str:
    mode = 0o644
    if before is not None:
        try:
            if digest(names.contents(folder, name, largest=LARGEST)) != before:
                raise Conflict
            mode = stat.S_IMODE(os.stat(folder / name, follow_symlinks=False).st_mode)
        except FileNotFoundError:
            raise Conflict from None
    partial_file = folder / f".{secrets.token_hex(8)}.part"
    try:
        with os.fdopen(
            os.open(partial_file, os.O_WRONLY | os.O_CREAT | os.O_EXCL | names.LINKS, mode), "wb"
        ) as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if before is None:
            _rename_new(partial_file, folder / name)
        else:
            # a link that was created in the meantime is replaced, not followed
            os.replace(partial_file, folder / name)
    finally:
        partial_file.unlink(missing_ok=True)
    return digest(data)


def save_new(folder: Path, stem: str, text: str) -> str:
    """Write a case under the first free name, and return that name."""
    for k in range(1, MOST):
        with suppress(Conflict):
            name = f"{stem}.toml" if k == 1 else f"{stem}-{k}.toml"
            save(folder, name, text, None)
            return name
    raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))


def lay_beside(folder: Path, path: str, data: bytes) -> None:
    """Write "folder/name" unless it exists; raise OSError if that folder is a link."""
    inner, name = path.split("/")
    with suppress(FileExistsError):
        os.mkdir(folder / inner)
    if not stat.S_ISDIR(os.lstat(folder / inner).st_mode):
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
    with suppress(Conflict):
        _write_case(folder / inner, name, data, None)


def _rename_new(partial_file: Path, path: Path) -> None:
    """Rename a new file, unless its name is taken; then raise Conflict."""
    try:
        os.link(partial_file, path)
    except FileExistsError:
        raise Conflict from None
    except OSError:  # a file system without hard links
        if os.path.lexists(path):
            raise Conflict from None
        os.replace(partial_file, path)


def cases(folder: Path) -> list[dict[str, Any]]:
    """Return the case files of a folder: name, title, and time of change [s since 1970]."""
    found = []
    for entry in entries(folder):
        if names.case(entry.name) and entry.is_file(follow_symlinks=False):
            with suppress(OSError):
                status = entry.stat(follow_symlinks=False)
                title = _title(folder, entry.name, status.st_mtime_ns, status.st_size)
                found.append({"name": entry.name, "title": title, "changed": status.st_mtime})
    return sorted(found, key=lambda row: str(row["name"]).lower())


@lru_cache(4 * MOST)
def _title(folder: Path, name: str, changed: int, size: int) -> str:
    """Return a case's title, "" if it has none; time of change and size are keys of the cache.

    The case is not parsed in the server, as crafted TOML can take hours to parse.
    """
    try:
        found = TITLE.search(read_case(folder, name)[0])
    except (OSError, ValueError):
        return ""
    if found is None:
        return ""
    try:
        return _one_line(json.loads(found[1]) if found[1] else found[2][1:-1])
    except ValueError:  # an escape that JSON does not have
        return _one_line(found[1][1:-1])


def runs(folder: Path) -> list[dict[str, Any]]:
    """Return the complete results in a folder, newest first."""
    found = []
    for entry in entries(folder):
        if names.plain(entry.name) and entry.is_dir(follow_symlinks=False):
            with suppress(OSError):
                status = os.stat(folder / entry.name / manifest.NAME, follow_symlinks=False)
                if (row := _run(folder, entry.name, status.st_mtime_ns)) and _is_complete(
                    folder / entry.name, row["sizes"]
                ):
                    found.append({key: value for key, value in row.items() if key != "sizes"})
    return sorted(found, key=lambda row: str(row["made"]), reverse=True)


@lru_cache(MOST)
def _run(folder: Path, name: str, changed: int) -> dict[str, Any] | None:
    """Return the entry of a run in the list; None if the folder is not a result of drift."""
    listed = manifest.read_manifest(folder / name)
    if listed is None or SUMMARY not in listed.names:
        return None
    try:
        content = json.loads(names.contents(folder, name, SUMMARY, largest=LARGEST_SUMMARY))
        run, warnings = content.get("run", {}), content.get("warnings", [])
        seconds = content.get("wall_time_s", {})
        seconds_total = (
            sum(float(part) for part in seconds.values()) if isinstance(seconds, dict) else None
        )
        seconds_total = (
            seconds_total if seconds_total is not None and math.isfinite(seconds_total) else None
        )
    except (OSError, ValueError, OverflowError, RecursionError, AttributeError, TypeError):
        return None
    sizes = {entry.name: entry.size for entry in listed.files if names.plain(entry.name)}
    return {
        "name": name,
        "title": _one_line(content.get("title", "")),
        "kind": next((kind for file, kind in KINDS.items() if file in sizes), "forecast"),
        "start": _one_line(run.get("start", "")) if isinstance(run, dict) else "",
        "end": _one_line(run.get("end", "")) if isinstance(run, dict) else "",
        "took": seconds_total,
        "warnings": [_one_line(line) for line in warnings] if isinstance(warnings, list) else [],
        "made": _one_line(content.get("date_created", "")),
        "report": REPORT in sizes,
        "files": [
            {"name": file, "bytes": size} for file, size in sorted(sizes.items()) if file != REPORT
        ],
        "sizes": sizes,
    }


def _is_complete(folder: Path, sizes: dict[str, int]) -> bool:
    """Return True if all files of a run exist with their sizes; digests would take minutes."""
    for name, size in sizes.items():
        status = os.stat(folder / name, follow_symlinks=False)
        if not stat.S_ISREG(status.st_mode) or status.st_size != size:
            return False
    return True


def _one_line(value: Any) -> str:
    """Return a value as one line of limited length that can be encoded."""
    return " ".join(str(value).encode("utf-8", "replace").decode("utf-8").split())[:300]


def entries(folder: Path) -> Iterator["os.DirEntry[str]"]:
    """Yield the entries of a folder, of very full ones only some."""
    with os.scandir(folder) as entries:
        for _, entry in zip(range(MOST * 10), entries, strict=False):
            yield entry


def file_of_run(folder: Path, run: str, name: str) -> tuple[int, int]:
    """Return a handle and the size [bytes] of a file that a run's manifest lists.

    Raises OSError for any other file.
    """
    if not (names.plain(run) and names.plain(name)) or os.path.islink(folder / run):
        raise FileNotFoundError
    listed = manifest.read_manifest(folder / run)
    if listed is None or name not in listed.names:
        raise FileNotFoundError
    handle = names.open_inside(folder, run, name)
    return handle, os.fstat(handle).st_size


def content_of_run(folder: Path, run: str, name: str, largest: int) -> bytes:
    """Return the bytes of a file that a run's manifest lists.

    Raises OSError for any other file, and for one above `largest` [bytes].
    """
    handle, size = file_of_run(folder, run, name)
    with open(handle, "rb") as file:
        if size > largest:
            raise OSError(errno.EFBIG, f"it has more than {largest // 2**20} MiB")
        return file.read()
