"""Datasets at addresses (OPeNDAP), read through a separate process.

So no server can crash or hang this process. The result is a dataset like that of a file: read on
demand, decoded by the same rules. A request asks for the header or for at most 2 MB of values. If
the server does not answer a request within the time-out (60 s unless the case says otherwise), the
request fails. Waiting can be interrupted by signals, and ends within half a second if the answer is
no longer needed. The process starts with the first request, is restarted if it had to be stopped,
and never outlives this process.
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
STARTING = 120.0  # [s] within which the reading process must start, even on a slow machine
PIECE = 2_000_000  # [bytes] largest amount of values per request
LONGEST_AXIS = 10_000_000  # largest number of values of a coordinate
LARGEST = 2**32  # [bytes] largest amount of values per read
START = "from geo.files import address_server; address_server.main(sys.argv[1])"

_open: "weakref.WeakValueDictionary[str, Line]" = weakref.WeakValueDictionary()
_opening = threading.Lock()


def open_dataset(address: str, timeout: float = TIMEOUT) -> xr.Dataset:
    """Return the dataset at an address, with fill values and packing resolved, times undecoded.

    Args:
        address: of the dataset.
        timeout: longest wait for the answer to a request [s].

    Raises:
        UserError: the dataset cannot be opened. Reading from it raises UserError as well.
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
    """A process that reads one address; it answers one request at a time."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._lock = threading.Lock()
        self._child: Child | None = None
        self._header: Any = None

    def header(self, timeout: float) -> dict[str, Any]:
        """Return the header of the dataset; see `address_server.header`."""
        with self._exclusive():
            self._start_and_open(timeout)
            header: dict[str, Any] = self._header
            return header

    def values(
        self, name: str, key: tuple[slice, ...], dtype: np.dtype[Any], timeout: float
    ) -> np.ndarray[Any, Any]:
        """Return part of a variable; key: slices with positive steps."""
        shape = tuple(len(range(s.start, s.stop, s.step)) for s in key)
        with self._exclusive():
            self._start_and_open(timeout)
            bounds = [(s.start, s.stop, s.step) for s in key]
            reply, content = self._request({"ask": "values", "name": name, "key": bounds}, timeout)
        if dtype.kind == "O" and len(reply.get("texts", ())) == math.prod(shape):
            return np.array(reply["texts"], object).reshape(shape)
        if tuple(reply.get("shape", ())) != shape or reply.get("dtype") != dtype.str:
            raise UserError(
                f'"{self.address}" answered with other values than were asked for, of {name}'
            )
        return np.frombuffer(content, dtype).reshape(shape)

    def close(self) -> None:
        """End the process; a later request starts another one."""
        child, self._child = self._child, None
        if child is not None:
            child.end()

    @contextlib.contextmanager
    def _exclusive(self) -> Iterator[None]:
        """Hold the process for this thread.

        Any error inside ends the process, because its answer may still be pending.
        """
        with waiting.hold_lock(self._lock):
            try:
                yield
            except Refused as error:
                raise UserError(str(error)) from None
            except BaseException:
                self.close()
                raise

    def _start_and_open(self, timeout: float) -> None:
        """Start the process and make it open the address, unless it is running."""
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
            header, _ = self._request({"ask": "open", "address": self.address}, timeout)
        except Refused:
            self.close()
            raise
        _check_header(header, self.address)
        if self._header is not None and _signature(header) != _signature(self._header):
            raise UserError(
                f'"{self.address}" holds other variables than when it was opened; run again'
            )
        self._header = header

    def _request(
        self, question: dict[str, Any], timeout: float
    ) -> tuple[dict[str, Any], memoryview]:
        """Return the answer to a request, and the bytes that go with it."""
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
    """An answer that reports an error; the process can take further requests."""


def _start_process() -> Child:
    """Start a process that will read one address; its first answer means that it is ready."""
    scratch = None
    try:
        scratch = tempfile.mkdtemp(prefix="drift-address-")
        return Child(START, scratch, most=2 * PIECE, scratch=scratch)
    except OSError as error:
        if scratch is not None:
            os.rmdir(scratch)
        raise UserError(f"cannot start a process to read an address ({error.strerror})") from None


def _check_header(header: dict[str, Any], address: str) -> None:
    """Raise UserError for a header that no real dataset can have."""
    sizes: dict[str, int] = {}
    for name, variable in header["variables"].items():
        dims, shape = variable["dims"], variable["shape"]
        if len(dims) != len(shape) or any(
            size < 0 or sizes.setdefault(d, size) != size
            for d, size in zip(dims, shape, strict=False)
        ):
            raise UserError(f'"{address}" gives contradictory dimensions for {name}')
        if dims == [name] and shape[0] > LONGEST_AXIS:
            raise UserError(
                f'"{address}" claims to hold {shape[0]:,} values along {name}: more than {LONGEST_AXIS:,}'
            )
    if sizes and not any(
        holder["attributes"] for holder in (header, *header["variables"].values())
    ):
        raise UserError(
            f'"{address}" does not describe its values: it has no attributes, or unreadable ones'
        )


def _signature(header: dict[str, Any]) -> dict[str, Any]:
    """Return names, dimensions, sizes and types in a header, to compare two headers."""
    return {n: (v["dims"], v["shape"], v["dtype"]) for n, v in header["variables"].items()}


class Store(AbstractDataStore):
    """Data store for xarray: the header of an address, with values read on demand."""

    __slots__ = ("_line", "_timeout")

    def __init__(self, line: Line, timeout: float) -> None:
        self._line, self._timeout = line, timeout

    def get_variables(self) -> dict[str, xr.Variable]:
        """Return the variables, not yet decoded."""
        variables = {}
        for name, entry in self._line.header(self._timeout)["variables"].items():
            array = Values(
                self._line, self._timeout, name, tuple(entry["shape"]), np.dtype(entry["dtype"])
            )
            attributes = {k: _to_numpy(v) for k, v in entry["attributes"].items()}
            data = indexing.LazilyIndexedArray(array)
            variables[name] = xr.Variable(entry["dims"], data, attributes, {"dtype": array.dtype})
        return variables

    def get_attrs(self) -> dict[str, Any]:
        """Return the attributes of the dataset."""
        return {k: _to_numpy(v) for k, v in self._line.header(self._timeout)["attributes"].items()}


def _to_numpy(value: Any) -> Any:
    """Return an attribute as a NumPy value, from the form in which `address_server` sends it."""
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
        """Return the part that an xarray indexer selects."""
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.BASIC, self._read
        )

    def _read(self, key: tuple[int | slice, ...]) -> np.ndarray[Any, Any]:
        """Return a part, given by integers and slices, with as many requests as it needs."""
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
            bounds = tuple(slice(w.start, w.stop, w.step) for w in wanted)
            result[piece] = self.line.values(self.name, bounds, self.dtype, self.timeout)
        return result[tuple(slice(None) if isinstance(index, slice) else 0 for index in key)]


def pieces(shape: tuple[int, ...], most: int) -> Iterator[tuple[slice, ...]]:
    """Yield slices that together cover an array once, with at most `most` values each.

    An empty array yields none.
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
