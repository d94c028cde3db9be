"""A run's files in their folder: the whole old result or the whole new one, whatever happens in
between.

New files are made in a hidden folder, in the target where that is there (it may be a mount or a
link, and what is beside it not writable), else beside it. A target that is not there yet comes into
being by one rename. In one that is, the old run's files are moved aside into the hidden folder, its
manifest first; the new ones are moved in, their manifest last: with that the new result is whole,
and the old files go. A journal in the hidden folder says what was to be moved. If the process dies
before the new manifest stands, whoever comes next, another run or a reader, puts the old files back
by the journal. Each step is one rename, and putting back may be cut short as well.

What no manifest of ours lists is never moved: a folder, a link or somebody else's file in the way
is refused beforehand.
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
from drift.products.files.interrupt import undisturbed
from drift.products.files.manifest import Manifest
from geo.errors import UserError

ADVICE = "name another with --out, or add --overwrite"
NEW, OLD, JOURNAL = "new", "old", "journal.json"
PATIENCE = 10.0  # [s] after which another process is taken to hang, for renames are short


@dataclass(frozen=True)
class Stage:
    """Where a run makes its files before they are published."""

    target: Path
    folder: Path  # hidden
    inside: bool  # the target was there already, and the hidden folder lies in it
    before: str | None  # digest of the manifest that the target had then

    @property
    def new(self) -> Path:
        """The folder to write into."""
        return self.folder / NEW


def check(folder: Path, overwrite: bool = False, names: Iterable[str] = ()) -> None:
    """Raise UserError unless results may be written to a folder; made before the work starts.
    Creates nothing.

    names: of files that will be written. A result that a dead process left half replaced is put
    back.
    """
    try:
        str(folder.absolute()).encode(sys.getfilesystemencoding())  # HDF5 takes no other names
        exists = _exists(folder)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise UserError(
            f"output folder {str(folder)[:300]!a}: {reason}; name another with --out"
        ) from None
    if exists and not folder.is_dir():
        raise UserError(f"output folder {folder}: is no folder; name another with --out")
    ground = folder if exists else next(p for p in folder.absolute().parents if _exists(p))
    if not ground.is_dir() or not os.access(ground, os.R_OK | os.W_OK | os.X_OK):
        raise UserError(
            f"output folder {folder}: cannot write in {ground}; name another with --out"
        )
    if not exists:
        return
    settle(folder)
    if not overwrite and _filled(folder):
        raise UserError(f"output folder {folder}: is not empty; {ADVICE}")
    _refuse_obstacles(folder, names)


def _exists(path: Path) -> bool:
    """Whether something has a name, were it a link to nothing; raises OSError for a name that
    cannot be.
    """
    try:
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


def _filled(folder: Path) -> bool:
    """Whether a folder holds anything but what a killed run left."""
    names = [path.name for path in folder.iterdir()]
    return any(not name.startswith(hidden.PREFIX) and name != hidden.UNFINISHED for name in names)


@contextmanager
def staged(target: Path) -> Iterator[Stage]:
    """Give a hidden folder on the target's file system, gone afterwards; what dead processes left
    goes too.
    """
    inside = target.is_dir()
    ground = target.absolute() if inside else target.absolute().parent
    # the innermost first
    created = [path for path in (ground, *ground.parents) if not path.exists()]
    ground.mkdir(parents=True, exist_ok=True)
    if inside:
        settle(target)
    for place in {ground, target.absolute().parent}:
        _clean(place)
    folder, lock = hidden.make(ground)
    try:
        os.mkdir(folder / NEW)
        yield Stage(target, folder, inside, _state(target))
    finally:
        with undisturbed():
            try:
                # with a journal, the old result is in it and could not be put back
                if not (folder / JOURNAL).exists():
                    hidden.remove(folder)
                # the results are in them, or they were there before
                with contextlib.suppress(OSError):
                    for path in created:
                        os.rmdir(path)
            finally:
                os.close(lock)


def _clean(ground: Path) -> None:
    """Take away the hidden folders that dead processes left; those with an old result in them stay."""
    for folder in hidden.within(ground):
        with hidden.taken(folder) as held:
            if held and not (folder / JOURNAL).exists():
                hidden.remove(folder)


def publish(stage: Stage, run_id: str, overwrite: bool = False) -> list[Path]:
    """Move all that was staged into the target, complete or not at all; return the files' paths.

    The manifest is moved with it.

    With `overwrite` what an earlier run wrote into the target, and this one does not, is taken
    away. Where another run has published there since the stage was made, that one stands and this
    one is refused.
    """
    listed = manifest.manifest_of(run_id, sorted(stage.new.iterdir()))
    _write(stage.new / manifest.NAME, manifest.manifest_text(listed))
    for entry in listed.files:
        _sync(stage.new / entry.name)
    _sync(stage.new)
    if not stage.inside:
        with undisturbed():
            _appear(stage)
    else:
        with _alone(stage.target):
            _settle(stage.target)
            if _state(stage.target) != stage.before or (not overwrite and _filled(stage.target)):
                raise _overtaken(stage.target)
            with undisturbed():
                _exchange(stage, listed)
    return [stage.target / name for name in sorted(listed.names)]


def _appear(stage: Stage) -> None:
    """Rename the new files' folder to the target, which must still not be there, or empty."""
    try:
        os.rename(stage.new, stage.target)
    except OSError as error:
        if error.errno in {errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR}:
            raise _overtaken(stage.target) from None
        raise
    _sync(stage.target.absolute().parent)


def _overtaken(target: Path) -> UserError:
    return UserError(
        f"output folder {target}: another run has filled it meanwhile, and nothing of this one was written; "
        "name another with --out"
    )


def _exchange(stage: Stage, listed: Manifest) -> None:
    """Move the old run's files aside and the new ones in, or leave all as it was."""
    target, old = stage.target, stage.folder / OLD
    _refuse_obstacles(target, listed.names)
    before = manifest.read_manifest(target)
    aside = [manifest.NAME] if before else []
    for entry in before.files if before else ():
        replaced = entry.name in listed.names and os.path.lexists(target / entry.name)
        if replaced or manifest.unchanged(target / entry.name, entry):
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
            if name == manifest.NAME:  # the last: all others are in their place for good before
                _sync(target)
            os.rename(stage.new / name, target / name)
        _sync(target)
    except BaseException as error:
        try:
            _finish(target, stage.folder)
        except OSError as trouble:
            raise UserError(
                f"output folder {target}: cannot be written ({error}), and the old results cannot be put back "
                f"({trouble.strerror}) from {stage.folder.name}/{OLD}; the next run or reader there will do it"
            ) from error
        raise
    _finish(target, stage.folder)


def _refuse_obstacles(folder: Path, names: Iterable[str]) -> None:
    """Raise UserError where one of our names is taken by anything but a file of an earlier run of
    ours.
    """
    before = manifest.read_manifest(folder)
    ours = before.names if before else set()
    for name in sorted(names):
        path = folder / name
        if not os.path.lexists(path) or (
            name in ours and manifest.regular(path) and not os.path.ismount(path)
        ):
            continue
        what = (
            "a link"
            if path.is_symlink()
            else "a folder"
            if path.is_dir()
            else "a file that no run of ours lists"
        )
        raise UserError(
            f'output folder {folder}: "{name}" is in the way: it is {what}, and stays as it is; move it away, or name '
            "another folder with --out"
        )


def settle(folder: Path) -> None:
    """Put back the old result where a dead process left it half replaced; raise UserError where
    that cannot be.
    """
    if any((place / JOURNAL).exists() for place in hidden.within(folder)):
        with _alone(folder), undisturbed():
            _settle(folder)


def _settle(folder: Path) -> None:
    """Do what `settle` does, in a folder that is held."""
    for place in hidden.within(folder):
        if not (place / JOURNAL).exists():
            continue
        with hidden.taken(place) as held:
            if not held:
                raise UserError(
                    f"output folder {folder}: another process is replacing its results just now ({place.name}); "
                    "wait for its end, or name another with --out"
                )
            try:
                _finish(folder, place)
            except OSError as error:
                raise UserError(
                    f"output folder {folder}: a run died while it replaced the results, and the old ones cannot be put "
                    f"back from {place.name} ({error.strerror}); mend that, or name another with --out"
                ) from None
            hidden.remove(place)


def _finish(target: Path, folder: Path) -> None:
    """End an exchange by its journal: the old files go if the new manifest stands, else they are
    put back.
    """
    try:
        journal: dict[str, Any] = json.loads((folder / JOURNAL).read_text(encoding="utf-8"))
        aside, new = list(journal["old"]), dict(journal["new"])
    except (ValueError, KeyError, TypeError):
        raise UserError(
            f"output folder {target}: {folder.name}/{JOURNAL} is damaged; see {folder.name}/{OLD}"
        ) from None
    if _state(target) != new[manifest.NAME]:
        _put_back(target, folder, aside, new)
    os.unlink(folder / JOURNAL)  # from here on the hidden folder holds nothing that anybody needs
    _sync(folder)


def _put_back(target: Path, folder: Path, aside: list[str], new: dict[str, str]) -> None:
    """Move the new files out of a target and the old ones back; what is done already is passed
    over.
    """
    for name, digest in new.items():
        if name in aside and not os.path.lexists(folder / OLD / name):
            continue  # the old one was never moved, or is back
        if not os.path.lexists(folder / NEW / name) and _holds(target / name, digest):
            os.rename(target / name, folder / NEW / name)
    for name in reversed(aside):  # the manifest, which went first, comes back last
        if not os.path.lexists(folder / OLD / name):
            continue
        if os.path.lexists(target / name):
            raise UserError(
                f'output folder {target}: a run died while it replaced the results, and "{name}", which is not its '
                f"own, is in the way of the old ones in {folder.name}/{OLD}; move it away"
            )
        os.rename(folder / OLD / name, target / name)
    _sync(target)


def _holds(path: Path, digest: str) -> bool:
    return manifest.regular(path) and manifest.digest(path) == digest


def summary(folder: Path, name: str) -> dict[str, Any] | None:
    """Return the object in a JSON file of the finished run that a folder holds; None where there is
    no such run.

    Where a dead process left results half replaced, the old ones are put back first.
    """
    try:
        if not any(path.name == name for path in results(folder)):
            return None
        held = json.loads((folder / name).read_text(encoding="utf-8"))
    except (UserError, OSError, ValueError):
        return None
    return held if isinstance(held, dict) else None


def results(folder: str | os.PathLike[str]) -> list[Path]:
    """Return the files of the finished run that a folder holds, once all are as the run wrote them.

    Where a dead process left results half replaced, the old ones are put back first.

    Args:
        folder: that `out` named.

    Returns:
        The paths, sorted by name, of all files that manifest.json lists.

    Raises:
        UserError: it holds none, or a file is missing or was changed; one line says which.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise UserError(f"results {folder}: there is no such folder")
    try:
        settle(folder)
        with _alone(folder, shared=True):
            listed = manifest.read_manifest(folder)
            fault = (
                manifest.fault(folder, listed) if listed else f"it has no {manifest.NAME} of ours"
            )
    except OSError as error:
        raise UserError(f"results {folder}: cannot be read ({error.strerror})") from None
    if listed is None or fault:
        raise UserError(
            f"results {folder}: not the whole result of a run: {fault}; run the case again"
        )
    return [folder / name for name in sorted(listed.names)]


@contextmanager
def _alone(folder: Path, *, shared: bool = False) -> Iterator[None]:
    """Hold a folder against other processes of ours; raise UserError where one does not let go of
    it.
    """
    with hidden.alone(folder, PATIENCE, shared=shared) as free:
        if not free:
            raise UserError(
                f"output folder {folder}: another process is replacing its results; wait for its end"
            )
        yield


def _state(folder: Path) -> str | None:
    """Return the digest of the manifest in a folder; None for none."""
    path = folder / manifest.NAME
    return manifest.digest(path) if manifest.regular(path) else None


def _write(path: Path, text: str) -> None:
    """Write a file so that it outlives a power cut."""
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def _sync(path: Path) -> None:
    """Have a file's contents, or a folder's names, outlive a power cut, where the system can."""
    if os.name != "posix":
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        # a file system that knows no such thing
        if error.errno not in {errno.EINVAL, errno.ENOTSUP}:
            raise
    finally:
        os.close(handle)
