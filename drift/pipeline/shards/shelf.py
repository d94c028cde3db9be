"""The folder in which a run in shards keeps what it has finished: beside its results, and gone when
these stand.

All of it stands under a fingerprint of the case, the versions, the forcing and the processor's
arithmetic: where that has changed, nothing of it is used.
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
from geo import notation
from geo.errors import UserError
from kernels.runtime import runtime

# [bytes] a particle and update, about: weights, and the quantities of which posteriors are told
NOTED = 80
# [bytes] a particle where shards meet, about; more for each kind of debris
STATE, DEBRIS = 200, 100
DRAWN = 24  # [bytes] a particle, each time that particles are drawn again


@contextlib.contextmanager
def open_shelf(
    out: Path | None, fingerprint: Mapping[str, str], need: int, slices: int = 0
) -> Iterator[Work]:
    """Give the work of a run that writes to `out`, as far as it is finished; None: it is not kept.

    fingerprint: of all that decides on the results, by what it is of; need: [bytes] of all shards;
    slices: [bytes] of the forcing's, which are kept if there is room for them too. It stays until
    `clear`. Raises UserError where another run is at work on it, or there is no room.
    """
    with contextlib.ExitStack() as stack:
        if out is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="drift-")))
            work = Work(folder, run_of(fingerprint))
            replace(folder / ABOUT, json.dumps(dict(fingerprint)))
        else:
            folder = shelf_beside(out)
            work = Work(folder, run_of(fingerprint))
            try:
                if _place(out).is_symlink() and not folder.parent.is_dir():
                    raise UserError(
                        f"{_place(out)}: the folder to which this link leads is not there; mend the link"
                    )
                folder.mkdir(parents=True, exist_ok=True)
                stack.callback(_removed_if_empty, folder)
                if not stack.enter_context(hidden.alone(folder, 0.0)):
                    raise UserError(
                        f"{out}: another run is at work on it ({folder}); wait for it, or name another folder with --out"
                    )
                _take_up(work, fingerprint)
            except OSError as error:
                raise UserError(
                    f"{folder}: {error.strerror or error}; name another folder with --out"
                ) from error
        have = sum(path.stat().st_size for path in folder.glob("*-*.bin"))
        room = shutil.disk_usage(folder).free
        _refuse_without(folder, need, have, room)
        _make_room(folder / FORCING, slices, room + have - need)
        yield work


def check_room(out: Path | None, need: int) -> None:
    """Reject a run whose shards [bytes] the disk has no room for, before anything of it is drawn.

    out: folder of its results; None: they are not kept, and the shards lie in the temporary folder.
    """
    folder = Path(tempfile.gettempdir()) if out is None else shelf_beside(out).absolute()
    there = next(place for place in (folder, *folder.parents) if place.is_dir())
    have = sum(path.stat().st_size for path in folder.glob("*-*.bin")) if out is not None else 0
    _refuse_without(folder, need, have, shutil.disk_usage(there).free)


def _refuse_without(folder: Path, need: int, have: int, room: int) -> None:
    """Raise UserError where a folder has no room [bytes] for what is needed and not there yet."""
    if need - have > room:
        raise UserError(
            f"{folder}: the particles at all output times need {notation.size(need)}, and "
            f"{notation.size(room + have)} are free; free some space, name another folder with --out, or ask for fewer particles or outputs"
        )


def _make_room(folder: Path, need: int, room: int) -> None:
    """Make the folder of the forcing's slices, if there is room for them [bytes]; say so where
    there is none.
    """
    have = sum(path.stat().st_size for path in folder.glob("*"))
    if need <= room + have:
        folder.mkdir(exist_ok=True)
        return
    shutil.rmtree(folder, ignore_errors=True)
    LOG.warning(
        "%s: no space to cache the regridded forcing (%s); every shard will read and regrid it again",
        folder.parent,
        notation.size(need),
    )


def unfinished(out: Path) -> bool:
    """Whether anything is kept of a run that was to write its results there."""
    return os.path.isdir(shelf_beside(out))


def begun(out: Path, fingerprint: Mapping[str, str]) -> int | None:
    """Return into how many shards this very run was cut before; None where nothing of it is there.

    fingerprint: of it, whatever the number of its shards.
    """
    before = mark_of(shelf_beside(out))
    if before is None or any(
        before.get(name) != value for name, value in fingerprint.items() if name != NUMBER
    ):
        return None
    return int(before[NUMBER]) if str(before.get(NUMBER)).isdecimal() else None


def settled(backend: str, out: str | os.PathLike[str] | None, client: Any = None) -> str:
    """Return a backend, and in place of AUTO the one on which an unfinished run to a folder was
    moved, if there is one.

    On another one nothing that is finished would count. client: of workers, who have processors
    alone.
    """
    if backend != runtime.AUTO or out is None or client is not None:
        return backend
    before = str((mark_of(shelf_beside(Path(out))) or {}).get(BACKEND, "")).partition(":")[0]
    return before if before in runtime.BACKENDS else backend


def clear(out: Path, fingerprint: Mapping[str, str] | None = None) -> None:
    """Take away what is kept of a run whose results stand; fingerprint: of that run, if another's
    is to be left.
    """
    folder = shelf_beside(out)
    if unfinished(out) and (fingerprint is None or begun(out, fingerprint) is not None):
        with hidden.alone(folder, 0.0) as free:
            if free:
                shutil.rmtree(folder, ignore_errors=True)


def shelf_beside(out: Path) -> Path:
    """Return the folder beside that of the results; where a link of that name leads, one of these
    results' own.
    """
    place = _place(out)
    if not place.is_symlink():
        return place
    real = os.path.realpath(out)
    whose = hashlib.blake2b(os.fsencode(real), digest_size=6).hexdigest()
    return Path(os.path.realpath(place)) / f"{os.path.basename(real)}-{whose}{hidden.UNFINISHED}"


def _place(out: Path) -> Path:
    """Return where the folder lies: beside the results, or in them where nothing can be made there,
    as beside a mount.
    """
    real = Path(os.path.realpath(out))
    inside = real.is_dir() and (
        os.path.ismount(real) or not os.access(real.parent, os.W_OK | os.X_OK)
    )
    return real / hidden.UNFINISHED if inside else real.parent / f".{real.name}{hidden.UNFINISHED}"


def _removed_if_empty(folder: Path) -> None:
    """Take a folder away in which nothing is kept."""
    with contextlib.suppress(OSError):
        folder.rmdir()


def _take_up(work: Work, fingerprint: Mapping[str, str]) -> None:
    """Use what a run before has finished, if it was the same; else say what has changed, and begin
    again.
    """
    about, before = work.folder / ABOUT, mark_of(work.folder)
    if before == dict(fingerprint):
        many = len(list(work.folder.glob(INDICES)))
        if many:
            LOG.warning("%d shards of this run were finished before: it goes on from there", many)
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
def stored(where: Environment, work: Work) -> Iterator[None]:
    """Have what this process reads of the forcing stored with the shards meanwhile."""
    environment.store(where, work.forcing)
    try:
        yield
    finally:
        environment.store(where, None)


def slices(case: Case, scene: Scene) -> int:
    """Return how many bytes the slices of a run's forcing take."""
    return scene.forcing.size(*notation.epochs(np.array(case.period.span)).tolist())


def need(case: Case, particles: int) -> int:
    """Return about how many bytes the files of a run take: outputs, what is told of updates, states
    between stretches.
    """
    # with the begin and the end
    told = len(case.sorties) + len(case.contacts) + len(case.sensors.telling) + 2
    again = case.resampling.below > 0
    states = 0  # of the stretch under way and the one before
    if again or any(contact.belief < 1 for contact in case.contacts):
        states = 2 * (
            STATE
            + DEBRIS * len({contact.drifter for contact in case.contacts} - {None})
            + 4 * len(case.sorties)
        )
    noted = (NOTED + DRAWN * again) * told if run_setup.is_told(case) else 0
    return particles * (BYTES * case.outputs.size + BYTES_END + noted + states)
