"""Read lane networks: named nodes, the lanes between them, and areas to patrol.

A TOML file has [[node]], [[lane]] and [[area]] tables. A GeoJSON file has the same keys as
properties of features: points are nodes, lines lanes, polygons areas. All mistakes of a file are
reported at once, one per line; messages name lanes by their nodes.
"""

import difflib
import itertools
import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError, model_validator

from drift.case.values import fields, messages, mistakes
from drift.case.values.places import AreaTable
from drift.engine.motion.steering.lanes import Network
from geo import sphere
from geo.errors import UserError
from geo.files import small
from geo.notation import NMI

LARGEST = 16 * 2**20  # [bytes] of a network file
# [m] longest lane: its projection is valid to a quarter of the Earth's circumference
LONGEST = 5_000 * NMI
SHORTEST = 1.0  # [m] shortest lane
ASTRAY = NMI  # [m] largest distance of a line's end in GeoJSON from its node


@dataclass(frozen=True)
class Chart:
    """The contents of a file: the network, and corners (lon, lat) [deg] of areas by name.

    Longitudes are continuous across 180 degrees.
    """

    network: Network
    areas: Mapping[str, tuple[tuple[float, float], ...]]


class NodeTable(fields.Table):
    """A [[node]]: where lanes begin, meet and end."""

    name: fields.Label
    """Name of the node, used by lanes and routes."""
    at: fields.Position
    """Position of the node."""


class LaneTable(fields.Table):
    """A [[lane]] from one node to another, or a chain of lanes through a list of nodes."""

    from_: fields.Label | None = Field(None, alias="from")
    """Node at one end; needs `to`."""
    to: fields.Label | None = None
    """Node at the other end; needs `from`."""
    through: list[fields.Label] | None = None
    """In place of `from` and `to`: nodes in order, with a lane between each two."""
    width: fields.Width
    """Full width of the lane."""
    one_way: bool = False
    """`true`: the lane is followed only from the first to the last node."""

    @model_validator(mode="after")
    def complete(self) -> "LaneTable":
        """Reject a lane whose ends are missing or given twice."""
        given = {name for name in ("from_", "to", "through") if getattr(self, name) is not None}
        if given not in ({"from_", "to"}, {"through"}):
            found = ", ".join(sorted(name.rstrip("_") for name in given)) or "nothing"
            raise ValueError(f"give from and to, or through (a list of nodes); found {found}")
        if self.through is not None and len(self.through) < 2:
            raise ValueError(
                f"through names {len(self.through)} node{'s' * (not self.through)}; at least 2 are needed"
            )
        return self

    def pairs(self) -> list[tuple[str, str]]:
        """Return the two nodes of each lane."""
        return list(itertools.pairwise(self.through or [self.from_ or "", self.to or ""]))


class PatrolAreaTable(fields.Table):
    """An [[area]]: a polygon to patrol."""

    name: fields.Label
    """Name of the area."""
    polygon: list[fields.Position]
    """Corners of the area in order."""

    @model_validator(mode="after")
    def simple(self) -> "PatrolAreaTable":
        """Reject corners that do not enclose exactly one area."""
        self.corners()
        return self

    def corners(self) -> list[tuple[float, float]]:
        """Return the corners (lon, lat) [deg], with longitudes continuous across 180 degrees."""
        return AreaTable.model_construct(polygon=self.polygon).corners()


class NetworkTable(fields.Table):
    """A network file."""

    title: fields.Label | None = None
    """Title of the network."""
    node: Annotated[list[NodeTable], Field(min_length=1)]
    """Nodes, where lanes begin, meet and end."""
    lane: Annotated[list[LaneTable], Field(min_length=1)]
    """Lanes between nodes."""
    area: list[PatrolAreaTable] = Field(default_factory=list)
    """Polygons to patrol."""

    @model_validator(mode="after")
    def consistent(self) -> "NetworkTable":
        """Reject duplicate names, duplicate or invalid lanes, and nodes without a lane."""
        fields.refuse(self, [*self._names(), *self._lanes()])
        return self

    def _names(self) -> Iterator[str]:
        for what, tables in (("node", self.node), ("area", self.area)):
            names = [table.name for table in tables]
            for name in dict.fromkeys(names):
                if names.count(name) > 1:
                    yield f'{what} "{name}": {names.count(name)} {what}s have this name; give each its own'

    def _lanes(self) -> Iterator[str]:
        places = {node.name: np.radians(node.at) for node in self.node}
        ways: set[tuple[str, str]] = set()
        used: set[str] = set()
        for lane in self.lane:
            for a, b in lane.pairs():
                place = f'lane "{a} - {b}"'
                unknown = [name for name in (a, b) if name not in places]
                yield from (
                    f'{place}: no node "{name}"; {_nearest(name, places)}' for name in unknown
                )
                used |= {a, b}
                if unknown:
                    continue
                length = float(sphere.distance(*places[a], *places[b]))
                led = {(a, b)} if lane.one_way else {(a, b), (b, a)}
                if a == b:
                    yield f"{place}: leads from a node to itself; name two nodes"
                elif length < SHORTEST:
                    yield f"{place}: has no length, because both nodes have the same position; move one, or leave it out"
                elif length > LONGEST:
                    yield f"{place}: is {length / NMI:,.0f} nmi long; at most {LONGEST / NMI:,.0f}: put nodes between"
                elif led & ways:
                    yield f"{place}: another lane leads there already; leave one out, or make both one_way"
                ways |= led
        idle = [name for name in places if name not in used]
        yield from (
            f'node "{name}": no lane begins or ends there; leave it out, or add a lane'
            for name in idle
        )

    def network(self) -> Network:
        """Return the record of the network."""
        number = {node.name: k for k, node in enumerate(self.node)}
        lon, lat = np.radians([node.at for node in self.node]).T
        rows = [
            (number[a], number[b], lane.width, lane.one_way)
            for lane in self.lane
            for a, b in lane.pairs()
        ]
        start, end, width, one_way = (np.array(column) for column in zip(*rows, strict=True))
        return Network(tuple(number), lon, lat, start, end, width.astype(float), one_way)


def read_network(path: str | Path) -> Chart:
    """Return the network of a TOML or GeoJSON file.

    Raises UserError with one line for each mistake.
    """
    path = Path(path)
    kinds = {".toml": _toml, ".geojson": _geojson, ".json": _geojson}
    try:
        if path.suffix.lower() not in kinds:
            raise UserError("is neither .toml nor .geojson; give a network in one of these")
        data = kinds[path.suffix.lower()](_text(path))
        try:
            table = NetworkTable.model_validate(data)
        except ValidationError as error:
            raise UserError(*messages.lines(error, _with_lane_names(data))) from None
        except OverflowError:  # integers beyond the largest float
            raise UserError("one of its whole numbers is too large") from None
    except UserError as error:
        raise UserError(
            *(f'network "{path.name}": {line}' for line in mistakes.shorten_lines(error.lines))
        ) from None
    return Chart(table.network(), {area.name: tuple(area.corners()) for area in table.area})


def _text(path: Path) -> str:
    try:
        return small.read_small_file(path, LARGEST).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise UserError("is not text in UTF-8") from None
    except OSError as error:
        raise UserError(f"cannot be read: {error.strerror}") from None


def _toml(text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise UserError(f"not valid TOML: {error}") from None


def _geojson(text: str) -> dict[str, Any]:
    """Convert GeoJSON to the tables that a TOML file of the same network would have."""
    try:
        data = json.loads(text)
        json.dumps(
            data, ensure_ascii=False
        ).encode()  # rejects unpaired surrogates, which JSON allows and UTF-8 does not
    except (ValueError, RecursionError) as error:
        raise UserError(f"not valid JSON: {error}") from None
    if not isinstance(data, dict) or not isinstance(data.get("features"), list):
        raise UserError("is not a GeoJSON FeatureCollection: it has no list of features")
    tables: dict[str, list[Any]] = {"node": [], "lane": [], "area": []}
    lines: list[tuple[dict[str, Any], Any]] = []
    wrong = []
    for number, feature in enumerate(data["features"], 1):
        shape = feature.get("geometry") if isinstance(feature, dict) else None
        kind, points = (
            (shape.get("type"), shape.get("coordinates"))
            if isinstance(shape, dict)
            else (None, None)
        )
        properties = feature.get("properties") if isinstance(feature, dict) else None
        keys = properties if isinstance(properties, dict) else {}
        keys = {key: value for key, value in keys.items() if value is not None}
        if kind == "Point":
            tables["node"].append({**keys, "at": _lonlat(points)})
        elif kind == "LineString":
            tables["lane"].append(keys)
            lines.append((keys, points))
        elif kind == "Polygon":
            if not isinstance(points, list) or len(points) != 1 or not isinstance(points[0], list):
                wrong.append(
                    f"feature {number}: a polygon that is not one ring; an area has no holes"
                )
            else:
                tables["area"].append({**keys, "polygon": [_lonlat(point) for point in points[0]]})
        else:
            wrong.append(
                f"feature {number}: {kind or 'no geometry'}; a Point (node), a LineString (lane) or a Polygon (area) "
                "is needed"
            )
    places = {
        node.get("name"): node["at"] for node in tables["node"] if isinstance(node.get("name"), str)
    }
    for keys, points in lines:
        wrong += _line_mistakes(keys, points, places)
    if wrong:
        raise UserError(*wrong)
    return {name: rows for name, rows in tables.items() if rows}


def _lonlat(point: Any) -> Any:
    """Return a GeoJSON position without its height."""
    return point[:2] if isinstance(point, list) else point


def _line_mistakes(
    keys: Mapping[str, Any], points: Any, places: Mapping[str, Any]
) -> Iterator[str]:
    """Yield the mistakes of a lane's line in GeoJSON, which must lead from node to node."""
    ends = (keys.get("from"), keys.get("to"))
    place = f'lane "{ends[0]} - {ends[1]}"'
    if not isinstance(points, list) or len(points) != 2:
        count = len(points) if isinstance(points, list) else 0
        yield f"{place}: its line has {count} points; a lane is straight from node to node: put a node at each bend"
        return
    for name, point in zip(ends, points, strict=True):
        there, drawn = (
            _finite(at) for at in (places.get(name) if isinstance(name, str) else None, point)
        )
        if not drawn:
            yield f"{place}: its line has the end {json.dumps(point)[:40]}; write [lon, lat] in degrees"
        elif there:  # unknown and invalid nodes are reported elsewhere
            away = float(sphere.distance(*np.radians([*there, *drawn])))
            if away > ASTRAY:
                yield f'{place}: its line ends {away / NMI:,.0f} nmi from the node "{name}"; move one to the other'


def _finite(point: Any) -> tuple[float, float] | None:
    """Return a GeoJSON position; None if it is not a list of two or more numbers."""
    if not isinstance(point, list) or len(point) < 2:
        return None
    numbers = [x for x in point[:2] if isinstance(x, int | float) and abs(x) <= 360]
    return (float(numbers[0]), float(numbers[1])) if len(numbers) == 2 else None


def _with_lane_names(data: Any) -> Any:
    """Return the tables with a name added to each lane, for messages."""
    if not isinstance(data, dict) or not isinstance(data.get("lane"), list):
        return data
    named = [
        {**lane, "name": f"{lane['from']} - {lane['to']}"}
        if isinstance(lane, dict) and {"from", "to"} <= lane.keys()
        else lane
        for lane in data["lane"]
    ]
    return {**data, "lane": named}


def _nearest(name: str, names: Sequence[str] | Mapping[str, Any]) -> str:
    near = difflib.get_close_matches(name, list(names), n=1, cutoff=0.5)
    return f'nearest is "{near[0]}"' if near else "add it, or name another"
