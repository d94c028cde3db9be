"""Publish a run's files in a folder: always the complete old or the complete new result.

New files are prepared in a hidden folder: inside the target if that exists (it may be a mount or a
link, and its parent may not be writable), else beside it. A new target appears by one rename. In an
existing target the old run's files are moved aside into the hidden folder, manifest first; the new
ones are moved in, manifest last. From then on the new result is complete, and the old files are
deleted. A journal in the hidden folder lists the moves. If the process dies before the new manifest
is in place, the next run or reader restores the old files by the journal. Each step is one rename,
and restoring may be interrupted as well.

Files that no manifest of drift lists are never moved: a folder, a link or a foreign file in the way
is reported as an error beforehand.
"""

import contextlib
import errno
import json
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drift.products.files import hidden, manifest
from drift.products.files.interrupt import signals_deferred
from drift.products.files.manifest import Manifest
from geo.errors import UserError

ADVICE = "name another with --out, or add --overwrite"
NEW, OLD, JOURNAL = "new", "old", "journal.json"
PATIENCE = 10.0  # [s] after which another process counts as hanging, as renames are fast


@dataclass(frozen=True)
class Stage:
    """The hidden folder in which a run prepares its files before they are published."""

    target: Path
    folder: Path  # hidden
    inside: bool  # the target existed already and contains the hidden folder
    before: str | None  # digest of the target's manifest at that time

    @property
    def new(self) -> Path:
        """The folder to write into."""
        return self.folder / NEW


def check(folder: Path, overwrite: bool = False, names: Iterable[str] = ()) -> None:
    """Raise UserError unless results may be written to a folder.

    Call it before the work starts: it creates nothing. An interrupted replacement of results is
    undone first.

    Args:
        folder: the output folder.
        overwrite: whether results in it may be replaced.
        names: names of the files that will be written.
    """
    try:
        str(folder.absolute()).encode(sys.getfilesystemencoding())  # HDF5 requires that
        exists = _exists(folder)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise UserError(
            f"output folder {str(folder)[:300]!a}: {reason}; name another with --out"
        ) from None
    if exists and not folder.is_dir():
        raise UserError(f"output folder {folder}: is not a folder; name another with --out")
    ground = folder if exists else next(p for p in folder.absolute().parents if _exists(p))
    if not ground.is_dir() or not os.access(ground, os.R_OK | os.W_OK | os.X_OK):
        raise UserError(
            f"output folder {folder}: cannot write in {ground}; name another with --out"
        )
    if not exists:
        return
    _restore_interrupted(folder)
    if not overwrite and _is_filled(folder):
        raise UserError(f"output folder {folder}: is not empty; {ADVICE}")
    _check_obstacles(folder, names)


def _exists(path: Path) -> bool:
    """Return True if a path exists, even as a broken link; raise OSError for an invalid name."""
    try:
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


def _is_filled(folder: Path) -> bool:
    """Return True if a folder contains anything but the remains of a killed run."""
    names = [path.name for path in folder.iterdir()]
    return any(not name.startswith(hidden.PREFIX) and name != hidden.UNFINISHED for name in names)


@contextmanager
def staged(target: Path) -> Iterator[Stage]:
    """Yield a hidden folder on the target's file system, and remove it afterwards.

    Hidden folders of dead processes are removed first.
    """
    inside = target.is_dir()
    ground = target.absolute() if inside else target.absolute().parent
    # innermost first
    created = [path for path in (ground, *ground.parents) if not path.exists()]
    ground.mkdir(parents=True, exist_ok=True)
    if inside:
        _restore_interrupted(target)
    for place in {ground, target.absolute().parent}:
        _remove_abandoned(place)
    folder, lock = hidden.make_hidden_folder(ground)
    try:
        os.mkdir(folder / NEW)
        yield Stage(target, folder, inside, _manifest_digest(target))
    finally:
        with signals_deferred():
            try:
                # with a journal the folder contains the old result, which could not be restored
                if not (folder / JOURNAL).exists():
                    hidden.remove(folder)
                # not empty if they contain the results, or existed before
                with contextlib.suppress(OSError):
                    for path in created:
                        os.rmdir(path)
            finally:
                os.close(lock)


def _remove_abandoned(ground: Path) -> None:
    """Remove the hidden folders of dead processes, except those with an old result in them."""
    for folder in hidden.hidden_folders_in(ground):
        with hidden.lock_if_abandoned(folder) as held:
            if held and not (folder / JOURNAL).exists():
                hidden.remove(folder)


def publish(stage: Stage, run_id: str, overwrite: bool = False) -> list[Path]:
    """Move all staged files and their manifest into the target, completely or not at all.

    Args:
        stage: the hidden folder with the new files.
        run_id: identifier of the run.
        overwrite: whether the files of an earlier run are replaced; those that this run does not
            write are removed.

    Returns:
        The paths of the files.

    Raises:
        UserError: another run has published there since the stage was made; its result stays.
    """
    listed = manifest.manifest_of(run_id, sorted(stage.new.iterdir()))
    _write(stage.new / manifest.NAME, manifest.manifest_text(listed))
    for entry in listed.files:
        _sync(stage.new / entry.name)
    _sync(stage.new)
    if not stage.inside:
        with signals_deferred():
            _rename_to_target(stage)
    else:
        with _locked_folder(stage.target):
            _settle_locked(stage.target)
            if _manifest_digest(stage.target) != stage.before or (
                not overwrite and _is_filled(stage.target)
            ):
                raise _overtaken_error(stage.target)
            with signals_deferred():
                _exchange(stage, listed)
    return [stage.target / name for name in sorted(listed.names)]


def _rename_to_target(stage: Stage) -> None:
    """Rename the folder of new files to the target, which must not exist or be empty."""
    try:
        os.rename(stage.new, stage.target)
    except OSError as error:
        if error.errno in {errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR}:
            raise _overtaken_error(stage.target) from None
        raise
    _sync(stage.target.absolute().parent)


def _overtaken_error(target: Path) -> UserError:
    return UserError(
        f"output folder {target}: another run has filled it in the meantime, and nothing of this "
        "one was written; "
        "name another with --out"
    )


def _exchange(stage: Stage, listed: Manifest) -> None:
    """Move the old run's files aside and the new ones in, or leave everything unchanged."""
    target, old = stage.target, stage.folder / OLD
    _check_obstacles(target, listed.names)
    before = manifest.read_manifest(target)
    aside = [manifest.NAME] if before else []
    for entry in before.files if before else ():
        replaced = entry.name in listed.names and os.path.lexists(target / entry.name)
        if replaced or manifest.matches_entry(target / entry.name, entry):
            aside.append(entry.name)
    new = {entry.name: entry.sha256 for entry in listed.files}
    new[manifest.NAME] = manifest.digest(stage.new / manifest.NAME)
    os.mkdir(old)
    _write(stage.folder / f"{JOURNAL}.draft", json.dumps({"old": aside, "new": new}))
    os.rename(stage.folder / f"{JOURNAL}.draft", stage.folder / JOURNAL)
    _sync(stage.folder)
    try:
        for name in aside:
            os.rename(target / name, old / name)
        for name in new:
            if name == manifest.NAME:  # the last one: all others must be on disk before it
                _sync(target)
            os.rename(stage.new / name, target / name)
        _sync(target)
    except BaseException as error:
        try:
            _finish_exchange(target, stage.folder)
        except OSError as trouble:
            raise UserError(
                f"output folder {target}: cannot be written ({error}), and the old results "
                "cannot be restored "
                f"({trouble.strerror}) from {stage.folder.name}/{OLD}; the next run or reader "
                "there will restore them"
            ) from error
        raise
    _finish_exchange(target, stage.folder)


def _check_obstacles(folder: Path, names: Iterable[str]) -> None:
    """Raise UserError if a name is taken by anything but a file of an earlier run of drift."""
    before = manifest.read_manifest(folder)
    own_names = before.names if before else set()
    for name in sorted(names):
        path = folder / name
        if not os.path.lexists(path) or (
            name in own_names and manifest.is_regular_file(path) and not os.path.ismount(path)
        ):
            continue
        obstacle = (
            "a link"
            if path.is_symlink()
            else "a folder"
            if path.is_dir()
            else "a file that no run of drift lists"
        )
        raise UserError(
            f'output folder {folder}: "{name}" is in the way: it is {obstacle}, and is not '
            "replaced; move it away, or name "
            "another folder with --out"
        )


def _restore_interrupted(folder: Path) -> None:
    """Restore an old result that is half replaced; raise UserError on failure."""
    if any((place / JOURNAL).exists() for place in hidden.hidden_folders_in(folder)):
        with _locked_folder(folder), signals_deferred():
            _settle_locked(folder)


def _settle_locked(folder: Path) -> None:
    """Restore old results as `settle` does, in a folder that is locked."""
    for place in hidden.hidden_folders_in(folder):
        if not (place / JOURNAL).exists():
            continue
        with hidden.lock_if_abandoned(place) as held:
            if not held:
                raise UserError(
                    f"output folder {folder}: another process is replacing its results "
                    f"({place.name}); "
                    "wait for it to finish, or name another with --out"
                )
            try:
                _finish_exchange(folder, place)
            except OSError as error:
                raise UserError(
                    f"output folder {folder}: a run died while it replaced the results, and the "
                    "old ones cannot be restored "
                    f"from {place.name} ({error.strerror}); fix that, or name another with --out"
                ) from None
            hidden.remove(place)


def _finish_exchange(target: Path, folder: Path) -> None:
    """End an exchange by its journal.

    The old files are deleted if the new manifest is in place, else they are restored.
    """
    try:
        journal: dict[str, Any] = json.loads((folder / JOURNAL).read_text(encoding="utf-8"))
        aside, new = list(journal["old"]), dict(journal["new"])
    except (ValueError, KeyError, TypeError):
        raise UserError(
            f"output folder {target}: {folder.name}/{JOURNAL} is damaged; see {folder.name}/{OLD}"
        ) from None
    if _manifest_digest(target) != new[manifest.NAME]:
        _restore(target, folder, aside, new)
    os.unlink(folder / JOURNAL)  # from here on nothing in the hidden folder is needed
    _sync(folder)


def _restore(target: Path, folder: Path, aside: list[str], new: dict[str, str]) -> None:
    """Move the new files out of a target and the old ones back; completed steps are skipped."""
    for name, digest in new.items():
        if name in aside and not os.path.lexists(folder / OLD / name):
            continue  # the old one was never moved, or is restored already
        if not os.path.lexists(folder / NEW / name) and _has_digest(target / name, digest):
            os.rename(target / name, folder / NEW / name)
    for name in reversed(aside):  # the manifest, which was moved first, is restored last
        if not os.path.lexists(folder / OLD / name):
            continue
        if os.path.lexists(target / name):
            raise UserError(
                f"output folder {target}: a run died while it replaced the results, and "
                f'"{name}", which is not one of '
                f"its files, is in the way of the old ones in {folder.name}/{OLD}; move it away"
            )
        os.rename(folder / OLD / name, target / name)
    _sync(target)


def _has_digest(path: Path, digest: str) -> bool:
    return manifest.is_regular_file(path) and manifest.digest(path) == digest


def summary(folder: Path, name: str) -> dict[str, Any] | None:
    """Return the object in a JSON file of the finished run in a folder; None if there is none.

    Half-replaced results are restored first.
    """
    try:
        if not any(path.name == name for path in results(folder)):
            return None
        content = json.loads((folder / name).read_text(encoding="utf-8"))
    except (UserError, OSError, ValueError):
        return None
    return content if isinstance(content, dict) else None


def results(folder: str | os.PathLike[str]) -> list[Path]:
    """Return the files of the finished run in a folder, after checking them against its manifest.

    Half-replaced results are restored first.

    Args:
        folder: a results folder, as given by `out`.

    Returns:
        The paths, sorted by name, of all files that manifest.json lists.

    Raises:
        UserError: the folder contains no result, or a file is missing or was changed; one line says
            which.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise UserError(f"results {folder}: the folder does not exist")
    try:
        _restore_interrupted(folder)
        with _locked_folder(folder, shared=True):
            listed = manifest.read_manifest(folder)
            fault = (
                manifest.difference_from_manifest(folder, listed)
                if listed
                else f"it has no {manifest.NAME} of drift"
            )
    except OSError as error:
        raise UserError(f"results {folder}: cannot be read ({error.strerror})") from None
    if listed is None or fault:
        raise UserError(
            f"results {folder}: not the complete result of a run: {fault}; run the case again"
        )
    return [folder / name for name in sorted(listed.names)]


@contextmanager
def _locked_folder(folder: Path, *, shared: bool = False) -> Iterator[None]:
    """Lock a folder against other processes of drift; raise UserError if one keeps it locked."""
    with hidden.folder_lock(folder, PATIENCE, shared=shared) as free:
        if not free:
            raise UserError(
                f"output folder {folder}: another process is replacing its results; wait for it "
                "to finish"
            )
        yield


def _manifest_digest(folder: Path) -> str | None:
    """Return the digest of the manifest in a folder; None if there is none."""
    path = folder / manifest.NAME
    return manifest.digest(path) if manifest.is_regular_file(path) else None


def _write(path: Path, text: str) -> None:
    """Write a file so that it survives a power cut."""
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def _sync(path: Path) -> None:
    """Flush a file's contents, or a folder's names, to disk, if the system can."""
    if os.name != "posix":
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        # the file system does not support it
        if error.errno not in {errno.EINVAL, errno.ENOTSUP}:
            raise
    finally:
        os.close(handle)
