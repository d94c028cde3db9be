"""Datasets at addresses (OPeNDAP), read through a process of their own, so that no server can crash or hang this one.

What comes back is a dataset like that of a file: read on demand, decoded by the same rules. A question is the header or
a piece of at most 2 MB of values; a server that leaves one unanswered for the time-out (60 s unless the case says otherwise) is given
up. A wait heeds signals, and ends within half a second when nobody needs its answer any more. The process starts with the first question,
starts anew if it had to be ended, and never outlives this one.
"""

import contextlib
import itertools
import json
import math
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import weakref
from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.backends.common import AbstractDataStore
from xarray.core import indexing

from geo import waiting
from geo.address_server import FAREWELL, LENGTH
from geo.errors import UserError

TIMEOUT = 60.0  # [s] without progress
STARTING = 120.0  # [s] in which a process for an address must have started, on however slow a machine
PIECE = 2_000_000  # [bytes] of values that one question asks for
LONGEST_HEADER = 2**26  # [bytes]
LONGEST_AXIS = 10_000_000  # values of a coordinate
LARGEST = 2**32  # [bytes] of values that one reading may take
START = "import sys; sys.path[:] = sys.argv[2:]; from geo import address_server; address_server.main(sys.argv[1])"

_open: "weakref.WeakValueDictionary[str, Line]" = weakref.WeakValueDictionary()
_opening = threading.Lock()


def open_dataset(address: str, timeout: float = TIMEOUT) -> xr.Dataset:
    """Return the dataset at an address with fill values and packing resolved but times as they are stored.

    timeout: how long a question may stay unanswered [s]. Raises UserError; so does reading from the dataset.
    """
    with _opening:
        line = _open.get(address)
        if line is None:
            line = _open[address] = Line(address)
    return xr.open_dataset(
        Store(line, timeout), decode_times=False, decode_coords=False, decode_timedelta=False, cache=False
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
        with self._turn(timeout):
            self._ready(timeout)
            told: dict[str, Any] = self._header
            return told

    def values(self, name: str, key: tuple[slice, ...], dtype: np.dtype[Any], timeout: float) -> np.ndarray[Any, Any]:
        """Return a piece of a variable; key: slices with positive steps."""
        shape = tuple(len(range(s.start, s.stop, s.step)) for s in key)
        with self._turn(timeout):
            self._ready(timeout)
            asked = [(s.start, s.stop, s.step) for s in key]
            told, content = self._ask({"ask": "values", "name": name, "key": asked}, timeout)
        if dtype.kind == "O" and len(told.get("texts", ())) == math.prod(shape):
            return np.array(told["texts"], object).reshape(shape)
        if tuple(told.get("shape", ())) != shape or told.get("dtype") != dtype.str:
            raise UserError(f'"{self.address}" answered with other values than were asked for, of {name}')
        return np.frombuffer(content, dtype).reshape(shape)

    def close(self) -> None:
        """End the process; a later question starts another one."""
        child, self._child = self._child, None
        if child is not None:
            child.end()

    @contextlib.contextmanager
    def _turn(self, timeout: float) -> Iterator[None]:
        """Wait until no other thread asks; whatever goes wrong inside ends the process, for an answer may still be under way."""
        while not self._lock.acquire(timeout=waiting.POLL):
            waiting.heed()
        try:
            yield
        except Refused as error:
            raise UserError(str(error)) from None
        except BaseException:
            self.close()
            raise
        finally:
            self._lock.release()

    def _ready(self, timeout: float) -> None:
        """Have the address open."""
        if self._child is not None and self._child.process.poll() is None:
            return
        self.close()
        self._child = Child()
        try:
            self._child.ready()
            told, _ = self._ask({"ask": "open", "address": self.address}, timeout)
        except Refused:
            self.close()
            raise
        _check_header(told, self.address)
        if self._header is not None and _form(told) != _form(self._header):
            raise UserError(f'"{self.address}" holds other variables than when it was opened; run again')
        self._header = told

    def _ask(self, question: dict[str, Any], timeout: float) -> tuple[dict[str, Any], bytes]:
        """Return the answer to a question."""
        assert self._child is not None
        try:
            told, content = self._child.ask(question | {"timeout": timeout}, timeout)
        except TimeoutError:
            raise UserError(f'"{self.address}" did not answer for {timeout:g} s (the timeout of its source)') from None
        except EOFError:
            raise UserError(
                f'what "{self.address}" answered cannot be read: the library that reads it {self._child.fate()}'
            ) from None
        if "error" in told:
            what = "cannot open the address" if question["ask"] == "open" else f"cannot read {question['name']} from"
            raise Refused(f'{what} "{self.address}" ({told["error"][:120]})')
        return told, content


class Refused(Exception):
    """An answer that says what is wrong; the process that gave it is in order."""


class Child:
    """A process that reads one address, and the thread that takes in what it answers."""

    def __init__(self) -> None:
        apart: dict[str, Any] = (
            {"start_new_session": True}  # Ctrl-C at a terminal is for this process; it ends the other one
            if os.name == "posix"
            else {"creationflags": getattr(subprocess, "CREATE_NO_WINDOW", 0)}
        )
        try:
            scratch = tempfile.mkdtemp(prefix="drift-address-")
            self.process = subprocess.Popen(
                [sys.executable, "-c", START, scratch, *map(str, sys.path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                bufsize=0,
                env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
                **apart,
            )
        except OSError as error:
            raise UserError(f"cannot start a process to read an address ({error.strerror})") from None
        self._answers: queue.SimpleQueue[tuple[dict[str, Any], bytes] | None] = queue.SimpleQueue()
        threading.Thread(
            target=_take_in, args=(self.process.stdout, self._answers), name="address", daemon=True
        ).start()
        self._busy = threading.Event()
        self._busy.set()
        self._end = weakref.finalize(
            self, _end, self.process, self._busy, scratch
        )  # at the latest when the program ends

    def ask(self, question: dict[str, Any], timeout: float) -> tuple[dict[str, Any], bytes]:
        """Return the answer; raise TimeoutError or, where the process ends without one, EOFError."""
        self._busy.set()
        text = json.dumps(question).encode()
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(len(text).to_bytes(LENGTH, "big") + text)
        except OSError:
            raise EOFError from None
        return self._answer(timeout)

    def ready(self) -> None:
        """Wait until the process has imported what it needs."""
        try:
            self._answer(STARTING)
        except (TimeoutError, EOFError):
            raise UserError("cannot start a process to read an address: it ended, or did not start in time") from None

    def _answer(self, timeout: float) -> tuple[dict[str, Any], bytes]:
        until = time.monotonic() + timeout
        while True:
            waiting.heed()
            left = until - time.monotonic()
            try:
                answer = self._answers.get(timeout=max(min(waiting.POLL, left), 0.0))
            except queue.Empty:
                if left <= 0:
                    raise TimeoutError from None
                continue
            if answer is None:
                raise EOFError
            self._busy.clear()
            return answer

    def end(self) -> None:
        """End the process, whatever it does."""
        self._end()

    def fate(self) -> str:
        """Return how the process ended, in words."""
        try:
            status = self.process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            return "stopped answering"
        if status >= 0:
            return f"ended with status {status}"
        try:
            return f"crashed ({signal.Signals(-status).name})"
        except ValueError:
            return f"crashed (signal {-status})"


def _take_in(pipe: Any, answers: "queue.SimpleQueue[tuple[dict[str, Any], bytes] | None]") -> None:
    """Pass answers on; None when there can be no more."""
    try:
        while True:
            told = json.loads(_read(pipe, int.from_bytes(_read(pipe, LENGTH), "big"), LONGEST_HEADER))
            answers.put((told, _read(pipe, int(told.get("bytes", 0)), 2 * PIECE)))
    except Exception:  # the end, or what no answer of ours looks like
        answers.put(None)
    finally:
        pipe.close()


def _read(pipe: Any, count: int, most: int = LENGTH) -> bytes:
    if not 0 <= count <= most:
        raise ValueError(count)
    content = bytearray()
    while len(content) < count:
        part = pipe.read(count - len(content))
        if not part:
            raise EOFError
        content += part
    return bytes(content)


def _end(process: "subprocess.Popen[bytes]", busy: threading.Event, scratch: str) -> None:
    """End a process: by the end of its input if it waits for a question, so that it closes what it holds."""
    if process.stdin is not None:
        with contextlib.suppress(OSError):
            process.stdin.close()
    if not busy.is_set():
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=FAREWELL)
    if process.poll() is None:
        process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=1.0)
    shutil.rmtree(scratch, ignore_errors=True)


def _check_header(told: dict[str, Any], address: str) -> None:
    """Refuse a header that no dataset has."""
    sizes: dict[str, int] = {}
    for name, variable in told["variables"].items():
        dims, shape = variable["dims"], variable["shape"]
        if len(dims) != len(shape) or any(
            size < 0 or sizes.setdefault(d, size) != size for d, size in zip(dims, shape, strict=False)
        ):
            raise UserError(f'"{address}" contradicts itself on the dimensions of {name}')
        if dims == [name] and shape[0] > LONGEST_AXIS:
            raise UserError(f'"{address}" claims to hold {shape[0]:,} values along {name}: more than {LONGEST_AXIS:,}')
    if sizes and not any(one["attributes"] for one in (told, *told["variables"].values())):
        raise UserError(f'"{address}" says nothing of what its values mean: no attributes, or some that cannot be read')


def _form(header: dict[str, Any]) -> dict[str, Any]:
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
        for name, told in self._line.header(self._timeout)["variables"].items():
            array = Values(self._line, self._timeout, name, tuple(told["shape"]), np.dtype(told["dtype"]))
            attributes = {k: _native(v) for k, v in told["attributes"].items()}
            data = indexing.LazilyIndexedArray(array)
            variables[name] = xr.Variable(told["dims"], data, attributes, {"dtype": array.dtype})
        return variables

    def get_attrs(self) -> dict[str, Any]:
        """Return the attributes of the whole."""
        return {k: _native(v) for k, v in self._line.header(self._timeout)["attributes"].items()}


def _native(value: Any) -> Any:
    if isinstance(value, dict):
        values = np.array(value["values"], np.dtype(value["dtype"]))
        return values if values.ndim else values[()]
    return value


class Values(BackendArray):
    """A variable at an address, read in pieces when it is indexed."""

    def __init__(self, line: Line, timeout: float, name: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        self.line, self.timeout, self.name, self.shape, self.dtype = line, timeout, name, shape, dtype

    def __getitem__(self, key: Any) -> Any:
        """Return what xarray asks for, through integers and slices."""
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.BASIC, self._get)

    def _get(self, key: tuple[int | slice, ...]) -> np.ndarray[Any, Any]:
        spans = [
            range(*one.indices(size)) if isinstance(one, slice) else range(int(one) % size, int(one) % size + 1)
            for one, size in zip(key, self.shape, strict=True)
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
        return result[tuple(slice(None) if isinstance(one, slice) else 0 for one in key)]


def pieces(shape: tuple[int, ...], most: int) -> Iterator[tuple[slice, ...]]:
    """Give slices that together cover an array once, each of at most `most` values; none where it is empty."""
    if 0 in shape:
        return
    lengths, left = [1] * len(shape), most
    for axis in reversed(range(len(shape))):
        lengths[axis] = max(min(shape[axis], left), 1)
        left //= lengths[axis]
    starts = (range(0, size, length) for size, length in zip(shape, lengths, strict=True))
    for corner in itertools.product(*starts):
        yield tuple(slice(k, min(k + length, size)) for k, length, size in zip(corner, lengths, shape, strict=True))
