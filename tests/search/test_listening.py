"""Watches of passive sonars, particle by particle, against the sonar equation and the renewal equation in float64.

How far a log weight may be off is told in decibels: as far as that of a sonar that is TOLERANCE better or worse. Noise and the
array's heading are those of the middle of a part, in which the noise changes by a quarter of a decibel (0.13); tables are
those of the array's middle place (0.05 here), bearings are laid out to a tenth of a degree (0.02), and the rule of parts and the
oracle's own times leave the rest.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sonars
from sonars import KNOT, NMI, Sonar, Way, heard, louder, missed, rhumb, run

TOLERANCE = 0.25  # [dB]
ROUNDING = 2e-5  # of float32 in logs of weights
RAFT = """
[[current]]
constant = { speed = "0 kn", toward = 0 }
[[scenario]]
name = "raft"
object = "water"
position = { at = [-30.0, 36.0], std = "25 nmi" }
"""
RANGES = np.arange(0, 120_001.0, 2000.0)
RADIALS, SIDES, AROUND = (np.arange(0, 360, by, float) for by in (30, 15, 45))
NOISE = np.array(
    [[70, 73, 71, 75, 72, 70, 74, 69.0], [72, 75, 74, 75, 73, 71, 75, 70.0], [69, 70, 74, 77, 72, 75, 70, 69.0]]
)


def losses(number: int, radials: np.ndarray = RADIALS) -> np.ndarray:
    """Return losses of a place, with a convergence zone: those of no two bearings and no two places are the same."""
    spread = 60 + (11 + number) * np.log10(1 + RANGES / 1000)
    zone = 9 * np.exp(-(((RANGES - 55_000 - 5000 * number) / 5000) ** 2))
    turned = np.sin(np.radians(radials + 40 * number))[:, None] * np.minimum(RANGES / 3e4, 1)
    return np.round(spread - zone + 4 * turned, 3)


def array(*places: tuple[float, float], radials: np.ndarray = RADIALS, **more: Any) -> Sonar:
    """Return a sonar whose port side is not like its starboard side."""
    gain = np.round(4 + 5 * np.cos(np.radians(SIDES - 50)) + 2 * np.sin(np.radians(3 * SIDES)), 3)
    own: dict[str, Any] = {
        "places": places, "radials": radials, "ranges": RANGES, "hours": (0.0, 2.5, 6.0), "around": AROUND, "noise": NOISE,
        "loss": np.stack([losses(k, radials) for k in range(max(len(places), 1))]), "sides": SIDES, "gain": gain,
        "levels": {"raft": 140.0},
    }  # fmt: skip
    return Sonar(**own | more)


def agree(
    found: np.ndarray, expected: Callable[[Sonar], np.ndarray], sonar: Sonar, tolerance: float = TOLERANCE
) -> float:
    """Hold logs of weights against those expected of a sonar; return the worst deviation [1]."""
    better, worse = (expected(louder(sonar, more)) for more in (tolerance, -tolerance))
    off = found - expected(sonar)
    assert np.all(found > better - ROUNDING), (better - found).max()
    assert np.all(found < worse + ROUNDING), (found - worse).max()
    return float(np.abs(off).max())


TURN = Way((0.7, 2.9, 5.4), ((-30.3, 35.8), (-30.0, 36.1), (-29.6, 36.0)))
PLACES = (-30.5, 35.6), (-29.2, 35.7), (-29.9, 36.6)


def towed(sonar: Sonar, way: Way = TURN, more: str = "") -> str:
    return f'[[sortie]]\nname = "w"\nwaypoints = {way.text()}\nwatch = {{ sensor = "{sonar.name}" }}\n{more}'


def times(way: Way, many: int) -> np.ndarray:
    """Return times of a way, those just before and after each turn among them."""
    turns = [hour + by for hour in way.hours[1:-1] for by in (-1e-6, 1e-6)]
    return np.unique(np.concatenate([np.linspace(way.hours[0], way.hours[-1], many), turns]))


def nearest(way: Way, lon: np.ndarray, lat: np.ndarray, hours: np.ndarray) -> np.ndarray:
    return np.min([sonars.toward(way.at(hour)[0], lon, lat)[1] for hour in hours], axis=0)


@pytest.mark.parametrize(
    ("sonar", "step"),
    [
        (array(*PLACES), 5),
        (array(*PLACES), 30),
        (array(*PLACES), 60),
        (array(*PLACES[:2]), 30),
        (array(radials=RADIALS + 5), 30),
        (array(around=AROUND + 10), 30),
        (
            array(
                sides=np.array([0, 50, 90, 135, 180, 230, 270, 315.0]),
                gain=np.array([15, 0, 4, 10, -3, 0, 6, 2.0]),
            ),
            30,
        ),
    ],
    ids=["5 min", "30 min", "60 min", "two places", "radials from 5", "noise from 10", "few gains"],
)
def test_an_array_that_turns_past_what_is_at_rest(tmp_path: Path, sonar: Sonar, step: int) -> None:
    """Two legs, gains by side, noise by bearing and time, losses by place, bearing and range."""
    ran = run(tmp_path, RAFT + sonar.text(tmp_path) + towed(sonar), step=step, particles=160)
    hours = times(TURN, 471)
    # What it passes within a mile changes its bearing faster than the oracle's times tell; see the next test.
    far = nearest(TURN, *ran.first.T, hours) > NMI
    assert far.mean() > 0.95
    lon, lat = ran.first[far].T

    def expected(own: Sonar) -> np.ndarray:
        source = own.source("raft", np.zeros(len(lon)))
        return np.log(missed(heard(own, TURN.at, hours, lambda _: (lon, lat, source)), hours, own.rate)[:, -1])

    assert ran.said.min() < -1.5
    assert agree(ran.said[far], expected, sonar) < 0.05


def test_an_array_that_passes_close_by(tmp_path: Path) -> None:
    """At 700 m to 2 km, of a target that is not loud: the oracle by times of six seconds."""
    case = RAFT.replace('[-30.0, 36.0], std = "25 nmi"', '[-30.15, 35.96], std = "1 nmi"')
    sonar = array(levels={"raft": 120.0})
    ran = run(tmp_path, case + sonar.text(tmp_path) + towed(sonar), step=30, particles=60)
    hours = np.linspace(0.7, 2.9, 1321)
    far = nearest(TURN, *ran.first.T, hours)
    chosen = (far > 700) & (far < 2000)
    assert chosen.sum() > 15
    lon, lat = ran.first[chosen].T
    hours = np.concatenate([hours[:-1], [2.9 - 1e-6, 2.9 + 1e-6], np.linspace(2.9, 5.4, 301)[1:]])

    def expected(own: Sonar) -> np.ndarray:
        source = own.source("raft", np.zeros(len(lon)))
        return np.log(missed(heard(own, TURN.at, hours, lambda _: (lon, lat, source)), hours, own.rate)[:, -1])

    agree(ran.said[chosen], expected, sonar)


def test_transit_legs_hear_nothing(tmp_path: Path) -> None:
    """Of three legs the middle one: what was not heard on the first is drawn anew on it."""
    way = Way((0.5, 2.0, 3.5, 5.5), ((-30.3, 35.8), (-30.1, 36.0), (-30.0, 35.7), (-29.6, 36.0)))
    sonar = array(rate=0.4)
    ran = run(tmp_path, RAFT + sonar.text(tmp_path) + towed(sonar, way, "transit_legs = [2]\n"), particles=100)
    hours = times(way, 401)
    far = nearest(way, *ran.first.T, hours) > NMI
    lon, lat = ran.first[far].T

    def expected(own: Sonar) -> np.ndarray:
        source = own.source("raft", np.zeros(len(lon)))
        chances = heard(own, way.at, hours, lambda _: (lon, lat, source), silent=lambda hour: 2 <= hour < 3.5)
        return np.log(missed(chances, hours, own.rate)[:, -1])

    agree(ran.said[far], expected, sonar)


# What moves past a sonar that stands: by scenario, where it is and how loud.
CURRENT = (1.3, 63.0)  # [kn] toward
PORTS = ((-30.9, 35.7), (-30.35, 36.15), (-29.7, 35.9))
STEAD = (-30.2, 35.75)
MOVING = f"""
[[current]]
constant = {{ speed = "{CURRENT[0]} kn", toward = {CURRENT[1]} }}
[[scenario]]
name = "raft"
object = "water"
position = {{ at = [-30.0, 36.0], std = "15 nmi", time = "+0 h", until = "+4 h" }}
[[scenario]]
name = "steady"
position = {{ at = [-30.5, 36.0], std = "10 nmi" }}
[[scenario.phase]]
course.course = 127
course.speed = "9 kn"
[[scenario]]
name = "voyage"
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = {[list(at) for at in PORTS]}
departure = ["+0 h", "+2.5 h"]
speed = "15 kn"
[[scenario]]
name = "yacht"
object = "water"
distress = {{ between = ["+0.5 h", "+5 h"] }}
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = {[list(at) for at in PORTS]}
departure = ["+0 h", "+1 h"]
speed = "7 kn"
"""
LEVELS = {
    "raft": 141.0,
    "steady": [(3, 121.0), (12, 143.0)],
    "voyage": [(5, 118.0), (10, 131.0), (20, 140.0)],
    "yacht": [(0, 150.0), (1, 139.0), (6, 131.0), (9, 137.0)],
}


def on_voyage(miles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where so many miles from the first port are, along great circles."""
    legs = [sonars.GLOBE.inv(*a, *b) for a, b in zip(PORTS, PORTS[1:], strict=False)]
    ends = np.cumsum([0.0, *(leg[2] for leg in legs)])
    far = np.clip(miles * NMI, 0, ends[-1])
    leg = np.clip(np.searchsorted(ends, far, side="right") - 1, 0, len(legs) - 1)
    course = np.array([own[0] for own in legs])[leg]
    first = np.array(PORTS)[leg]
    lon, lat, _ = sonars.GLOBE.fwd(first[:, 0], first[:, 1], course, far - ends[leg])
    return np.asarray(lon), np.asarray(lat)


LENGTH = sum(sonars.GLOBE.inv(*a, *b)[2] for a, b in zip(PORTS, PORTS[1:], strict=False)) / NMI


def targets(ran: sonars.Ran, sonar: Sonar) -> Callable[[float], tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return what gives places and source levels at a time, from what was drawn of each at the begin."""
    columns = {name: column.to_numpy() for name, column in ran.ensemble.columns.items()}
    release, left = columns["release"] / 3600, columns["departure"] / 3600
    names = np.array(list(LEVELS))[ran.scenario]
    distress = np.stack(on_voyage(7.0 * (release - left)), axis=-1)

    def at(hour: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        lon, lat, source = *ran.first.T.copy(), np.full(len(names), -np.inf)
        raft = names == "raft"
        drifted = CURRENT[0] * KNOT * 3600 * np.maximum(hour - release, 0)
        lon[raft], lat[raft] = rhumb(lon[raft], lat[raft], CURRENT[1], drifted[raft])
        source[raft & (release <= hour)] = sonar.source("raft", 0.0)
        steady = names == "steady"
        lon[steady], lat[steady] = rhumb(lon[steady], lat[steady], 127.0, 9 * NMI * hour)
        source[steady] = sonar.source("steady", 9.0)
        for name, speed in (("voyage", 15.0), ("yacht", 7.0)):
            own = names == name
            miles = speed * (hour - left[own])
            lon[own], lat[own] = on_voyage(miles)
            source[own] = np.where((miles >= 0) & (miles <= LENGTH), sonar.source(name, speed), -np.inf)
        adrift = (names == "yacht") & (release <= hour) & (7.0 * (release - left) < LENGTH)
        lon[adrift], lat[adrift] = rhumb(*distress[adrift].T, CURRENT[1], drifted[adrift])
        source[adrift] = sonar.source("yacht", CURRENT[0])
        return lon, lat, source

    return at


@pytest.mark.parametrize("step", [5, 10, 30, 60])
def test_what_moves_past_a_sonar(tmp_path: Path, step: int) -> None:
    """What drifts, is released late, keeps a course, bends, arrives, and goes adrift while it is listened for."""
    sonar = array(at=STEAD, heading=205.0, levels=LEVELS, unknown=0.0)
    watch = '[[sortie]]\nname = "w"\nstart = "+0.3 h"\nend = "+5.6 h"\nwatch = { sensor = "ears" }\n'
    ran = run(tmp_path, MOVING + sonar.text(tmp_path) + watch, step=step, particles=240)
    hours = np.linspace(0.3, 5.6, 531)
    every = np.array([targets(ran, sonar)(hour)[:2] for hour in hours])
    far = np.min([sonars.toward(STEAD, *places)[1] for places in every], axis=0) > NMI

    def expected(own: Sonar) -> np.ndarray:
        where = targets(ran, own)

        def these(hour: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            lon, lat, source = where(hour)
            return lon[far], lat[far], source[far]

        chances = heard(own, lambda _: (STEAD, 205.0), hours, these)
        return np.log(missed(chances, hours, own.rate)[:, -1])

    assert all(ran.said[far & (ran.scenario == k)].min() < -0.3 for k in range(4))
    agree(ran.said[far], expected, sonar)
