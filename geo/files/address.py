"""Datasets at addresses (OPeNDAP), read through a process of their own.

So no server can crash or hang this process.

What comes back is a dataset like that of a file: read on demand, decoded by the same rules. A
question asks for the header or for a piece of at most 2 MB of values. A server that leaves one
unanswered for the time-out (60 s unless the case says otherwise) is given up. A wait heeds signals,
and ends within half a second when nobody needs its answer any more. The process starts with the
first question, starts again if it had to be ended, and never outlives this one.
"""

import contextlib
import itertools
import math
import os
import tempfile
import threading
import weakref
from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.backends.common import AbstractDataStore
from xarray.core import indexing

from geo import waiting
from geo.errors import UserError
from geo.files.child import Child

TIMEOUT = 60.0  # [s] without progress
STARTING = 120.0  # [s] in which a process for an address must have started, even on a slow machine
PIECE = 2_000_000  # [bytes] of values that one question asks for at most
LONGEST_AXIS = 10_000_000  # most values that a coordinate may have
LARGEST = 2**32  # [bytes] most values that one reading may take
START = "from geo.files import address_server; address_server.main(sys.argv[1])"

_open: "weakref.WeakValueDictionary[str, Line]" = weakref.WeakValueDictionary()
_opening = threading.Lock()


def open_dataset(address: str, timeout: float = TIMEOUT) -> xr.Dataset:
    """Return the dataset at an address, with fill values and packing resolved but times as they are
    stored.

    timeout: how long a question may stay unanswered [s]. Raises UserError; so does reading from the
    dataset.
    """
    with _opening:
        line = _open.get(address)
        if line is None:
            line = _open[address] = Line(address)
    return xr.open_dataset(
        Store(line, timeout),
        decode_times=False,
        decode_coords=False,
        decode_timedelta=False,
        cache=False,
    )


class Line:
    """A process that reads one address: questions go there, one at a time, and answers come back."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._lock = threading.Lock()
        self._child: Child | None = None
        self._header: Any = None

    def header(self, timeout: float) -> dict[str, Any]:
        """Return what the address holds; see `address_server.header`."""
        with self._turn():
            self._ready(timeout)
            header: dict[str, Any] = self._header
            return header

    def values(
        self, name: str, key: tuple[slice, ...], dtype: np.dtype[Any], timeout: float
    ) -> np.ndarray[Any, Any]:
        """Return a piece of a variable; key: slices with positive steps."""
        shape = tuple(len(range(s.start, s.stop, s.step)) for s in key)
        with self._turn():
            self._ready(timeout)
            asked = [(s.start, s.stop, s.step) for s in key]
            reply, content = self._ask({"ask": "values", "name": name, "key": asked}, timeout)
        if dtype.kind == "O" and len(reply.get("texts", ())) == math.prod(shape):
            return np.array(reply["texts"], object).reshape(shape)
        if tuple(reply.get("shape", ())) != shape or reply.get("dtype") != dtype.str:
            raise UserError(
                f'"{self.address}" answered with other values than were asked for, of {name}'
            )
        return np.frombuffer(content, dtype).reshape(shape)

    def close(self) -> None:
        """End the process; a later question starts another one."""
        child, self._child = self._child, None
        if child is not None:
            child.end()

    @contextlib.contextmanager
    def _turn(self) -> Iterator[None]:
        """Hold the process for this thread.

        Any error inside ends it, because an answer may still be under way.
        """
        with waiting.turn(self._lock):
            try:
                yield
            except Refused as error:
                raise UserError(str(error)) from None
            except BaseException:
                self.close()
                raise

    def _ready(self, timeout: float) -> None:
        """Start the process and have it open the address, where it does not run yet."""
        if self._child is not None and self._child.running():
            return
        self.close()
        self._child = _start_process()
        try:
            self._child.answer(STARTING)
        except (TimeoutError, EOFError):
            raise UserError(
                "cannot start a process to read an address: it ended, or did not start in time"
            ) from None
        try:
            header, _ = self._ask({"ask": "open", "address": self.address}, timeout)
        except Refused:
            self.close()
            raise
        _check_header(header, self.address)
        if self._header is not None and _signature(header) != _signature(self._header):
            raise UserError(
                f'"{self.address}" holds other variables than when it was opened; run again'
            )
        self._header = header

    def _ask(self, question: dict[str, Any], timeout: float) -> tuple[dict[str, Any], memoryview]:
        """Return the answer to a question, and the bytes that go with it."""
        assert self._child is not None
        try:
            reply, content = self._child.ask(question | {"timeout": timeout}, timeout)
        except TimeoutError:
            raise UserError(
                f'"{self.address}" did not answer for {timeout:g} s (the timeout of its source)'
            ) from None
        except EOFError:
            raise UserError(
                f'what "{self.address}" answered cannot be read: the library that reads it {self._child.fate()}'
            ) from None
        if "error" in reply:
            what = (
                "cannot open the address"
                if question["ask"] == "open"
                else f"cannot read {question['name']} from"
            )
            raise Refused(f'{what} "{self.address}" ({reply["error"][:120]})')
        return reply, content


class Refused(Exception):
    """An answer that says what is wrong; the process that gave it can be asked again."""


def _start_process() -> Child:
    """Return a process that will read one address; its first answer says that it is ready."""
    scratch = None
    try:
        scratch = tempfile.mkdtemp(prefix="drift-address-")
        return Child(START, scratch, most=2 * PIECE, scratch=scratch)
    except OSError as error:
        if scratch is not None:
            os.rmdir(scratch)
        raise UserError(f"cannot start a process to read an address ({error.strerror})") from None


def _check_header(header: dict[str, Any], address: str) -> None:
    """Refuse a header that no real dataset can have."""
    sizes: dict[str, int] = {}
    for name, variable in header["variables"].items():
        dims, shape = variable["dims"], variable["shape"]
        if len(dims) != len(shape) or any(
            size < 0 or sizes.setdefault(d, size) != size
            for d, size in zip(dims, shape, strict=False)
        ):
            raise UserError(f'"{address}" contradicts itself on the dimensions of {name}')
        if dims == [name] and shape[0] > LONGEST_AXIS:
            raise UserError(
                f'"{address}" claims to hold {shape[0]:,} values along {name}: more than {LONGEST_AXIS:,}'
            )
    if sizes and not any(
        holder["attributes"] for holder in (header, *header["variables"].values())
    ):
        raise UserError(
            f'"{address}" says nothing of what its values mean: no attributes, or some that cannot be read'
        )


def _signature(header: dict[str, Any]) -> dict[str, Any]:
    """Return names, dimensions, sizes and types of a header."""
    return {n: (v["dims"], v["shape"], v["dtype"]) for n, v in header["variables"].items()}


class Store(AbstractDataStore):
    """What xarray opens: the header of an address, its values on demand."""

    __slots__ = ("_line", "_timeout")

    def __init__(self, line: Line, timeout: float) -> None:
        self._line, self._timeout = line, timeout

    def get_variables(self) -> dict[str, xr.Variable]:
        """Return the variables, not decoded yet."""
        variables = {}
        for name, entry in self._line.header(self._timeout)["variables"].items():
            array = Values(
                self._line, self._timeout, name, tuple(entry["shape"]), np.dtype(entry["dtype"])
            )
            attributes = {k: _native(v) for k, v in entry["attributes"].items()}
            data = indexing.LazilyIndexedArray(array)
            variables[name] = xr.Variable(entry["dims"], data, attributes, {"dtype": array.dtype})
        return variables

    def get_attrs(self) -> dict[str, Any]:
        """Return the attributes of the dataset."""
        return {k: _native(v) for k, v in self._line.header(self._timeout)["attributes"].items()}


def _native(value: Any) -> Any:
    """Return an attribute as NumPy knows it, from the form in which `address_server` wrote it."""
    if isinstance(value, dict):
        values = np.array(value["values"], np.dtype(value["dtype"]))
        return values if values.ndim else values[()]
    return value


class Values(BackendArray):
    """A variable at an address, read in pieces when it is indexed."""

    def __init__(
        self, line: Line, timeout: float, name: str, shape: tuple[int, ...], dtype: np.dtype[Any]
    ) -> None:
        self.line, self.timeout, self.name, self.shape, self.dtype = (
            line,
            timeout,
            name,
            shape,
            dtype,
        )

    def __getitem__(self, key: Any) -> Any:
        """Return the part that an indexer of xarray's asks for."""
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.BASIC, self._read
        )

    def _read(self, key: tuple[int | slice, ...]) -> np.ndarray[Any, Any]:
        """Return a part, given by integers and slices, in as many questions as it needs."""
        spans = [
            range(*index.indices(size))
            if isinstance(index, slice)
            else range(int(index) % size, int(index) % size + 1)
            for index, size in zip(key, self.shape, strict=True)
        ]
        if math.prod(len(span) for span in spans) * self.dtype.itemsize > LARGEST:
            raise UserError(f'"{self.line.address}": {self.name} is too large to be read at once')
        try:
            result = np.empty([len(span) for span in spans], self.dtype)
        except (MemoryError, ValueError):
            raise UserError(f'"{self.line.address}": {self.name} is too large to read') from None
        for piece in pieces(result.shape, max(PIECE // max(self.dtype.itemsize, 1), 1)):
            wanted = tuple(span[part] for span, part in zip(spans, piece, strict=True))
            asked = tuple(slice(w.start, w.stop, w.step) for w in wanted)
            result[piece] = self.line.values(self.name, asked, self.dtype, self.timeout)
        return result[tuple(slice(None) if isinstance(index, slice) else 0 for index in key)]


def pieces(shape: tuple[int, ...], most: int) -> Iterator[tuple[slice, ...]]:
    """Give slices that together cover an array once, each of at most `most` values.

    There are no slices where it is empty.
    """
    if 0 in shape:
        return
    lengths, left = [1] * len(shape), most
    for axis in reversed(range(len(shape))):
        lengths[axis] = max(min(shape[axis], left), 1)
        left //= lengths[axis]
    starts = (range(0, size, length) for size, length in zip(shape, lengths, strict=True))
    for corner in itertools.product(*starts):
        yield tuple(
            slice(k, min(k + length, size))
            for k, length, size in zip(corner, lengths, shape, strict=True)
        )
