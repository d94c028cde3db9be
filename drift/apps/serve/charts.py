"""Charts of the user's own for the map of the page: tiles of images from MBTiles and PMTiles files.

MBTiles 1.3 is a table of SQLite, whose rows count from the south. PMTiles 3 is read by its own
library. A file may come from anyone: what takes too long or is too large is no tile, and only bytes
that begin as PNG, JPEG or WebP are sent.
"""

import html
import os
import re
import sqlite3
import time
import zlib
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geo.errors import UserError

DEEPEST = 24  # zoom level: tiles of 2 m
LARGEST = 4 * 2**20  # [bytes] of a tile
LONGEST = 2**20  # [bytes] of a directory of a PMTiles file and of its metadata, unpacked
PATIENCE = 2.0  # [s] that a database may take for an answer
OPERATIONS = 10_000  # of SQLite's machine between two looks at the clock
KINDS = {b"\x89PNG\r\n\x1a\n": "image/png", b"\xff\xd8\xff": "image/jpeg", b"RIFF": "image/webp"}
WHERE = "name an MBTiles or PMTiles file of images with --chart"
# what reading a file that is not as it should be raises
BROKEN = (
    sqlite3.Error,
    zlib.error,
    EOFError,
    IndexError,
    KeyError,
    OSError,
    OverflowError,
    TypeError,
    ValueError,
)


@dataclass(frozen=True)
class Chart:
    """A chart, and where its tiles come from.

    Attributes:
        name: for the list of layers.
        attribution: who made it, as plain text.
        least: lowest zoom level that it has.
        most: highest one.
        bounds: west, south, east, north [deg]; None: anywhere.
        read: returns what the file holds as tile (zoom, column from 180 W, row from the north).
    """

    name: str
    attribution: str
    least: int
    most: int
    bounds: tuple[float, float, float, float] | None
    read: Callable[[int, int, int], bytes | None]

    def tile(self, zoom: int, column: int, row: int) -> tuple[str, bytes] | None:
        """Return the media type and the bytes of a tile; None: the chart has none there."""
        if not self.least <= zoom <= self.most or max(column, row) >= 2**zoom:
            return None
        try:
            data = self.read(zoom, column, row)
        except BROKEN:
            return None
        kind = media_type(data) if isinstance(data, bytes) else ""
        return (kind, data) if data and kind and len(data) <= LARGEST else None


def media_type(data: bytes) -> str:
    """Return the media type of a tile's bytes; "" for anything but PNG, JPEG and WebP."""
    kind = next((kind for begin, kind in KINDS.items() if data.startswith(begin)), "")
    return "" if kind == "image/webp" and data[8:12] != b"WEBP" else kind


def open_chart(path: str | os.PathLike[str]) -> Chart:
    """Return the chart in a file.

    Args:
        path: of an MBTiles or a PMTiles file.

    Raises:
        UserError: the file cannot be read, is of another kind, or holds no images.
    """
    place = Path(path).expanduser()
    told = f'chart "{str(path)[:300]}"'
    try:
        with open(place, "rb") as file:
            begin = file.read(16) if place.is_file() else b""
        if begin.startswith(b"SQLite format 3\0"):
            return _mbtiles(place.resolve(), told)
        if begin.startswith(b"PMTiles\x03"):
            return _pmtiles(place.resolve(), told)
    except UserError:
        raise
    except OSError as error:
        raise UserError(f"{told}: cannot be read ({error.strerror}); {WHERE}") from None
    except BROKEN as error:
        raise UserError(f"{told}: is damaged ({str(error)[:200]}); {WHERE}") from None
    raise UserError(f"{told}: is neither MBTiles nor PMTiles 3; {WHERE}")


def _mbtiles(path: Path, told: str) -> Chart:
    """Return the chart in an MBTiles file, which is never written and never waits for a lock."""
    address = f"{path.as_uri()}?mode=ro&immutable=1"

    def ask(words: str, *values: int) -> list[Any]:
        with closing(sqlite3.connect(address, uri=True)) as file:
            file.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST)
            end = time.monotonic() + PATIENCE
            # its tables may be views that never end
            file.set_progress_handler(lambda: time.monotonic() > end, OPERATIONS)
            return file.execute(words, values).fetchmany(100)

    said = {str(name): str(value) for name, value in ask("SELECT name, value FROM metadata")}
    _check_images(told, said.get("format", "png").lower())
    ((least, most),) = ask("SELECT min(zoom_level), max(zoom_level) FROM tiles")
    if least is None:
        raise UserError(f"{told}: holds no tiles; {WHERE}")
    words = "SELECT tile_data FROM tiles WHERE zoom_level=? AND tile_column=? AND tile_row=?"

    def read(zoom: int, column: int, row: int) -> bytes | None:
        found = ask(words, zoom, column, 2**zoom - 1 - row)
        return found[0][0] if found else None

    bounds = said.get("bounds", "").split(",")
    return Chart(
        _plain(said.get("name", "")) or path.stem,
        _plain(said.get("attribution", "")),
        max(int(least), 0),
        min(int(most), DEEPEST),
        _box([float(value) for value in bounds]) if len(bounds) == 4 else None,
        read,
    )


def _pmtiles(path: Path, told: str) -> Chart:
    """Return the chart in a PMTiles file."""
    try:
        from pmtiles.reader import Reader
        from pmtiles.tile import Compression, TileType
    except ImportError:
        raise UserError(
            f"{told}: PMTiles need the library pmtiles; pip install pmtiles, or convert the file "
            "to MBTiles"
        ) from None

    def piece(offset: int, length: int) -> bytes:
        """Return bytes of the file; a directory unpacks to no more than its limit."""
        if length > LARGEST:
            raise ValueError("a part of it is too large")
        with open(path, "rb") as file:
            file.seek(offset)
            held = file.read(length)
        if held.startswith(b"\x1f\x8b"):
            unpacking = zlib.decompressobj(wbits=31)
            unpacking.decompress(held, LONGEST)
            if not unpacking.eof:
                raise ValueError("a directory is too large")
        return held

    reader: Any = Reader(piece)
    header = reader.header()
    kind = header["tile_type"]
    _check_images(told, kind.name.lower() if isinstance(kind, TileType) else str(kind))
    if header["tile_compression"] not in (Compression.NONE, Compression.UNKNOWN):
        raise UserError(f"{told}: its images are packed once more; {WHERE}")
    said = reader.metadata()
    said = said if isinstance(said, dict) else {}
    edges = [
        header[name] / 1e7 for name in ("min_lon_e7", "min_lat_e7", "max_lon_e7", "max_lat_e7")
    ]
    return Chart(
        _plain(str(said.get("name", ""))) or path.stem,
        _plain(str(said.get("attribution", ""))),
        header["min_zoom"],
        min(header["max_zoom"], DEEPEST),
        _box(edges),
        reader.get,
    )


def _check_images(told: str, kind: str) -> None:
    """Raise UserError where tiles are of a kind that the page does not draw."""
    if kind in ("pbf", "mvt", "mlt"):
        raise UserError(
            f"{told}: is a vector chart; only images can be shown: convert it to PNG tiles, for "
            "example with tileserver-gl"
        )
    if kind not in ("png", "jpg", "jpeg", "webp", "unknown"):
        raise UserError(f'{told}: tiles of the kind "{kind[:40]}"; they must be png, jpg or webp')


def _box(edges: list[float]) -> tuple[float, float, float, float] | None:
    """Return west, south, east, north [deg]; None where they enclose nothing, or cross 180 E."""
    west, south, east, north = edges
    inside = -180 <= west < east <= 180 and -90 <= south < north <= 90
    return (west, south, east, north) if inside else None


def _plain(text: str) -> str:
    """Return a text without tags and line breaks, short enough for a list."""
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", text[:2000])).split())[:120]
