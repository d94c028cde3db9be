"""Land polygons in: GSHHG out of roaring-landmask, or the user's own shoreline, cut to a box.

Polygons are shapely polygons in degrees, unwrapped round the box (so a box over the antimeridian holds longitudes
above 180), cut at the box rounded outward to whole degrees plus MARGIN. What comes in broken (rings that cross
themselves, polygons that overlap) is mended and said in `notes`; a shoreline without polygons is refused.
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

MARGIN = 0.25  # [deg] kept beyond the rounded box, so that the cut lines lie outside every grid of geo.coast

Polygons = npt.NDArray[Any]  # of shapely.Polygon


@dataclass(frozen=True)
class Shore:
    """Land polygons [deg], where they come from, what was done to them, and the box they are cut to."""

    polygons: Polygons
    source: str
    notes: tuple[str, ...] = ()
    box: Box | None = None


def land(source: str | os.PathLike[str], box: Box) -> Shore:
    """Return the land in a box, from "gshhg", a file (.bna, GeoJSON, shapefile, ...) or "none"."""
    cut = _rounded(box)
    name = os.fspath(source)
    if name.lower() == "none":
        return Shore(np.empty(0, object), "none", ("no coast: particles pass over land",), cut)
    if name.lower() == "gshhg":
        version = importlib.metadata.version("roaring-landmask")
        polygons = _cached(f"gshhg-{version}_{cut.west:g}_{cut.south:g}_{cut.east:g}_{cut.north:g}.wkb.gz", cut)
        return Shore(polygons, f"GSHHG, full resolution (roaring-landmask {version})", (), cut)
    polygons, notes = _read(Path(name))
    polygons, mended = _mend(polygons)
    if not polygons.size:
        raise UserError(f'shoreline "{name}": holds no land polygon; give polygons of land, "gshhg" or "none"')
    notes += mended
    polygons = clip(polygons, cut)
    if not polygons.size:
        notes += (f"none of its land lies in {box.west:g}..{box.east:g} E, {box.south:g}..{box.north:g} N",)
    digest = hashlib.sha256(Path(name).read_bytes()).hexdigest()[:12]
    return Shore(polygons, f"{Path(name).name} (sha256 {digest})", notes, cut)


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
        pieces.append(shapely.clip_by_rect(shifted, box.west, box.south, box.east, box.north))
    parts = _polygonal(np.concatenate(pieces))
    seams = [x for x in (-180.0, 180.0, 540.0) if box.west < x < box.east]
    if not seams or not parts.size:
        return parts
    bounds = shapely.bounds(parts)
    at_seam = np.any([(bounds[:, 0] == x) | (bounds[:, 2] == x) for x in seams], axis=0)
    return np.concatenate([parts[~at_seam], _polygonal(np.array([shapely.union_all(parts[at_seam])]))])


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


def _read(path: Path) -> tuple[Polygons, tuple[str, ...]]:
    if not path.is_file():
        raise UserError(f'shoreline "{path}": no such file; give a .bna, GeoJSON or shapefile, "gshhg" or "none"')
    if path.suffix.lower() == ".bna":
        return _read_bna(path)
    import pyogrio
    import pyproj

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # GDAL's, on what is refused or mended below
            meta, _, wkb, _ = pyogrio.raw.read(path, layer=0, columns=[], force_2d=True)
        geometries = shapely.from_wkb(wkb if wkb is not None else np.empty(0, object))  # None: a table without places
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, shapely.errors.GEOSException) as error:
        reason = str(error).splitlines()[0]
        raise UserError(f'shoreline "{path}": cannot be read ({reason}); give a .bna, GeoJSON or shapefile') from None
    notes: tuple[str, ...] = ()
    if meta["crs"] and pyproj.CRS(meta["crs"]).is_projected:
        turn = pyproj.Transformer.from_crs(meta["crs"], "EPSG:4326", always_xy=True).transform
        geometries = shapely.transform(geometries, turn, interleaved=False)
        notes = (f"shoreline converted from {pyproj.CRS(meta['crs']).name} to longitude and latitude",)
    polygons = _polygonal(geometries[~shapely.is_missing(geometries)])
    _refuse_impossible(polygons, path)
    return polygons, notes


def _refuse_impossible(polygons: Polygons, path: Path) -> None:
    if not polygons.size:
        return
    west, south, east, north = shapely.total_bounds(polygons)
    if not (west >= -360 and east <= 360 and south >= -90 and north <= 90):
        raise UserError(
            f'shoreline "{path}": its coordinates run over {west:g}..{east:g}, {south:g}..{north:g}; '
            "degrees of longitude (-180..360) and latitude (-90..90) are needed: convert it or state its projection"
        )


_HEADER = re.compile(r'\s*"([^"]*)"\s*,\s*"([^"]*)"\s*,\s*(-?\d{1,12})\s*$')


def _read_bna(path: Path) -> tuple[Polygons, tuple[str, ...]]:
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
            raise UserError(
                f'shoreline "{path}", line {at + 1}: not a .bna record ("name","type",count): {lines[at][:40]!r}'
            )
        name, kind, count = header[1].replace(" ", "").lower(), header[2], int(header[3])
        body = lines[at + 1 : at + 1 + abs(count)]
        try:
            points = np.array([line.split(",")[:2] for line in body], np.float64).reshape(-1, 2)
            if not count or len(points) != abs(count) or not np.isfinite(points).all():
                raise ValueError
        except ValueError:
            raise UserError(
                f'shoreline "{path}", line {at + 1}: record "{header[1]}" needs {abs(count) or "some"} lines "lon,lat"'
            ) from None
        at += 1 + abs(count)
        if name == "mapbounds":
            (west, south), (east, north) = points.min(0), points.max(0)
            notes = (f"the shoreline is known in {west:g}..{east:g} E, {south:g}..{north:g} N only (its map bounds)",)
        elif name == "spillablearea" or count < 3 or kind not in ("1", "2"):
            skipped += name != "spillablearea"
        else:
            (shores if kind == "1" else lakes).append(shapely.Polygon(points))
    if skipped:
        notes += (f"{skipped} records of the shoreline that are no land polygons (lines, points) were left out",)
    polygons = np.array(shores, object)
    _refuse_impossible(polygons, path)
    if lakes and shores:
        water = shapely.union_all(shapely.make_valid(np.array(lakes, object)))
        polygons, mended = _mend(polygons)
        polygons = _polygonal(shapely.difference(polygons, water))
        notes += (*mended, f"{len(lakes)} lakes of the shoreline are water")
    return polygons, notes
