"""ECMWF's eccodes in a process of its own: messages in, keys, points and values out.

On damaged bytes the library may write past its memory, call abort or never return: of 150 damaged files 7 ended the
process. Here that ends another process (see `geo.files.child`), and the file is refused in one line. It starts with the first
message, serves all files, and never touches one.
"""

import os
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo import waiting
from geo.files.child import Child, limit, listen, send

LIMIT = 60.0  # [s] for one answer; a field of a million points takes 0.1
MOST = 100_000_000  # points of a field; more is damage
MISSING = -1.0e100  # no value of any field
MEMORY = 8 * 2**30  # [bytes] that the process may take
START = "from geo.files import decoder; decoder.serve()"

NAMES = ("shortName", "name", "units")  # dear: each is looked up among thousands of definitions
KEYS = (
    "stepType", "dataType", "gridType", "resolutionAndComponentFlags", "typeOfLevel", "level:d", "typeOfFirstFixedSurface:i", "scaleFactorOfFirstFixedSurface:i",
    "scaledValueOfFirstFixedSurface:i", "discipline", "parameterCategory", "parameterNumber", "table2Version",
    "indicatorOfParameter", "validityDate", "validityTime", "dataDate", "dataTime", "number", "perturbationNumber",
    "derivedForecast",
)  # fmt: skip
GRID_KEYS = (
    "gridType", "Ni", "Nj", "Nx", "Ny", "iScansNegatively", "jScansPositively", "jPointsAreConsecutive",
    "alternativeRowScanning", "earthIsOblate", "radius:d", "earthMajorAxisInMetres:d", "earthMinorAxisInMetres:d",
    "LoVInDegrees:d", "LaDInDegrees:d", "Latin1InDegrees:d", "Latin2InDegrees:d", "orientationOfTheGridInDegrees:d",
    "projectionCentreFlag", "latitudeOfSouthernPoleInDegrees:d", "longitudeOfSouthernPoleInDegrees:d",
    "angleOfRotationInDegrees:d",
)  # fmt: skip

Array = NDArray[np.float64]


class DecodeError(Exception):
    """What a message did to the library, in a few words."""


def keys(message: bytes) -> dict[str, Any]:
    """Return the keys of a message (its header is enough) that say what it holds; those it lacks are absent."""
    return _ask("keys", message)[0]


def names(message: bytes) -> dict[str, Any]:
    """Return how the field of a message is called, and its units: "unknown" where nobody has named it."""
    return _ask("names", message)[0]


def points(message: bytes) -> tuple[dict[str, Any], Array, Array]:
    """Return the keys of a message's grid, and latitudes and longitudes [deg] in the order of its values.

    A reduced grid's keys have "pl", the number of points of every row.
    """
    told, data = _ask("points", message)
    both = np.frombuffer(data, np.float64)
    return told, both[: both.size // 2], both[both.size // 2 :]


def values(message: bytes) -> Array:
    """Return the values of a message in its order, NaN where missing."""
    return np.frombuffer(_ask("values", message)[1], np.float64)


_lock = threading.Lock()
_child: Child | None = None


def _ask(what: str, message: bytes) -> tuple[dict[str, Any], memoryview]:
    """Return what the process tells of a message."""
    with waiting.turn(_lock):
        try:
            told, data = _answered(what, message)
        except BaseException:  # Ctrl-C too: an answer that is still under way must not meet the next question
            _end()
            raise
    if "error" in told:
        raise DecodeError(str(told["error"]))
    return told, data


def _answered(what: str, message: bytes) -> tuple[dict[str, Any], memoryview]:
    child = _running()
    try:
        return child.ask({"ask": what}, LIMIT, message)
    except TimeoutError:
        raise DecodeError(f"the GRIB library did not answer within {LIMIT:g} s") from None
    except EOFError:
        raise DecodeError(f"the GRIB library {child.fate()}") from None


def _running() -> Child:
    global _child
    if _child is None or not _child.running():
        _end()
        try:
            _child = Child(START, most=2 * MOST * 8)
        except OSError as error:
            raise DecodeError(f"cannot start a process for the GRIB library ({error.strerror})") from None
    return _child


def _end() -> None:
    global _child
    child, _child = _child, None
    if child is not None:
        child.end()


def serve() -> None:
    """Answer questions until the input ends: what the process runs."""
    questions, answers = listen()
    limit(RLIMIT_AS=MEMORY)
    for question, message in questions:
        data: Any = b""
        try:
            told, data = _answer(question["ask"], bytes(message))
        except MemoryError:
            told = {"error": "it asks for more memory than a field can take"}
        except ImportError as error:
            told = {"error": f"GRIB needs ECMWF's eccodes ({error}): pip install eccodes"}
        except Exception as error:  # eccodes raises a class for each of its hundred codes
            told = {"error": " ".join(str(error).split())[:120] or type(error).__name__}
        send(answers, told, data)
    os._exit(0)


def _answer(what: str, message: bytes) -> tuple[dict[str, Any], bytes]:
    import eccodes

    handle = eccodes.codes_new_from_message(message)
    try:
        if what == "keys":
            return _held(eccodes, handle, KEYS), b""
        if what == "names":
            return _held(eccodes, handle, NAMES), b""
        told = _held(eccodes, handle, GRID_KEYS)
        count = int(eccodes.codes_get(handle, "numberOfDataPoints"))
        if not 0 < count <= MOST:
            raise ValueError(f"a field of {count} points")
        if what == "points":
            if eccodes.codes_is_defined(handle, "pl") and str(told.get("gridType", "")).startswith("reduced"):
                told["pl"] = [int(n) for n in eccodes.codes_get_array(handle, "pl")]
            pair = [eccodes.codes_get_array(handle, name) for name in ("latitudes", "longitudes")]
            return told, b"".join(np.asarray(p, np.float64).tobytes() for p in pair)
        eccodes.codes_set(handle, "missingValue", MISSING)
        data = np.asarray(eccodes.codes_get_values(handle), np.float64)
        return {}, np.where(data == MISSING, np.nan, data).tobytes()
    finally:
        eccodes.codes_release(handle)


def _held(eccodes: Any, handle: Any, names: tuple[str, ...]) -> dict[str, Any]:
    told = {}
    for name in names:
        bare, _, kind = name.partition(":")
        try:
            told[bare] = eccodes.codes_get(handle, bare, {"d": float, "i": int, "": None}[kind])
        except eccodes.CodesInternalError:
            continue
    return told
