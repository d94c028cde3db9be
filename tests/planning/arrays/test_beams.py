"""What beams hear of particles, against NumPy and SciPy from the same tables, and the integral
equation of lambda-sigma.
"""

import math

import numpy as np
import pytest
from scipy import integrate, stats
from scipy.interpolate import RegularGridInterpolator

from drift.evidence.sensors import line_array
from drift.evidence.sensors.records import Gain, Levels, Listener, Losses, Noise, Sensor, Sonar
from drift.planning.arrays import beams
from drift.planning.search.planning_tracks import Tracks
from geo import polyline, sphere
from kernels.runtime import runtime

RADIUS = 6_371_000.0  # [m]
START = 1_780_272_000  # [s since 1970]
RATE = 1 / 2400  # [1/s]
HEADING = math.radians(35)
PLACE = (179.6, 41.0)  # [deg] 34 km west of the antimeridian
RAYS = np.radians([0.0, 90.0, 180.0, 270.0])
RINGS = np.linspace(0, 120_000, 61)
# 20 log r with a zone at 60 km, deeper to the east; west of it 3 dB more is lost everywhere.
LOSS = np.stack(
    [
        20 * np.log10(np.maximum(RINGS, 1000))
        + extra
        - gain * np.exp(-(((RINGS - 60_000) / 5000) ** 2))
        for extra, gain in ((0, 6), (0, 10), (1, 6), (3, 6))
    ]
)
NOISE = np.array([70.0, 73.0, 71.0, 69.0])  # by RAYS
WIDE = 0.01  # of M: a staircase of many peaks errs by it (kernels.evidence.jumps)


@pytest.fixture(autouse=True, scope="module")
def started():
    runtime.start()


def sonar(gain: Gain, unknown: float = 0.0) -> Sonar:
    return Sonar(
        Levels(np.array([0.0, 10.0]), np.array([[158.0, 166.0], [156.0, 156.0]], np.float32)),
        Losses(RAYS, RINGS, LOSS[None].astype(np.float32), np.zeros(0), np.zeros(0)),
        Noise(RAYS, NOISE[None].astype(np.float32), np.zeros(0, "datetime64[s]")),
        gain, 5.0, 6.0, RATE, unknown,
    )  # fmt: skip


def line(count: int = 5) -> Gain:
    return line_array.of_line(8, 12.0, 50.0, beams=count)


def tracks(ways, hours=4.0, bins=8, scenario=None) -> Tracks:
    """Return particles that go straight; ways: rows of lon, lat [deg] at first and at last."""
    share = np.linspace(0, 1, bins + 1)[:, None]
    begin, end = np.array(ways, float)[:, :2], np.array(ways, float)[:, 2:]
    lon, lat = (begin[:, k] + share * (end[:, k] - begin[:, k]) for k in (0, 1))
    m = len(ways)
    return Tracks(
        START + share[:, 0] * hours * 3600, sphere.to_binary(lon), sphere.to_binary(lat), np.ones((bins + 1, m), bool),
        np.full(m, 1 / m), np.zeros(m, np.int32) if scenario is None else np.array(scenario, np.int32),
        np.full(m, float(START)),
    )  # fmt: skip


def edges(*hours: float):
    return np.array([START + round(3600 * h) for h in hours], "datetime64[s]")


def toward(here, there) -> tuple[float, float]:
    """Return range [m] and true bearing [rad] on the sphere, by haversines."""
    (x, y), (u, v) = np.radians(here), np.radians(there)
    a = math.sin((v - y) / 2) ** 2 + math.cos(y) * math.cos(v) * math.sin((u - x) / 2) ** 2
    bearing = math.atan2(
        math.sin(u - x) * math.cos(v),
        math.cos(y) * math.sin(v) - math.sin(y) * math.cos(v) * math.cos(u - x),
    )
    return 2 * RADIUS * math.asin(math.sqrt(a)), bearing % (2 * math.pi)


def chance_now(own: Sonar, beam: int, here, heading: float, there, level: float) -> float:
    """Return the probability that excess and a fluctuation drawn again are above 0, from the
    tables.
    """
    far, bearing = toward(here, there)
    if far > RINGS[-1]:
        return 0.0
    closed = np.append(RAYS, 2 * math.pi)
    loss = RegularGridInterpolator((closed, RINGS), np.vstack([LOSS, LOSS[:1]]))([bearing, far])[0]
    noise = np.interp(bearing, closed, np.append(NOISE, NOISE[0]))
    gain = np.interp(
        (bearing - heading) % (2 * math.pi),
        np.append(own.gain.bearing, 2 * math.pi),
        np.append(own.gain.beams[beam], own.gain.beams[beam][0]),
    )
    return float(stats.norm.cdf((level - loss - noise + gain - own.threshold) / own.fluctuation))


def missed(p, lasting: float) -> float:
    """Return M at the end by the integral equation (McCabe and Belkin 1973); p: chances at evenly
    spaced times.
    """
    p = np.asarray(p, float)
    n, dt = len(p), lasting / (len(p) - 1)
    m = np.empty(n)
    for k in range(n):
        highest = np.maximum.accumulate(p[k::-1])[::-1]  # of all from s to now
        kernel = RATE * np.exp(-RATE * dt * (k - np.arange(k + 1))) * (1 - highest)
        known = 0.0 if k == 0 else dt * (kernel[1:k] @ m[1:k] + 0.5 * kernel[0] * m[0])
        m[k] = (math.exp(-RATE * k * dt) * (1 - highest[0]) + known) / (
            1 - (0.5 * dt * kernel[k] if k else 0.0)
        )
    return float(m[-1])


def test_of_a_particle_that_lies_still():
    """A closed form: M = (1 - p) exp(-lambda p t)."""
    own = sonar(line())
    there = (180.3, 41.2)
    field = beams.field(
        [Listener("a", Sensor("a", own, PLACE, HEADING, "a"))],
        tracks([(*there, *there)]),
        edges(0, 1.3, 4),
        1,
    )
    found = [table.toarray() for table in beams.chances(field)]
    chances = np.array([chance_now(own, beam, PLACE, HEADING, there, 158.0) for beam in range(5)])
    assert chances.max() > 0.2 > chances.min()  # it tells beams apart
    for table, hours in zip(found, (1.3, 2.7), strict=True):
        expected = 1 - (1 - chances) * np.exp(-RATE * chances * hours * 3600)
        # Positions of 1 cm and single precision: of 1e-4 dB, and of exp.
        assert table[0] == pytest.approx(np.where(expected < 1e-6, 0, expected), abs=2e-5)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "passing", [(178.9, 40.7, 180.6, 41.9), (179.2, 42.0, 180.5, 40.2), (180.6, 40.9, 180.35, 41.9)]
)
def test_of_a_particle_that_passes(passing):
    """By the integral equation, at times of 12 s; one goes through the zone, one close by, one
    faster than its level changes.
    """
    own = sonar(line())
    field = beams.field(
        [Listener("a", Sensor("a", own, PLACE, HEADING, "a"))], tracks([passing]), edges(0, 4), 1
    )
    found = beams.chances(field)[0].toarray()[0]
    share = np.linspace(0, 1, 1201)
    places = [
        (passing[0] + s * (passing[2] - passing[0]), passing[1] + s * (passing[3] - passing[1]))
        for s in share
    ]
    speed = toward(places[600], places[601])[0] / 12
    level = np.interp(speed, [0, 10], [158, 166])
    expected = []
    for beam in range(5):
        now = [chance_now(own, beam, PLACE, HEADING, place, level) for place in places]
        expected.append(1 - missed(now, 4 * 3600))
    assert found == pytest.approx(np.array(expected), abs=WIDE)
    assert max(expected) > 0.3


def test_of_an_array_that_is_towed_and_turns():
    """Its heading is its course, and it listens while it is on its way; the particle lies still."""
    own = sonar(line())
    legs = polyline.legs_through(
        [START + 1800, START + 5400, START + 9000], [179.2, 179.7, 179.7], [41.0, 41.0, 41.35]
    )
    there = (180.2, 41.3)
    field = beams.field(
        [Listener("tail", Sensor("tail", own, None, 0.0, "tail"), legs)],
        tracks([(*there, *there)]),
        edges(0, 4),
        1,
    )
    found = beams.chances(field)[0].toarray()[0]
    times = np.linspace(1800, 9000, 601)
    at = [
        (179.2 + 0.5 * min((t - 1800) / 3600, 1), 41 + 0.35 * max((t - 5400) / 3600, 0))
        for t in times
    ]
    # The great circle between two places of a parallel leaves it by 140 m here; its course turns by
    # 0.3 degrees.
    heading = [toward((179.2, 41.0), (179.7, 41.0))[1] if t < 5400 else 0.0 for t in times]
    expected = [
        1
        - missed(
            [
                chance_now(own, beam, here, ahead, there, 158.0)
                for here, ahead in zip(at, heading, strict=True)
            ],
            7200,
        )
        for beam in range(5)
    ]
    # Of what remains the fluctuation forgets nothing that was heard: nothing is heard afterwards.
    assert found == pytest.approx(np.array(expected), abs=WIDE)
    assert max(expected) > 0.2


def test_an_image_is_heard_as_the_target_is():
    """A line cannot tell port from starboard: in water that is the same all round both are heard
    alike.
    """
    own = sonar(line())
    even = Sonar(own.levels, Losses(np.zeros(1), RINGS, LOSS[None, :1].astype(np.float32), np.zeros(0), np.zeros(0)),
                 Noise(np.zeros(1), np.full((1, 1), 70, np.float32), np.zeros(0, "datetime64[s]")), own.gain, 5.0, 6.0, RATE)  # fmt: skip
    both = [
        sphere.destination(
            *np.radians(PLACE), 40_000 * math.sin(HEADING + side), 40_000 * math.cos(HEADING + side)
        )
        for side in (1.0, -1.0)
    ]
    ways = [(*np.degrees([float(x), float(y)]), *np.degrees([float(x), float(y)])) for x, y in both]
    field = beams.field(
        [Listener("a", Sensor("a", even, PLACE, HEADING, "a"))], tracks(ways), edges(0, 4), 1
    )
    found = beams.chances(field)[0].toarray()
    assert found[0] == pytest.approx(found[1], abs=2e-5)
    assert found[0].max() > 0.1


def test_an_unknown_is_shared_by_a_group_and_by_all_slots():
    """The mean over many particles at one place is the integral over the unknown, of products of
    misses.
    """
    own = sonar(line(), unknown=5.0)
    there, m = (180.3, 41.2), 4000
    listeners = [
        Listener(name, Sensor(name, own, PLACE, heading, "pair"))
        for name, heading in (("a", HEADING), ("b", 0.5))
    ]
    field = beams.field(listeners, tracks([(*there, *there)] * m), edges(0, 2, 4), 1)
    tables = [table.toarray().astype(float) for table in beams.chances(field)]
    for one, other in ((2, 7), (1, 5)):
        found = 1 - np.mean((1 - tables[0][:, one]) * (1 - tables[1][:, other]))

        def both(u, one=one, other=other):
            silent = 1.0
            for beam, heading in ((one, HEADING), (other - 5, 0.5)):
                p = chance_now(own, beam, PLACE, heading, there, 158.0 + u)
                silent *= (1 - p) * math.exp(-RATE * p * 7200)
            return silent * stats.norm.pdf(u, 0, 5)

        # Each 4000th part of the distribution has one value: what is monotone in it errs by less
        # than its range / 8000 at the middle of each.
        assert found == pytest.approx(1 - integrate.quad(both, -40, 40)[0], abs=1 / m)


def test_what_is_carried_from_slot_to_slot():
    """The same beam in every slot is one watch of all of them; two beams of an array are one that
    hears as its best.
    """
    own = sonar(line())
    there = (180.3, 41.2)
    field = beams.field(
        [Listener("a", Sensor("a", own, PLACE, HEADING, "a"))],
        tracks([(*there, *there)]),
        edges(0, 1, 2, 3, 4),
        1,
    )
    chances = [chance_now(own, beam, PLACE, HEADING, there, 158.0) for beam in range(5)]
    best, second = np.argsort(chances)[::-1][:2]
    p = chances[best]
    expected = 1 - (1 - p) * math.exp(-RATE * p * 4 * 3600)
    for chosen in (((best,),) * 4, (tuple(sorted((best, second))),) * 4):
        assert beams.carried(field, chosen)[0] == pytest.approx(expected, abs=2e-5)
    # In two slots of four, one after the other: what it was deaf to in between may have changed.
    now = np.repeat([p, 0, p, 0], 300)
    assert beams.carried(field, ((best,), (), (best,), ()))[0] == pytest.approx(
        1 - missed(now, 4 * 3600), abs=WIDE
    )
    assert beams.carried(field, ((),) * 4)[0] == 0


def test_beams_are_called_by_where_they_look():
    own = sonar(line(3))
    stands = Listener("a", Sensor("a", own, PLACE, math.radians(30), "a"))
    assert beams.looks(stands) == ["000R 030T", "090R 120/300T", "180R 210T"]
    assert beams.looks(Listener("t", Sensor("t", own, None, 0.0, "t"), tow="ship")) == [
        "000R",
        "090R",
        "180R",
    ]


def test_tracks_at_other_edges_are_the_same_tracks():
    """Across the antimeridian, and with a particle that can be heard in part of the time."""
    some = tracks([(179.5, 40, -179.5 + 360, 41), (170, 10, 171, 12)])
    some.adrift[3:, 1] = False
    time = np.unique(np.concatenate([some.time, START + np.array([100.0, 5000.0, 12_000.0])]))
    found = beams.at_edges(some, time)
    lon, lat = sphere.to_degrees(found.lon), sphere.to_degrees(found.lat)
    share = (time - START) / (4 * 3600)
    assert np.mod(lon[:, 0], 360) == pytest.approx(179.5 + share, abs=1e-6)
    assert lat[:, 0] == pytest.approx(40 + share, abs=1e-6)
    # It can be heard to the second edge: in bins that end later it cannot.
    assert found.adrift[:, 1].tolist() == (time <= some.time[2]).tolist()
