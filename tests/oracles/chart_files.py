"""Charts as MBTiles and PMTiles files, written by hand from their specifications."""

import gzip
import io
import json
import sqlite3
import struct
from collections.abc import Mapping
from pathlib import Path

from PIL import Image

Tiles = Mapping[tuple[int, int, int], bytes]  # by zoom, column from 180 W, row from the north
# places of the tiles of zoom levels 0 and 1 along the Hilbert curve (PMTiles 3, section 4)
HILBERT = {(0, 0, 0): 0, (1, 0, 0): 1, (1, 0, 1): 2, (1, 1, 1): 3, (1, 1, 0): 4}
KINDS = {"mvt": 1, "png": 2, "jpeg": 3, "webp": 4, "avif": 5}


def image(colour: tuple[int, ...], kind: str = "png", side: int = 256) -> bytes:
    """Return a tile of one colour."""
    file = io.BytesIO()
    Image.new("RGBA" if len(colour) == 4 else "RGB", (side, side), colour).save(file, kind)
    return file.getvalue()


def mbtiles(path: Path, tiles: Tiles, **metadata: str) -> Path:
    """Write an MBTiles file, whose rows count from the south (MBTiles 1.3)."""
    with sqlite3.connect(path) as file:
        file.execute("CREATE TABLE metadata (name text, value text)")
        columns = "zoom_level integer, tile_column integer, tile_row integer, tile_data blob"
        file.execute(f"CREATE TABLE tiles ({columns})")
        file.executemany("INSERT INTO metadata VALUES (?, ?)", metadata.items())
        rows = [(z, x, 2**z - 1 - y, data) for (z, x, y), data in tiles.items()]
        file.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", rows)
    file.close()
    return path


def pmtiles(path: Path, tiles: Tiles, kind: str = "png", packed: int = 1, **metadata: str) -> Path:
    """Write a PMTiles file of zoom levels 0 and 1. packed: compression of its tiles, 1: none."""
    ordered = sorted((HILBERT[key], data) for key, data in tiles.items())
    numbers, contents = [number for number, _ in ordered], [data for _, data in ordered]
    gaps = [one - before for before, one in zip([0, *numbers], numbers, strict=False)]
    # the offset of a tile right behind the one before is 0, any other is its offset + 1
    offsets = [1, *[0] * (len(numbers) - 1)]
    lengths = [len(data) for data in contents]
    columns = [[len(numbers)], gaps, [1] * len(numbers), lengths, offsets]
    root = gzip.compress(b"".join(_varint(value) for column in columns for value in column))
    told = gzip.compress(json.dumps(metadata).encode())
    begins = 127, 127 + len(root), 127 + len(root) + len(told)
    sections = (
        (begins[0], len(root)),
        (begins[1], len(told)),
        (begins[2], 0),
        (begins[2], sum(lengths)),
    )
    head = b"PMTiles\x03" + struct.pack("<8Q", *(value for one in sections for value in one))
    head += struct.pack("<3Q", *[len(numbers)] * 3)
    head += struct.pack("<6B", 1, 2, packed, KINDS[kind], 0, 1)
    edges = (-1800000000, -850000000, 1800000000, 850000000)
    head += struct.pack("<4iB2i", *edges, 0, 0, 0)
    assert len(head) == 127
    path.write_bytes(head + root + told + b"".join(contents))
    return path


def _varint(value: int) -> bytes:
    """Return a number as PMTiles packs it: seven bits a byte, the lowest first."""
    found = b""
    while value > 127:
        found += bytes([value & 127 | 128])
        value >>= 7
    return found + bytes([value])
