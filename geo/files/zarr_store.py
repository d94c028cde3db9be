"""Open Zarr stores in folders, after checking their metadata.

Chunks with the codec "pickle", and some arrays of Python objects, run code when they are decoded.
Stores come from elsewhere, so both are rejected, whatever numcodecs and its settings allow.
"""

import json
import os
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import xarray as xr

from geo.errors import UserError

CODEC = "pickle"
UNSAFE = "NUMCODECS_ALLOW_UNSAFE_PICKLE_DECODE"  # lets numcodecs 0.16.6 and later decode pickles
GROUPS = (".zgroup", ".zmetadata", "zarr.json")  # a folder with one of these files is a group
DOCUMENTS = (*GROUPS, ".zarray", ".zattrs")
FREE = ("attributes", ".zattrs")  # users' attributes, from which nothing is built
# the only filter with which an array of objects holds nothing but texts
TEXTS = ({"id": "vlen-utf8"},)
# [bytes] arrays up to this size, such as coordinates, are read to find out which one is damaged
SMALL = 2**24
TYPES = ("dtype", "astype", "encode_dtype", "decode_dtype", "data_type")  # keys that name a type

_building = threading.RLock()


def is_store(folder: str) -> bool:
    """Return True if a folder is a Zarr group."""
    return any(os.path.exists(os.path.join(folder, name)) for name in GROUPS)


def open_store(folder: str, **options: Any) -> xr.Dataset:
    """Return the dataset of a store, opened by xarray with options.

    Raises UserError with the file or array concerned if the store would run code or is damaged.
    """
    if not is_store(folder):
        raise UserError(f'"{folder}": is a folder, not a netCDF file or a Zarr store')
    try:
        with without_pickles():
            check(folder)
            return xr.open_dataset(folder, engine="zarr", **options)
    except UserError:
        raise
    except Exception as error:  # the library raises errors of all kinds over damaged metadata
        raise damage(folder, error) from error


def damage(folder: str, error: Exception) -> UserError:
    """Return a UserError that says which part of a store is damaged, given a library's error."""
    with suppress(Exception):  # the search itself may fail on the damage
        if found := _first_damaged(folder, SMALL):
            name, cause = found
            place = os.path.join(folder, name)
            return UserError(
                f'"{place}": this array cannot be read, truncated or damaged ({_one_line(cause)})'
            )
    return UserError(f'"{folder}": cannot be read, truncated or damaged ({_one_line(error)})')


def check(folder: str) -> None:
    """Raise UserError if metadata of a group or its arrays are no JSON or could run code."""
    known = list(_metadata_files(folder))
    if known and not any(os.path.join(folder, name) in known for name in (".zgroup", "zarr.json")):
        raise UserError(
            f'"{os.path.join(folder, ".zgroup")}": is not there, but {known[0]} is; the store is damaged'
        )
    for path in known:
        try:
            with open(path, encoding="utf-8") as file:
                document = json.load(file)
        except (ValueError, RecursionError) as error:
            raise UserError(
                f'"{path}": is no JSON ({_one_line(error)}), truncated or damaged'
            ) from error
        except OSError as error:
            raise UserError(f'"{path}": cannot be read ({error.strerror})') from error
        if not isinstance(document, dict):
            raise UserError(
                f'"{path}": holds {type(document).__name__}, not a JSON object; it is damaged'
            )
        if os.path.basename(path) not in FREE:
            _refuse_code(document, path)


@contextmanager
def without_pickles() -> Iterator[None]:
    """Keep numcodecs from building a pickle codec here, whatever the environment says."""
    # numcodecs reads this variable when it is imported, here or in child processes
    os.environ.pop(UNSAFE, None)
    from numcodecs import registry
    from numcodecs.abc import Codec

    class RejectedCodec(Codec):  # type: ignore[misc]
        """Replacement for the codec that fails when it is built."""

        codec_id = CODEC

        def __init__(self, *_: object, **__: object) -> None:
            raise UserError(
                f'its codec "{CODEC}" runs code when it is read, which drift does not allow'
            )

        def encode(self, buf: Any) -> Any:
            raise NotImplementedError

        def decode(self, buf: Any, out: Any = None) -> Any:
            raise NotImplementedError

    with _building:  # another thread would restore what this one has replaced
        before = registry.codec_registry.get(CODEC)
        registry.register_codec(RejectedCodec, CODEC)
        try:
            yield
        finally:
            if before is None:
                registry.codec_registry.pop(CODEC, None)
            else:
                registry.register_codec(before, CODEC)


def _metadata_files(folder: str) -> Iterator[str]:
    """Yield the metadata files of a group and of its direct children, which xarray opens."""
    inside = sorted(entry.name for entry in os.scandir(folder) if entry.is_dir())
    for place in ("", *inside):
        for name in DOCUMENTS:
            path = os.path.join(folder, place, name)
            if os.path.lexists(path):
                yield path


def _refuse_code(value: Any, path: str) -> None:
    """Raise UserError for metadata with a codec that runs code or a type with non-text objects."""
    if isinstance(value, list):
        for part in value:
            _refuse_code(part, path)
    if not isinstance(value, dict):
        return
    for key in ("id", "name"):
        if isinstance(named := value.get(key), str) and named.lower().rpartition(".")[2] == CODEC:
            raise UserError(
                f'"{path}": the codec "{named}" runs code when it is read, which drift does not allow'
            )
    texts = _is_text(value)
    for key, part in value.items():
        if key in TYPES and _holds_objects(part) and not (key == "dtype" and texts):
            raise UserError(
                f'"{path}": {key} {json.dumps(part)[:100]} is of Python objects, which drift does not read; allowed are '
                'numbers, and texts of the one filter "vlen-utf8"'
            )
        if not any(key == free or key.endswith(f"/{free}") for free in FREE):
            _refuse_code(part, path)


def _is_text(array: dict[str, Any]) -> bool:
    """Return True if an array of objects holds only texts."""
    return array.get("dtype") == "|O" and array.get("filters") == list(TEXTS)


def _holds_objects(written: Any) -> bool:
    """Return True if a type, as written in metadata, contains Python objects."""
    if isinstance(written, list):  # fields: name, type and possibly shape
        return any(
            isinstance(field, list) and any(map(_holds_objects, field[1:])) for field in written
        )
    if isinstance(written, dict):
        return any(map(_holds_objects, written.values()))
    with suppress(Exception), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return isinstance(written, str) and bool(np.dtype(written).hasobject)
    return False  # no NumPy type: Zarr rejects it, or it is a type of Zarr's own


def _first_damaged(folder: str, largest: int = 0) -> tuple[str, Exception] | None:
    """Return the name of the first array of a store that cannot be opened, and the error.

    None if all can be opened. Values of arrays up to the size `largest` [bytes] are read as well.
    """
    import zarr

    for entry in sorted(os.scandir(folder), key=lambda one: one.name):
        if not entry.is_dir() or not any(
            os.path.exists(os.path.join(entry, n)) for n in (".zarray", "zarr.json")
        ):
            continue
        try:
            with without_pickles():
                array = zarr.open_array(entry.path, mode="r")
            if array.nbytes <= largest:
                array[...]
        except Exception as error:
            return entry.name, error
    return None


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
