"""The other end of `geo.files.address`: a process that serves the header and the values of one address.

It is another process because the answers of a server can crash or hang the C libraries that read them (see
`geo.files.child`).
"""

import contextlib
import faulthandler
import os
import shutil
import warnings
from functools import partial
from typing import Any

from geo.files.child import limit, listen, send

MEMORY = 4 * 2**30  # [bytes] of memory at most, so that a nonsensical length does not exhaust the machine's
DISK = 2**30  # [bytes] of a temporary file at most, because an answer may have no end
COOKIES = "HTTP.COOKIEJAR"  # where the netCDF library keeps cookies; by default it leaves a file in /tmp
NETRC = "HTTP.NETRC"  # the file of names and passwords, which the library leaves alone unless it is told of it
GRACE = 30.0  # [s] after the time-out of a question this process ends by itself


def main(scratch: str) -> None:
    """Answer questions until the input ends, then remove the folder `scratch`."""
    questions, answers = listen(partial(shutil.rmtree, scratch, ignore_errors=True))
    limit(RLIMIT_DATA=MEMORY, RLIMIT_FSIZE=DISK)
    warnings.simplefilter("ignore")
    import netCDF4  # imported before the clock of the first question runs, because it takes a second
    import xarray  # noqa: F401

    with contextlib.suppress(Exception):  # netCDF4 before 1.6.4 has no such function and writes into /tmp
        if not netCDF4.rc_get(COOKIES):
            netCDF4.rc_set(COOKIES, os.path.join(scratch, "cookies"))
        own = os.path.expanduser("~/.netrc")
        if os.path.isfile(own) and not netCDF4.rc_get(NETRC):
            netCDF4.rc_set(NETRC, own)
    send(answers, {})
    nowhere = open(os.devnull, "w")  # noqa: SIM115 - it stays open as long as the process lives
    dataset: Any = None
    for question, _ in questions:
        # This timer is a C thread that needs no interpreter lock, so it ends calls that hang while they hold it.
        faulthandler.dump_traceback_later(question["timeout"] + GRACE, exit=True, file=nowhere)
        values: Any = b""
        try:
            if question["ask"] == "open":
                dataset = _open(question["address"])
                reply: dict[str, Any] = header(dataset)
            else:
                reply, values = _values(dataset, question)
        except BaseException as raised:  # backends raise errors of all kinds; the other end makes one line of each
            error = raised
            while error.__cause__ is not None:  # xarray hides the error of a library behind its own advice
                error = error.__cause__
            reply = {"error": " ".join(f"{error}".split())[:500] or type(error).__name__}
        faulthandler.cancel_dump_traceback_later()
        send(answers, reply, values)
    if dataset is not None:
        dataset.close()
    shutil.rmtree(scratch, ignore_errors=True)
    os._exit(0)


def _open(address: str) -> Any:
    """Return the dataset at an address, its values as they are stored."""
    import inspect

    import xarray as xr

    options: dict[str, Any] = {"decode_cf": False, "cache": False}
    if "create_default_indexes" in inspect.signature(xr.open_dataset).parameters:
        options["create_default_indexes"] = False  # so that coordinates are only read when asked for, piece by piece
    return xr.open_dataset(address, **options)


def header(data: Any) -> dict[str, Any]:
    """Return dimensions, types and attributes of a dataset in values that JSON can write."""
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
    """Return an attribute as JSON can write it.

    Numbers keep their type, because fill values must be exact.
    """
    import numpy as np

    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biuf":
        array = np.asarray(value)
        return {"dtype": array.dtype.str, "values": array.tolist()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(item) for item in list(value)]
    return value if isinstance(value, str | int | float | bool | None) else str(value)


def _values(dataset: Any, question: dict[str, Any]) -> tuple[dict[str, Any], Any]:
    """Return shape and type of a piece of a variable, and its bytes; texts stand in the first of the two."""
    import numpy as np

    key = tuple(slice(*bounds) for bounds in question["key"])
    piece = np.asarray(dataset.variables[question["name"]][key].values)
    if piece.dtype.kind == "O":
        return {"shape": piece.shape, "texts": [str(text) for text in piece.ravel()]}, b""
    piece = np.ascontiguousarray(piece)
    return {"shape": piece.shape, "dtype": piece.dtype.str}, piece.reshape(-1).view(np.uint8)
