"""Land polygons: GSHHG from roaring-landmask, or the user's own shoreline, cut to a box.

Polygons are shapely polygons in degrees, unwrapped around the box (so a box over the antimeridian
has longitudes above 180). They are cut at the box, rounded outward to whole degrees plus MARGIN.
Broken polygons (self-crossing or overlapping) are repaired, with a note; a shoreline without
polygons is rejected.

Lakes count as land, because nothing that drifts at sea gets there, unless the case asks for them.
Then they are the inner rings of a file's own polygons, or a file of lake polygons. A .bna file
marks lakes by their type; NOAA's files contain lakes that are connected to the sea (Pontchartrain,
Maurepas), which are always water. GSHHG comes without lakes.
"""

import glob
import hashlib
import json
import os
import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from geo.box import Box
from geo.coast import gshhg
from geo.errors import UserError
from geo.files import fence

VAST = 4_000.0  # [deg2] area above which a preview of the coast is thinned
ISLET = 0.05  # [deg] extent below which islands are left out of such a preview
THIN, FEWEST = 16, 12  # every THIN-th vertex of a ring is kept, but at least about FEWEST vertices
# [deg] margin around the rounded box, so that cut lines lie outside every grid of geo.coast.edges
MARGIN = 0.25

SHAPEFILE = b"\x00\x00\x27\x0a"  # first bytes of a shapefile
SHAPES = (
    "Point",
    "MultiPoint",
    "LineString",
    "MultiLineString",
    "Polygon",
    "MultiPolygon",
    "GeometryCollection",
)

Polygons = npt.NDArray[Any]  # of shapely.Polygon


@dataclass(frozen=True)
class Shore:
    """Land polygons [deg], their source, notes on repairs, and the box to which they are cut."""

    polygons: Polygons
    source: str
    notes: tuple[str, ...] = ()
    box: Box | None = None


@dataclass(frozen=True)
class _Contents:
    """Contents of a file: polygons, polygons that a .bna marks as lakes, and notes.

    label: name of the file in messages.
    """

    polygons: Polygons
    lakes: Polygons
    notes: tuple[str, ...]
    label: str


def read_land(
    source: str | os.PathLike[str], box: Box, lakes: bool | str | os.PathLike[str] = False
) -> Shore:
    """Return the land in a box.

    Args:
        source: "gshhg", a file (.bna, GeoJSON, shapefile) or "none".
        box: area of the case.
        lakes: False: inner rings of the source's polygons are land. True: they are water. A file:
            its polygons are water (in a .bna with records of type 2 only those), and inner rings
            of the source are land. In a .bna source, records of type 2 are always water.

    Raises:
        UserError: a file cannot be read or interpreted, or the source has no lakes.
    """
    cut = _rounded(box)
    name = os.fspath(source)
    kind = name.lower()
    if lakes is True and kind == "gshhg":
        raise UserError(
            'lakes = true: GSHHG as installed holds no lakes; name a file of lake polygons (lakes = "lakes.geojson"), '
            "or leave lakes out: everything inside its shores is then land"
        )
    if lakes and kind == "none":
        raise UserError(
            'lakes: with the coast "none" there is no land to cut them from; leave lakes out or name a coast'
        )
    if kind == "none":
        return Shore(np.empty(0, object), "none", ("no coast: particles pass over land",), cut)
    notes: tuple[str, ...] = ()
    if kind == "gshhg":
        polygons = clip(gshhg.near(cut), cut)
        origin = f"GSHHG, full resolution (roaring-landmask {gshhg.version()})"
    else:
        polygons, notes = _land_of_file(Path(name), lakes is True)
        polygons = clip(polygons, cut)
        if not polygons.size:
            notes += (f"none of its land lies in {_extent_text(box)}",)
        origin = _name_and_digest(name)
    if lakes and lakes is not True:
        polygons, done = _cut_lakes(polygons, Path(lakes), cut, box)
        origin, notes = f"{origin}, lakes {_name_and_digest(lakes)}", notes + done
    return Shore(polygons, origin, notes, cut)


def read_whole_land(
    source: str | os.PathLike[str], lakes: bool | str | os.PathLike[str] = False
) -> Polygons:
    """Return the uncut land polygons of a source, for the whole Earth; arguments as in `land`.

    A file of lakes is ignored. GSHHG takes a second.
    """
    name = os.fspath(source)
    if name.lower() == "none":
        return np.empty(0, object)
    return gshhg.whole() if name.lower() == "gshhg" else _land_of_file(Path(name), lakes is True)[0]


def _land_of_file(path: Path, lakes: bool) -> tuple[Polygons, tuple[str, ...]]:
    """Return the land of a user's file, and notes; lakes: inner rings are water."""
    contents = _read_polygons(path, "shoreline", 'a .bna, GeoJSON or shapefile, "gshhg" or "none"')
    polygons, notes = contents.polygons, contents.notes
    if not polygons.size:
        raise UserError(
            f'{contents.label}: holds no land polygon; give polygons of land, "gshhg" or "none"'
        )
    rings = int(shapely.get_num_interior_rings(polygons).sum())
    if rings and not lakes:
        polygons = shapely.polygons(shapely.get_exterior_ring(polygons))
        notes += (
            f"{rings} inner rings of the shoreline (lakes) are land; lakes = true makes them water",
        )
    polygons, repairs = _repair(polygons)
    if not polygons.size:
        raise UserError(
            f'{contents.label}: holds no land polygon; give polygons of land, "gshhg" or "none"'
        )
    notes += repairs
    if contents.lakes.size:
        water = shapely.union_all(shapely.make_valid(contents.lakes))
        polygons = _only_polygons(shapely.difference(polygons, water))
    if contents.lakes.size or (lakes and rings):
        notes += (f"{rings * lakes + contents.lakes.size} lakes of the shoreline are water",)
    elif lakes:
        notes += ("lakes were asked for, but the shoreline holds none",)
    return polygons, notes


def _cut_lakes(land: Polygons, path: Path, cut: Box, box: Box) -> tuple[Polygons, tuple[str, ...]]:
    """Return land, cut to a box, without the lakes of a file, and notes."""
    contents = _read_polygons(path, "lakes", "a .bna, GeoJSON or shapefile of lake polygons")
    lakes = contents.lakes if contents.lakes.size else contents.polygons
    if not lakes.size:
        raise UserError(f"{contents.label}: holds no polygon; give polygons of lakes")
    total = lakes.size
    broken = int((~shapely.is_valid(lakes)).sum())
    # Lakes are cut to the box before they are joined, because a file may hold those of the world.
    water = clip(_only_polygons(shapely.make_valid(lakes)), cut)
    notes = contents.notes
    if broken:
        notes += (f"{broken} of {total} lakes crossed themselves and were repaired",)
    if not water.size:
        return land, (
            *notes,
            f"none of the {total} lakes of {path.name} lies in {_extent_text(box)}",
        )
    near, lake = shapely.STRtree(land).query(water, "intersects")[::-1]
    touching = np.unique(near)
    parts = _only_polygons(shapely.difference(land[touching], shapely.union_all(water)))
    count = np.unique(lake).size
    return (
        np.concatenate([np.delete(land, touching), parts]),
        (*notes, f"{count} lakes of {path.name}, or parts of them, are water"),
    )


def _name_and_digest(path: str | os.PathLike[str]) -> str:
    """Return a file's name and a digest of its contents."""
    fence.check(path)
    return f"{Path(path).name} (sha256 {hashlib.sha256(Path(path).read_bytes()).hexdigest()[:12]})"


def _extent_text(box: Box) -> str:
    """Return a box [deg] as text for messages."""
    return f"{box.west:g}..{box.east:g} E, {box.south:g}..{box.north:g} N"


def clip(polygons: Polygons, box: Box) -> Polygons:
    """Return the polygons' parts in a box, shifted to its longitudes.

    Parts on both sides of the antimeridian are joined.
    """
    bounds = shapely.bounds(polygons)
    pieces = []
    for turn in gshhg.TURNS:
        near = (bounds[:, 0] + turn <= box.east) & (bounds[:, 2] + turn >= box.west)
        near &= (bounds[:, 1] <= box.north) & (bounds[:, 3] >= box.south)
        shifted = polygons[near]
        if turn:
            shifted = shapely.transform(shifted, lambda x, turn=turn: x + np.array([turn, 0.0]))
        west, south, east, north = shapely.bounds(shifted).T
        rim = (west <= box.west) | (south <= box.south) | (east >= box.east) | (north >= box.north)
        shifted[rim] = shapely.clip_by_rect(shifted[rim], box.west, box.south, box.east, box.north)
        pieces.append(shifted)
    parts = _only_polygons(np.concatenate(pieces))
    seams = [x for x in (-180.0, 180.0, 540.0) if box.west < x < box.east]
    if not seams or not parts.size:
        return parts
    bounds = shapely.bounds(parts)
    at_seam = np.any([(bounds[:, 0] == x) | (bounds[:, 2] == x) for x in seams], axis=0)
    return np.concatenate(
        [parts[~at_seam], _only_polygons(np.array([shapely.union_all(parts[at_seam])]))]
    )


def thin_shore(shore: Shore) -> Shore:
    """Return land for a preview, not for a run.

    In a vast box, islets are left out, and a vertex is kept every few kilometres: shores are off by
    up to about THIN vertices (3 km for GSHHG). Land with inner rings, and land in a smaller box, is
    returned unchanged.
    """
    box, polygons = shore.box, shore.polygons
    if box is None or (box.east - box.west) * (box.north - box.south) <= VAST:
        return shore
    if not polygons.size or shapely.get_num_interior_rings(polygons).any():
        return shore
    west, south, east, north = shapely.bounds(polygons).T
    rings = shapely.get_exterior_ring(polygons[np.maximum(east - west, north - south) >= ISLET])
    points, ring = shapely.get_coordinates(rings, return_index=True)
    count = np.bincount(ring, minlength=len(rings))
    place = np.arange(len(points)) - np.repeat(np.cumsum(count) - count, count)
    every = np.clip(count // FEWEST, 1, THIN)
    keep = (place % every[ring] == 0) | (place == count[ring] - 1)
    outlines = shapely.polygons(shapely.linearrings(points[keep], indices=ring[keep]))
    note = "the domain is vast: this preview shows its coast without islets, to some 3 km; a run uses all of it"
    return Shore(outlines, shore.source, (*shore.notes, note), box)


def _rounded(box: Box) -> Box:
    """Return a box rounded outward to whole degrees and widened by MARGIN, within the Earth."""
    south, north = max(np.floor(box.south) - MARGIN, -90.0), min(np.ceil(box.north) + MARGIN, 90.0)
    west, east = np.floor(box.west) - MARGIN, np.ceil(box.east) + MARGIN
    if east - west >= 360:
        west, east = -180.0, 180.0
    return Box(float(west), float(south), float(east), float(north))


def _only_polygons(geometries: Polygons) -> Polygons:
    """Return the polygons in geometries and collections, without lines, points and empty ones."""
    parts = shapely.get_parts(shapely.get_parts(geometries))
    return np.asarray(parts[(shapely.get_type_id(parts) == 3) & ~shapely.is_empty(parts)])


def _repair(polygons: Polygons) -> tuple[Polygons, tuple[str, ...]]:
    """Return polygons that neither cross themselves nor overlap, and notes on repairs."""
    notes: tuple[str, ...] = ()
    broken = ~shapely.is_valid(polygons)
    if broken.any():
        polygons = np.where(broken, shapely.make_valid(polygons), polygons)
        notes = (
            f"{broken.sum()} of {broken.size} shoreline polygons crossed themselves and were repaired",
        )
    return _only_polygons(np.array([shapely.union_all(polygons)])), notes


def _read_polygons(path: Path, word: str, wanted: str) -> _Contents:
    """Return a file's polygons.

    word: "shoreline" or "lakes"; wanted: allowed inputs; both for messages.
    """
    label = f'{word} "{path}"'
    fence.check(path)
    if not path.is_file():
        raise UserError(f"{label}: no such file; give {wanted}")
    if path.suffix.lower() == ".bna":
        return _read_bna(path, word, label)
    import pyproj

    try:
        with open(path, "rb") as file:
            start = file.read(16)
        geometries, crs = (
            _read_shapefile(path) if start.startswith(SHAPEFILE) else _read_geojson(path)
        )
    except (
        OSError,
        ValueError,
        TypeError,
        KeyError,
        AttributeError,
        RecursionError,
        shapely.errors.GEOSException,
        pyproj.exceptions.CRSError,
    ) as error:
        reason = " ".join(str(error).split())[:200]
        raise UserError(
            f"{label}: cannot be read ({reason}); give a .bna, GeoJSON or shapefile"
        ) from None
    notes: tuple[str, ...] = ()
    if crs is not None and crs.is_projected:
        turn = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform
        geometries = shapely.transform(geometries, turn, interleaved=False)
        notes = (f"{word} converted from {crs.name} to longitude and latitude",)
    polygons = _only_polygons(geometries[~shapely.is_missing(geometries)])
    _refuse_impossible(polygons, label)
    return _Contents(polygons, np.empty(0, object), notes, label)


def _read_shapefile(path: Path) -> tuple[Polygons, Any]:
    """Return the shapes of a shapefile, which refers to no other files, and its crs."""
    import pyogrio
    import pyproj

    # GDAL also interprets names: x.zip!y is y in an archive
    if path.suffix.lower() != ".shp" or "!" in str(path):
        raise ValueError('the name of a shapefile ends in .shp, and has no "!"')
    for beside in path.parent.glob(f"{glob.escape(path.stem)}.*"):
        fence.check(beside)
    try:
        with warnings.catch_warnings():
            # GDAL warns about problems that are rejected or repaired later
            warnings.simplefilter("ignore", RuntimeWarning)
            meta, _, wkb, _ = pyogrio.raw.read(path, layer=0, columns=[], force_2d=True)
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError) as error:
        raise ValueError(str(error).splitlines()[0]) from None
    # A table without shapes has the geometry None.
    return shapely.from_wkb(wkb if wkb is not None else np.empty(0, object)), meta[
        "crs"
    ] and pyproj.CRS(meta["crs"])


def _read_geojson(path: Path) -> tuple[Polygons, Any]:
    """Return the shapes of a GeoJSON file, and its crs if it names one (not part of RFC 7946).

    GDAL is not used: it chooses a driver by the contents of a text, which may name a program or
    other files.
    """
    import pyproj

    document = json.loads(path.read_bytes().decode("utf-8-sig"))
    if not isinstance(document, dict):
        raise ValueError("this is no GeoJSON")
    entries = document["features"] if document.get("type") == "FeatureCollection" else [document]
    shapes = [one.get("geometry") if one.get("type") == "Feature" else one for one in entries]
    if any(shape is not None and shape.get("type") not in SHAPES for shape in shapes):
        raise ValueError("this is no GeoJSON")
    crs = None
    if (named := document.get("crs")) is not None:
        name = named["properties"]["name"]
        fence.check_crs(name)
        crs = pyproj.CRS(name)
    written = [json.dumps(shape) for shape in shapes if shape is not None]
    return shapely.force_2d(np.atleast_1d(shapely.from_geojson(written))), crs


def _refuse_impossible(polygons: Polygons, label: str) -> None:
    """Raise UserError if coordinates cannot be degrees of longitude and latitude."""
    if not polygons.size:
        return
    west, south, east, north = shapely.total_bounds(polygons)
    if not (west >= -360 and east <= 360 and south >= -90 and north <= 90):
        raise UserError(
            f"{label}: its coordinates run over {west:g}..{east:g}, {south:g}..{north:g}; "
            "degrees of longitude (-180..360) and latitude (-90..90) are needed: convert it or state its projection"
        )


_HEADER = re.compile(r'\s*"([^"]*)"\s*,\s*"([^"]*)"\s*,\s*(-?\d{1,12})\s*$')


def _read_bna(path: Path, word: str, label: str) -> _Contents:
    """Return the polygons of NOAA's .bna: records of type 1 are land, of type 2 lakes.

    A negative count means a line. "Map Bounds" and "SpillableArea" (names in NOAA's GNOME) are
    frames, not land; a note says that the file covers only the map bounds.
    """
    lines = path.read_text(encoding="latin-1").splitlines()
    shores: list[Any] = []
    lakes: list[Any] = []
    notes: tuple[str, ...] = ()
    number = skipped = 0
    while number < len(lines):
        if not lines[number].strip():
            number += 1
            continue
        header = _HEADER.match(lines[number])
        if not header:
            raise UserError(
                f'{label}, line {number + 1}: not a .bna record ("name","type",count): {lines[number][:40]!r}'
            )
        name, kind, count = header[1].replace(" ", "").lower(), header[2], int(header[3])
        rows = lines[number + 1 : number + 1 + abs(count)]
        try:
            points = np.array([line.split(",")[:2] for line in rows], np.float64).reshape(-1, 2)
            if not count or len(points) != abs(count) or not np.isfinite(points).all():
                raise ValueError
        except ValueError:
            raise UserError(
                f'{label}, line {number + 1}: record "{header[1]}" needs {abs(count) or "some"} lines "lon,lat"'
            ) from None
        number += 1 + abs(count)
        if name == "mapbounds":
            (west, south), (east, north) = points.min(0), points.max(0)
            verb = "are" if word == "lakes" else "is"
            extent = f"{west:g}..{east:g} E, {south:g}..{north:g} N"
            notes = (f"the {word} {verb} known in {extent} only (its map bounds)",)
        elif name == "spillablearea" or count < 3 or kind not in ("1", "2"):
            skipped += name != "spillablearea"
        else:
            (shores if kind == "1" else lakes).append(shapely.Polygon(points))
    if skipped:
        notes += (
            f"{skipped} records of the {word} that are no polygons of land or lakes (lines, points) were left out",
        )
    polygons, water = np.array(shores, object), np.array(lakes, object)
    _refuse_impossible(np.concatenate([polygons, water]), label)
    return _Contents(polygons, water, notes, label)
