"""The other end of `geo.files.address`: a process that opens one address and hands out its header and its values.

It is another process because what a server answers can crash or hang the C libraries that read it (see `geo.files.child`).
"""

import contextlib
import faulthandler
import os
import shutil
import warnings
from functools import partial
from typing import Any

from geo.files.child import limit, listen, send

MEMORY = 4 * 2**30  # [bytes] a nonsensical length must not take the machine's memory with it
DISK = 2**30  # [bytes] of a temporary file, for an answer that has no end
COOKIES = "HTTP.COOKIEJAR"  # where the netCDF library keeps cookies; by itself it leaves a file in /tmp
GRACE = 30.0  # [s] beyond the time-out of a question, after which this process ends by itself


def main(scratch: str) -> None:
    """Answer questions until the input ends, then remove the folder `scratch`."""
    questions, answers = listen(partial(shutil.rmtree, scratch, ignore_errors=True))
    limit(RLIMIT_DATA=MEMORY, RLIMIT_FSIZE=DISK)
    warnings.simplefilter("ignore")
    import netCDF4  # what takes a second is done before the first question's clock runs
    import xarray  # noqa: F401

    with contextlib.suppress(Exception):  # before 1.6.4 there is no such function; the library then writes into /tmp
        if not netCDF4.rc_get(COOKIES):
            netCDF4.rc_set(COOKIES, os.path.join(scratch, "cookies"))
    send(answers, {})
    nowhere = open(os.devnull, "w")  # noqa: SIM115 - for as long as the process lives
    held: Any = None
    for question, _ in questions:
        # A C thread that needs no lock of the interpreter's: it ends calls that hang with that lock held.
        faulthandler.dump_traceback_later(question["timeout"] + GRACE, exit=True, file=nowhere)
        values: Any = b""
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
        send(answers, told, values)
    if held is not None:
        held.close()
    shutil.rmtree(scratch, ignore_errors=True)
    os._exit(0)


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
        return {"shape": piece.shape, "texts": [str(text) for text in piece.ravel()]}, b""
    piece = np.ascontiguousarray(piece)
    return {"shape": piece.shape, "dtype": piece.dtype.str}, piece.reshape(-1).view(np.uint8)
