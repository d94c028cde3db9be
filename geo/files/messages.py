"""Split a GRIB file into messages of one field each, using only the lengths of sections.

GRIB 2 may put several fields into one message (NCEP does so with u and v); each field is extracted
with the sections that it shares. So is its header, a field without values, so that an index of a
large file reads no values. A file whose lengths do not add up is damaged and is rejected: a skipped
message would be a gap in time.
"""

import mmap
from dataclasses import dataclass

from geo.errors import UserError

LOOK = 4096  # [bytes] at the start of a file within which the first message must begin
HEADING = 256  # [bytes] allowed between two messages, for instance a bulletin heading
END = b"7777"


@dataclass(frozen=True)
class Message:
    """One field of a file.

    number: counted from 1. edition: 1 or 2. parts: (start, end) [bytes] of the pieces that form it.
    header: its bytes without values. shape: bytes of the section that defines the grid. product:
    bytes that identify the field, equal at all times and on all pressure levels.
    """

    path: str
    number: int
    edition: int
    parts: tuple[tuple[int, int], ...]
    header: bytes
    shape: bytes
    product: bytes


def is_grib(path: str) -> bool:
    """Return True if a file has a GRIB message near its start."""
    with open(path, "rb") as file:
        start = file.read(LOOK)
    return b"GRIB" in start and not start.startswith((b"CDF", b"\x89HDF"))


def split_messages(path: str) -> list[Message]:
    """Return the messages of a file in file order; raise UserError if the file is damaged."""
    messages: list[Message] = []
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        end, position = len(data), 0
        while (start := data.find(b"GRIB", position)) >= 0:
            _check_gap(
                data[position : min(start, position + HEADING + 1)],
                start - position,
                path,
                position,
            )
            try:
                edition = data[start + 7]
                if edition == 1:
                    position, fields = _split_edition_1(data, start)
                elif edition == 2:
                    position, fields = _split_edition_2(data, start)
                else:
                    raise ValueError(f"edition {edition}")
            except (ValueError, IndexError) as error:
                why = "ends in the middle of" if start + LOOK > end else "has a damaged"
                raise UserError(
                    f'"{path}" is a truncated or damaged GRIB file: '
                    f"it {why} message {len(messages) + 1}, at byte {start} ({error})"
                ) from error
            for parts, header, shape, product in fields:
                messages.append(
                    Message(path, len(messages) + 1, edition, parts, header, shape, product)
                )
        _check_gap(data[position : position + HEADING + 1], end - position, path, position)
    return messages


def whole(message: Message) -> bytes:
    """Return the bytes of a message of one field, with its values."""
    with open(message.path, "rb") as file:
        pieces = []
        for start, end in message.parts:
            file.seek(start)
            pieces.append(file.read(end - start))
    return pieces[0] if message.edition == 1 else _join_edition_2(pieces)


def _check_gap(gap: bytes, size: int, path: str, position: int) -> None:
    """Raise UserError if the bytes between two messages are neither a short heading nor blank."""
    if size <= HEADING or not gap.strip(b"\0 \r\n\t"):
        return
    raise UserError(
        f'"{path}" is a truncated or damaged GRIB file: {size} bytes at byte {position} belong to no message'
    )


# `parts`, `header`, `shape` and `product` of a Message
Field = tuple[tuple[tuple[int, int], ...], bytes, bytes, bytes]


def _read_number(data: mmap.mmap, position: int, size: int, end: int) -> int:
    """Return the number of `size` bytes at a position; raise ValueError if they exceed `end`."""
    if position + size > end:
        raise ValueError("a section beyond its end")
    return int.from_bytes(data[position : position + size], "big")


def _split_edition_1(data: mmap.mmap, start: int) -> tuple[int, list[Field]]:
    """Return the end of a GRIB 1 message, and its only field."""
    size, end = _read_number(data, start + 4, 3, len(data)), len(data)
    position = start + 8
    product = _read_number(data, position, 3, end)
    present = data[position + 7]
    position += product
    shape = b""
    for bit in (0x80, 0x40):  # flags of a grid section and a bitmap section
        if present & bit:
            section = _read_number(data, position, 3, end)
            if section < 6 or position + section > end:
                raise ValueError(f"a section of {section} bytes")
            shape = data[position : position + section] if bit == 0x80 else shape
            position += section
    values = _read_number(data, position, 3, end)
    # above 8 MiB ECMWF counts in units of 120 bytes, minus the number `values`
    if size & 0x800000 and values < 120:
        size = (size & 0x7FFFFF) * 120 - values + 4
    stop = start + size
    if product < 28 or stop > end or not position + 12 <= stop or data[stop - 4 : stop] != END:
        raise ValueError("its end is not where its length says")
    if size < 0x800000 and position + values + 4 != stop:
        raise ValueError("its sections do not add up")
    definition = bytearray(data[start + 8 : start + 8 + product])
    definition[7] &= 0x80
    grid = shape if present & 0x80 else b""
    head = (
        bytes(definition)
        + grid
        + (12).to_bytes(3, "big")
        + data[position + 3 : position + 12]
        + END
    )
    header = data[start : start + 4] + (len(head) + 8).to_bytes(3, "big") + b"\x01" + head
    identity = bytearray(definition)
    identity[12:20] = bytes(8)  # the date and the step
    if identity[9] == 100:
        identity[10:12] = bytes(2)
    return stop, [
        (((start, stop),), header, shape or bytes(identity[4:7]), b"\x01" + bytes(identity))
    ]


def _split_edition_2(data: mmap.mmap, start: int) -> tuple[int, list[Field]]:
    """Return the end of a GRIB 2 message, and its fields."""
    size = _read_number(data, start + 8, 8, len(data))
    stop = start + size
    if stop > len(data) or size < 20 or data[stop - 4 : stop] != END:
        raise ValueError("its end is not where its length says")
    last: dict[int, tuple[int, int]] = {}
    fields: list[Field] = []
    position, before = start + 16, 0
    while position < stop - 4:
        section, kind = _read_number(data, position, 4, stop), data[position + 4]
        if section < 5 or position + section > stop - 4 or not 1 <= kind <= 7:
            raise ValueError(f"section {kind} of {section} bytes")
        if kind <= before and before != 7:
            raise ValueError(f"section {kind} after section {before}")
        bitmap = last.get(6)
        last[kind] = (position, position + section)
        # 254: the previous field's bitmap applies
        if kind == 6 and data[position + 5] == 254 and bitmap is not None:
            last[6] = bitmap
        if kind == 7:
            missing = [k for k in (1, 3, 4, 5, 6) if k not in last]
            if missing:
                raise ValueError(f"no section {missing[0]}")
            sections = [last[k] for k in (1, 2, 3, 4, 5, 6, 7) if k in last]
            # the header gets an empty bitmap and no values
            pieces = [data[a:b] for a, b in sections[:-2]]
            header = _join_edition_2(
                [data[start : start + 16], *pieces, b"\0\0\0\x06\x06\xff", b"\0\0\0\x05\x07"]
            )
            identity = bytearray(data[slice(*last[4])])
            identity[18:22] = bytes(4)  # the step
            if identity[22:23] == b"\x64":
                identity[24:28] = bytes(4)
            origin = data[start + 6 : start + 7] + data[last[1][0] + 5 : last[1][0] + 12]
            fields.append(
                (
                    ((start, start + 16), *sections),
                    header,
                    data[slice(*last[3])],
                    origin + bytes(identity),
                )
            )
        position, before = position + section, kind
    if before != 7:
        raise ValueError("no values")
    return stop, fields


def _join_edition_2(pieces: list[bytes]) -> bytes:
    """Return a GRIB 2 message joined from its sections, with its length updated."""
    body = b"".join(pieces[1:]) + END
    return pieces[0][:8] + (16 + len(body)).to_bytes(8, "big") + body
