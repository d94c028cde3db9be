"""Corridors and areas held against land: by points scattered in them by vectors (oracles/globe.py),
and shapely's points in polygons.
"""

import re
from dataclasses import replace

import globe
import numpy as np
import pytest
import shapely

from cases import __file__ as cases
from drift.case.scenario import network as network_file
from drift.engine.environment import corridors
from drift.engine.motion.steering import lanes
from drift.engine.motion.steering.lanes import MITRE, Network, Route
from geo.box import Box
from geo.coast import edges, shore
from geo.coast.edges import Coast
from geo.coast.shore import Shore
from geo.errors import UserError

NMI = globe.NMI
# Where networks are laid: [deg] of the middle; the last two are over the antimeridian, and in high
# latitudes.
PLACES = {
    "sound": (-61.3, -14.2),
    "fiji": (179.2, -17.6),
    "svalbard": (21.0, 78.4),
    "alaska": (-179.4, 71.3),
}


def islands(rng: np.random.Generator, about: tuple[float, float], count: int) -> np.ndarray:
    """Return ragged islands of 2 to 9 nmi as polygons [deg] about a place, longitudes not wrapped."""
    found = []
    for _ in range(count):
        x, y = rng.uniform(-1, 1, 2) * 150 * NMI
        centre = globe.point(*np.radians(about))
        centre = globe.walk(centre, globe.heading(centre, np.arctan2(x, y)), np.hypot(x, y))
        bearing = np.sort(rng.uniform(0, 2 * np.pi, 14))
        rim = globe.walk(centre, globe.heading(centre, bearing), rng.uniform(2, 9, 14) * NMI)
        lon, lat = np.degrees(globe.lonlat(rim))
        found.append(
            shapely.Polygon(
                np.column_stack([about[0] + (lon - about[0] + 180) % 360 - 180, lat])
            ).buffer(0)
        )
    parts = shapely.get_parts(shapely.union_all(found))
    return np.array([shapely.Polygon(part.exterior) for part in parts])


def coast(polygons: np.ndarray, about: tuple[float, float]) -> Coast:
    """Return the coast of a box of some 250 nmi each way about a place [deg]."""
    wide = 4.5 / np.cos(np.radians(abs(about[1]) + 4.5))
    west = (about[0] - wide + 180) % 360 - 180
    box = Box(west, about[1] - 4.5, west + 2 * wide, about[1] + 4.5)
    return edges.build_coast(Shore(shore.clip(polygons, box), "trial", box=box), box)


def laid(rng: np.random.Generator, about: tuple[float, float]) -> Network:
    """Return nine nodes within 110 nmi of a place [deg], and lanes between some of them, three of
    which are one-way.
    """
    middle = globe.point(*np.radians(about))
    p = globe.walk(
        middle, globe.heading(middle, rng.uniform(0, 2 * np.pi, 9)), rng.uniform(50, 110, 9) * NMI
    )
    pairs = [
        (a, b)
        for a in range(9)
        for b in range(a)
        if globe.distance(p[a], p[b]) > 40 * NMI and rng.random() < 0.5
    ]
    start, end = np.array(pairs).T
    width = rng.uniform(1, 9, len(pairs)) * NMI
    return Network(
        tuple("ABCDEFGHI"), *globe.lonlat(p), start, end, width, np.arange(len(pairs)) % 5 == 1
    )


def neighbours(found: Network, at: int, other: int, leaving: bool) -> list[tuple[int, float]]:
    """Return (node, width) of lanes by which a node is left or reached, but for those to one other
    node.
    """
    rows = zip(found.start, found.end, found.width, found.one_way, strict=True)
    ways = []
    for a, b, width, one in rows:
        if (a if leaving else b) == at:
            ways.append((int(b if leaving else a), width))
        elif (b if leaving else a) == at and not one:
            ways.append((int(a if leaving else b), width))
    return [way for way in ways if way[0] != other]


def corner(
    p: np.ndarray, before: int | None, at: int, after: int | None, widths: tuple[float, float]
) -> np.ndarray:
    """Return the tangent at a node that leads a particle of side 1 to its place: its length is in
    metres.

    To starboard of both courses together, by vectors: their sum points along the bisecting course.
    """
    courses = []
    if before is not None:
        courses.append(-globe.tangent(p[at], p[before]))
    if after is not None:
        courses.append(globe.tangent(p[at], p[after]))
    along = sum(courses)
    slant = np.linalg.norm(along) / len(courses)  # the cosine of half the turn
    return (
        np.cross(along / np.linalg.norm(along), p[at]) * np.mean(widths) / 2 * min(1 / slant, MITRE)
    )


def scattered(
    rng: np.random.Generator,
    p: np.ndarray,
    a: int,
    b: int,
    from_a: np.ndarray,
    to_b: np.ndarray,
    n: int,
) -> np.ndarray:
    """Return points of a corridor: each at a share of the way of a side."""
    side = rng.uniform(-1, 1, n)
    # The edges matter most: half of all points lie on them.
    side[: n // 2] = np.sign(side[: n // 2])
    q = [
        globe.walk(p[at], globe.unit(away), side * np.linalg.norm(away))
        for at, away in ((a, from_a), (b, to_b))
    ]
    return globe.part(*q, rng.uniform(0, 1, n))


def swept(rng: np.random.Generator, found: Network, lane: int, n: int) -> np.ndarray:
    """Return n points of all corridors that a lane has, whatever comes before it and after it."""
    p, width = globe.point(found.lon, found.lat), found.width[lane]
    ways = [(int(found.start[lane]), int(found.end[lane]))]
    ways += [] if found.one_way[lane] else [ways[0][::-1]]
    cases = []
    for a, b in ways:
        for before, w0 in [(None, width), *neighbours(found, a, b, leaving=False)]:
            for after, w1 in [(None, width), *neighbours(found, b, a, leaving=True)]:
                cases.append(
                    (
                        a,
                        b,
                        corner(p, before, a, b, (w0, width)),
                        corner(p, a, b, after, (width, w1)),
                    )
                )
    return np.concatenate([scattered(rng, p, *case, n // len(cases) + 1) for case in cases])


def on_land(polygons: np.ndarray, x: np.ndarray, about: float) -> np.ndarray:
    """Return whether points lie in polygons."""
    lon, lat = np.degrees(globe.lonlat(x))
    lon = about + (lon - about + 180) % 360 - 180
    return shapely.contains_xy(shapely.union_all(polygons), lon, lat)


def refused(found: Network, land: Coast, routes: tuple[Route, ...] = ()) -> list[str]:
    """Return the lines of refusal."""
    try:
        corridors.refuse_lanes(found, land, routes)
    except UserError as error:
        return list(error.lines)
    return []


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.thorough)])
def test_lanes_are_refused_where_a_point_of_their_corridor_lies_on_land(
    place: str, seed: int
) -> None:
    """What points find on land is refused; and of what is refused, points find land grown by some
    of their spacing.

    A lane of 200 by 9 nmi has 25,000 points or more within it and on its edges: 0.3 nmi apart at
    most, on average.
    """
    rng, about = np.random.default_rng([seed, *place.encode()]), PLACES[place]
    land = islands(rng, about, 22)
    found = laid(rng, about)
    lines = refused(found, coast(land, about))
    named = {tuple(re.match(r'lane "(\w) - (\w)": its corridor', line).groups()) for line in lines}
    assert len(named) == len(lines)
    # A share of a degree of latitude each way, and the more of a degree of longitude, the nearer to
    # the pole.
    squeeze = np.cos(np.radians(about[1]))
    grown = [
        shapely.transform(
            shapely.transform(one, lambda xy: xy * [squeeze, 1]).buffer(0.3 / 60),
            lambda xy: xy / [squeeze, 1],
        )
        for one in land
    ]
    count = {True: 0, False: 0}
    for lane in range(found.start.size):
        x = swept(rng, found, lane, 50_000)
        name = (found.name[found.start[lane]], found.name[found.end[lane]])
        assert name in named or not on_land(land, x, about[0]).any(), name
        assert name not in named or on_land(np.array(grown), x, about[0]).any(), name
        count[name in named] += 1
    assert count[True] >= 1
    assert count[False] >= 1


def test_a_refusal_names_the_lane_its_width_and_the_land() -> None:
    """The corridor's middle passes 2 nmi north of an islet, which is 0.5 nmi wide."""
    islet = shapely.box(14.99, 35.0, 15.01, 35.009)
    land = coast(np.array([islet]), (15.0, 35.0))
    lon, lat = np.radians([[14.5, 15.5], [35.042, 35.042]])
    start, end, straight = np.array([0]), np.array([1]), np.array([False])
    # Halfway between nodes on one parallel a great circle lies sin(lat) cos(lat) dlon**2 / 8 nearer
    # to the pole.
    rise = np.degrees(np.sin(lat[0]) * np.cos(lat[0]) * np.radians(1.0) ** 2 / 8) * 60
    off = (35.042 - 35.009) * 60 + rise  # [nmi]
    narrow = Network(
        ("West", "East"), lon, lat, start, end, np.array([2 * (off - 0.02) * NMI]), straight
    )
    assert refused(narrow, land) == []
    wide = Network(
        ("West", "East"), lon, lat, start, end, np.array([2 * (off + 0.02) * NMI]), straight
    )
    (line,) = refused(wide, land)
    words = re.fullmatch(
        r'lane "West - East": its corridor, (.*) nmi wide, touches land near \[(.*), (.*)\], (.*) nmi off its middle; '
        "make it narrower or move a node",
        line,
    )
    width, x, y, away = map(float, words.groups())
    assert width == pytest.approx(2 * off + 0.04, abs=0.006)
    assert (14.989 <= x <= 15.011, y) == (True, pytest.approx(35.009, abs=6e-4))
    assert away == pytest.approx(off, abs=0.06)


def test_a_lane_that_runs_over_land_or_lies_inland_is_refused() -> None:
    """No shoreline need be near: all nodes and their corridors may be inland."""
    land = coast(np.array([shapely.box(-73.0, 9.0, -69.5, 12.0)]), (-71.0, 10.5))
    nodes = np.radians([[-74.0, -71.3, -71.0, -71.2], [10.2, 10.4, 10.9, 10.1]])
    found = Network(
        ("Sea", "Plain", "Hill", "Ford"),
        *nodes,
        np.array([0, 1, 1]),
        np.array([1, 2, 3]),
        np.full(3, 4e3),
        np.zeros(3, bool),
    )
    lines = refused(found, land)
    assert [re.match('lane "(.*?)"', line)[1] for line in lines] == [
        "Sea - Plain",
        "Plain - Hill",
        "Plain - Ford",
    ]
    assert "touches land near [-73.000, " in lines[0]
    assert all("on its middle" in line for line in lines)
    assert "near [-71.300, 10.400]" in lines[1]


@pytest.mark.parametrize(
    ("pairs", "one_way"), [([(0, 1), (1, 2)], 0), ([(0, 1), (1, 2)], 1), ([(1, 0), (2, 1)], 1)]
)
def test_the_corridor_of_a_joint_counts_and_a_wide_neighbour_widens_it(
    pairs: list[tuple[int, int]], one_way: int
) -> None:
    """Beside a narrow lane lies an islet that its corridor meets only where a wide lane follows, or
    comes before.
    """
    lon, lat = np.radians([[30.0, 31.0, 32.0], [-41.0, -41.0, -41.0]])
    # 2.6 nmi north, 2 west of B
    land = coast(np.array([shapely.box(30.93, -40.96, 30.95, -40.95)]), (31.0, -41.0))

    def lines(second: float) -> list[str]:
        lanes_ = *np.array(pairs).T, np.array([2.0, second]) * NMI, np.full(2, bool(one_way))
        return refused(Network(("A", "B", "C"), lon, lat, *lanes_), land)

    name = " - ".join("ABC"[node] for node in pairs[0])
    assert lines(2.0) == []
    assert lines(14.0)[0].startswith(
        f'lane "{name}": its corridor, 2 nmi (up to 8 nmi at its nodes) wide, touches land'
    )


def test_a_u_turn_counts_where_a_route_makes_one() -> None:
    """It leads MITRE half widths beyond the node; an islet lies 1.2 of them beyond."""
    p = globe.point(*np.radians([[179.0, -179.6], [12.0, 12.4]]))
    beyond = globe.walk(p[1], -globe.tangent(p[1], p[0]), np.asarray(1.2 * 4 * NMI))
    x, y = np.degrees(globe.lonlat(beyond))
    land = coast(np.array([shapely.Point(x + 360, y).buffer(0.002)]), (180.0, 12.0))
    found = Network(
        ("Out", "Far"),
        *globe.lonlat(p),
        np.array([0]),
        np.array([1]),
        np.array([8 * NMI]),
        np.array([False]),
    )
    assert refused(found, land) == []
    assert refused(found, land, (lanes.route(found, ["Out", "Far"]),)) == []
    assert len(refused(found, land, (lanes.route(found, ["Out", "Far", "Out"]),))) == 1


def test_a_coast_that_does_not_reach_as_far_as_the_lanes_is_no_proof() -> None:
    # to 39.5 N and 20.8 E
    land = coast(np.array([shapely.box(15.0, 35.0, 15.1, 35.1)]), (15.0, 35.0))
    alone = np.array([0]), np.array([1]), np.array([1e3]), np.array([False])
    # The last lies with its nodes and their corridor inside the box, but its middle is nearer to
    # the pole, 39.54 N.
    for lon, lat, known in (
        ([16.0, 20.0], 39.3, True),
        ([16.0, 23.0], 36.0, False),
        ([11.5, 18.5], 39.49, False),
    ):
        found = Network(("A", "B"), *np.radians([lon, [lat, lat]]), *alone)
        if known:
            assert refused(found, land) == []
        else:
            with pytest.raises(ValueError, match="leads beyond the box"):
                corridors.refuse_lanes(found, land)


RINGS = {
    "over the antimeridian": (
        [(178.6, -18.9), (-179.0, -18.7), (-178.8, -16.3), (178.9, -16.5)],
        (179.2, -17.6),
    ),
    "in high latitudes": ([(14.0, 77.6), (27.0, 77.9), (25.5, 79.3), (13.1, 79.0)], (21.0, 78.4)),
}


@pytest.mark.parametrize("name", RINGS)
@pytest.mark.parametrize("spot", ["inside", "across", "outside", "around"])
def test_areas(name: str, spot: str) -> None:
    """An islet inside, land across an edge, land outside, and an area that lies wholly on land."""
    ring, about = RINGS[name]
    unwrapped = np.array(ring)
    unwrapped[:, 0] = about[0] + (unwrapped[:, 0] - about[0] + 180) % 360 - 180
    area = shapely.Polygon(unwrapped)
    corner_ = shapely.Point(unwrapped[0])
    island = {
        "inside": area.centroid.buffer(0.01),
        "across": corner_.buffer(0.05),
        "outside": shapely.affinity.translate(corner_, -0.06, -0.06).buffer(0.05),
        "around": area.buffer(0.3),
    }[spot]
    land = coast(np.array([island]), about)
    if spot == "outside":
        corridors.refuse_area("area", ring, land)
        return
    with pytest.raises(UserError, match=r'^area "x": touches land near') as error:
        corridors.refuse_area('area "x"', ring, land)
    lon, lat = map(float, re.search(r"near \[(.*), (.*)\];", str(error.value)).groups())
    place = shapely.Point(about[0] + (lon - about[0] + 180) % 360 - 180, lat)
    assert place.distance(island) < 0.002  # three decimals are told
    assert -180 <= lon < 180


@pytest.mark.thorough
def test_nothing_of_the_mediterranean_network_lies_on_land() -> None:
    """Neither we nor points, 10^5 of them in corridors and as many in areas, find land; both do if
    the lanes are doubled.

    Whether a point is land is asked of geo.coast.edges, by the parity of edges crossed
    (tests/geo/coast/test_coast.py).
    """
    box, rng = Box(-7.0, 29.0, 36.0, 46.0), np.random.default_rng(3)
    chart = network_file.read_network(f"{cases.rpartition('/')[0]}/networks/mediterranean.toml")
    found, land = chart.network, edges.build_coast(shore.read_land("gshhg", box), box)

    def dry(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
        return edges.is_land(
            land,
            *(np.rint(np.asarray(angle) * 2**31 / np.pi).astype(np.int32) for angle in (lon, lat)),
        )

    corridors.refuse_lanes(found, land)
    x = np.concatenate([swept(rng, found, lane, 1400) for lane in range(found.start.size)])
    assert len(x) > 100_000
    assert not dry(*globe.lonlat(x)).any()
    for name, ring in chart.areas.items():
        corridors.refuse_area(name, ring, land)
        area, (west, south, east, north) = shapely.Polygon(ring), shapely.Polygon(ring).bounds
        lon, lat = rng.uniform([west, south], [east, north], (25_000, 2)).T
        inside = shapely.contains_xy(area, lon, lat)
        assert not dry(*np.radians([lon[inside], lat[inside]])).any()
    doubled = replace(found, width=2 * found.width)
    lines = refused(doubled, land)
    named = {tuple(re.match(r'lane "(.*?) - (.*?)": its', line).groups()) for line in lines}
    hit = {
        (found.name[found.start[lane]], found.name[found.end[lane]])
        for lane in range(found.start.size)
        if dry(*globe.lonlat(swept(rng, doubled, lane, 1400))).any()
    }
    assert hit <= named
    assert len(hit) >= 3
