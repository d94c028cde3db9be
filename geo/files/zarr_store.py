"""Opening Zarr stores in folders: what their metadata ask for is checked before the library builds
anything of it.

Chunks of the codec "pickle", and some of arrays of Python objects, run code when they are decoded.
Stores come from elsewhere, so neither is read, whatever the release of numcodecs and its settings
allow.
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
UNSAFE = "NUMCODECS_ALLOW_UNSAFE_PICKLE_DECODE"  # has numcodecs 0.16.6 and later decode pickles
GROUPS = (".zgroup", ".zmetadata", "zarr.json")  # a folder with one of them is a group
DOCUMENTS = (*GROUPS, ".zarray", ".zattrs")
FREE = ("attributes", ".zattrs")  # what users write, which builds nothing
# the one filter by which an array of objects holds texts and nothing else
TEXTS = ({"id": "vlen-utf8"},)
# [bytes] arrays up to this size, such as coordinates, are read to find out which is damaged
SMALL = 2**24
TYPES = ("dtype", "astype", "encode_dtype", "decode_dtype", "data_type")  # keys that name a type

_building = threading.RLock()


def is_store(folder: str) -> bool:
    """Whether a folder is a Zarr group."""
    return any(os.path.exists(os.path.join(folder, name)) for name in GROUPS)


def open_store(folder: str, **options: Any) -> xr.Dataset:
    """Return the dataset of a store, as xarray opens it with options.

    Raises UserError, which names the file of the store or its array, where it would run code or is
    damaged.
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
    """Return in words what is damaged in a store, over which a library raised an error."""
    with suppress(Exception):  # what looks for damage may meet it
        if found := first_damaged(folder, SMALL):
            name, cause = found
            place = os.path.join(folder, name)
            return UserError(
                f'"{place}": this array cannot be read, truncated or damaged ({_words(cause)})'
            )
    return UserError(f'"{folder}": cannot be read, truncated or damaged ({_words(error)})')


def check(folder: str) -> None:
    """Raise UserError where the metadata of a group and its arrays are no JSON, or ask for what may
    run code.
    """
    known = list(_documents(folder))
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
                f'"{path}": is no JSON ({_words(error)}), truncated or damaged'
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
    """Have numcodecs build no pickle codec in this process meanwhile, whatever its environment
    allows.
    """
    # read when numcodecs is imported, here or in processes that this one starts
    os.environ.pop(UNSAFE, None)
    from numcodecs import registry
    from numcodecs.abc import Codec

    class RejectedCodec(Codec):  # type: ignore[misc]
        """Stands in for the codec, and fails when it is built."""

        codec_id = CODEC

        def __init__(self, *_: object, **__: object) -> None:
            raise UserError(
                f'its codec "{CODEC}" runs code when it is read, which drift does not allow'
            )

        def encode(self, buf: Any) -> Any:
            raise NotImplementedError

        def decode(self, buf: Any, out: Any = None) -> Any:
            raise NotImplementedError

    with _building:  # another thread would put back what this one has set
        before = registry.codec_registry.get(CODEC)
        registry.register_codec(RejectedCodec, CODEC)
        try:
            yield
        finally:
            if before is None:
                registry.codec_registry.pop(CODEC, None)
            else:
                registry.register_codec(before, CODEC)


def _documents(folder: str) -> Iterator[str]:
    """Give the metadata of a group and of the arrays and groups just below it, of which xarray
    opens the arrays.
    """
    inside = sorted(entry.name for entry in os.scandir(folder) if entry.is_dir())
    for place in ("", *inside):
        for name in DOCUMENTS:
            path = os.path.join(folder, place, name)
            if os.path.lexists(path):
                yield path


def _refuse_code(value: Any, path: str) -> None:
    """Raise UserError where metadata name a codec that runs code, or a type that holds objects
    other than texts.
    """
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
    """Whether an array of objects holds texts alone."""
    return array.get("dtype") == "|O" and array.get("filters") == list(TEXTS)


def _holds_objects(written: Any) -> bool:
    """Whether a type, as metadata write it, holds Python objects."""
    if isinstance(written, list):  # of fields: name, type and perhaps shape
        return any(
            isinstance(field, list) and any(map(_holds_objects, field[1:])) for field in written
        )
    if isinstance(written, dict):
        return any(map(_holds_objects, written.values()))
    with suppress(Exception), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return isinstance(written, str) and bool(np.dtype(written).hasobject)
    return False  # no type of NumPy: Zarr rejects it, or has a type of its own


def first_damaged(folder: str, largest: int = 0) -> tuple[str, Exception] | None:
    """Return the name of the first array of a store that cannot be opened, and why; None where all
    can.

    largest: of arrays up to this size the values are read too [bytes].
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


def _words(error: BaseException) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
