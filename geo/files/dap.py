"""Values by OPeNDAP (DAP 2.0), with a check of every answer's length.

The netCDF library accepts a truncated answer as complete and returns uninitialized memory. So it
only reads headers; this module reads values, one variable at a time, undecoded.

DAP 2.0: J. Gallagher, N. Potter, T. Sgouros, S. Hankin and G. Flierl 2007, The Data Access
Protocol, ESE-RFC-004.1.2. Values are XDR (RFC 4506): big-endian, 16-bit integers in 32 bits, the
length of an array twice before it.
"""

import math
import re
from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from geo.errors import UserError
from geo.files import web

STRUCTURE = 4_000_000  # [bytes] largest description of a dataset
TYPES = {
    "Byte": 1,
    "Int16": "i2",
    "UInt16": "u2",
    "Int32": "i4",
    "UInt32": "u4",
    "Float32": "f4",
    "Float64": "f8",
}
# Structure of an answer: one variable, alone or in a Structure or Grid. The groups are its type and
# its dimensions.
ANSWER = re.compile(
    r"\s*Dataset\s*\{\s*(?:(?:Structure|Grid)\s*\{\s*(?:Array:\s*)?)*(\w+)\s+[^\s\[{};]+((?:\s*\[[^\[\]{};]*\])*)\s*;"
    r"(?:\s*\}\s*[^\s{}]+\s*;)+\s*",
    re.IGNORECASE,
)


def grids(address: str, timeout: float) -> frozenset[str]:
    """Return the names of the variables in a dataset that are DAP Grids.

    Values of a Grid must be requested by the array's name, otherwise its axes are sent as well.
    Raises UserError or web.Passing.
    """
    structure = web.get_address(f"{address}.dds", timeout, STRUCTURE).decode("utf-8", "replace")
    if not structure.lstrip().startswith("Dataset"):
        raise UserError(
            f'"{address}" answers, but not as OPeNDAP does: it may be another kind of server'
        )
    return frozenset(re.findall(r"\bGrid\s*\{[^}]*\}\s*(\w+)\s*;", structure))


def read_variable(
    address: str, name: str, parts: Sequence[slice], dtype: np.dtype[Any], timeout: float
) -> NDArray[Any]:
    """Return part of a numeric variable, undecoded.

    Args:
        address: of the dataset.
        name: of the variable, with the name of its Grid before it.
        parts: one slice with a positive step for each dimension.
        dtype: of the variable.
        timeout: longest wait for the server [s].

    Raises:
        UserError: the server rejects the request.
        web.Passing: the server failed, or the answer is incomplete.
    """
    shape = [len(range(s.start, s.stop, s.step or 1)) for s in parts]
    if 0 in shape:
        return np.empty(shape, dtype)
    constraint = name + "".join(f"[{s.start}:{s.step or 1}:{s.stop - 1}]" for s in parts)
    most = STRUCTURE + max(dtype.itemsize, 4) * math.prod(shape)
    content = web.get_address(f"{address}.dods?{quote(constraint, safe='.,')}", timeout, most)
    return _decode_answer(content, shape, dtype, f"{name} of {address}")


def _decode_answer(
    content: bytes, shape: list[int], dtype: np.dtype[Any], what: str
) -> NDArray[Any]:
    """Return the array in an answer; raise web.Passing if it is not what was requested."""
    structure, mark, values = content.partition(b"\nData:\n")
    if not mark:
        excerpt = " ".join(content[:200].decode("ascii", "replace").split())
        raise web.TemporaryError(f"in place of {what} came: {excerpt or 'nothing'}")
    match = ANSWER.fullmatch(structure.decode("utf-8", "replace"))
    if (
        match is None
        or [int(n) for n in re.findall(r"(\d+)\s*\]", match[2])] != shape
        or TYPES.get(match[1])
        not in (
            dtype.str[1:],
            dtype.itemsize,
        )
    ):
        excerpt = " ".join(structure[-200:].decode("ascii", "replace").split())
        raise web.TemporaryError(f"in place of {what} came other values: {excerpt}")
    count, start = math.prod(shape), 8 if shape else 0  # a scalar has no length before it
    size = start + (-(-count // 4) * 4 if dtype.itemsize == 1 else count * max(dtype.itemsize, 4))
    if len(values) != size or not (np.frombuffer(values[:start], ">u4") == count).all():
        raise web.TemporaryError(f"{what} came with {len(values):,} bytes in place of {size:,}")
    wire = dtype.newbyteorder(">") if dtype.itemsize != 2 else np.dtype(f">{dtype.kind}4")
    return np.frombuffer(values, wire, count, start).astype(dtype).reshape(shape)
