"""Shipped cases of targets that steer, drawn in plain float64 by tests/oracles/second_opinions/passages.py."""

import itertools
import re
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import passages
from oracle import HOUR, KNOT, NMI
from places import ROOT

from drift.engine.particles.status import Status

CASES = ROOT / "cases"
# of the oracle, a scenario
THEIRS = {"cast_submarine": 12_000, "medsearch_transit": 5_000, "smuggler_bridge": 12_000}
Array = np.ndarray


def table(name: str) -> dict[str, Any]:
    """Return a case's tables as written."""
    return tomllib.loads((CASES / f"{name}.toml").read_text())


def place(text: str) -> tuple[float, float]:
    """Return longitude and latitude [deg] of a text like 46 20N 027 40W."""
    (lat, ns), (lon, ew) = re.findall(r"([\d. ]+)([NSEW])", text)
    degrees = [sum(float(part) / 60**k for k, part in enumerate(one.split())) for one in (lat, lon)]
    return degrees[1] * (-1 if ew == "W" else 1), degrees[0] * (-1 if ns == "S" else 1)


def number(value: Any) -> float:
    """Return a quantity in SI, or a bare number."""
    if not isinstance(value, str):
        return float(value)
    size, unit = value.split()
    units = {
        "nmi": NMI,
        "kn": KNOT,
        "min": 60.0,
        "h": HOUR,
        "/h": 1 / HOUR,
        "nmi/sqrt(h)": NMI / HOUR**0.5,
    }
    return float(size) * units[unit]


def spread(rng: np.random.Generator, n: int, told: Any) -> Array:
    """Draw an uncertain number as a case has it: a value, [low, high], or a truncated triangle."""
    if isinstance(told, dict):
        low, best, high = (number(told[k]) for k in told if k != "ratio")
        return passages.triangle(rng, n, low, best, high, told["ratio"])
    low, high = told if isinstance(told, list) else (told, told)
    return rng.uniform(number(low), number(high), n)


@dataclass(frozen=True)
class Where:
    """Where the particles of a scenario are, and what has become of each."""

    lon: Array  # (n,) [deg]
    lat: Array
    status: Array  # (n,) of Status


def probable(std: Any) -> float:
    """Return the semi-axis of an ellipse [standard deviations] that holds a probability."""
    return float(np.sqrt(-2 * np.log1p(-std)))


def cast_submarine(rng: np.random.Generator, n: int, hours: float) -> list[Where]:
    """A fix with course and speed, and a track with a random start that ends in a patrol."""
    return [places[0] for places in cast_ways(rng, n, [hours])]


def cast_ways(rng: np.random.Generator, n: int, hours: Sequence[float]) -> list[list[Where]]:
    """Return where the same submarines are at each of some times, by scenario."""
    first, second = table("cast_submarine")["scenario"]
    fix, motion, moments = (
        first["position"]["ellipse"],
        first["phase"][0]["course"],
        [h * HOUR for h in hours],
    )
    scale = probable(fix["probability"])
    lon, lat = passages.about(
        rng, place(first["position"]["at"]), n, number(fix["major"]) / scale, number(fix["minor"]) / scale,
        fix["orientation"],
    )  # fmt: skip
    course, speed = spread(rng, n, motion["course"]), spread(rng, n, motion["speed"])
    told = [
        [
            Where(*passages.rhumb(lon, lat, course, speed * time), np.full(n, Status.UNDER_WAY))
            for time in moments
        ]
    ]

    track, patrol = second["phase"][0]["track"], second["phase"][1]["loiter"]
    begin = rng.uniform(*(number(one[1:]) for one in track["start"]), n)
    a, b, c = track["points"]
    wide = probable(b["ellipse"]["probability"])
    far, to = number(c["radius"]) * np.sqrt(rng.uniform(size=n)), rng.uniform(0, 360, n)
    points = [
        passages.about(rng, place(a["at"]), n, number(a["std"]), number(a["std"])),
        passages.about(
            rng, place(b["at"]), n, number(b["ellipse"]["major"]) / wide, number(b["ellipse"]["minor"]) / wide,
            b["ellipse"]["orientation"],
        ),
        passages.off(place(c["at"]), far * np.cos(np.radians(to)), far * np.sin(np.radians(to)), 0.0),
    ]  # fmt: skip
    times = [begin + spread(rng, n, one["after"]) for one in track["points"]]
    lon, lat = (np.stack([one[k] for one in points], axis=1) for k in (0, 1))
    ring, pace = [place(one) for one in patrol["polygon"]], spread(rng, n, patrol["speed"])
    ends = [time - times[-1] for time in moments]
    patrols = passages.loiter(rng, ring, lon[:, -1], lat[:, -1], ends, pace, number(patrol["leg"]))
    told.append([])
    for time, left, there in zip(moments, ends, patrols, strict=True):
        way = passages.passed(lon, lat, np.stack(times, axis=1), time)
        x, y = (np.where(left > 0, b, a) for a, b in zip(way, there, strict=True))
        told[-1].append(Where(x, y, np.where(begin < time, Status.UNDER_WAY, Status.PENDING)))
    return told


@dataclass(frozen=True)
class Transit:
    """Way points (lon, lat, time) (n, k) of submarines on a route, and the patrol after it."""

    lon: Array
    lat: Array
    time: Array  # [s]
    patrol: dict[str, Any]
    pace: Array  # (n,) [m/s] on patrol

    def at(self, time: float | Array) -> tuple[Array, Array]:
        """Return where they are at a time [s] on their route."""
        return passages.passed(self.lon, self.lat, self.time, time)


def transits(rng: np.random.Generator, n: int) -> list[Transit]:
    """Return the submarines of each scenario of medsearch_transit."""
    found = []
    nodes, lanes = passages.network(CASES / "networks" / "mediterranean.toml")
    for scenario in table("medsearch_transit")["scenario"]:
        leg, patrol = scenario["phase"][0]["lanes"], scenario["phase"][1]["loiter"]
        route = passages.shortest(
            nodes, lanes, [leg["route"]["from"], *leg["route"]["via"], leg["route"]["to"]]
        )
        width = [lanes[pair] for pair in itertools.pairwise(route)]
        lon, lat, along = passages.aside(
            [nodes[one] for one in route], width, rng.uniform(-1, 1, n)
        )
        entry = {k: v[1:] if isinstance(v, str) else v for k, v in leg["entry"].items()}
        time = spread(rng, n, entry)[:, None] + along / spread(rng, n, leg["speed"])[:, None]
        found.append(Transit(lon, lat, time, patrol, spread(rng, n, patrol["speed"])))
    return found


def medsearch_transit(rng: np.random.Generator, n: int, hours: float) -> list[Where]:
    """Twelve routes along lanes, then an area of patrol."""
    return [patrolled(rng, one, hours * HOUR) for one in transits(rng, n)]


def patrolled(rng: np.random.Generator, one: Transit, time: float) -> Where:
    """Return where submarines are at a time on their route or on patrol."""
    left = time - one.time[:, -1]
    (at,) = passages.loiter(
        rng, one.patrol["polygon"], *one.at(time), [left], one.pace, number(one.patrol["leg"])
    )
    return Where(*at, np.where(one.time[:, 0] < time, Status.UNDER_WAY, Status.PENDING))


def touched(one: Transit, points: Sequence[str]) -> Array:
    """Return when submarines first meet a barrier, a great circle between two places, on their
    lanes [s]; inf: never.
    """

    def vectors(lon: Any, lat: Any) -> Array:
        x, y = np.radians(lon), np.radians(lat)
        return np.stack([np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y)], axis=-1)

    def angle(a: Array, b: Array) -> Array:
        return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1))

    first, last = (vectors(*place(point)) for point in points)
    nodes = vectors(one.lon, one.lat)
    above = nodes @ np.cross(first, last)  # the plane of the barrier
    a, b, over, under = nodes[:, :-1], nodes[:, 1:], above[:, :-1, None], above[:, 1:, None]
    meets = a * np.abs(under) + b * np.abs(over)  # where the chord of a leg meets the plane
    meets /= np.linalg.norm(meets, axis=-1, keepdims=True)
    hits = (over * under < 0)[..., 0] & (
        angle(first, meets) + angle(meets, last) < angle(first, last) + 1e-12
    )
    when = one.time[:, :-1] + angle(a, meets) / angle(a, b) * np.diff(one.time, axis=1)
    return np.where(hits, when, np.inf).min(axis=1)


Knot = tuple[Array, Array, Array]  # lon, lat [deg] and time [s] of each particle


def smuggler_ends(rng: np.random.Generator, n: int) -> tuple[Knot, Knot]:
    """Return where and when smugglers depart, from a box, and arrive, at one of three places."""
    told = table("smuggler_bridge")["scenario"][0]["phase"][0]["bridge"]

    def anywhere(point: dict[str, Any]) -> tuple[Array, Array]:
        at = place(point["at"])
        if "box" in point:
            along, across = (number(side) * rng.uniform(-0.5, 0.5, n) for side in point["box"])
            return passages.off(at, along, across, point["orientation"])
        if "radius" in point:
            far, to = (
                number(point["radius"]) * np.sqrt(rng.uniform(size=n)),
                rng.uniform(0, 2 * np.pi, n),
            )
            return passages.off(at, far * np.cos(to), far * np.sin(to), 0.0)
        return passages.about(rng, at, n, number(point["std"]), number(point["std"]))

    def moment(law: Any) -> Array:
        if isinstance(law, dict):
            return number(law["at"][1:]) + number(law["std"]) * rng.standard_normal(n)
        return rng.uniform(*(number(one[1:]) for one in law), n)

    (first,), ends = told["points"], told["destinations"]
    begin = (*anywhere(first), moment(first["time"]))
    chosen = rng.choice(len(ends), n, p=[end["probability"] for end in ends])
    drawn = [(*anywhere(end), moment(end["time"])) for end in ends]
    lon, lat, time = (np.choose(chosen, [one[k] for one in drawn]) for k in range(3))
    return begin, (lon, lat, time)


def smuggler_bridge(rng: np.random.Generator, n: int, hours: float) -> list[Where]:
    """Bridges from a box to one of three places."""
    begin, end = smuggler_ends(rng, n)
    return [
        crossing(
            begin, end, passages.bridge(rng, begin, end, smuggler_k(), hours * HOUR), hours * HOUR
        )
    ]


def smuggler_k() -> float:
    """Return how fast a smuggler's bridge spreads [m/sqrt(s)]."""
    return number(table("smuggler_bridge")["scenario"][0]["phase"][0]["bridge"]["k"])


def crossing(begin: Knot, end: Knot, at: tuple[Array, Array], time: float) -> Where:
    """Return smugglers at a time."""
    status = np.where(
        time < begin[2], Status.PENDING, np.where(time < end[2], Status.UNDER_WAY, Status.ARRIVED)
    )
    return Where(*at, status)


ORACLES: dict[str, Callable[[np.random.Generator, int, float], list[Where]]] = {
    "cast_submarine": cast_submarine,
    "medsearch_transit": medsearch_transit,
    "smuggler_bridge": smuggler_bridge,
}
