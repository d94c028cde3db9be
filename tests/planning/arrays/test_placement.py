"""Where arrays are towed: against brute force, and the bound against plans made to beat it."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from drift.evidence.sensors import line_array, noise, spreading
from drift.evidence.sensors.records import Levels, Sensor, Sonar, Tow
from drift.planning.arrays import heard, placement, placement_bound, ways
from drift.planning.arrays.ways import Ways
from drift.planning.search import planning_tracks
from drift.planning.search.planning_tracks import Tracks
from geo import sphere
from geo.polyline import Area

NMI = 1852.0
KNOT = NMI / 3600
BEGIN = 1.7801e9
MIDDLE = math.radians(179.3), math.radians(41.0)  # ways lead across the antimeridian


def box(west, south, east, north):
    """Return an area from its sides [nmi] from the middle."""
    x, y = np.array([west, east, east, west]) * NMI, np.array([south, south, north, north]) * NMI
    lon, lat = np.degrees(sphere.destination(*MIDDLE, x, y))
    return Area(tuple(np.degrees(np.unwrap(np.radians(lon))).tolist()), tuple(lat.tolist()))


def tracks(seed, m=4000, hours=18, bins=18):
    """Return particles of two or three groups, each with its place, course and speed."""
    rng = np.random.default_rng(seed)
    groups = int(rng.integers(2, 4))
    which = rng.choice(groups, m, p=rng.dirichlet(np.full(groups, 3.0)))
    centre = rng.uniform(-110, 110, (2, groups)) * NMI
    x, y = centre[:, which] + rng.normal(0, 1, (2, m)) * rng.uniform(12, 40) * NMI
    course = rng.uniform(0, 2 * math.pi, groups)[which] + rng.normal(0, 0.25, m)
    speed = rng.uniform(4, 11, m) * KNOT
    time = BEGIN + np.linspace(0, hours * 3600, bins + 1)
    gone = (time - BEGIN)[:, None] * speed
    lon, lat = sphere.destination(*MIDDLE, x + gone * np.sin(course), y + gone * np.cos(course))
    places = (sphere.to_binary(np.degrees(angle)) for angle in (lon, lat))
    return Tracks(
        time,
        *places,
        np.ones((bins + 1, m), bool),
        np.full(m, 1 / m),
        which.astype(np.int32),
        np.full(m, BEGIN),
    )


def sonar(seed, groups=3, **more):
    """Return a towed line array in water with two convergence zones."""
    rng = np.random.default_rng(seed)
    zones = ((27.3 * NMI, 32.1 * NMI, 11.0), (55.0 * NMI, 63.2 * NMI, 9.0))
    level = Levels(np.zeros(1), np.full((groups, 1), rng.uniform(138, 145), np.float32))
    water = spreading.losses(120 * NMI, transition=8000.0, absorption=0.012, zones=zones)
    wind = noise.of_table([[b, 72 + 3 * math.sin(math.radians(b - 40))] for b in range(0, 360, 30)])
    own = Sonar(level, water, wind, line_array.of_line(16, 14.0, 50.0), 8.0, 6.0, 1 / 3600)
    return replace(own, **more)


def ship(seed, name="ship", where=(-70, -60, 55, 65), **more):
    """Return a ship that tows at 5 knots."""
    own = Tow(
        name,
        Sensor("array", sonar(seed)),
        box(*where),
        5 * KNOT,
        np.datetime64(int(BEGIN), "s"),
        legs=1,
    )
    return replace(own, **more)


def grid(sea, side, courses, time):
    """Return straight ways from a grid of begins on evenly spread courses, those that are possible."""
    west, south, east, north = sea.begins.shape.bounds
    share = np.linspace(1e-3, 1 - 1e-3, side)  # what lies on the edge of the area counts as outside
    x, y, course = np.meshgrid(
        west + (east - west) * share,
        south + (north - south) * share,
        np.arange(courses) * 2 * math.pi / courses,
    )
    lon, lat = sphere.destination(*sea.middle, x.ravel(), y.ravel())
    some = Ways(lon, lat, course.ravel(), course.ravel(), np.ones(course.size))
    return some.take(np.flatnonzero(ways.possible(sea, some, time)))


@pytest.mark.parametrize(
    ("seed", "m", "side", "courses"),
    [
        (3, 150, 6, 8),
        pytest.param(3, 500, 9, 12, marks=pytest.mark.thorough),
        pytest.param(8, 500, 9, 12, marks=pytest.mark.thorough),
    ],
)
def test_no_way_of_a_grid_is_better(seed, m, side, courses):
    some = tracks(seed, m=m)
    sea = ways.sea(ship(seed), BEGIN, BEGIN + 18 * 3600)
    plan = placement.best_ways([sea], some, seed)
    hearer = heard.hearer(sea, some)
    every = grid(sea, side, courses, some.time)
    best = placement.worth(hearer, every, some.weight[:, None], placement.FINE).max()
    assert plan.value >= 0.99 * best


@pytest.mark.thorough
def test_what_a_way_hears_is_what_the_search_hears():
    """The planner's kernel against the same process in plain NumPy: ranges by the haversine, parts
    of 15 s, G by its recursion.
    """
    some = tracks(5, m=12)
    own = ship(5, sensor=Sensor("array", sonar(5, unknown=2.0)))
    sea = ways.sea(own, BEGIN, BEGIN + 18 * 3600)
    lon, lat = sphere.destination(*sea.middle, np.array([20 * NMI]), np.array([-9 * NMI]))
    way = Ways(lon, lat, np.array([2.1]), np.array([2.9]), np.array([0.4]))
    hearer = heard.hearer(sea, some)
    ours = heard.missed(hearer, way, 0.0, 100.0)[0]
    at = [x[0] for x in ways.ships_at(sea, way, some.time)]
    sees, rate = own.sensor.sees, 1 / 3600
    told, part = np.empty(ours.shape), (np.arange(240) + 0.5) / 240
    for i in range(some.m):
        track = [(x[:, i] * sphere.UNIT) for x in (some.lon, some.lat)]
        excess = []
        for t in range(some.bins):
            a, b = (
                np.array(geodesic(at[0][k], at[1][k], track[0][k], track[1][k])) for k in (t, t + 1)
            )
            heading = math.atan2(*geodesic(at[0][t], at[1][t], at[0][t + 1], at[1][t + 1]))
            east, north = (a + part[:, None] * (b - a)).T
            excess.append(equation(sees, np.hypot(east, north), np.arctan2(east, north), heading))
        for f, offset in enumerate(hearer.tables.offsets):
            told[i, f] = recursion(
                np.concatenate(excess) + offset, sees.fluctuation, rate, 3600 / 240
            )
    # Eight stairs cost 1 % of a miss (kernels.evidence.jumps); of the array's lobes, 300 m wide at
    # 3 nmi, parts of 100 m cost as much.
    assert ours == pytest.approx(told, rel=0.02)


def geodesic(lon, lat, to_lon, to_lat):
    """Return (east, north) [m] along the great circle, by its distance and azimuth."""
    from pyproj import Geod

    azimuth, _, far = Geod(a=sphere.RADIUS, b=sphere.RADIUS).inv(
        *np.degrees([lon, lat, to_lon, to_lat])
    )
    return far * math.sin(math.radians(azimuth)), far * math.cos(math.radians(azimuth))


def equation(sees, far, bearing, heading):
    """Return the signal excess by the sonar equation, from the records; far, bearing: (n,)."""
    turn = 2 * math.pi
    gains = sees.gain.beams.max(axis=0)
    gain = np.interp((bearing - heading) % turn, sees.gain.bearing, gains, period=turn)
    loud = np.interp(bearing % turn, sees.noise.bearing, sees.noise.level[0], period=turn)
    loss = np.interp(far, sees.losses.range, sees.losses.loss[0, 0], right=math.inf)
    return sees.levels.level[0, 0] - loss - (loud - gain) - sees.threshold


def recursion(excess, spread, rate, part):
    """Return G of parts in which the excess is constant; tests/kernels/evidence/test_jumps.py has
    the formula.
    """
    from scipy.stats import norm

    p = np.minimum(norm.cdf(excess / spread), 1 - 1e-12)
    # of each part: who jumped in it; the highest chance from it on
    ended, highest = np.empty(len(p)), np.zeros(len(p))
    inner = (np.exp(-rate * p * part) - math.exp(-rate * part)) / (1 - p)
    ages = np.exp(-rate * part * np.arange(len(p))[::-1])  # the last are of k - 1 parts, ..., 0
    for k in range(len(p)):
        np.maximum(highest[: k + 1], p[k], out=highest[: k + 1])
        begin = math.exp(-rate * part * k) * (1 - highest[0])
        begin += (ages[len(p) - k :] * ended[:k]) @ (1 - highest[:k])
        ended[k] = begin * inner[k]
    return begin * math.exp(-rate * p[-1] * part)


@pytest.mark.thorough
def test_two_ships_share_the_work():
    some = tracks(4, m=500)
    seas = [ways.sea(ship(4, name, legs=2), BEGIN, BEGIN + 18 * 3600) for name in ("one", "two")]
    plan = placement.best_ways(seas, some, 2)
    alone = max(placed.value for placed in plan.placed)
    assert plan.value > alone + 0.02
    assert plan.value == pytest.approx(alone + min(placed.adds for placed in plan.placed), abs=0.05)
    # Not worse than both on the best way of one, and than any pair of a grid.
    hearers = [heard.hearer(sea, some) for sea in seas]
    every = grid(seas[0], 5, 6, some.time)
    missed = heard.missed(hearers[0], every, placement.COARSE)[:, :, 0].astype(float)
    best = max(float((1 - missed[j] * missed[j:]).mean(axis=1).max()) for j in range(len(missed)))
    assert plan.value >= 0.99 * best


def test_arrays_of_one_group_share_an_unknown():
    """Against sums over the values of each group's unknown, written out; and a plan is worth what
    these say.
    """
    some = tracks(7, m=40)
    of = {"a": 3.0, "b": 2.0}
    seas = [
        ways.sea(
            ship(7, name, sensor=Sensor("array", sonar(7, unknown=of[group]), group=group)),
            BEGIN,
            BEGIN + 18 * 3600,
        )
        for name, group in (("one", "a"), ("two", "b"), ("three", "a"))
    ]
    hearers = [heard.hearer(sea, some) for sea in seas]
    rng = np.random.default_rng(7)
    missed = [rng.uniform(0, 1, (some.m, hearer.chances.size)) for hearer in hearers]
    told = np.zeros(some.m)
    for (f, p), (g, q) in itertools.product(
        *(list(enumerate(hearer.chances)) for hearer in hearers[:2])
    ):
        told += p * q * missed[0][:, f] * missed[1][:, g] * missed[2][:, f]
    assert placement.together(hearers, missed) == pytest.approx(told, rel=1e-12)
    for number in range(3):
        rest = placement.besides(hearers, [*missed[:number], None, *missed[number + 1 :]], number)
        assert (rest * missed[number]).sum(axis=1) == pytest.approx(told, rel=1e-12)
    apart = np.prod(
        [own @ hearer.chances for own, hearer in zip(missed, hearers, strict=True)], axis=0
    )
    assert np.abs(apart - told).max() > 0.01


@pytest.mark.thorough
@pytest.mark.parametrize(
    "seed", [*(pytest.param(seed, marks=pytest.mark.thorough) for seed in range(3)), 3]
)
def test_bound_holds_against_what_is_better_than_any_ship(seed):
    """A ship that jumps at each slot to the best of all places still hears no more than the bound
    says.
    """
    some = tracks(seed, m=300)
    sea = ways.sea(
        ship(seed, where=(-40, -40, 40, 40), allowed=box(-90, -90, 90, 90)),
        BEGIN,
        BEGIN + 18 * 3600,
    )
    plan = placement.best_ways([sea], some, seed)
    found = placement_bound.bound([sea], some, plan)
    assert found.plan <= found.value
    hearer = heard.hearer(sea, planning_tracks.coarser(some, placement.BINS))
    every = grid(sea, 9, 12, some.time)
    assert (
        placement.worth(hearer, every, hearer.tracks.weight[:, None], placement.FINE).max()
        <= found.value
    )


@pytest.mark.thorough
def test_a_bound_that_says_something():
    """In a small sea without zones and with a loud target cells lose little; in others the bound is
    loose, and says so.
    """
    some = tracks(11, m=400, hours=6, bins=12)
    water = spreading.losses(120 * NMI, transition=8000.0, absorption=0.012)
    loud = Levels(np.zeros(1), np.full((3, 1), 158.0, np.float32))
    own = sonar(11, losses=water, levels=loud)
    tow = ship(
        11, sensor=Sensor("array", own), where=(-20, -20, 20, 20), allowed=box(-30, -30, 30, 30)
    )
    sea = ways.sea(tow, BEGIN, BEGIN + 6 * 3600)
    found = placement_bound.bound([sea], some, placement.best_ways([sea], some, 1))
    assert 0.85 < found.plan / found.value <= 1
    assert found.value < 1


@pytest.mark.thorough
def test_ways_keep_to_what_is_asked():
    some = tracks(6, m=600)
    asked = ship(
        6, courses=(math.radians(300), math.radians(40)), allowed=box(-60, -50, 60, 80), legs=2, endurance=9 * 3600.0,
        base=tuple(np.degrees(sphere.destination(*MIDDLE, -100 * NMI, 0.0))), transit_speed=14 * KNOT,
    )  # fmt: skip
    sea = ways.sea(asked, BEGIN, BEGIN + 18 * 3600)
    plan = placement.best_ways([sea], some, 3)
    way = plan.placed[0].way
    legs = ways.legs(sea, way, 0)
    lon, lat = np.radians(legs.lon), np.radians(legs.lat)
    assert (
        legs.time[0]
        >= BEGIN
        + sphere.distance(*np.radians(asked.base), lon[0], lat[0]) / asked.transit_speed
        - 1
    )
    assert legs.time[-1] - legs.time[0] <= 9 * 3600
    for course in (float(way.course[0]), float(way.second[0])):
        assert np.mod(course - math.radians(300), 2 * math.pi) <= math.radians(100) + 1e-6
    length = sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:]).sum()
    assert length / (legs.time[-1] - legs.time[0]) == pytest.approx(asked.speed, rel=1e-3)
    inside = ways.region(asked.allowed).holds(lon, lat)
    assert inside.all()


def test_without_a_plan_one_goes_from_the_middle_within_the_sector():
    """A sector of 100 degrees through north: the first of its eight courses that is possible."""
    asked = ship(6, courses=(math.radians(300), math.radians(40)))
    way = placement._middle(ways.sea(asked, BEGIN, BEGIN + 18 * 3600), np.array([BEGIN]))
    assert math.degrees(way.course[0]) == pytest.approx(300 + 100 / 16)


def test_a_ship_that_cannot_go_anywhere_says_so():
    sea = ways.sea(ship(1, allowed=box(200, 200, 210, 210)), BEGIN, BEGIN + 18 * 3600)
    with pytest.raises(ValueError, match="ship has no track"):
        placement.best_ways([sea], tracks(1, m=500), 1)


@pytest.mark.thorough
def test_the_same_seed_gives_the_same_plan():
    some, sea = tracks(9, m=200), ways.sea(ship(9), BEGIN, BEGIN + 18 * 3600)
    a, b = (placement.best_ways([sea], some, 4) for _ in range(2))
    assert a.value == b.value
    assert a.placed[0].way.lon == b.placed[0].way.lon
