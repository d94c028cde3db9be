"""The folder of a run's finished shards, beside the output folder; deleted when results are
complete.

Its contents are valid for one fingerprint of case, versions, forcing and the processor's
arithmetic. If the fingerprint has changed, the shards are discarded.
"""

import contextlib
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from drift.case.record import Case
from drift.engine.environment import environment
from drift.engine.environment.environment import Environment
from drift.engine.motion.scene import Scene
from drift.engine.motion.spool import BYTES, BYTES_END
from drift.pipeline import run_setup
from drift.pipeline.shards.work import (
    ABOUT,
    BACKEND,
    FORCING,
    INDICES,
    LOG,
    NUMBER,
    Work,
    mark_of,
    replace,
    run_of,
)
from drift.products.files import hidden
from drift.products.files.interrupt import Terminated
from geo import notation
from geo.errors import UserError
from kernels.runtime import runtime

# about [bytes] a particle and update: weights, and the quantities whose posteriors are reported
NOTED = 80
# about [bytes] a particle for its state between stretches, and in addition for each debris class
STATE, DEBRIS = 200, 100
DRAWN = 24  # [bytes] a particle and resampling


@contextlib.contextmanager
def open_shelf(
    out: Path | None, fingerprint: Mapping[str, str], need: int, slices: int = 0
) -> Iterator[Work]:
    """Open the store of a run's finished shards; it stays until `clear`.

    Args:
        out: the output folder of the run; None: the store is a temporary folder.
        fingerprint: the run's fingerprint.
        need: size of all shards [bytes].
        slices: size of the regridded forcing [bytes], stored only if there is space for it too.

    Raises:
        UserError: another run uses the store, the folder cannot be written, or space is short.
    """
    with contextlib.ExitStack() as stack:
        if out is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="drift-")))
            work = Work(folder, run_of(fingerprint))
            replace(folder / ABOUT, json.dumps(dict(fingerprint)))
        else:
            folder = _shelf_beside(out)
            work = Work(folder, run_of(fingerprint))
            try:
                if _path_of_shelf(out).is_symlink() and not folder.parent.is_dir():
                    raise UserError(
                        f"{_path_of_shelf(out)}: this link points to a folder that does not exist; correct the link"
                    )
                folder.mkdir(parents=True, exist_ok=True)
                stack.callback(_remove_if_empty, folder)
                if not stack.enter_context(hidden.folder_lock(folder, 0.0)):
                    raise UserError(
                        f"{out}: another run is at work on it ({folder}); wait for it, or name another folder with --out"
                    )
                _reuse_or_clear(work, fingerprint)
            except OSError as error:
                raise UserError(
                    f"{folder}: {error.strerror or error}; name another folder with --out"
                ) from error
        have = sum(path.stat().st_size for path in folder.glob("*-*.bin"))
        room = shutil.disk_usage(folder).free
        _check_space(folder, need, have, room)
        _create_forcing_folder(folder / FORCING, slices, room + have - need)
        with _lost_files_as_user_errors(work), _interrupts_with_notes(work, out):
            yield work


@contextlib.contextmanager
def _lost_files_as_user_errors(work: Work) -> Iterator[None]:
    """Turn an error of a file in the store, here or on a worker, into a UserError."""
    try:
        yield
    except OSError as error:
        path = Path(str(error.filename)).absolute()
        if error.filename is None or work.folder.absolute() not in path.parents:
            raise
        raise UserError(
            f"{path}: {error.strerror}; do not delete or change files of this folder before the results are complete; {work.kept}"
        ) from error


@contextlib.contextmanager
def _interrupts_with_notes(work: Work, out: Path | None) -> Iterator[None]:
    """Add to an interrupt how many shards are stored, unless their folder is a temporary one."""
    try:
        yield
    except (KeyboardInterrupt, Terminated) as interrupt:
        if out is not None and work.any_finished:
            interrupt.add_note(f"{work.folder}: {work.kept}")
        raise


def check_room(out: Path | None, need: int) -> None:
    """Reject a run whose shards do not fit on the disk, before its particles are drawn.

    Args:
        out: the output folder of the run; None: the shards go to a temporary folder.
        need: size of all shards [bytes].

    Raises:
        UserError: the disk has not enough free space.
    """
    folder = Path(tempfile.gettempdir()) if out is None else _shelf_beside(out).absolute()
    there = next(place for place in (folder, *folder.parents) if place.is_dir())
    have = sum(path.stat().st_size for path in folder.glob("*-*.bin")) if out is not None else 0
    _check_space(folder, need, have, shutil.disk_usage(there).free)


def _check_space(folder: Path, need: int, have: int, room: int) -> None:
    """Raise UserError if `need` exceeds the bytes stored and the free space, all in [bytes]."""
    if need - have > room:
        raise UserError(
            f"{folder}: the particles at all output times need {notation.format_bytes(need)}, and "
            f"{notation.format_bytes(room + have)} are free; free some space, name another folder with --out, or ask for fewer particles or outputs"
        )


def _create_forcing_folder(folder: Path, need: int, room: int) -> None:
    """Create the folder of the regridded forcing if it fits into `room` [bytes], else warn."""
    have = sum(path.stat().st_size for path in folder.glob("*"))
    if need <= room + have:
        folder.mkdir(exist_ok=True)
        return
    shutil.rmtree(folder, ignore_errors=True)
    LOG.warning(
        "%s: no space to cache the regridded forcing (%s); every shard will read and regrid it again",
        folder.parent,
        notation.format_bytes(need),
    )


def unfinished(out: Path) -> bool:
    """Return whether there are stored shards of an unfinished run to this output folder."""
    return os.path.isdir(_shelf_beside(out))


def stored_shard_count(out: Path, fingerprint: Mapping[str, str]) -> int | None:
    """Return the number of shards of an unfinished run; None if it is not stored.

    Args:
        out: the output folder.
        fingerprint: the run's fingerprint; its number of shards is ignored.
    """
    before = mark_of(_shelf_beside(out))
    if before is None or any(
        before.get(name) != value for name, value in fingerprint.items() if name != NUMBER
    ):
        return None
    return int(before[NUMBER]) if str(before.get(NUMBER)).isdecimal() else None


def resumed_backend(backend: str, out: str | os.PathLike[str] | None, client: Any = None) -> str:
    """Return the backend; AUTO becomes the backend of an unfinished run to the folder, if any.

    The finished shards are valid only on the backend that made them.

    Args:
        backend: the requested backend.
        out: the output folder; None: there is none.
        client: a client of a cluster, whose workers have only processors; None: no cluster.
    """
    if backend != runtime.AUTO or out is None or client is not None:
        return backend
    before = str((mark_of(_shelf_beside(Path(out))) or {}).get(BACKEND, "")).partition(":")[0]
    return before if before in runtime.BACKENDS else backend


def clear(out: Path, fingerprint: Mapping[str, str] | None = None) -> None:
    """Delete the stored shards of a run whose results are complete.

    Args:
        out: the output folder.
        fingerprint: delete only the shards of the run with this fingerprint; None: of any run.
    """
    folder = _shelf_beside(out)
    if unfinished(out) and (
        fingerprint is None or stored_shard_count(out, fingerprint) is not None
    ):
        with hidden.folder_lock(folder, 0.0) as free:
            if free:
                shutil.rmtree(folder, ignore_errors=True)


def _shelf_beside(out: Path) -> Path:
    """Return the folder of the shards; if it is a link, a subfolder of its target for this run."""
    place = _path_of_shelf(out)
    if not place.is_symlink():
        return place
    real = os.path.realpath(out)
    whose = hashlib.blake2b(os.fsencode(real), digest_size=6).hexdigest()
    return Path(os.path.realpath(place)) / f"{os.path.basename(real)}-{whose}{hidden.UNFINISHED}"


def _path_of_shelf(out: Path) -> Path:
    """Return the path of the shards' folder: beside the output folder, or in it.

    It is in the output folder if that is a mount point, or if its parent is not writable.
    """
    real = Path(os.path.realpath(out))
    inside = real.is_dir() and (
        os.path.ismount(real) or not os.access(real.parent, os.W_OK | os.X_OK)
    )
    return real / hidden.UNFINISHED if inside else real.parent / f".{real.name}{hidden.UNFINISHED}"


def _remove_if_empty(folder: Path) -> None:
    """Delete a folder if it is empty."""
    with contextlib.suppress(OSError):
        folder.rmdir()


def _reuse_or_clear(work: Work, fingerprint: Mapping[str, str]) -> None:
    """Keep the finished shards of the same run; delete those of another, and log what changed."""
    about, before = work.folder / ABOUT, mark_of(work.folder)
    if before == dict(fingerprint):
        many = len(list(work.folder.glob(INDICES)))
        if many:
            LOG.warning("%d shards of this run were finished before: it resumes from there", many)
        return
    if before is not None:
        changed = [
            name for name in {**before, **fingerprint} if before.get(name) != fingerprint.get(name)
        ]
        LOG.warning(
            "an unfinished run is there, but %s changed since: it starts again",
            " and ".join(changed),
        )
    work.drop()
    replace(about, json.dumps(dict(fingerprint)))


@contextlib.contextmanager
def cache_forcing_in(where: Environment, work: Work) -> Iterator[None]:
    """Cache the forcing that this process regrids in the store, while the context is open."""
    environment.share_slices(where, work.forcing)
    try:
        yield
    finally:
        environment.share_slices(where, None)


def bytes_of_slices(case: Case, scene: Scene) -> int:
    """Return the size of a run's regridded forcing [bytes]."""
    return scene.forcing.size(*notation.epochs(np.array(case.period.span)).tolist())


def bytes_of_shards(case: Case, particles: int) -> int:
    """Return the approximate size of a run's shards [bytes]: outputs, updates and states.

    Args:
        case: the case of the run.
        particles: the number of its particles.
    """
    # updates, and the start and the end of the run
    records = len(case.sorties) + len(case.contacts) + len(case.sensors.telling) + 2
    again = case.resampling.below > 0
    states = 0  # of the stretch under way and the one before
    if again or any(contact.belief < 1 for contact in case.contacts):
        states = 2 * (
            STATE
            + DEBRIS * len({contact.drifter for contact in case.contacts} - {None})
            + 4 * len(case.sorties)
        )
    noted = (NOTED + DRAWN * again) * records if run_setup.needs_whole_ensemble(case) else 0
    return particles * (BYTES * case.outputs.size + BYTES_END + noted + states)
