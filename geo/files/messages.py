"""Cutting a GRIB file into messages of one field each, by the lengths of their sections alone.

GRIB 2 may put several fields into a message (NCEP does with u and v): each is cut out with the sections that it shares.
Headers are cut as well, a field without its values, so that an index of a large file needs no values. What does not
add up is refused: the file is damaged, and a slice that is passed over would be a hole in time.
"""

import mmap
from dataclasses import dataclass

from geo.errors import UserError

LOOK = 4096  # [bytes] at the start of a file within which its first message begins
HEADING = 256  # [bytes] that may stand between two messages: a bulletin's heading
END = b"7777"


@dataclass(frozen=True)
class Message:
    """One field of a file. parts: (start, end) [bytes] of what it is joined from; edition: 1 or 2; number: from 1.

    header: the same bytes without the values; shape: those of the section that defines the grid; product: those that
    say which field it is, the same at all times and on all pressure levels.
    """

    path: str
    number: int
    edition: int
    parts: tuple[tuple[int, int], ...]
    header: bytes
    shape: bytes
    product: bytes


def is_grib(path: str) -> bool:
    """Whether a file holds a GRIB message near its start."""
    with open(path, "rb") as file:
        start = file.read(LOOK)
    return b"GRIB" in start and not start.startswith((b"CDF", b"\x89HDF"))


def cut(path: str) -> list[Message]:
    """Return the messages of a file in its order."""
    found: list[Message] = []
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as held:
        end, at = len(held), 0
        while (start := held.find(b"GRIB", at)) >= 0:
            _check_gap(held[at : min(start, at + HEADING + 1)], start - at, path, at)
            try:
                edition = held[start + 7]
                if edition == 1:
                    at, fields = _first_edition(held, start)
                elif edition == 2:
                    at, fields = _second_edition(held, start)
                else:
                    raise ValueError(f"edition {edition}")
            except (ValueError, IndexError) as error:
                why = "ends in the middle of" if start + LOOK > end else "has a damaged"
                raise UserError(
                    f'"{path}" is a truncated or damaged GRIB file: it {why} message {len(found) + 1}, at byte {start} ({error})'
                ) from error
            for parts, header, shape, product in fields:
                found.append(Message(path, len(found) + 1, edition, parts, header, shape, product))
        _check_gap(held[at : at + HEADING + 1], end - at, path, at)
    return found


def whole(message: Message) -> bytes:
    """Return the bytes of a message of one field, values and all."""
    with open(message.path, "rb") as file:
        pieces = []
        for start, end in message.parts:
            file.seek(start)
            pieces.append(file.read(end - start))
    return pieces[0] if message.edition == 1 else _second_whole(pieces)


def _check_gap(gap: bytes, size: int, path: str, at: int) -> None:
    if size <= HEADING or not gap.strip(b"\0 \r\n\t"):
        return
    raise UserError(f'"{path}" is a truncated or damaged GRIB file: {size} bytes at byte {at} belong to no message')


Field = tuple[tuple[tuple[int, int], ...], bytes, bytes, bytes]


def _length(held: mmap.mmap, at: int, size: int, end: int) -> int:
    if at + size > end:
        raise ValueError("a section beyond its end")
    return int.from_bytes(held[at : at + size], "big")


def _first_edition(held: mmap.mmap, start: int) -> tuple[int, list[Field]]:
    size, end = _length(held, start + 4, 3, len(held)), len(held)
    at = start + 8
    product = _length(held, at, 3, end)
    present = held[at + 7]
    at += product
    shape = b""
    for bit in (0x80, 0x40):  # a grid, a bitmap
        if present & bit:
            section = _length(held, at, 3, end)
            if section < 6 or at + section > end:
                raise ValueError(f"a section of {section} bytes")
            shape = held[at : at + section] if bit == 0x80 else shape
            at += section
    values = _length(held, at, 3, end)
    if size & 0x800000 and values < 120:  # ECMWF's way past 8 MiB: in units of 120 bytes, and what is left over
        size = (size & 0x7FFFFF) * 120 - values + 4
    stop = start + size
    if product < 28 or stop > end or not at + 12 <= stop or held[stop - 4 : stop] != END:
        raise ValueError("its end is not where its length says")
    if size < 0x800000 and at + values + 4 != stop:
        raise ValueError("its sections do not add up")
    about = bytearray(held[start + 8 : start + 8 + product])
    about[7] &= 0x80
    grid = shape if present & 0x80 else b""
    head = bytes(about) + grid + (12).to_bytes(3, "big") + held[at + 3 : at + 12] + END
    header = held[start : start + 4] + (len(head) + 8).to_bytes(3, "big") + b"\x01" + head
    what = bytearray(about)
    what[12:20] = bytes(8)  # the date, and the step
    if what[9] == 100:
        what[10:12] = bytes(2)
    return stop, [(((start, stop),), header, shape or bytes(what[4:7]), b"\x01" + bytes(what))]


def _second_edition(held: mmap.mmap, start: int) -> tuple[int, list[Field]]:
    size = _length(held, start + 8, 8, len(held))
    stop = start + size
    if stop > len(held) or size < 20 or held[stop - 4 : stop] != END:
        raise ValueError("its end is not where its length says")
    last: dict[int, tuple[int, int]] = {}
    fields: list[Field] = []
    at, before = start + 16, 0
    while at < stop - 4:
        section, kind = _length(held, at, 4, stop), held[at + 4]
        if section < 5 or at + section > stop - 4 or not 1 <= kind <= 7:
            raise ValueError(f"section {kind} of {section} bytes")
        if kind <= before and before != 7:
            raise ValueError(f"section {kind} after section {before}")
        bitmap = last.get(6)
        last[kind] = (at, at + section)
        if kind == 6 and held[at + 5] == 254 and bitmap is not None:  # the bitmap of the field before
            last[6] = bitmap
        if kind == 7:
            missing = [k for k in (1, 3, 4, 5, 6) if k not in last]
            if missing:
                raise ValueError(f"no section {missing[0]}")
            wanted = [last[k] for k in (1, 2, 3, 4, 5, 6, 7) if k in last]
            pieces = [held[a:b] for a, b in wanted[:-2]]  # and no bitmap, no values
            header = _second_whole([held[start : start + 16], *pieces, b"\0\0\0\x06\x06\xff", b"\0\0\0\x05\x07"])
            what = bytearray(held[slice(*last[4])])
            what[18:22] = bytes(4)  # the step
            if what[22:23] == b"\x64":
                what[24:28] = bytes(4)
            origin = held[start + 6 : start + 7] + held[last[1][0] + 5 : last[1][0] + 12]
            fields.append((((start, start + 16), *wanted), header, held[slice(*last[3])], origin + bytes(what)))
        at, before = at + section, kind
    if before != 7:
        raise ValueError("no values")
    return stop, fields


def _second_whole(pieces: list[bytes]) -> bytes:
    body = b"".join(pieces[1:]) + END
    return pieces[0][:8] + (16 + len(body)).to_bytes(8, "big") + body
