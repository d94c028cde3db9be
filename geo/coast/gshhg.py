"""GSHHG at full resolution, from roaring-landmask, cached in pieces: small boxes read little.

The package holds all land in one compressed block, which takes 3 s and 600 MB to read. On first use
it is written to the user's cache in pieces (26 MB), each with polygons that lie near each other.
Later calls read only the pieces that may reach the box, which takes 0.1 s, and return the same
polygons in the same order, bit for bit.
"""

import contextlib
import importlib.metadata
import os
import struct
import tempfile
import time
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import platformdirs
import shapely

from geo.box import Box

STEP = 1e6  # coordinates are whole numbers of millionths of a degree
CELL = 5.0  # [deg] polygons with centres in the same cell form one piece
LARGE = 20_000  # number of vertices above which a polygon is a piece of its own
BEGIN = struct.Struct("<8sq")  # start of the file: mark, and length of the table
MARK = b"gshhg  1"
# row of the table: bounding box [deg], length in the file [bytes]
PIECE = np.dtype([("edges", "<f8", 4), ("length", "<i8")])

Polygons = npt.NDArray[Any]  # of shapely.Polygon
TURNS = (-360.0, 0.0, 360.0)  # [deg] shifts of land to the longitudes of a box


def version() -> str:
    """Return the release of roaring-landmask, which identifies the data."""
    return importlib.metadata.version("roaring-landmask")


def whole() -> Polygons:
    """Return all land polygons of the Earth, cut at 180 degrees as in the package."""
    return _load(None)


def near(box: Box) -> Polygons:
    """Return at least the polygons that reach a box, in the order of `whole`.

    The box's longitudes may exceed 180 degrees.
    """
    return _load(box)


def cache_folder() -> Path:
    """Return the folder of cached land: DRIFT_CACHE, or the user's cache folder of this system."""
    return Path(os.environ.get("DRIFT_CACHE") or platformdirs.user_cache_dir("casp-drift"))


def _load(box: Box | None) -> Polygons:
    """Return the polygons near a box, from the cache if possible; otherwise write the cache."""
    path = cache_folder() / f"gshhg-{version()}.pieces"
    with contextlib.suppress(
        OSError, ValueError, MemoryError, struct.error, zlib.error, shapely.errors.GEOSException
    ):
        return _read_pieces(path, box)
    polygons = _read_package()
    # if the cache cannot be written, the next run takes some seconds more
    with contextlib.suppress(OSError):
        _write_pieces(path, polygons)
    return polygons


def _read_package() -> Polygons:
    """Return the polygons from the package itself."""
    # Shapes.wkb takes 2.4 s; the package's RoaringLandmask.new() would take 6 s and 1.3 GB.
    from roaring_landmask import LandmaskProvider, Shapes

    return np.asarray(shapely.get_parts(shapely.from_wkb(Shapes.wkb(LandmaskProvider.Gshhg))))


def _write_pieces(path: Path, polygons: Polygons) -> None:
    """Write polygons in pieces: the complete file or none.

    Polygons that the format cannot reproduce bit for bit (inner rings, finer coordinates) are not
    cached.
    """
    points = shapely.get_coordinates(polygons)
    steps = np.rint(points * STEP).astype(np.int32)
    if shapely.get_num_interior_rings(polygons).any() or (steps / STEP != points).any():
        return
    edges, count = shapely.bounds(polygons), shapely.get_num_coordinates(polygons)
    each = np.split(steps, np.cumsum(count)[:-1])
    table, packed = [], []
    for members in _group_into_pieces(edges, count):
        vertices = np.concatenate([each[k] for k in members])
        ways = np.diff(vertices, axis=0, prepend=np.int32(0)).T  # small numbers compress well
        numbers = (np.array([len(members)]), members, count[members], ways.reshape(-1))
        packed.append(
            zlib.compress(np.concatenate([part.astype("<i4") for part in numbers]).tobytes(), 1)
        )
        corners = (*edges[members, :2].min(axis=0), *edges[members, 2:].max(axis=0))
        table.append((corners, len(packed[-1])))
    head = zlib.compress(np.array(table, PIECE).tobytes())
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove_leftovers(path)
    with tempfile.NamedTemporaryFile(dir=path.parent, prefix=path.name, delete=False) as file:
        try:
            file.writelines((BEGIN.pack(MARK, len(head)), head, *packed))
            file.close()
            # other users may share the folder, but a temporary file is private
            os.chmod(file.name, 0o644)
            os.replace(file.name, path)
        except BaseException:  # also Ctrl-C
            os.unlink(file.name)
            raise


def _remove_leftovers(path: Path) -> None:
    """Remove temporary files of killed writers that are more than a day old."""
    for left in path.parent.glob(f"{path.name}?*"):
        with contextlib.suppress(OSError):
            if time.time() - left.stat().st_mtime > 86_400:
                left.unlink()


def _group_into_pieces(
    edges: npt.NDArray[np.float64], count: npt.NDArray[np.int32]
) -> Iterable[npt.NDArray[np.int64]]:
    """Return the indices of polygons in each piece: those with centres in the same cell.

    Each large polygon is a piece of its own.
    """
    column, row = (np.floor((edges[:, k] + edges[:, k + 2]) / 2 / CELL) for k in (0, 1))
    cell = column * 1_000 + row
    large = count > LARGE
    cell[large] = -1e9 - np.arange(large.sum())
    order = np.argsort(cell, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(cell[order])) + 1)


def _read_pieces(path: Path, box: Box | None) -> Polygons:
    """Return the polygons in the pieces that may reach a box; raise an error for a broken file."""
    members, rings = [], []
    with open(path, "rb") as file:
        mark, length = BEGIN.unpack(file.read(BEGIN.size))
        if mark != MARK:
            raise ValueError("another kind of file")
        table = np.frombuffer(zlib.decompress(file.read(length)), PIECE)
        begins = file.tell() + np.cumsum(table["length"]) - table["length"]
        for k in (
            range(len(table))
            if box is None
            else np.flatnonzero(_boxes_reaching(table["edges"], box))
        ):
            file.seek(int(begins[k]))
            numbers = np.frombuffer(zlib.decompress(file.read(int(table["length"][k]))), "<i4")
            size = int(numbers[0])
            members.append(numbers[1 : 1 + size])
            vertices = (
                numbers[1 + 2 * size :].reshape(2, -1).cumsum(axis=1, dtype=np.int32).T / STEP
            )
            of_ring = np.repeat(np.arange(size), numbers[1 + size : 1 + 2 * size])
            rings.append(shapely.linearrings(vertices, indices=of_ring))
    if not members:
        return np.empty(0, object)
    order = np.argsort(np.concatenate(members))
    return np.asarray(shapely.polygons(np.concatenate(rings)[order]))


def _boxes_reaching(edges: npt.NDArray[np.float64], box: Box) -> npt.NDArray[np.bool_]:
    """Return which boxes [deg] (n, 4: west, south, east, north) reach a box, shifted by turns."""
    west, south, east, north = edges.T
    across = [(west + turn <= box.east) & (east + turn >= box.west) for turn in TURNS]
    return np.asarray(np.any(across, axis=0) & (south <= box.north) & (north >= box.south))
