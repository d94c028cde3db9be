"""Restriction of what this process may read: folders and hosts in the variable DRIFT_FENCE.

`drift serve` sets this environment variable for processes that run what a browser sent. Without it
everything is allowed. Access is checked when files are opened, not when names are read, so that
patterns, links and later changes cannot bypass it. A link inside an allowed folder counts as its
target.
"""

import json
import os
import re
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from geo.errors import UserError

# {"folders": [...], "hosts": ["host" or "host:port", ...], "writable": [...]} as JSON
NAME = "DRIFT_FENCE"
# environment variables that a restricted case may use; others may be secrets
VARIABLES = {"DRIFT_DATA"}
ADVICE = "put it into the folder that is served, or start drift serve with --allow"
PLACE = re.compile(
    r"[A-Za-z0-9.-]+(:\d{1,5})?"
)  # host with port; no user or brackets, which different parsers may read differently


@dataclass(frozen=True)
class Fence:
    """Folders and files (as real paths) and hosts that may be read, and folders for writing."""

    folders: tuple[Path, ...] = ()
    hosts: frozenset[str] = frozenset()
    writable: tuple[Path, ...] = ()  # enforced only by the kernel (`geo.files.landlock`)


def fence_text(fence: Fence) -> str:
    """Return a fence as text for the environment variable."""
    folders, writable = (list(map(str, some)) for some in (fence.folders, fence.writable))
    return json.dumps({"folders": folders, "hosts": sorted(fence.hosts), "writable": writable})


def current_fence() -> Fence | None:
    """Return the fence of this process, None for none; an invalid one allows nothing."""
    written = os.environ.get(NAME)
    if written is None:
        return None
    try:
        content = json.loads(written)
        folders, writable = (tuple(map(Path, content[key])) for key in ("folders", "writable"))
        return Fence(folders, frozenset(map(str, content["hosts"])), writable)
    except (ValueError, KeyError, TypeError, RecursionError):
        return Fence()


def check(path: str | os.PathLike[str]) -> None:
    """Raise UserError unless a file or folder may be read, with all links resolved."""
    fence = current_fence()
    if fence is not None and not _inside(fence, os.path.realpath(path)):
        raise _outside_error(path)


def check_open(handle: int, path: str | os.PathLike[str]) -> None:
    """Raise UserError unless an open file may be read: it cannot be exchanged any more."""
    fence = current_fence()
    if fence is None:
        return
    real = os.path.realpath(path)
    if os.path.islink(there := f"/proc/self/fd/{handle}"):  # Linux
        real = os.readlink(there)
    if not _inside(fence, real):
        raise _outside_error(path)


def check_store(folder: str) -> None:
    """Raise UserError unless a file, or a folder (Zarr) with all links in it, may be read."""
    if current_fence() is None:
        return
    check(folder)
    for place, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = os.path.join(place, name)
            # links to folders are rejected: their contents would have to be checked as well
            if os.path.islink(path) and os.path.isdir(path):
                raise _outside_error(path)
            if os.path.islink(path):
                check(path)


def check_pattern(pattern: str) -> None:
    """Raise UserError if a path or pattern could lead outside, before it is searched for."""
    if current_fence() is None:
        return
    parts = Path(pattern).parts
    plain = next((k for k, part in enumerate(parts) if re.search(r"[*?\[]", part)), len(parts))
    if ".." in parts[plain:]:
        raise _outside_error(pattern)
    check(Path(*parts[:plain]))


def check_variable(name: str) -> None:
    """Raise UserError unless paths may use an environment variable."""
    if current_fence() is not None and name not in VARIABLES:
        raise UserError(
            f"the environment variable {name} may not be used here; allowed: {', '.join(sorted(VARIABLES))}"
        )


def check_address(address: str) -> None:
    """Raise UserError unless requests may be sent to an address."""
    fence = current_fence()
    if fence is None:
        return
    scheme, _, rest = address.partition("://")
    place = re.split(r"[/?#]", rest, maxsplit=1)[0].lower()
    plain = (
        scheme.lower() in ("http", "https")
        and PLACE.fullmatch(place)
        and re.fullmatch(r"[!-~]+", rest)
    )
    # A fragment (#mode=file) would make the netCDF library read something other than the address.
    if (
        not plain
        or "\\" in rest
        or "#" in rest
        or not {place, str(urlsplit(address).hostname)} & fence.hosts
    ):
        raise UserError(
            f'the address "{address[:200]}" may not be asked here; start drift serve with --allow-host and its host'
        )


def check_program(name: str) -> None:
    """Raise UserError unless a program named in a case may be run."""
    if current_fence() is not None:
        raise UserError(
            f'"{name}" is a program, and programs in a case are not run here; run the case with drift run'
        )


def check_crs(written: object) -> None:
    """Raise UserError if a reference system in a case or file would make PROJ open a file."""
    if current_fence() is not None and re.search(
        r"[/\\]|init|grids|file|catalog", str(written), re.IGNORECASE
    ):
        raise UserError(
            "a reference system that names files may not be used here; give an EPSG code"
        )


def _inside(fence: Fence, real: str) -> bool:
    return any(Path(real).is_relative_to(folder) for folder in fence.folders)


def _outside_error(path: str | os.PathLike[str]) -> UserError:
    return UserError(f'"{str(path)[:200]}" is outside the folders that may be read here; {ADVICE}')
