"""Answers of DAP 2.0 that are written out by hand, byte for byte (RFC 4506): what is read, and what
is not taken for an answer.
"""

import struct

import numpy as np
import pytest

from geo.files import dap, web

HELD = {  # name in DAP, how one value goes over the wire
    "Byte": (np.uint8, "B"),
    "Int16": (np.int16, ">i"),
    "UInt16": (np.uint16, ">I"),
    "Int32": (np.int32, ">i"),
    "Float32": (np.float32, ">f"),
    "Float64": (np.float64, ">d"),
}


def answer(
    kind: str, sizes: dict[str, int], values: list[float], count: int | None = None
) -> bytes:
    """Return an answer; count: how long the array is said to be, by default as long as it is."""
    shape = "".join(f"[{name} = {size}]" for name, size in sizes.items())
    body = b"".join(struct.pack(HELD[kind][1], value) for value in values)
    body += b"\0" * (-len(body) % 4)
    length = struct.pack(">II", *[len(values) if count is None else count] * 2) if sizes else b""
    return f"Dataset {{\n    {kind} u{shape};\n}} sea;\n\nData:\n".encode() + length + body


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch):
    """Return a function that reads an answer as one of a shape."""

    def read(content: bytes, shape: tuple[int, ...], dtype: type) -> np.ndarray:
        monkeypatch.setattr(web, "get_address", lambda address, timeout, most: content)
        return dap.read_variable(
            "http://x/sea", "u", [slice(0, size) for size in shape], np.dtype(dtype), 1.0
        )

    return read


@pytest.mark.parametrize("kind", HELD)
@pytest.mark.parametrize("many", [1, 3, 4, 6])
def test_values_of_every_type(served, kind: str, many: int) -> None:
    dtype = HELD[kind][0]
    values = [
        7 + 13 * k if kind.startswith(("B", "U")) else (-1) ** k * (7 + 13 * k) for k in range(many)
    ]
    got = served(answer(kind, {"t": 1, "x": many}, values), (1, many), dtype)
    assert got.dtype == dtype
    assert got.tolist() == [values]


def test_one_number_has_no_length_before_it(served) -> None:
    assert served(answer("Int16", {}, [-5]), (), np.int16) == -5


@pytest.mark.parametrize(
    "content",
    [
        answer("Float32", {"t": 2, "x": 3}, [1.5] * 6, count=5),
        answer("Float32", {"t": 3, "x": 2}, [1.5] * 6),
        answer("Float32", {"t": 6}, [1.5] * 6),
        answer("Int32", {"t": 2, "x": 3}, [1] * 6),
        answer("Float32", {"t": 2, "x": 3}, [1.5] * 5),
        answer("Float32", {"t": 2, "x": 3}, [1.5] * 6) + b"\0\0\0\0",
        b"Error {\n    code = 5;\n    message = \"no\";\n};\n",
    ],
    ids=["another length", "turned", "flat", "another type", "short", "long", "an error"],
)  # fmt: skip
def test_another_answer_is_none(served, content: bytes) -> None:
    with pytest.raises(web.TemporaryError):
        served(content, (2, 3), np.float32)
