"""What a finished run's folder holds: manifest.json names each file with its size and digest.

It is written last.

A folder whose files are as its manifest says is the whole result of one run. Nothing else is: a
folder without a manifest, or with one that some other program wrote, holds no result of ours.
"""

import hashlib
import json
import os
import stat
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

NAME = "manifest.json"
LARGEST = 2**22  # [bytes] of a manifest: far more than ours ever have


@dataclass(frozen=True)
class Entry:
    """A file of a run."""

    name: str  # without a folder
    size: int  # [bytes]
    sha256: str  # in hexadecimal digits


@dataclass(frozen=True)
class Manifest:
    """The files of a run, without the manifest itself."""

    run_id: str
    files: tuple[Entry, ...]

    @property
    def names(self) -> set[str]:
        """Names of all files of the run, the manifest among them."""
        return {entry.name for entry in self.files} | {NAME}


def manifest_of(run_id: str, paths: Iterable[Path]) -> Manifest:
    """Return the manifest of files, which are read for it."""
    return Manifest(
        run_id, tuple(Entry(path.name, path.stat().st_size, digest(path)) for path in paths)
    )


def manifest_text(manifest: Manifest) -> str:
    """Return a manifest as it is written to its file."""
    return json.dumps(asdict(manifest), indent=1) + "\n"


def read_manifest(folder: Path) -> Manifest | None:
    """Return the manifest of a folder; None where there is none, or one that is not ours."""
    path = folder / NAME
    try:
        if not regular(path) or path.stat().st_size > LARGEST:
            return None
        held = json.loads(path.read_bytes())
        entries = tuple(Entry(row["name"], row["size"], row["sha256"]) for row in held["files"])
        run_id = held["run_id"]
    except (OSError, ValueError, RecursionError, KeyError, TypeError, AttributeError):
        return None
    return (
        Manifest(run_id, entries) if isinstance(run_id, str) and all(map(_plain, entries)) else None
    )


def _plain(entry: Entry) -> bool:
    """Whether an entry is one that we write: no name leads out of the folder or to the manifest."""
    typed = (
        isinstance(entry.name, str)
        and isinstance(entry.size, int)
        and isinstance(entry.sha256, str)
    )
    return (
        typed
        and Path(entry.name).name == entry.name not in {"", "..", NAME}
        and "\0" not in entry.name
    )


def fault(folder: Path, manifest: Manifest) -> str | None:
    """Return in words where a folder differs from its manifest;

    None where all is as it was written.
    """
    for entry in manifest.files:
        path = folder / entry.name
        if not os.path.lexists(path):
            return f'"{entry.name}" is missing'
        if not unchanged(path, entry):
            return f'"{entry.name}" has been changed since the run wrote it'
    return None


def unchanged(path: Path, entry: Entry) -> bool:
    """Whether a path is a file, no link, with the contents of an entry."""
    return regular(path) and path.stat().st_size == entry.size and digest(path) == entry.sha256


def regular(path: Path) -> bool:
    """Whether a path is a file: no folder, no link, no pipe."""
    try:
        return stat.S_ISREG(os.lstat(path).st_mode)
    except OSError:
        return False


def digest(path: Path) -> str:
    """Return the SHA-256 of a file's contents."""
    total = hashlib.sha256()
    with open(path, "rb") as file:
        while chunk := file.read(2**20):
            total.update(chunk)
    return total.hexdigest()
