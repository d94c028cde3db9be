"""Folders of results that are published, stopped at any step, and read."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import drift
from drift.products.files import hidden, manifest, publication
from geo.errors import UserError

Files = dict[str, str]
OLD: Files = {
    "map.png": "old map",
    "same.txt": "same",
    "summary.json": "old",
    "only_old.csv": "old",
}
NEW: Files = {
    "map.png": "new map",
    "same.txt": "same",
    "summary.json": "new",
    "only_new.csv": "new",
}
THIRD: Files = {"third.txt": "third"}
posix = pytest.mark.skipif(os.name != "posix", reason="locks and links of POSIX")


def publish(folder: Path, files: Files, overwrite: bool = True) -> None:
    publication.check(folder, overwrite, [*files, manifest.NAME])
    with publication.staged(folder) as stage:
        for name, text in files.items():
            (stage.new / name).write_text(text)
        publication.publish(stage, f"run of {len(files)}", overwrite)


def foreign(folder: Path) -> None:
    """Put things of the user into a folder."""
    (folder / "sub").mkdir(parents=True)
    (folder / "sub" / "map.png").write_text("mine")
    (folder / "notes.txt").write_text("mine")
    (folder / "link").symlink_to("notes.txt")


def untouched(folder: Path) -> bool:
    kept = [(folder / "sub" / "map.png").read_text(), (folder / "notes.txt").read_text()]
    return kept == ["mine", "mine"] and os.readlink(folder / "link") == "notes.txt"


def held(folder: Path, mine: set[str] = frozenset({"sub", "notes.txt", "link"})) -> Files:  # type: ignore[assignment]
    """Return the files in a folder without the user's, hidden folders and the manifest."""
    if not folder.exists():
        return {}
    left = [
        p
        for p in folder.iterdir()
        if p.name not in mine and not p.name.startswith(".") and p.name != manifest.NAME
    ]
    return {path.name: path.read_text() for path in left}


def hiding(*folders: Path) -> list[str]:
    return [
        path.name
        for folder in folders
        if folder.exists()
        for path in folder.iterdir()
        if path.name.startswith(".")
    ]


class Death(BaseException):
    """Stands for the kill of the process: from then on nothing that it does reaches the disk."""


@contextmanager
def dying(after: float) -> Iterator[list[str]]:
    """Count what changes the disk, and raise Death at every such step from one on; gives the names
    of those done.
    """
    done: list[str] = []

    def counted(name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def step(*arguments: Any, **more: Any) -> Any:
            if name == "os.open" and not arguments[1] & os.O_CREAT:
                return real(*arguments, **more)  # to read, or to have it synced
            if len(done) >= after:
                raise Death
            done.append(name)
            return real(*arguments, **more)

        return step

    dead = (*hidden._owner_names()[:3], str(2**30))  # no process has that number
    with pytest.MonkeyPatch.context() as patch:
        for name in ("rename", "replace", "unlink", "rmdir", "mkdir", "fsync", "open"):
            patch.setattr(os, name, counted(f"os.{name}", getattr(os, name)))
        patch.setattr(hidden, "_owner_names", lambda: dead)
        # it opens nothing to read
        patch.setattr(publication, "open", counted("open", open), raising=False)
        yield done


def stopped(after: float, action: Callable[[], object]) -> list[str] | None:
    """Do something until it dies; None if it came to its end, else the steps that it did."""
    with dying(after) as done:
        try:
            action()
        except Death:
            return done
    return None


def read(folder: Path) -> Files | None:
    """Return what a reader gets; None where it is told that there is nothing whole."""
    try:
        paths = drift.results(folder)
    except UserError:
        return None
    return {path.name: path.read_text() for path in paths if path.name != manifest.NAME}


SCENES: dict[str, Files | None] = {"a result": OLD, "the user's things alone": {}, "nothing": None}


def scene(folder: Path, before: Files | None) -> None:
    if before is not None:
        foreign(folder)
        if before:
            publish(folder, before)
