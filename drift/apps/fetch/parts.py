"""Fetch the parts of shipments one by one, and keep them until all are there.

Parts are stored in a hidden folder next to the output folder, so that an interrupted fetch can
continue. A part counts once its digest is in the list there, which is replaced by one rename after
each part. All other files in that folder are deleted.
"""

import errno
import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
import xarray as xr

from drift.apps.fetch.order import Order, Part, Shipment
from drift.products.files import hidden, interrupt, manifest
from geo import waiting
from geo.errors import UserError
from geo.files import dataset
from geo.files.web import TemporaryError
from geo.forcing.times import clock

PREFIX = ".drift-fetch-"
LIST = "parts.json"
ATTEMPTS = 5
PAUSE = 1.0  # [s] before the second attempt; doubled before each further one
PATIENCE = 600.0  # [s] after which no further attempt is made
SPARE = 1.1  # free disk space that is required, as a multiple of the missing parts

T = TypeVar("T")
Report = Callable[[str, float], None]  # (name of the provider, share of all parts that is done)


def retry(attempt: Callable[[], T], tell: Callable[[str], None]) -> T:
    """Return the result of an attempt; repeat it after temporary failures, up to a limit."""
    until = time.monotonic() + PATIENCE
    for number in range(1, ATTEMPTS + 1):
        try:
            return attempt()
        except TemporaryError as error:
            pause = PAUSE * 2 ** (number - 1)
            if number == ATTEMPTS or time.monotonic() + pause > until:
                raise UserError(
                    f"{error}; stopped after {number} attempts, the same command continues from "
                    "here"
                ) from None
            tell(f"{error}; attempt {number + 1} of {ATTEMPTS} in {pause:g} s")
            _wait(pause)
    raise AssertionError


def _wait(seconds: float) -> None:
    until = time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0:
        interrupt.raise_if_interrupted()
        waiting.check_wait()
        time.sleep(min(left, waiting.POLL))


def parts_folder(out: Path, orders: Sequence[Order]) -> Path:
    """Return the hidden folder for the parts of some orders, which depends on them and on `out`."""
    identity = [
        [o.provider.name, o.provider.address, str(o.box), str(o.begin), str(o.end)] for o in orders
    ]
    key = hashlib.sha256(json.dumps([str(out.absolute()), identity]).encode()).hexdigest()[:12]
    return out.absolute().parent / f"{PREFIX}{key}"


@contextmanager
def locked_parts(folder: Path) -> Iterator[dict[str, str]]:
    """Yield the stored parts, as digests by key, while the folder is locked against other runs."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"cannot keep parts in {folder.parent}: {error.strerror}; name another folder with --out"
        ) from None
    with hidden.folder_lock(folder, 0.0) as free:
        if not free:
            raise UserError(
                "another `drift fetch` is already downloading this request; wait for it to finish or stop it"
            )
        yield _verified(folder)


def _verified(folder: Path) -> dict[str, str]:
    """Return the stored parts with correct digests; delete all other files."""
    listed: dict[str, str] = {}
    try:
        stored = json.loads((folder / LIST).read_text(encoding="utf-8"))
        listed = {str(key): str(digest) for key, digest in stored.items()}
    except (OSError, ValueError, AttributeError):
        pass
    verified = {
        k: d
        for k, d in listed.items()
        if path(folder, k).is_file() and manifest.digest(path(folder, k)) == d
    }
    names = {path(folder, key).name for key in verified} | {LIST}
    for other in folder.iterdir():
        if other.name not in names and other.is_file():
            other.unlink()
    return verified


def path(folder: Path, key: str) -> Path:
    """Return the path of a stored part."""
    return folder / f"{key}.nc"


def missing(shipments: Sequence[Shipment], there: dict[str, str]) -> float:
    """Return the estimated size of the parts that are still missing [bytes]."""
    return sum(
        part.size for shipment in shipments for part in shipment.parts if part.key not in there
    )


def fetch(
    folder: Path,
    shipments: Sequence[Shipment],
    there: dict[str, str],
    report: Report,
    tell: Callable[[str], None],
) -> None:
    """Fetch all missing parts; each is added to the list as soon as it is complete."""
    parts = [(shipment, part) for shipment in shipments for part in shipment.parts]
    _check_free_space(folder, missing(shipments, there))
    for number, (shipment, part) in enumerate(parts):
        report(shipment.order.provider.name, number / len(parts))
        if part.key in there:
            continue
        try:
            retry(partial(_fetch_part, folder, shipment.order, part), tell)
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise _disk_full_error(folder, number, len(parts)) from None
            raise UserError(
                f"cannot write into {folder.parent}: {error.strerror or error}"
            ) from None
        except UserError as error:
            there_now = sum(one.key in there for _, one in parts)
            raise UserError(f"{error} ({there_now} of {len(parts)} parts are kept)") from None
        there[part.key] = manifest.digest(path(folder, part.key))
        _write_list(folder, there)
    report("done", 1.0)


def _fetch_part(folder: Path, order: Order, part: Part) -> None:
    """Fetch a part; it gets its name once it was read back and checked."""
    draft = folder / f"{part.key}.draft.nc"
    draft.unlink(missing_ok=True)
    try:
        part.make(draft)
        _check_part(draft, order, part)
    except (RuntimeError, OSError) as error:
        # the netCDF library reports a full disk with an error of its own
        if shutil.disk_usage(folder).free < part.size:
            raise OSError(errno.ENOSPC, "disk full") from None
        if isinstance(error, OSError) and error.errno is not None and error.errno > 0:
            raise
        raise TemporaryError(
            f"a part of {order.provider.name} could not be written or read back ({error})"
        ) from None
    os.replace(draft, path(folder, part.key))


def _check_part(draft: Path, order: Order, part: Part) -> None:
    """Raise Passing unless a file contains both components at the times that were ordered."""
    name = order.provider.name
    try:
        with dataset.open_one(str(draft), order.provider.quantity) as data:
            fields = [variable for variable in data.data_vars.values() if variable.ndim >= 2]
            time = next(
                (
                    n
                    for n, v in data.variables.items()
                    if " since " in str(v.attrs.get("units", "")) and v.ndim < 2
                ),
                None,
            )
            if time is None or len(fields) < 2:
                raise TemporaryError(f"a part of {name} came without its times or components")
            decoded, _ = clock.decode(xr.Dataset({time: data[time].variable}), str(time))
            if part.times is not None and not np.array_equal(np.atleast_1d(decoded), part.times):
                raise TemporaryError(f"a part of {name} came with other times than were asked for")
            for variable in fields:  # reading all values reveals a truncated file
                variable.values  # noqa: B018
    except UserError as error:
        raise TemporaryError(f"a part of {name} is incomplete ({error})") from None


def _write_list(folder: Path, there: dict[str, str]) -> None:
    draft = folder / f"{LIST}.draft"
    draft.write_text(json.dumps(there), encoding="utf-8")
    os.replace(draft, folder / LIST)


def _check_free_space(folder: Path, size: float) -> None:
    free = shutil.disk_usage(folder).free
    if size * SPARE > free:
        raise UserError(
            f"{folder.parent} has {size_in_words(free)} free, and {size_in_words(size)} are to "
            "be fetched: free some, or name another folder "
            "with --out"
        )


def _disk_full_error(folder: Path, done: int, of: int) -> UserError:
    return UserError(
        f"disk full: {folder.parent} has no space left; {done} of {of} parts are kept, and the "
        "same command continues "
        "from there"
    )


def size_in_words(size: float) -> str:
    """Return a size [bytes] as text with a decimal unit."""
    for unit in ("bytes", "kB", "MB"):
        if size < 1000:
            return f"{size:.0f} {unit}" if unit == "bytes" else f"{size:.1f} {unit}"
        size /= 1000
    return f"{size:.1f} GB"
