"""Networks of lanes, and routes along them for targets that keep to known lanes.

A particle keeps one side s in [-1, 1] along its whole route. At each node it passes the point at
the distance s * half from the node in the direction `toward`, which bisects the corner there.
Between nodes it follows the great circle between two such points. The corridor of a route, swept by
all sides, therefore has no gap at a corner, however sharp, and side > 0 is to starboard on every
leg, also through north and round a U-turn.

At a node the corridor is as wide as the mean of the lanes before and after it. The line across it
is at an angle to both lanes of half the turn, phi / 2, so its length is that mean divided by
cos(phi / 2): at 60 degrees it is 15 % longer, without which the corridor would be 13 % too narrow
there. This is the mitre joint of drawn lines, and it is limited in the same way: beyond a right
angle (MITRE) the corridor narrows towards the node, which avoids a spike.
"""

import difflib
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph

from geo import sphere
from geo.array import Array
from geo.notation import NMI

PIECE = 50_000.0  # [m] spacing of points along a route for its extent
# most by which a corner lengthens the line across the corridor: that of a turn of 90 degrees
MITRE = np.sqrt(2.0)


@dataclass(frozen=True, eq=False)
class Network:
    """Nodes, and lanes between pairs of them.

    Names are unique, and lanes have a length and connect two different nodes;
    drift.case.scenario.network rejects others. A one-way lane leads from `start` to `end`; any
    other may be followed in both directions.
    """

    name: tuple[str, ...]  # of the nodes, (n,)
    lon: Array  # [rad] of the nodes, (n,)
    lat: Array
    start: npt.NDArray[np.int64]  # number of the node where each lane begins, (m,)
    end: npt.NDArray[np.int64]
    width: Array  # [m] from side to side, (m,)
    one_way: npt.NDArray[np.bool_]  # (m,)


@dataclass(frozen=True, eq=False)
class Route:
    """A route along lanes, with one value for each node, shape (k,), k >= 2.

    A particle on side s in [-1, 1] passes node j at the point exp(s * half[j]) in the direction
    toward[j], after the distance along[j] on the centre line. With an entry time and a speed of
    advance this is at entry + along[j] / speed.
    """

    node: tuple[str, ...]
    lon: Array  # [rad] of the nodes, in [-pi, pi)
    lat: Array
    # [m] half the length of the line across the corridor, at most MITRE times the lanes' mean half
    # width
    half: Array
    toward: Array  # [rad] direction of that line to starboard, clockwise from north, in [-pi, pi)
    along: Array  # [m] from the first node along the centre line; 0 at the first


def displaced(route: Route, side: npt.ArrayLike) -> tuple[Array, Array]:
    """Return (lon, lat) [rad] where particles pass the nodes, shape (..., k); side: in [-1, 1],
    shape (...).
    """
    away = np.asarray(side, np.float64)[..., None] * route.half
    return sphere.destination(
        route.lon, route.lat, away * np.sin(route.toward), away * np.cos(route.toward)
    )


def extent(route: Route) -> tuple[Array, Array, float]:
    """Return places along the route (lon, lat) [rad], unwrapped, and its largest half width [m]."""
    lon, lat = sphere.track(route.lon, route.lat, PIECE)
    return np.unwrap(lon), lat, float(route.half.max())


def route(network: Network, names: Sequence[str]) -> Route:
    """Return the route through nodes.

    Args:
        network: of the lanes.
        names: of the nodes, in order.

    Raises:
        ValueError: if no lane leads from a node to the next, or a lane is too short.
    """
    if len(names) < 2:
        raise ValueError(
            f"route: {len(names)} node{'s' * (len(names) != 1)}; at least 2 are needed"
        )
    node = np.array([number(network, name) for name in names])
    lane = np.array([between(network, a, b) for a, b in itertools.pairwise(node)])
    lon, lat, half = network.lon[node], network.lat[node], network.width[lane] / 2
    ahead = bearing(lon[:-1], lat[:-1], lon[1:], lat[1:])
    behind = bearing(lon[1:], lat[1:], lon[:-1], lat[:-1]) + np.pi
    # At its two ends a route is extended straight, with the width of its only lane there.
    arriving, leaving = np.append(ahead[0], behind), np.append(ahead, behind[-1])
    reach, toward = line_across_corridor(
        arriving, leaving, np.append(half[0], half), np.append(half, half[-1])
    )
    length = sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:])
    # The path is shorter on one side of the corridor and longer on the other: paths must not run
    # backwards.
    slant = reach[1:] * np.cos(toward[1:] - behind) - reach[:-1] * np.cos(toward[:-1] - ahead)
    short = np.flatnonzero(np.abs(slant) >= length)
    if short.size:
        j = short[0]
        raise ValueError(
            f'lane "{names[j]} - {names[j + 1]}": {length[j] / NMI:.3g} nmi long, too short for a corridor '
            f"{network.width[lane[j]] / NMI:.3g} nmi wide at its turns: on their inner side tracks would run backwards; "
            "make it narrower, or leave a node out"
        )
    return Route(
        tuple(names), sphere.wrap(lon), lat, reach, toward, np.append(0.0, np.cumsum(length))
    )


def followed(network: Network, routes: Sequence[Route]) -> Network:
    """Return the network reduced to the lanes that routes follow, with all its nodes."""
    legs = {pair for way in routes for pair in itertools.pairwise(way.node)}
    lane = sorted({between(network, number(network, a), number(network, b)) for a, b in legs})
    return replace(
        network,
        start=network.start[lane],
        end=network.end[lane],
        width=network.width[lane],
        one_way=network.one_way[lane],
    )


def join_networks(networks: Sequence[Network]) -> Network:
    """Return one network of the lanes of several, each lane once; nodes are identified by name and
    place.
    """
    place: dict[tuple[str, float, float], int] = {}
    rows: dict[tuple[int, int], tuple[float, bool]] = {}
    for network in networks:
        number = [
            place.setdefault((name, float(x), float(y)), len(place))
            for name, x, y in zip(network.name, network.lon, network.lat, strict=True)
        ]
        for lane, (a, b) in enumerate(zip(network.start, network.end, strict=True)):
            rows[number[a], number[b]] = float(network.width[lane]), bool(network.one_way[lane])
    used = sorted({node for ends in rows for node in ends})
    nodes = [list(place)[k] for k in used]
    start, end = (np.searchsorted(used, [ends[k] for ends in rows]) for k in (0, 1))
    width, one_way = (np.array(column) for column in zip(*rows.values(), strict=True))
    lon, lat = (np.array([node[k] for node in nodes], float) for k in (1, 2))
    return Network(tuple(node[0] for node in nodes), lon, lat, start, end, width, one_way)


def line_across_corridor(
    arriving: Array, leaving: Array, before: Array, after: Array
) -> tuple[Array, Array]:
    """Return half length [m] and direction to starboard [rad] of the line across the corridor at
    corners.

    A U-turn is made to port.

    Args:
        arriving: bearings [rad] on which nodes are reached.
        leaving: bearings [rad] on which nodes are left.
        before: half widths [m] of the lanes before the nodes.
        after: half widths [m] of the lanes after the nodes.
    """
    turn = sphere.wrap(leaving - arriving)
    turn = np.where(
        np.abs(turn) > np.pi - 1e-6, -np.pi, turn
    )  # so that rounding does not decide the side
    mitre = np.minimum(1 / np.maximum(np.cos(turn / 2), 1e-9), MITRE)
    return (before + after) / 2 * mitre, sphere.wrap(arriving + turn / 2 + np.pi / 2)


def shortest(network: Network, start: str, end: str) -> tuple[str, ...]:
    """Return the nodes on the shortest route; raise ValueError if no permitted route exists.

    Dijkstra (1959, doi:10.1007/BF01386390) by the lengths of the centre lines.
    """
    first, last = number(network, start), number(network, end)
    if first == last:
        raise ValueError(f'route: it begins and ends at "{start}"; give two nodes')
    length, before = csgraph.dijkstra(_lengths(network), indices=first, return_predecessors=True)
    if not np.isfinite(length[last]):
        reached = _quoted(
            [network.name[j] for j in np.flatnonzero(np.isfinite(length)) if j != first]
        )
        raise ValueError(
            f'route: no way from "{start}" to "{end}" along the lanes; '
            f"{f'they lead from there to {reached}' if reached else 'none begins there'}; add a lane, or let a "
            "one-way lane be followed both ways"
        )
    way = [last]
    while way[-1] != first:
        way.append(int(before[way[-1]]))
    return tuple(network.name[j] for j in reversed(way))


def number(network: Network, name: str) -> int:
    """Return the number of a node; raise ValueError, with the nearest name, if it is unknown."""
    if name in network.name:
        return network.name.index(name)
    near = difflib.get_close_matches(name, network.name, n=1, cutoff=0.5)
    instead = f"nearest is {_quoted(near)}" if near else f"there are {_quoted(network.name)}"
    raise ValueError(f'route: no node "{name}" in the network; {instead}')


def bearing(
    lon1: npt.ArrayLike, lat1: npt.ArrayLike, lon2: npt.ArrayLike, lat2: npt.ArrayLike
) -> Array:
    """Return the direction [rad, clockwise from north] in which points 2 lie from points 1
    [rad].
    """
    return np.arctan2(*sphere.offset(lon1, lat1, lon2, lat2))


def lane_directions(
    network: Network,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return (from, to, lane) of every permitted direction of a lane: numbers of nodes and lane,
    (d,).
    """
    both = np.flatnonzero(~network.one_way)
    return (
        np.concatenate([network.start, network.end[both]]),
        np.concatenate([network.end, network.start[both]]),
        np.concatenate([np.arange(network.start.size), both]),
    )


def between(network: Network, a: int, b: int) -> int:
    """Return the number of the lane from one node to another."""
    start, end, lane = lane_directions(network)
    found = lane[(start == a) & (end == b)]
    if found.size:
        return int(found[0])
    here, there = network.name[a], network.name[b]
    if a == b:
        raise ValueError(f'route: "{here}" is listed twice in a row; name it once')
    said = f'route: no lane from "{here}" to "{there}"'
    if ((start == b) & (end == a)).any():
        said += f', as that from "{there}" to "{here}" is one-way'
    ways = _quoted([network.name[j] for j in np.unique(end[start == a])])
    said += (
        f'; from "{here}" lanes lead to {ways}' if ways else f'; no lane leads away from "{here}"'
    )
    try:
        way = shortest(network, here, there)
    except ValueError:
        raise ValueError(f'{said}, and none of them on to "{there}"') from None
    raise ValueError(
        f'{said}; the shortest way to "{there}" is by {_quoted(way[1:-1])}; list these nodes too'
    )


def _lengths(network: Network) -> sparse.csr_array:
    """Return the lengths [m] of lanes; row: from node, column: to node."""
    a, b, _ = lane_directions(network)
    length = sphere.distance(network.lon[a], network.lat[a], network.lon[b], network.lat[b])
    return sparse.csr_array((length, (a, b)), shape=(len(network.name),) * 2)


def _quoted(names: Sequence[str], most: int = 8) -> str:
    """Return names in quotation marks; of many, the first few and a count."""
    text = ", ".join(f'"{name}"' for name in names[:most])
    return f"{text} and {len(names) - most} more" if len(names) > most else text
