"""ECMWF's eccodes in a process of its own: messages in, keys, points and values out.

On damaged bytes the library may write past its memory, call abort or never return: of 150 damaged files 7 ended the
process. Here that ends a helper process, and the file is refused in one line. The helper starts with the first message,
serves all files, is told to end by the end of its input, and never touches a file.
"""

import atexit
import json
import os
import struct
import subprocess
import sys
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

LIMIT = 60.0  # [s] for one answer; a field of a million points takes 0.1
MOST = 100_000_000  # points of a field; more is damage
MISSING = -1.0e100  # no value of any field
MEMORY = 8 * 2**30  # [bytes] that the helper may take

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


# --- this side: one helper for the whole process ------------------------------------------------------------------

_lock = threading.Lock()
_helper: "tuple[int, subprocess.Popen[bytes]] | None" = None  # (process that started it, helper)


def _ask(what: str, message: bytes) -> tuple[dict[str, Any], bytes]:
    with _lock:
        helper = _running()
        stuck = threading.Event()

        def give_up() -> None:
            stuck.set()
            helper.kill()

        clock = threading.Timer(LIMIT, give_up)
        clock.daemon = True
        clock.start()
        try:
            assert helper.stdin is not None
            assert helper.stdout is not None
            helper.stdin.write(struct.pack("<8sQ", what.encode(), len(message)) + message)
            helper.stdin.flush()
            head = _exactly(helper.stdout, 16)
            told, size = struct.unpack("<QQ", head)
            answer = json.loads(_exactly(helper.stdout, told))
            data = _exactly(helper.stdout, size)
        except (OSError, EOFError, ValueError) as error:
            _end()
            code = helper.returncode or 0
            raise DecodeError(
                f"the GRIB library did not answer within {LIMIT:g} s"
                if stuck.is_set()
                else f"the GRIB library crashed on it ({'signal' if code < 0 else 'status'} {abs(code)})"
            ) from error
        except BaseException:  # Ctrl-C in the middle of an answer: the rest of it must not meet the next question
            _end()
            raise
        finally:
            clock.cancel()
    if "error" in answer:
        raise DecodeError(str(answer["error"]))
    return answer, data


def _exactly(stream: Any, size: int) -> bytes:
    data = stream.read(size)
    if len(data) < size:
        raise EOFError
    return bytes(data)


def _running() -> "subprocess.Popen[bytes]":
    global _helper
    if _helper is not None and (_helper[0] != os.getpid() or _helper[1].poll() is not None):
        _end()
    if _helper is None:
        code = f"import sys; sys.path[:] = {sys.path!r}; from geo import decoder; decoder.serve()"
        process = subprocess.Popen(
            [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        _helper = os.getpid(), process
        atexit.register(_end)
    return _helper[1]


def _end() -> None:
    """End the helper, if it is ours and not a parent's that this process was forked from."""
    global _helper
    if _helper is None:
        return
    owner, process = _helper
    _helper = None
    for stream in (process.stdin, process.stdout):
        try:
            if stream is not None:
                stream.close()
        except OSError:
            pass
    if owner == os.getpid():
        process.kill()
        process.wait()


# --- the other side -----------------------------------------------------------------------------------------------


def serve() -> None:
    """Answer questions from standard input until it ends: what the helper process runs."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that asks; it closes our input
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever the library prints is no answer
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, resource.RLIM_INFINITY))
    except (ImportError, ValueError, OSError):  # not on this system
        pass
    questions = os.fdopen(0, "rb")
    while len(head := questions.read(16)) == 16:
        what, size = struct.unpack("<8sQ", head)
        message = questions.read(size)
        try:
            told, data = _answer(what.rstrip(b"\0").decode(), message)
        except MemoryError:
            told, data = {"error": "it asks for more memory than a field can take"}, b""
        except ImportError as error:
            told, data = {"error": f"GRIB needs ECMWF's eccodes ({error}): pip install eccodes"}, b""
        except Exception as error:  # eccodes raises a class for each of its hundred codes
            told, data = {"error": " ".join(str(error).split())[:120] or type(error).__name__}, b""
        text = json.dumps(told).encode()
        answers.write(struct.pack("<QQ", len(text), len(data)) + text)
        answers.write(data)
        answers.flush()


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
