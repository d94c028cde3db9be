"""The shoreline cut into stretches: of a given length, or as named in a user's GeoJSON.

A stretch is a set of whole shoreline edges (geo.coast.edges.shoreline_edges), which are never split. The
shoreline between two landmarks is cut into equal lengths, as far as edges allow. Landmarks depend
only on the shore around them. So a coast has the same stretches in every domain, except near where
the domain's edge cuts it. Rings shorter than half a stretch, and pieces as short that a box or a
named stretch leaves of a coast, are no stretches of their own: all those in a square about one
stretch wide form one segment.

Lengths are great circles between the edges' ends. Distances for finding the nearest shoreline are
computed in a plane with longitudes scaled at the place in question: exact nearby, off by some
percent at 500 km.
"""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from geo import geohash, mixing, notation, sphere
from geo.array import Array
from geo.coast import edges as shoreline
from geo.coast.edges import Coast
from geo.coast.land_masses import LandMasses
from geo.errors import UserError
from geo.files import small as file

NEAR = 2_000.0  # [m] largest distance from a named line to its shoreline
METRES = np.pi * sphere.RADIUS / 180  # [m] in a degree of latitude
DEGREES = 360.0 / sphere.TURN  # [deg] in a binary angle unit
# [stretches] radius in which a landmark is the only one; with it, lengths between two landmarks
# divide into stretches within an eighth of the wanted length
REACH = 4.0
MARGIN = 1e-6  # of a stretch (1 cm of 10 km): far above the rounding of sums over a coast
ID_LENGTH = 9  # letters of an id: its geohash cell is 5 m wide
UNKNOWN = ""  # kind of shore that the user's file does not state

Ints = npt.NDArray[np.int32]
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Segments:
    """Stretches of shoreline, one per row, shape (n,)."""

    name: tuple[str, ...]  # unique
    length: Floats  # [m] along the shoreline
    lon: Floats  # [deg] of the midpoint, which lies on the shoreline; -180 to 180
    lat: Floats
    of_edge: Ints  # (edges,) segment of every shoreline edge, by the edge's number
    lines: Array  # shapely LineString or MultiLineString [deg], unwrapped around the coast's grid
    access: tuple[str, ...]  # kind of shore from the user's file; "" if it states none
    id: tuple[str, ...] = ()  # geohash of the midpoint: unique, and the same in every domain
    # the land whose shore these are; None if unknown
    land: LandMasses | None = None
    # number of each stretch's land mass, SEVERAL if it lies on several
    mass: npt.NDArray[np.int64] | None = None


@dataclass(frozen=True)
class _Feature:
    """A named line or polygon of a user's file."""

    name: str
    access: str
    shape: Any  # shapely line or polygon [deg], longitudes unwrapped


def cut_coast(coast: Coast, length: float = 10_000.0) -> Segments:
    """Return the coast cut into stretches of whole edges.

    Args:
        coast: to cut.
        length: of a stretch, approximately [m]; the stretches of a chain are equally long.
    """
    edge = shoreline.shoreline_edges(coast)
    return _build_segments(coast, edge, np.full(len(edge), -1), [], length)


def read_named_segments(
    coast: Coast, path: str | os.PathLike[str], rest: float = 10_000.0
) -> Segments:
    """Return the stretches of a user's GeoJSON in file order, then the rest of the coast.

    A polygon takes the edges with midpoints inside; a line takes those within NEAR of it, except
    those beyond its ends. An edge that several features could take belongs to the nearest of them,
    and to the first in the file if they are equally near. Feature properties: "name", required and
    unique, and "access".

    Args:
        coast: to divide.
        path: of the GeoJSON file.
        rest: length of the stretches into which the rest is cut [m].

    Raises:
        UserError: the file cannot be used, or a feature has no shoreline.
    """
    features = _read_features(Path(path))
    edge = shoreline.shoreline_edges(coast)
    lon, lat = _edge_midpoints(edge)
    owner, nearest_distance = np.full(len(edge), -1), np.full(len(edge), np.inf)
    for number, feature in enumerate(features):
        taken, distance = _edges_of_feature(feature.shape, lon, lat)
        if not taken.size:
            raise UserError(f'segments "{path}": {_no_shoreline_message(feature, coast)}')
        closer = distance < nearest_distance[taken]
        owner[taken[closer]], nearest_distance[taken[closer]] = number, distance[closer]
    empty = np.flatnonzero(np.bincount(owner[owner >= 0], minlength=len(features)) == 0)
    if empty.size:
        raise UserError(
            f'segments "{path}": all the shoreline of "{features[empty[0]].name}" is taken by other segments, which lie nearer '
            "or come first in the file; move or delete it"
        )
    return _build_segments(coast, edge, owner, features, rest)


def nearest_segment(
    segments: Segments, coast: Coast, lon_deg: float, lat_deg: float
) -> tuple[int, float]:
    """Return (segment, distance [m]) of the shoreline nearest to a point.

    (-1, inf) if there is no coast.
    """
    edge = shoreline.shoreline_edges(coast)
    if not len(edge):
        return -1, np.inf
    lon, lat = int(sphere.to_binary(lon_deg)), int(sphere.to_binary(lat_deg))
    squeeze = max(np.cos(np.deg2rad(lat_deg)), 1e-9)
    ax, ay = _shorter_arc(edge[:, 0] - np.int64(lon)) * squeeze, edge[:, 1] - float(lat)
    dx, dy = (
        _shorter_arc(edge[:, 2] - edge[:, 0].astype(np.int64)) * squeeze,
        edge[:, 3] - edge[:, 1].astype(float),
    )
    along = np.clip(-(ax * dx + ay * dy) / (dx * dx + dy * dy), 0, 1)
    x, y = ax + along * dx, ay + along * dy
    # among these, distances on the sphere decide
    near = np.argpartition(np.hypot(x, y), min(31, len(edge) - 1))[:32]
    to = (lon + x[near] / squeeze) * sphere.UNIT, (lat + y[near]) * sphere.UNIT
    distance = sphere.distance(np.deg2rad(lon_deg), np.deg2rad(lat_deg), *to)
    best = int(np.argmin(distance))
    return int(segments.of_edge[near[best]]), float(distance[best])


def segment_of_id(segments: Segments, text: str) -> int | None:
    """Return the stretch with an id, or, if another domain has cut this coast, the one there.

    None if the text is no id, or if its position is farther than NEAR from any stretch.
    """
    if text in segments.id:
        return segments.id.index(text)
    if len(text) < ID_LENGTH or not set(text) <= set(geohash.ALPHABET) or not len(segments.name):
        return None
    lon, lat = geohash.decode(text)
    at = np.radians(lon), np.radians(lat)
    away = sphere.distance(*at, np.radians(segments.lon), np.radians(segments.lat))
    near = np.argsort(away)[:64]
    squeeze = max(float(np.cos(np.radians(lat))), 1e-9)
    lines = [
        shapely.transform(
            segments.lines[k],
            lambda xy: np.stack([sphere.wrap_degrees(xy[:, 0] - lon) * squeeze, xy[:, 1] - lat], 1),
        )
        for k in near
    ]
    distance = shapely.distance(np.array(lines, object), shapely.Point(0, 0)) * METRES
    closest = int(np.argmin(distance))
    return int(near[closest]) if distance[closest] <= NEAR else None


def _geohash_ids(lon: Array, lat: Array) -> tuple[str, ...]:
    """Return the ids of stretches from their midpoints [deg].

    Midpoints are rounded to binary angles, so that rounding errors of a sum change no letter.
    """
    lon, lat = (np.floor(np.asarray(x) / DEGREES + 0.25) * DEGREES for x in (lon, lat))
    places = list(zip(sphere.wrap_degrees(lon).tolist(), lat.tolist(), strict=True))
    return _unique_names([geohash.encode(*place, ID_LENGTH) for place in places], "{name}{number}")


def _build_segments(
    coast: Coast, edge: Array, owner: Array, features: list[_Feature], length: float
) -> Segments:
    """Return the segments.

    owner: (edges,) feature of each edge, -1 for edges to be cut by length. length: of a stretch
    [m].
    """
    if not (np.isfinite(length) and length > 0):
        raise ValueError(f"length of a segment: {length} m; must be more than 0")
    order, chain, closed = _running_chains(edge, owner, REACH * length)
    a, size = np.deg2rad(edge[order, :2] * DEGREES).T, _edge_lengths(edge[order])
    total = np.bincount(chain, size)
    first = np.flatnonzero(np.diff(chain, prepend=-1))
    share = np.maximum(np.rint(total / length), 1)[chain]  # number of stretches in the edge's chain
    reached = np.cumsum(size)
    middle = reached - (reached - size)[first][chain] - size / 2
    # An edge's middle may lie exactly on a boundary, as in equal halves. The margin then decides,
    # because sums over the whole coast have rounding errors.
    stretch = np.minimum(np.floor(middle / total[chain] * share + MARGIN), share - 1)

    # Each edge gets a key: (0, feature, 0), (1, chain, stretch) or, if its chain is short, (2, row,
    # column) of a square. Each key becomes a segment; segments are numbered in the order of their
    # first edges.
    own_feature = owner[order]
    row = np.floor(a[1][first] * sphere.RADIUS / length)
    column = np.floor(
        a[0][first] * np.cos((row + 0.5) * length / sphere.RADIUS) * sphere.RADIUS / length
    )
    small = (total < length / 2)[chain] & (own_feature < 0)
    kind = np.where(own_feature >= 0, 0, np.where(small, 2, 1))
    key = np.stack(
        [
            kind,
            np.where(own_feature >= 0, own_feature, np.where(small, row[chain], chain)),
            np.where(small, column[chain], np.where(own_feature >= 0, 0, stretch)),
        ],
        axis=1,
    )
    _, begins, number = np.unique(key, axis=0, return_index=True, return_inverse=True)
    number = number.reshape(-1)
    rank = np.empty(len(begins), np.int64)
    unnamed = kind[begins] > 0  # named segments come first, in the user's order
    rank[np.lexsort((np.where(unnamed, begins, 0), unnamed))] = np.arange(len(begins))
    number = rank[number]

    # order a segment's chains by their marks, which do not depend on chain numbers
    mark = _random_marks(edge[order])[first][chain]
    by_segment = np.lexsort((np.arange(len(order)), mark, number))
    order, number, size = order[by_segment], number[by_segment], size[by_segment]
    of_edge = np.empty(len(edge), np.int32)
    of_edge[order] = number
    lengths = np.asarray(np.bincount(number, size, minlength=len(begins)), np.float64)
    lon, lat = _midpoints(edge[order], number, size)
    islets = np.bincount(number, (small & closed[chain])[by_segment], minlength=len(begins)) > 0
    pieces = np.bincount(number, small[by_segment], minlength=len(begins)) > 0
    prefixes = np.where(islets, "islets near ", np.where(pieces, "shore near ", ""))
    ids = _geohash_ids(lon, lat)
    generated = [
        f"{prefix}{notation.position(x, y)}"
        for prefix, x, y in zip(prefixes, lon, lat, strict=True)
    ][len(features) :]
    return Segments(
        name=_unique_names(
            [*(f.name for f in features), *generated],
            by=[*[""] * len(features), *ids[len(features) :]],
        ),
        length=lengths,
        lon=lon,
        lat=lat,
        of_edge=of_edge,
        lines=_segment_lines(coast, edge[order], number),
        access=(*(f.access for f in features), *[UNKNOWN] * len(generated)),
        id=ids,
    )


def _running_chains(edge: Array, label: Array, reach: float) -> tuple[Array, Array, Array]:
    """Return the edges in running order, the chain of each, and whether chains are part of a ring.

    A chain is a run of edges with one label, each beginning where the previous one ends, from
    landmark to landmark (see `_landmarks`). So stretches depend neither on the box nor on where a
    file happens to begin. Chains that the first point of a ring divides are joined.
    """
    if not len(edge):
        return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, bool)
    breaks = np.ones(len(edge), bool)
    breaks[1:] = (edge[1:, :2] != edge[:-1, 2:]).any(axis=1) | (label[1:] != label[:-1])
    first = np.flatnonzero(breaks)
    last = np.append(first[1:], len(edge)) - 1
    part = np.cumsum(breaks) - 1
    open_runs = np.flatnonzero((edge[first, :2] != edge[last, 2:]).any(axis=1))
    begins = {(label[first[c]], *edge[first[c], :2]): c for c in open_runs}
    follows = {
        c: begins[key] for c in open_runs if (key := (label[last[c]], *edge[last[c], 2:])) in begins
    }
    chain, place = np.arange(len(first)), np.zeros(len(first), np.int64)
    visited: set[int] = set()
    followers = set(follows.values())
    # runs that are still unvisited form rings
    for head in [*(c for c in open_runs if c not in followers), *open_runs]:
        c, steps = head, 0
        while c not in visited:
            visited.add(c)
            chain[c], place[c] = head, steps
            steps += 1
            if c not in follows:
                break
            c = follows[c]
    order = np.lexsort((np.arange(len(edge)), place[part], chain[part]))
    chain = np.unique(chain[part][order], return_inverse=True)[1].reshape(-1)
    first = np.flatnonzero(np.diff(chain, prepend=-1))
    count = np.diff(np.append(first, len(edge)))
    closed = (edge[order[first], :2] == edge[order[first + count - 1], 2:]).all(axis=1)
    landmark, least = _landmarks(edge[order], first, closed, reach)
    turned = np.where(closed, least - first, 0)[chain]
    within = (np.arange(len(edge)) - first[chain] - turned) % count[chain]
    running = np.lexsort((within, chain))
    begins = landmark[running] | (within[running] == 0)
    return order[running], np.cumsum(begins) - 1, closed[chain[begins]]


def _edge_lengths(edge: Array) -> Floats:
    """Return the great-circle lengths [m] of edges (n, 4) [binary angle], shape (n,)."""
    return np.asarray(
        sphere.distance(*np.deg2rad(edge[:, :2] * DEGREES).T, *np.deg2rad(edge[:, 2:] * DEGREES).T)
    )


def _random_marks(edge: Array) -> Array:
    """Return a random number for each edge (n, 4) that depends only on its first point, uint64."""
    place = edge[:, :2].astype(np.int32).view(np.uint32).astype(np.uint64)
    return mixing.mixed(place[:, 0] << np.uint64(32) | place[:, 1])


def _landmarks(edge: Array, first: Array, closed: Array, reach: float) -> tuple[Array, Array]:
    """Return which edges begin at a landmark (n,), and the edge with the least mark per chain (m,).

    A landmark has the least mark of all points within `reach` [m] to both sides along its chain,
    and the chain must extend as far. So a larger box has the same landmarks, and more.

    edge: in running order (n, 4). first: index of the first edge of each chain (m,). closed:
    whether the chain is a ring (m,).
    """
    mark, size, found = _random_marks(edge), _edge_lengths(edge), np.zeros(len(edge), bool)
    count, total = np.diff(np.append(first, len(edge))), np.add.reduceat(size, first)
    least = np.lexsort((mark, np.repeat(np.arange(len(first)), count)))[first]
    found[least[closed]] = True  # the least mark of its ring
    for chain in np.flatnonzero(total > 2 * reach):
        own = slice(first[chain], first[chain] + count[chain])
        at = np.cumsum(size[own]) - size[own]
        turns = np.array([-1, 0, 1] if closed[chain] else [0])
        around, marks = (total[chain] * turns[:, None] + at).ravel(), np.tile(mark[own], len(turns))
        candidates = np.flatnonzero(np.diff(at // reach, prepend=-1))
        # A landmark has the least mark of its part of length `reach`.
        best = np.minimum.reduceat(mark[own], candidates)
        candidates = np.flatnonzero(
            mark[own] == np.repeat(best, np.diff(np.append(candidates, len(at))))
        )
        if not closed[chain]:
            candidates = candidates[
                (at[candidates] >= reach) & (at[candidates] <= total[chain] - reach)
            ]
        for k in candidates:
            low, high = (
                np.searchsorted(around, at[k] - reach),
                np.searchsorted(around, at[k] + reach, "right"),
            )
            found[own.start + k] = mark[own][k] == marks[low:high].min()
    return found, least


def _midpoints(edge: Array, number: Array, size: Array) -> tuple[Floats, Floats]:
    """Return (lon, lat) [deg] of the point at half of each segment's length.

    The edges are sorted by segment.
    """
    first = np.flatnonzero(np.diff(number, prepend=-1))
    reached = np.cumsum(size)
    before = (reached - size)[first]
    half = before + np.add.reduceat(size, first) / 2 if len(first) else before
    last = np.append(first[1:], len(edge)) - 1
    middle = np.clip(np.searchsorted(reached, half), first, last)
    share = np.clip((half - (reached - size)[middle]) / size[middle], 0, 1)
    lon = edge[middle, 0] + share * _shorter_arc(edge[middle, 2] - edge[middle, 0].astype(np.int64))
    lat = edge[middle, 1] + share * (edge[middle, 3] - edge[middle, 1].astype(float))
    return sphere.wrap_degrees(lon * DEGREES), lat * DEGREES


def _segment_lines(coast: Coast, edge: Array, number: Array) -> Array:
    """Return each segment's line or lines [deg].

    The edges are sorted by segment and, within connected parts, in running order.
    """
    if not len(edge):
        return np.empty(0, object)
    centre = np.int64(coast.lon0) + (coast.nx << coast.shift) // 2
    ax = centre + _shorter_arc(edge[:, 0] - centre)
    bx = ax + _shorter_arc(edge[:, 2] - edge[:, 0].astype(np.int64))
    ends = np.stack([ax, edge[:, 1], bx, edge[:, 3]], axis=1) * DEGREES
    new = np.ones(len(edge), bool)
    new[1:] = (ends[1:, :2] != ends[:-1, 2:]).any(axis=1) | (number[1:] != number[:-1])
    # points of the lines: the start of each line's first edge, then the ends of its edges
    points = np.repeat(ends[:, 2:], 1 + new, axis=0)
    points[np.flatnonzero(new) + np.arange(new.sum())] = ends[new, :2]
    line = np.repeat(np.cumsum(new) - 1, 1 + new)
    lines = shapely.linestrings(points, indices=line)
    segment = number[new]
    lines_of = np.asarray(shapely.multilinestrings(lines, indices=segment))
    single = np.bincount(segment) == 1
    lines_of[single] = shapely.get_geometry(lines_of[single], 0)
    return lines_of


def _unique_names(
    names: list[str], again: str = "{name} ({number})", by: list[str] | None = None
) -> tuple[str, ...]:
    """Return names with " (2)", " (3)" after repeated ones, numbered in the order of `by`.

    None: in the given order.
    """
    used: set[str] = set()
    times: dict[str, int] = {}
    unique = list(names)
    for k in range(len(names)) if by is None else sorted(range(len(names)), key=by.__getitem__):
        name = new = names[k]
        while new in used:
            times[name] = times.get(name, 1) + 1
            new = again.format(name=name, number=times[name])
        used.add(new)
        unique[k] = new
    return tuple(unique)


def _shorter_arc(units: Array) -> Floats:
    """Return differences of binary longitudes along the shorter arc."""
    return np.asarray(units.astype(np.int64).astype(np.int32), np.float64)


def _edge_midpoints(edge: Array) -> tuple[Floats, Floats]:
    """Return the midpoints (lon, lat) [deg] of edges; longitudes may exceed 180 by half an edge."""
    half = _shorter_arc(edge[:, 2] - edge[:, 0].astype(np.int64)) / 2
    return (edge[:, 0] + half) * DEGREES, (edge[:, 1] / 2 + edge[:, 3] / 2) * DEGREES


def _edges_of_feature(shape: Any, lon: Floats, lat: Floats) -> tuple[Array, Floats]:
    """Return the edges that a feature takes, by their midpoints [deg], and their distances [m]."""
    west, south, east, north = shape.bounds
    centre, squeeze = (west + east) / 2, np.cos(np.deg2rad((south + north) / 2))
    margin = NEAR / METRES
    x, y = sphere.wrap_degrees(lon - centre), lat
    half_width = (east - west) / 2 + margin / max(
        np.cos(np.deg2rad(min(max(abs(south), abs(north)) + margin, 90))), 1e-3
    )
    near = np.flatnonzero((np.abs(x) <= half_width) & (y >= south - margin) & (y <= north + margin))
    points = shapely.points(x[near] * squeeze * METRES, y[near] * METRES)
    plane = shapely.transform(shape, lambda p: (p - [centre, 0.0]) * [squeeze * METRES, METRES])
    shapely.prepare(plane)
    if plane.geom_type.endswith("Polygon"):
        inside = np.asarray(shapely.intersects(plane, points))
        return near[inside], np.zeros(inside.sum())
    distance = np.asarray(shapely.distance(plane, points))
    near, points, distance = (
        near[distance <= NEAR],
        points[distance <= NEAR],
        distance[distance <= NEAR],
    )
    ends = shapely.boundary(plane)  # empty for a closed line
    # without ends the distance is NaN, so the comparison is False
    beyond = np.asarray(shapely.distance(ends, points)) <= distance * (1 + 1e-9)
    beyond &= ~beyond.all()
    return near[~beyond], distance[~beyond]


def _no_shoreline_message(feature: _Feature, coast: Coast) -> str:
    """Return a message that says why a feature has no shoreline, and what to do."""
    middle = feature.shape.point_on_surface()
    nearest = shoreline.nearest_coast(coast, float(sphere.wrap_degrees(middle.x)), float(middle.y))
    hint = "the domain has no coast"
    if nearest:
        middle_text, coast_text = (
            notation.position(middle.x, middle.y),
            notation.position(*nearest[:2]),
        )
        hint = (
            f"the nearest coast is {nearest[2] / 1000:.1f} km from {middle_text}, at {coast_text}"
        )
    allowed = (
        "a polygon must hold the middle of a shoreline edge"
        if feature.shape.geom_type.endswith("Polygon")
        else f"a line must run within {NEAR / 1000:g} km of the shoreline"
    )
    return f'"{feature.name}" matches no shoreline: {hint}; {allowed}. Move it or delete it'


def _read_features(path: Path) -> list[_Feature]:
    """Return the features of a GeoJSON file; raise UserError unless all are named and usable."""
    needed = "give a GeoJSON file of lines or polygons, each with a name"
    try:
        content = json.loads(file.read_small_file(path).decode("utf-8-sig"))
    except FileNotFoundError:
        raise UserError(f'segments "{path}": no such file; {needed}') from None
    except OSError as error:
        raise UserError(f'segments "{path}": cannot be read ({error.strerror}); {needed}') from None
    except (ValueError, RecursionError) as error:
        # UnicodeDecodeError and JSONDecodeError are ValueErrors
        raise UserError(
            f'segments "{path}": not GeoJSON ({str(error).splitlines()[0]}); {needed}'
        ) from None
    kind = content.get("type") if isinstance(content, dict) else None
    entries = (
        content.get("features")
        if kind == "FeatureCollection"
        else [content]
        if kind == "Feature"
        else None
    )
    if not isinstance(entries, list):
        raise UserError(f'segments "{path}": not a GeoJSON FeatureCollection; {needed}')
    if not entries:
        raise UserError(f'segments "{path}": holds no feature; {needed}')
    features: list[_Feature] = []
    for number, row in enumerate(entries, 1):
        try:
            feature = _feature(row)
            if any(feature.name == other.name for other in features):
                raise ValueError(f'name "{feature.name}" comes twice; names must be unique')
        except ValueError as error:
            raise UserError(f'segments "{path}", feature {number}: {error}') from None
        features.append(feature)
    return features


def _feature(row: Any) -> _Feature:
    """Return a feature from its JSON; raise ValueError with a message for users if unusable."""
    if not isinstance(row, dict) or row.get("type") != "Feature":
        raise ValueError("is no GeoJSON Feature")
    properties = row.get("properties") or {}
    name = properties.get("name") if isinstance(properties, dict) else None
    if isinstance(name, (int, float)) and not isinstance(name, bool):
        name = f"{name:g}"
    if not isinstance(name, str) or not name.strip():
        raise ValueError(
            'has no name; write one into its properties: "properties": {"name": "Grand Isle"}'
        )
    name = " ".join(name.split())
    access = properties.get("access")
    if access is None:
        access = UNKNOWN
    elif not isinstance(access, str) or not access.strip():
        raise ValueError(
            f'"{name}": access is {access!r}; must be a word such as "town", "road" or "wild"'
        )
    geometry = row.get("geometry")
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if kind not in ("LineString", "MultiLineString", "Polygon", "MultiPolygon"):
        raise ValueError(
            f'"{name}" is a {kind or "feature without geometry"}; must be a line or a polygon'
        )
    try:
        shape = shapely.force_2d(shapely.from_geojson(json.dumps(geometry)))
    except shapely.errors.GEOSException as error:
        raise ValueError(f'"{name}": {str(error).splitlines()[0]}') from None
    if shape.is_empty:
        raise ValueError(f'"{name}" is an empty {kind}')
    x, y = shapely.get_coordinates(shape).T
    if not (np.abs(x) <= 360).all() or not (np.abs(y) <= 90).all():
        raise ValueError(
            f'"{name}": coordinates must be degrees, lon -180..360 and lat -90..90, in that order'
        )
    shape = _unwrap_geometry(shape)
    if kind.endswith("Polygon"):
        # Repairing a polygon that crosses itself may leave lines, for which other rules hold: keep
        # only polygons.
        parts = shapely.get_parts(shapely.get_parts(shapely.make_valid(shape)))
        shape = shapely.multipolygons(parts[shapely.get_type_id(parts) == 3])
        if shape.is_empty:
            raise ValueError(f'"{name}" is a {kind} without area')
    return _Feature(name, " ".join(access.split()), shape)


def _unwrap_geometry(shape: Any) -> Any:
    """Return a geometry without jumps at the antimeridian.

    All its parts lie within half a turn of the first one.
    """
    reference: list[float] = []

    def unwrap(points: Array) -> Array:
        lon = np.unwrap(points[:, 0], period=360)
        reference.append(reference[0] if reference else lon.mean())
        return np.stack(
            [lon - 360 * np.round((lon.mean() - reference[0]) / 360), points[:, 1]], axis=1
        )

    parts = []
    for part in shapely.get_parts(shape):
        if part.geom_type == "Polygon":
            outer, *inner = (
                unwrap(shapely.get_coordinates(ring)) for ring in shapely.get_rings(part)
            )
            parts.append(shapely.Polygon(outer, inner))
        else:
            parts.append(shapely.LineString(unwrap(shapely.get_coordinates(part))))
    return (
        shapely.MultiPolygon(parts)
        if shape.geom_type.endswith("Polygon")
        else shapely.MultiLineString(parts)
    )
