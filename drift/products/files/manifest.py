"""The manifest of a results folder: manifest.json lists each file with its size and digest.

It is written last, so a folder whose files match its manifest is the complete result of one run. A
folder without a manifest, or with one of another program, is not a result of drift.
"""

import hashlib
import json
import os
import stat
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

NAME = "manifest.json"
LARGEST = 2**22  # [bytes] most of a manifest, far more than drift writes


@dataclass(frozen=True)
class Entry:
    """A file of a run: name, size and digest."""

    name: str  # without a folder
    size: int  # [bytes]
    sha256: str  # in hexadecimal digits


@dataclass(frozen=True)
class Manifest:
    """The files of a run, except the manifest itself."""

    run_id: str
    files: tuple[Entry, ...]

    @property
    def names(self) -> set[str]:
        """Names of all files of the run, including the manifest."""
        return {entry.name for entry in self.files} | {NAME}


def manifest_of(run_id: str, paths: Iterable[Path]) -> Manifest:
    """Return the manifest of some files, after reading them."""
    return Manifest(
        run_id, tuple(Entry(path.name, path.stat().st_size, digest(path)) for path in paths)
    )


def manifest_text(manifest: Manifest) -> str:
    """Return the text of a manifest's file."""
    return json.dumps(asdict(manifest), indent=1) + "\n"


def read_manifest(folder: Path) -> Manifest | None:
    """Return the manifest of a folder; None if it has none that drift wrote."""
    path = folder / NAME
    try:
        if not is_regular_file(path) or path.stat().st_size > LARGEST:
            return None
        content = json.loads(path.read_bytes())
        entries = tuple(Entry(row["name"], row["size"], row["sha256"]) for row in content["files"])
        run_id = content["run_id"]
    except (OSError, ValueError, RecursionError, KeyError, TypeError, AttributeError):
        return None
    return (
        Manifest(run_id, entries)
        if isinstance(run_id, str) and all(map(_is_valid, entries))
        else None
    )


def _is_valid(entry: Entry) -> bool:
    """Return True for an entry as drift writes it, whose name cannot lead out of the folder."""
    types_are_right = (
        isinstance(entry.name, str)
        and isinstance(entry.size, int)
        and isinstance(entry.sha256, str)
    )
    return (
        types_are_right
        and Path(entry.name).name == entry.name not in {"", "..", NAME}
        and "\0" not in entry.name
    )


def difference_from_manifest(folder: Path, manifest: Manifest) -> str | None:
    """Return how a folder differs from its manifest, as text; None if it does not."""
    for entry in manifest.files:
        path = folder / entry.name
        if not os.path.lexists(path):
            return f'"{entry.name}" is missing'
        if not matches_entry(path, entry):
            return f'"{entry.name}" has been changed since the run wrote it'
    return None


def matches_entry(path: Path, entry: Entry) -> bool:
    """Return True if a path is a file, not a link, with the contents of an entry."""
    return (
        is_regular_file(path) and path.stat().st_size == entry.size and digest(path) == entry.sha256
    )


def is_regular_file(path: Path) -> bool:
    """Return True for a regular file, not a folder, link or pipe."""
    try:
        return stat.S_ISREG(os.lstat(path).st_mode)
    except OSError:
        return False


def digest(path: Path) -> str:
    """Return the SHA-256 of a file's contents in hexadecimal."""
    sha256 = hashlib.sha256()
    with open(path, "rb") as file:
        while chunk := file.read(2**20):
            sha256.update(chunk)
    return sha256.hexdigest()
