"""Land polygons in: GSHHG out of roaring-landmask, or the user's own shoreline, cut to a box.

Polygons are shapely polygons in degrees, unwrapped round the box (so a box over the antimeridian holds longitudes
above 180), cut at the box rounded outward to whole degrees plus MARGIN. What comes in broken (rings that cross
themselves, polygons that overlap) is mended and said in `notes`; a shoreline without polygons is refused.

Lakes are land, for nothing that drifts at sea gets there, unless they are asked for: the inner rings of a file's own
polygons, or a file of lake polygons. A .bna tells lakes by their type, and NOAA's hold those that the sea reaches
(Pontchartrain, Maurepas): they are water always. GSHHG comes without lakes.
"""

import gzip
import hashlib
import importlib.metadata
import os
import re
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import platformdirs
import shapely

from geo.box import Box
from geo.errors import UserError

VAST = 4_000.0  # [deg2] a box of which a look need not show every rock
ISLET = 0.05  # [deg] extent under which an island is left out of such a look
THIN, FEWEST = 16, 12  # of its vertices one in so many, but at least about so many
MARGIN = 0.25  # [deg] kept beyond the rounded box, so that the cut lines lie outside every grid of geo.coast.edges

Polygons = npt.NDArray[Any]  # of shapely.Polygon


@dataclass(frozen=True)
class Shore:
    """Land polygons [deg], where they come from, what was done to them, and the box they are cut to."""

    polygons: Polygons
    source: str
    notes: tuple[str, ...] = ()
    box: Box | None = None


@dataclass(frozen=True)
class _Contents:
    """What a file holds: polygons, those a .bna calls lakes, what was done to them; says: what messages call the file."""

    polygons: Polygons
    lakes: Polygons
    notes: tuple[str, ...]
    says: str


def land(source: str | os.PathLike[str], box: Box, lakes: bool | str | os.PathLike[str] = False) -> Shore:
    """Return the land in a box, from "gshhg", a file (.bna, GeoJSON, shapefile, ...) or "none".

    lakes: False: inner rings of the source's polygons are land; True: they are water; a file: its polygons are water
    (of a .bna with records of type 2, those), its islands land, whatever the source. Type 2 of a .bna source is water.
    Raises UserError for files that can't be understood, and for lakes where there are none to have.
    """
    cut = _rounded(box)
    name = os.fspath(source)
    kind = name.lower()
    if lakes is True and kind == "gshhg":
        raise UserError(
            'lakes = true: GSHHG as installed holds no lakes; name a file of lake polygons (lakes = "lakes.geojson"), or '
            "leave lakes out and all inside its shores is land"
        )
    if lakes and kind == "none":
        raise UserError(
            'lakes: with the coast "none" there is no land to cut them from; leave lakes out or name a coast'
        )
    if kind == "none":
        return Shore(np.empty(0, object), "none", ("no coast: particles pass over land",), cut)
    notes: tuple[str, ...] = ()
    if kind == "gshhg":
        version = importlib.metadata.version("roaring-landmask")
        polygons = _cached(f"gshhg-{version}_{cut.west:g}_{cut.south:g}_{cut.east:g}_{cut.north:g}.wkb.gz", cut)
        origin = f"GSHHG, full resolution (roaring-landmask {version})"
    else:
        polygons, notes = _of_file(Path(name), lakes is True)
        polygons = clip(polygons, cut)
        if not polygons.size:
            notes += (f"none of its land lies in {_spoken(box)}",)
        origin = _signed(name)
    if lakes and lakes is not True:
        polygons, said = _without(polygons, Path(lakes), cut, box)
        origin, notes = f"{origin}, lakes {_signed(lakes)}", notes + said
    return Shore(polygons, origin, notes, cut)


def _of_file(path: Path, lakes: bool) -> tuple[Polygons, tuple[str, ...]]:
    """Return the land of a user's file; lakes: whether its inner rings are water."""
    found = _read(path, "shoreline", 'a .bna, GeoJSON or shapefile, "gshhg" or "none"')
    polygons, notes = found.polygons, found.notes
    if not polygons.size:
        raise UserError(f'{found.says}: holds no land polygon; give polygons of land, "gshhg" or "none"')
    rings = int(shapely.get_num_interior_rings(polygons).sum())
    if rings and not lakes:
        polygons = shapely.polygons(shapely.get_exterior_ring(polygons))
        notes += (f"{rings} inner rings of the shoreline (lakes) are land; lakes = true makes them water",)
    polygons, mended = _mend(polygons)
    if not polygons.size:
        raise UserError(f'{found.says}: holds no land polygon; give polygons of land, "gshhg" or "none"')
    notes += mended
    if found.lakes.size:
        water = shapely.union_all(shapely.make_valid(found.lakes))
        polygons = _polygonal(shapely.difference(polygons, water))
    if found.lakes.size or (lakes and rings):
        notes += (f"{rings * lakes + found.lakes.size} lakes of the shoreline are water",)
    elif lakes:
        notes += ("lakes were asked for, but the shoreline holds none",)
    return polygons, notes


def _without(land: Polygons, path: Path, cut: Box, box: Box) -> tuple[Polygons, tuple[str, ...]]:
    """Return land (cut to a box) without the lakes of a file, and what was done."""
    found = _read(path, "lakes", "a .bna, GeoJSON or shapefile of lake polygons")
    lakes = found.lakes if found.lakes.size else found.polygons
    if not lakes.size:
        raise UserError(f"{found.says}: holds no polygon; give polygons of lakes")
    total = lakes.size
    broken = int((~shapely.is_valid(lakes)).sum())
    water = clip(_polygonal(shapely.make_valid(lakes)), cut)  # before they are joined: a world of lakes is large
    notes = found.notes
    if broken:
        notes += (f"{broken} of {total} lakes crossed themselves and were repaired",)
    if not water.size:
        return land, (*notes, f"none of the {total} lakes of {path.name} lies in {_spoken(box)}")
    near, touched = shapely.STRtree(land).query(water, "intersects")[::-1]
    wet = np.unique(near)
    parts = _polygonal(shapely.difference(land[wet], shapely.union_all(water)))
    count = np.unique(touched).size
    return (
        np.concatenate([np.delete(land, wet), parts]),
        (*notes, f"{count} lakes of {path.name}, or parts of them, are water"),
    )


def _signed(path: str | os.PathLike[str]) -> str:
    """Return a file's name and a digest of what it holds."""
    return f"{Path(path).name} (sha256 {hashlib.sha256(Path(path).read_bytes()).hexdigest()[:12]})"


def _spoken(box: Box) -> str:
    return f"{box.west:g}..{box.east:g} E, {box.south:g}..{box.north:g} N"


def clip(polygons: Polygons, box: Box) -> Polygons:
    """Return the polygons' parts in a box, shifted by whole turns to its longitudes and joined at 180."""
    bounds = shapely.bounds(polygons)
    pieces = []
    for turn in (-360.0, 0.0, 360.0):
        near = (bounds[:, 0] + turn <= box.east) & (bounds[:, 2] + turn >= box.west)
        near &= (bounds[:, 1] <= box.north) & (bounds[:, 3] >= box.south)
        shifted = polygons[near]
        if turn:
            shifted = shapely.transform(shifted, lambda x, turn=turn: x + np.array([turn, 0.0]))
        west, south, east, north = shapely.bounds(shifted).T
        rim = (west <= box.west) | (south <= box.south) | (east >= box.east) | (north >= box.north)
        shifted[rim] = shapely.clip_by_rect(shifted[rim], box.west, box.south, box.east, box.north)
        pieces.append(shifted)
    parts = _polygonal(np.concatenate(pieces))
    seams = [x for x in (-180.0, 180.0, 540.0) if box.west < x < box.east]
    if not seams or not parts.size:
        return parts
    bounds = shapely.bounds(parts)
    at_seam = np.any([(bounds[:, 0] == x) | (bounds[:, 2] == x) for x in seams], axis=0)
    return np.concatenate([parts[~at_seam], _polygonal(np.array([shapely.union_all(parts[at_seam])]))])


def thinned(shore: Shore) -> Shore:
    """Return land to be looked at, not drifted by: of a vast box without islets and with a vertex every few km.

    Its shores lie up to some THIN vertices (of GSHHG: 3 km) off. Land with inner rings, and of a box that is not vast,
    stays as it is.
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
    kept = (place % every[ring] == 0) | (place == count[ring] - 1)
    made = shapely.polygons(shapely.linearrings(points[kept], indices=ring[kept]))
    note = "the domain is vast: its coast was looked at without islets and to some 3 km; a run takes it in full"
    return Shore(made, shore.source, (*shore.notes, note), box)


def _rounded(box: Box) -> Box:
    south, north = max(np.floor(box.south) - MARGIN, -90.0), min(np.ceil(box.north) + MARGIN, 90.0)
    west, east = np.floor(box.west) - MARGIN, np.ceil(box.east) + MARGIN
    if east - west >= 360:
        west, east = -180.0, 180.0
    return Box(float(west), float(south), float(east), float(north))


def _polygonal(geometries: Polygons) -> Polygons:
    """Return the polygons in geometries and collections; lines, points and empties are left out."""
    parts = shapely.get_parts(shapely.get_parts(geometries))
    return np.asarray(parts[(shapely.get_type_id(parts) == 3) & ~shapely.is_empty(parts)])


def _mend(polygons: Polygons) -> tuple[Polygons, tuple[str, ...]]:
    """Return polygons that neither cross themselves nor overlap, and what was done."""
    notes: tuple[str, ...] = ()
    broken = ~shapely.is_valid(polygons)
    if broken.any():
        polygons = np.where(broken, shapely.make_valid(polygons), polygons)
        notes = (f"{broken.sum()} of {broken.size} shoreline polygons crossed themselves and were repaired",)
    return _polygonal(np.array([shapely.union_all(polygons)])), notes


def cache_folder() -> Path:
    """Return the folder of cached land: DRIFT_CACHE, or the user's cache folder of this system."""
    return Path(os.environ.get("DRIFT_CACHE") or platformdirs.user_cache_dir("casp-drift"))


def _cached(name: str, box: Box) -> Polygons:
    path = cache_folder() / name
    try:
        return np.asarray(shapely.get_parts(shapely.from_wkb(gzip.decompress(path.read_bytes()))))
    except (OSError, EOFError, shapely.errors.GEOSException):
        polygons = clip(_gshhg(), box)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=name, delete=False) as file:
            file.write(gzip.compress(shapely.to_wkb(shapely.multipolygons(polygons)), 1, mtime=0))
        os.replace(file.name, path)
    except OSError:  # a cache that cannot be written costs seconds next time, not the run
        pass
    return polygons


def _gshhg() -> Polygons:
    # Shapes.wkb takes 2.4 s; the package's RoaringLandmask.new() would take 6 s and 1.3 GB.
    from roaring_landmask import LandmaskProvider, Shapes

    return np.asarray(shapely.get_parts(shapely.from_wkb(Shapes.wkb(LandmaskProvider.Gshhg))))


def _read(path: Path, word: str, wanted: str) -> _Contents:
    """Read a file's polygons; word: "shoreline" or "lakes", wanted: what may stand in its place, both for messages."""
    says = f'{word} "{path}"'
    if not path.is_file():
        raise UserError(f"{says}: no such file; give {wanted}")
    if path.suffix.lower() == ".bna":
        return _read_bna(path, word, says)
    import pyogrio
    import pyproj

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # GDAL's, on what is refused or mended below
            meta, _, wkb, _ = pyogrio.raw.read(path, layer=0, columns=[], force_2d=True)
        geometries = shapely.from_wkb(wkb if wkb is not None else np.empty(0, object))  # None: a table without places
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, shapely.errors.GEOSException) as error:
        reason = str(error).splitlines()[0]
        raise UserError(f"{says}: cannot be read ({reason}); give a .bna, GeoJSON or shapefile") from None
    notes: tuple[str, ...] = ()
    if meta["crs"] and pyproj.CRS(meta["crs"]).is_projected:
        turn = pyproj.Transformer.from_crs(meta["crs"], "EPSG:4326", always_xy=True).transform
        geometries = shapely.transform(geometries, turn, interleaved=False)
        notes = (f"{word} converted from {pyproj.CRS(meta['crs']).name} to longitude and latitude",)
    polygons = _polygonal(geometries[~shapely.is_missing(geometries)])
    _refuse_impossible(polygons, says)
    return _Contents(polygons, np.empty(0, object), notes, says)


def _refuse_impossible(polygons: Polygons, says: str) -> None:
    if not polygons.size:
        return
    west, south, east, north = shapely.total_bounds(polygons)
    if not (west >= -360 and east <= 360 and south >= -90 and north <= 90):
        raise UserError(
            f"{says}: its coordinates run over {west:g}..{east:g}, {south:g}..{north:g}; "
            "degrees of longitude (-180..360) and latitude (-90..90) are needed: convert it or state its projection"
        )


_HEADER = re.compile(r'\s*"([^"]*)"\s*,\s*"([^"]*)"\s*,\s*(-?\d{1,12})\s*$')


def _read_bna(path: Path, word: str, says: str) -> _Contents:
    """Read NOAA's .bna: records of type 1 are land, of type 2 lakes in it; a negative count is a line.

    "Map Bounds" and "SpillableArea" (names of NOAA's GNOME) are frames, not land: outside the map bounds the file
    knows nothing, and that is a note.
    """
    lines = path.read_text(encoding="latin-1").splitlines()
    shores: list[Any] = []
    lakes: list[Any] = []
    notes: tuple[str, ...] = ()
    at = skipped = 0
    while at < len(lines):
        if not lines[at].strip():
            at += 1
            continue
        header = _HEADER.match(lines[at])
        if not header:
            raise UserError(f'{says}, line {at + 1}: not a .bna record ("name","type",count): {lines[at][:40]!r}')
        name, kind, count = header[1].replace(" ", "").lower(), header[2], int(header[3])
        body = lines[at + 1 : at + 1 + abs(count)]
        try:
            points = np.array([line.split(",")[:2] for line in body], np.float64).reshape(-1, 2)
            if not count or len(points) != abs(count) or not np.isfinite(points).all():
                raise ValueError
        except ValueError:
            raise UserError(
                f'{says}, line {at + 1}: record "{header[1]}" needs {abs(count) or "some"} lines "lon,lat"'
            ) from None
        at += 1 + abs(count)
        if name == "mapbounds":
            (west, south), (east, north) = points.min(0), points.max(0)
            notes = (
                f"the {word} {'are' if word == 'lakes' else 'is'} known in {west:g}..{east:g} E, {south:g}..{north:g} N only (its map bounds)",
            )
        elif name == "spillablearea" or count < 3 or kind not in ("1", "2"):
            skipped += name != "spillablearea"
        else:
            (shores if kind == "1" else lakes).append(shapely.Polygon(points))
    if skipped:
        notes += (
            f"{skipped} records of the {word} that are no polygons of land or lakes (lines, points) were left out",
        )
    polygons, water = np.array(shores, object), np.array(lakes, object)
    _refuse_impossible(np.concatenate([polygons, water]), says)
    return _Contents(polygons, water, notes, says)
