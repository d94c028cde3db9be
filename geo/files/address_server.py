"""Server side of `geo.files.address`: a process that sends header and values of one address.

It is a separate process because a server's answers can crash or hang the C libraries that read them
(see `geo.files.child`). `geo.files.dap` reads values, because it checks their number of bytes; the
netCDF library reads everything else.
"""

import contextlib
import faulthandler
import os
import re
import shutil
import time
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

from geo.errors import UserError
from geo.files import dap, web, zarr_store
from geo.files.child import limit, listen, send

# [bytes] limit of memory, so that a nonsensical length does not exhaust the machine's memory
MEMORY = 4 * 2**30
DISK = 2**30  # [bytes] limit of a temporary file, because an answer may be endless
# setting for the netCDF library's file of cookies; by default the library leaves one in /tmp
COOKIES = "HTTP.COOKIEJAR"
# setting for the file of names and passwords, which the library does not read by default
NETRC = "HTTP.NETRC"
GRACE = 30.0  # [s] after the time-out of a request at which this process ends itself


def main(scratch: str) -> None:
    """Answer requests until the input ends, then remove the folder `scratch`."""
    questions, answers = listen(partial(shutil.rmtree, scratch, ignore_errors=True))
    limit(RLIMIT_DATA=MEMORY, RLIMIT_FSIZE=DISK)
    warnings.simplefilter("ignore")
    # imported before the first request's time-out starts, because it takes a second
    import netCDF4
    import xarray  # noqa: F401

    # netCDF4 before 1.6.4 has no such function and writes into /tmp
    with contextlib.suppress(Exception):
        if not netCDF4.rc_get(COOKIES):
            netCDF4.rc_set(COOKIES, os.path.join(scratch, "cookies"))
        own = os.path.expanduser("~/.netrc")
        if os.path.isfile(own) and not netCDF4.rc_get(NETRC):
            netCDF4.rc_set(NETRC, own)
    send(answers, {})
    nowhere = open(os.devnull, "w")  # noqa: SIM115 - it stays open as long as the process lives
    dataset: Dataset | None = None
    for question, _ in questions:
        # This timer is a C thread that needs no interpreter lock, so it ends calls that hang while
        # they hold it.
        faulthandler.dump_traceback_later(question["timeout"] + GRACE, exit=True, file=nowhere)
        values: Any = b""
        try:
            if question["ask"] == "open":
                dataset = Dataset(question["address"])
                reply: dict[str, Any] = header(dataset.data)
            else:
                assert dataset is not None
                reply, values = dataset.values(question)
        except BaseException as raised:
            # backends raise errors of all kinds; the client makes one line of each
            error = raised
            # xarray hides the error of a library behind its own advice
            while error.__cause__ is not None:
                error = error.__cause__
            reply = {"error": " ".join(f"{error}".split())[:500] or type(error).__name__}
        faulthandler.cancel_dump_traceback_later()
        send(answers, reply, values)
    if dataset is not None:
        dataset.data.close()
    shutil.rmtree(scratch, ignore_errors=True)
    os._exit(0)


class Dataset:
    """The dataset at an address.

    The netCDF library reads its header and texts, `geo.files.dap` its numbers.
    """

    def __init__(self, address: str) -> None:
        self.data = _open(address)
        self._address = address.replace("dods://", "http://", 1)
        # Only the library can interpret an address with a constraint (?) or library switches (#).
        self._counted = self._address.startswith("http") and not re.search(r"[?#]", address)
        self._grids: frozenset[str] | None = None

    def values(self, question: dict[str, Any]) -> tuple[dict[str, Any], Any]:
        """Return shape and type of part of a variable as a document, and its bytes.

        Texts are in the document.
        """
        import numpy as np

        name, key = question["name"], tuple(slice(*bounds) for bounds in question["key"])
        variable = self.data.variables[name]
        if self._speaks_dap(question["timeout"]) and variable.dtype.kind in "biuf":
            full_name = f"{name}.{name}" if name in (self._grids or ()) else name
            piece = _retry(
                lambda: dap.read_variable(
                    self._address, full_name, key, variable.dtype, question["timeout"]
                ),
                question["timeout"],
            )
        else:
            piece = np.asarray(variable[key].values)
        if piece.dtype.kind == "O":
            return {"shape": piece.shape, "texts": [str(text) for text in piece.ravel()]}, b""
        piece = np.ascontiguousarray(piece)
        return {"shape": piece.shape, "dtype": piece.dtype.str}, piece.reshape(-1).view(np.uint8)

    def _speaks_dap(self, timeout: float) -> bool:
        if self._counted and self._grids is None:
            try:
                self._grids = dap.grids(self._address, timeout)
            except UserError:  # another kind of server, like one of Zarr
                self._counted = False
        return self._counted


def _retry(ask: Callable[[], Any], timeout: float) -> Any:
    """Return an answer, repeating the request after temporary failures.

    It gives up after half the time that the client waits.
    """
    until, pause = time.monotonic() + timeout / 2, 0.5
    while True:
        try:
            return ask()
        except web.TemporaryError:
            if time.monotonic() + pause > until:
                raise
            time.sleep(pause)
            pause *= 2


def _open(address: str) -> Any:
    """Return the dataset at an address with undecoded values."""
    import inspect

    import xarray as xr

    options: dict[str, Any] = {"decode_cf": False, "cache": False}
    if "create_default_indexes" in inspect.signature(xr.open_dataset).parameters:
        # so that coordinates are read only on request, piece by piece
        options["create_default_indexes"] = False
    with zarr_store.without_pickles():  # xarray takes some addresses for Zarr stores
        return xr.open_dataset(address, **options)


def header(data: Any) -> dict[str, Any]:
    """Return dimensions, types and attributes of a dataset as values for JSON."""
    return {
        "attributes": {str(k): _to_json(v) for k, v in data.attrs.items()},
        "variables": {
            str(name): {
                "dims": [str(d) for d in variable.dims],
                "shape": [int(n) for n in variable.shape],
                "dtype": variable.dtype.str,
                "attributes": {str(k): _to_json(v) for k, v in variable.attrs.items()},
            }
            for name, variable in data.variables.items()
        },
    }


def _to_json(value: Any) -> Any:
    """Return an attribute as a value for JSON.

    Numbers keep their type, because fill values must be exact.
    """
    import numpy as np

    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biuf":
        array = np.asarray(value)
        return {"dtype": array.dtype.str, "values": array.tolist()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_to_json(item) for item in list(value)]
    return value if isinstance(value, str | int | float | bool | None) else str(value)
