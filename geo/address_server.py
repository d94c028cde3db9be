"""The other end of `geo.address`: a process that opens one address and hands out its header and its values.

It is another process because what a server answers can crash or hang the C libraries that read it. Questions come on
standard input, answers leave on what was standard output; each is a length (8 bytes), a JSON text, and for values their
bytes. It ends when its input does, even in the middle of a call that hangs.
"""

import contextlib
import faulthandler
import json
import os
import queue
import shutil
import threading
import time
import warnings
from typing import Any

LENGTH = 8  # [bytes] of the number before each text, big-endian
MEMORY = 4 * 2**30  # [bytes] a nonsensical length must not take the machine's memory with it
DISK = 2**30  # [bytes] of a temporary file, for an answer that has no end
COOKIES = "HTTP.COOKIEJAR"  # where the netCDF library keeps cookies; by itself it leaves a file in /tmp
FAREWELL = 0.5  # [s] for closing what is open
GRACE = 30.0  # [s] beyond the time-out of a question, after which this process ends by itself


def main(scratch: str) -> None:
    """Answer questions until the input ends, then remove the folder `scratch`."""
    questions: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(questions, scratch), daemon=True).start()
    answers = os.dup(1)
    os.dup2(2, 1)  # libraries print where nobody reads
    _limit()
    warnings.simplefilter("ignore")
    import netCDF4  # what takes a second is done before the first question's clock runs
    import xarray  # noqa: F401

    with contextlib.suppress(Exception):  # before 1.6.4 there is no such function; the library then writes into /tmp
        if not netCDF4.rc_get(COOKIES):
            netCDF4.rc_set(COOKIES, os.path.join(scratch, "cookies"))
    _write(answers, _framed({}))
    nowhere = open(os.devnull, "w")  # noqa: SIM115 - for as long as the process lives
    held: Any = None
    while True:
        question = questions.get()
        if question["ask"] == "end":
            if held is not None:
                held.close()
            shutil.rmtree(scratch, ignore_errors=True)
            os._exit(0)
        # A C thread that needs no lock of the interpreter's: it ends calls that hang with that lock held.
        faulthandler.dump_traceback_later(question["timeout"] + GRACE, exit=True, file=nowhere)
        values = None
        try:
            if question["ask"] == "open":
                held = _open(question["address"])
                told: dict[str, Any] = header(held)
            else:
                told, values = _values(held, question)
        except BaseException as raised:  # backends raise all kinds; the other end makes one line of them
            error = raised
            while error.__cause__ is not None:  # xarray hides a library's error behind advice of its own
                error = error.__cause__
            told = {"error": " ".join(f"{error}".split())[:500] or type(error).__name__}
        faulthandler.cancel_dump_traceback_later()
        _write(answers, _framed(told))
        if values is not None:
            _write(answers, values)


def _listen(questions: "queue.SimpleQueue[dict[str, Any]]", scratch: str) -> None:
    """Pass questions on; end the process when there can be no more."""
    with contextlib.suppress(Exception):
        while True:
            length = int.from_bytes(_read(0, LENGTH), "big")
            questions.put(json.loads(_read(0, length)))
    questions.put({"ask": "end"})
    time.sleep(FAREWELL)
    shutil.rmtree(scratch, ignore_errors=True)
    os._exit(0)


def _framed(told: dict[str, Any]) -> bytes:
    text = json.dumps(told).encode()
    return len(text).to_bytes(LENGTH, "big") + text


def _read(pipe: int, count: int) -> bytes:
    parts = b""
    while len(parts) < count:
        part = os.read(pipe, count - len(parts))
        if not part:
            raise EOFError
        parts += part
    return parts


def _write(pipe: int, content: Any) -> None:
    left = memoryview(content).cast("B")
    while left:
        left = left[os.write(pipe, left) :]


def _limit() -> None:
    """Bound what the libraries may take, and leave no core dump of their crashes."""
    try:
        import resource
    except ImportError:  # Windows
        return
    for which, most in ((resource.RLIMIT_DATA, MEMORY), (resource.RLIMIT_FSIZE, DISK), (resource.RLIMIT_CORE, 0)):
        with contextlib.suppress(OSError, ValueError):
            _, hard = resource.getrlimit(which)
            resource.setrlimit(which, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _open(address: str) -> Any:
    """Return the dataset at an address, its values as they are stored."""
    import inspect

    import xarray as xr

    plain: dict[str, Any] = {"decode_cf": False, "cache": False}
    if "create_default_indexes" in inspect.signature(xr.open_dataset).parameters:
        plain["create_default_indexes"] = False  # coordinates are read when they are asked for, piece by piece
    return xr.open_dataset(address, **plain)


def header(data: Any) -> dict[str, Any]:
    """Return dimensions, types and attributes of a dataset as JSON knows them."""
    return {
        "attributes": {str(k): _plain(v) for k, v in data.attrs.items()},
        "variables": {
            str(name): {
                "dims": [str(d) for d in variable.dims],
                "shape": [int(n) for n in variable.shape],
                "dtype": variable.dtype.str,
                "attributes": {str(k): _plain(v) for k, v in variable.attrs.items()},
            }
            for name, variable in data.variables.items()
        },
    }


def _plain(value: Any) -> Any:
    """Return an attribute as JSON knows it; numbers keep their type, a fill value's must be exact."""
    import numpy as np

    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biuf":
        array = np.asarray(value)
        return {"dtype": array.dtype.str, "values": array.tolist()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(one) for one in list(value)]
    return value if isinstance(value, str | int | float | bool | None) else str(value)


def _values(held: Any, question: dict[str, Any]) -> tuple[dict[str, Any], Any]:
    """Return what is said of a piece of a variable, and its bytes; texts are said."""
    import numpy as np

    key = tuple(slice(*one) for one in question["key"])
    piece = np.asarray(held.variables[question["name"]][key].values)
    if piece.dtype.kind == "O":
        return {"shape": piece.shape, "texts": [str(text) for text in piece.ravel()]}, None
    piece = np.ascontiguousarray(piece)
    return {"shape": piece.shape, "dtype": piece.dtype.str, "bytes": piece.nbytes}, piece.reshape(-1).view(np.uint8)
