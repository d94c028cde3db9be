"""Large arrays in unnamed files of the temporary folder, when they do not fit into memory."""

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

LARGE = 2**28  # [bytes] of arrays from which on they are stored on disk


def check_room(need: int, what: str) -> None:
    """Raise UserError if the temporary folder has too little space.

    Args:
        need: space that is needed [bytes].
        what: what needs it, for the message.
    """
    try:
        free = shutil.disk_usage(tempfile.gettempdir()).free
    except OSError as error:
        raise temporary_folder_error(error.strerror or str(error)) from error
    if need > free:
        raise temporary_folder_error(
            f"{what} need {notation.format_bytes(need)}, and {notation.format_bytes(free)} are free"
        )


def temporary_folder_error(reason: str) -> UserError:
    """Return an error about the temporary folder, with advice."""
    temporary = tempfile.tempdir or os.environ.get("TMPDIR", "")
    return UserError(
        f"temporary folder {temporary}: {reason}; free some space, name another folder in the environment variable TMPDIR, or "
        "ask for fewer particles or output times"
    )


def zeros(shapes: Sequence[tuple[int, ...]], kind: npt.DTypeLike) -> list[Array]:
    """Return arrays of zeros: on disk if they are large in total and fit there, else in memory."""
    sizes = [math.prod(shape) * np.dtype(kind).itemsize for shape in shapes]
    # without posix_fallocate a full disk would kill the process
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


def release_pages(values: Array) -> None:
    """Release the memory pages of an array on disk; its values stay."""
    mapped = getattr(values, "_mmap", None)
    if isinstance(mapped, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        mapped.madvise(mmap.MADV_DONTNEED)
