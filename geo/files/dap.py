"""Values by OPeNDAP (DAP 2.0), each answer counted to the byte.

The netCDF library takes an answer that was cut short for whole, and gives whatever was in memory;
so it reads headers, and this reads values, one variable at a time, as they are stored.

DAP 2.0: J. Gallagher, N. Potter, T. Sgouros, S. Hankin and G. Flierl 2007, The Data Access
Protocol, ESE-RFC-004.1.2; values are XDR (RFC 4506): big-endian, 16-bit integers in 32 bits, an
array's length twice before it.
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

STRUCTURE = 4_000_000  # [bytes] that the description of a dataset may have
TYPES = {
    "Byte": 1,
    "Int16": "i2",
    "UInt16": "u2",
    "Int32": "i4",
    "UInt32": "u4",
    "Float32": "f4",
    "Float64": "f8",
}
# The structure of an answer: one variable, alone or in a Structure or Grid. Types and dimensions
# are taken out.
ANSWER = re.compile(
    r"\s*Dataset\s*\{\s*(?:(?:Structure|Grid)\s*\{\s*(?:Array:\s*)?)*(\w+)\s+[^\s\[{};]+((?:\s*\[[^\[\]{};]*\])*)\s*;"
    r"(?:\s*\}\s*[^\s{}]+\s*;)+\s*",
    re.IGNORECASE,
)


def grids(address: str, timeout: float) -> frozenset[str]:
    """Return the names of the DAP Grids of a dataset: of these a part must be asked for, else axes
    come with it.

    Raises UserError or web.Passing.
    """
    structure = web.get(f"{address}.dds", timeout, STRUCTURE).decode("utf-8", "replace")
    if not structure.lstrip().startswith("Dataset"):
        raise UserError(
            f'"{address}" answers, but not as OPeNDAP does: it may be another kind of server'
        )
    return frozenset(re.findall(r"\bGrid\s*\{[^}]*\}\s*(\w+)\s*;", structure))


def read_variable(
    address: str, name: str, parts: Sequence[slice], dtype: np.dtype[Any], timeout: float
) -> NDArray[Any]:
    """Return a part of a variable of numbers, as it is stored.

    name: with that of its Grid before it; parts: a slice with a positive step for each dimension.
    Raises UserError, or web.Passing where the answer is not whole.
    """
    shape = [len(range(s.start, s.stop, s.step or 1)) for s in parts]
    if 0 in shape:
        return np.empty(shape, dtype)
    asked = name + "".join(f"[{s.start}:{s.step or 1}:{s.stop - 1}]" for s in parts)
    most = STRUCTURE + max(dtype.itemsize, 4) * math.prod(shape)
    content = web.get(f"{address}.dods?{quote(asked, safe='.,')}", timeout, most)
    return _decoded(content, shape, dtype, f"{name} of {address}")


def _decoded(content: bytes, shape: list[int], dtype: np.dtype[Any], what: str) -> NDArray[Any]:
    """Return the one array of an answer."""
    structure, mark, values = content.partition(b"\nData:\n")
    if not mark:
        said = " ".join(content[:200].decode("ascii", "replace").split())
        raise web.Passing(f"in place of {what} came: {said or 'nothing'}")
    told = ANSWER.fullmatch(structure.decode("utf-8", "replace"))
    if (
        told is None
        or [int(n) for n in re.findall(r"(\d+)\s*\]", told[2])] != shape
        or TYPES.get(told[1])
        not in (
            dtype.str[1:],
            dtype.itemsize,
        )
    ):
        said = " ".join(structure[-200:].decode("ascii", "replace").split())
        raise web.Passing(f"in place of {what} came other values: {said}")
    count, start = math.prod(shape), 8 if shape else 0  # one number has no length before it
    size = start + (-(-count // 4) * 4 if dtype.itemsize == 1 else count * max(dtype.itemsize, 4))
    if len(values) != size or not (np.frombuffer(values[:start], ">u4") == count).all():
        raise web.Passing(f"{what} came with {len(values):,} bytes in place of {size:,}")
    wire = dtype.newbyteorder(">") if dtype.itemsize != 2 else np.dtype(f">{dtype.kind}4")
    return np.frombuffer(values, wire, count, start).astype(dtype).reshape(shape)
