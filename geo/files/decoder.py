"""ECMWF's eccodes in a separate process: it takes messages, returns keys, points and values.

On damaged bytes the library may write past its memory, call abort or never return: 7 of 150 damaged
files ended the process. Here this ends a child process (see `geo.files.child`), and the file is
rejected with one message. The child starts with the first message, serves all files, and never
opens a file itself.
"""

import os
import threading
from typing import Any

import numpy as np

from geo import waiting
from geo.array import Real
from geo.files.child import Child, limit, listen, send

LIMIT = 60.0  # [s] for one answer; a field of a million points takes 0.1 s
MOST = 100_000_000  # largest number of points of a field; a message with more is damaged
MISSING = -1.0e100  # marks missing values; no field has this value
MEMORY = 8 * 2**30  # [bytes] memory limit of the process
START = "from geo.files import decoder; decoder.serve()"

NAMES = ("shortName", "name", "units")  # slow: each is looked up among thousands of definitions
KEYS = (
    "stepType",
    "dataType",
    "gridType",
    "resolutionAndComponentFlags",
    "typeOfLevel",
    "level:d",
    "typeOfFirstFixedSurface:i",
    "scaleFactorOfFirstFixedSurface:i",
    "scaledValueOfFirstFixedSurface:i",
    "discipline",
    "parameterCategory",
    "parameterNumber",
    "table2Version",
    "indicatorOfParameter",
    "validityDate",
    "validityTime",
    "dataDate",
    "dataTime",
    "number",
    "perturbationNumber",
    "derivedForecast",
    "startStep:i",
    "endStep:i",
    "stepUnits:i",
)
GRID_KEYS = (
    "gridType",
    "Ni",
    "Nj",
    "Nx",
    "Ny",
    "iScansNegatively",
    "jScansPositively",
    "jPointsAreConsecutive",
    "alternativeRowScanning",
    "earthIsOblate",
    "radius:d",
    "earthMajorAxisInMetres:d",
    "earthMinorAxisInMetres:d",
    "LoVInDegrees:d",
    "LaDInDegrees:d",
    "Latin1InDegrees:d",
    "Latin2InDegrees:d",
    "orientationOfTheGridInDegrees:d",
    "projectionCentreFlag",
    "latitudeOfSouthernPoleInDegrees:d",
    "longitudeOfSouthernPoleInDegrees:d",
    "angleOfRotationInDegrees:d",
)


class DecodeError(Exception):
    """A message that the library cannot decode; the text gives a short reason."""


def keys(message: bytes) -> dict[str, Any]:
    """Return the keys that describe a message, without absent ones; a header is sufficient."""
    return _ask("keys", message)[0]


def names(message: bytes) -> dict[str, Any]:
    """Return names and units of a message's field, "unknown" if eccodes has none."""
    return _ask("names", message)[0]


def points(message: bytes) -> tuple[dict[str, Any], Real, Real]:
    """Return the keys of a message's grid, and latitudes and longitudes [deg].

    The points are in the order of the message's values. For a reduced grid the keys include "pl",
    the number of points in every row.
    """
    grid_keys, data = _ask("points", message)
    coordinates = np.frombuffer(data, np.float64)
    return grid_keys, coordinates[: coordinates.size // 2], coordinates[coordinates.size // 2 :]


def values(message: bytes) -> Real:
    """Return the values of a message in its own order, NaN for missing."""
    return np.frombuffer(_ask("values", message)[1], np.float64)


_lock = threading.Lock()
_child: Child | None = None


def _ask(what: str, message: bytes) -> tuple[dict[str, Any], memoryview]:
    """Return the process' answer about a message, and the bytes that go with it."""
    with waiting.hold_lock(_lock):
        try:
            reply, data = _ask_child(what, message)
        except BaseException:
            # also after Ctrl-C: a pending answer must not be taken for the next request's
            _end()
            raise
    if "error" in reply:
        raise DecodeError(str(reply["error"]))
    return reply, data


def _ask_child(what: str, message: bytes) -> tuple[dict[str, Any], memoryview]:
    """Send a request to the process; raise DecodeError if it does not answer."""
    child = _running()
    try:
        return child.ask({"ask": what}, LIMIT, message)
    except TimeoutError:
        raise DecodeError(f"the GRIB library did not answer within {LIMIT:g} s") from None
    except EOFError:
        raise DecodeError(f"the GRIB library {child.fate()}") from None


def _running() -> Child:
    """Return the process; start it if it is not running."""
    global _child
    if _child is None or not _child.running():
        _end()
        try:
            _child = Child(START, most=2 * MOST * 8)
        except OSError as error:
            raise DecodeError(
                f"cannot start a process for the GRIB library ({error.strerror})"
            ) from None
    return _child


def _end() -> None:
    global _child
    child, _child = _child, None
    if child is not None:
        child.end()


def serve() -> None:
    """Answer requests until the input ends; the main function of the process."""
    questions, answers = listen()
    limit(RLIMIT_AS=MEMORY)
    for question, message in questions:
        data: Any = b""
        try:
            reply, data = _answer(question["ask"], bytes(message))
        except MemoryError:
            reply = {"error": "it asks for more memory than a field can take"}
        except ImportError as error:
            reply = {"error": f"GRIB needs ECMWF's eccodes ({error}): pip install eccodes"}
        except Exception as error:  # eccodes has about a hundred exception classes
            reply = {"error": " ".join(str(error).split())[:120] or type(error).__name__}
        send(answers, reply, data)
    os._exit(0)


def _answer(what: str, message: bytes) -> tuple[dict[str, Any], bytes]:
    """Return, in the process, what eccodes reads from a message."""
    import eccodes

    handle = eccodes.codes_new_from_message(message)
    try:
        if what == "keys":
            return _present_keys(eccodes, handle, KEYS), b""
        if what == "names":
            return _present_keys(eccodes, handle, NAMES), b""
        grid_keys = _present_keys(eccodes, handle, GRID_KEYS)
        count = int(eccodes.codes_get(handle, "numberOfDataPoints"))
        if not 0 < count <= MOST:
            raise ValueError(f"a field of {count} points")
        if what == "points":
            if eccodes.codes_is_defined(handle, "pl") and str(
                grid_keys.get("gridType", "")
            ).startswith("reduced"):
                grid_keys["pl"] = [int(n) for n in eccodes.codes_get_array(handle, "pl")]
            pair = [eccodes.codes_get_array(handle, name) for name in ("latitudes", "longitudes")]
            return grid_keys, b"".join(np.asarray(p, np.float64).tobytes() for p in pair)
        eccodes.codes_set(handle, "missingValue", MISSING)
        data = np.asarray(eccodes.codes_get_values(handle), np.float64)
        return {}, np.where(data == MISSING, np.nan, data).tobytes()
    finally:
        eccodes.codes_release(handle)


def _present_keys(eccodes: Any, handle: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """Return the keys that a message has.

    A name ends in :d or :i if the key is to be read as float or integer.
    """
    present = {}
    for name in names:
        bare, _, kind = name.partition(":")
        try:
            present[bare] = eccodes.codes_get(handle, bare, {"d": float, "i": int, "": None}[kind])
        except eccodes.CodesInternalError:
            continue
    return present
