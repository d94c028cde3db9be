"""What is too large for memory lies in the temporary folder meanwhile, in files without a name."""

import math
import mmap
import os
import shutil
import tempfile
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from geo import notation
from geo.array import Array
from geo.errors import UserError

LARGE = 2**28  # [bytes] of arrays that are laid on disk; fewer stay in memory


def check_room(need: int, what: str) -> None:
    """Raise UserError where the temporary folder has less room than that [bytes]; what: needs it,
    in words.
    """
    try:
        free = shutil.disk_usage(tempfile.gettempdir()).free
    except OSError as error:
        raise refusal(error.strerror or str(error)) from error
    if need > free:
        raise refusal(f"{what} need {notation.size(need)}, and {notation.size(free)} are free")


def refusal(reason: str) -> UserError:
    """Return an error of the temporary folder, with what helps."""
    temporary = tempfile.tempdir or os.environ.get("TMPDIR", "")
    return UserError(
        f"temporary folder {temporary}: {reason}; free some space, name another folder in the environment variable TMPDIR, or "
        "ask for fewer particles or output times"
    )


def zeros(shapes: Sequence[tuple[int, ...]], kind: npt.DTypeLike) -> list[Array]:
    """Return arrays of zeros: on disk, where they are large together and there is room for them,
    else in memory.
    """
    sizes = [math.prod(shape) * np.dtype(kind).itemsize for shape in shapes]
    # without it a disk that fills up ends the process
    if sum(sizes) >= LARGE and hasattr(os, "posix_fallocate"):
        try:
            if sum(sizes) < shutil.disk_usage(tempfile.gettempdir()).free:
                return [
                    _on_disk(shape, kind, size) for shape, size in zip(shapes, sizes, strict=True)
                ]
        except OSError:
            pass
    return [np.zeros(shape, kind) for shape in shapes]


def _on_disk(shape: tuple[int, ...], kind: npt.DTypeLike, size: int) -> Array:
    with tempfile.TemporaryFile(prefix="drift-") as file:
        os.posix_fallocate(file.fileno(), 0, size)
        return np.memmap(file, kind, "r+", shape=shape)


def let_go(values: Array) -> None:
    """Let the memory go in which an array on disk was changed or read; its values stay."""
    held = getattr(values, "_mmap", None)
    if isinstance(held, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        held.madvise(mmap.MADV_DONTNEED)
