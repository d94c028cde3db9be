"""Routes along lanes against great circles by vectors (oracles/globe.py), and shortest ways against
all ways there are.
"""

import itertools
import re

import globe
import numpy as np
import pytest

from drift.engine.motion.steering import lanes
from drift.engine.motion.steering.lanes import MITRE, Network, Route

NMI = 1852.0
ROTATIONS = range(40)


def network(
    lonlat: np.ndarray,
    pairs: list[tuple[int, int]],
    width: np.ndarray | float,
    one_way: tuple[int, ...] = (),
) -> Network:
    """Return a network of nodes "A", "B", ... at places [rad]; one_way: numbers of lanes."""
    names = tuple("ABCDEFGHIJ"[: len(lonlat)])
    start, end = np.array(pairs).T
    ways = np.isin(np.arange(len(pairs)), one_way)
    return Network(
        names,
        *np.array(lonlat).T,
        start,
        end,
        np.broadcast_to(width, start.shape).astype(float),
        ways,
    )


def bend(turn: float, first: float = 37.0, length: float = 80 * NMI) -> np.ndarray:
    """Return (lon, lat) [rad] of three nodes: a course of `first` [deg], then a turn [deg] to
    starboard.
    """
    b = globe.point(np.radians(17.3), np.radians(34.7))
    a = globe.walk(b, -globe.heading(b, np.radians(first)), length)
    c = globe.walk(b, globe.heading(b, np.radians(first + turn)), 1.3 * length)
    return np.column_stack(globe.lonlat(np.array([a, b, c])))


def passed(route: Route, side: float) -> np.ndarray:
    """Return where a route's nodes are passed on a side, as vectors: by its records and globe
    alone.
    """
    p = globe.point(route.lon, route.lat)
    return globe.walk(p, globe.heading(p, route.toward), side * route.half)


@pytest.mark.parametrize("turn", [0.4, 23.0, 60.0, -77.0, 89.0, -89.0])
@pytest.mark.parametrize("side", [-1.0, 0.6])
def test_a_corner_is_as_far_from_the_middle_of_both_lanes_as_the_corridor_is_wide(
    turn: float, side: float
) -> None:
    """Where edges meet at a corner, they lie the half width off both lanes: there is no gap, and
    nothing is pinched.

    The sphere's excess over the plane is of the order half * (half / R)**2, 1e-6 of it.
    """
    route = lanes.route(network(bend(turn), [(0, 1), (1, 2)], 16 * NMI), ["A", "B", "C"])
    a, b, c = globe.point(route.lon, route.lat)
    corner = passed(route, side)[1]
    assert globe.starboard(a, b, corner) == pytest.approx(side * 8 * NMI, rel=1e-5)
    assert globe.starboard(b, c, corner) == pytest.approx(side * 8 * NMI, rel=1e-5)


def test_without_the_mitre_a_turn_of_60_degrees_would_be_13_percent_too_narrow() -> None:
    route = lanes.route(network(bend(60.0), [(0, 1), (1, 2)], 16 * NMI), ["A", "B", "C"])
    assert route.half[1] == pytest.approx(8 * NMI / np.cos(np.radians(30)), rel=1e-9)
    assert route.half[[0, 2]] == pytest.approx(8 * NMI, rel=1e-12)


@pytest.mark.parametrize("turn", [91.0, -120.0, 150.0, 179.0])
def test_beyond_a_right_angle_the_corridor_narrows_instead_of_growing_a_spike(turn: float) -> None:
    route = lanes.route(network(bend(turn), [(0, 1), (1, 2)], 9 * NMI), ["A", "B", "C"])
    a, b, _ = globe.point(route.lon, route.lat)
    assert route.half[1] == pytest.approx(MITRE * 4.5 * NMI, rel=1e-12)
    off = globe.starboard(a, b, passed(route, 1.0)[1])
    assert off == pytest.approx(MITRE * 4.5 * NMI * np.cos(np.radians(turn / 2)), rel=1e-4)
    assert 0 < off < 4.5 * NMI


def test_a_corner_of_unequal_lanes_takes_their_mean() -> None:
    route = lanes.route(
        network(bend(-41.0), [(0, 1), (2, 1)], np.array([20 * NMI, 6 * NMI])), ["A", "B", "C"]
    )
    expected = np.array([10, (10 + 3) / 2 / np.cos(np.radians(20.5)), 3]) * NMI
    assert route.half == pytest.approx(expected, rel=1e-9)


def wandering(seed: int) -> tuple[Network, list[str]]:
    """Return a route of eight nodes over sharp and slight turns somewhere on the globe, through
    north by chance, or a pole.
    """
    rng = np.random.default_rng(seed)
    p = [globe.point(np.radians(0.3), np.radians(1.1))]
    course = rng.uniform(0, 2 * np.pi)
    for length in rng.uniform(70, 260, 7) * NMI:
        p.append(globe.walk(p[-1], globe.heading(p[-1], np.asarray(course)), length))
        course += np.radians(rng.uniform(-160, 160))
    turned = np.array(p) @ globe.rotation(seed).T
    pairs = [(j, j + 1) if j % 2 else (j + 1, j) for j in range(7)]
    found = network(np.column_stack(globe.lonlat(turned)), pairs, rng.uniform(4, 20, 7) * NMI)
    return found, list(found.name)


@pytest.mark.parametrize("seed", ROTATIONS)
def test_a_route_is_the_same_wherever_it_lies(seed: int) -> None:
    """Turned about the Earth's centre, so that it crosses the antimeridian, north or a pole, it
    sweeps the same corridor.
    """
    found, names = wandering(seed)
    there = lanes.route(found, names)
    back = globe.rotation(seed)  # p @ back undoes wandering's p @ back.T
    home = globe.point(there.lon, there.lat) @ back
    here = lanes.route(
        network(
            np.column_stack(globe.lonlat(home)),
            [*zip(found.start, found.end, strict=True)],
            found.width,
        ),
        names,
    )
    assert here.along == pytest.approx(there.along, rel=1e-12)
    for side in (-1.0, 0.37, 1.0):
        away = globe.distance(passed(there, side) @ back, passed(here, side))
        assert away.max() < 0.01  # [m]


@pytest.mark.parametrize("seed", ROTATIONS)
def test_a_side_stays_the_same_side(seed: int) -> None:
    """Halfway along every leg, side > 0 is to starboard and side < 0 to port, whatever the courses
    and turns.
    """
    route = lanes.route(*wandering(seed))
    middle = globe.point(route.lon, route.lat)
    for side in (-1.0, -0.2, 0.5, 1.0):
        way = passed(route, side)
        halfway = globe.part(way[:-1], way[1:], np.full(7, 0.5))
        assert (np.sign(side) * globe.starboard(middle[:-1], middle[1:], halfway) > 0).all()


def test_a_u_turn_is_made_to_port_and_keeps_the_side() -> None:
    """Who keeps to starboard turns beyond the node, who keeps to port before it; on both ways each
    is on its own side.
    """
    out, back = bend(180.0, length=60 * NMI)[:2]
    route = lanes.route(network(np.array([out, back]), [(0, 1)], 10 * NMI), ["A", "B", "A"])
    a, b, _ = globe.point(route.lon, route.lat)
    for side in (-1.0, 1.0):
        way = passed(route, side)
        assert globe.distance(way[1], b) == pytest.approx(MITRE * 5 * NMI, rel=1e-9)
        ahead = globe.distance(a, way[1]) - globe.distance(a, b)
        assert ahead == pytest.approx(side * MITRE * 5 * NMI, rel=1e-9)
        for j in (0, 1):
            halfway = globe.part(way[j], way[j + 1], np.asarray(0.5))
            p, q = ((a, b), (b, a))[j]
            assert side * globe.starboard(p, q, halfway) == pytest.approx(2.5 * NMI, rel=1e-3)


@pytest.mark.parametrize("seed", ROTATIONS[:10])
def test_the_way_back_sweeps_the_same_corridor(seed: int) -> None:
    found, names = wandering(seed)
    there, back = lanes.route(found, names), lanes.route(found, names[::-1])
    assert globe.distance(passed(there, 0.8), passed(back, -0.8)[::-1]).max() < 0.01  # [m]
    assert back.along[-1] == pytest.approx(there.along[-1], rel=1e-12)


def test_distances_are_along_the_middle() -> None:
    found, names = wandering(5)
    route = lanes.route(found, names)
    p = globe.point(found.lon, found.lat)
    assert route.along[0] == 0
    assert np.diff(route.along) == pytest.approx(globe.distance(p[:-1], p[1:]), rel=1e-9)


def test_displaced_is_what_the_records_say() -> None:
    route = lanes.route(*wandering(11))
    side = np.array([[-1.0, 0.0, 0.3], [0.7, 1.0, -0.45]])
    lon, lat = lanes.displaced(route, side)
    assert lon.shape == (2, 3, 8)
    for index in np.ndindex(2, 3):
        # [m]
        assert (
            globe.distance(globe.point(lon[index], lat[index]), passed(route, side[index])).max()
            < 0.01
        )


@pytest.mark.parametrize("seed", ROTATIONS[:10])
def test_the_extent_holds_the_corridor(seed: int) -> None:
    route = lanes.route(*wandering(seed))
    lon, lat, far = lanes.extent(route)
    assert np.abs(np.diff(lon)).max() < np.pi
    places = globe.point(lon, lat)
    rng = np.random.default_rng(seed)
    for side in (-1.0, 1.0):
        way = passed(route, side)
        x = globe.part(
            np.repeat(way[:-1], 50, 0), np.repeat(way[1:], 50, 0), rng.uniform(0, 1, 350)
        )
        nearest = globe.distance(x[:, None], places).min(axis=1)
        assert nearest.max() < np.hypot(far, lanes.PIECE / 2) * 1.001


def ways(found: Network, first: int, last: int) -> list[tuple[float, tuple[int, ...]]]:
    """Return the lengths and nodes of all ways without a repeated node, shortest first: by trying
    every order.
    """
    p = globe.point(found.lon, found.lat)
    allowed = {
        pair
        for a, b, one in zip(found.start, found.end, found.one_way, strict=True)
        for pair in (((a, b),) if one else ((a, b), (b, a)))
    }
    others = [j for j in range(len(found.name)) if j not in (first, last)]
    orders = (order for k in range(len(others) + 1) for order in itertools.permutations(others, k))
    tried = [(first, *order, last) for order in orders]
    sound = [way for way in tried if set(itertools.pairwise(way)) <= allowed]
    return sorted(
        (float(globe.distance(p[list(way[:-1])], p[list(way[1:])]).sum()), way) for way in sound
    )


@pytest.mark.parametrize("seed", range(12))
def test_shortest_ways_against_all_ways(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p = globe.unit(globe.point(*np.radians([178.0, -16.0])) + rng.normal(0, 0.1, (7, 3)))
    pairs = [pair for pair in itertools.combinations(range(7), 2) if rng.random() < 0.45]
    pairs = [(b, a) if rng.random() < 0.5 else (a, b) for a, b in pairs]
    one_way = tuple(np.flatnonzero(rng.random(len(pairs)) < 0.5))
    found = network(np.column_stack(globe.lonlat(p)), pairs, 100.0, one_way)
    reached = 0
    for first, last in itertools.permutations(range(7), 2):
        known = ways(found, first, last)
        names = found.name[first], found.name[last]
        if known:
            assert lanes.shortest(found, *names) == tuple(found.name[j] for j in known[0][1])
            reached += 1
        else:
            with pytest.raises(
                ValueError, match=rf'route: no way from "{names[0]}" to "{names[1]}"'
            ):
                lanes.shortest(found, *names)
    assert reached > 0


SQUARE = network(
    np.radians([[10.0, 50.0], [12.0, 50.1], [12.2, 52.0], [9.8, 51.8]]),
    [(0, 1), (1, 2), (2, 3)],
    1e4,
    (1,),
)


@pytest.mark.parametrize(
    ("nodes", "message"),
    [
        (["A"], "route: 1 node; at least 2 are needed"),
        ([], "route: 0 nodes; at least 2 are needed"),
        (["A", "Z"], 'route: no node "Z" in the network; there are "A", "B", "C", "D"'),
        (["A", "A"], 'route: "A" is listed twice in a row; name it once'),
        (["A", "C"], 'route: no lane from "A" to "C"; from "A" lanes lead to "B"; the shortest way to "C" is by "B"; list these nodes too'),
        (["A", "D"], 'route: no lane from "A" to "D"; from "A" lanes lead to "B"; the shortest way to "D" is by "B", "C"; list these nodes too'),
        (
            ["C", "B"],
            'route: no lane from "C" to "B", as that from "B" to "C" is one-way; from "C" lanes lead to "D", and none '
            'of them on to "B"',
        ),
    ],
)  # fmt: skip
def test_routes_that_lanes_do_not_allow(nodes: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        lanes.route(SQUARE, nodes)


def test_ends_that_lanes_do_not_join() -> None:
    message = (
        'route: no way from "D" to "A" along the lanes; they lead from there to "C"; add a lane, or let a one-way lane '
        "be followed both ways"
    )
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        lanes.shortest(SQUARE, "D", "A")
    with pytest.raises(ValueError, match='route: it begins and ends at "B"; give two nodes'):
        lanes.shortest(SQUARE, "B", "B")
    alone = network(np.radians([[1.0, 2.0], [1.5, 2.5]]), [(0, 1)], 1e3, (0,))
    with pytest.raises(ValueError, match='from "B" to "A" along the lanes; none begins there'):
        lanes.shortest(alone, "B", "A")


def test_a_misspelt_node_is_told_the_nearest_name() -> None:
    named = Network(
        ("Gibraltar", "Malta"),
        *np.radians([[-5.5, 14.6], [35.9, 35.7]]),
        np.array([0]),
        np.array([1]),
        np.array([9e3]),
        np.array([False]),
    )
    with pytest.raises(
        ValueError, match='route: no node "Gibralta" in the network; nearest is "Gibraltar"'
    ):
        lanes.shortest(named, "Gibralta", "Malta")


def test_what_routes_follow_of_a_network() -> None:
    """Its lanes in their order, each once; routes along what is left are the same."""
    routes = [
        lanes.route(SQUARE, ["C", "D", "C"]),
        lanes.route(SQUARE, ["A", "B"]),
        lanes.route(SQUARE, ["B", "A"]),
    ]
    left = lanes.followed(SQUARE, routes)
    assert (left.start.tolist(), left.end.tolist(), left.one_way.tolist()) == (
        [0, 2],
        [1, 3],
        [False, False],
    )
    again = lanes.route(left, ["C", "D", "C"])
    assert (again.half.tolist(), again.toward.tolist()) == (
        routes[0].half.tolist(),
        routes[0].toward.tolist(),
    )
    with pytest.raises(ValueError, match='route: no lane from "B" to "C"'):
        lanes.route(left, ["B", "C"])


@pytest.mark.parametrize("turns", [(80.0, 80.0), (-80.0, -80.0)])
def test_a_lane_too_short_for_its_corridor_is_refused(turns: tuple[float, float]) -> None:
    """With two like turns of 80 degrees the inner side of the lane between loses 2 half tan(40
    deg): here 8.4 nmi of 8.
    """
    b = globe.point(np.radians(-35.2), np.radians(-47.1))
    first = np.radians(112.0)
    a = globe.walk(b, -globe.heading(b, first), 90 * NMI)

    def trial(length: float) -> Network:
        c = globe.walk(b, globe.heading(b, first + np.radians(turns[0])), length)
        onward = globe.tangent(c, b)  # back, so a turn of t is a heading t + 180 from it
        angle = np.radians(turns[1])
        d = globe.walk(c, -np.cos(angle) * onward + np.sin(angle) * np.cross(c, onward), 90 * NMI)
        return network(
            np.column_stack(globe.lonlat(np.array([a, b, c, d]))),
            [(0, 1), (1, 2), (2, 3)],
            10 * NMI,
        )

    limit = 10 * NMI * np.tan(np.radians(40.0))
    assert lanes.route(trial(1.01 * limit), list("ABCD")).half[1] == pytest.approx(
        5 * NMI / np.cos(np.radians(40))
    )
    with pytest.raises(
        ValueError,
        match=r'^lane "B - C": 8\.31 nmi long, too short for a corridor 10 nmi wide at its turns',
    ):
        lanes.route(trial(0.99 * limit), list("ABCD"))
