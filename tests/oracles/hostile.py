"""Servers on this machine: one that speaks DAP2 (OPeNDAP), and ones that answer anything else, or
nothing, or too slowly.

DAP 2.0: J. Gallagher, N. Potter, T. Sgouros, S. Hankin and G. Flierl 2007, The Data Access
Protocol, DAP 2.0, ESE-RFC-004.1.2. Values travel as XDR (RFC 4506): big-endian, 16-bit integers in
32 bits, an array's length twice.
"""

import contextlib
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import xarray as xr

KINDS = {
    "i2": ("Int16", ">i4"),
    "i4": ("Int32", ">i4"),
    "f4": ("Float32", ">f4"),
    "f8": ("Float64", ">f8"),
}

# what a server does with a connection and the target that it asks for
Answer = Callable[[socket.socket, str], None]


@dataclass(frozen=True)
class Variable:
    """What a server holds under one name: dims, one a dimension of `values`; attributes, numbers as
    NumPy scalars.
    """

    dims: tuple[str, ...]
    values: np.ndarray
    attributes: dict[str, object]


def dds(variables: dict[str, Variable], parts: dict[str, tuple[slice, ...]] | None = None) -> bytes:
    """Return the structure of a dataset, or of the parts of it that a constraint asks for."""
    lines = []
    for name, one in variables.items():
        if parts is not None and name not in parts:
            continue
        sizes = one.values[parts[name]].shape if parts else one.values.shape
        along = "".join(f"[{dim} = {size}]" for dim, size in zip(one.dims, sizes, strict=True))
        lines.append(f"    {KINDS[one.values.dtype.str[1:]][0]} {name}{along};\n")
    return f"Dataset {{\n{''.join(lines)}}} sea;\n".encode()


def held(path: Path) -> dict[str, Variable]:
    """Return what a netCDF file holds, but for attributes of several numbers."""
    found = {}
    with xr.open_dataset(path, decode_cf=False) as data:
        for name, one in data.variables.items():
            values = one.values.astype(np.int32) if one.dtype == np.int64 else one.values
            kept = {
                k: v if isinstance(v, str) else np.asarray(v)[()]
                for k, v in one.attrs.items()
                if np.ndim(v) == 0
            }
            kept = {k: np.int32(v) if isinstance(v, np.int64) else v for k, v in kept.items()}
            found[str(name)] = Variable(tuple(map(str, one.dims)), values, kept)
    return found


def das(variables: dict[str, Variable]) -> bytes:
    """Return the attributes of a dataset."""

    def line(key: str, value: object) -> str:
        if isinstance(value, str):
            return f'        String {key} "{value}";\n'
        number = np.asarray(value)
        return f"        {KINDS[number.dtype.str[1:]][0]} {key} {number.item()!r};\n"

    tables = (
        f"    {name} {{\n{''.join(line(key, value) for key, value in one.attributes.items())}    }}\n"
        for name, one in variables.items()
    )
    return f"Attributes {{\n{''.join(tables)}}}\n".encode()


def dods(variables: dict[str, Variable], constraint: str) -> bytes:
    """Return the values that a constraint asks for, like "u[0:1:3][2][5:7],lat"; all of them
    without one.
    """
    parts = _parts(variables, constraint)
    content = b"".join(_xdr(variables[name].values[part]) for name, part in parts.items())
    return dds(variables, parts) + b"\nData:\n" + content


def _parts(variables: dict[str, Variable], constraint: str) -> dict[str, tuple[slice, ...]]:
    whole = {name: (slice(None),) * one.values.ndim for name, one in variables.items()}
    if not constraint:
        return whole
    parts = {}
    for asked in constraint.split(","):
        name = asked.split("[")[0]
        bounds = [
            [int(n) for n in inside.split(":")] for inside in re.findall(r"\[([^]]*)\]", asked)
        ]
        spans = [slice(b[0], b[-1] + 1, b[1] if len(b) == 3 else 1) for b in bounds]
        parts[name] = tuple(spans) or whole[name]
    # in the order of the structure
    return {name: parts[name] for name in variables if name in parts}


def _xdr(values: np.ndarray) -> bytes:
    length = np.array([values.size, values.size], ">u4").tobytes() if values.ndim else b""
    return length + values.astype(KINDS[values.dtype.str[1:]][1]).tobytes()


def http(body: bytes, status: str = "200 OK", *headers: str) -> bytes:
    """Return an answer in HTTP."""
    lines = [
        f"HTTP/1.1 {status}",
        "XDAP: 2.0",
        "Connection: close",
        f"Content-Length: {len(body)}",
        *headers,
    ]
    return "\r\n".join([*lines, "", ""]).encode() + body


def speaking_dap(variables: dict[str, Variable], seen: list[str] | None = None) -> Answer:
    """Return what a good server does; seen: takes what was asked for."""

    def answer(connection: socket.socket, target: str) -> None:
        if seen is not None:
            seen.append(target)
        connection.sendall(good(variables, target))

    return answer


def good(variables: dict[str, Variable], target: str) -> bytes:
    """Return a good server's answer."""
    path, _, query = target.partition("?")
    if path.endswith(".dds"):
        names = {name.split("[")[0] for name in query.split(",") if name}
        asked = {n: v for n, v in variables.items() if n in names} if names else variables
        return http(
            dds(asked), "200 OK", "Content-Type: text/plain", "Content-Description: dods-dds"
        )
    if path.endswith(".das"):
        return http(
            das(variables), "200 OK", "Content-Type: text/plain", "Content-Description: dods-das"
        )
    if path.endswith(".dods"):
        content = dods(variables, query)
        return http(
            content,
            "200 OK",
            "Content-Type: application/octet-stream",
            "Content-Description: dods-data",
        )
    return http(b"no such thing", "404 Not Found")


def always(content: bytes) -> Answer:
    """Return what a server does that answers everything with the same bytes."""
    return lambda connection, target: connection.sendall(content)


def silent(connection: socket.socket, target: str) -> None:
    """Never answer."""
    with contextlib.suppress(OSError):
        while connection.recv(1):  # until the other side has left
            pass


def dripping(variables: dict[str, Variable], every: float = 1.0) -> Answer:
    """Return what a server does that sends one byte of a good answer a second."""

    def answer(connection: socket.socket, target: str) -> None:
        for byte in good(variables, target):
            connection.sendall(bytes([byte]))
            time.sleep(every)

    return answer


def redirecting(connection: socket.socket, target: str) -> None:
    """Send every question on to the same server."""
    host, port = connection.getsockname()
    connection.sendall(http(b"", "302 Found", f"Location: http://{host}:{port}{target}"))


@contextlib.contextmanager
def serving(answer: Answer) -> Iterator[str]:
    """Serve in threads on a port of this machine; give the address of a dataset there."""
    with socket.create_server(("127.0.0.1", 0), backlog=64) as door:
        door.settimeout(0.1)
        closing = threading.Event()
        threading.Thread(target=_accept, args=(door, answer, closing), daemon=True).start()
        try:
            yield f"http://127.0.0.1:{door.getsockname()[1]}/sea"
        finally:
            closing.set()


@contextlib.contextmanager
def never_accepting() -> Iterator[str]:
    """Hold a port whose queue is full: a connection to it is never made."""
    with socket.create_server(("127.0.0.1", 0), backlog=0) as door, contextlib.ExitStack() as stack:
        for _ in range(3):
            one = stack.enter_context(socket.socket())
            one.setblocking(False)
            one.connect_ex(door.getsockname())
        yield f"http://127.0.0.1:{door.getsockname()[1]}/sea"


def _accept(door: socket.socket, answer: Answer, closing: threading.Event) -> None:
    while not closing.is_set():
        try:
            connection, _ = door.accept()
        except TimeoutError:
            continue
        except OSError:
            return
        threading.Thread(target=_attend, args=(connection, answer), daemon=True).start()


def _attend(connection: socket.socket, answer: Answer) -> None:
    with connection, contextlib.suppress(OSError):
        connection.settimeout(30.0)
        request = b""
        while b"\r\n\r\n" not in request:
            part = connection.recv(65536)
            if not part:
                return
            request += part
        answer(connection, unquote(request.split()[1].decode("latin-1")))
        connection.shutdown(socket.SHUT_WR)


def sea(rows: int = 7, columns: int = 9) -> dict[str, Variable]:
    """Return a current across the antimeridian at 4 times, its u packed in 16 bits; the library
    fetches small ones whole.
    """
    dlat, dlon = 3.5 / rows, 6.75 / columns
    time_h, lat, lon = (
        np.arange(4.0),
        -41.0 + dlat * np.arange(rows),
        177.5 + dlon * np.arange(columns),
    )
    t, y, x = np.meshgrid(time_h, lat, lon, indexing="ij")
    u = 0.31 + 0.05 * np.sin(0.9 * x) + 0.02 * (y + 38) - 0.03 * t
    v = -0.12 + 0.04 * np.cos(1.3 * y) + 0.01 * (x - 180) + 0.02 * t
    packed = np.round((u - 0.25) / 0.001).astype(np.int16)
    packed[:, 2, 3] = -32767
    standard = "surface_{}ward_sea_water_velocity".format
    return {
        "time": Variable(
            ("time",), time_h, {"units": "hours since 2024-03-01 00:00:00", "standard_name": "time"}
        ),
        "lat": Variable(
            ("lat",),
            lat.astype(np.float32),
            {"units": "degrees_north", "standard_name": "latitude"},
        ),
        "lon": Variable(
            ("lon",),
            lon.astype(np.float32),
            {"units": "degrees_east", "standard_name": "longitude"},
        ),
        "u": Variable(
            ("time", "lat", "lon"),
            packed,
            {
                "units": "m s-1",
                "standard_name": standard("east"),
                "scale_factor": np.float32(0.001),
                "add_offset": np.float32(0.25),
                "_FillValue": np.int16(-32767),
            },
        ),
        "v": Variable(
            ("time", "lat", "lon"),
            v.astype(np.float32),
            {"units": "m s-1", "standard_name": standard("north")},
        ),
    }


def mutated(variables: dict[str, Variable], seed: int) -> tuple[str, Answer]:
    """Return a name and what a server does whose answers are damaged in one of many ways, the same
    for the same seed.
    """
    rng = np.random.default_rng(seed)
    where = ("dds", "das", "dods", "dods", "any")[rng.integers(5)]
    how, change = MUTATIONS[rng.integers(len(MUTATIONS))]
    keys = rng.integers(2**32, size=4)

    def answer(connection: socket.socket, target: str) -> None:
        whole = good(variables, target)
        if where in ("any", target.partition("?")[0].rpartition(".")[2]):
            head, _, body = whole.partition(b"\r\n\r\n")
            whole = change(head, body, np.random.default_rng(keys))
        connection.sendall(whole)
        if how == "left waiting":
            silent(connection, target)

    return f"{where}: {how}", answer


def _spliced(head: bytes, body: bytes, rng: np.random.Generator) -> bytes:
    """Put a stretch of the answer somewhere else, over what was there."""
    a, b = sorted(rng.integers(len(body) + 1, size=2).tolist())
    at = int(rng.integers(len(body) + 1))
    return http(body[:at] + body[a:b] + body[at + int(rng.integers(b - a + 1)) :])


def _flipped(head: bytes, body: bytes, rng: np.random.Generator) -> bytes:
    content = bytearray(body)
    for at in rng.integers(max(len(content), 1), size=1 + int(rng.integers(12))):
        content[at : at + 1] = rng.bytes(1)
    return http(bytes(content))


def _renumbered(head: bytes, body: bytes, rng: np.random.Generator) -> bytes:
    """Replace one number in the text by one that is far off."""
    text, mark, values = body.partition(b"\nData:\n")
    found = list(re.finditer(rb"\d+", text))
    if found:
        one = found[int(rng.integers(len(found)))]
        other = (b"-1", b"0", b"7", b"2147483648", b"99999999999999999999", b"1e400")[
            int(rng.integers(6))
        ]
        text = text[: one.start()] + other + text[one.end() :]
    return http(text + mark + values)


def _lengthened(head: bytes, body: bytes, rng: np.random.Generator) -> bytes:
    """Give an array of the values another length."""
    text, mark, values = body.partition(b"\nData:\n")
    return http(text + mark + np.array(rng.integers(2**32, size=2), ">u4").tobytes() + values[8:])


def _worded(head: bytes, body: bytes, rng: np.random.Generator) -> bytes:
    """Replace a word of the grammar by another one, or by its brackets."""
    words = [
        b"Float32",
        b"Int16",
        b"String",
        b"Dataset",
        b"Structure",
        b"Grid",
        b"Sequence",
        b"{",
        b"}",
        b"[",
        b"];",
        b'"',
    ]
    a, b = rng.choice(len(words), 2, replace=False)
    return http(body.replace(words[a], words[b], 1 + int(rng.integers(3))))


MUTATIONS: tuple[tuple[str, Callable[[bytes, bytes, np.random.Generator], bytes]], ...] = (
    ("cut short", lambda head, body, rng: http(body[: int(rng.integers(len(body) + 1))])),
    (
        "shorter than said",
        lambda head, body, rng: head + b"\r\n\r\n" + body[: int(rng.integers(len(body) + 1))],
    ),
    (
        "left waiting",
        lambda head, body, rng: head + b"\r\n\r\n" + body[: int(rng.integers(len(body) + 1))],
    ),
    ("bytes changed", _flipped),
    ("spliced", _spliced),
    ("numbers changed", _renumbered),
    ("lengths changed", _lengthened),
    ("words changed", _worded),
    ("random bytes", lambda head, body, rng: http(rng.bytes(int(rng.integers(5000))))),
    ("no HTTP", lambda head, body, rng: rng.bytes(1 + int(rng.integers(500)))),
    ("a web page", lambda head, body, rng: http(b"<html><body>Please log in</body></html>")),
    (
        "an error",
        lambda head, body, rng: http(
            b'Error { code = 500; message = "no"; };', "500 Internal Server Error"
        ),
    ),
    ("doubled", lambda head, body, rng: http(body + body)),
    ("nested", lambda head, body, rng: http(b"Dataset {" * 20_000 + body)),
)
