"""Open the paths of a case (netCDF, GRIB, globs, Zarr stores, OPeNDAP) as xarray datasets.

Only headers are read. Every problem with a path becomes one message with the path and the key of
the case that names it.
"""

import glob
import hashlib
import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import xarray as xr

from geo.errors import UserError
from geo.files import address, digest, fence, grib, messages, zarr_store

# [bytes] files up to this size are hashed whole, larger ones by 256 samples spread over the file
WHOLE = 2**28
SAMPLE = 2**16  # [bytes] size of a sample
# errors that damaged files cause in any library
FAULTS = (OSError, RuntimeError, EOFError, MemoryError, UnicodeError)
LIBRARIES = {"cftime", "dask", "fsspec", "netCDF4", "numcodecs", "xarray", "zarr"}

Paths = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]


def is_remote(path: str) -> bool:
    """Return True if a path is an address (OPeNDAP) and not a file."""
    return path.startswith(("http://", "https://", "dods://", "s3://", "gs://"))


def expand(paths: Paths, quantity: str) -> list[str]:
    """Return every path that a case's list of paths and globs stands for.

    Args:
        paths: paths, globs and addresses.
        quantity: of the source, for messages.

    Raises:
        UserError: a file is missing or named twice, or a glob matches nothing.
    """
    listed = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    expanded: list[str] = []
    for path in (os.path.expanduser(os.fspath(p)) for p in listed):
        if is_remote(path) or os.path.exists(path):
            expanded.append(path)
        elif glob.has_magic(path):
            matches = sorted(glob.glob(path, recursive=True))
            if not matches:
                raise UserError(f'no file matches "{path}"; set [[{quantity}]] files')
            expanded += matches
        else:
            raise UserError(f'no such file: "{path}"; set [[{quantity}]] files')
    if not expanded:
        raise UserError(f"[[{quantity}]] files is empty; name at least one file")
    repeated = sorted({p for p in expanded if expanded.count(p) > 1})
    if repeated:
        raise UserError(f'"{repeated[0]}" is named twice in [[{quantity}]] files')
    return expanded


def key(path: str, quantity: str) -> str:
    """Return the key of a case in which a user can correct a path."""
    if is_remote(path):
        return f"[[{quantity}]] files or timeout"
    return f"[[{quantity}]] {'dataset' if path.startswith('dataset ') else 'files'}"


def title(paths: Sequence[str | os.PathLike[str]]) -> str:
    """Return a name for files in messages: that of the first, and the number of others."""
    first = os.path.basename(os.fspath(paths[0]).rstrip("/")) if paths else ""
    return first if len(paths) <= 1 else f"{first} and {len(paths) - 1} more"


def open_one(
    path: str, quantity: str, timeout: float = address.TIMEOUT, mend: str = ""
) -> xr.Dataset:
    """Return one file's dataset, with fill values and packing resolved, times undecoded.

    Args:
        path: of the file, Zarr store or address.
        quantity: of the source, for messages.
        timeout: longest wait for the answer of an address' server [s].
        mend: what the user can do about a wrong path, if no source of a quantity names it.

    Raises:
        UserError: the path cannot be opened.
    """
    where = mend or f"set {key(path, quantity)}"
    if is_remote(path):
        fence.check_address(path)
    else:
        fence.check_store(path)
    is_zarr = os.path.isdir(path)
    if (
        not is_remote(path) and not is_zarr and not os.path.isfile(path)
    ):  # reading a pipe could hang
        raise UserError(f'"{path}" is neither a file nor a folder; {where}')
    if is_zarr and not zarr_store.is_store(path):
        raise UserError(f'"{path}" is a folder, not a netCDF file or a Zarr store; {where}')
    try:
        with warnings.catch_warnings():
            # harmless warnings: of several fill values (xarray), of consolidation (Zarr)
            warnings.simplefilter("ignore")
            if is_remote(path):
                return address.open_dataset(path, timeout)
            if not is_zarr and messages.is_grib(path):
                return grib.open_file(path)
            data = open_local(
                path, decode_times=False, decode_coords=False, decode_timedelta=False, cache=False
            )
    except UserError as error:
        raise UserError(f"{error}; {where}") from error
    except Exception as error:
        # backends raise OSError, ValueError, KeyError, RuntimeError and their own
        if is_remote(path):
            raise UserError(
                f'cannot open the address "{path}" ({_one_line(error)}); {where}'
            ) from error
        raise UserError(
            f'"{path}" is not a netCDF file that can be read ({_reason(path, error)}); {where}'
        ) from error
    return data


def open_local(path: str | os.PathLike[str], **options: Any) -> xr.Dataset:
    """Return the dataset of a netCDF file or Zarr folder, opened by xarray with options.

    The engine is named, because xarray would otherwise try every installed backend. Raises
    UserError if a classic file is truncated, or a store is damaged or runs code; otherwise the
    errors of the netCDF library.
    """
    fence.check_store(os.fspath(path))
    if os.path.isdir(path):
        return zarr_store.open_store(os.fspath(path), **options)
    _refuse_truncated(os.fspath(path))
    return xr.open_dataset(path, engine="netcdf4", **options)


def _refuse_truncated(path: str) -> None:
    """Raise UserError if a classic netCDF file is shorter than its header says.

    The netCDF library would read zeros beyond its end.
    """
    with open(path, "rb") as file:
        magic = file.read(4)
    if magic in (b"CDF\x01", b"CDF\x02"):
        # imported late because it takes a sixth of a second, and only old files need it
        from scipy.io import netcdf_file

        class Header(netcdf_file):  # type: ignore[misc]
            """A reader without `close` at deletion: if reading fails, there is nothing to close."""

            def __del__(self) -> None:
                pass

        try:
            with open(path, "rb") as file, Header(file, mmap=True):
                pass
        except Exception as error:
            raise UserError(f'"{path}" is a truncated or damaged netCDF file') from error
    # scipy does not read this format, so check that the file is large enough for the values
    if magic == b"CDF\x05":
        import netCDF4

        with netCDF4.Dataset(path) as data:
            least = sum(int(np.prod(v.shape)) * v.dtype.itemsize for v in data.variables.values())
        if os.path.getsize(path) < least:
            raise UserError(f'"{path}" is a truncated or damaged netCDF file')


def _reason(path: str, error: Exception) -> str:
    """Return the reason why a file cannot be opened, for a message."""
    try:
        with open(path, "rb") as file:
            magic = file.read(8)
    except OSError as trouble:
        return str(trouble.strerror).lower()
    if not magic:
        return "it is empty"
    if any("\ud800" <= letter <= "\udfff" for letter in path):
        return "its name is not text in UTF-8: rename it"
    if magic.startswith((b"CDF", b"\x89HDF")):
        return "it is truncated or damaged"
    return (
        _one_line(error)
        if isinstance(error, PermissionError)
        else "unknown format, and no GRIB either"
    )


@contextmanager
def reporting_damage(paths: Paths, quantity: str, mend: str = "") -> Iterator[None]:
    """Convert the errors that libraries raise for a damaged file into one UserError with its path.

    Headers are read when a file is opened, attributes and coordinates later; each may be damaged.

    Args:
        paths: of the files.
        quantity: of the source, for messages.
        mend: see `open_one`.
    """
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        if not isinstance(error, FAULTS) and _package_raising(error) not in LIBRARIES:
            raise
        listed = [paths] if isinstance(paths, str | os.PathLike) else paths
        if len(listed) == 1 and os.path.isdir(only := os.fspath(listed[0])):
            raise UserError(
                f"{zarr_store.damage(only, error)}; {mend or f'set [[{quantity}]] files'}"
            ) from error
        named = ", ".join(f'"{os.fspath(path)}"' for path in listed)
        reason = f"{type(error).__name__}: {_one_line(error)}"
        raise UserError(
            f"{named[:500]}: cannot be read, truncated or damaged ({reason}); {mend or f'set [[{quantity}]] files'}"
        ) from error


def _package_raising(error: BaseException) -> str:
    """Return the package in which an error was raised."""
    trace, name = error.__traceback__, ""
    while trace is not None:
        name = str(trace.tb_frame.f_globals.get("__name__", ""))
        trace = trace.tb_next
    return name.partition(".")[0]


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:120]


def fingerprint(paths: Sequence[str], datasets: Sequence[xr.Dataset], extra: str = "") -> str:
    """Return a short hash of the contents of the paths.

    Files above 256 MiB are hashed by samples, 16 MiB in total; addresses by their header and short
    axes.
    """
    total = hashlib.sha256(extra.encode())
    for path, data in zip(paths, datasets, strict=True):
        if is_remote(path):
            total.update(repr(data).encode())
            for name in sorted(map(str, data.variables)):
                if data[name].ndim == 1 and data[name].size < 100_000:
                    total.update(np.ascontiguousarray(data[name].values).tobytes())
        elif os.path.isdir(path) or os.path.getsize(path) <= WHOLE:
            total.update(digest.digest_of(path).encode())
        else:
            _add_samples(total, path)
    return total.hexdigest()[:16]


def _add_samples(total: "hashlib._Hash", path: str) -> None:
    """Add a file's size and 256 samples of it to a hash."""
    size = os.path.getsize(path)
    total.update(str(size).encode())
    with open(path, "rb") as file:
        for start in np.linspace(0, size - SAMPLE, 256).astype(int):
            file.seek(int(start))
            total.update(file.read(SAMPLE))
